//! One visitor: what is asked is read between two steps, and time runs by the clock.

use std::io::ErrorKind;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use glam::Vec2;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use super::message::{ClientMessage, ServerMessage, Setup};
use super::session::{Catalogue, PEDESTRIANS_MAX, Session};
use jostle_runs::output::one_line;

/// Bytes of a message at most.
const MESSAGE_MAX: usize = 4096;
/// Seconds of the room in a second.
const TIMES: std::ops::RangeInclusive<f32> = 0.1..=16.0;
/// Time for which a visitor sees the end of an episode (s), before the next one begins.
const REST: f32 = 1.5;
/// Between two looks at a socket while time stands still.
const IDLE: Duration = Duration::from_millis(200);
/// Wishes that a visitor may have before the next step; one with more of them waits.
const ASKS_MAX: usize = 64;

struct Visit<'a> {
    session: Session<'a>,
    catalogue: &'a Catalogue,
    socket: WebSocket<TcpStream>,
    playing: bool,
    times: f32,
    /// When the next step is due.
    due: Instant,
}

/// Plays with a visitor until they leave.
///
/// # Errors
/// What the room itself refuses; a visitor who leaves, however rudely, is no error.
pub(crate) fn visit(catalogue: &Catalogue, first: &Setup, stream: TcpStream) -> Result<()> {
    let limits = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX))
        .max_write_buffer_size(1 << 20);
    let mut visit = Visit {
        session: Session::new(catalogue, first.clone())?,
        catalogue,
        socket: WebSocket::from_raw_socket(stream, Role::Server, Some(limits)),
        playing: true,
        times: 1.0,
        due: Instant::now(),
    };
    match visit.run() {
        Err(error) if error.downcast_ref::<Error>().is_some() => Ok(()),
        ended => ended,
    }
}

impl Visit<'_> {
    fn run(&mut self) -> Result<()> {
        let policies = self.catalogue.policies();
        let crowds = &self.catalogue.crowds;
        self.tell(&ServerMessage::Choices { policies: &policies, crowds, pedestrians_max: PEDESTRIANS_MAX })?;
        self.tell_all()?;
        loop {
            for _ in 0..ASKS_MAX {
                match self.next_message()? {
                    Some(Message::Text(text)) => self.answer(&text)?,
                    Some(Message::Close(_)) => return Ok(()),
                    Some(_) => {}
                    None => break,
                }
            }
            if self.playing && Instant::now() >= self.due {
                self.tick()?;
            }
        }
    }

    /// The next message, or `None` when it is time for a step.
    fn next_message(&mut self) -> Result<Option<Message>> {
        let wait = if self.playing { self.due.saturating_duration_since(Instant::now()) } else { IDLE };
        // A timeout of 0 would mean none.
        let wait = wait.max(Duration::from_micros(500));
        self.socket.get_ref().set_read_timeout(Some(wait)).map_err(Error::Io)?;
        match self.socket.read() {
            Ok(message) => Ok(Some(message)),
            Err(Error::Io(error)) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// A step, or the next episode after a rest.
    fn tick(&mut self) -> Result<()> {
        if self.session.has_ended() {
            self.session.next()?;
            self.tell_room()?;
        } else {
            self.session.step()?;
        }
        self.tell_frame()?;
        let dt = self.session.dt() / self.times;
        let wait = Duration::from_secs_f32(if self.session.has_ended() { REST } else { dt });
        // A machine that cannot keep up plays more slowly; it does not hurry afterwards.
        self.due = (self.due + wait).max(Instant::now());
        Ok(())
    }

    /// Does what was asked, or says why not.
    fn answer(&mut self, text: &str) -> Result<()> {
        let done = serde_json::from_str(text).context("not understood").and_then(|ask| self.apply(ask));
        match done {
            Ok(()) => Ok(()),
            Err(error) if error.downcast_ref::<Error>().is_some() => Err(error),
            Err(error) => self.tell(&ServerMessage::Refused { why: one_line(&error) }),
        }
    }

    fn apply(&mut self, ask: ClientMessage) -> Result<()> {
        match ask {
            ClientMessage::Play => self.run_time(true),
            ClientMessage::Pause => self.run_time(false),
            ClientMessage::Step => {
                self.run_time(false)?;
                if self.session.has_ended() {
                    self.session.next()?;
                    self.tell_room()?;
                } else {
                    self.session.step()?;
                }
                self.tell_frame()
            }
            ClientMessage::Speed { times } => {
                let (least, most) = (TIMES.start(), TIMES.end());
                ensure!(TIMES.contains(&times), "speed: found {times}, expected {least} to {most}");
                self.times = times;
                self.tell_clock()
            }
            ClientMessage::Reset => self.session.reset().and_then(|()| self.tell_all()),
            ClientMessage::Next => self.session.next().and_then(|()| self.tell_all()),
            ClientMessage::Goal { x, y } => {
                self.session.goal(Vec2::new(x, y)).and_then(|()| self.tell_frame())
            }
            ClientMessage::Pedestrian { x, y } => {
                self.session.pedestrian(Vec2::new(x, y)).and_then(|()| self.tell_frame())
            }
            ClientMessage::Obstacle { x, y } => self.session.obstacle(Vec2::new(x, y)).and_then(|()| {
                self.tell_room()?;
                self.tell_frame()
            }),
            ClientMessage::Setup(setup) => {
                self.session = Session::new(self.catalogue, setup)?;
                self.tell_all()
            }
        }
    }

    fn run_time(&mut self, playing: bool) -> Result<()> {
        if playing && !self.playing {
            self.due = Instant::now();
        }
        self.playing = playing;
        self.tell_clock()
    }

    fn tell_all(&mut self) -> Result<()> {
        self.tell_room()?;
        self.tell_clock()?;
        self.tell_frame()
    }

    fn tell_room(&mut self) -> Result<()> {
        let text = json(&self.session.describe())?;
        self.send(text)
    }

    fn tell_clock(&mut self) -> Result<()> {
        self.tell(&ServerMessage::Clock { playing: self.playing, times: self.times })
    }

    fn tell_frame(&mut self) -> Result<()> {
        self.tell(&ServerMessage::Frame(self.session.frame()))
    }

    fn tell(&mut self, message: &ServerMessage<'_>) -> Result<()> {
        self.send(json(message)?)
    }

    fn send(&mut self, text: String) -> Result<()> {
        Ok(self.socket.send(Message::text(text))?)
    }
}

fn json(message: &ServerMessage<'_>) -> Result<String> {
    serde_json::to_string(message).context("a message that is no JSON")
}
