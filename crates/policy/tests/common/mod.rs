//! Shared by the tests: inputs from a formula, and a slow, plain `f64` oracle of the networks.

pub(crate) mod oracle;

use jostle_policy::{Layout, NetworkConfig, Parameters};

/// SplitMix64 of `seed` and `index`, as a number in [−1, 1): any language can evaluate it.
pub(crate) fn noise(seed: u64, index: u64) -> f64 {
    let mut x =
        seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(index.wrapping_mul(0xD1B5_4A32_D192_ED03));
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Parameters from the formula: ±1/√(values behind one output) for every tensor.
pub(crate) fn parameters(layout: Layout, seed: u64) -> Parameters {
    let mut flat = Vec::with_capacity(layout.len());
    for entry in layout.entries() {
        let fan_in: usize = entry.shape[1..].iter().product();
        let bound = 1.0 / (fan_in as f64).sqrt().min(8.0);
        let scale = if entry.shape.len() == 1 { 0.1 } else { bound };
        flat.extend(entry.range().map(|idx| (scale * noise(seed, idx as u64)) as f32));
    }
    Parameters::from_flat(layout, flat).unwrap()
}

/// Observation rows in the range of real ones: scans in ±0.5, goals within metres, speeds within
/// the limits.
pub(crate) fn observations(config: &NetworkConfig, n_rows: usize, seed: u64) -> Vec<f32> {
    let width = config.observation_len();
    let scans = config.frames * config.beams;
    let scale = |column: usize| {
        if column < scans {
            0.5
        } else if column < scans + 2 {
            8.0
        } else {
            1.0
        }
    };
    (0..n_rows * width).map(|idx| (scale(idx % width) * noise(seed, idx as u64)) as f32).collect()
}

/// Tokens 0, 1, …, M − 1, 0, ….
pub(crate) fn tokens(config: &NetworkConfig, n_rows: usize) -> Vec<u32> {
    (0..n_rows).map(|row| (row % config.n_behaviours) as u32).collect()
}

/// A small network of the same form, whose every parameter can be tried.
pub(crate) fn small() -> NetworkConfig {
    NetworkConfig {
        frames: 2,
        beams: 17,
        n_behaviours: 3,
        embedding: 4,
        laser_feature: 32,
        hidden: 32,
        ..NetworkConfig::default()
    }
}

/// The largest |a − b|.
pub(crate) fn largest_deviation(a: &[f32], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}
