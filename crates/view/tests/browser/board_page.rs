//! The leaderboard's page, as it is made of the stored entries: everything on it that has to work.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use jostle_eval::board::BoardEntry;
use jostle_runs::provenance::workspace;
use jostle_runs::run_folder::write_atomically;

use super::tab::Tab;

/// Writes the page; its address.
pub(super) fn write(folder: &Path) -> Result<String> {
    let stored = workspace().join("results/leaderboard");
    let listed = std::fs::read_dir(&stored).with_context(|| format!("cannot list {}", stored.display()))?;
    let mut files = listed.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    files.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    let entries =
        files.iter().map(|path| Ok(BoardEntry::read(path)?)).collect::<Result<Vec<BoardEntry>>>()?;
    let path = folder.join("leaderboard.html");
    write_atomically(&path, &jostle_view::board::html(&entries))?;
    Ok(format!("file://{}", path.display()))
}

/// The values of a column from the first row to the last.
fn column(head: &str) -> String {
    format!(
        "(() => {{ const heads = [...document.querySelectorAll('#board > thead th')]; \
         const k = heads.findIndex((head) => head.textContent === '{head}'); \
         return [...document.querySelectorAll('#board > tbody > tr')].map((row) => Number(row.cells[k].dataset.value)); }})()"
    )
}

/// An expression that is true if the values of a column fall (−1) or rise (1) from row to row.
fn runs(head: &str, way: i32) -> String {
    format!("{}.every((value, k, all) => k === 0 || {way} * (value - all[k - 1]) >= 0)", column(head))
}

/// Sorts both ways, shows groups of columns, opens an entry.
pub(super) fn check(tab: &mut Tab) -> Result<()> {
    let rows = tab.number("document.querySelectorAll('#board > tbody > tr').length")?;
    ensure!(rows >= 2.0, "{rows} entries, expected some to sort");
    tab.require(&runs("mean", -1))?;
    tab.eval("[...document.querySelectorAll('#board > thead button')].forEach((b) => { b.id = `by-${b.textContent.replaceAll(' ', '-')}`; })")?;
    tab.click("#by-VO")?;
    tab.require(&runs("VO", -1))?;
    tab.require("document.querySelector('#by-VO').parentElement.getAttribute('aria-sort') === 'descending'")?;
    tab.click("#by-VO")?;
    tab.require(&runs("VO", 1))?;
    tab.require("document.querySelectorAll('[aria-sort]').length === 1")?;
    tab.require("document.querySelector('#board > tbody .rank').textContent === '1'")?;
    tab.require("document.querySelector('#by-timeout').offsetParent === null")?;
    tab.click("[data-group=drives]")?;
    tab.require("document.querySelector('#by-VO').offsetParent === null")?;
    tab.click("#by-timeout")?;
    // Less is better.
    tab.require(&runs("timeout", 1))?;
    tab.click("[data-group=crowds]")?;
    tab.click("#by-mean")?;
    tab.require(&runs("mean", -1))?;
    tab.click("#board > tbody > tr:first-child summary")?;
    tab.require("document.querySelector('#board details[open] code').textContent.includes('leaderboard ')")?;
    let cells = tab.number("document.querySelectorAll('#board details[open] .cells td.share').length")?;
    ensure!(cells > 0.0, "an open entry shows no cell");
    tab.require("document.documentElement.scrollWidth <= window.innerWidth")
}
