//! The server: one thread for each connection, loopback alone.

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use anyhow::{Context as _, Result};

use super::http::{Head, write_reply, write_switch};
use super::message::Setup;
use super::page::page;
use super::session::Catalogue;
use super::visit::visit;
use jostle_runs::output::{note, one_line};

/// Visits at a time: each has a room of its own.
const VISITS_MAX: usize = 8;
/// Connections at a time, visits among them.
const CONNECTIONS_MAX: usize = 32;
/// A connection that says nothing, or takes nothing, for so long is closed.
const PATIENCE: Duration = Duration::from_secs(10);

/// Things that every connection needs.
pub(crate) struct Server {
    pub(crate) catalogue: Catalogue,
    /// The setup that a visit begins with.
    pub(crate) first: Setup,
    visits: AtomicUsize,
    connections: AtomicUsize,
}

/// Counts one up, and down again when it is dropped.
struct Counted<'a>(&'a AtomicUsize);

impl<'a> Counted<'a> {
    /// `None` where there are `most` already.
    fn below(count: &'a AtomicUsize, most: usize) -> Option<Self> {
        let taken = count.fetch_update(Ordering::AcqRel, Ordering::Acquire, |n| (n < most).then_some(n + 1));
        taken.ok().map(|_| Self(count))
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Opens a port of the loopback interface; 0 takes any that is free.
///
/// # Errors
/// A port that is taken.
pub(crate) fn listen(port: u16) -> Result<(TcpListener, SocketAddr)> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .with_context(|| format!("cannot listen on 127.0.0.1:{port}; choose another --port"))?;
    let address = listener.local_addr().context("a listener without an address")?;
    Ok((listener, address))
}

impl Server {
    pub(crate) fn new(catalogue: Catalogue, first: Setup) -> Self {
        Self { catalogue, first, visits: AtomicUsize::new(0), connections: AtomicUsize::new(0) }
    }

    /// Answers connections until the process ends. What goes wrong in one of them is its own
    /// affair.
    pub(crate) fn serve(self: &Arc<Self>, listener: &TcpListener, address: SocketAddr) {
        for stream in listener.incoming() {
            let Ok(stream) = stream else {
                // Out of file handles, most likely: the open connections must get on.
                std::thread::sleep(Duration::from_millis(100));
                continue;
            };
            let server = Arc::clone(self);
            let started = std::thread::Builder::new().spawn(move || {
                if let Err(error) = server.connection(stream, address) {
                    note(&format!("a visit ended: {}", one_line(&error)));
                }
            });
            if let Err(error) = started {
                note(&format!("cannot answer a connection: {error}"));
            }
        }
    }

    /// Answers one connection. Browsers open connections that they never use: these end without a
    /// word.
    fn connection(&self, mut stream: TcpStream, address: SocketAddr) -> Result<()> {
        let Some(_connection) = Counted::below(&self.connections, CONNECTIONS_MAX) else { return Ok(()) };
        stream.set_read_timeout(Some(PATIENCE)).context("a socket without a clock")?;
        stream.set_write_timeout(Some(PATIENCE)).context("a socket without a clock")?;
        stream.set_nodelay(true).context("a socket that waits")?;
        let Ok(head) = Head::read(&mut stream) else { return Ok(()) };
        if !is_ours(&head, address) {
            // A page from elsewhere that points a name, or a script, at this port.
            let _ = write_reply(
                &mut stream,
                "403 Forbidden",
                "text/plain",
                "this server talks to its own page alone\n",
            );
            return Ok(());
        }
        match (head.path(), head.websocket_key()) {
            (Some("/live"), Some(key)) => {
                let Some(_visit) = Counted::below(&self.visits, VISITS_MAX) else {
                    let why = format!("{VISITS_MAX} pages are open already; close one\n");
                    let _ = write_reply(&mut stream, "503 Service Unavailable", "text/plain", &why);
                    return Ok(());
                };
                if write_switch(&mut stream, key).is_err() {
                    return Ok(());
                }
                visit(&self.catalogue, &self.first, stream)
            }
            (Some("/"), None) => {
                // A visitor who has left needs no page.
                let _ = write_reply(&mut stream, "200 OK", "text/html", &page());
                Ok(())
            }
            _ => {
                let _ = write_reply(&mut stream, "404 Not Found", "text/plain", "the page is at /\n");
                Ok(())
            }
        }
    }
}

/// True if a request was meant for this server: by name and, where a script sent it, from this
/// server's own page.
fn is_ours(head: &Head, address: SocketAddr) -> bool {
    let names = [address.to_string(), format!("localhost:{}", address.port())];
    let host = head.field("host").is_some_and(|host| names.iter().any(|name| name == host));
    let origin = head.field("origin").is_none_or(|origin| {
        origin.strip_prefix("http://").is_some_and(|origin| names.iter().any(|name| name == origin))
    });
    host && origin
}
