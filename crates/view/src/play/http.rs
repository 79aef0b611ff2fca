//! As much of HTTP/1.1 as one page and one WebSocket need (RFC 9112; RFC 6455, section 4).
//!
//! Rejected: a web framework with an asynchronous runtime. It brings two dozen crates into every
//! build, for a page that one person opens on their own machine.

use std::io::{Read, Write};

use anyhow::{Context as _, Result, bail, ensure};
use tungstenite::handshake::derive_accept_key;

/// Bytes of a request's head at most.
const HEAD_MAX: usize = 16 * 1024;

/// A request or a reply without its body: the first line, then the fields.
#[derive(Debug)]
pub(crate) struct Head {
    /// Its first line, such as `GET / HTTP/1.1`.
    pub(crate) line: String,
    fields: Vec<(String, String)>,
}

impl Head {
    /// Reads up to the empty line that ends a head; bytes behind it stay where they are.
    ///
    /// # Errors
    /// A connection that ends before, a head that is too long or no text.
    pub(crate) fn read(stream: &mut impl Read) -> Result<Self> {
        let mut bytes = Vec::new();
        let mut byte = [0];
        while !bytes.ends_with(b"\r\n\r\n") {
            ensure!(bytes.len() < HEAD_MAX, "a head of more than {HEAD_MAX} bytes");
            if stream.read(&mut byte).context("the connection failed")? == 0 {
                bail!("the connection ended within a head");
            }
            bytes.push(byte[0]);
        }
        let text = String::from_utf8(bytes).context("a head that is no text")?;
        let mut lines = text.split("\r\n").filter(|line| !line.is_empty());
        let line = lines.next().context("an empty head")?.to_owned();
        let field = |line: &str| {
            let (name, value) = line.split_once(':')?;
            Some((name.trim().to_ascii_lowercase(), value.trim().to_owned()))
        };
        Ok(Self { line, fields: lines.filter_map(field).collect() })
    }

    /// A field's value; names are in lower case.
    pub(crate) fn field(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(field, _)| field == name).map(|(_, value)| value.as_str())
    }

    /// The path of a GET request, without its query.
    pub(crate) fn path(&self) -> Option<&str> {
        let rest = self.line.strip_prefix("GET ")?;
        let target = rest.strip_suffix(" HTTP/1.1")?;
        target.split('?').next()
    }

    /// The key of a client that asks for a WebSocket.
    pub(crate) fn websocket_key(&self) -> Option<&str> {
        let upgrade = self.field("upgrade").is_some_and(|value| value.eq_ignore_ascii_case("websocket"));
        let version = self.field("sec-websocket-version") == Some("13");
        self.field("sec-websocket-key").filter(|_| upgrade && version)
    }
}

/// Switches a connection over to WebSocket.
pub(crate) fn write_switch(stream: &mut impl Write, key: &str) -> std::io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {}\r\n\r\n",
        derive_accept_key(key.as_bytes())
    )
}

/// Writes a whole reply and announces the end of the connection.
pub(crate) fn write_reply(
    stream: &mut impl Write,
    status: &str,
    kind: &str,
    body: &str,
) -> std::io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}; charset=utf-8\r\nContent-Length: {}\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
}

#[cfg(test)]
mod tests {
    use super::{Head, write_switch};

    #[test]
    fn the_key_of_the_rfc_is_answered_as_there() {
        let mut reply = Vec::new();
        write_switch(&mut reply, "dGhlIHNhbXBsZSBub25jZQ==").unwrap();
        let reply = Head::read(&mut &reply[..]).unwrap();
        assert_eq!(reply.field("sec-websocket-accept"), Some("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="));
    }

    #[test]
    fn a_head_is_read_to_its_end_and_not_beyond() {
        let mut bytes =
            &b"GET /live?x HTTP/1.1\r\nHost: a:1\r\nUPGRADE: WebSocket\r\nSec-WebSocket-Version: 13\r\n\
            Sec-WebSocket-Key: k\r\n\r\nrest"[..];
        let head = Head::read(&mut bytes).unwrap();
        assert_eq!(
            (head.path(), head.field("host"), head.websocket_key()),
            (Some("/live"), Some("a:1"), Some("k"))
        );
        assert_eq!(bytes, b"rest");
    }

    #[test]
    fn damaged_heads_are_refused() {
        for bytes in [&b""[..], b"GET / HTTP/1.1\r\n", b"\xff\xfe\r\n\r\n", b"\r\n\r\n"] {
            assert!(Head::read(&mut &*bytes).is_err());
        }
        assert!(Head::read(&mut std::io::repeat(b'a')).is_err());
        let head = Head::read(&mut &b"POST / HTTP/1.1\r\n\r\n"[..]).unwrap();
        assert!(head.path().is_none() && head.websocket_key().is_none());
    }
}
