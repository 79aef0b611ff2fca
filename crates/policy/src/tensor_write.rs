//! Writing a safetensors file: the same content gives the same bytes, and a reader never sees half
//! a file.
//!
//! The safetensors crate keeps the metadata in a hash map, whose order is another in each run; the
//! header is therefore written here (eight bytes of length, JSON, the tensors), and read back by
//! the crate in the tests.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use half::f16;
use serde_json::{Map, Value, json};

use crate::checksum::Checksum;
use crate::error::PolicyError;
use crate::layout::Layout;
use crate::tensor_file::{CHECKSUM_KEY, HEADER_MAX};

/// The values of a tensor to be written.
#[derive(Debug, Clone, Copy)]
pub enum Values<'a> {
    /// Stored as F32.
    F32(&'a [f32]),
    /// Rounded to half precision and stored as F16.
    F16(&'a [f32]),
    /// Stored as F64.
    F64(&'a [f64]),
    /// A blob of bytes.
    U8(&'a [u8]),
}

/// A tensor to be written.
#[derive(Debug, Clone)]
pub struct TensorOut<'a> {
    /// Full name, with its prefix.
    pub name: String,
    /// Row-major shape.
    pub shape: Vec<usize>,
    /// Values, as many as the shape says.
    pub values: Values<'a>,
}

impl<'a> TensorOut<'a> {
    /// Every tensor of a flat vector in canonical order (parameters, or an optimiser's moments), as
    /// F32.
    ///
    /// # Panics
    ///
    /// If the vector is not as long as the layout.
    pub fn all(prefix: &str, layout: &Layout, flat: &'a [f32]) -> Vec<Self> {
        assert_eq!(flat.len(), layout.len(), "one value for each parameter");
        let tensor = |entry: &crate::layout::Entry| TensorOut {
            name: format!("{prefix}.{}", entry.name),
            shape: entry.shape.clone(),
            values: Values::F32(&flat[entry.range()]),
        };
        layout.entries().iter().map(tensor).collect()
    }

    fn dtype(&self) -> (&'static str, usize) {
        match self.values {
            Values::F32(_) => ("F32", 4),
            Values::F16(_) => ("F16", 2),
            Values::F64(_) => ("F64", 8),
            Values::U8(_) => ("U8", 1),
        }
    }

    fn bytes(&self) -> Cow<'a, [u8]> {
        match self.values {
            Values::F32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Values::F16(values) => {
                values.iter().flat_map(|value| f16::from_f32(*value).to_le_bytes()).collect()
            }
            Values::F64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Values::U8(values) => values.into(),
        }
    }

    /// The first value that would be stored as NaN or infinity.
    fn first_not_finite(&self) -> Option<String> {
        let of_f32 = |values: &[f32]| values.iter().find(|value| !value.is_finite()).map(f32::to_string);
        match self.values {
            Values::F32(values) => of_f32(values),
            Values::F16(values) => {
                let overflows = |value: &&f32| !f16::from_f32(**value).is_finite();
                values.iter().find(overflows).map(|value| format!("{value} (in half precision)"))
            }
            Values::F64(values) => values.iter().find(|value| !value.is_finite()).map(f64::to_string),
            Values::U8(_) => None,
        }
    }
}

/// Writes a safetensors file under a temporary name in the same folder, syncs it, and renames it; a
/// file that was there is replaced whole or not at all. A metadata key `checksum` over everything
/// is added.
///
/// # Errors
///
/// [`PolicyError::File`] if a value is not finite or two tensors have one name, [`PolicyError::Io`]
/// if the disk refuses; nothing is left behind then.
///
/// # Panics
///
/// If a shape does not fit its values.
pub fn write_tensors(
    path: &Path,
    tensors: &[TensorOut<'_>],
    metadata: &BTreeMap<String, String>,
) -> Result<(), PolicyError> {
    let refuse = |field: &str, found: String, expected: &str| {
        let (file, field) = (path.to_owned(), field.to_owned());
        Err(PolicyError::File { file, field, found, expected: expected.to_owned() })
    };
    let mut by_name = BTreeMap::new();
    for tensor in tensors {
        if let Some(found) = tensor.first_not_finite() {
            return refuse(&tensor.name, found, "finite values");
        }
        let bytes = tensor.bytes();
        let n_values = tensor.shape.iter().product::<usize>();
        assert_eq!(bytes.len(), n_values * tensor.dtype().1, "{}: shape {:?}", tensor.name, tensor.shape);
        if by_name.insert(tensor.name.as_str(), (tensor, bytes)).is_some() {
            return refuse(&tensor.name, "two tensors".to_owned(), "one tensor of this name");
        }
    }
    let header = header(&by_name, metadata);
    if header.len() as u64 > HEADER_MAX {
        return refuse("header length", header.len().to_string(), "at most 1 MiB");
    }
    let mut content = (header.len() as u64).to_le_bytes().to_vec();
    content.extend(header);
    for (_tensor, bytes) in in_file_order(&by_name) {
        content.extend_from_slice(bytes);
    }
    replace(path, &content)
}

/// Tensors by name, with their bytes.
type ByName<'t, 'v> = BTreeMap<&'t str, (&'t TensorOut<'v>, Cow<'v, [u8]>)>;

/// Wide types first, so that every tensor is aligned to its type; by name within a type.
fn in_file_order<'m, 't, 'v>(by_name: &'m ByName<'t, 'v>) -> Vec<&'m (&'t TensorOut<'v>, Cow<'v, [u8]>)> {
    let mut order: Vec<_> = by_name.values().collect();
    order.sort_by_key(|(tensor, _)| std::cmp::Reverse(tensor.dtype().1));
    order
}

/// The header's JSON, filled with spaces to a multiple of eight bytes.
fn header(by_name: &ByName<'_, '_>, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    let mut checksum = Checksum::new();
    let mut strings = Map::new();
    for (key, value) in metadata.iter().filter(|(key, _)| key.as_str() != CHECKSUM_KEY) {
        checksum.metadata(key, value);
        strings.insert(key.clone(), Value::from(value.as_str()));
    }
    for (tensor, bytes) in by_name.values() {
        checksum.tensor(&tensor.name, tensor.dtype().0, &tensor.shape, bytes);
    }
    strings.insert(CHECKSUM_KEY.to_owned(), Value::from(checksum.finish()));

    let mut entries = Map::new();
    entries.insert("__metadata__".to_owned(), Value::Object(strings));
    let mut start = 0;
    for (tensor, bytes) in in_file_order(by_name) {
        let end = start + bytes.len();
        let entry = json!({ "dtype": tensor.dtype().0, "shape": tensor.shape, "data_offsets": [start, end] });
        entries.insert(tensor.name.clone(), entry);
        start = end;
    }
    let mut header = Value::Object(entries).to_string().into_bytes();
    header.resize(header.len().next_multiple_of(8), b' ');
    header
}

/// Puts `content` at `path` in one step.
fn replace(path: &Path, content: &[u8]) -> Result<(), PolicyError> {
    let io = |action| move |reason| PolicyError::Io { file: path.to_owned(), action, reason };
    let partial = partial_path(path);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&partial)?;
        file.write_all(content)?;
        file.sync_all()
    };
    let result =
        write().map_err(io("write")).and_then(|()| fs::rename(&partial, path).map_err(io("replace")));
    if result.is_err() {
        // The first error is the one to report; there may be no partial file at all.
        let _ = fs::remove_file(&partial);
        return result;
    }
    #[cfg(unix)]
    if let Some(folder) = path.parent() {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        File::open(folder).and_then(|folder| folder.sync_all()).map_err(io("sync the folder of"))?;
    }
    Ok(())
}

/// A name beside `path` that no other process uses.
fn partial_path(path: &Path) -> PathBuf {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!(".{name}.{}.partial", std::process::id()))
}
