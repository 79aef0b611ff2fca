//! The replay page at work.

use std::path::Path;

use anyhow::{Result, ensure};
use jostle_arena::Planner;
use jostle_arena::config::ArenaConfig;
use jostle_arena::crowds::Pools;
use jostle_eval::protocol::Protocol;
use jostle_peds::CrowdKind;

use super::tab::Tab;
use jostle_view::replay::driver::Driver;
use jostle_view::replay::{Wish, record, write as write_page};

/// Episodes in each crowd: among so many, the goal-seeker ends in more than one way.
const EPISODES: usize = 12;

/// Writes a page with two drivers and two crowds; its address.
pub(super) fn write(folder: &Path) -> Result<String> {
    let drivers = [Driver::planner(Planner::GoalSeeker), Driver::planner(Planner::GoalSeeker)];
    let protocol = Protocol::new(ArenaConfig::default(), Pools::default())?;
    let page = record(&protocol, &drivers, &[CrowdKind::Sf, CrowdKind::Vo], &Wish::first(EPISODES))?.page;
    Ok(format!("file://{}", write_page(&page, &folder.join("replay"))?.display()))
}

/// Writes a page with two drivers among 20 pedestrians; its address.
pub(super) fn write_crowded(folder: &Path) -> Result<String> {
    let drivers = [Driver::planner(Planner::GoalSeeker), Driver::planner(Planner::Straight)];
    let config = ArenaConfig { n_agents: 21, ..ArenaConfig::default() };
    let protocol = Protocol::new(config, Pools::default())?;
    let page = record(&protocol, &drivers, &[CrowdKind::Sf], &Wish::first(EPISODES))?.page;
    Ok(format!("file://{}", write_page(&page, &folder.join("crowded"))?.display()))
}

/// A half circle of three beams from a robot that looks along y: to its right, ahead, to its left.
const SECTOR: &str = "JSON.stringify(Scene.ends([1, 2, Math.PI / 2], { range: 10, start: -Math.PI / 2, step: Math.PI / 2 }, \
    [255, 51, 0]).map((end) => end.map((value) => Math.round(value * 1000)))) === '[[11000,2000],[1000,4000],[1000,2000]]'";

/// Plays, steps, scrubs, filters, switches; each leaves its mark on the page.
pub(super) fn check(tab: &mut Tab) -> Result<()> {
    tab.require(SECTOR)?;
    tab.wait("document.body.dataset.playing === 'true' && Number(document.body.dataset.step) > 2")?;
    tab.click("#play")?;
    tab.wait("document.body.dataset.playing === 'false'")?;
    let step = tab.data("step")?;
    tab.require("!document.getElementById('play').classList.contains('playing')")?;
    tab.click("#forward")?;
    tab.key("ArrowRight")?;
    let later = tab.data("step")?;
    // A pause may have caught it between two steps.
    ensure!((step + 2.0..=step + 3.0).contains(&later), "two steps on from {step} is {later}");
    tab.key("End")?;
    let last = tab.number("Number(document.getElementById('timeline').getAttribute('aria-valuemax'))")?;
    ensure!((tab.data("step")? - last).abs() < 0.5, "End is not the last step, {last}");
    tab.require("document.querySelector('.badge').textContent !== 'on its way'")?;

    tab.drag("#timeline", &[(0.9, 0.5), (0.7, 0.5), (0.5, 0.5)])?;
    let middle = tab.data("step")?;
    ensure!((middle - last / 2.0).abs() <= 0.03 * last + 1.0, "the middle of {last} steps is {middle}");

    let all = tab.number("document.querySelectorAll('#episodes li').length")?;
    ensure!(all as usize == 2 * EPISODES, "{all} episodes are listed");
    tab.eval("[...document.querySelectorAll('#filters button')].find(b => b.textContent.startsWith('pedestrian')).id = 'hits'")?;
    tab.click("#hits")?;
    let hits = tab.number("document.querySelectorAll('#episodes li').length")?;
    ensure!(0.0 < hits && hits < all, "a filter leaves {hits} of {all} episodes");
    tab.require(
        "[...document.querySelectorAll('#episodes .run')].every(e => e.textContent.includes('pedestrian'))",
    )?;
    tab.require("document.querySelector('#filters button[aria-pressed=true]').textContent !== ''")?;

    let number = tab.data("episode")?;
    tab.key("ArrowDown")?;
    ensure!(hits < 2.0 || (tab.data("episode")? - number).abs() > 0.5, "the next episode is the same");
    tab.key("l")?;
    tab.require("document.getElementById('layer-laser').getAttribute('aria-pressed') === 'false'")?;
    tab.key("l")?;
    let theme = tab.eval("document.documentElement.dataset.theme")?;
    tab.click("#theme")?;
    ensure!(tab.eval("document.documentElement.dataset.theme")? != theme, "light is as dark");
    tab.click("#theme")?;
    tab.drag("#timeline", &[(0.6, 0.5)])?;
    check_link(tab)
}

/// A link leads to its moment: from another page, from this one, and where a filter hides the
/// episode.
fn check_link(tab: &mut Tab) -> Result<()> {
    let moment =
        "[document.body.dataset.crowd, document.body.dataset.episode, document.body.dataset.step].join(' ')";
    let here = tab.eval(moment)?;
    tab.click("#share")?;
    tab.wait("document.getElementById('said').textContent.startsWith('The link to this moment')")?;
    // The address follows after a moment.
    tab.eval("new Promise((done) => setTimeout(done, 500))")?;
    let link = tab.eval("location.href")?;
    let link = link.as_str().unwrap_or_default();
    tab.key("ArrowDown")?;
    tab.key("End")?;
    ensure!(tab.eval(moment)? != here, "another episode is the same moment");
    tab.go("about:blank?")?;
    tab.go(link)?;
    let found = tab.eval(moment)?;
    ensure!(found == here, "{link}: leads to {found}, not to {here}");
    tab.require("document.body.dataset.playing === 'false'")?;
    // Within the page, to the other crowd, while only pedestrians' collisions are listed.
    tab.eval("location.hash = 'in=VO&episode=2&t=1.5&still=1'")?;
    tab.wait(&format!("{moment} === 'VO 2 15'"))?;
    tab.require("document.querySelector('#episodes [aria-current=true] .crowd').textContent === 'VO'")
}
