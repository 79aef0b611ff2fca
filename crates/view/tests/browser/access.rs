//! A page without a mouse and without eyes: every control is reached by Tab, and axe-core finds
//! nothing serious.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use jostle_runs::tools::{on_path, target_folder};
use serde_json::Value;

use super::tab::Tab;

/// The engine that accessibility checkers run (<https://github.com/dequelabs/axe-core>), as npm has
/// it.
const AXE: &str = "axe-core@4.14.1";
/// Names its file where npm is not to be asked.
const VARIABLE: &str = "JOSTLE_AXE";

/// The engine's source, fetched once into `target/`.
///
/// # Errors
/// No npm, or no network the first time.
pub(super) fn axe() -> Result<String> {
    let file = match std::env::var_os(VARIABLE) {
        Some(file) => PathBuf::from(file),
        None => fetched()?,
    };
    std::fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))
}

fn fetched() -> Result<PathBuf> {
    let folder = target_folder().join("axe");
    let file = folder.join("node_modules/axe-core/axe.min.js");
    if !file.is_file() {
        let npm = on_path(&["npm", "npm.cmd"]).with_context(|| {
            format!("no npm on the path to fetch {AXE}: install it, or name axe.min.js in {VARIABLE}")
        })?;
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let quiet = ["install", "--no-save", "--no-audit", "--no-fund", "--loglevel=error", "--prefix"];
        let status =
            Command::new(npm).args(quiet).arg(&folder).arg(AXE).status().context("cannot start npm")?;
        ensure!(status.success(), "npm cannot fetch {AXE}");
    }
    Ok(file)
}

/// Requires that axe-core finds no violation that it calls serious or critical, in light and in
/// dark.
pub(super) fn check_with_axe(tab: &mut Tab, axe: &str) -> Result<()> {
    tab.eval(&format!("(() => {{ {axe} }})(), typeof axe === 'object'"))?;
    for theme in ["light", "dark"] {
        tab.eval(&format!("document.documentElement.dataset.theme = '{theme}'"))?;
        let found = tab.eval(
            "axe.run(document, { resultTypes: ['violations'] }).then((run) => run.violations\
             .filter((one) => one.impact === 'serious' || one.impact === 'critical')\
             .map((one) => `${one.id}: ${one.help}: ${one.nodes.slice(0, 3).map((n) => n.html + ' ' + n.failureSummary).join(' | ')}`))",
        )?;
        ensure!(found.as_array().is_some_and(Vec::is_empty), "axe-core, {theme}: {found:#}");
    }
    Ok(())
}

/// Requires that Tab leads to every control that can be used, and that each shows that it has the
/// focus.
pub(super) fn check_keyboard(tab: &mut Tab) -> Result<()> {
    let wanted = strings(&tab.eval(
        "const controls = [...document.querySelectorAll('button, select, input, [tabindex=\"0\"]')]\
         .filter((e) => !e.disabled && e.offsetParent && !(e.type === 'radio' && !e.checked)); \
         controls.forEach((e, k) => { e.dataset.stop = k; }); document.activeElement.blur(); controls.map((e) => e.dataset.stop)",
    )?)?;
    ensure!(wanted.len() > 10, "only {} controls were found", wanted.len());
    let mut reached = BTreeSet::new();
    for _ in 0..wanted.len() + 5 {
        tab.key("Tab")?;
        let stop = tab.eval(
            "((e) => { if (e.dataset.stop === undefined) return ''; const s = getComputedStyle(e); \
             return s.outlineStyle === 'none' || s.outlineWidth === '0px' ? 'hidden focus: ' + e.outerHTML.slice(0, 80) : e.dataset.stop; })\
             (document.activeElement)",
        )?;
        let stop = stop.as_str().unwrap_or_default().to_owned();
        ensure!(!stop.starts_with("hidden"), "{stop}");
        reached.insert(stop);
    }
    let missed: Vec<&String> = wanted.iter().filter(|stop| !reached.contains(*stop)).collect();
    ensure!(
        missed.is_empty(),
        "Tab does not lead to {} of {} controls: {missed:?}",
        missed.len(),
        wanted.len()
    );
    tab.eval("document.activeElement.blur()").map(drop)
}

fn strings(value: &Value) -> Result<Vec<String>> {
    serde_json::from_value(value.clone()).context("no list of texts")
}
