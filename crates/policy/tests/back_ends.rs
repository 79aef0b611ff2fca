//! Every back end against the plain `f64` oracle, and the properties that every back end has.
//!
//! A back end is added to `BACKENDS`; all tests then hold it, too.

use crate::common::oracle::{Head, Oracle};
use crate::common::{largest_deviation, noise, observations, parameters, small, tokens};
use jostle_policy::{Backend, Batch, Network, NetworkConfig, Parameters, actor, critic};

const BACKENDS: [Backend; 2] = [Backend::Reference, Backend::Fast];
const HEADS: [Head; 2] = [Head::Actor, Head::Critic];

fn network(
    config: &NetworkConfig,
    head: Head,
    backend: Backend,
    parameters: &Parameters,
) -> Box<dyn Network> {
    match head {
        Head::Actor => actor(config, backend, parameters),
        Head::Critic => critic(config, backend, parameters),
    }
    .unwrap()
}

/// Runs `test` for every back end and head, with a network of the formula's parameters.
fn for_all(config: &NetworkConfig, test: impl Fn(Head, Backend, &Parameters, Box<dyn Network>)) {
    for (backend, head) in BACKENDS.into_iter().flat_map(|backend| HEADS.map(|head| (backend, head))) {
        let parameters = parameters(head.layout(config), 3);
        test(head, backend, &parameters, network(config, head, backend, &parameters));
    }
}

fn infer(network: &mut dyn Network, batch: Batch<'_>) -> Vec<f32> {
    let mut outputs = vec![f32::NAN; batch.len() * network.n_outputs()];
    network.infer(batch, &mut outputs);
    outputs
}

#[test]
fn outputs_are_those_of_the_oracle() {
    for n_behaviours in [1, 5] {
        let config = NetworkConfig { n_behaviours, ..NetworkConfig::default() };
        for_all(&config, |head, backend, parameters, mut network| {
            let (xs, zs) = (observations(&config, 6, 1), tokens(&config, 6));
            let expected = Oracle::new(&config, head, parameters).forward_all(&xs, &zs);
            let batch = Batch::new(&xs, &zs);
            let mut outputs = vec![0.0; expected.len()];
            network.forward(batch, &mut outputs);
            let scale = expected.iter().fold(1.0_f64, |scale, value| scale.max(value.abs()));
            let deviation = largest_deviation(&outputs, &expected);
            assert!(deviation < 1e-5 * scale, "{backend:?} {head:?} M = {n_behaviours}: {deviation:e}");
            assert_eq!(
                infer(&mut *network, batch),
                outputs,
                "{backend:?} {head:?}: infer and forward differ"
            );
        });
    }
}

#[test]
fn gradients_are_those_of_the_oracle() {
    for config in [small(), NetworkConfig::default()] {
        for_all(&config, |head, backend, parameters, mut network| {
            let n_rows = 4;
            let (xs, zs) = (observations(&config, n_rows, 2), tokens(&config, n_rows));
            let n_outputs = head.n_outputs();
            let d: Vec<f32> = (0..n_rows * n_outputs).map(|idx| noise(9, idx as u64) as f32).collect();
            let mut outputs = vec![0.0; d.len()];
            network.forward(Batch::new(&xs, &zs), &mut outputs);
            network.backward(&d);
            let native = network.parameters_and_gradient().1.to_vec();
            let gradient = network.to_canonical(&native);

            let d: Vec<f64> = d.iter().map(|value| f64::from(*value)).collect();
            let expected = Oracle::new(&config, head, parameters).backward_all(&xs, &zs, &d);
            for entry in network.layout().entries() {
                let (found, expected) = (&gradient[entry.range()], &expected[entry.range()]);
                let largest = expected.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
                let deviation = largest_deviation(found, expected);
                assert!(
                    deviation <= 1e-7 + 1e-4 * largest,
                    "{backend:?} {head:?} {}: {deviation:e} of {largest:e}",
                    entry.name
                );
                assert!(
                    entry.name == "log_std" || largest > 0.0,
                    "{}: the test sees no gradient",
                    entry.name
                );
            }
        });
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let config = NetworkConfig::default();
    for_all(&config, |head, backend, parameters, _| {
        // More rows than a chunk of any back end, and no multiple of one.
        let n_rows = 67;
        let (xs, zs) = (observations(&config, n_rows, 2), tokens(&config, n_rows));
        let d: Vec<f32> = (0..n_rows * head.n_outputs()).map(|idx| noise(9, idx as u64) as f32).collect();
        let run = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| {
                let mut network = network(&config, head, backend, parameters);
                let mut outputs = vec![0.0; d.len()];
                network.forward(Batch::new(&xs, &zs), &mut outputs);
                network.backward(&d);
                (outputs, network.parameters_and_gradient().1.to_vec())
            })
        };
        assert!(run(1) == run(2), "{backend:?} {head:?}: 1 and 2 threads differ");
        assert!(run(2) == run(3), "{backend:?} {head:?}: 2 and 3 threads differ");
    });
}

#[test]
fn backward_leaves_log_std_to_the_caller_and_overwrites_the_rest() {
    let config = small();
    for backend in BACKENDS {
        let parameters = parameters(Head::Actor.layout(&config), 3);
        let mut network = actor(&config, backend, &parameters).unwrap();
        let (xs, zs) = (observations(&config, 2, 2), tokens(&config, 2));
        let mut run = |fill: f32| {
            network.parameters_and_gradient().1.fill(fill);
            network.forward(Batch::new(&xs, &zs), &mut [0.0; 4]);
            network.backward(&[1.0, -1.0, 0.5, 2.0]);
            let native = network.parameters_and_gradient().1.to_vec();
            network.to_canonical(&native)
        };
        let (zeros, sevens) = (run(0.0), run(7.0));
        let n_others = zeros.len() - 2;
        assert_eq!(zeros[..n_others], sevens[..n_others]);
        assert_eq!(sevens[n_others..], [7.0, 7.0]);
    }
}

#[test]
fn a_row_depends_on_no_other_row() {
    let config = NetworkConfig::default();
    for_all(&config, |head, backend, _, mut network| {
        let (xs, zs) = (observations(&config, 5, 4), tokens(&config, 5));
        let before = infer(&mut *network, Batch::new(&xs, &zs));
        let mut changed = xs.clone();
        changed[config.observation_len()..].fill(0.25);
        let after = infer(&mut *network, Batch::new(&changed, &zs));
        let n_outputs = head.n_outputs();
        assert_eq!(before[..n_outputs], after[..n_outputs], "{backend:?} {head:?}");
        assert_ne!(before[n_outputs..], after[n_outputs..], "{backend:?} {head:?}: the change is seen");
    });
}

#[test]
fn rows_pick_permute_and_repeat() {
    let config = NetworkConfig::default();
    for_all(&config, |head, backend, _, mut network| {
        let (xs, zs) = (observations(&config, 5, 4), tokens(&config, 5));
        let all = infer(&mut *network, Batch::new(&xs, &zs));
        let rows = [4, 0, 0, 2, 3];
        let picked = infer(&mut *network, Batch::subset(&xs, &zs, &rows));
        for (outputs, row) in picked.chunks(head.n_outputs()).zip(rows) {
            let expected = &all[row as usize * head.n_outputs()..][..head.n_outputs()];
            let expected: Vec<f64> = expected.iter().map(|value| f64::from(*value)).collect();
            let deviation = largest_deviation(outputs, &expected);
            assert!(deviation < 1e-6, "{backend:?} {head:?} row {row}: {deviation:e}");
        }
    });
}

#[test]
fn the_token_is_read() {
    let config = NetworkConfig::default();
    for_all(&config, |head, backend, _, mut network| {
        let xs = observations(&config, 1, 4);
        let outputs: Vec<Vec<f32>> = (0..5).map(|z| infer(&mut *network, Batch::new(&xs, &[z]))).collect();
        for z in 1..5 {
            assert_ne!(outputs[0], outputs[z], "{backend:?} {head:?}");
        }
    });
}

#[test]
fn changed_parameters_are_used() {
    let config = small();
    for_all(&config, |head, backend, _, mut network| {
        let (xs, zs) = (observations(&config, 3, 4), tokens(&config, 3));
        let other = parameters(head.layout(&config), 8);
        let native = network.to_native(other.flat());
        network.parameters_and_gradient().0.copy_from_slice(&native);
        network.parameters_changed();
        let expected = Oracle::new(&config, head, &other).forward_all(&xs, &zs);
        let deviation = largest_deviation(&infer(&mut *network, Batch::new(&xs, &zs)), &expected);
        assert!(deviation < 1e-5, "{backend:?} {head:?}: {deviation:e}");
    });
}

#[test]
fn orders_are_permutations_of_each_other() {
    let config = small();
    for_all(&config, |_, backend, parameters, mut network| {
        let numbers: Vec<f32> = (0..network.layout().len()).map(|idx| idx as f32).collect();
        assert_eq!(network.to_canonical(&network.to_native(&numbers)), numbers, "{backend:?}");
        assert_eq!(network.to_native(&network.to_canonical(&numbers)), numbers, "{backend:?}");
        let native = network.parameters_and_gradient().0.to_vec();
        assert_eq!(network.to_canonical(&native), parameters.flat(), "{backend:?}");
    });
}

#[test]
fn an_empty_batch_infers_nothing() {
    for_all(&small(), |_, _, _, mut network| assert!(infer(&mut *network, Batch::new(&[], &[])).is_empty()));
}

#[test]
fn parameters_of_another_network_are_refused() {
    let config = NetworkConfig::default();
    for backend in BACKENDS {
        let check = |parameters: &Parameters, message: &str| {
            let error = actor(&config, backend, parameters).err().expect("refused").to_string();
            assert!(error.contains(message), "{backend:?}: {error}");
        };
        check(
            &parameters(Head::Critic.layout(&config), 1),
            "found value.weight [1, 128], expected mean_v.weight",
        );
        let seven = NetworkConfig { n_behaviours: 7, ..config.clone() };
        check(
            &parameters(Head::Actor.layout(&seven), 1),
            "embedding.weight [7, 32], expected embedding.weight [5, 32]",
        );
    }
}

#[test]
#[should_panic(expected = "tokens: found 3, expected less than 3")]
fn a_token_out_of_range_is_refused() {
    let config = small();
    let parameters = parameters(Head::Actor.layout(&config), 1);
    let mut network = actor(&config, Backend::Reference, &parameters).unwrap();
    infer(&mut *network, Batch::new(&observations(&config, 1, 1), &[3]));
}
