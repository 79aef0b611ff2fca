//! The shape of the networks: paper section III ("Network"), as sizes that can be changed.

use serde::{Deserialize, Serialize};

use crate::encoder::motion::{self, MotionInputs};
use crate::error::PolicyError;
use crate::observation::{BEAMS, FRAMES, TAIL_LEN};

/// Output channels of both convolutions.
pub const CONV_CHANNELS: usize = 32;
/// Kernel length of the first convolution.
pub const CONV1_KERNEL: usize = 5;
/// Kernel length of the second convolution.
pub const CONV2_KERNEL: usize = 3;
/// Stride of both convolutions.
pub const CONV_STRIDE: usize = 2;
/// Zeros put before and behind the input of both convolutions.
pub const CONV_PADDING: usize = 1;

/// The largest value accepted for any size, so that a hostile file cannot ask for more memory than
/// there is.
const SIZE_MAX: usize = 1 << 16;
/// The largest number of parameters that a network may have (1 GiB in `f32`).
const PARAMETERS_MAX: usize = 1 << 28;

/// Sizes of the actor and of the critic, which have separate trunks of the same shape.
///
/// The default is the paper's network with its M = 5 behaviours.
///
/// # Examples
///
/// ```
/// let config = jostle_policy::NetworkConfig { n_behaviours: 10, ..Default::default() };
/// assert_eq!(config.observation_len(), 1540);
/// assert_eq!(config.flat_len(), 4096);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetworkConfig {
    /// Laser scans in an observation (paper: 3).
    pub frames: usize,
    /// Beams in a scan (paper: 512).
    pub beams: usize,
    /// Number of behaviour tokens M (paper: 5; 1 is the baseline without diversity).
    pub n_behaviours: usize,
    /// Length of a behaviour's embedding (paper: 32).
    pub embedding: usize,
    /// Standard deviation of the embeddings at the start (PyTorch's default: 1). Of a network that
    /// reads motions, where a token is one of M ones, the factor on what its weights would be
    /// otherwise. Larger values make the behaviours differ more from the first update on.
    pub embedding_std: f32,
    /// Length of the laser feature behind the convolutions (paper: 256).
    pub laser_feature: usize,
    /// Length of the last hidden layer (paper: 128).
    pub hidden: usize,
    /// Initial logarithm of the action's standard deviation, for both dimensions (as in the
    /// lineage: 0).
    pub log_std_init: f32,
    /// The network reads the nearest of each this many neighbouring beams (paper: 1, every beam).
    #[serde(skip_serializing_if = "is_one")]
    pub scan_pool: usize,
    /// With this the network reads bodies with their velocities ([`motion`]) instead of scans: a
    /// perceptron of `laser_feature` and `hidden` units, into which the token enters as one of M
    /// ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionInputs>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_one(value: &usize) -> bool {
    *value == 1
}

impl Default for NetworkConfig {
    fn default() -> Self {
        Self {
            frames: FRAMES,
            beams: BEAMS,
            n_behaviours: 5,
            embedding: 32,
            embedding_std: 1.0,
            laser_feature: 256,
            hidden: 128,
            log_std_init: 0.0,
            scan_pool: 1,
            motion: None,
        }
    }
}

impl NetworkConfig {
    /// Refuses sizes of 0, sizes that no machine can hold, an `embedding_std` that is negative or
    /// not finite, and a `log_std_init` that is not finite.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Config`] names the first field that is out of bounds.
    pub fn validate(&self) -> Result<(), PolicyError> {
        // Three beams are the fewest that leave the first convolution one window.
        let sizes = [
            ("frames", self.frames, 1),
            ("beams", self.beams, 3),
            ("n_behaviours", self.n_behaviours, 1),
            ("embedding", self.embedding, 1),
            ("laser_feature", self.laser_feature, 1),
            ("hidden", self.hidden, 1),
        ];
        for (field, found, least) in sizes {
            if found < least || found > SIZE_MAX {
                let expected = format!("{least} to {SIZE_MAX}");
                return Err(PolicyError::Config { field, found: found.to_string(), expected });
            }
        }
        if !(self.embedding_std.is_finite() && self.embedding_std >= 0.0) {
            let found = self.embedding_std.to_string();
            let expected = "a finite number ≥ 0".to_owned();
            return Err(PolicyError::Config { field: "embedding_std", found, expected });
        }
        if !self.log_std_init.is_finite() {
            let found = self.log_std_init.to_string();
            let expected = "a finite number".to_owned();
            return Err(PolicyError::Config { field: "log_std_init", found, expected });
        }
        self.validate_inputs()?;
        let largest = if self.motion.is_some() {
            [
                self.laser_feature.saturating_mul(self.input_len().saturating_add(self.n_behaviours)),
                self.hidden.saturating_mul(self.laser_feature),
                0,
            ]
        } else {
            [
                self.laser_feature.saturating_mul(self.flat_len()),
                self.hidden.saturating_mul(self.concat_len()),
                self.n_behaviours.saturating_mul(self.embedding),
            ]
        };
        let total = largest.iter().fold(0_usize, |sum, size| sum.saturating_add(*size));
        if total > PARAMETERS_MAX {
            let expected = format!("at most {PARAMETERS_MAX} parameters");
            return Err(PolicyError::Config {
                field: "sizes",
                found: format!("{total} parameters"),
                expected,
            });
        }
        Ok(())
    }

    /// The map before the network must fit the row and the network.
    fn validate_inputs(&self) -> Result<(), PolicyError> {
        let refuse = |field, found: String, expected: &str| {
            Err(PolicyError::Config { field, found, expected: expected.to_owned() })
        };
        let pool = self.scan_pool;
        if pool == 0 || !self.beams.is_multiple_of(pool) || self.beams / pool < 3 {
            let expected = format!("1 to {} (a divisor of the {} beams)", self.beams / 3, self.beams);
            return refuse("scan_pool", pool.to_string(), &expected);
        }
        let Some(motion) = &self.motion else { return Ok(()) };
        if pool != 1 {
            return refuse("scan_pool", pool.to_string(), "1 where the inputs are motions");
        }
        if self.frames < 2 || self.beams < 64 {
            let found = format!("{} frames of {} beams", self.frames, self.beams);
            return refuse("motion", found, "at least 2 frames of at least 64 beams");
        }
        for (value, name) in [(motion.dt, "dt"), (motion.v_max, "v_max"), (motion.w_max, "w_max")] {
            if !(value.is_finite() && value > 0.0) {
                return refuse("motion", format!("{name} = {value}"), "finite numbers > 0");
            }
        }
        Ok(())
    }

    /// Length of an observation row: scans, goal, velocity.
    pub fn observation_len(&self) -> usize {
        self.frames * self.beams + TAIL_LEN
    }

    /// Length of an input row, which the [encoder](crate::encoder) makes of an observation row.
    pub fn input_len(&self) -> usize {
        if self.motion.is_some() { motion::INPUT_LEN } else { self.frames * self.input_beams() + TAIL_LEN }
    }

    /// Beams of a scan as the convolutions read it (512 without pooling).
    pub fn input_beams(&self) -> usize {
        self.beams / self.scan_pool
    }

    /// Positions behind the first convolution (255 for 512 beams).
    pub fn conv1_len(&self) -> usize {
        conv_len(self.input_beams(), CONV1_KERNEL)
    }

    /// Positions behind the second convolution (128 for 512 beams).
    pub fn conv2_len(&self) -> usize {
        conv_len(self.conv1_len(), CONV2_KERNEL)
    }

    /// Length of the flattened output of the convolutions (4096 for 512 beams).
    pub fn flat_len(&self) -> usize {
        CONV_CHANNELS * self.conv2_len()
    }

    /// Number of inputs of the last hidden layer: laser feature, goal and velocity, embedding
    /// (292).
    pub fn concat_len(&self) -> usize {
        self.laser_feature + TAIL_LEN + self.embedding
    }
}

/// Positions behind a convolution of stride 2 and padding 1.
///
/// # Formula
///
/// ⌊(len + 2·padding − kernel) / stride⌋ + 1
fn conv_len(len: usize, kernel: usize) -> usize {
    (len + 2 * CONV_PADDING - kernel) / CONV_STRIDE + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_those_of_the_paper() {
        let config = NetworkConfig::default();
        let lengths = [config.conv1_len(), config.conv2_len(), config.flat_len(), config.concat_len()];
        assert_eq!(lengths, [255, 128, 4096, 292]);
        assert_eq!(config.observation_len(), crate::observation::OBSERVATION_LEN);
    }

    #[test]
    fn sizes_out_of_bounds_are_named() {
        let check = |config: NetworkConfig, field: &str| {
            let message = config.validate().unwrap_err().to_string();
            assert!(message.contains(field), "{message}");
        };
        let good = NetworkConfig::default();
        assert!(good.validate().is_ok());
        check(NetworkConfig { n_behaviours: 0, ..good.clone() }, "n_behaviours: found 0");
        check(NetworkConfig { beams: 2, ..good.clone() }, "beams: found 2");
        check(NetworkConfig { hidden: usize::MAX, ..good.clone() }, "hidden");
        check(NetworkConfig { laser_feature: 1 << 16, beams: 1 << 16, ..good.clone() }, "sizes");
        check(NetworkConfig { embedding_std: -1.0, ..good.clone() }, "embedding_std: found -1");
        check(NetworkConfig { embedding_std: f32::INFINITY, ..good.clone() }, "embedding_std");
        check(NetworkConfig { log_std_init: f32::NAN, ..good }, "log_std_init");
    }
}
