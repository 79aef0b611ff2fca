//! Range noise: Gaussian on in-range returns, then the observation's scaling, in one pass.
//!
//! Box and Muller's transform on `ChaCha8` words: it takes a fixed number of words per scan (so
//! that a stream's position is a plain function of the number of scans) and has no branches, so it
//! vectorises. `rand_distr`'s ziggurat does neither; per scan of 512 beams it takes about twice as
//! long.
//!
//! Only integer operations and IEEE additions, multiplications, divisions and roots occur, so the
//! bits are the same on every CPU.
//!
//! # References
//!
//! G. E. P. Box, M. E. Muller, "A note on the generation of random normal deviates",
//! doi:10.1214/aoms/1177706645. The logarithm and the sine are the minimax polynomials of Cephes
//! (`logf`, `sinf`, `cosf`; S. L. Moshier).
// A kernel must be inlined into the function that is compiled for a CPU feature, or it is compiled
// without it.
#![allow(clippy::inline_always)]

use crate::rng::StreamRng;
use rand::Rng;

/// Natural logarithm of a number in (0, 1], relative error below 2e-7.
#[inline(always)]
fn ln(u: f32) -> f32 {
    let bits = u.to_bits();
    // Mantissa in [√½, √2): exponent and mantissa split where the polynomial is centred.
    let shifted = bits.wrapping_sub(0x3F35_04F3);
    let exponent = (shifted as i32) >> 23;
    let mantissa = f32::from_bits((shifted & 0x007F_FFFF).wrapping_add(0x3F35_04F3));
    let x = mantissa - 1.0;
    let z = x * x;
    let mut p = 7.037_683_6e-2;
    for c in [
        -1.151_461e-1,
        1.167_699_9e-1,
        -1.242_014_1e-1,
        1.424_932_3e-1,
        -1.666_805_8e-1,
        2.000_071_5e-1,
        -2.499_999_4e-1,
        3.333_333e-1,
    ] {
        p = p * x + c;
    }
    let e = exponent as f32;
    let tail = x * z * p + e * -2.121_944_4e-4 - 0.5 * z;
    x + tail + e * 0.693_359_4
}

/// (cos, sin) of `word`/2³² turns.
#[inline(always)]
fn cos_sin_of_turn(word: u32) -> (f32, f32) {
    let quadrant = word.wrapping_add(1 << 29) >> 30;
    let rest = word.wrapping_sub(quadrant << 30) as i32;
    let x = rest as f32 * (std::f32::consts::FRAC_PI_2 / (1_u32 << 30) as f32);
    let z = x * x;
    let sin = x + x * z * (-1.666_665_5e-1 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let cos = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    let odd = quadrant & 1 == 1;
    let (c, s) = if odd { (sin, cos) } else { (cos, sin) };
    // The signs by quadrant: cos + − − +, sin + + − −.
    let flip = |value: f32, negative: u32| f32::from_bits(value.to_bits() ^ (negative << 31));
    (flip(c, (quadrant ^ (quadrant >> 1)) & 1), flip(s, quadrant >> 1))
}

/// Two independent normal deviates from two words, times `std`.
#[inline(always)]
fn normal_pair(radius_word: u32, angle_word: u32, std: f32) -> (f32, f32) {
    // (0, 1]: the logarithm is finite; at 24 bits the largest deviate is 5.8 standard deviations.
    let u = ((radius_word >> 8) + 1) as f32 * (1.0 / (1_u32 << 24) as f32);
    let square = -2.0 * ln(u);
    let radius = std * if square > 0.0 { square } else { 0.0 }.sqrt();
    let (cos, sin) = cos_sin_of_turn(angle_word);
    (radius * cos, radius * sin)
}

/// A range with its noise, clamped, as the observation holds it; a beam that meets nothing stays at
/// the range.
#[inline(always)]
fn observed(r: f32, noise: f32, range: f32) -> f32 {
    let noisy = r + noise;
    let noisy = if noisy > 0.0 { noisy } else { 0.0 };
    let noisy = if noisy < range { noisy } else { range };
    let read = if r < range { noisy } else { range };
    read / range - 0.5
}

/// Writes range/`range` − ½ with noise of standard deviation `std` on every return nearer than
/// `range`.
///
/// # Shapes
///
/// `ranges`, `out`: n beams; `random`: 8·⌈n/2⌉ bytes, the radius words of beams 0 to ⌈n/2⌉ − 1,
/// then their angle words. Beam k and beam k + ⌈n/2⌉ share a pair.
#[inline(always)]
pub(super) fn noisy_frame(ranges: &[f32], random: &[u8], std: f32, range: f32, out: &mut [f32]) {
    let half = ranges.len().div_ceil(2);
    assert!(random.len() == 8 * half && out.len() == ranges.len());
    let (radius_words, _) = random[..4 * half].as_chunks::<4>();
    let (angle_words, _) = random[4 * half..].as_chunks::<4>();
    let (near, far) = ranges.split_at(half);
    let (out_near, out_far) = out.split_at_mut(half);
    // One long loop over slices of one length: that is what the compiler vectorises.
    let n = far.len();
    let (radii, angles) = (&radius_words[..n], &angle_words[..n]);
    let (near_n, out_near_n, out_far_n) = (&near[..n], &mut out_near[..n], &mut out_far[..n]);
    for k in 0..n {
        let words = (u32::from_le_bytes(radii[k]), u32::from_le_bytes(angles[k]));
        let noise = normal_pair(words.0, words.1, std);
        out_near_n[k] = observed(near_n[k], noise.0, range);
        out_far_n[k] = observed(far[k], noise.1, range);
    }
    if n < half {
        // An odd count of beams: the middle one uses half of its pair.
        let words = (u32::from_le_bytes(radius_words[n]), u32::from_le_bytes(angle_words[n]));
        out_near[n] = observed(near[n], normal_pair(words.0, words.1, std).0, range);
    }
}

/// One sensor's noise stream and the bytes of its present scan.
#[derive(Clone, Debug)]
pub struct NoiseSource {
    rng: StreamRng,
    random: Vec<u8>,
}

impl NoiseSource {
    /// Noise for scans of `beams` beams from a stream.
    pub fn new(rng: StreamRng, beams: usize) -> Self {
        Self { rng, random: vec![0; 8 * beams.div_ceil(2)] }
    }

    /// Writes a noise-free scan as one frame of an observation: noise on in-range returns, clamp,
    /// scaling.
    ///
    /// Takes the same number of words from the stream whatever the ranges are; none when `std` is
    /// 0.
    ///
    /// # Shapes
    ///
    /// `ranges`, `frame`: one per beam.
    ///
    /// # Formula
    ///
    /// frame = clamp(r + n, 0, `range`)/`range` − ½ where r < `range`, else ½. At the default range
    /// of 10 m that is range/10 − 0.5.
    pub fn frame(&mut self, ranges: &[f32], std: f32, range: f32, frame: &mut [f32]) {
        if std == 0.0 {
            for (out, r) in frame.iter_mut().zip(ranges) {
                *out = observed(*r, 0.0, range);
            }
            return;
        }
        self.rng.fill_bytes(&mut self.random);
        super::noisy_frame(ranges, &self.random, std, range, frame);
    }

    /// Position of the stream, in 32-bit words.
    pub fn position(&self) -> u64 {
        self.rng.get_word_pos() as u64
    }

    /// Goes to a position of [`NoiseSource::position`].
    pub fn seek(&mut self, position: u64) {
        self.rng.set_word_pos(u128::from(position));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Streams;

    #[test]
    fn logarithm_and_circle_are_accurate() {
        for i in 1..=200_000_u32 {
            let u = i as f32 / 200_000.0;
            let exact = f64::from(u).ln();
            assert!((f64::from(ln(u)) - exact).abs() <= 3e-7 * exact.abs().max(0.5), "ln {u}");
            let word = i.wrapping_mul(2_654_435_761);
            let (cos, sin) = cos_sin_of_turn(word);
            let (s, c) = libm::sincos(f64::from(word) / 4_294_967_296.0 * std::f64::consts::TAU);
            assert!((f64::from(cos) - c).abs() < 3e-7 && (f64::from(sin) - s).abs() < 3e-7, "turn {word}");
        }
        assert_eq!(ln(1.0), 0.0);
    }

    #[test]
    fn noise_is_a_standard_normal_times_its_scale() {
        let mut noise = NoiseSource::new(Streams::new(5).stream("noise", &[]), 512);
        let (mut sum, mut square, mut fourth, mut product) = (0.0, 0.0, 0.0, 0.0);
        let (ranges, mut frame, n) = ([5.0; 512], [0.0; 512], 512.0 * 2000.0);
        for _ in 0..2000 {
            noise.frame(&ranges, 0.02, 10.0, &mut frame);
            for k in 0..512 {
                let z = f64::from(frame[k]) * 10.0 / 0.02;
                sum += z;
                square += z * z;
                fourth += z.powi(4);
                product += z * f64::from(frame[(k + 256) % 512]) * 10.0 / 0.02;
            }
        }
        assert!((sum / n).abs() < 0.004, "mean {}", sum / n);
        assert!((square / n - 1.0).abs() < 0.006, "variance {}", square / n);
        assert!((fourth / n - 3.0).abs() < 0.04, "kurtosis {}", fourth / n);
        assert!((product / n).abs() < 0.006, "correlation in a pair {}", product / n);
    }

    #[test]
    fn only_returns_are_noisy_and_all_is_clamped() {
        let mut noise = NoiseSource::new(Streams::new(5).stream("noise", &[]), 5);
        let mut frame = [0.0; 5];
        for _ in 0..100 {
            noise.frame(&[10.0, 0.001, 9.999, 10.0, 5.0], 0.5, 10.0, &mut frame);
            assert_eq!((frame[0], frame[3]), (0.5, 0.5));
            assert!(frame.iter().all(|f| (-0.5..=0.5).contains(f)));
            assert_ne!(frame[4], 0.0);
        }
        noise.frame(&[10.0, 0.25, 9.75, 10.0, 5.0], 0.0, 10.0, &mut frame);
        assert_eq!(frame, [0.5, 0.25 / 10.0 - 0.5, 9.75 / 10.0 - 0.5, 0.5, 0.0]);
    }
}
