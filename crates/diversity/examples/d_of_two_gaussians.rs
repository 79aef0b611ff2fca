//! The diversity metric D of a policy with two behaviours, by hand: `cargo run -p jostle-diversity
//! --example d_of_two_gaussians`.

use jostle_diversity::BehaviourActions;
use jostle_diversity::covariance::FullGaussian;

fn main() -> Result<(), jostle_diversity::DiversityError> {
    // One state; behaviour 0 drives straight at 0.8 m/s, behaviour 1 slowly to the left. σ = 0.5
    // for v and for ω.
    let means = [0.8, 0.0, 0.3, 0.6];
    let log_stds = [0.5_f64.ln(); 4];
    let actions = BehaviourActions::new(&means, &log_stds, 2, 2)?;
    println!("D = {:.3} nats", actions.diversity());

    // The same through full covariances, which may also hold a correlation of v and ω.
    let straight = FullGaussian::new(&means[..2], &[0.25, 0.0, 0.0, 0.25])?;
    let left = FullGaussian::new(&means[2..], &[0.25, 0.0, 0.0, 0.25])?;
    println!("KL(0 ‖ 1) = {:.3}, KL(1 ‖ 0) = {:.3}", straight.kl(&left)?, left.kl(&straight)?);
    let leaning = FullGaussian::new(&means[2..], &[0.25, -0.15, -0.15, 0.25])?;
    println!("with v and ω correlated in behaviour 1: KL(0 ‖ 1) = {:.3}", straight.kl(&leaning)?);
    Ok(())
}
