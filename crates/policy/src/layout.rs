//! The order of a network's parameters: names, shapes and offsets in one flat vector.
//!
//! The order here is *canonical*: files, optimiser states and comparisons use it. A back end may
//! keep its own order ([`Network::to_native`](crate::Network::to_native)). Names and shapes are
//! PyTorch's, so that a file can be read by a `torch.nn` module of the same shape. A `HashMap` of
//! variables, as candle's `VarMap` keeps, would put the parameters in another order in each run;
//! here the order is data.

use std::ops::Range;

use crate::config::{CONV_CHANNELS, CONV1_KERNEL, CONV2_KERNEL, NetworkConfig};

/// The values of a tensor before training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Init {
    /// Uniform in ±1/√`fan_in`: PyTorch's default for the weights and biases of linear layers and
    /// convolutions.
    Uniform {
        /// Inputs of one output.
        fan_in: usize,
    },
    /// As [`Self::Uniform`], with the last columns, which the behaviour tokens switch on, times a
    /// factor.
    UniformWithTokens {
        /// Inputs of one output, the tokens among them.
        fan_in: usize,
        /// How many of them are tokens: the last ones.
        tokens: usize,
        /// The factor on their weights.
        factor: f32,
    },
    /// Normal with mean 0; a standard deviation of 1 is PyTorch's default for embeddings.
    Normal {
        /// Standard deviation.
        std: f32,
    },
    /// One value everywhere.
    Constant(f32),
}

/// One tensor of a layout.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name without the network's prefix, such as `conv1.weight`.
    pub name: String,
    /// PyTorch's shape.
    pub shape: Vec<usize>,
    /// Index of the first value in the flat vector.
    pub offset: usize,
    /// The values before training.
    pub init: Init,
}

impl Entry {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// `true` if there is no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The indices of the values in the flat vector.
    pub fn range(&self) -> Range<usize> {
        self.offset..self.offset + self.len()
    }
}

/// An ordered list of named tensors, one behind the other in a flat vector.
///
/// # Examples
///
/// ```
/// use jostle_policy::{Layout, NetworkConfig};
/// let layout = Layout::actor(&NetworkConfig::default());
/// assert_eq!(layout.len(), 1_090_372);
/// assert_eq!(layout.entries()[0].name, "conv1.weight");
/// assert_eq!(layout.range("log_std"), Some(1_090_370..1_090_372));
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Layout {
    entries: Vec<Entry>,
    len: usize,
}

impl Layout {
    /// An empty layout, to be filled by [`push`](Self::push) and
    /// [`push_linear`](Self::push_linear).
    pub fn new() -> Self {
        Self::default()
    }

    /// The actor: trunk, one head for the mean of each action dimension, and the free log standard
    /// deviation.
    pub fn actor(config: &NetworkConfig) -> Self {
        let mut layout = Self::trunk(config);
        layout.push_linear("mean_v", config.hidden, 1);
        layout.push_linear("mean_w", config.hidden, 1);
        layout.push("log_std", &[2], Init::Constant(config.log_std_init));
        layout
    }

    /// The critic: a trunk of its own and the value head.
    pub fn critic(config: &NetworkConfig) -> Self {
        let mut layout = Self::trunk(config);
        layout.push_linear("value", config.hidden, 1);
        layout
    }

    /// The part that actor and critic have in common, up to the last hidden layer.
    fn trunk(config: &NetworkConfig) -> Self {
        let mut layout = Self::new();
        if config.motion.is_some() {
            // The token enters as one of M ones behind the inputs.
            let (tokens, factor) = (config.n_behaviours, config.embedding_std);
            let fan_in = config.input_len() + tokens;
            let init = Init::UniformWithTokens { fan_in, tokens, factor };
            layout.push("fc1.weight", &[config.laser_feature, fan_in], init);
            layout.push("fc1.bias", &[config.laser_feature], Init::Uniform { fan_in });
            layout.push_linear("fc2", config.laser_feature, config.hidden);
            return layout;
        }
        layout.push_conv("conv1", config.frames, CONV_CHANNELS, CONV1_KERNEL);
        layout.push_conv("conv2", CONV_CHANNELS, CONV_CHANNELS, CONV2_KERNEL);
        layout.push_linear("fc1", config.flat_len(), config.laser_feature);
        let init = Init::Normal { std: config.embedding_std };
        layout.push("embedding.weight", &[config.n_behaviours, config.embedding], init);
        layout.push_linear("fc2", config.concat_len(), config.hidden);
        layout
    }

    /// Appends one tensor.
    ///
    /// # Panics
    ///
    /// If the name is taken.
    pub fn push(&mut self, name: &str, shape: &[usize], init: Init) {
        assert!(self.entry(name).is_none(), "the layout holds {name} already");
        let entry = Entry { name: name.to_owned(), shape: shape.to_vec(), offset: self.len, init };
        self.len += entry.len();
        self.entries.push(entry);
    }

    /// Appends `name.weight` `[outputs, inputs]` and `name.bias` `[outputs]`.
    pub fn push_linear(&mut self, name: &str, inputs: usize, outputs: usize) {
        let init = Init::Uniform { fan_in: inputs };
        self.push(&format!("{name}.weight"), &[outputs, inputs], init);
        self.push(&format!("{name}.bias"), &[outputs], init);
    }

    /// Appends `name.weight` `[outputs, inputs, kernel]` and `name.bias` `[outputs]`.
    fn push_conv(&mut self, name: &str, inputs: usize, outputs: usize, kernel: usize) {
        let init = Init::Uniform { fan_in: inputs * kernel };
        self.push(&format!("{name}.weight"), &[outputs, inputs, kernel], init);
        self.push(&format!("{name}.bias"), &[outputs], init);
    }

    /// The tensors in their order.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The tensor of that name.
    pub fn entry(&self, name: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.name == name)
    }

    /// The indices of the tensor of that name in the flat vector.
    pub fn range(&self, name: &str) -> Option<Range<usize>> {
        self.entry(name).map(Entry::range)
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.len
    }

    /// `true` if there is no parameter.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameter_counts_are_those_of_the_paper() {
        let config = NetworkConfig::default();
        assert_eq!(Layout::actor(&config).len(), 1_090_372);
        assert_eq!(Layout::critic(&config).len(), 1_090_241);
    }

    #[test]
    fn entries_lie_one_behind_the_other() {
        let layout = Layout::actor(&NetworkConfig::default());
        let mut end = 0;
        for entry in layout.entries() {
            assert_eq!(entry.offset, end, "{}", entry.name);
            end = entry.range().end;
        }
        assert_eq!(end, layout.len());
        assert_eq!(layout.entry("fc1.weight").unwrap().shape, [256, 4096]);
        assert_eq!(layout.entry("fc2.weight").unwrap().shape, [128, 292]);
    }

    #[test]
    #[should_panic(expected = "holds fc already")]
    fn a_name_is_given_once() {
        let mut layout = Layout::new();
        layout.push("fc", &[1], Init::Constant(0.0));
        layout.push("fc", &[2], Init::Constant(0.0));
    }
}
