//! Reads a network's inner features from outside.
//!
//! A critic's output is `value.weight · hidden + value.bias`; with a unit vector for the weight and
//! no bias it *is* one entry of the hidden feature. In the same way rows of the last hidden layer
//! that are unit vectors hand a laser feature through, which is not negative, so the ReLU between
//! leaves it alone. Actor and critic have trunks of the same shape: the actor's trunk is read
//! through a critic's head.

use anyhow::{Context as _, Result};
use jostle_policy::{Backend, Batch, Layout, Network, NetworkConfig, Parameters, critic};

/// A trunk with a head that selects.
pub(crate) struct Probe {
    network: Box<dyn Network>,
    /// Place of each canonical entry in the back end's order.
    native: Vec<usize>,
    layout: Layout,
    config: NetworkConfig,
}

impl Probe {
    /// Puts a critic's head, all zero, on the trunk of `source`.
    pub(crate) fn new(config: &NetworkConfig, backend: Backend, source: &Parameters) -> Result<Self> {
        let layout = Layout::critic(config);
        let mut flat = vec![0.0; layout.len()];
        for entry in layout.entries().iter().filter(|entry| !entry.name.starts_with("value.")) {
            flat[entry.range()].copy_from_slice(source.get(&entry.name).context("a trunk of another shape")?);
        }
        let network = critic(config, backend, &Parameters::from_flat(layout.clone(), flat)?)?;
        // Indices below 2²⁴ are exact in f32, so the permutation can be read off an index vector.
        let indices: Vec<f32> = (0..layout.len()).map(|index| index as f32).collect();
        let mut native = vec![0; layout.len()];
        for (position, &canonical) in network.to_native(&indices).iter().enumerate() {
            native[canonical as usize] = position;
        }
        Ok(Self { network, native, layout, config: config.clone() })
    }

    /// The hidden feature after its ReLU: [B, hidden].
    pub(crate) fn hidden(&mut self, batch: Batch<'_>) -> Result<Vec<f32>> {
        let width = self.config.hidden;
        let mut features = vec![0.0; batch.len() * width];
        for index in 0..width {
            self.read_entry(batch, index, &mut features, index, width)?;
        }
        Ok(features)
    }

    /// The laser feature after its ReLU: [B, `laser_feature`]. Replaces the last hidden layer.
    pub(crate) fn laser_feature(&mut self, batch: Batch<'_>) -> Result<Vec<f32>> {
        let (width, hidden) = (self.config.laser_feature, self.config.hidden);
        let mut features = vec![0.0; batch.len() * width];
        let weight = self.layout.range("fc2.weight").context("no fc2")?;
        let bias = self.layout.range("fc2.bias").context("no fc2")?;
        self.set(weight.clone().chain(bias), 0.0);
        for start in (0..width).step_by(hidden) {
            for (row, index) in (start..width.min(start + hidden)).enumerate() {
                let entry = weight.start + row * self.config.concat_len() + index;
                self.set([entry], 1.0);
                self.read_entry(batch, row, &mut features, index, width)?;
                self.set([entry], 0.0);
            }
        }
        Ok(features)
    }

    /// Writes hidden entry `index` of each row to column `column` of `features`.
    fn read_entry(
        &mut self,
        batch: Batch<'_>,
        index: usize,
        features: &mut [f32],
        column: usize,
        width: usize,
    ) -> Result<()> {
        let head = self.layout.range("value.weight").context("no head")?.start + index;
        self.set([head], 1.0);
        let mut values = vec![0.0; batch.len()];
        self.network.infer(batch, &mut values);
        self.set([head], 0.0);
        for (row, value) in values.into_iter().enumerate() {
            features[row * width + column] = value;
        }
        Ok(())
    }

    fn set(&mut self, entries: impl IntoIterator<Item = usize>, value: f32) {
        let (parameters, _) = self.network.parameters_and_gradient();
        for entry in entries {
            parameters[self.native[entry]] = value;
        }
        self.network.parameters_changed();
    }
}
