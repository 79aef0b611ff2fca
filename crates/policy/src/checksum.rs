//! The checksum of a tensor file: SHA-256 over its metadata and tensors, whatever their place in
//! the file.

use sha2::{Digest, Sha256};

/// Feeds metadata (sorted by key), then tensors (sorted by name); every part is preceded by its
/// length, so that no two contents have the same stream of bytes.
#[derive(Debug)]
pub(crate) struct Checksum(Sha256);

impl Checksum {
    pub(crate) fn new() -> Self {
        Self(Sha256::new())
    }

    pub(crate) fn metadata(&mut self, key: &str, value: &str) {
        self.part(key.as_bytes());
        self.part(value.as_bytes());
    }

    pub(crate) fn tensor(&mut self, name: &str, dtype: &str, shape: &[usize], bytes: &[u8]) {
        self.part(name.as_bytes());
        self.part(dtype.as_bytes());
        self.part(format!("{shape:?}").as_bytes());
        self.part(bytes);
    }

    pub(crate) fn finish(self) -> String {
        hex(&self.0.finalize())
    }

    fn part(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }
}

/// Lower-case hexadecimal digits, two for each byte, as hashes are written.
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a string takes everything");
        text
    })
}
