//! Loads a trained policy and asks every behaviour what it would do in one situation: free space
//! all around, the goal five metres ahead, the robot standing.
//!
//! ```text
//! cargo run --release -p jostle-policy --example load_and_act -- CHECKPOINT.safetensors
//! ```

use jostle_policy::{Backend, Batch, PolicyFile, actor};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give the path of a checkpoint or policy")?;
    let policy = PolicyFile::load(path)?;
    let mut actor = actor(&policy.network, Backend::default(), &policy.actor)?;

    let scans = policy.network.frames * policy.network.beams;
    let mut observation = vec![0.5; policy.network.observation_len()]; // 10 m / 10 − 0.5
    observation[scans..].copy_from_slice(&[5.0, 0.0, 0.0, 0.0]); // goal x, goal y, v, ω

    println!("trained for {} updates from seed {}", policy.provenance.update, policy.provenance.seed);
    for behaviour in 0..policy.network.n_behaviours as u32 {
        let mut mean = [0.0; 2];
        actor.infer(Batch::new(&observation, &[behaviour]), &mut mean);
        println!("behaviour {behaviour}: v = {:.3} m/s, ω = {:+.3} rad/s", mean[0], mean[1]);
    }
    Ok(())
}
