//! A run that takes milliseconds: two rooms of two agents with 16 beams, networks of 32 units.

use jostle_ppo::{Config, Trainer};

pub(crate) const TINY: &str = r"
N = 2
M = 2
R = 2
horizon = 16
minibatch = 24
epochs_discriminator = 2
learning_rate = 1e-3
network = { laser_feature = 32, hidden = 32, embedding = 4, log_std_init = -0.5 }
discriminator = { hidden = 32, learning_rate = 1e-3 }
[sim]
room = { width = 6.0, height = 6.0 }
laser = { beams = 16 }
spawn = { goal_distance = 2.0 }
episode = { step_limit = 12 }
";

pub(crate) fn tiny(overrides: &[&str]) -> Config {
    Config::parse(TINY, "tiny", overrides).expect("a valid configuration")
}

pub(crate) fn trainer(overrides: &[&str]) -> Trainer {
    Trainer::new(tiny(overrides)).expect("the room has place")
}
