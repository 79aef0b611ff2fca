//! `cargo xtask ci --web`: the replay page, the live page and the leaderboard in a real browser,
//! without a window.
//!
//! Reading order: [`replay_page`], [`live_page`] and [`board_page`] (what is checked), [`access`]
//! (without a mouse, without eyes), [`frames`] (how smoothly), [`tab`] (a page and a visitor's
//! hands), [`devtools`] (the protocol), [`chromium`] (the program).
//!
//! Rejected: a crate for the whole DevTools protocol. The dozen calls that are made here need a
//! WebSocket and JSON, which are there already.

mod access;
mod board_page;
mod chromium;
mod devtools;
mod frames;
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

/// All pages at both sizes; screenshots go to `runs/web`.
#[test]
#[ignore = "needs Chromium: `cargo xtask ci --web` runs it"]
fn all_pages_work() -> Result<()> {
    let browser = Chromium::start()?;
    let folder = workspace().join("runs/web");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let replay = replay_page::write(&folder)?;
    let live = live_page::serve()?;
    let axe = access::axe()?;
    let board = board_page::write(&folder)?;
    for (name, width, height) in SIZES {
        in_tab(
            &browser,
            &replay,
            (width, height),
            &folder.join(format!("replay-{name}.png")),
            &axe,
            replay_page::check,
        )
        .with_context(|| format!("replay page, {name}"))?;
        let picture = folder.join(format!("live-{name}.png"));
        in_tab(&browser, &live, (width, height), &picture, &axe, live_page::check)
            .with_context(|| format!("live page, {name}"))?;
        let mut tab = Tab::open(&browser, (width, height))?;
        let checked = tab.go(&board).and_then(|()| board_page::check(&mut tab));
        checked.and_then(|()| tab.check_quiet()).with_context(|| format!("leaderboard, {name}"))?;
        tab.screenshot(&folder.join(format!("leaderboard-{name}.png")))?;
        note(&format!("web: all pages work at {width} × {height}"));
    }
    live_page::check_strangers(&live)?;
    smoothly(&browser, &folder, &live)?;
    note(&format!("web: screenshots are in {}", folder.display()));
    Ok(())
}

fn in_tab(
    browser: &Chromium,
    url: &str,
    size: (u32, u32),
    picture: &Path,
    axe: &str,
    check: fn(&mut Tab) -> Result<()>,
) -> Result<()> {
    let mut tab = Tab::open(browser, size)?;
    tab.go(url)?;
    check(&mut tab)?;
    tab.check_legible()?;
    tab.check_quiet()?;
    tab.screenshot(picture)?;
    access::check_keyboard(&mut tab)?;
    access::check_with_axe(&mut tab, axe)
}

/// Both pages with 20 pedestrians: the replay with two policies, the live page with one.
fn smoothly(browser: &Chromium, folder: &Path, live: &str) -> Result<()> {
    let (_, width, height) = SIZES[0];
    let mut tab = Tab::open(browser, (width, height))?;
    tab.go(&replay_page::write_crowded(folder)?)?;
    tab.wait("document.body.dataset.playing === 'true' && Number(document.body.dataset.step) > 10")?;
    frames::check(&mut tab, "replay page, 20 pedestrians, two policies")?;
    tab.screenshot(&folder.join("replay-crowded.png"))?;
    let mut tab = Tab::open(browser, (width, height))?;
    tab.go(&format!("{live}#pedestrians=20"))?;
    tab.wait("document.body.dataset.pedestrians === '20' && Number(document.body.dataset.step) > 30")?;
    frames::check(&mut tab, "live page, 20 pedestrians")?;
    tab.screenshot(&folder.join("live-crowded.png"))
}
