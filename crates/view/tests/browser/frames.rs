//! Pictures a second: a page with 20 pedestrians keeps up with a screen of 60.
//!
//! On a machine with nothing else to do that is what is counted. On a busy one nothing gets its
//! pictures in time; there the page passes by the processor time that a picture takes in each of
//! the browser's processes, which other programs cannot change much.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use jostle_runs::output::note;

use super::tab::Tab;

/// Pictures that are timed together.
const WINDOW: usize = 90;
/// Windows that are timed at most.
const TRIES: usize = 6;
/// Pictures a second of a headless browser's screen.
const SCREEN: f64 = 60.0;
/// The share of them that has to be kept.
const KEPT: f64 = 0.97;

/// Requires 60 pictures a second in the best of some windows, or no more processor time for a
/// picture than a screen waits for one. `what` names the page in the note with the figures.
pub(super) fn check(tab: &mut Tab, what: &str) -> Result<()> {
    // Every drawing of a room is timed on the way.
    tab.eval(
        "window.drawn = []; if (!Scene.timed) { const draw = Scene.draw; Scene.timed = true; Scene.draw = (...given) => { \
         const began = performance.now(); draw(...given); window.drawn.push(performance.now() - began); }; }",
    )?;
    let (mut best, mut least) = (0.0_f64, f64::INFINITY);
    for _ in 0..TRIES {
        let before: BTreeMap<u64, f64> = tab.processor_seconds()?.into_iter().collect();
        let seconds = tab.number(&format!(
            "new Promise((done) => {{ let first = null, k = 0; const next = (stamp) => {{ \
             if (first === null) first = stamp; else if (++k === {WINDOW}) return done((stamp - first) / 1000); \
             requestAnimationFrame(next); }}; requestAnimationFrame(next); }})"
        ))?;
        let used = tab.processor_seconds()?.into_iter();
        let busiest = used.map(|(id, now)| now - before.get(&id).unwrap_or(&0.0)).fold(0.0, f64::max);
        best = best.max(WINDOW as f64 / seconds);
        least = least.min(busiest / WINDOW as f64);
        if best >= KEPT * SCREEN {
            break;
        }
    }
    let median = tab.number("((all) => all[all.length >> 1])([...window.drawn].sort((a, b) => a - b))")?;
    note(&format!(
        "web: {what}: {best:.1} pictures a second; {:.1} ms of the busiest process for a picture; {median:.2} ms to draw a room (median)",
        least * 1e3
    ));
    ensure!(
        best >= KEPT * SCREEN || least <= 1.0 / SCREEN,
        "{what}: {best:.1} pictures a second and {:.1} ms of processor time for one, expected {SCREEN} or {:.1} ms",
        least * 1e3,
        1e3 / SCREEN
    );
    Ok(())
}
