//! A page in the browser, and a visitor's hands and eyes.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde_json::{Value, json};

use super::chromium::Chromium;
use super::devtools::DevTools;
use jostle_runs::run_folder::write_bytes_atomically;

/// Longest time for something to happen on a busy machine.
const PATIENCE: Duration = Duration::from_secs(30);
/// Smallest letters that count as legible (CSS pixels).
const LETTERS: f64 = 11.0;

/// A page of a given size.
pub(super) struct Tab {
    devtools: DevTools,
    session: String,
    size: (u32, u32),
}

impl Tab {
    /// Opens an empty page.
    pub(super) fn open(browser: &Chromium, size: (u32, u32)) -> Result<Self> {
        let mut devtools = DevTools::connect(&browser.address)?;
        let target = devtools.call(None, "Target.createTarget", &json!({ "url": "about:blank" }))?;
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = devtools.call(None, "Target.attachToTarget", &attach)?;
        let session = attached["sessionId"].as_str().context("a page without a session")?.to_owned();
        let mut tab = Self { devtools, session, size };
        for domain in ["Page", "Runtime", "Log"] {
            tab.call(&format!("{domain}.enable"), &json!({}))?;
        }
        let (width, height) = size;
        let narrow = width < 800;
        tab.call(
            "Emulation.setDeviceMetricsOverride",
            &json!({ "width": width, "height": height, "deviceScaleFactor": if narrow { 2 } else { 1 }, "mobile": narrow }),
        )?;
        Ok(tab)
    }

    fn call(&mut self, method: &str, parameters: &Value) -> Result<Value> {
        self.devtools.call(Some(&self.session), method, parameters)
    }

    /// Processor time of each of the browser's processes since its start (s), by the process'
    /// number.
    pub(super) fn processor_seconds(&mut self) -> Result<Vec<(u64, f64)>> {
        let told = self.devtools.call(None, "SystemInfo.getProcessInfo", &json!({}))?;
        let processes = told["processInfo"].as_array().context("a browser without processes")?;
        processes
            .iter()
            .map(|process| process["id"].as_u64().zip(process["cpuTime"].as_f64()))
            .collect::<Option<_>>()
            .context("a process without a number or a time")
    }

    /// Loads a page and waits until it is complete.
    pub(super) fn go(&mut self, url: &str) -> Result<()> {
        let went = self.call("Page.navigate", &json!({ "url": url }))?;
        if let Some(error) = went["errorText"].as_str() {
            bail!("{url}: {error}");
        }
        self.wait("document.readyState === 'complete' && location.href !== 'about:blank'")
    }

    /// The value of an expression.
    pub(super) fn eval(&mut self, expression: &str) -> Result<Value> {
        let asked = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let told = self.call("Runtime.evaluate", &asked)?;
        if let Some(exception) = told.get("exceptionDetails") {
            let what = exception["exception"]["description"].as_str().unwrap_or("an exception");
            bail!("{expression}: {what}");
        }
        Ok(told["result"]["value"].clone())
    }

    /// The value of an expression that is a number.
    pub(super) fn number(&mut self, expression: &str) -> Result<f64> {
        let value = self.eval(expression)?;
        value.as_f64().with_context(|| format!("{expression} is {value}, expected a number"))
    }

    /// The body's data attribute, as a number.
    pub(super) fn data(&mut self, name: &str) -> Result<f64> {
        self.number(&format!("Number(document.body.dataset.{name})"))
    }

    /// Waits until an expression is true.
    pub(super) fn wait(&mut self, expression: &str) -> Result<()> {
        let started = Instant::now();
        loop {
            if self.eval(expression)? == Value::Bool(true) {
                return Ok(());
            }
            ensure!(started.elapsed() < PATIENCE, "not within {PATIENCE:?}: {expression}");
            std::thread::sleep(Duration::from_millis(40));
        }
    }

    /// Requires that an expression is true now.
    pub(super) fn require(&mut self, expression: &str) -> Result<()> {
        ensure!(self.eval(expression)? == Value::Bool(true), "not so: {expression}");
        Ok(())
    }

    /// Place of a share of an element's box on the page, after it was scrolled into view.
    fn place(&mut self, selector: &str, (x, y): (f64, f64)) -> Result<(f64, f64)> {
        let quoted = Value::from(selector);
        let place = self.eval(&format!(
            "(() => {{ const e = document.querySelector({quoted}); if (!e) return null; \
             e.scrollIntoView({{ block: 'nearest', inline: 'nearest' }}); \
             const b = e.getBoundingClientRect(); return [b.left + {x} * b.width, b.top + {y} * b.height]; }})()"
        ))?;
        match (place[0].as_f64(), place[1].as_f64()) {
            (Some(x), Some(y)) => Ok((x, y)),
            _ => bail!("there is no {selector}"),
        }
    }

    fn mouse(&mut self, kind: &str, (x, y): (f64, f64), buttons: u8) -> Result<()> {
        let event =
            json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", &event).map(drop)
    }

    /// Clicks in the middle of an element.
    pub(super) fn click(&mut self, selector: &str) -> Result<()> {
        self.drag(selector, &[(0.5, 0.5)])
    }

    /// Presses at the first place (shares of the element's box), moves along the others and lets
    /// go.
    pub(super) fn drag(&mut self, selector: &str, places: &[(f64, f64)]) -> Result<()> {
        let mut last = (0.0, 0.0);
        for (index, share) in places.iter().enumerate() {
            last = self.place(selector, *share)?;
            self.mouse("mouseMoved", last, u8::from(index > 0))?;
            if index == 0 {
                self.mouse("mousePressed", last, 1)?;
            }
        }
        self.mouse("mouseReleased", last, 0)
    }

    /// Presses a key, such as `ArrowRight` or a letter.
    pub(super) fn key(&mut self, key: &str) -> Result<()> {
        let text = if key.chars().count() == 1 { key } else { "" };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({ "type": kind, "key": key });
            // The browser itself acts on these, and knows them by their numbers.
            if let Some(number) = [("Tab", 9), ("Enter", 13)].iter().find(|(name, _)| *name == key) {
                event["code"] = key.into();
                event["windowsVirtualKeyCode"] = number.1.into();
            }
            if kind == "keyDown" && !text.is_empty() {
                event["text"] = text.into();
            }
            self.call("Input.dispatchKeyEvent", &event)?;
        }
        Ok(())
    }

    /// Requires that the page fits its window's width, and its height where it is not narrow; that
    /// no letters are too small; and that each canvas shows something.
    pub(super) fn check_legible(&mut self) -> Result<()> {
        let (width, height) = self.size;
        self.require(&format!("document.documentElement.scrollWidth <= {width}"))?;
        if width >= 800 {
            self.require(&format!("document.documentElement.scrollHeight <= {height}"))?;
        }
        let small = self.eval(&format!(
            "[...document.querySelectorAll('body *')].filter(e => e.offsetParent && [...e.childNodes].some(n => \
             n.nodeType === 3 && n.data.trim()) && parseFloat(getComputedStyle(e).fontSize) < {LETTERS}) \
             .map(e => e.outerHTML.slice(0, 80))"
        ))?;
        ensure!(small.as_array().is_some_and(Vec::is_empty), "letters below {LETTERS} pixels: {small}");
        let blank = self.eval(
            "[...document.querySelectorAll('canvas')].filter(c => { const d = c.getContext('2d').getImageData(0, 0, \
             c.width, c.height).data, seen = new Set(); for (let k = 0; k < d.length; k += 40) seen.add(d[k] << 16 | \
             d[k + 1] << 8 | d[k + 2]); return seen.size < 8; }).length",
        )?;
        ensure!(blank == 0, "{blank} canvases are blank");
        let narrowest = self
            .number("Math.min(...[...document.querySelectorAll('.view canvas')].map(c => c.clientWidth))")?;
        ensure!(narrowest >= 300.0, "a room is drawn {narrowest} pixels wide, expected at least 300");
        Ok(())
    }

    /// Requires that the page made no error.
    pub(super) fn check_quiet(&mut self) -> Result<()> {
        // An answer comes after everything that was said before it.
        self.eval("0")?;
        let loud: Vec<String> = self.devtools.take_events().iter().filter_map(complaint).collect();
        ensure!(loud.is_empty(), "the console says: {}", loud.join("; "));
        Ok(())
    }

    /// The visible part of the page, as PNG.
    pub(super) fn screenshot(&mut self, path: &Path) -> Result<()> {
        let shot = self.call("Page.captureScreenshot", &json!({ "format": "png" }))?;
        let data = shot["data"].as_str().unwrap_or_default();
        let bytes = BASE64_STANDARD.decode(data).context("a screenshot that is no base 64")?;
        write_bytes_atomically(path, &bytes)
    }
}

/// An error or a warning that an event tells of.
fn complaint(event: &Value) -> Option<String> {
    let parameters = &event["params"];
    match event["method"].as_str()? {
        "Runtime.exceptionThrown" => {
            Some(parameters["exceptionDetails"]["exception"]["description"].to_string())
        }
        "Runtime.consoleAPICalled"
            if matches!(parameters["type"].as_str(), Some("error" | "warning" | "assert")) =>
        {
            Some(parameters["args"].to_string())
        }
        "Log.entryAdded" if matches!(parameters["entry"]["level"].as_str(), Some("error" | "warning")) => {
            Some(parameters["entry"]["text"].to_string())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::complaint;
    use serde_json::json;

    #[test]
    fn errors_are_heard_and_talk_is_not() {
        let console = |kind: &str| json!({ "method": "Runtime.consoleAPICalled", "params": { "type": kind, "args": [] } });
        assert!(complaint(&console("error")).is_some() && complaint(&console("log")).is_none());
        let log = json!({ "method": "Log.entryAdded", "params": { "entry": { "level": "error", "text": "lost" } } });
        assert_eq!(complaint(&log).as_deref(), Some("\"lost\""));
    }
}
