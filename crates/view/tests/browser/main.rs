//! `cargo xtask ci --web`: the replay page and the live page in a real browser, without a window.
//!
//! Reading order: [`replay_page`] and [`live_page`] (what is checked), [`tab`] (a page and a visitor's hands), [`devtools`]
//! (the protocol), [`chromium`] (the program).
//!
//! Rejected: a crate for the whole DevTools protocol. The dozen calls that are made here need a WebSocket and JSON, which
//! are there already.

mod chromium;
mod devtools;
mod live_page;
mod replay_page;
mod tab;

use std::path::Path;

use anyhow::{Context as _, Result};

use self::chromium::Chromium;
use self::tab::Tab;
use jostle_runs::output::note;
use jostle_runs::provenance::workspace;

/// A window as on a desk, and as on a telephone.
const SIZES: [(&str, u32, u32); 2] = [("desk", 1280, 800), ("phone", 390, 844)];

/// Both pages at both sizes; screenshots go to `runs/web`.
#[test]
#[ignore = "needs Chromium: `cargo xtask ci --web` runs it"]
fn both_pages_work() -> Result<()> {
    let browser = Chromium::start()?;
    let folder = workspace().join("runs/web");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let replay = replay_page::write(&folder)?;
    let live = live_page::serve()?;
    for (name, width, height) in SIZES {
        in_tab(
            &browser,
            &replay,
            (width, height),
            &folder.join(format!("replay-{name}.png")),
            replay_page::check,
        )
        .with_context(|| format!("replay page, {name}"))?;
        in_tab(&browser, &live, (width, height), &folder.join(format!("live-{name}.png")), live_page::check)
            .with_context(|| format!("live page, {name}"))?;
        note(&format!("web: both pages work at {width} × {height}"));
    }
    live_page::check_strangers(&live)?;
    note(&format!("web: screenshots are in {}", folder.display()));
    Ok(())
}

fn in_tab(
    browser: &Chromium,
    url: &str,
    size: (u32, u32),
    picture: &Path,
    check: fn(&mut Tab) -> Result<()>,
) -> Result<()> {
    let mut tab = Tab::open(browser, size)?;
    tab.go(url)?;
    check(&mut tab)?;
    tab.check_legible()?;
    tab.check_quiet()?;
    tab.screenshot(picture)
}
