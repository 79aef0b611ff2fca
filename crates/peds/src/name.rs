//! Names of crowds: any crowd has one, and it is all that keys, records and reports know of it.
//!
//! A name is a short text that can be copied. The paper's crowds have two capitals; every other
//! name is in lower case, so that none can be taken for them.

use std::{cmp::Ordering, fmt};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::{CrowdKind, PedsError};

/// Most characters of a name.
pub const NAME_MAX: usize = 24;

/// The name of a crowd: of a built-in one, or of one's own.
///
/// Names are ordered as tables show them: the built-in crowds in the order of
/// [`CrowdKind::built_in`], then the others by their letters.
///
/// # Examples
///
/// ```
/// use jostle_peds::{CrowdKind, CrowdName};
/// let stubborn = CrowdName::new("stubborn")?;
/// assert_eq!((stubborn.as_str(), stubborn.built_in()), ("stubborn", None));
/// assert_eq!(CrowdName::from(CrowdKind::Vo).as_str(), "VO");
/// assert!(CrowdName::new("vo").is_err(), "a built-in crowd's, but for its case");
/// # Ok::<(), jostle_peds::PedsError>(())
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct CrowdName {
    /// ASCII, padded with zeros.
    letters: [u8; NAME_MAX],
    len: u8,
}

impl CrowdName {
    /// The name of a crowd of one's own: 1 to [`NAME_MAX`] lower-case letters, digits and hyphens,
    /// the first a letter.
    ///
    /// # Errors
    ///
    /// [`PedsError::CrowdName`] for any other text, and for a name that a built-in crowd has in
    /// whatever case.
    pub fn new(name: &str) -> Result<Self, PedsError> {
        let bytes = name.as_bytes();
        let fits = bytes.first().is_some_and(u8::is_ascii_lowercase)
            && bytes.len() <= NAME_MAX
            && bytes.iter().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || *b == b'-');
        if !fits || CrowdKind::built_in().any(|kind| kind.name().eq_ignore_ascii_case(name)) {
            let found = name.chars().take(2 * NAME_MAX).collect();
            return Err(PedsError::CrowdName { found, most: NAME_MAX });
        }
        Ok(Self::of_ascii(name))
    }

    /// `name` is ASCII and at most [`NAME_MAX`] long.
    fn of_ascii(name: &str) -> Self {
        let mut letters = [0; NAME_MAX];
        letters[..name.len()].copy_from_slice(name.as_bytes());
        Self { letters, len: name.len() as u8 }
    }

    /// The name as text.
    pub fn as_str(&self) -> &str {
        // Names are made of ASCII only.
        std::str::from_utf8(&self.letters[..usize::from(self.len)]).unwrap_or_default()
    }

    /// The built-in crowd of this name; `None` for a crowd of one's own.
    pub fn built_in(&self) -> Option<CrowdKind> {
        CrowdKind::built_in().find(|kind| kind.name() == self.as_str())
    }
}

impl From<CrowdKind> for CrowdName {
    fn from(kind: CrowdKind) -> Self {
        Self::of_ascii(kind.name())
    }
}

impl PartialEq<CrowdKind> for CrowdName {
    fn eq(&self, kind: &CrowdKind) -> bool {
        self.as_str() == kind.name()
    }
}

impl Ord for CrowdName {
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |name: &Self| (name.built_in().is_none(), name.built_in(), name.letters);
        key(self).cmp(&key(other))
    }
}

impl PartialOrd for CrowdName {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl fmt::Debug for CrowdName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

impl fmt::Display for CrowdName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl Serialize for CrowdName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl<'de> Deserialize<'de> for CrowdName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let built_in = CrowdKind::built_in().find(|kind| kind.name() == name);
        built_in.map_or_else(|| Self::new(&name), |kind| Ok(kind.into())).map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_ones_own_are_short_and_never_a_built_in_crowds() {
        let longest = "a23456789-123456789-1234";
        for text in ["a", "my-crowd-2", longest] {
            let name = CrowdName::new(text).unwrap();
            assert_eq!((name.as_str(), name.built_in()), (text, None));
            let json = serde_json::to_string(&name).unwrap();
            assert_eq!(json, format!("{text:?}"));
            assert_eq!(serde_json::from_str::<CrowdName>(&json).unwrap(), name);
        }
        let too_long = format!("{longest}5");
        for text in ["", "vo", "straight", "recorded", "Mine", "a/b", "2fast", "-a", "ä", &too_long] {
            assert!(CrowdName::new(text).is_err(), "{text}");
            let is_read = serde_json::from_str::<CrowdName>(&format!("{text:?}")).is_ok();
            assert_eq!(is_read, text.parse::<CrowdKind>().is_ok(), "{text}");
        }
    }

    #[test]
    fn a_built_in_crowd_is_found_by_its_name() {
        for kind in CrowdKind::built_in() {
            let name = CrowdName::from(kind);
            assert_eq!((name.built_in(), name.as_str()), (Some(kind), kind.name()));
            assert!(name == kind && name != CrowdName::new("mine").unwrap());
        }
    }

    #[test]
    fn names_stand_in_the_order_of_the_tables() {
        let own = ["mine", "a-crowd"].map(|name| CrowdName::new(name).unwrap());
        let mut names: Vec<CrowdName> =
            own.into_iter().chain(CrowdKind::built_in().map(Into::into)).collect();
        names.reverse();
        names.sort_unstable();
        let texts: Vec<&str> = names.iter().map(CrowdName::as_str).collect();
        let expected = [
            "NH",
            "IN",
            "VA",
            "SO",
            "VO",
            "SF",
            "straight",
            "stop-and-go",
            "cross-play",
            "recorded",
            "a-crowd",
            "mine",
        ];
        assert_eq!(texts, expected);
    }
}
