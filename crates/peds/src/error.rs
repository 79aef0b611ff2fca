//! The errors in the input of a crowd model.

/// Error of this crate: every variant names what was found and what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PedsError {
    /// A number of the input is NaN, infinite or too large for single precision to square twice.
    #[error("{what} is ({x}, {y}); expected finite components of magnitude at most {limit:e}")]
    Coordinates {
        /// Name of the vector.
        what: &'static str,
        /// Its first component.
        x: f64,
        /// Its second component.
        y: f64,
        /// Largest accepted magnitude.
        limit: f64,
    },
    /// A parameter is outside its range.
    #[error("{field} = {found}; expected {expected}")]
    OutOfRange {
        /// Name of the parameter.
        field: &'static str,
        /// Value found.
        found: f64,
        /// The accepted range.
        expected: &'static str,
    },
    /// An obstacle has fewer than two vertices.
    #[error("obstacle {obstacle}: {found} vertices; expected at least 2")]
    ObstacleVertices {
        /// Index of the polygon in the list given.
        obstacle: usize,
        /// Number of its vertices.
        found: usize,
    },
    /// An obstacle has an edge without a direction.
    #[error("obstacle {obstacle}: edge {edge} is {length} m long; expected edges of at least {least} m")]
    ObstacleEdge {
        /// Index of the polygon in the list given.
        obstacle: usize,
        /// Index of the edge; it begins at the vertex of that index.
        edge: usize,
        /// Its length, m.
        length: f32,
        /// The least accepted length, m.
        least: f32,
    },
    /// Obstacles have too many edges.
    #[error("obstacle {obstacle}: {found} edges in all; expected at most {most}")]
    TooManyEdges {
        /// Index of the polygon with which there are too many.
        obstacle: usize,
        /// Number of edges up to its last one.
        found: usize,
        /// The largest accepted number.
        most: usize,
    },
    /// An agent index beyond the last agent.
    #[error("agent {agent} does not exist; there are {count}")]
    NoSuchAgent {
        /// Index asked for.
        agent: usize,
        /// Number of agents.
        count: usize,
    },
    /// Two lists that belong together differ in length.
    #[error("{what} has {found} entries; expected {expected}")]
    Length {
        /// Name of the list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The expected length.
        expected: usize,
    },
    /// A name that is no crowd.
    #[error(
        "unknown crowd `{0}`; expected one of NH, IN, VA, SO, VO, SF, straight, stop-and-go, cross-play, recorded"
    )]
    UnknownCrowd(String),
    /// A text that cannot be the name of a crowd of one's own.
    #[error(
        "crowd name {found:?}; expected 1 to {most} lower-case letters, digits and hyphens, beginning with a letter, that are no \
         built-in crowd's name"
    )]
    CrowdName {
        /// The text, shortened.
        found: String,
        /// Most characters of a name.
        most: usize,
    },
    /// A crowd of one family was asked to be of another.
    #[error("crowd {found} cannot be driven this way; expected one of {expected}")]
    WrongKind {
        /// Name of the crowd asked for.
        found: &'static str,
        /// The crowds that can be made so.
        expected: &'static str,
    },
    /// A recording cannot be read.
    #[error("{}: {}{problem}", file.display(), line_of(*line))]
    Recording {
        /// The file.
        file: std::path::PathBuf,
        /// The line, from 1; 0 for the file as a whole.
        line: usize,
        /// What was found and what was expected.
        problem: String,
    },
    /// A learned crowd has no policies.
    #[error("policy pool: it is empty; expected at least one policy")]
    EmptyPool,
    /// A policy of the pool is no actor.
    #[error("policy pool: network {policy} has {found} outputs; expected an actor's 2")]
    PoolOutputs {
        /// Index of the policy.
        policy: usize,
        /// Number of its outputs.
        found: usize,
    },
    /// A policy of the pool reads other observations than the first one.
    #[error(
        "policy pool: policy {policy} sees {} frames of {} beams; expected {} of {}, as policy 0",
        found[0], found[1], expected[0], expected[1]
    )]
    PoolObservation {
        /// Index of the policy.
        policy: usize,
        /// Its frames and beams.
        found: [usize; 2],
        /// The frames and beams of policy 0.
        expected: [usize; 2],
    },
    /// A policy of the pool cannot be made.
    #[error("policy pool: policy {policy}: {reason}")]
    PoolBackend {
        /// Index of the policy.
        policy: usize,
        /// The words of `jostle-policy`, which this crate does without unless the feature `learned`
        /// is on.
        reason: String,
    },
    /// A policy of the pool answers with a number that is not finite.
    #[error("policy pool: policy {policy} answers {mean:?}; expected finite means")]
    PoolAnswer {
        /// Index of the policy.
        policy: usize,
        /// Its answer: linear and angular velocity.
        mean: [f32; 2],
    },
}

/// The line's part of a message.
fn line_of(line: usize) -> String {
    if line == 0 { String::new() } else { format!("line {line}: ") }
}

/// Largest coordinate, speed or distance accepted: its fourth power is far from the end of `f32`.
pub const MAGNITUDE_LIMIT: f32 = 1e6;

/// The vector itself when both components are finite and at most [`MAGNITUDE_LIMIT`] in magnitude.
pub(crate) fn checked(what: &'static str, vector: glam::Vec2) -> Result<glam::Vec2, PedsError> {
    // NaN fails both comparisons.
    if vector.x.abs() <= MAGNITUDE_LIMIT && vector.y.abs() <= MAGNITUDE_LIMIT {
        return Ok(vector);
    }
    Err(PedsError::Coordinates {
        what,
        x: f64::from(vector.x),
        y: f64::from(vector.y),
        limit: f64::from(MAGNITUDE_LIMIT),
    })
}

/// An error unless `ok` holds (written so that a NaN, for which no comparison holds, is refused).
pub(crate) fn require(
    ok: bool,
    field: &'static str,
    found: f64,
    expected: &'static str,
) -> Result<(), PedsError> {
    if ok { Ok(()) } else { Err(PedsError::OutOfRange { field, found, expected }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    use glam::Vec2;

    #[test]
    fn coordinates_are_checked_to_the_limit_one_by_one() {
        let ok = |x, y| checked("point", Vec2::new(x, y)).is_ok();
        assert!(ok(MAGNITUDE_LIMIT, -MAGNITUDE_LIMIT));
        assert!(!ok(1.001 * MAGNITUDE_LIMIT, 0.0) && !ok(0.0, -1.001 * MAGNITUDE_LIMIT));
        assert!(!ok(f32::NAN, 0.0) && !ok(0.0, f32::NAN));
    }

    #[test]
    fn messages_name_what_was_found_and_expected() {
        let found = checked("goal", Vec2::new(2e6, 0.0)).unwrap_err().to_string();
        assert_eq!(found, "goal is (2000000, 0); expected finite components of magnitude at most 1e6");
        let found = require(false, "tau", 0.0, "0.001 to 1000 s").unwrap_err().to_string();
        assert_eq!(found, "tau = 0; expected 0.001 to 1000 s");
    }
}
