//! The statements of the paper's text on its tables, as comparisons that can be tested, and their
//! verdicts.
//!
//! Reading order: this file (what a claim is), [`of_paper`] (the paper's), [`study`] (the data:
//! rows, training seeds, episodes), [`evidence`] (intervals, tests and the verdict).
//!
//! # The rule
//!
//! A claim is a list of parts. A part says where a number lies: a difference of means above 0, say,
//! or within ± a margin. Its estimate is the sum over rows of the mean over training seeds. Two 95
//! % intervals are formed: Welch's over training seeds, and that of a hierarchical bootstrap over
//! seeds and paired episodes. The part is *confirmed* where both lie wholly in the region that the
//! paper claims, *contradicted* where both lie wholly outside it, *not confirmed* otherwise; with a
//! single training seed in a row nothing can be said of training, and it is not confirmed, either.
//! A claim is confirmed where all its parts are; contradicted where at least one part is at the
//! level 0.05 divided by the number of parts; not confirmed otherwise. Where a row has no policy
//! the claim is not tested.

pub mod evidence;
pub mod of_paper;
pub mod study;

use serde::Serialize;

use jostle_arena::Outcome;

pub use evidence::{ClaimResult, PartResult, test_claims};
pub use study::{Row, SeedRun, Study};

/// A quantity of an episode, or of a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Share of episodes that reach the goal.
    Success,
    /// Share of episodes that end in a collision.
    Collision,
    /// Share of collisions minus share of timeouts.
    CollisionMinusTimeout,
    /// Mean extra time over the successes (s).
    ExtraTime,
    /// Mean extra distance over the successes (m).
    ExtraDistance,
    /// Mean speed over the successes (m/s).
    AverageSpeed,
    /// The diversity metric D (nats), a number of the policy and not of episodes.
    Diversity,
}

impl Measure {
    /// The value of an episode; `None` where it has none.
    pub fn value(self, episode: &jostle_eval::compact::CompactEpisode) -> Option<f64> {
        let is = |outcomes: &[Outcome]| f64::from(u8::from(outcomes.contains(&episode.outcome)));
        let collision = is(&[Outcome::CollisionWall, Outcome::CollisionPedestrian]);
        match self {
            Self::Success => Some(is(&[Outcome::Success])),
            Self::Collision => Some(collision),
            Self::CollisionMinusTimeout => Some(collision - is(&[Outcome::Timeout])),
            Self::ExtraTime => episode.metrics.extra_time,
            Self::ExtraDistance => episode.metrics.extra_distance,
            Self::AverageSpeed => episode.metrics.average_speed,
            Self::Diversity => None,
        }
    }
}

/// Weighted mean of a measure over some sites (crowds or maps) of a row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Term {
    /// Name of the row.
    pub row: &'static str,
    /// Factor.
    pub weight: f64,
    /// Names of the sites, averaged; none for [`Measure::Diversity`].
    pub sites: Vec<&'static str>,
}

/// The region in which the paper says that a number lies: above `low`, below `high`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Region {
    /// Lower end, if there is one.
    pub low: Option<f64>,
    /// Upper end, if there is one.
    pub high: Option<f64>,
}

impl Region {
    /// Above 0.
    pub const POSITIVE: Self = Self { low: Some(0.0), high: None };

    /// Not below 0 by more than a margin.
    pub const fn not_below(margin: f64) -> Self {
        Self { low: Some(-margin), high: None }
    }

    /// Within ± a margin.
    pub const fn within(margin: f64) -> Self {
        Self { low: Some(-margin), high: Some(margin) }
    }
}

/// One number of a claim.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// The comparison in words.
    pub label: String,
    /// The quantity compared.
    pub measure: Measure,
    /// Summed.
    pub terms: Vec<Term>,
    /// The region where the sum should lie.
    pub region: Region,
}

/// A comparison that the paper's text makes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// Short name.
    pub id: &'static str,
    /// The table that it speaks of.
    pub table: &'static str,
    /// The statement, in our words, with its place in the paper.
    pub text: &'static str,
    /// Our reading of it, where that needs words; else empty.
    pub reading: &'static str,
    /// Its numbers.
    pub parts: Vec<Part>,
}

/// The verdict on a claim or a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All evidence lies in the claimed region.
    Confirmed,
    /// Neither confirmed nor contradicted.
    NotConfirmed,
    /// The evidence lies outside the claimed region.
    Contradicted,
    /// A policy is missing.
    NotTested,
}

impl Verdict {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::NotConfirmed => "not confirmed",
            Self::Contradicted => "contradicted",
            Self::NotTested => "not tested",
        }
    }
}
