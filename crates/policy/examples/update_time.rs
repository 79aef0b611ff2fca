//! An update's time by its parts: the learner's part alone, phase by phase, and the actor's
//! inference.
//!
//! ```text
//! cargo run --release -p jostle-policy --example update_time -- [THREADS] [ROUNDS] [INSTRUCTIONS]
//! ```
//!
//! One update is 640 transitions, full batch, 3 epochs each of actor, critic and two
//! discriminators: forward, backward and Adam, 39.4 GFLOP. Figures are medians over the rounds. The
//! rate to compare with is that of the kernels' own product on operands that stay in the
//! first-level cache, measured in the same run: what the processor gives at its present clock.
//! Other load on the machine moves all of them; compare ratios within one run. INSTRUCTIONS is
//! `avx512`, `avx2` or `plain`: one set of what the processor has, instead of the widest.

use std::hint::black_box;
use std::time::Instant;

use jostle_kernels::{AdamStep, Finish, Grid, HALF, Isa, PANEL, Start, Strips, adam_step, rows_times_panel};
use jostle_policy::fast::Mlp;
use jostle_policy::{Backend, Batch, Network, NetworkConfig, Parameters, PolicyError, actor, critic};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const BATCH: usize = 640;
const EPOCHS: usize = 3;
/// Multiply-adds of a trunk for one sample: conv1, conv2, fc1, fc2 (heads are left out).
const TRUNK: [f64; 4] = [255.0 * 480.0, 128.0 * 3072.0, 4096.0 * 256.0, 292.0 * 128.0];

/// A network with its optimiser and its inputs.
struct Learner {
    network: Box<dyn Network>,
    width: usize,
    moments: [Vec<f32>; 2],
    observations: Vec<f32>,
    outputs: Vec<f32>,
    step: u64,
    /// Seconds of each epoch's forward, backward and Adam.
    seconds: [Vec<f64>; 3],
}

impl Learner {
    fn new(mut network: Box<dyn Network>, width: usize, rng: &mut impl Rng) -> Self {
        let len = network.parameters_and_gradient().0.len();
        let observations =
            (0..BATCH * width).map(|_| rng.next_u32() as f32 / u32::MAX as f32 - 0.5).collect();
        let outputs = vec![0.0; BATCH * network.n_outputs()];
        let moments = [vec![0.0; len], vec![0.0; len]];
        Self { network, width, moments, observations, outputs, step: 0, seconds: Default::default() }
    }

    fn epochs(&mut self, tokens: &[u32]) {
        for _ in 0..EPOCHS {
            let start = Instant::now();
            self.network.forward(Batch::new(&self.observations, tokens), &mut self.outputs);
            let forward = Instant::now();
            // The gradient of a mean of squares.
            let d: Vec<f32> = self.outputs.iter().map(|output| output * 2.0 / BATCH as f32).collect();
            self.network.backward(&d);
            let backward = Instant::now();
            self.step += 1;
            let step =
                AdamStep { learning_rate: 5e-5, beta1: 0.9, beta2: 0.999, epsilon: 1e-8, step: self.step };
            let [m, v] = &mut self.moments;
            let (parameters, gradient) = self.network.parameters_and_gradient();
            adam_step(Isa::detect(), parameters, gradient, m, v, &step);
            self.network.parameters_changed();
            let times = [forward - start, backward - forward, backward.elapsed()];
            self.seconds.iter_mut().zip(times).for_each(|(all, time)| all.push(time.as_secs_f64()));
        }
    }

    fn report(&self, name: &str, madds: [f64; 2]) {
        let [forward, backward, adam] = &self.seconds;
        let rate = |madds: f64, seconds: f64| 2e-9 * madds * BATCH as f64 / seconds;
        println!(
            "  {name:<14} forward {:7.2} ms {:6.1} GFLOP/s, backward {:7.2} ms {:6.1} GFLOP/s, Adam {:5.2} ms",
            1e3 * median(forward),
            rate(madds[0], median(forward)),
            1e3 * median(backward),
            rate(madds[1], median(backward)),
            1e3 * median(adam),
        );
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// GFLOP/s of the product of 14 rows and one panel, all in the first-level cache.
fn in_cache_rate() -> f64 {
    let (a, panel) = (vec![0.5; 14 * 256], vec![0.5; 256 * PANEL]);
    let mut out = vec![0.0; 14 * PANEL];
    let mut run = || {
        let start = Instant::now();
        for _ in 0..2000 {
            let strips = Strips { data: black_box(&a), blocks: 16, block_len: 16, block_stride: 14 * 16 };
            let out = Grid { data: black_box(&mut out[..]), row: PANEL, half: HALF };
            rows_times_panel::<16>(Isa::detect(), 14, strips, &panel, Start::Zero, Finish::Store, out);
        }
        2e-9 * 2000.0 * (14 * 256 * PANEL) as f64 / start.elapsed().as_secs_f64()
    };
    (0..9).map(|_| run()).fold(0.0, f64::max)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default| arguments.get(i).map_or(Ok(default), |argument| argument.parse());
    let (threads, rounds) = (number(0, 1)?, number(1, 9)?);
    if let Some(key) = arguments.get(2) {
        let sets = Isa::available();
        let keys = || sets.iter().map(|set| set.key()).collect::<Vec<_>>().join(", ");
        let set = sets
            .iter()
            .find(|set| set.key() == key)
            .ok_or_else(|| format!("{key}: expected one of {}", keys()))?;
        assert!(set.choose(), "nothing has asked before");
    }
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    // On a worker of the pool, so that nothing is handed over before the work begins.
    Ok(rayon::scope(|_| measure(threads, rounds))?)
}

fn measure(threads: usize, rounds: usize) -> Result<(), PolicyError> {
    let config = NetworkConfig::default();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut rng = &mut rng;
    let of_actor = actor(&config, Backend::Fast, &Parameters::actor(&config, &mut rng))?;
    let of_critic = critic(&config, Backend::Fast, &Parameters::critic(&config, &mut rng))?;
    let mut policy = Learner::new(of_actor, 1540, rng);
    let mut value = Learner::new(of_critic, 1540, rng);
    let mut mlp = |inputs| -> Result<Learner, PolicyError> {
        let parameters = Parameters::init(Mlp::layout(inputs, 128, 5), &mut rng);
        Ok(Learner::new(Box::new(Mlp::new(inputs, 128, 5, &parameters)?), inputs, rng))
    };
    let (mut state, mut state_action) = (mlp(1540)?, mlp(1542)?);
    let tokens: Vec<u32> = (0..BATCH as u32).map(|row| row % 5).collect();
    let trunk: f64 = TRUNK.iter().sum();
    let dense = |inputs: f64| inputs * 128.0 + 128.0 * 128.0;

    // The networks one after the other, for the figures of each; then side by side, as the learner
    // runs them.
    let mut together = Vec::new();
    let mut rates = Vec::new();
    for _ in 0..rounds {
        rates.push(in_cache_rate());
        for learner in [&mut policy, &mut value, &mut state, &mut state_action] {
            learner.epochs(&tokens);
        }
        let keep = [&policy, &value, &state, &state_action].map(|learner| learner.seconds.clone());
        let start = Instant::now();
        rayon::join(
            || rayon::join(|| policy.epochs(&tokens), || value.epochs(&tokens)),
            || rayon::join(|| state.epochs(&tokens), || state_action.epochs(&tokens)),
        );
        together.push(start.elapsed().as_secs_f64());
        for (learner, seconds) in
            [&mut policy, &mut value, &mut state, &mut state_action].into_iter().zip(keep)
        {
            learner.seconds = seconds;
        }
    }
    let flop = 2.0
        * EPOCHS as f64
        * BATCH as f64
        * (2.0 * (3.0 * trunk - TRUNK[0])
            + [1540.0, 1542.0].map(|n| 3.0 * dense(n) - n * 128.0).iter().sum::<f64>());
    let (rate, seconds) = (median(&rates), median(&together));
    println!("{}, {threads} threads, in-cache product {rate:.1} GFLOP/s on one", Isa::detect().name());
    let achieved = 1e-9 * flop / seconds;
    let share = 100.0 * achieved / (rate * threads as f64);
    println!("update {:.1} ms, {:.1} GFLOP, {achieved:.1} GFLOP/s, {share:.0} %", 1e3 * seconds, 1e-9 * flop);
    policy.report("actor", [trunk, 2.0 * trunk - TRUNK[0]]);
    value.report("critic", [trunk, 2.0 * trunk - TRUNK[0]]);
    state.report("q(z | s)", [dense(1540.0), 2.0 * dense(1540.0) - 1540.0 * 128.0]);
    state_action.report("q(z | s, a)", [dense(1542.0), 2.0 * dense(1542.0) - 1542.0 * 128.0]);

    for batch in [1, 5, 20, 80, 320] {
        let observations = &policy.observations[..batch * policy.width];
        let mut outputs = vec![0.0; batch * 2];
        let calls = 4000 / (batch + 15);
        let mut times = Vec::new();
        for _ in 0..rounds {
            let start = Instant::now();
            for _ in 0..calls {
                policy.network.infer(Batch::new(observations, &tokens[..batch]), &mut outputs);
            }
            times.push(start.elapsed().as_secs_f64() / calls as f64);
        }
        println!("  actor, batch {batch:>3}: {:8.1} us", 1e6 * median(&times));
    }
    Ok(())
}
