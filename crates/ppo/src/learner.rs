//! A network with its optimiser: what each of the four learners is made of.

use jostle_policy::{Batch, Layout, Network};

use crate::PpoError;
use crate::adam::{Adam, clip_norm};

/// A network, the Adam that steps it, and where its `log_std` stands (the actor's alone).
pub(crate) struct Learner {
    pub(crate) network: Box<dyn Network>,
    pub(crate) adam: Adam,
    name: &'static str,
    /// Places of `log_std` in the network's own order of parameters.
    log_std: Vec<usize>,
}

impl Learner {
    pub(crate) fn new(name: &'static str, network: Box<dyn Network>, learning_rate: f64) -> Self {
        let n = network.layout().len();
        let log_std = native_places(&*network, "log_std");
        Self { network, adam: Adam::new(n, learning_rate), name, log_std }
    }

    /// The network's name in checkpoints and errors.
    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    pub(crate) fn layout(&self) -> &Layout {
        self.network.layout()
    }

    /// Parameters in canonical order.
    pub(crate) fn parameters(&mut self) -> Vec<f32> {
        let native = self.network.parameters_and_gradient().0.to_vec();
        self.network.to_canonical(&native)
    }

    /// Log standard deviations of the actor.
    pub(crate) fn log_std(&mut self) -> [f32; 2] {
        let parameters = self.network.parameters_and_gradient().0;
        [parameters[self.log_std[0]], parameters[self.log_std[1]]]
    }

    /// As [`Network::forward`]; an empty batch is one, too.
    pub(crate) fn forward(&mut self, batch: Batch<'_>, outputs: &mut [f32]) {
        if !batch.is_empty() {
            self.network.forward(batch, outputs);
        }
    }

    /// As [`Network::backward`]; the gradient of an empty batch is 0.
    pub(crate) fn backward(&mut self, d_outputs: &[f32]) {
        if d_outputs.is_empty() {
            self.gradient().fill(0.0);
        } else {
            self.network.backward(d_outputs);
        }
    }

    /// The gradient that `backward` left, in the network's own order.
    pub(crate) fn gradient(&mut self) -> &mut [f32] {
        self.network.parameters_and_gradient().1
    }

    /// Writes the gradient of `log_std`, which the network leaves to the loss.
    pub(crate) fn set_log_std_gradient(&mut self, gradient: [f64; 2]) {
        let places = &self.log_std;
        let all = self.network.parameters_and_gradient().1;
        places.iter().zip(gradient).for_each(|(&place, g)| all[place] = g as f32);
    }

    /// One step of Adam down the gradient that `backward` left.
    pub(crate) fn step(&mut self, max_grad_norm: f64) {
        let (parameters, gradient) = self.network.parameters_and_gradient();
        if max_grad_norm > 0.0 {
            clip_norm(gradient, max_grad_norm);
        }
        self.adam.step(parameters, gradient);
        self.network.parameters_changed();
    }

    /// Refuses parameters that are not finite, naming the tensor.
    pub(crate) fn check_finite(&mut self, update: u64) -> Result<(), PpoError> {
        if self.network.parameters_and_gradient().0.iter().all(|x| x.is_finite()) {
            return Ok(());
        }
        let parameters = self.parameters();
        let broken = |range: std::ops::Range<usize>| parameters[range].iter().any(|x| !x.is_finite());
        let entry = self.layout().entries().iter().find(|entry| broken(entry.range()));
        let tensor = format!("{}.{}", self.name, entry.map_or("parameters", |entry| &entry.name));
        Err(PpoError::NotFinite { update, tensor, agent: None })
    }
}

/// Places of a tensor's values in the network's own order: marks sent through the permutation.
fn native_places(network: &dyn Network, tensor: &str) -> Vec<usize> {
    let Some(range) = network.layout().range(tensor) else { return Vec::new() };
    let place_of = |canonical: usize| {
        let mut marks = vec![0.0; network.layout().len()];
        marks[canonical] = 1.0;
        network.to_native(&marks).iter().position(|&mark| mark == 1.0).expect("a permutation keeps the mark")
    };
    range.map(place_of).collect()
}
