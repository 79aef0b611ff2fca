//! Messages between the page and the server: JSON, one object a message.

use jostle_arena::Outcome;
use jostle_peds::CrowdKind;
use serde::{Deserialize, Serialize};

use crate::replay::page::Scene;

/// A visitor's wish.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum ClientMessage {
    /// Let time run.
    Play,
    /// Stop time.
    Pause,
    /// One control period, then stop.
    Step,
    /// Seconds of the room in a second.
    Speed { times: f32 },
    /// The same episode from its start, without what was added.
    Reset,
    /// The next episode.
    Next,
    /// Another goal for the robot.
    Goal { x: f32, y: f32 },
    /// One more pedestrian.
    Pedestrian { x: f32, y: f32 },
    /// One more obstacle: a disc.
    Obstacle { x: f32, y: f32 },
    /// Another room, from one of its episodes on.
    Setup(Setup),
}

/// A room that a visitor chooses.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Setup {
    pub(crate) crowd: CrowdKind,
    pub(crate) pedestrians: usize,
    /// Index of the policy among those that are offered.
    pub(crate) policy: usize,
    pub(crate) token: u32,
    pub(crate) seed: u64,
    /// The episode that comes first.
    #[serde(default)]
    pub(crate) episode: u64,
}

/// A message to a visitor.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum ServerMessage<'a> {
    /// The choices: once, first.
    Choices { policies: &'a [PolicyChoice], crowds: &'a [CrowdKind], pedestrians_max: usize },
    /// The room: when it is new or got an obstacle.
    Room { scene: &'a Scene, setup: &'a Setup, episode: u64, policy: &'a str, learned: bool },
    /// A moment.
    Frame(Frame),
    /// Time runs, or does not.
    Clock { playing: bool, times: f32 },
    /// Why something was not done.
    Refused { why: String },
}

/// A policy that can be chosen.
#[derive(Clone, Serialize)]
pub(crate) struct PolicyChoice {
    pub(crate) name: String,
    pub(crate) note: String,
    /// Behaviours; 0 where the policy knows none.
    pub(crate) tokens: usize,
}

/// The room at a moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Frame {
    pub(crate) episode: u64,
    /// Steps since the episode began.
    pub(crate) step: u64,
    /// x, y, heading.
    pub(crate) robot: [f32; 3],
    /// v, ω that led here.
    pub(crate) command: [f32; 2],
    pub(crate) goal: [f32; 2],
    /// Distance to the nearest thing all round (m).
    pub(crate) near: f32,
    /// A byte for each kept beam, base 64; 255 is the laser's range.
    pub(crate) ranges: String,
    /// x, y, heading.
    pub(crate) pedestrians: Vec<[f32; 3]>,
    pub(crate) goals: Vec<[f32; 2]>,
    /// The episode's outcome, if it ended.
    pub(crate) outcome: Option<Outcome>,
}

#[cfg(test)]
mod tests {
    use super::{ClientMessage, Setup};
    use jostle_peds::CrowdKind;

    #[test]
    fn asks_are_read_and_slips_refused() {
        let read = |text: &str| serde_json::from_str::<ClientMessage>(text);
        assert_eq!(read(r#"{"do":"goal","x":1,"y":-2.5}"#).unwrap(), ClientMessage::Goal { x: 1.0, y: -2.5 });
        let setup = r#"{"do":"setup","crowd":"SF","pedestrians":4,"policy":0,"token":0,"seed":7}"#;
        let expected =
            Setup { crowd: CrowdKind::Sf, pedestrians: 4, policy: 0, token: 0, seed: 7, episode: 0 };
        assert_eq!(read(setup).unwrap(), ClientMessage::Setup(expected.clone()));
        let third = setup.replace("\"seed\":7", "\"seed\":7,\"episode\":3");
        assert_eq!(read(&third).unwrap(), ClientMessage::Setup(Setup { episode: 3, ..expected }));
        let unknown = setup.replace("SF", "wanderers");
        let error = read(&unknown).unwrap_err().to_string();
        assert!(error.starts_with("unknown crowd `wanderers`; expected one of NH, IN"), "{error}");
        for slip in [r#"{"do":"fly"}"#, r#"{"do":"goal","x":1}"#, r#"{"do":"goal","x":"1","y":2}"#, "[]", ""]
        {
            assert!(read(slip).is_err(), "{slip}");
        }
    }
}
