//! Actor and critic: means, values, log-probabilities, entropy, and the two inner features.

use anyhow::{Context as _, Result, ensure};
use jostle_policy::{
    Backend, Batch, DiagonalGaussian, Layout, Network, NetworkConfig, Parameters, actor, critic,
};

use super::probe;
use super::tensors::{Observations, Tensors};
use super::verdict::Verdict;

/// Tolerance of single precision (absolute, relative).
pub(crate) const SINGLE: (f64, f64) = (1e-5, 1e-5);

/// The networks of a fixture, with the shape that its tensors have.
pub(crate) struct Networks {
    pub(crate) config: NetworkConfig,
    actor: Parameters,
    critic: Parameters,
}

impl Networks {
    /// Reads `actor.*` and `critic.*`; frames and beams are those of `batch`.
    pub(crate) fn read(tensors: &Tensors, batch: &Observations) -> Result<Self> {
        let shape = |name: &str, axis: usize| -> Result<usize> {
            tensors.get(name)?.shape.get(axis).copied().with_context(|| format!("{name} has too few axes"))
        };
        let config = NetworkConfig {
            frames: batch.frames,
            beams: batch.beams,
            n_behaviours: shape("actor.embedding.weight", 0)?,
            embedding: shape("actor.embedding.weight", 1)?,
            laser_feature: shape("actor.fc1.weight", 0)?,
            hidden: shape("actor.fc2.weight", 0)?,
            ..NetworkConfig::default()
        };
        config.validate()?;
        let actor = parameters(tensors, "actor.", Layout::actor(&config))?;
        let critic = parameters(tensors, "critic.", Layout::critic(&config))?;
        Ok(Self { config, actor, critic })
    }

    pub(crate) fn actor(&self, backend: Backend) -> Result<Box<dyn Network>> {
        Ok(actor(&self.config, backend, &self.actor)?)
    }

    pub(crate) fn critic(&self, backend: Backend) -> Result<Box<dyn Network>> {
        Ok(critic(&self.config, backend, &self.critic)?)
    }

    pub(crate) fn log_std(&self) -> Result<[f32; 2]> {
        let values = self.actor.get("log_std").context("actor.log_std is missing")?;
        Ok(values.try_into()?)
    }
}

/// Fills a layout from the tensors `prefix + name`, whose shapes must be the layout's.
pub(crate) fn parameters(tensors: &Tensors, prefix: &str, layout: Layout) -> Result<Parameters> {
    let mut flat = Vec::with_capacity(layout.len());
    for entry in layout.entries() {
        let name = format!("{prefix}{}", entry.name);
        let shape = &tensors.get(&name)?.shape;
        ensure!(*shape == entry.shape, "{name} has shape {shape:?}, not {:?}", entry.shape);
        flat.extend_from_slice(tensors.f32(&name)?);
    }
    Ok(Parameters::from_flat(layout, flat)?)
}

/// Checks a forward fixture. Groups of expected tensors that are absent are not checked.
pub(crate) fn check(tensors: &Tensors, backend: Backend, verdict: &mut Verdict) -> Result<()> {
    let batch = tensors.observations()?;
    let networks = Networks::read(tensors, &batch)?;
    let tokens = tensors.tokens(networks.config.n_behaviours)?;
    let rows = Batch::new(&batch.rows, &tokens);
    let mut means = vec![0.0; 2 * batch.batch];
    networks.actor(backend)?.infer(rows, &mut means);
    let mut values = vec![0.0; batch.batch];
    networks.critic(backend)?.infer(rows, &mut values);
    compare(tensors, "mean", &means, verdict)?;
    compare(tensors, "value", &values, verdict)?;
    check_gaussian(tensors, &means, networks.log_std()?, verdict)?;
    for (name, parameters) in [("actor", &networks.actor), ("critic", &networks.critic)] {
        let wanted = |feature: &str| tensors.has(&format!("intermediate.{name}.{feature}"));
        if wanted("laser_feature") || wanted("hidden") {
            let mut probe = probe::Probe::new(&networks.config, backend, parameters)?;
            compare(tensors, &format!("intermediate.{name}.hidden"), &probe.hidden(rows)?, verdict)?;
            compare(
                tensors,
                &format!("intermediate.{name}.laser_feature"),
                &probe.laser_feature(rows)?,
                verdict,
            )?;
        }
    }
    Ok(())
}

/// Checks `log_prob` and `entropy` of the fixture's actions under the means.
pub(crate) fn check_gaussian(
    tensors: &Tensors,
    means: &[f32],
    log_std: [f32; 2],
    verdict: &mut Verdict,
) -> Result<()> {
    if tensors.has("log_prob") {
        let log_probs = log_probs(tensors, means, log_std)?;
        compare(tensors, "log_prob", &log_probs, verdict)?;
    }
    if tensors.has("entropy") {
        compare(
            tensors,
            "entropy",
            &[DiagonalGaussian { mean: [0.0; 2], log_std }.entropy() as f32],
            verdict,
        )?;
    }
    Ok(())
}

/// Compares an output with the tensor of that name, if the fixture holds it.
pub(crate) fn compare(tensors: &Tensors, name: &str, actual: &[f32], verdict: &mut Verdict) -> Result<()> {
    if tensors.has(name) {
        let expected = tensors.f32(name)?;
        verdict.all_close(wide(actual), wide(expected), SINGLE, name);
    }
    Ok(())
}

/// The values in double precision.
pub(crate) fn wide(values: &[f32]) -> impl ExactSizeIterator<Item = f64> {
    values.iter().map(|&value| f64::from(value))
}

/// Log-probabilities of the fixture's actions under the means [B, 2].
pub(crate) fn log_probs(tensors: &Tensors, means: &[f32], log_std: [f32; 2]) -> Result<Vec<f32>> {
    let actions = tensors.pairs("action", means.len() / 2)?;
    Ok(actions
        .iter()
        .zip(means.as_chunks().0)
        .map(|(&action, &mean)| DiagonalGaussian { mean, log_std }.log_prob(action) as f32)
        .collect())
}
