//! The networks once more: `f64`, one loop per index, no library, forward and backward written from
//! the definition.

use jostle_policy::{Layout, NetworkConfig, Parameters};

/// The head behind the trunk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Head {
    Actor,
    Critic,
}

impl Head {
    pub(crate) fn layout(self, config: &NetworkConfig) -> Layout {
        match self {
            Head::Actor => Layout::actor(config),
            Head::Critic => Layout::critic(config),
        }
    }

    pub(crate) fn n_outputs(self) -> usize {
        match self {
            Head::Actor => 2,
            Head::Critic => 1,
        }
    }
}

/// One network with `f64` weights.
pub(crate) struct Oracle {
    config: NetworkConfig,
    head: Head,
    layout: Layout,
    pub(crate) weights: Vec<f64>,
}

/// The values that the backward pass reads again.
struct Kept {
    laser: Vec<f64>,
    conv1: Vec<f64>,
    conv2: Vec<f64>,
    laser_feature: Vec<f64>,
    concat: Vec<f64>,
    hidden: Vec<f64>,
    outputs: Vec<f64>,
}

impl Oracle {
    pub(crate) fn new(config: &NetworkConfig, head: Head, parameters: &Parameters) -> Self {
        let weights = parameters.flat().iter().map(|value| f64::from(*value)).collect();
        Self { config: config.clone(), head, layout: head.layout(config), weights }
    }

    fn w(&self, name: &str) -> &[f64] {
        &self.weights[self.layout.range(name).unwrap()]
    }

    /// Outputs of one row.
    pub(crate) fn forward(&self, observation: &[f32], token: u32) -> Vec<f64> {
        self.keep(observation, token).outputs
    }

    /// Outputs of all rows.
    pub(crate) fn forward_all(&self, observations: &[f32], tokens: &[u32]) -> Vec<f64> {
        let rows = observations.chunks(self.config.observation_len());
        rows.zip(tokens).flat_map(|(row, token)| self.forward(row, *token)).collect()
    }

    /// Gradient of Σ outputs · `d_outputs` over all rows.
    pub(crate) fn backward_all(&self, observations: &[f32], tokens: &[u32], d_outputs: &[f64]) -> Vec<f64> {
        let mut gradient = vec![0.0; self.weights.len()];
        let rows = observations.chunks(self.config.observation_len());
        for ((row, token), d) in rows.zip(tokens).zip(d_outputs.chunks(self.head.n_outputs())) {
            self.backward(row, *token, d, &mut gradient);
        }
        gradient
    }

    fn keep(&self, observation: &[f32], token: u32) -> Kept {
        let config = &self.config;
        let values: Vec<f64> = observation.iter().map(|value| f64::from(*value)).collect();
        let scans = config.frames * config.beams;
        let laser = values[..scans].to_vec();
        let conv1 = relu(conv(&laser, config.frames, self.w("conv1.weight"), self.w("conv1.bias"), 5));
        let conv2 = relu(conv(&conv1, 32, self.w("conv2.weight"), self.w("conv2.bias"), 3));
        let laser_feature = relu(linear(&conv2, self.w("fc1.weight"), self.w("fc1.bias")));
        let row = token as usize * config.embedding;
        let embedding = &self.w("embedding.weight")[row..row + config.embedding];
        let concat = [&laser_feature, &values[scans..], embedding].concat();
        let hidden = relu(linear(&concat, self.w("fc2.weight"), self.w("fc2.bias")));
        let outputs = match self.head {
            Head::Critic => linear(&hidden, self.w("value.weight"), self.w("value.bias")),
            Head::Actor => {
                let v = linear(&hidden, self.w("mean_v.weight"), self.w("mean_v.bias"))[0];
                let w = linear(&hidden, self.w("mean_w.weight"), self.w("mean_w.bias"))[0];
                vec![1.0 / (1.0 + (-v).exp()), w.tanh()]
            }
        };
        Kept { laser, conv1, conv2, laser_feature, concat, hidden, outputs }
    }

    fn backward(&self, observation: &[f32], token: u32, d_outputs: &[f64], gradient: &mut [f64]) {
        let config = &self.config;
        let kept = self.keep(observation, token);
        let mut d_hidden = vec![0.0; config.hidden];
        let heads: Vec<(&str, f64)> = match self.head {
            Head::Critic => vec![("value", d_outputs[0])],
            Head::Actor => {
                let (v, w) = (kept.outputs[0], kept.outputs[1]);
                vec![("mean_v", d_outputs[0] * v * (1.0 - v)), ("mean_w", d_outputs[1] * (1.0 - w * w))]
            }
        };
        for (name, d) in heads {
            add(&mut d_hidden, &self.linear_back(name, &kept.hidden, &[d], gradient));
        }
        gate(&mut d_hidden, &kept.hidden);
        let d_concat = self.linear_back("fc2", &kept.concat, &d_hidden, gradient);

        let start = self.layout.range("embedding.weight").unwrap().start + token as usize * config.embedding;
        let d_embedding = &d_concat[config.laser_feature + 4..];
        add(&mut gradient[start..start + config.embedding], d_embedding);

        let mut d_feature = d_concat[..config.laser_feature].to_vec();
        gate(&mut d_feature, &kept.laser_feature);
        let mut d_conv2 = self.linear_back("fc1", &kept.conv2, &d_feature, gradient);
        gate(&mut d_conv2, &kept.conv2);
        let mut d_conv1 = self.conv_back("conv2", &kept.conv1, 32, &d_conv2, 3, gradient);
        gate(&mut d_conv1, &kept.conv1);
        self.conv_back("conv1", &kept.laser, config.frames, &d_conv1, 5, gradient);
    }

    fn linear_back(&self, name: &str, xs: &[f64], d: &[f64], gradient: &mut [f64]) -> Vec<f64> {
        let weight = self.w(&format!("{name}.weight"));
        let (at_w, at_b) = self.starts(name);
        let mut d_xs = vec![0.0; xs.len()];
        for (o, d) in d.iter().enumerate() {
            gradient[at_b + o] += d;
            for i in 0..xs.len() {
                gradient[at_w + o * xs.len() + i] += d * xs[i];
                d_xs[i] += d * weight[o * xs.len() + i];
            }
        }
        d_xs
    }

    fn conv_back(
        &self,
        name: &str,
        xs: &[f64],
        inputs: usize,
        d: &[f64],
        kernel: usize,
        gradient: &mut [f64],
    ) -> Vec<f64> {
        let weight = self.w(&format!("{name}.weight"));
        let (at_w, at_b) = self.starts(name);
        let (len, windows) = (xs.len() / inputs, d.len() / 32);
        let mut d_xs = vec![0.0; xs.len()];
        for o in 0..32 {
            for window in 0..windows {
                let d = d[o * windows + window];
                gradient[at_b + o] += d;
                for (i, k) in (0..inputs).flat_map(|i| (0..kernel).map(move |k| (i, k))) {
                    // The padding is one zero: position −1 is outside.
                    let Some(at) = (2 * window + k).checked_sub(1).filter(|at| *at < len) else { continue };
                    gradient[at_w + (o * inputs + i) * kernel + k] += d * xs[i * len + at];
                    d_xs[i * len + at] += d * weight[(o * inputs + i) * kernel + k];
                }
            }
        }
        d_xs
    }

    fn starts(&self, name: &str) -> (usize, usize) {
        let start = |part| self.layout.range(&format!("{name}.{part}")).unwrap().start;
        (start("weight"), start("bias"))
    }
}

/// Channel-major cross-correlation, stride 2, padding 1, 32 outputs.
fn conv(xs: &[f64], inputs: usize, weight: &[f64], bias: &[f64], kernel: usize) -> Vec<f64> {
    let len = xs.len() / inputs;
    let windows = (len + 2 - kernel) / 2 + 1;
    let mut ys = Vec::with_capacity(32 * windows);
    for o in 0..32 {
        for window in 0..windows {
            let mut sum = bias[o];
            for (i, k) in (0..inputs).flat_map(|i| (0..kernel).map(move |k| (i, k))) {
                if let Some(at) = (2 * window + k).checked_sub(1).filter(|at| *at < len) {
                    sum += xs[i * len + at] * weight[(o * inputs + i) * kernel + k];
                }
            }
            ys.push(sum);
        }
    }
    ys
}

fn linear(xs: &[f64], weight: &[f64], bias: &[f64]) -> Vec<f64> {
    let dot = |row: &[f64]| row.iter().zip(xs).map(|(w, x)| w * x).sum::<f64>();
    weight.chunks(xs.len()).zip(bias).map(|(row, b)| dot(row) + b).collect()
}

fn relu(xs: Vec<f64>) -> Vec<f64> {
    xs.into_iter().map(|x| x.max(0.0)).collect()
}

/// The gradient before a ReLU from that behind it.
fn gate(d: &mut [f64], ys: &[f64]) {
    for (d, y) in d.iter_mut().zip(ys) {
        if *y <= 0.0 {
            *d = 0.0;
        }
    }
}

fn add(sum: &mut [f64], more: &[f64]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}
