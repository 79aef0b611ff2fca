//! Compares the networks with PyTorch's outputs, gradients and parameters after three Adam steps.
//!
//! ```text
//! cargo run --release -p jostle-policy --example compare_with_pytorch -- FOLDER
//! ```
//!
//! FOLDER holds `forward_m1`, `forward_m5` and `ppo_m5.safetensors` in the format of the
//! conformance set. Each line is the largest deviation; a gradient's is relative to the largest
//! entry of its tensor.

use std::path::Path;

use jostle_policy::{
    Backend, Batch, DiagonalGaussian, Layout, Network, NetworkConfig, Parameters, PolicyError, TensorFile,
    actor, critic,
};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome<()> {
    let folder = std::env::args().nth(1).ok_or("give the folder of the fixtures")?;
    for backend in [Backend::Reference, Backend::Fast] {
        println!("{backend:?}");
        for name in ["forward_m1", "forward_m5"] {
            let path = Path::new(&folder).join(format!("{name}.safetensors"));
            let mut case = Case::read(&path, &path, backend)?;
            case.report(name)?;
        }
        let file = |name: &str| Path::new(&folder).join(format!("{name}.safetensors"));
        Case::read(&file("forward_m5"), &file("ppo_m5"), backend)?.learn()?;
    }
    Ok(())
}

/// Both networks, and a file of inputs and expected outputs.
struct Case {
    file: TensorFile,
    actor: Box<dyn Network>,
    critic: Box<dyn Network>,
    observations: Vec<f32>,
    tokens: Vec<u32>,
}

impl Case {
    fn read(parameters: &Path, inputs: &Path, backend: Backend) -> Outcome<Self> {
        let (from, file) = (TensorFile::read(parameters)?, TensorFile::read(inputs)?);
        let n_behaviours = from.shape("actor.embedding.weight")?[0];
        let config = NetworkConfig { n_behaviours, ..NetworkConfig::default() };
        let tokens: Vec<u32> = file.raw("token")?.1.chunks(8).map(|bytes| u32::from(bytes[0])).collect();
        let rows = tokens.len();
        let part = |name: &str, shape: &[usize]| -> Result<Vec<f32>, PolicyError> { file.f32s(name, shape) };
        let laser = part("laser", &[rows, config.frames, config.beams])?;
        let (goal, velocity) = (part("goal", &[rows, 2])?, part("velocity", &[rows, 2])?);
        let row =
            |i: usize| [&laser[i * 1536..][..1536], &goal[2 * i..][..2], &velocity[2 * i..][..2]].concat();
        Ok(Self {
            actor: actor(&config, backend, &from.parameters("actor", Layout::actor(&config))?)?,
            critic: critic(&config, backend, &from.parameters("critic", Layout::critic(&config))?)?,
            observations: (0..rows).flat_map(row).collect(),
            tokens,
            file,
        })
    }

    fn expected(&self, name: &str) -> Outcome<Vec<f32>> {
        Ok(self.file.f32s(name, self.file.shape(name)?)?)
    }

    fn policies(&mut self) -> Vec<DiagonalGaussian> {
        let mut mean = vec![0.0; 2 * self.tokens.len()];
        self.actor.forward(Batch::new(&self.observations, &self.tokens), &mut mean);
        let log_std = canonical(&mut *self.actor, false).get("log_std").map_or([0.0; 2], |s| [s[0], s[1]]);
        mean.chunks(2).map(|mean| DiagonalGaussian { mean: [mean[0], mean[1]], log_std }).collect()
    }

    fn values(&mut self) -> Vec<f32> {
        let mut values = vec![0.0; self.tokens.len()];
        self.critic.forward(Batch::new(&self.observations, &self.tokens), &mut values);
        values
    }

    fn actions(&self) -> Outcome<Vec<[f32; 2]>> {
        Ok(self.expected("action")?.chunks(2).map(|a| [a[0], a[1]]).collect())
    }

    fn report(&mut self, name: &str) -> Outcome<()> {
        let (policies, values, actions) = (self.policies(), self.values(), self.actions()?);
        let mean: Vec<f32> = policies.iter().flat_map(|policy| policy.mean).collect();
        let log_prob: Vec<f32> = policies.iter().zip(actions).map(|(p, a)| p.log_prob(a) as f32).collect();
        println!("{name} mean {:.1e}", largest(&mean, &self.expected("mean")?));
        println!("{name} value {:.1e}", largest(&values, &self.expected("value")?));
        println!("{name} log_prob {:.1e}", largest(&log_prob, &self.expected("log_prob")?));
        println!(
            "{name} entropy {:.1e}",
            largest(&[policies[0].entropy() as f32], &self.expected("entropy")?)
        );
        Ok(())
    }

    /// The losses of PPO on one full batch, three steps of Adam.
    fn learn(&mut self) -> Outcome<()> {
        let (advantage, old) = (self.expected("advantage")?, self.expected("old_log_prob")?);
        let (targets, actions) = (self.expected("value_target")?, self.actions()?);
        let n = targets.len() as f64;
        let (mut of_actor, mut of_critic) = (Adam::default(), Adam::default());
        let (mut losses, mut value_losses) = (Vec::new(), Vec::new());
        for step in 0..4 {
            let policies = self.policies();
            let (mut loss, mut d_mean, mut d_log_std) = (0.0, Vec::new(), [-5e-4_f64; 2]);
            for (i, policy) in policies.iter().enumerate() {
                let (a, ratio) =
                    (f64::from(advantage[i]), (policy.log_prob(actions[i]) - f64::from(old[i])).exp());
                let clipped = ratio.clamp(0.9, 1.1) * a;
                loss -= (ratio * a).min(clipped) / n;
                let d_log_prob = if ratio * a <= clipped { -ratio * a / n } else { 0.0 };
                d_mean.extend(policy.d_log_prob_d_mean(actions[i]).map(|d| (d_log_prob * d) as f32));
                let d_width = policy.d_log_prob_d_log_std(actions[i]);
                (0..2).for_each(|k| d_log_std[k] += d_log_prob * d_width[k]);
            }
            losses.push((loss - 5e-4 * policies[0].entropy()) as f32);
            let values = self.values();
            let errors: Vec<f64> =
                values.iter().zip(&targets).map(|(v, t)| f64::from(*v) - f64::from(*t)).collect();
            value_losses.push((errors.iter().map(|error| error * error).sum::<f64>() / n) as f32);
            if step == 3 {
                break;
            }
            self.actor.backward(&d_mean);
            let at = self.actor.layout().range("log_std").ok_or("no log_std")?;
            let native =
                self.actor.to_native(&(0..self.actor.layout().len()).map(|i| i as f32).collect::<Vec<_>>());
            for (i, slot) in native.iter().zip(self.actor.parameters_and_gradient().1) {
                if at.contains(&(*i as usize)) {
                    *slot = d_log_std[*i as usize - at.start] as f32;
                }
            }
            self.critic.backward(&errors.iter().map(|error| (2.0 * error / n) as f32).collect::<Vec<_>>());
            if step == 0 {
                let (of_actor, of_critic) =
                    (canonical(&mut *self.actor, true), canonical(&mut *self.critic, true));
                println!("gradient of the actor {:.1e}", self.worst("grad.actor", &of_actor, true)?);
                println!("gradient of the critic {:.1e}", self.worst("grad.critic", &of_critic, true)?);
            }
            of_actor.step(&mut *self.actor);
            of_critic.step(&mut *self.critic);
        }
        let (after_actor, after_critic) =
            (canonical(&mut *self.actor, false), canonical(&mut *self.critic, false));
        println!("actor after three steps {:.1e}", self.worst("after.actor", &after_actor, false)?);
        println!("critic after three steps {:.1e}", self.worst("after.critic", &after_critic, false)?);
        println!("loss curve {:.1e}", largest(&losses, &self.expected("loss_curve")?));
        println!("value loss curve {:.1e}", largest(&value_losses, &self.expected("value_loss_curve")?));
        Ok(())
    }

    /// The largest deviation over all tensors; `fc1.weight` is stored as every sixteenth row.
    fn worst(&self, prefix: &str, found: &Parameters, relative: bool) -> Outcome<f32> {
        let mut worst = 0.0_f32;
        for entry in found.layout().entries() {
            let name = format!("{prefix}.{}", entry.name);
            let values = &found.flat()[entry.range()];
            let (expected, values) = if self.file.contains(&name) {
                (self.expected(&name)?, values.to_vec())
            } else {
                let rows = values.chunks(entry.shape[1]).step_by(16).flatten().copied().collect();
                (self.expected(&format!("{name}.rows16"))?, rows)
            };
            let scale = if relative { expected.iter().fold(1e-12_f32, |s, v| s.max(v.abs())) } else { 1.0 };
            worst = worst.max(largest(&values, &expected) / scale);
        }
        Ok(worst)
    }
}

/// The parameters (or the gradient) of a network in canonical order.
fn canonical(network: &mut dyn Network, gradient: bool) -> Parameters {
    let (parameters, d) = network.parameters_and_gradient();
    let native = if gradient { d.to_vec() } else { parameters.to_vec() };
    let flat = network.to_canonical(&native);
    Parameters::from_flat(network.layout().clone(), flat).expect("the network's own layout")
}

fn largest(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Adam as PyTorch has it, at the paper's learning rate.
#[derive(Default)]
struct Adam {
    step: i32,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Adam {
    fn step(&mut self, network: &mut dyn Network) {
        self.step += 1;
        let correct = |beta: f32| 1.0 - beta.powi(self.step);
        let (parameters, gradient) = network.parameters_and_gradient();
        self.first.resize(parameters.len(), 0.0);
        self.second.resize(parameters.len(), 0.0);
        for (i, g) in gradient.iter().enumerate() {
            self.first[i] = 0.9 * self.first[i] + 0.1 * g;
            self.second[i] = 0.999 * self.second[i] + 0.001 * g * g;
            let (m, v) = (self.first[i] / correct(0.9), self.second[i] / correct(0.999));
            parameters[i] -= 5e-5 * m / (v.sqrt() + 1e-8);
        }
        network.parameters_changed();
    }
}
