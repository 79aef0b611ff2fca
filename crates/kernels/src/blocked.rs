//! Activations in blocks of 16 features: one format that every product reads without a copy.
//!
//! A batch is cut into chunks of at most 64 rows. Element (row, feature) of a chunk is at
//!
//! ```text
//! (feature / 16 · stride + row) · 16 + feature % 16
//! ```
//!
//! Forward products and input gradients broadcast along the 16 features of a row, and rows lie a
//! fixed 16 floats apart; weight gradients read 16 features of one row after the other, as a
//! stream. With rows of 4096 features side by side instead, the 14 rows of a tile would lie 16 KB
//! apart and evict each other from the cache. The chunks depend on the size of the batch only,
//! never on the number of threads.

/// Features of a block.
pub const BLOCK: usize = 16;

/// The division of a batch into chunks, and the distance between their blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunks {
    /// Rows of the batch.
    pub batch: usize,
    /// Number of chunks.
    pub count: usize,
    /// Rows of a chunk; the last may have fewer.
    pub size: usize,
    /// Rows that a block has room for.
    pub stride: usize,
}

/// Most rows of a chunk: 64 rows of 4096 features are 1 MB, half of a usual second-level cache.
const CHUNK_MAX: usize = 64;
/// Up to here a batch is one chunk: reading the weights twice would cost more than a second core
/// gives.
const SINGLE_MAX: usize = 24;

/// Chunks summed in registers by one weight-gradient tile: 192 rows, 12 KB of inputs and 24 KB of
/// output gradients.
const CHUNKS_AT_ONCE: usize = 3;

impl Chunks {
    /// Cuts a batch into chunks of nearly one size, an even number of them so that two cores share
    /// them evenly.
    pub fn new(batch: usize) -> Self {
        let count = if batch <= SINGLE_MAX { 1 } else { batch.div_ceil(CHUNK_MAX).next_multiple_of(2) };
        let size = batch.div_ceil(count).max(1);
        let count = batch.div_ceil(size);
        // A distance of 64 rows is 4 KB, at which all blocks of a row would fall into one set of
        // the cache.
        let stride = if size > 32 { size | 3 } else { size };
        let stride = if size > 48 { CHUNK_MAX + 3 } else { stride };
        Self { batch, count, size, stride }
    }

    /// Rows of a chunk.
    #[inline]
    pub fn rows(&self, chunk: usize) -> usize {
        self.size.min(self.batch - chunk * self.size)
    }

    /// First row of a chunk.
    #[inline]
    pub fn first(&self, chunk: usize) -> usize {
        chunk * self.size
    }

    /// `true` if a weight gradient sums from zero from this chunk on: every third, and the last if
    /// it has fewer rows.
    pub(crate) fn begins_run(&self, chunk: usize) -> bool {
        chunk.is_multiple_of(CHUNKS_AT_ONCE) || self.rows(chunk) < self.size
    }

    /// Distance between two blocks.
    #[inline]
    pub fn block_stride(&self) -> usize {
        self.stride * BLOCK
    }

    /// Length of one chunk's activations of `features` features.
    #[inline]
    pub fn chunk_len(&self, features: usize) -> usize {
        features.div_ceil(BLOCK) * self.block_stride()
    }

    /// Length of the whole batch's activations of `features` features.
    #[inline]
    pub fn len(&self, features: usize) -> usize {
        self.count * self.chunk_len(features)
    }

    /// Writes one row into a chunk, from the feature `first` on.
    #[inline]
    pub fn write_row(&self, chunk: &mut [f32], row: usize, first: usize, values: &[f32]) {
        if first.is_multiple_of(BLOCK) {
            let mut at = first / BLOCK * self.block_stride() + row * BLOCK;
            for block in values.chunks(BLOCK) {
                chunk[at..at + block.len()].copy_from_slice(block);
                at += self.block_stride();
            }
        } else {
            for (feature, value) in (first..).zip(values) {
                chunk[feature / BLOCK * self.block_stride() + row * BLOCK + feature % BLOCK] = *value;
            }
        }
    }

    /// Adds the rows of all chunks: `sums[feature] = Σ_row x[row, feature]`, chunk by chunk. This
    /// is the gradient of a bias.
    pub fn sum_rows(&self, x: &[f32], features: usize, sums: &mut [f32]) {
        sums.fill(0.0);
        for (chunk, x) in x.chunks_exact(self.chunk_len(features)).enumerate() {
            for (block, sums) in sums.chunks_mut(BLOCK).enumerate() {
                let mut partial = [0.0_f32; BLOCK];
                let (rows, _) = x[block * self.block_stride()..].as_chunks::<BLOCK>();
                for row in &rows[..self.rows(chunk)] {
                    partial.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
                }
                sums.iter_mut().zip(partial).for_each(|(sum, value)| *sum += value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_cover_the_batch() {
        for batch in 1..700 {
            let chunks = Chunks::new(batch);
            let rows: usize = (0..chunks.count).map(|chunk| chunks.rows(chunk)).sum();
            assert_eq!(rows, batch);
            assert!(chunks.size <= CHUNK_MAX && chunks.stride >= chunks.size);
        }
        assert_eq!(Chunks::new(640), Chunks { batch: 640, count: 10, size: 64, stride: 67 });
        assert_eq!(Chunks::new(80).size, 40);
        assert_eq!(Chunks::new(5), Chunks { batch: 5, count: 1, size: 5, stride: 5 });
    }

    #[test]
    fn rows_are_found_again_and_summed() {
        let chunks = Chunks::new(50);
        let mut x = vec![0.0; chunks.len(20)];
        for row in 0..50 {
            let chunk = row / chunks.size;
            let chunk_len = chunks.chunk_len(20);
            let values: Vec<f32> = (0..20).map(|feature| (row * 20 + feature) as f32).collect();
            let x = &mut x[chunk * chunk_len..][..chunk_len];
            chunks.write_row(x, row % chunks.size, 0, &values[..3]);
            chunks.write_row(x, row % chunks.size, 3, &values[3..]);
        }
        let mut sums = [0.0; 20];
        chunks.sum_rows(&x, 20, &mut sums);
        for (feature, sum) in sums.iter().enumerate() {
            assert_eq!(*sum, (20 * 49 * 25 + 50 * feature) as f32);
        }
    }
}
