//! The table of README.md: who drives how well, out of the stored tables and without their
//! provenance, which those have.

use std::path::Path;

use anyhow::{Context as _, Result};
use jostle_eval::report::grid::{Grid, number};
use jostle_eval::report::{PooledCell, PooledRow, PooledTable};
use jostle_runs::folder::read_optional;

/// A line: the stored table, the labels of its row there, and what the line is called.
type Line = (&'static str, &'static [&'static str], &'static str);

/// Learned policies beside planners that nobody trained, the best ones first.
const LINES: [Line; 7] = [
    ("strong", &["5", "strong"], "**strong**: learned here, 50 million transitions"),
    ("strong", &["5", "orca (knows positions)"], "orca: planner that knows all positions"),
    ("strong", &["5", "dwa"], "dwa: planner, a dynamic window"),
    ("strong", &["5", "goal-seeker"], "goal-seeker: planner, a hundred lines"),
    ("table1", &["1", "5000", "5000"], "M = 1: the paper's baseline, ours"),
    ("table1", &["5", "5000", "1000"], "M = 5: the paper's method, ours"),
    ("strong", &["5", "straight"], "straight on"),
];

/// The table as Markdown; `None` while one of the stored tables or rows is not there.
///
/// # Errors
/// A stored table that cannot be read.
pub(super) fn overview(results: &Path) -> Result<Option<String>> {
    let (Some(table1), Some(strong)) = (stored(results, "table1")?, stored(results, "strong")?) else {
        return Ok(None);
    };
    let crowds = &table1.columns[..6];
    let mut grid =
        Grid::new(["robot"].into_iter().chain(crowds.iter().map(String::as_str)).chain(["average (95 %)"]));
    for (id, labels, name) in LINES {
        let table = if id == table1.id { &table1 } else { &strong };
        let Some(row) = table.rows.iter().find(|row| row.labels == labels) else { return Ok(None) };
        let Some(cells) = row.cells.iter().map(Option::as_ref).collect::<Option<Vec<&PooledCell>>>() else {
            return Ok(None);
        };
        grid.push(false, line(name, &cells));
        grid_paper(&mut grid, row);
    }
    Ok(Some(grid.markdown()))
}

fn stored(results: &Path, id: &str) -> Result<Option<PooledTable>> {
    let path = results.join(format!("{id}.json"));
    let text = read_optional(&path)?;
    text.map(|text| serde_json::from_str(&text).with_context(|| format!("{}: is no table", path.display())))
        .transpose()
}

fn line(name: &str, cells: &[&PooledCell]) -> Vec<String> {
    let mut line = vec![name.to_owned()];
    let (average, rates) = cells.split_last().expect("a row has cells");
    line.extend(rates.iter().map(|cell| number(cell.value, 3)));
    let ends =
        average.interval.map_or_else(String::new, |ends| format!(" ({:.3} to {:.3})", ends.low, ends.high));
    line.push(number(average.value, 3) + &ends);
    line
}

/// The paper's figures below ours, where it has any.
fn grid_paper(grid: &mut Grid, row: &PooledRow) {
    if let Some(figures) =
        row.paper.iter().copied().collect::<Option<Vec<_>>>().filter(|figures| !figures.is_empty())
    {
        let printed = figures.iter().map(|(figure, _)| format!("{figure:.2}"));
        grid.push(false, ["*printed in the paper*".to_owned()].into_iter().chain(printed).collect());
    }
}
