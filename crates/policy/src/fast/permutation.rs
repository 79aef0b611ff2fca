//! From canonical order to the order of the kernels, and back.

/// The index of each canonical parameter in native order.
#[derive(Debug, Clone)]
pub(super) struct Permutation {
    native: Vec<u32>,
}

impl Permutation {
    /// The identity of so many parameters.
    pub(super) fn identity(len: usize) -> Self {
        Self { native: (0..u32::try_from(len).expect("a network has less than 2³² parameters")).collect() }
    }

    /// Reorders the tensor that starts at `offset`: its canonical value `idx` goes to
    /// `native_index(idx)`, both counted from the tensor's start.
    pub(super) fn reorder(&mut self, offset: usize, len: usize, native_index: impl Fn(usize) -> usize) {
        for (idx, native) in self.native[offset..offset + len].iter_mut().enumerate() {
            let to = native_index(idx);
            debug_assert!(to < len, "{to} is outside of a tensor of {len}");
            *native = (offset + to) as u32;
        }
    }

    pub(super) fn to_native(&self, canonical: &[f32]) -> Vec<f32> {
        assert_eq!(canonical.len(), self.native.len(), "a vector of another network");
        let mut native = vec![0.0; canonical.len()];
        for (value, at) in canonical.iter().zip(&self.native) {
            native[*at as usize] = *value;
        }
        native
    }

    pub(super) fn to_canonical(&self, native: &[f32]) -> Vec<f32> {
        assert_eq!(native.len(), self.native.len(), "a vector of another network");
        self.native.iter().map(|at| native[*at as usize]).collect()
    }
}
