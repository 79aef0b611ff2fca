//! Named, seekable random streams: every draw of the workspace comes from one of these.
//!
//! One root seed gives one `ChaCha8` key; a stream's name and indices give its 64-bit stream id.
//! Two streams of different ids never overlap, and a stream can be resumed from its word position.

use rand_chacha::rand_core::SeedableRng;

/// The generator behind every stream: `ChaCha8`, seekable (`get_word_pos`, `set_word_pos`) and
/// serialisable.
pub type StreamRng = rand_chacha::ChaCha8Rng;

/// The family of streams that belong to one root seed.
///
/// # Examples
///
/// ```
/// use rand::Rng;
/// let streams = jostle_sim::Streams::new(7);
/// let mut a = streams.stream("noise", &[0, 3]);
/// let mut b = streams.stream("noise", &[0, 3]);
/// assert_eq!(a.next_u64(), b.next_u64());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Streams {
    seed: u64,
}

impl Streams {
    /// The streams of `seed`.
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// The root seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// The stream called `name`, told apart from its siblings by `indices` (room, agent, episode,
    /// …), at its start.
    ///
    /// # Formula
    ///
    /// The key is `ChaCha8Rng::seed_from_u64(seed)`. The stream id is FNV-1a 64 over the bytes of
    /// `name`, one byte `0xFF` (which no UTF-8 text holds), and each index as eight little-endian
    /// bytes.
    pub fn stream(&self, name: &str, indices: &[u64]) -> StreamRng {
        let mut rng = StreamRng::seed_from_u64(self.seed);
        rng.set_stream(stream_id(name, indices));
        rng
    }
}

/// FNV-1a 64 of a stream's name and indices.
fn stream_id(name: &str, indices: &[u64]) -> u64 {
    let tail = indices.iter().flat_map(|index| index.to_le_bytes());
    let bytes = name.bytes().chain(std::iter::once(0xFF)).chain(tail);
    bytes.fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    /// FNV-1a of a prefix without indices, against the published value for "foobar" continued by
    /// the separator.
    #[test]
    fn stream_id_is_fnv_1a() {
        let foobar: u64 = 0x8594_4171_F739_67E8;
        assert_eq!(stream_id("foobar", &[]), (foobar ^ 0xFF).wrapping_mul(0x0100_0000_01B3));
    }

    #[test]
    fn first_words_are_pinned() {
        let words = |name, indices: &[u64]| Streams::new(1).stream(name, indices).next_u64();
        assert_eq!(words("noise", &[0, 0]), 6_373_903_178_274_716_064);
        assert_eq!(words("noise", &[0, 1]), 17_674_537_810_216_343_444);
    }

    #[test]
    fn names_and_indices_tell_streams_apart() {
        let draws = [("a", vec![]), ("a", vec![0]), ("a", vec![1]), ("b", vec![0]), ("a", vec![0, 0])]
            .map(|(name, indices)| Streams::new(3).stream(name, &indices).next_u64());
        for (i, a) in draws.iter().enumerate() {
            assert!(draws[i + 1..].iter().all(|b| a != b));
        }
        assert_ne!(Streams::new(4).stream("a", &[]).next_u64(), draws[0]);
    }
}
