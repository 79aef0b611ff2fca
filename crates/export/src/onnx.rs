//! A policy's network as an ONNX model (opset 17), for onnxruntime and its like.
//!
//! | | name | type | what |
//! |---|---|---|---|
//! | in | `observation` | float32 `[B, row]` | observation rows as everywhere: scans oldest first, goal, velocity (docs/concepts.md) |
//! | in | `token` | int64 `[B]` | behaviour tokens; not there where one was baked in |
//! | out | `action` | float32 `[B, 2]` | the policy's mean: v (m/s), ω (rad/s), to be clipped to the robot's limits |
//!
//! A policy that reads motions (`network.inputs = "motion"`) has an encoder before its network that
//! matches bodies between scans. ONNX has no operators for that, so the model then takes `inputs`,
//! float32 `[B, n]`: what the encoder makes of each observation row ([`jostle_policy::encoder`];
//! `jostle.Policy.encode` in Python).
//!
//! The metadata hold the policy's provenance, its limits, and the beams of its laser.

mod proto;

use jostle_policy::observation::TAIL_LEN;
use jostle_policy::{NetworkConfig, PolicyFile};
use prost::Message as _;

use crate::ExportError;
use proto::{
    Attribute, Dimension, FLOAT, Graph, INT64, Model, Node, OperatorSet, Shape, Size, StringEntry, Tensor,
    TensorType, Type, ValueInfo,
};

/// Version of ONNX's operators; every runtime since 2022 has it.
pub const OPSET: i64 = 17;
/// Version of the file format that goes with it.
const IR_VERSION: i64 = 8;

/// The bytes of a model file. With a `token` the behaviour is baked in, without one the model has
/// an input for it.
///
/// # Errors
///
/// [`ExportError::Token`] for a behaviour that the policy does not have.
pub fn model(policy: &PolicyFile, token: Option<u32>) -> Result<Vec<u8>, ExportError> {
    let n_behaviours = policy.network.n_behaviours;
    if let Some(found) = token.filter(|token| *token as usize >= n_behaviours) {
        return Err(ExportError::Token { found, n_behaviours });
    }
    let mut builder = Builder::default();
    let hidden = if policy.network.motion.is_some() {
        builder.perceptron(policy, token)
    } else {
        builder.convolutions(policy, token)
    };
    let v = builder.linear(policy, &hidden, "mean_v");
    let v = builder.node("Sigmoid", &[&v], vec![]);
    let w = builder.linear(policy, &hidden, "mean_w");
    let w = builder.node("Tanh", &[&w], vec![]);
    builder.named("action", "Concat", &[&v, &w], vec![Attribute::int("axis", 1)]);
    let graph = Graph {
        node: builder.nodes,
        name: "policy".to_owned(),
        initializer: builder.constants,
        input: inputs(&policy.network, token.is_none()),
        output: vec![value("action", FLOAT, &[2], "mean of v (m/s) and ω (rad/s)")],
    };
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: "jostle".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        doc_string: "A local motion planner for a robot with a 2D laser among people.".to_owned(),
        graph: Some(graph),
        opset_import: vec![OperatorSet { domain: String::new(), version: OPSET }],
        metadata_props: metadata(policy, token),
    };
    Ok(model.encode_to_vec())
}

fn inputs(network: &NetworkConfig, has_token: bool) -> Vec<ValueInfo> {
    let (name, what) = if network.motion.is_some() {
        ("inputs", "what the motion encoder makes of each observation row")
    } else {
        (
            "observation",
            "scans oldest first (range/10 - 1/2), goal in the robot's frame (m), v (m/s), w (rad/s)",
        )
    };
    let width = if network.motion.is_some() { network.input_len() } else { network.observation_len() };
    let mut inputs = vec![value(name, FLOAT, &[width], what)];
    if has_token {
        let what = format!("behaviour tokens, 0 to {}", network.n_behaviours - 1);
        inputs.push(value("token", INT64, &[], &what));
    }
    inputs
}

/// An input or output of B rows of these sizes.
fn value(name: &str, elem_type: i32, sizes: &[usize], what: &str) -> ValueInfo {
    let rows = Size::Named("B".to_owned());
    let sizes = [rows].into_iter().chain(sizes.iter().map(|size| Size::Fixed(*size as i64)));
    let dim = sizes.map(|size| Dimension { size: Some(size) }).collect();
    let tensor_type = TensorType { elem_type, shape: Some(Shape { dim }) };
    let doc_string = what.to_owned();
    ValueInfo { name: name.to_owned(), r#type: Some(Type { tensor_type: Some(tensor_type) }), doc_string }
}

fn metadata(policy: &PolicyFile, token: Option<u32>) -> Vec<StringEntry> {
    let provenance = &policy.provenance;
    let mut lines = vec![
        ("jostle.config_hash", provenance.config_hash.clone()),
        ("jostle.seed", provenance.seed.to_string()),
        ("jostle.commit", provenance.commit.clone()),
        ("jostle.updates", provenance.update.to_string()),
        ("jostle.beams", policy.network.beams.to_string()),
        ("jostle.frames", policy.network.frames.to_string()),
        ("jostle.n_behaviours", policy.network.n_behaviours.to_string()),
    ];
    lines.extend(token.map(|token| ("jostle.token", token.to_string())));
    lines.extend(policy.metadata.get("sim").map(|sim| ("jostle.sim", sim.clone())));
    lines.into_iter().map(|(key, value)| StringEntry { key: key.to_owned(), value }).collect()
}

/// A graph that grows node by node. What a node makes is named after it.
#[derive(Default)]
struct Builder {
    nodes: Vec<Node>,
    constants: Vec<Tensor>,
}

impl Builder {
    /// Appends an operator; answers the name of what it makes.
    fn node(&mut self, op_type: &str, input: &[&str], attribute: Vec<Attribute>) -> String {
        let name = format!("{}_{}", op_type.to_lowercase(), self.nodes.len());
        self.named(&name, op_type, input, attribute);
        name
    }

    /// Appends an operator that makes a value of this name.
    fn named(&mut self, name: &str, op_type: &str, input: &[&str], attribute: Vec<Attribute>) {
        self.nodes.push(Node {
            input: input.iter().map(|&name| name.to_owned()).collect(),
            output: vec![name.to_owned()],
            name: name.to_owned(),
            op_type: op_type.to_owned(),
            attribute,
        });
    }

    /// A tensor of the policy under its own name.
    fn weight(&mut self, policy: &PolicyFile, name: &str) -> String {
        let values = policy.actor.get(name).expect("a tensor of the layout");
        let entry = policy.actor.layout().entries().iter().find(|entry| entry.name == name);
        let dims = entry.expect("as above").shape.iter().map(|&size| size as i64).collect();
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constants.push(Tensor { dims, data_type: FLOAT, name: name.to_owned(), raw_data });
        name.to_owned()
    }

    /// A constant list of integers.
    fn integers(&mut self, name: &str, values: &[i64]) -> String {
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let dims = vec![values.len() as i64];
        self.constants.push(Tensor { dims, data_type: INT64, name: name.to_owned(), raw_data });
        name.to_owned()
    }

    /// x Wᵀ + b.
    fn linear(&mut self, policy: &PolicyFile, x: &str, layer: &str) -> String {
        let weight = self.weight(policy, &format!("{layer}.weight"));
        let bias = self.weight(policy, &format!("{layer}.bias"));
        self.node("Gemm", &[x, &weight, &bias], vec![Attribute::int("transB", 1)])
    }

    fn linear_relu(&mut self, policy: &PolicyFile, x: &str, layer: &str) -> String {
        let y = self.linear(policy, x, layer);
        self.node("Relu", &[&y], vec![])
    }

    fn conv_relu(&mut self, policy: &PolicyFile, x: &str, layer: &str) -> String {
        let weight = self.weight(policy, &format!("{layer}.weight"));
        let bias = self.weight(policy, &format!("{layer}.bias"));
        let settings = vec![Attribute::ints("strides", &[2]), Attribute::ints("pads", &[1, 1])];
        let y = self.node("Conv", &[x, &weight, &bias], settings);
        self.node("Relu", &[&y], vec![])
    }

    /// Columns `from` to `end` of the rows `x`.
    fn columns(&mut self, x: &str, what: &str, from: usize, end: usize) -> String {
        let from = self.integers(&format!("{what}_from"), &[from as i64]);
        let end = self.integers(&format!("{what}_end"), &[end as i64]);
        let axis = self.integers(&format!("{what}_axis"), &[1]);
        self.node("Slice", &[x, &from, &end, &axis], vec![])
    }

    /// Rows of `table`, one for each input row: those of the tokens, or of the one that is baked
    /// in.
    fn of_token(&mut self, table: &str, rows: &str, token: Option<u32>) -> String {
        let Some(token) = token else { return self.node("Gather", &[table, "token"], vec![]) };
        let baked = self.integers("baked_token", &[i64::from(token)]);
        let row = self.node("Gather", &[table, &baked], vec![]);
        // [1, n] for each of B rows.
        let shape = self.node("Shape", &[rows], vec![Attribute::int("start", 0), Attribute::int("end", 1)]);
        let one = self.integers("one", &[1]);
        let target = self.node("Concat", &[&shape, &one], vec![Attribute::int("axis", 0)]);
        self.node("Expand", &[&row, &target], vec![])
    }

    /// The paper's trunk, up to the last hidden layer.
    fn convolutions(&mut self, policy: &PolicyFile, token: Option<u32>) -> String {
        let network = &policy.network;
        let n_scans = network.frames * network.beams;
        let scans = self.columns("observation", "scans", 0, n_scans);
        let tail = self.columns("observation", "tail", n_scans, n_scans + TAIL_LEN);
        let shape = self.integers("laser_shape", &[-1, network.frames as i64, network.beams as i64]);
        let mut laser = self.node("Reshape", &[&scans, &shape], vec![]);
        if network.scan_pool > 1 {
            // The nearest of each k neighbours: the largest of the negated.
            let k = network.scan_pool as i64;
            let negated = self.node("Neg", &[&laser], vec![]);
            let settings = vec![Attribute::ints("kernel_shape", &[k]), Attribute::ints("strides", &[k])];
            let pooled = self.node("MaxPool", &[&negated], settings);
            laser = self.node("Neg", &[&pooled], vec![]);
        }
        let x = self.conv_relu(policy, &laser, "conv1");
        let x = self.conv_relu(policy, &x, "conv2");
        let flat = self.node("Flatten", &[&x], vec![Attribute::int("axis", 1)]);
        let feature = self.linear_relu(policy, &flat, "fc1");
        let table = self.weight(policy, "embedding.weight");
        let embedding = self.of_token(&table, "observation", token);
        let joined = self.node("Concat", &[&feature, &tail, &embedding], vec![Attribute::int("axis", 1)]);
        self.linear_relu(policy, &joined, "fc2")
    }

    /// The perceptron over encoded rows, up to the last hidden layer.
    fn perceptron(&mut self, policy: &PolicyFile, token: Option<u32>) -> String {
        let m = policy.network.n_behaviours;
        let ones: Vec<f32> = (0..m * m).map(|i| f32::from(u8::from(i / m == i % m))).collect();
        let raw_data = ones.iter().flat_map(|value| value.to_le_bytes()).collect();
        let dims = vec![m as i64; 2];
        self.constants.push(Tensor { dims, data_type: FLOAT, name: "one_hot".to_owned(), raw_data });
        let token = self.of_token("one_hot", "inputs", token);
        let joined = self.node("Concat", &["inputs", &token], vec![Attribute::int("axis", 1)]);
        let feature = self.linear_relu(policy, &joined, "fc1");
        self.linear_relu(policy, &feature, "fc2")
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use jostle_policy::encoder::motion::MotionInputs;
    use jostle_policy::{Parameters, Provenance};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    fn policy(network: NetworkConfig) -> PolicyFile {
        let actor = Parameters::actor(&network, &mut ChaCha8Rng::seed_from_u64(3));
        let provenance = Provenance {
            config_hash: "hash".to_owned(),
            seed: 3,
            commit: "commit".to_owned(),
            update: 1,
            transitions: 2,
            n_agents: 5,
            n_rooms: 1,
        };
        PolicyFile { actor, network, provenance, metadata: BTreeMap::new() }
    }

    fn kinds() -> [NetworkConfig; 3] {
        let plain = NetworkConfig { beams: 64, ..NetworkConfig::default() };
        let motion = MotionInputs { dt: 0.1, v_max: 1.0, w_max: 1.0 };
        [
            NetworkConfig { scan_pool: 4, ..plain.clone() },
            NetworkConfig { motion: Some(motion), ..plain.clone() },
            plain,
        ]
    }

    #[test]
    fn whatever_is_read_was_made_before() {
        for network in kinds() {
            for token in [None, Some(2)] {
                let bytes = model(&policy(network.clone()), token).unwrap();
                let graph = Model::decode(&bytes[..]).unwrap().graph.unwrap();
                let names: Vec<&str> = graph.input.iter().map(|input| input.name.as_str()).collect();
                assert_eq!(names.contains(&"token"), token.is_none());
                let mut made: BTreeSet<&str> = names.into_iter().collect();
                for constant in &graph.initializer {
                    let n: i64 = constant.dims.iter().product();
                    let size = if constant.data_type == FLOAT { 4 } else { 8 };
                    assert_eq!(constant.raw_data.len() as i64, n * size, "{}", constant.name);
                    assert!(made.insert(&constant.name), "{} is there twice", constant.name);
                }
                for node in &graph.node {
                    let missing = node.input.iter().find(|name| !made.contains(name.as_str()));
                    assert_eq!(missing, None, "{}", node.name);
                    node.output.iter().for_each(|name| assert!(made.insert(name), "{name} is made twice"));
                }
                assert!(made.contains("action"));
            }
        }
    }

    #[test]
    fn every_tensor_of_the_actor_but_its_spread_is_there() {
        for network in kinds() {
            let policy = policy(network);
            let bytes = model(&policy, None).unwrap();
            let graph = Model::decode(&bytes[..]).unwrap().graph.unwrap();
            for entry in policy.actor.layout().entries().iter().filter(|entry| entry.name != "log_std") {
                let constant = graph.initializer.iter().find(|constant| constant.name == entry.name);
                let constant = constant.unwrap_or_else(|| panic!("no {}", entry.name));
                let shape: Vec<i64> = entry.shape.iter().map(|&size| size as i64).collect();
                assert_eq!(constant.dims, shape);
                let first = f32::from_le_bytes(constant.raw_data[..4].try_into().unwrap());
                assert_eq!(first, policy.actor.get(&entry.name).unwrap()[0]);
            }
        }
    }

    #[test]
    fn a_behaviour_that_is_not_there_is_refused() {
        let [_, _, plain] = kinds();
        let refusal = model(&policy(plain), Some(5)).unwrap_err();
        assert_eq!(refusal.to_string(), "token: found 5, expected 0 to 4 (the policy has 5 behaviours)");
    }
}
