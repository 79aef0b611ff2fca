//! The leaderboard as Markdown, and as one page that sorts by any column and needs nothing else.
//!
//! The page is complete without its script: entries stand in the order of their mean score, and all
//! columns are there. The script sorts rows and shows one group of columns at a time.

use std::fmt::Write as _;

use jostle_arena::Outcome;
use jostle_arena::identity::short;
use jostle_eval::board::BoardEntry;
use jostle_eval::report::grid::{Grid, number};
use jostle_peds::CrowdName;

const TEMPLATE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("board.js");

/// The end at which a value is good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Better {
    High,
    Low,
}

/// A column of numbers.
struct Column {
    /// The group that it is shown with.
    group: &'static str,
    /// Its title.
    head: String,
    /// The meaning of the title, in a line.
    about: String,
    better: Better,
    decimals: usize,
    /// True for shares, which are coloured.
    is_share: bool,
    value: Value,
}

/// An entry's value in a column; nothing where the entry has none.
type Value = Box<dyn Fn(&BoardEntry) -> Option<f64>>;

/// The groups of columns and what they are called.
const GROUPS: [(&str, &str); 3] =
    [("crowds", "Success by crowd"), ("scenes", "Success by scene"), ("drives", "Ends and driving")];

/// Entries by their mean score, the best first; equal ones by name.
pub fn ranked(entries: &[BoardEntry]) -> Vec<&BoardEntry> {
    let mut ranked: Vec<&BoardEntry> = entries.iter().collect();
    ranked.sort_by(|a, b| b.score.mean.total_cmp(&a.score.mean).then_with(|| a.name.cmp(&b.name)));
    ranked
}

/// Entries by a column of the page, the best first, those without a value last; equal ones by name.
///
/// # Errors
/// The heads that there are, where none is `column`.
pub fn sorted<'e>(entries: &'e [BoardEntry], column: &str) -> Result<Vec<&'e BoardEntry>, Vec<String>> {
    let columns = columns(entries.first());
    let Some(chosen) = columns.iter().find(|found| found.head.eq_ignore_ascii_case(column)) else {
        return Err(columns.into_iter().map(|column| column.head).collect());
    };
    let worst = if chosen.better == Better::High { f64::NEG_INFINITY } else { f64::INFINITY };
    let value = |entry: &BoardEntry| (chosen.value)(entry).unwrap_or(worst);
    let mut sorted = ranked(entries);
    sorted.sort_by(|a, b| match chosen.better {
        Better::High => value(b).total_cmp(&value(a)),
        Better::Low => value(a).total_cmp(&value(b)),
    });
    Ok(sorted)
}

/// The table for a terminal, in the order of `sorted`.
pub fn text(sorted: &[&BoardEntry]) -> String {
    grid(sorted).text()
}

/// The table as Markdown, with how it is to be read and the line of every entry.
pub fn markdown(entries: &[BoardEntry]) -> String {
    let ranked = ranked(entries);
    let mut text = format!("## Leaderboard\n\n{}\n", grid(&ranked).markdown());
    for note in notes(entries) {
        let _ = writeln!(text, "- {note}");
    }
    for entry in &ranked {
        let _ = writeln!(
            text,
            "- {}: {}; sha256 {}, seed {}, {} episodes a cell; `{}`",
            entry.name,
            entry.about,
            short(&entry.policy.sha256),
            entry.seed,
            entry.episodes,
            entry.command
        );
    }
    text
}

/// Scores, crowds and SPL, a row for each entry.
fn grid(entries: &[&BoardEntry]) -> Grid {
    let columns = columns(entries.first().copied());
    let shown: Vec<&Column> = columns
        .iter()
        .filter(|column| column.group == "score" || column.group == "crowds" || column.head == "SPL")
        .collect();
    let heads = ["", "robot", "what it is"].into_iter().map(str::to_owned);
    let mut grid = Grid::new(heads.chain(shown.iter().map(|column| column.head.clone())));
    for (i, entry) in entries.iter().enumerate() {
        let mut row = vec![(i + 1).to_string(), entry.name.clone(), entry.kind.label().to_owned()];
        row.extend(shown.iter().map(|column| {
            let value = number((column.value)(entry), column.decimals);
            if column.head == "mean" { format!("{value} {}", interval(entry)) } else { value }
        }));
        grid.push(false, row);
    }
    grid
}

/// The page.
pub fn html(entries: &[BoardEntry]) -> String {
    let columns = columns(entries.first());
    let mut heads = String::new();
    for (i, column) in columns.iter().enumerate() {
        let better = if column.better == Better::High { "high" } else { "low" };
        let _ = write!(
            heads,
            "<th class=\"{}\" scope=\"col\" data-better=\"{better}\"{}><button title=\"{}\">{}</button></th>",
            column.group,
            // The order that the rows stand in.
            if i == 0 { " aria-sort=\"descending\"" } else { "" },
            escaped(&column.about),
            escaped(&column.head)
        );
    }
    let rows: String = ranked(entries).iter().map(|entry| row(entry, &columns)).collect();
    let groups: Vec<String> = GROUPS
        .iter()
        .enumerate()
        .map(|(i, (group, name))| {
            let pressed = i == 0;
            format!("<button data-group=\"{group}\" aria-pressed=\"{pressed}\">{name}</button>")
        })
        .collect();
    let notes: Vec<String> =
        notes(entries).iter().map(|note| format!("<li>{}</li>", escaped(note))).collect();
    TEMPLATE
        .replace("<!-- groups -->", &groups.concat())
        .replace("<!-- heads -->", &heads)
        .replace("<!-- rows -->", &rows)
        .replace("<!-- notes -->", &notes.concat())
        .replace("/* script */", SCRIPT)
}

fn row(entry: &BoardEntry, columns: &[Column]) -> String {
    let mut row = format!(
        "<tr><td class=\"rank\"></td><th scope=\"row\"><details><summary>{}</summary>{}</details></th><td class=\"kind\">{}</td>",
        escaped(&entry.name),
        details(entry),
        entry.kind.label()
    );
    for column in columns {
        let value = (column.value)(entry);
        let shown = number(value, column.decimals);
        let share = value.filter(|_| column.is_share).map(|value| format!(" style=\"--share:{value:.3}\""));
        let ends = if column.head == "mean" {
            format!(" <small>{}</small>", interval(entry))
        } else {
            String::new()
        };
        let worst = &entry.score.worst;
        let title = if column.head == "worst" {
            format!(" title=\"{}, {}\"", escaped(&worst.scene), escaped(worst.crowd.as_str()))
        } else {
            String::new()
        };
        let share_class = match column.better {
            _ if !column.is_share => "",
            Better::High => " share",
            Better::Low => " share bad",
        };
        let _ = write!(
            row,
            "<td class=\"{}{share_class}\" data-value=\"{}\"{}{title}>{shown}{ends}</td>",
            column.group,
            value.map_or_else(String::new, |value| value.to_string()),
            share.unwrap_or_default()
        );
    }
    row + "</tr>\n"
}

/// The part of an entry that is seen when it is opened: identity, line, and every cell.
fn details(entry: &BoardEntry) -> String {
    let crowds = entry.crowds();
    let heads: Vec<String> =
        crowds.iter().map(|crowd| format!("<th>{}</th>", escaped(crowd.as_str()))).collect();
    let mut rows = String::new();
    for scene in entry.scenes() {
        let cells = entry.cells.iter().filter(|cell| cell.scene == scene);
        let cells: Vec<String> = cells
            .map(|cell| {
                let title = format!(
                    "{} of {}: {} hit a pedestrian, {} a wall, {} ran out of time; sha256 of the episodes {}",
                    cell.success,
                    cell.episodes(),
                    cell.collision_pedestrian,
                    cell.collision_wall,
                    cell.timeout,
                    short(&cell.episodes_sha256)
                );
                let rate = cell.success_rate();
                format!("<td class=\"share\" style=\"--share:{rate:.3}\" title=\"{title}\">{rate:.2}</td>")
            })
            .collect();
        let _ = write!(rows, "<tr><th>{}</th>{}</tr>", escaped(scene), cells.concat());
    }
    format!(
        "<p>{}</p><p><code>{}</code></p><p class=\"sha\">sha256 {}, z = {}, seed {}, {} episodes a cell</p>\
         <table class=\"cells\"><tr><td></td>{}</tr>{rows}</table>",
        escaped(&entry.about),
        escaped(&entry.command),
        escaped(&entry.policy.sha256),
        entry.token,
        entry.seed,
        entry.episodes,
        heads.concat()
    )
}

/// Notes below the table.
fn notes(entries: &[BoardEntry]) -> Vec<String> {
    let mut episodes: Vec<u64> = entries.iter().map(|entry| entry.episodes).collect();
    episodes.sort_unstable();
    episodes.dedup();
    let episodes: Vec<String> = episodes.iter().map(ToString::to_string).collect();
    let suite = entries.first().map_or("standard", |entry| entry.suite.as_str());
    let cells = entries.first().map_or(0, |entry| entry.cells.len());
    vec![
        format!(
            "Success on the suite {suite}: {cells} cells, each a scene among a crowd, {} episodes a cell, the same for every robot. Nothing of \
             this is of the paper.",
            episodes.join(" or ")
        ),
        "mean: over the cells, with the 95 % interval of its episodes; worst: the lowest cell; CVaR: mean of the worst quarter of the cells. \
         A crowd's figure is the mean over the scenes, a scene's that over the crowds."
            .to_owned(),
        "A planner that knows positions reads everyone's true position and velocity; all others read the laser, the goal and their own velocity."
            .to_owned(),
        "Every entry has the SHA-256 of its policy and of the episodes of every cell. Its line runs it again and fails where a single bit \
         is another (docs/leaderboard.md)."
            .to_owned(),
    ]
}

fn interval(entry: &BoardEntry) -> String {
    let ends = entry.mean_interval();
    format!("({:.3}–{:.3})", ends.low, ends.high)
}

/// All columns of numbers: scores first, then crowds and scenes as an entry has them.
fn columns(entry: Option<&BoardEntry>) -> Vec<Column> {
    let column = |group, head: &str, about: &str, value: Value| Column {
        group,
        head: head.to_owned(),
        about: about.to_owned(),
        better: Better::High,
        decimals: 3,
        is_share: true,
        value,
    };
    let mut columns = vec![
        column("score", "mean", "mean success of all cells", Box::new(|entry| Some(entry.score.mean))),
        column("score", "worst", "success of the worst cell", Box::new(|e| Some(e.score.worst.success_rate))),
        column("score", "CVaR", "mean of the worst quarter of the cells", Box::new(|e| Some(e.score.cvar))),
    ];
    let crowds: Vec<CrowdName> = entry.map(BoardEntry::crowds).unwrap_or_default();
    for crowd in crowds {
        let about = format!("mean success among crowd {crowd}, all scenes");
        let value = move |entry: &BoardEntry| entry.mean(|cell| cell.crowd == crowd);
        columns.push(column("crowds", crowd.as_str(), &about, Box::new(value)));
    }
    let scenes = entry.map(BoardEntry::scenes).unwrap_or_default();
    for scene in scenes.into_iter().map(str::to_owned) {
        let about = format!("mean success on {scene}, all crowds");
        let head = scene.clone();
        let value = move |entry: &BoardEntry| entry.mean(|cell| cell.scene == scene);
        columns.push(column("scenes", &head, &about, Box::new(value)));
    }
    for (head, about, outcome) in [
        ("hit pedestrian", "share of all episodes that hit a pedestrian", Outcome::CollisionPedestrian),
        ("hit wall", "share of all episodes that hit a wall", Outcome::CollisionWall),
        ("timeout", "share of all episodes that ran out of time", Outcome::Timeout),
    ] {
        let value = move |entry: &BoardEntry| Some(entry.share(outcome));
        columns.push(Column { better: Better::Low, ..column("drives", head, about, Box::new(value)) });
    }
    columns.push(column(
        "drives",
        "SPL",
        "success weighted by the way's length (Anderson et al. 2018)",
        Box::new(|entry| entry.driving.spl),
    ));
    columns.push(column(
        "drives",
        "time eff.",
        "time at full speed straight to the goal over the time taken, successes only",
        Box::new(|entry| entry.driving.time_efficiency),
    ));
    columns.push(Column {
        is_share: false,
        ..column(
            "drives",
            "clearance (m)",
            "mean of the least clearances in their lowest 5 %",
            Box::new(|entry| entry.driving.min_clearance_tail),
        )
    });
    columns.push(Column {
        better: Better::Low,
        ..column(
            "drives",
            "in 0.45 m",
            "share of the time within 0.45 m of a pedestrian",
            Box::new(|entry| entry.driving.intimate),
        )
    });
    columns
}

/// Text that can stand in HTML, in quotes as well.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
pub(crate) mod tests {
    use jostle_arena::identity::PolicyIdentity;
    use jostle_eval::board::{BoardCell, EntryKind, FORMAT};
    use jostle_eval::driving::DrivingSummary;
    use jostle_eval::report::SuiteScore;
    use jostle_peds::CrowdKind;

    use super::*;

    /// An entry of two scenes among two crowds, with so many of ten episodes brought to the goal.
    fn entry(name: &str, successes: [u64; 4]) -> BoardEntry {
        let places = [("a", CrowdKind::Vo), ("a", CrowdKind::Sf), ("b", CrowdKind::Vo), ("b", CrowdKind::Sf)];
        let cell = |((scene, crowd), success): ((&str, CrowdKind), u64)| BoardCell {
            scene: scene.to_owned(),
            crowd: crowd.into(),
            n_agents: 5,
            success,
            collision_wall: 0,
            collision_pedestrian: 10 - success,
            timeout: 0,
            cell: "0".repeat(64),
            episodes_sha256: "1".repeat(64),
        };
        let cells: Vec<BoardCell> = places.into_iter().zip(successes).map(cell).collect();
        let rated = cells.iter().map(|cell| (cell.scene.as_str(), cell.crowd, cell.success_rate()));
        BoardEntry {
            format: FORMAT.to_owned(),
            name: name.to_owned(),
            kind: EntryKind::Own,
            about: "drives <b>on</b>".to_owned(),
            command: "python \"mine.py\"".to_owned(),
            policy: PolicyIdentity::custom(name, "1"),
            token: 0,
            suite: "two".to_owned(),
            seed: 0,
            episodes: 10,
            score: SuiteScore::new(rated).unwrap(),
            driving: DrivingSummary { spl: Some(0.5), ..DrivingSummary::EMPTY },
            cells,
        }
    }

    #[test]
    fn the_best_mean_comes_first_in_every_form() {
        let entries =
            [entry("worse", [5, 5, 5, 5]), entry("better", [9, 8, 7, 4]), entry("also", [5, 5, 5, 5])];
        let order: Vec<&str> = ranked(&entries).iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(order, ["better", "also", "worse"]);
        let text = markdown(&entries);
        // Means: 28 of 40; VO 16 of 20, SF 12 of 20; the worst quarter of four cells is one.
        let interval = interval(&entries[1]);
        let line = format!("| 1 | better | own | 0.700 {interval} | 0.400 | 0.400 | 0.800 | 0.600 | 0.500 |");
        assert!(text.contains(&line), "{text}");
        assert!(text.contains("sha256 ") && text.contains("`python \"mine.py\"`"), "{text}");
        let page = html(&entries);
        let at = |name: &str| page.find(&format!("<summary>{name}</summary>")).unwrap();
        assert!(at("better") < at("also") && at("also") < at("worse"));
    }

    #[test]
    fn the_page_holds_every_value_and_no_name_becomes_markup() {
        let page = html(&[entry("one", [9, 8, 7, 4])]);
        assert!(page.contains("drives &lt;b&gt;on&lt;/b&gt;") && !page.contains("<b>on"), "{page}");
        assert!(page.contains("<code>python &quot;mine.py&quot;</code>"));
        for value in [
            "data-value=\"0.7",
            ">0.700 <small>",
            ">0.800</td>",
            ">0.300</td>",
            ">0.40</td>",
            "title=\"b, SF\">0.400",
        ] {
            assert!(page.contains(value), "{value}");
        }
        // What a driving summary does not have is a dash that sorts last.
        assert!(page.contains("data-value=\"\">–</td>"));
        for placeholder in ["<!-- ", "/* script */"] {
            assert!(!page.contains(placeholder), "{placeholder} is left");
        }
        assert!(!page.contains("http://") && !page.contains("https://"), "the page needs the network");
    }

    #[test]
    fn a_column_sorts_by_what_is_better_in_it() {
        let entries = [entry("a", [9, 1, 9, 1]), entry("b", [5, 5, 5, 6]), entry("c", [5, 5, 5, 6])];
        let order = |column: &str| -> Vec<String> {
            sorted(&entries, column).unwrap().iter().map(|entry| entry.name.clone()).collect()
        };
        assert_eq!(order("mean"), ["b", "c", "a"]);
        assert_eq!((order("VO"), order("sf")), (vec!["a".into(), "b".into(), "c".into()], order("mean")));
        assert_eq!(order("hit pedestrian"), ["b", "c", "a"], "less is better");
        let heads = sorted(&entries, "speed").unwrap_err();
        assert_eq!(heads[..6], ["mean", "worst", "CVaR", "VO", "SF", "a"]);
        assert!(text(&ranked(&entries)).lines().nth(2).unwrap().starts_with("1  b "));
    }

    #[test]
    fn an_empty_board_is_a_page() {
        assert!(markdown(&[]).starts_with("## Leaderboard") && html(&[]).contains("</html>"));
    }
}
