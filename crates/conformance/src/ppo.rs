//! One full batch through the losses: log-probabilities, ratios, gradients, and three steps of
//! Adam.

use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use jostle_policy::{Backend, Batch, Network};
use jostle_ppo::adam::Adam;
use jostle_ppo::loss::{PolicyLoss, PolicyLossWeights, PolicyTargets, policy_loss, value_loss};

use super::discriminator::gradient_close;
use super::network::{Networks, check_gaussian, compare, log_probs, wide};
use super::tensors::Tensors;
use super::verdict::Verdict;

const LEARNING_RATE: f64 = 5e-5;
const WEIGHTS: PolicyLossWeights = PolicyLossWeights { clip_coef: 0.1, ent_coef: 5e-4 };
const STEPS: usize = 3;
/// Every 16th row of a tensor stands for the whole in `.rows16`.
const ROW_STRIDE: usize = 16;

/// Inputs and targets of the batch.
struct Fixture<'a> {
    tensors: &'a Tensors,
    observations: Vec<f32>,
    tokens: Vec<u32>,
    actions: Vec<[f32; 2]>,
    old_log_probs: Vec<f64>,
    advantages: Vec<f64>,
    value_targets: Vec<f64>,
    rows: Vec<u32>,
}

/// Checks a PPO fixture against the parameters of the forward fixture that it names.
pub(crate) fn check(tensors: &Tensors, path: &Path, backend: Backend, verdict: &mut Verdict) -> Result<()> {
    let source = parameter_file(tensors, path)?;
    let parameters = Tensors::read(&source).with_context(|| format!("parameters {}", source.display()))?;
    let batch = tensors.observations()?;
    let networks = Networks::read(&parameters, &batch)?;
    let doubles = |name: &str| Ok::<Vec<f64>, anyhow::Error>(wide(tensors.f32(name)?).collect());
    let fixture = Fixture {
        tensors,
        tokens: tensors.tokens(networks.config.n_behaviours)?,
        actions: tensors.pairs("action", batch.batch)?,
        old_log_probs: doubles("old_log_prob")?,
        advantages: doubles("advantage")?,
        value_targets: doubles("value_target")?,
        rows: (0..batch.batch as u32).collect(),
        observations: batch.rows,
    };
    let lengths = [&fixture.old_log_probs, &fixture.advantages, &fixture.value_targets].map(Vec::len);
    ensure!(
        lengths == [batch.batch; 3] && fixture.tokens.len() == batch.batch,
        "targets are not [{}]",
        batch.batch
    );
    ensure!(batch.batch > 0, "an empty batch");
    fixture.check_actor(networks.actor(backend)?.as_mut(), verdict)?;
    fixture.check_critic(networks.critic(backend)?.as_mut(), verdict)
}

/// The forward fixture with the starting parameters: named in the metadata, else
/// `forward_m<M>.safetensors`.
fn parameter_file(tensors: &Tensors, path: &Path) -> Result<std::path::PathBuf> {
    let name = match (tensors.metadata.get("parameters"), tensors.metadata.get("tokens")) {
        (Some(name), _) => name.clone(),
        (None, Some(tokens)) => format!("forward_m{tokens}.safetensors"),
        (None, None) => bail!("the metadata name no file of starting parameters"),
    };
    Ok(path.with_file_name(name))
}

impl Fixture<'_> {
    fn batch(&self) -> Batch<'_> {
        Batch::new(&self.observations, &self.tokens)
    }

    fn check_actor(&self, actor: &mut dyn Network, verdict: &mut Verdict) -> Result<()> {
        let mut adam = Adam::new(actor.layout().len(), LEARNING_RATE);
        let mut curve = Vec::new();
        for step in 0..=STEPS {
            let (means, loss) = self.actor_pass(actor)?;
            curve.push(loss.loss as f32);
            if step == 0 {
                self.check_start(&means, &loss, actor, verdict)?;
            }
            if step < STEPS {
                let (parameters, gradient) = actor.parameters_and_gradient();
                adam.step(parameters, gradient);
                actor.parameters_changed();
            }
        }
        compare(self.tensors, "loss_curve", &curve, verdict)?;
        let parameters = actor.parameters_and_gradient().0.to_vec();
        self.check_group("after.actor.", actor, &parameters, after_close, verdict)
    }

    /// Forward and backward; the gradient stays in the network.
    fn actor_pass(&self, actor: &mut dyn Network) -> Result<(Vec<f32>, PolicyLoss)> {
        let log_std = current_log_std(actor)?;
        let mut means = vec![0.0; 2 * self.rows.len()];
        actor.forward(self.batch(), &mut means);
        let targets = PolicyTargets {
            actions: &self.actions,
            old_log_probs: &self.old_log_probs,
            advantages: &self.advantages,
        };
        let mut d_means = vec![[0.0; 2]; self.rows.len()];
        let loss = policy_loss(means.as_chunks().0, log_std, targets, &self.rows, WEIGHTS, &mut d_means);
        actor.backward(d_means.as_flattened());
        set_log_std_gradient(actor, loss.d_log_std)?;
        Ok((means, loss))
    }

    fn check_start(
        &self,
        means: &[f32],
        loss: &PolicyLoss,
        actor: &mut dyn Network,
        verdict: &mut Verdict,
    ) -> Result<()> {
        let log_std = current_log_std(actor)?;
        check_gaussian(self.tensors, means, log_std, verdict)?;
        let log_probs = log_probs(self.tensors, means, log_std)?;
        let ratios: Vec<f32> = log_probs
            .iter()
            .zip(&self.old_log_probs)
            .map(|(&new, old)| (f64::from(new) - old).exp() as f32)
            .collect();
        compare(self.tensors, "ratio", &ratios, verdict)?;
        compare(self.tensors, "surrogate", &[loss.surrogate as f32], verdict)?;
        compare(self.tensors, "loss", &[loss.loss as f32], verdict)?;
        let gradient = actor.parameters_and_gradient().1.to_vec();
        self.check_group("grad.actor.", actor, &gradient, gradient_close, verdict)
    }

    fn check_critic(&self, critic: &mut dyn Network, verdict: &mut Verdict) -> Result<()> {
        let mut adam = Adam::new(critic.layout().len(), LEARNING_RATE);
        let mut curve = Vec::new();
        for step in 0..=STEPS {
            let mut values = vec![0.0; self.rows.len()];
            critic.forward(self.batch(), &mut values);
            let mut d_values = vec![0.0; values.len()];
            let loss = value_loss(&values, &self.value_targets, &self.rows, &mut d_values);
            curve.push(loss as f32);
            critic.backward(&d_values);
            if step == 0 {
                compare(self.tensors, "value", &values, verdict)?;
                compare(self.tensors, "value_loss", &[loss as f32], verdict)?;
                let gradient = critic.parameters_and_gradient().1.to_vec();
                self.check_group("grad.critic.", critic, &gradient, gradient_close, verdict)?;
            }
            if step < STEPS {
                let (parameters, gradient) = critic.parameters_and_gradient();
                adam.step(parameters, gradient);
                critic.parameters_changed();
            }
        }
        compare(self.tensors, "value_loss_curve", &curve, verdict)?;
        let parameters = critic.parameters_and_gradient().0.to_vec();
        self.check_group("after.critic.", critic, &parameters, after_close, verdict)
    }

    /// Checks all tensors under `prefix`: whole ones, every 16th row of large ones, sums and norms.
    fn check_group(
        &self,
        prefix: &str,
        network: &dyn Network,
        native: &[f32],
        close: fn(&[f32], &[f32], &str, &mut Verdict),
        verdict: &mut Verdict,
    ) -> Result<()> {
        let canonical = network.to_canonical(native);
        for key in self.tensors.names_under(prefix) {
            let name = ["sum", "norm", "rows16"]
                .iter()
                .find_map(|s| key.strip_suffix(s)?.strip_suffix('.'))
                .unwrap_or(key);
            let entry = network
                .layout()
                .entry(name)
                .with_context(|| format!("{prefix}{key} belongs to no parameter"))?;
            let values = &canonical[entry.range()];
            let full = format!("{prefix}{key}");
            let kind = key.rsplit_once('.').map_or("", |(_, kind)| kind);
            if kind == "sum" || kind == "norm" {
                check_digest(&full, values, self.tensors.f64_scalar(&full)?, verdict);
            } else if kind == "rows16" {
                let width = entry.len() / entry.shape.first().copied().unwrap_or(1).max(1);
                let rows: Vec<f32> =
                    values.chunks_exact(width).step_by(ROW_STRIDE).flatten().copied().collect();
                close(&rows, self.tensors.f32(&full)?, &full, verdict);
            } else {
                close(values, self.tensors.f32(&full)?, &full, verdict);
            }
        }
        Ok(())
    }
}

/// Sum and L2 norm of a whole tensor. A sum's tolerance follows the norm, as its terms cancel.
fn check_digest(key: &str, values: &[f32], expected: f64, verdict: &mut Verdict) {
    let norm = wide(values).map(|x| x * x).sum::<f64>().sqrt();
    if key.rsplit_once('.').is_some_and(|(_, kind)| kind == "norm") {
        verdict.close(norm, expected, 0.0, 1e-5, || key.to_owned());
    } else {
        verdict.close(wide(values).sum(), expected, 1e-4 * (1.0 + norm), 0.0, || key.to_owned());
    }
}

/// Parameters after the steps: 1e-5 for each entry, 1e-6 for 99.9 % of a tensor (where a gradient
/// is near Adam's ε, the step is ill-conditioned).
fn after_close(actual: &[f32], expected: &[f32], name: &str, verdict: &mut Verdict) {
    verdict.all_close(wide(actual), wide(expected), (1e-5, 0.0), name);
    let far = wide(actual).zip(wide(expected)).filter(|(a, e)| (a - e).abs() > 1e-6).count();
    verdict.error(far as f64 / expected.len().max(1) as f64, 1e-3, || {
        format!("{name}: share of entries off by > 1e-6")
    });
}

fn current_log_std(actor: &mut dyn Network) -> Result<[f32; 2]> {
    let native = actor.parameters_and_gradient().0.to_vec();
    let range = actor.layout().range("log_std").context("an actor without log_std")?;
    Ok(actor.to_canonical(&native)[range].try_into()?)
}

fn set_log_std_gradient(actor: &mut dyn Network, d_log_std: [f64; 2]) -> Result<()> {
    let native = actor.parameters_and_gradient().1.to_vec();
    let mut canonical = actor.to_canonical(&native);
    let range = actor.layout().range("log_std").context("an actor without log_std")?;
    canonical[range].copy_from_slice(&d_log_std.map(|d| d as f32));
    let native = actor.to_native(&canonical);
    actor.parameters_and_gradient().1.copy_from_slice(&native);
    Ok(())
}
