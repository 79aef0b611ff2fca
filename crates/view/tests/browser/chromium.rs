//! The browser as a child process that ends with us.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use anyhow::{Context as _, Result, anyhow};

use jostle_runs::tools::on_path;

/// Names the program where the path does not.
const VARIABLE: &str = "JOSTLE_CHROMIUM";
const NAMES: [&str; 5] =
    ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge"];
/// Longest time for a start on a busy machine.
const START: Duration = Duration::from_mins(2);
/// The program's text before the address of its protocol.
const LISTENING: &str = "DevTools listening on ";

/// A running browser with a profile of its own.
pub(super) struct Chromium {
    child: Child,
    profile: PathBuf,
    /// `ws://127.0.0.1:PORT/devtools/browser/ID`.
    pub(super) address: String,
}

impl Chromium {
    /// Starts the browser without a window.
    ///
    /// # Errors
    /// No browser on the path; one that does not start.
    pub(super) fn start() -> Result<Self> {
        let program = std::env::var_os(VARIABLE).map(PathBuf::from).or_else(|| on_path(&NAMES));
        let program = program.with_context(|| {
            format!(
                "no Chromium on the path: install one (Debian: `apt install chromium`, macOS: `brew install --cask \
                 chromium`) or name its program in {VARIABLE}"
            )
        })?;
        let profile = std::env::temp_dir().join(format!("jostle-web-{}", std::process::id()));
        let mut child = Command::new(&program)
            .args(["--headless=new", "--remote-debugging-port=0", "--no-first-run", "--disable-gpu"])
            // It shows our own pages alone, and some systems (containers, root) cannot have its
            // sandbox.
            .args(["--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking"])
            .args(["--disable-background-timer-throttling", "--disable-renderer-backgrounding"])
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let stderr = child.stderr.take().context("a child without standard error")?;
        let (told, hears) = mpsc::channel();
        // Read to the end, so that the browser never waits for us.
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(std::io::Result::ok) {
                if let Some(address) = line.strip_prefix(LISTENING) {
                    // Nobody listens any more once the start has failed.
                    let _ = told.send(address.trim().to_owned());
                }
            }
        });
        let mut browser = Self { child, profile, address: String::new() };
        browser.address = hears
            .recv_timeout(START)
            .map_err(|_| anyhow!("{} opened no DevTools port within {START:?}", program.display()))?;
        Ok(browser)
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        // It may have ended by itself, and its profile may be half gone.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.profile);
    }
}
