//! Scan pooling: the nearest of each k neighbouring beams.
//!
//! The nearest, not the mean: a thing that is near and narrow must not vanish between two far
//! beams.

use crate::observation::TAIL_LEN;

/// Writes a row whose beams are the nearest of each `k` neighbours of the observation's; the last
/// four values (goal and velocity) are copied. Input beam i covers beams k·i to k·i + k − 1.
///
/// # Shapes
///
/// `observation` `[frames · beams + 4]` → `input` `[frames · beams / k + 4]`
///
/// # Panics
///
/// If the number of scan values is no multiple of `k`, or `input` has another length.
pub fn pool_row(observation: &[f32], k: usize, input: &mut [f32]) {
    let (scans, tail) = observation.split_at(observation.len() - TAIL_LEN);
    assert_eq!(scans.len() % k, 0, "scans of a multiple of {k} beams");
    let (pooled, rest) = input.split_at_mut(scans.len() / k);
    for (to, beams) in pooled.iter_mut().zip(scans.chunks_exact(k)) {
        *to = beams.iter().copied().fold(f32::INFINITY, f32::min);
    }
    rest.copy_from_slice(tail);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_of_each_pair_is_kept() {
        let mut input = [0.0; 2 + 4];
        pool_row(&[0.5, 0.1, -0.5, 0.2, 1.0, 2.0, 3.0, 4.0], 2, &mut input);
        assert_eq!(input, [0.1, -0.5, 1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn one_beam_each_is_the_row_itself() {
        let row = [0.3, 0.1, -0.5, 1.0, 2.0, 3.0, 4.0];
        let mut input = [0.0; 7];
        pool_row(&row, 1, &mut input);
        assert_eq!(input, row);
    }
}
