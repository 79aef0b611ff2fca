//! The values of a network: one flat vector in the canonical order of its [`Layout`].

use std::sync::Arc;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal, Uniform};

use crate::config::NetworkConfig;
use crate::error::PolicyError;
use crate::layout::{Init, Layout};

/// Parameters in canonical order, independent of any back end.
///
/// # Examples
///
/// ```
/// use jostle_policy::{NetworkConfig, Parameters};
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// let mut rng = ChaCha8Rng::seed_from_u64(7);
/// let actor = Parameters::actor(&NetworkConfig::default(), &mut rng);
/// assert_eq!(actor.get("log_std"), Some(&[0.0, 0.0][..]));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    layout: Arc<Layout>,
    flat: Vec<f32>,
}

impl Parameters {
    /// Fresh parameters, drawn tensor by tensor in the layout's order from one host generator.
    ///
    /// Weights and biases are uniform in ±1/√`fan_in`, embeddings normal, `log_std` constant, each
    /// as [`Init`] says. Draws are made here and not by candle, whose CPU generator cannot be
    /// seeded.
    pub fn init(layout: impl Into<Arc<Layout>>, rng: &mut impl Rng) -> Self {
        let layout = layout.into();
        let mut flat = Vec::with_capacity(layout.len());
        for entry in layout.entries() {
            match entry.init {
                Init::Uniform { fan_in } => {
                    let uniform = uniform(fan_in);
                    flat.extend((0..entry.len()).map(|_| uniform.sample(rng)));
                }
                Init::UniformWithTokens { fan_in, tokens, factor } => {
                    let uniform = uniform(fan_in);
                    flat.extend((0..entry.len()).map(|idx| {
                        let is_token = idx % fan_in >= fan_in - tokens;
                        uniform.sample(rng) * if is_token { factor } else { 1.0 }
                    }));
                }
                Init::Normal { std } => {
                    let mut draw = || -> f32 { StandardNormal.sample(rng) };
                    flat.extend((0..entry.len()).map(|_| std * draw()));
                }
                Init::Constant(value) => flat.extend(std::iter::repeat_n(value, entry.len())),
            }
        }
        Self { layout, flat }
    }

    /// Fresh parameters of an actor.
    pub fn actor(config: &NetworkConfig, rng: &mut impl Rng) -> Self {
        Self::init(Layout::actor(config), rng)
    }

    /// Fresh parameters of a critic.
    pub fn critic(config: &NetworkConfig, rng: &mut impl Rng) -> Self {
        Self::init(Layout::critic(config), rng)
    }

    /// Parameters with the values given, in canonical order.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Parameters`] if the number of values is not the layout's.
    pub fn from_flat(layout: impl Into<Arc<Layout>>, flat: Vec<f32>) -> Result<Self, PolicyError> {
        let layout = layout.into();
        if flat.len() != layout.len() {
            return Err(PolicyError::Parameters {
                tensor: "all".to_owned(),
                found: format!("{} values", flat.len()),
                expected: format!("{} values", layout.len()),
            });
        }
        Ok(Self { layout, flat })
    }

    /// Refuses parameters of another layout: the first tensor that differs is named.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Parameters`] with both shapes.
    pub fn check_layout(&self, expected: &Layout) -> Result<(), PolicyError> {
        let describe = |layout: &Layout, idx: usize| {
            layout
                .entries()
                .get(idx)
                .map_or_else(|| "nothing".to_owned(), |entry| format!("{} {:?}", entry.name, entry.shape))
        };
        let n_entries = self.layout.entries().len().max(expected.entries().len());
        for idx in 0..n_entries {
            let (found, wanted) = (describe(&self.layout, idx), describe(expected, idx));
            if found != wanted {
                return Err(PolicyError::Parameters {
                    tensor: format!("tensor {idx}"),
                    found,
                    expected: wanted,
                });
            }
        }
        Ok(())
    }

    /// Names, shapes and offsets.
    pub fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    /// The values of the tensor of that name, row-major.
    pub fn get(&self, name: &str) -> Option<&[f32]> {
        self.layout.range(name).map(|range| &self.flat[range])
    }

    /// The values of the tensor of that name, to be changed.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut [f32]> {
        self.layout.range(name).map(|range| &mut self.flat[range])
    }

    /// All values in canonical order.
    pub fn flat(&self) -> &[f32] {
        &self.flat
    }

    /// All values in canonical order, to be changed.
    pub fn flat_mut(&mut self) -> &mut [f32] {
        &mut self.flat
    }

    /// The name of the first tensor that holds a value that is not finite, with that value.
    pub fn first_not_finite(&self) -> Option<(&str, f32)> {
        self.layout.entries().iter().find_map(|entry| {
            let value = self.flat[entry.range()].iter().copied().find(|value| !value.is_finite())?;
            Some((entry.name.as_str(), value))
        })
    }
}

/// Uniform in ±1/√`fan_in`.
fn uniform(fan_in: usize) -> Uniform<f32> {
    let bound = 1.0 / (fan_in as f32).sqrt();
    Uniform::new(-bound, bound).expect("a positive fan-in gives a finite bound")
}
