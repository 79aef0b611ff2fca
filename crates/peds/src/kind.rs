//! The crowds that come with this crate: the six of the paper, and those that settings are chosen
//! with.
//!
//! A crowd of one's own needs no entry here: it implements [`Crowd`](crate::Crowd) with a
//! [`CrowdName`](crate::CrowdName) of its own.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::PedsError;

/// A built-in crowd. It is written as [`Self::name`] everywhere: in arguments, keys, records and
/// reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CrowdKind {
    /// Learned pedestrians that see the robot ("non-homogeneous").
    Nh,
    /// Learned pedestrians from whose scans the robot is removed ("invisible").
    In,
    /// As `In`, each pedestrian's speed multiplied by a factor drawn per episode ("variability").
    Va,
    /// As `Nh`, each policy taken at half its training ("sub-optimal").
    So,
    /// Optimal reciprocal collision avoidance (velocity obstacles).
    Vo,
    /// The social force model.
    Sf,
    /// Validation crowd: straight to the goal at a speed of one's own, whoever is in the way. Not
    /// of the paper.
    Straight,
    /// Validation crowd: as `Straight`, walking and standing in turns. Not of the paper.
    StopAndGo,
    /// Validation crowd: as `Nh`, driven by whatever policies the pool holds, such as those of
    /// other seeds. Not of the paper.
    CrossPlay,
    /// People as they walked in a recording that the user brings; they react to nobody. Not of the
    /// paper.
    Recorded,
}

impl CrowdKind {
    /// The six of the paper, in the order of its tables.
    pub const PAPER: [Self; 6] = [Self::Nh, Self::In, Self::Va, Self::So, Self::Vo, Self::Sf];

    /// Those by which settings are chosen; never a column of a table of the paper.
    pub const VALIDATION: [Self; 3] = [Self::Straight, Self::StopAndGo, Self::CrossPlay];

    /// Every crowd that comes with this crate: the paper's, those for validation, then the recorded
    /// one.
    pub fn built_in() -> impl Iterator<Item = Self> {
        Self::PAPER.into_iter().chain(Self::VALIDATION).chain([Self::Recorded])
    }

    /// The two letters of the paper, or a name in lower case.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Nh => "NH",
            Self::In => "IN",
            Self::Va => "VA",
            Self::So => "SO",
            Self::Vo => "VO",
            Self::Sf => "SF",
            Self::Straight => "straight",
            Self::StopAndGo => "stop-and-go",
            Self::CrossPlay => "cross-play",
            Self::Recorded => "recorded",
        }
    }

    /// True if the pedestrians are driven by trained policies of a pool (and so sense by laser).
    pub fn is_learned(self) -> bool {
        matches!(self, Self::Nh | Self::In | Self::Va | Self::So | Self::CrossPlay)
    }

    /// True if it is one of [`Self::VALIDATION`].
    pub fn is_for_validation(self) -> bool {
        Self::VALIDATION.contains(&self)
    }
}

impl fmt::Display for CrowdKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for CrowdKind {
    type Err = PedsError;

    /// A built-in crowd, written exactly as [`CrowdKind::name`].
    fn from_str(name: &str) -> Result<Self, PedsError> {
        Self::built_in()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| PedsError::UnknownCrowd(name.to_owned()))
    }
}

impl Serialize for CrowdKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for CrowdKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for kind in CrowdKind::built_in() {
            assert_eq!(kind.to_string().parse::<CrowdKind>(), Ok(kind));
        }
        assert_eq!("nh".parse::<CrowdKind>(), Err(PedsError::UnknownCrowd("nh".into())));
        assert!("stubborn".parse::<CrowdKind>().is_err(), "a slip must not become a crowd");
        let names: Vec<String> = CrowdKind::PAPER.iter().map(ToString::to_string).collect();
        assert_eq!(names, ["NH", "IN", "VA", "SO", "VO", "SF"]);
    }

    /// Stored keys and records are read by these very bytes.
    #[test]
    fn the_papers_crowds_are_stored_as_ever() {
        let text = serde_json::to_string(&CrowdKind::PAPER).unwrap();
        assert_eq!(text, r#"["NH","IN","VA","SO","VO","SF"]"#);
        assert_eq!(serde_json::from_str::<[CrowdKind; 6]>(&text).unwrap(), CrowdKind::PAPER);
        let validation = serde_json::to_string(&CrowdKind::VALIDATION).unwrap();
        assert_eq!(validation, r#"["straight","stop-and-go","cross-play"]"#);
    }

    #[test]
    fn five_crowds_learn() {
        let learned: Vec<String> =
            CrowdKind::built_in().filter(|kind| kind.is_learned()).map(|kind| kind.to_string()).collect();
        assert_eq!(learned, ["NH", "IN", "VA", "SO", "cross-play"]);
        assert!(!CrowdKind::PAPER.iter().any(|kind| kind.is_for_validation()));
    }
}
