//! Reading a safetensors file that anybody may have made.
//!
//! Nothing is allocated on the word of the file: the header's length is capped and compared with
//! the file's size before it is read, and the size of every tensor is compared with the bytes that
//! are there (by the safetensors crate). Values are checked where they are used
//! ([`TensorFile::f32s`]).

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use half::f16;
use safetensors::{Dtype, SafeTensors};

use crate::checksum::Checksum;
use crate::error::PolicyError;
use crate::layout::Layout;
use crate::parameters::Parameters;

/// The longest header that is read (the safetensors crate would accept 100 MB).
pub const HEADER_MAX: u64 = 1 << 20;
/// The largest file that is read.
pub const FILE_MAX: u64 = 4 << 30;
/// The metadata key of the checksum ([`TensorFile::verify_checksum`]).
pub const CHECKSUM_KEY: &str = "checksum";
/// Characters of a file that an error repeats at most.
const EXCERPT_MAX: usize = 200;

/// A safetensors file in memory.
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    bytes: Vec<u8>,
    tensors: BTreeMap<String, Info>,
    metadata: BTreeMap<String, String>,
}

/// The place, type and shape of a tensor.
#[derive(Debug)]
struct Info {
    dtype: Dtype,
    shape: Vec<usize>,
    range: Range<usize>,
}

impl TensorFile {
    /// Reads the whole file and checks its structure.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Io`] if it cannot be read, [`PolicyError::File`] if it is no safetensors
    /// file, is truncated, or is larger than the caps.
    pub fn read(path: &Path) -> Result<Self, PolicyError> {
        let io = |action| move |reason| PolicyError::Io { file: path.to_owned(), action, reason };
        let mut file = File::open(path).map_err(io("open"))?;
        let about = file.metadata().map_err(io("read"))?;
        let refuse =
            |field: &str, found: String, expected: String| Err(refusal(path, field, &found, expected));
        if !about.is_file() {
            return refuse("file", "something else".to_owned(), "a regular file".to_owned());
        }
        let len = about.len();
        if !(8..=FILE_MAX).contains(&len) {
            return refuse("file", format!("{len} bytes"), format!("8 to {FILE_MAX} bytes"));
        }
        let mut claim = [0; 8];
        file.read_exact(&mut claim).map_err(io("read"))?;
        let (header_len, header_max) = (u64::from_le_bytes(claim), HEADER_MAX.min(len - 8));
        if header_len > header_max {
            return refuse("header length", header_len.to_string(), format!("at most {header_max}"));
        }
        let mut bytes = claim.to_vec();
        file.take(len - 8).read_to_end(&mut bytes).map_err(io("read"))?;
        Self::parse(path, bytes)
    }

    fn parse(path: &Path, bytes: Vec<u8>) -> Result<Self, PolicyError> {
        let (header_len, header) = SafeTensors::read_metadata(&bytes).map_err(|error| {
            refusal(path, "header", &error.to_string(), "a whole safetensors file".to_owned())
        })?;
        let start = 8 + header_len;
        let info = |info: &safetensors::tensor::TensorInfo| Info {
            dtype: info.dtype,
            shape: info.shape.clone(),
            range: start + info.data_offsets.0..start + info.data_offsets.1,
        };
        // Both maps come as hash maps; from here on they are ordered.
        let tensors = header.tensors().into_iter().map(|(name, about)| (name, info(about))).collect();
        let metadata = header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        Ok(Self { path: path.to_owned(), bytes, tensors, metadata })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The metadata, all strings.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// The names of the tensors, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// `true` if there is a tensor of that name.
    pub fn contains(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// The shape of a tensor.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] if there is none of that name.
    pub fn shape(&self, name: &str) -> Result<&[usize], PolicyError> {
        Ok(&self.info(name)?.shape)
    }

    /// The type and the bytes (little-endian) of a tensor.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] if there is none of that name.
    pub fn raw(&self, name: &str) -> Result<(Dtype, &[u8]), PolicyError> {
        let info = self.info(name)?;
        Ok((info.dtype, &self.bytes[info.range.clone()]))
    }

    /// The values of an F32 or F16 tensor of the shape given, every one finite.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] for a tensor that is missing, of another shape or type, or not finite.
    pub fn f32s(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, PolicyError> {
        let info = self.info(name)?;
        if info.shape != shape {
            return Err(self.refuse(name, format!("shape {:?}", info.shape), format!("shape {shape:?}")));
        }
        let (dtype, bytes) = self.raw(name)?;
        let values: Vec<f32> = match dtype {
            Dtype::F32 => {
                bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
            }
            Dtype::F16 => bytes.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
            other => return Err(self.refuse(name, format!("type {other}"), "type F32 or F16".to_owned())),
        };
        match values.iter().position(|value| !value.is_finite()) {
            Some(idx) => {
                let found = format!("{} at index {idx}", values[idx]);
                Err(self.refuse(name, found, "finite values".to_owned()))
            }
            None => Ok(values),
        }
    }

    /// The parameters whose tensors are named `prefix.…`, which must be exactly those of the
    /// layout.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] for a tensor that is missing, of another shape or type, not finite, or
    /// not in the layout.
    pub fn parameters(
        &self,
        prefix: &str,
        layout: impl Into<Arc<Layout>>,
    ) -> Result<Parameters, PolicyError> {
        let layout = layout.into();
        // The names first: nothing is allocated for a layout that the file does not hold.
        let entry_name = |name: &str| format!("{prefix}.{name}");
        for entry in layout.entries() {
            self.info(&entry_name(&entry.name))?;
        }
        let behind_prefix = |name: &'_ str| -> Option<String> {
            name.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('.')).map(str::to_owned)
        };
        if let Some(extra) =
            self.names().find(|name| behind_prefix(name).is_some_and(|n| layout.entry(&n).is_none()))
        {
            return Err(self.refuse(extra, "a tensor".to_owned(), "no tensor of this name".to_owned()));
        }
        let mut flat = Vec::new();
        for entry in layout.entries() {
            flat.extend(self.f32s(&entry_name(&entry.name), &entry.shape)?);
        }
        Parameters::from_flat(layout, flat)
    }

    /// The value of a metadata key.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] if the key is missing.
    pub fn metadata_value(&self, key: &str) -> Result<&str, PolicyError> {
        let missing = || self.refuse(&format!("metadata {key}"), "nothing".to_owned(), "a value".to_owned());
        self.metadata.get(key).map(String::as_str).ok_or_else(missing)
    }

    /// Compares the content with the metadata key `checksum`, which
    /// [`write_tensors`](crate::write_tensors) puts there.
    ///
    /// # Errors
    ///
    /// [`PolicyError::File`] if the key is missing or the content was changed.
    pub fn verify_checksum(&self) -> Result<(), PolicyError> {
        let expected = self.metadata_value(CHECKSUM_KEY)?;
        let mut checksum = Checksum::new();
        for (key, value) in self.metadata.iter().filter(|(key, _)| key.as_str() != CHECKSUM_KEY) {
            checksum.metadata(key, value);
        }
        for (name, info) in &self.tensors {
            checksum.tensor(name, &info.dtype.to_string(), &info.shape, &self.bytes[info.range.clone()]);
        }
        let found = checksum.finish();
        if found == expected {
            return Ok(());
        }
        Err(self.refuse("content", format!("checksum {found}"), format!("checksum {expected}")))
    }

    /// An error about a field of this file.
    ///
    /// Text from the file is shortened ([`excerpt`]): a hostile name or value does not fill a
    /// terminal.
    pub fn refuse(&self, field: &str, found: impl Into<String>, expected: String) -> PolicyError {
        refusal(&self.path, field, &found.into(), expected)
    }

    fn info(&self, name: &str) -> Result<&Info, PolicyError> {
        let missing = || self.refuse(name, "nothing".to_owned(), "a tensor".to_owned());
        self.tensors.get(name).ok_or_else(missing)
    }
}

fn refusal(path: &Path, field: &str, found: &str, expected: String) -> PolicyError {
    PolicyError::File { file: path.to_owned(), field: excerpt(field), found: excerpt(found), expected }
}

/// Text from a file, fit for an error message: one line without control characters, at most 200
/// characters.
pub fn excerpt(text: &str) -> String {
    let clean = |c: char| if c.is_control() { ' ' } else { c };
    let mut line: String = text.chars().take(EXCERPT_MAX).map(clean).collect();
    if text.chars().nth(EXCERPT_MAX).is_some() {
        line.push('…');
    }
    line
}
