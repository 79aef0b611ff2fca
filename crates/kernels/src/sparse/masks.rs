//! Masks of one sample's output gradients.

use crate::operands::PANEL;

/// Channels on either side of conv2.
pub(super) const CHANNELS: usize = PANEL;

/// Positions of a mask.
const PART: usize = u64::BITS as usize;

/// One bit for each output gradient of a sample that is not zero, by position and by channel.
///
/// The memory grows to the longest sample and stays.
#[derive(Debug, Clone, Default)]
pub struct SampleMasks {
    /// Bit c of mask p: position p, channel c.
    pub(super) positions: Vec<u32>,
    /// Bit i of mask c of part k: position 64·k + i, channel c.
    pub(super) channels: Vec<[u64; CHANNELS]>,
}

impl SampleMasks {
    /// Takes the masks of a sample's features, position after position, 64 to a mask: two
    /// positions.
    pub fn set(&mut self, features: impl Iterator<Item = u64>) {
        self.positions.clear();
        self.positions.extend(features.flat_map(|mask| [mask as u32, (mask >> CHANNELS) as u32]));
        self.channels.clear();
        for part in self.positions.chunks(PART) {
            let [mut front, mut back] = [[0; CHANNELS]; 2];
            let in_front = part.len().min(CHANNELS);
            front[..in_front].copy_from_slice(&part[..in_front]);
            back[..part.len() - in_front].copy_from_slice(&part[in_front..]);
            transpose(&mut front);
            transpose(&mut back);
            self.channels.push(std::array::from_fn(|c| u64::from(front[c]) | u64::from(back[c]) << CHANNELS));
        }
    }
}

/// Transposes 32 × 32 bits: bit j of word i becomes bit i of word j. Halves are exchanged, then
/// halves of halves.
fn transpose(words: &mut [u32; CHANNELS]) {
    let (mut width, mut low) = (CHANNELS / 2, 0x0000_ffff_u32);
    while width > 0 {
        for first in (0..CHANNELS).filter(|word| word & width == 0) {
            let exchanged = (words[first] >> width ^ words[first + width]) & low;
            words[first] ^= exchanged << width;
            words[first + width] ^= exchanged;
        }
        width /= 2;
        low ^= low << width;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_transposed() {
        let words: [u32; 32] = std::array::from_fn(|i| (i as u32 + 1).wrapping_mul(0x9e37_79b9));
        let mut transposed = words;
        transpose(&mut transposed);
        for (i, j) in (0..32).flat_map(|i| (0..32).map(move |j| (i, j))) {
            assert_eq!(transposed[j] >> i & 1, words[i] >> j & 1, "bit {j} of word {i}");
        }
    }

    #[test]
    fn masks_are_found_by_position_and_by_channel() {
        for spans in [1, 15, 16, 17, 33, 64] {
            let features: Vec<u64> =
                (1..=spans).map(|i: u64| i.wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect();
            let mut masks = SampleMasks::default();
            masks.set(features.iter().copied());
            assert_eq!(masks.positions.len(), 2 * features.len());
            assert_eq!(masks.channels.len(), (2 * features.len()).div_ceil(64));
            for (p, c) in (0..64 * masks.channels.len()).flat_map(|p| (0..32).map(move |c| (p, c))) {
                let expected = features.get(p / 2).is_some_and(|mask| mask >> (p % 2 * 32 + c) & 1 == 1);
                assert_eq!(masks.channels[p / 64][c] >> (p % 64) & 1 == 1, expected, "{p}, {c}");
                let by_position = masks.positions.get(p).is_some_and(|mask| mask >> c & 1 == 1);
                assert_eq!(by_position, expected, "{p}, {c}");
            }
        }
    }
}
