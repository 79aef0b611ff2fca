//! Names of crowds: the six of the paper, those that settings are chosen with, and any that a user brings.
//!
//! A name is a short text that can be copied, so that keys, records and reports of a crowd of one's own are made as those of a
//! built-in one. The paper's crowds have two capitals; every other name is in lower case, so that none can be taken for them.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::PedsError;

/// Most characters of a name of one's own.
pub const NAME_MAX: usize = 24;

/// A name of one's own, see [`CrowdKind::own`].
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CrowdName {
    /// ASCII, padded with zeros.
    letters: [u8; NAME_MAX],
    len: u8,
}

impl CrowdName {
    /// The name as text.
    pub fn as_str(&self) -> &str {
        // `CrowdKind::own`, which alone makes names, accepts ASCII only.
        std::str::from_utf8(&self.letters[..usize::from(self.len)]).unwrap_or_default()
    }
}

impl fmt::Debug for CrowdName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

/// A crowd by its name. It is written as [`Self::name`] everywhere: in arguments, keys, records and reports.
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
    /// Validation crowd: straight to the goal at a speed of one's own, whoever is in the way. Not of the paper.
    Straight,
    /// Validation crowd: as `Straight`, walking and standing in turns. Not of the paper.
    StopAndGo,
    /// Validation crowd: as `Nh`, driven by whatever policies the pool holds, such as those of other seeds. Not of the paper.
    CrossPlay,
    /// A crowd of the user's own.
    Own(CrowdName),
}

impl CrowdKind {
    /// The six of the paper, in the order of its tables.
    pub const PAPER: [Self; 6] = [Self::Nh, Self::In, Self::Va, Self::So, Self::Vo, Self::Sf];

    /// Those by which settings are chosen; never a column of a table of the paper.
    pub const VALIDATION: [Self; 3] = [Self::Straight, Self::StopAndGo, Self::CrossPlay];

    /// The name of a crowd of one's own: 1 to [`NAME_MAX`] lower-case letters, digits and hyphens, the first a letter.
    ///
    /// # Errors
    ///
    /// [`PedsError::CrowdName`] for any other text, and for a name that a built-in crowd has in whatever case.
    ///
    /// # Examples
    ///
    /// ```
    /// use jostle_peds::CrowdKind;
    /// assert_eq!(CrowdKind::own("stubborn").unwrap().name(), "stubborn");
    /// assert!(CrowdKind::own("sf").is_err() && CrowdKind::own("").is_err());
    /// ```
    pub fn own(name: &str) -> Result<Self, PedsError> {
        let bytes = name.as_bytes();
        let fits = bytes.first().is_some_and(u8::is_ascii_lowercase)
            && bytes.len() <= NAME_MAX
            && bytes.iter().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || *b == b'-');
        if !fits || Self::built_in().any(|kind| kind.name().eq_ignore_ascii_case(name)) {
            return Err(PedsError::CrowdName(name.chars().take(2 * NAME_MAX).collect()));
        }
        let mut letters = [0; NAME_MAX];
        letters[..bytes.len()].copy_from_slice(bytes);
        // At most `NAME_MAX`.
        Ok(Self::Own(CrowdName { letters, len: bytes.len() as u8 }))
    }

    /// Every crowd that comes with this crate: the paper's, then those for validation.
    pub fn built_in() -> impl Iterator<Item = Self> {
        Self::PAPER.into_iter().chain(Self::VALIDATION)
    }

    /// The two letters of the paper, or a name in lower case.
    pub fn name(&self) -> &str {
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
            Self::Own(name) => name.as_str(),
        }
    }

    /// Whether the pedestrians are driven by trained policies of a pool (and so sense by laser).
    pub fn is_learned(self) -> bool {
        matches!(self, Self::Nh | Self::In | Self::Va | Self::So | Self::CrossPlay)
    }

    /// Whether it is one of [`Self::VALIDATION`].
    pub fn is_for_validation(self) -> bool {
        Self::VALIDATION.contains(&self)
    }

    /// Whether it is a crowd of the user's own.
    pub fn is_own(self) -> bool {
        matches!(self, Self::Own(_))
    }
}

impl fmt::Display for CrowdKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for CrowdKind {
    type Err = PedsError;

    /// A built-in crowd, written exactly as [`CrowdKind::name`]: a slip must not become a crowd of one's own.
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
    /// A built-in crowd or a name of the user's own, since records hold either.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Name;
        impl de::Visitor<'_> for Name {
            type Value = CrowdKind;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a crowd")
            }

            fn visit_str<E: de::Error>(self, name: &str) -> Result<CrowdKind, E> {
                name.parse().or_else(|_| CrowdKind::own(name)).map_err(E::custom)
            }
        }
        deserializer.deserialize_str(Name)
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
    fn names_of_ones_own_are_short_and_never_a_built_in_crowds() {
        let longest = "a23456789-123456789-1234";
        for name in ["a", "my-crowd-2", longest] {
            let kind = CrowdKind::own(name).unwrap();
            assert_eq!((kind.name(), kind.is_own(), kind.is_learned()), (name, true, false));
            let text = serde_json::to_string(&kind).unwrap();
            assert_eq!(serde_json::from_str::<CrowdKind>(&text).unwrap(), kind);
        }
        let too_long = format!("{longest}5");
        for name in ["", "vo", "straight", "cross-play", "Mine", "a/b", "2fast", "-a", "ä", &too_long] {
            assert!(CrowdKind::own(name).is_err(), "{name}");
            assert_eq!(
                serde_json::from_str::<CrowdKind>(&format!("{name:?}")).is_ok(),
                name.parse::<CrowdKind>().is_ok(),
                "{name}"
            );
        }
    }

    #[test]
    fn five_crowds_learn() {
        let learned: Vec<String> =
            CrowdKind::built_in().filter(|kind| kind.is_learned()).map(|kind| kind.to_string()).collect();
        assert_eq!(learned, ["NH", "IN", "VA", "SO", "cross-play"]);
        assert!(!CrowdKind::PAPER.iter().any(|kind| kind.is_for_validation()));
    }
}
