//! Errors before a measurement begins.

use thiserror::Error;

/// A workload that cannot be prepared.
#[derive(Debug, Error)]
pub enum BenchError {
    /// The simulator refuses its scene.
    #[error(transparent)]
    Sim(#[from] jostle_sim::SimError),
    /// A crowd refuses its scene.
    #[error(transparent)]
    Crowd(#[from] jostle_peds::PedsError),
    /// A network cannot be made.
    #[error(transparent)]
    Policy(#[from] jostle_policy::PolicyError),
    /// A discriminator cannot be made.
    #[error(transparent)]
    Diversity(#[from] jostle_diversity::DiversityError),
    /// A room or a robot is refused.
    #[error(transparent)]
    Arena(#[from] jostle_arena::ArenaError),
    /// The evaluation refuses its settings.
    #[error(transparent)]
    Eval(Box<jostle_eval::EvalError>),
    /// The matrix product that serves as the yardstick fails.
    #[error(transparent)]
    Product(#[from] candle_core::Error),
    /// The processor has no such instruction set, or work has begun with another.
    #[error("instruction set `{found}`: expected {expected}")]
    InstructionSet {
        /// The name as it was given.
        found: String,
        /// The sets of this processor.
        expected: String,
    },
    /// No workload has this name.
    #[error(
        "workload `{found}`: expected update, forward-B, simulator-R or orca-N with a number for B, R, N"
    )]
    UnknownWork {
        /// The name as it was given.
        found: String,
    },
}

// Boxed: it is the largest of the errors, and every call would carry its size.
impl From<jostle_eval::EvalError> for BenchError {
    fn from(error: jostle_eval::EvalError) -> Self {
        Self::Eval(Box::new(error))
    }
}
