//! A first training run, in seconds: two robots with 32 beams in a small room, two behaviours.
//! `cargo run --release -p jostle-ppo --example train_tiny_room -- [UPDATES]`

use jostle_ppo::{Config, PpoError, Trainer};

const CONFIG: &str = r"
N = 2
M = 2
R = 8
horizon = 64
learning_rate = 1e-3
network = { laser_feature = 32, hidden = 32, embedding = 8, log_std_init = -0.5 }
discriminator = { hidden = 32, learning_rate = 1e-3 }
[sim]
room = { width = 6.0, height = 6.0 }
laser = { beams = 32 }
spawn = { goal_distance = 2.0, wall_clearance = 1.0 }
episode = { step_limit = 100 }
";

fn main() -> Result<(), PpoError> {
    let updates = std::env::args().nth(1).unwrap_or_else(|| "100".to_owned());
    let config = Config::parse(CONFIG, "train_tiny_room", &[format!("updates={updates}")])?;
    let mut trainer = Trainer::new(config)?;
    println!("{:>6} {:>11} {:>8} {:>9} {:>7}", "update", "transitions", "success", "collision", "return");
    while !trainer.is_done() {
        let report = trainer.update()?;
        if report.update.is_multiple_of(10) {
            let n = report.episodes;
            let share = |count: u64| count as f64 / n.ended.max(1) as f64;
            let (success, collision) = (share(n.success), share(n.collision_wall + n.collision_agent));
            let mean_return = report.episode_return.unwrap_or(f64::NAN);
            println!(
                "{:>6} {:>11} {success:>8.2} {collision:>9.2} {mean_return:>7.1}",
                report.update, report.transitions
            );
        }
    }
    trainer.save(std::path::Path::new("tiny.safetensors"))
}
