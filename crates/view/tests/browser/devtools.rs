//! The DevTools protocol: numbered calls and what happens in between
//! (<https://chromedevtools.github.io/devtools-protocol/>).

use std::net::TcpStream;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, bail};
use serde_json::{Value, json};
use tungstenite::client::{IntoClientRequest as _, client_with_config};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message, WebSocket};

/// Longest time for an answer.
const PATIENCE: Duration = Duration::from_mins(1);

/// A connection to a browser.
pub(super) struct DevTools {
    socket: WebSocket<TcpStream>,
    last: u64,
    /// Events since they were last taken.
    events: Vec<Value>,
}

impl DevTools {
    /// Connects to `ws://HOST:PORT/PATH`.
    ///
    /// # Errors
    /// An address that is none, a server that speaks no WebSocket.
    pub(super) fn connect(address: &str) -> Result<Self> {
        Ok(Self { socket: websocket(address, None)?, last: 0, events: Vec::new() })
    }

    /// Calls a method and waits for its answer; `session` is the page that is meant.
    ///
    /// # Errors
    /// What the browser refuses; no answer in time.
    pub(super) fn call(&mut self, session: Option<&str>, method: &str, parameters: &Value) -> Result<Value> {
        self.last += 1;
        let id = self.last;
        let mut call = json!({ "id": id, "method": method, "params": parameters });
        if let Some(session) = session {
            call["sessionId"] = session.into();
        }
        self.socket.send(Message::text(call.to_string())).context("the browser has left")?;
        let started = Instant::now();
        while started.elapsed() < PATIENCE {
            let Message::Text(text) = self.socket.read().context("the browser has left")? else { continue };
            let told: Value = serde_json::from_str(&text).context("the browser sent no JSON")?;
            if told["id"] != id {
                self.events.push(told);
                continue;
            }
            if let Some(error) = told.get("error") {
                bail!("{method}: {}", error["message"].as_str().unwrap_or("refused"));
            }
            return Ok(told["result"].clone());
        }
        Err(anyhow!("{method}: no answer within {PATIENCE:?}"))
    }

    /// The events since the last call of this.
    pub(super) fn take_events(&mut self) -> Vec<Value> {
        std::mem::take(&mut self.events)
    }
}

/// Opens a WebSocket as a client, as a page of `origin` would.
pub(super) fn websocket(address: &str, origin: Option<&str>) -> Result<WebSocket<TcpStream>> {
    let mut request =
        address.into_client_request().with_context(|| format!("{address} is no address of a WebSocket"))?;
    if let Some(origin) = origin {
        request.headers_mut().insert("Origin", origin.parse().context("an origin that is no header")?);
    }
    let host = request.uri().authority().with_context(|| format!("{address} has no host"))?.to_string();
    let stream = TcpStream::connect(&host).with_context(|| format!("cannot connect to {host}"))?;
    stream.set_read_timeout(Some(PATIENCE)).context("a socket without a clock")?;
    stream.set_nodelay(true).context("a socket that waits")?;
    let limits = WebSocketConfig::default().max_message_size(Some(64 << 20)).max_frame_size(Some(64 << 20));
    match client_with_config(request, stream, Some(limits)) {
        Ok((socket, _)) => Ok(socket),
        Err(error) => Err(anyhow!("{address}: {error}")),
    }
}
