//! Settings of the planners that know positions, tried on the validation crowds: how
//! `OrcaRobotConfig` and `SocialForceRobotConfig` got their defaults (docs/planners.md).
//!
//! ```sh
//! cargo run --release -p jostle-eval --example tune_positions -- 500
//! ```
//!
//! It prints a line for each setting: success among the straight walkers, among the stop-and-go
//! walkers, and their mean. The episodes are of another seed than those of the tables, and the six
//! test crowds are not looked at.

use jostle_arena::lock_step::run_episodes;
use jostle_arena::planners::each_room::EachRoom;
use jostle_arena::planners::{OrcaRobot, OrcaRobotConfig, SocialForceRobot, SocialForceRobotConfig};
use jostle_arena::room::RoomPlan;
use jostle_arena::{ArenaConfig, Outcome, Pools, Robot};
use jostle_eval::{EvalError, Protocol};
use jostle_peds::CrowdKind;

/// Root seed of the episodes; the tables have 0.
const SEED: u64 = 1;
/// The crowds that settings are chosen by.
const CROWDS: [CrowdKind; 2] = [CrowdKind::Straight, CrowdKind::StopAndGo];

/// Makes a robot for the rooms of a plan.
type Make = dyn Fn(&RoomPlan) -> Result<Box<dyn Robot>, EvalError>;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let episodes: u64 = std::env::args().nth(1).map_or(Ok(500), |text| text.parse())?;
    for radius in [0.5, 0.55, 0.65, 0.8, 1.0] {
        for time_horizon in [1.5, 3.0, 5.0] {
            for responsibility in [0.5, 1.0] {
                let config =
                    OrcaRobotConfig { radius, time_horizon, responsibility, ..OrcaRobotConfig::default() };
                let label = format!("orca radius {radius} horizon {time_horizon} share {responsibility}");
                try_setting(&label, episodes, &move |plan| {
                    Ok(Box::new(EachRoom::new(OrcaRobot::new(plan, &config)?)))
                })?;
            }
        }
    }
    for sigma in [0.3, 0.6, 0.9, 1.2, 1.5] {
        for v0 in [2.1, 4.0, 8.0, 12.0, 16.0, 24.0] {
            let config = SocialForceRobotConfig { sigma, v0, ..SocialForceRobotConfig::default() };
            let label = format!("social-force sigma {sigma} v0 {v0}");
            try_setting(&label, episodes, &move |plan| {
                Ok(Box::new(EachRoom::new(SocialForceRobot::new(plan, &config)?)))
            })?;
        }
    }
    Ok(())
}

fn try_setting(label: &str, episodes: u64, make: &Make) -> Result<(), EvalError> {
    let config = ArenaConfig { seed: SEED, ..ArenaConfig::default() };
    let protocol = Protocol::new(config, Pools::default())?;
    let mut rates = Vec::new();
    for kind in CROWDS {
        let plan = RoomPlan::new(protocol.config(), kind)?;
        let (mut robot, mut crowd, mut successes) = (make(&plan)?, protocol.crowd(&plan)?, 0_u64);
        run_episodes::<EvalError>(&plan, &mut *robot, &mut *crowd, 0..episodes, |episode| {
            successes += u64::from(episode.outcome == Outcome::Success);
            Ok(())
        })?;
        rates.push(successes as f64 / episodes as f64);
    }
    println!("{label}: {:.3} {:.3} mean {:.3}", rates[0], rates[1], rates.iter().sum::<f64>() / 2.0);
    Ok(())
}
