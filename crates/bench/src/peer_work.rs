//! The workloads that other software does, too: one name, one round at a time, so that sides can
//! take turns.

use std::fmt;
use std::str::FromStr;

use crate::clock::Round;
use crate::crowds::OrcaScene;
use crate::error::BenchError;
use crate::large_updates::{LargeUpdate, Shape};
use crate::learners::WorkU;
use crate::scenes::{Scene, Stepping};

/// A workload; its text is `update`, `forward-B`, `learner-SHAPE`, `simulator-R` or `orca-N`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PeerWork {
    /// Work U. A unit is an update.
    Update,
    /// Inference of the actor. A unit is a call.
    Forward {
        /// Rows of a call.
        batch: usize,
    },
    /// Acting on and learning from a large rollout. A unit is a transition.
    Learner {
        /// Its sizes.
        shape: Shape,
    },
    /// Steps of rooms of five robots with 512 noisy beams. A unit is an agent-step.
    Simulator {
        /// Rooms side by side.
        rooms: usize,
    },
    /// Steps of a crowd on open ground. A unit is an agent-step.
    Orca {
        /// Agents.
        agents: usize,
    },
}

/// Rows of a round of inference, for both sides: a tenth of a second, so that neither the caches
/// that the other side left cold nor a slice of the scheduler decides.
const ROWS_OF_A_ROUND: usize = 4000;

impl PeerWork {
    /// The thing counted: one unit of the work.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Update => "update",
            Self::Forward { .. } => "call",
            Self::Learner { .. } => "transition",
            Self::Simulator { .. } | Self::Orca { .. } => "agent-step",
        }
    }

    /// Makes everything ready and warm; each call of the answer is one round. To be called on the
    /// threads of a pool of `threads`.
    ///
    /// # Errors
    ///
    /// When a part of the work cannot be made.
    pub fn prepare(self, threads: usize) -> Result<Box<dyn FnMut() -> Round + Send>, BenchError> {
        Ok(match self {
            Self::Update => {
                let mut work = WorkU::new()?;
                work.run(threads);
                Box::new(move || {
                    Round::repeat(threads, || {
                        work.run(threads);
                        1.0
                    })
                })
            }
            Self::Forward { batch } => {
                let mut work = WorkU::new()?;
                let calls = 1 + ROWS_OF_A_ROUND / batch;
                (0..calls).for_each(|_| work.actor.infer(batch));
                Box::new(move || {
                    Round::repeat(threads, || {
                        (0..calls).for_each(|_| work.actor.infer(batch));
                        calls as f64
                    })
                })
            }
            Self::Learner { shape } => {
                let mut update = LargeUpdate::new(shape)?;
                update.run();
                Box::new(move || {
                    Round::repeat(threads, || {
                        update.run();
                        update.transitions() as f64
                    })
                })
            }
            Self::Simulator { rooms } => {
                let mut stepping = Stepping::new(Scene::empty(5), rooms)?;
                let steps = 1 + 200 / rooms;
                stepping.step();
                Box::new(move || {
                    Round::repeat(threads, || (0..steps).map(|_| stepping.step()).sum::<usize>() as f64)
                })
            }
            Self::Orca { agents } => {
                let scene = OrcaScene::new(agents)?;
                Box::new(move || scene.round(threads))
            }
        })
    }
}

impl fmt::Display for PeerWork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Update => f.write_str("update"),
            Self::Forward { batch } => write!(f, "forward-{batch}"),
            Self::Learner { shape } => write!(f, "learner-{}", shape.name()),
            Self::Simulator { rooms } => write!(f, "simulator-{rooms}"),
            Self::Orca { agents } => write!(f, "orca-{agents}"),
        }
    }
}

impl FromStr for PeerWork {
    type Err = BenchError;

    fn from_str(text: &str) -> Result<Self, BenchError> {
        let unknown = || BenchError::UnknownWork { found: text.to_owned() };
        if text == "update" {
            return Ok(Self::Update);
        }
        let (kind, number) = text.split_once('-').ok_or_else(unknown)?;
        if kind == "learner" {
            let shape = Shape::ALL.into_iter().find(|shape| shape.name() == number).ok_or_else(unknown)?;
            return Ok(Self::Learner { shape });
        }
        let number = number.parse().ok().filter(|n| (1..=1_000_000).contains(n)).ok_or_else(unknown)?;
        match kind {
            "forward" if number <= crate::learners::TRANSITIONS => Ok(Self::Forward { batch: number }),
            "simulator" => Ok(Self::Simulator { rooms: number }),
            "orca" => Ok(Self::Orca { agents: number }),
            _ => Err(unknown()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for text in ["update", "forward-80", "learner-motion", "simulator-1", "orca-10000"] {
            assert_eq!(text.parse::<PeerWork>().expect("a workload").to_string(), text);
        }
        for text in [
            "",
            "updates",
            "forward",
            "forward-0",
            "forward-641",
            "learner-",
            "learner-u",
            "orca-x",
            "simulator--1",
        ] {
            assert!(text.parse::<PeerWork>().is_err(), "{text}");
        }
    }
}
