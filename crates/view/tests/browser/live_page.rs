//! The live page at work, and the refusals of its server.

use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};
use serde_json::Value;
use tungstenite::Message;

use super::devtools::websocket;
use super::tab::Tab;
use jostle_view::play;

/// Serves the page with the goal-seeker; its address.
pub(super) fn serve() -> Result<String> {
    let address = play::serve_in_background()?;
    Ok(format!("http://{address}/"))
}

/// Plays, pauses, steps, drags the goal, drops people and things, asks for another room.
pub(super) fn check(tab: &mut Tab) -> Result<()> {
    tab.wait("document.body.dataset.connected === 'true' && Number(document.body.dataset.step) > 3")?;
    tab.click("#play")?;
    tab.wait("document.body.dataset.playing === 'false'")?;
    let step = tab.data("step")?;
    tab.key("ArrowRight")?;
    tab.wait(&format!("Number(document.body.dataset.step) === {}", step + 1.0))?;
    tab.click("#step")?;
    tab.wait(&format!("Number(document.body.dataset.step) === {}", step + 2.0))?;

    let goal = tab.eval("document.body.dataset.goal")?;
    tab.drag(".view canvas", &[(0.3, 0.3), (0.4, 0.4), (0.5, 0.25)])?;
    // The middle of the room's width; a quarter of its height from above: (0, 5) of 20 m, with a
    // margin around.
    tab.wait(&format!("document.body.dataset.goal !== {goal}"))?;
    tab.wait("(g => Math.abs(g[0]) < 0.3 && Math.abs(g[1] - 5.2) < 0.3)(document.body.dataset.goal.split(' ').map(Number))")?;

    drop_at_some_place(tab, "2", "pedestrians")?;
    drop_at_some_place(tab, "3", "obstacles")?;
    // Out of the room: the server says why not.
    tab.drag(".view canvas", &[(0.002, 0.002)])?;
    tab.wait("document.getElementById('refused').textContent.startsWith('obstacle: found')")?;

    tab.click("#reset")?;
    tab.wait("document.body.dataset.step === '0' && document.body.dataset.obstacles === '0'")?;
    tab.click("#next")?;
    tab.wait("document.body.dataset.episode === '1'")?;
    tab.eval(
        "document.getElementById('crowd').value = 'VO', document.getElementById('pedestrians').value = 9",
    )?;
    tab.click("#setup button")?;
    tab.wait("document.body.dataset.pedestrians === '9' && document.getElementById('headline').textContent.includes('VO')")?;
    tab.eval("document.getElementById('rate').value = '4', document.getElementById('rate').dispatchEvent(new Event('change'))")?;
    tab.key("1")?;
    tab.click("#play")?;
    tab.wait("document.body.dataset.playing === 'true' && Number(document.body.dataset.step) > 25")?;
    tab.click("#play")?;
    tab.wait("document.body.dataset.playing === 'false'")?;

    // Without a mouse: a cross from the goal on, a metre to the left of it, Enter.
    tab.click("#reset")?;
    tab.wait("document.body.dataset.step === '0'")?;
    let goal = tab.eval("document.body.dataset.goal")?;
    tab.eval("document.querySelector('.view canvas').focus()")?;
    let away = if tab.number("Number(document.body.dataset.goal.split(' ')[0])")? > 0.0 {
        "ArrowLeft"
    } else {
        "ArrowRight"
    };
    tab.key(away)?;
    tab.key(away)?;
    tab.key("Enter")?;
    tab.wait(&format!(
        "(([x, y], [u, v]) => Math.abs(Math.abs(x - u) - 1) < 0.02 && Math.abs(y - v) < 0.02)         (document.body.dataset.goal.split(' ').map(Number), {goal}.split(' ').map(Number))"
    ))?;
    tab.require("document.body.dataset.step === '0'")?;

    // A link to an episode.
    tab.wait("location.hash.includes('crowd=VO') && location.hash.includes('pedestrians=9')")?;
    let link = tab.eval("location.href.replace(/episode=\\d+/, 'episode=6')")?;
    tab.go("about:blank?")?;
    tab.go(link.as_str().unwrap_or_default())?;
    tab.wait("document.body.dataset.episode === '6' && document.body.dataset.pedestrians === '9'")
}

/// Clicks at one place after the other until something is dropped: some may be taken.
fn drop_at_some_place(tab: &mut Tab, key: &str, count: &str) -> Result<()> {
    let before = tab.data(count)?;
    tab.key(key)?;
    for share in [(0.2, 0.5), (0.8, 0.5), (0.2, 0.8), (0.8, 0.8), (0.5, 0.6)] {
        tab.drag(".view canvas", &[share])?;
        tab.eval("new Promise(done => setTimeout(done, 300))")?;
        if tab.data(count)? > before {
            return Ok(());
        }
    }
    bail!("no place was free for {count}")
}

/// Visitors from elsewhere, nonsense and sudden ends: each is answered or dropped, and the next
/// visitor is served.
pub(super) fn check_strangers(url: &str) -> Result<()> {
    let address = url.replacen("http", "ws", 1) + "live";
    let stranger = websocket(&address, Some("http://elsewhere.example"));
    ensure!(stranger.is_err_and(|error| error.to_string().contains("403")), "a stranger's page may connect");
    for _ in 0..3 {
        // Opened and dropped.
        drop(websocket(&address, None)?);
    }
    let mut visit = websocket(&address, None)?;
    for nonsense in
        ["", "{", r#"{"do":"goal","x":1e99,"y":0}"#, r#"{"do":"setup"}"#, r#"{"do":"speed","times":-1}"#]
    {
        visit.send(Message::text(nonsense)).context("the server has left")?;
        wait_for(&mut visit, "refused")?;
    }
    visit.send(Message::text(r#"{"do":"step"}"#)).context("the server has left")?;
    wait_for(&mut visit, "frame")?;
    // Longer than any message may be: the server hangs up, and goes on.
    let _ = visit.send(Message::text("x".repeat(1 << 20)));
    let visits: Vec<_> = (0..4).map(|_| websocket(&address, None)).collect::<Result<_>>()?;
    for mut visit in visits {
        wait_for(&mut visit, "frame")?;
    }
    Ok(())
}

/// Reads until a message of a kind comes.
fn wait_for(visit: &mut tungstenite::WebSocket<std::net::TcpStream>, kind: &str) -> Result<()> {
    visit.get_ref().set_read_timeout(Some(Duration::from_secs(30))).context("a socket without a clock")?;
    loop {
        if let Message::Text(text) = visit.read().context("the server has left")? {
            let told: Value = serde_json::from_str(&text).context("the server sent no JSON")?;
            if told["kind"] == kind {
                return Ok(());
            }
        }
    }
}
