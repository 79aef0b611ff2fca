//! `docs/reproduction.md` and `README.md`: their tables are filled from `results/`, their prose is
//! written by hand; `docs/model-cards.md` is written whole ([`super::cards`]).
//!
//! README.md's own table is made of the stored ones ([`super::overview`]). A table is between `<!--
//! begin: NAME -->` and `<!-- end: NAME -->`: the file `results/NAME.md`. Figures are copied to
//! `docs/images/`, as a book holds what is below its own folder alone.

use std::path::Path;

use anyhow::{Context as _, Result, bail};

use super::cards;
use super::overview::overview;
use jostle_runs::folder::read_optional;
use jostle_runs::output::note;
use jostle_runs::provenance::workspace;
use jostle_runs::run_folder::write_atomically;

/// The pictures of the pages: where they are below `results/`, and their names in `docs/images/`.
const FIGURES: [(&str, &str); 3] = [
    ("figure-loss.svg", "figure-loss.svg"),
    ("figure-paths.svg", "figure-paths.svg"),
    ("study/results.svg", "study.svg"),
];

/// The table that is made of others instead of being a file.
const OVERVIEW: &str = "overview";
/// The text in place of a result that is not there.
const NOTHING: &str = "*Not run yet.*\n";

/// The pages with tables, the one with all of them first.
const PAGES: [&str; 6] = [
    "docs/reproduction.md",
    "README.md",
    "docs/study.md",
    "docs/planners.md",
    "docs/how-to-dynamics.md",
    "docs/leaderboard.md",
];

/// The page that is written whole.
pub(super) const CARDS: &str = "docs/model-cards.md";

/// Fills the pages from a folder of results, and writes the cards of the policies of a folder.
pub(super) fn fill_all(results: &Path, checkpoints: &Path) -> Result<()> {
    if let Some(cards) = cards::page(checkpoints, results)? {
        write_atomically(&workspace().join(CARDS), &cards)?;
    }
    for page in PAGES {
        fill(&workspace().join(page), results)?;
    }
    for (from, to) in FIGURES {
        if let Some(picture) = read_optional(&results.join(from))? {
            write_atomically(&workspace().join("docs/images").join(to), &picture)?;
        }
    }
    note(&format!("{}, {CARDS}: filled from {}", PAGES.join(", "), results.display()));
    Ok(())
}

/// Fills one page's tables.
fn fill(page: &Path, results: &Path) -> Result<()> {
    let text = read_optional(page)?.with_context(|| format!("{} is missing", page.display()))?;
    let filled = filled(&text, results).with_context(|| page.display().to_string())?;
    if filled != text {
        write_atomically(page, &filled)?;
    }
    Ok(())
}

/// The text with every table replaced by its result.
fn filled(text: &str, results: &Path) -> Result<String> {
    let mut filled = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("<!-- begin: ") {
        let line_end = rest[at..].find('\n').map_or(rest.len(), |end| at + end + 1);
        let name = rest[at..line_end].trim().trim_start_matches("<!-- begin: ").trim_end_matches(" -->");
        let end_mark = format!("<!-- end: {name} -->");
        let Some(end) = rest[line_end..].find(&end_mark).map(|end| line_end + end) else {
            bail!("no {end_mark} after its begin");
        };
        let result = match name {
            OVERVIEW => overview(results)?,
            _ => read_optional(&results.join(format!("{name}.md")))?,
        };
        let body = result.map_or_else(|| NOTHING.to_owned(), |text| demoted(&text));
        for part in [&rest[..line_end], "\n", body.trim_end(), "\n\n", &end_mark] {
            filled += part;
        }
        rest = &rest[end + end_mark.len()..];
    }
    Ok(filled + rest)
}

/// Headings one level lower, so that they fit into a page.
fn demoted(text: &str) -> String {
    text.lines()
        .map(|line| if line.starts_with("##") { format!("#{line}\n") } else { format!("{line}\n") })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_replaced_and_prose_stays() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.md"), "## A\n\n| 1 |\n").unwrap();
        let page = "# Page\nProse.\n<!-- begin: a -->\nold\n<!-- end: a -->\nMore.\n<!-- begin: b -->\n<!-- end: b -->\n";
        let once = filled(page, folder.path()).unwrap();
        assert_eq!(
            once,
            "# Page\nProse.\n<!-- begin: a -->\n\n### A\n\n| 1 |\n\n<!-- end: a -->\nMore.\n<!-- begin: b -->\n\n\
             *Not run yet.*\n\n<!-- end: b -->\n"
        );
        assert_eq!(filled(&once, folder.path()).unwrap(), once);
        assert!(filled("<!-- begin: a -->\n", folder.path()).is_err());
    }

    #[test]
    fn the_pages_are_what_the_results_say() {
        for page in PAGES {
            let text = std::fs::read_to_string(workspace().join(page)).unwrap();
            let expected = filled(&text, &workspace().join("results")).unwrap();
            assert!(text == expected, "{page}: run `cargo xtask reproduce page`: results/ has changed");
            let names: &[&str] = match page {
                "README.md" => &[OVERVIEW],
                "docs/study.md" => &["study/summary"],
                "docs/planners.md" => &["table1"],
                "docs/how-to-dynamics.md" => &["dynamics"],
                "docs/leaderboard.md" => &["leaderboard/leaderboard"],
                _ => &[
                    "table1", "table2", "table3", "table4", "table5", "dynamics", "claims", "strong",
                    "tokens", "outcomes", "driving",
                ],
            };
            for name in names {
                assert!(text.contains(&format!("<!-- begin: {name} -->")), "{page}: {name}");
            }
        }
        for (from, to) in FIGURES {
            let read = |path: &str| read_optional(&workspace().join(path)).unwrap();
            let (result, picture) = (read(&format!("results/{from}")), read(&format!("docs/images/{to}")));
            assert!(result == picture, "{to}: run `cargo xtask reproduce page`");
        }
    }
}
