//! From an observation row to the input row of a network.
//!
//! The paper's network reads the row as it is. There can be a fixed map before a smaller network,
//! one of two (spec, section 8): the nearest of each k neighbouring beams
//! ([`NetworkConfig::scan_pool`]), or the row's own reading of what moves ([`motion`],
//! [`NetworkConfig::motion`]). Neither has parameters, so a rollout keeps encoded rows and encodes
//! each once.
//!
//! Reading order: this file, [`pool`], [`clusters`] (the pieces of a scan), [`paths`] (the robot's
//! possible ways), [`motion`].

pub mod clusters;
pub mod encoded;
pub mod motion;
pub mod paths;
pub mod pool;

use motion::{MotionEncoder, MotionScratch};
use pool::pool_row;

use crate::config::NetworkConfig;

/// The map from observation rows to input rows of one network.
///
/// # Examples
///
/// ```
/// use jostle_policy::{NetworkConfig, encoder::Encoder};
/// let config = NetworkConfig { scan_pool: 4, ..Default::default() };
/// let encoder = Encoder::new(&config);
/// let mut input = vec![0.0; config.input_len()];
/// encoder.encode(&vec![0.5; config.observation_len()], &mut Default::default(), &mut input);
/// assert_eq!(input.len(), 3 * 128 + 4);
/// ```
#[derive(Debug, Clone)]
pub struct Encoder {
    config: NetworkConfig,
    motion: Option<MotionEncoder>,
}

/// Memory that [`Encoder::encode`] reuses from row to row; its content never matters.
#[derive(Debug, Clone, Default)]
pub struct EncoderScratch {
    motion: MotionScratch,
}

impl Encoder {
    /// The encoder of a network of these sizes.
    ///
    /// # Panics
    ///
    /// If [`NetworkConfig::validate`] refuses the sizes.
    pub fn new(config: &NetworkConfig) -> Self {
        config.validate().expect("a validated configuration");
        let motion = config.motion.as_ref().map(|motion| MotionEncoder::new(motion, config.beams));
        Self { config: config.clone(), motion }
    }

    /// `true` if an input row is the observation row itself.
    pub fn is_identity(&self) -> bool {
        self.motion.is_none() && self.config.scan_pool == 1
    }

    /// Length of an observation row.
    pub fn observation_len(&self) -> usize {
        self.config.observation_len()
    }

    /// Length of an input row.
    pub fn input_len(&self) -> usize {
        self.config.input_len()
    }

    /// Encodes one row.
    ///
    /// # Shapes
    ///
    /// `observation` [[`observation_len`](Self::observation_len)] → `input`
    /// [[`input_len`](Self::input_len)], overwritten.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn encode(&self, observation: &[f32], scratch: &mut EncoderScratch, input: &mut [f32]) {
        assert_eq!(observation.len(), self.observation_len(), "length of an observation row");
        assert_eq!(input.len(), self.input_len(), "length of an input row");
        match &self.motion {
            Some(motion) => motion.encode(observation, &mut scratch.motion, input),
            None => pool_row(observation, self.config.scan_pool, input),
        }
    }

    /// Encodes rows that lie one behind the other, and appends the input rows to `inputs`.
    ///
    /// # Panics
    ///
    /// If `observations` is no whole number of rows.
    pub fn append(&self, observations: &[f32], scratch: &mut EncoderScratch, inputs: &mut Vec<f32>) {
        if self.is_identity() {
            inputs.extend_from_slice(observations);
            return;
        }
        let (width, len) = (self.observation_len(), self.input_len());
        assert_eq!(observations.len() % width, 0, "whole observation rows");
        let start = inputs.len();
        inputs.resize(start + observations.len() / width * len, 0.0);
        for (row, input) in observations.chunks_exact(width).zip(inputs[start..].chunks_exact_mut(len)) {
            self.encode(row, scratch, input);
        }
    }
}
