//! Reads a safetensors fixture: F32, F64 and I64 tensors by name, and its metadata.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use safetensors::{Dtype, SafeTensors};

/// One tensor of a fixture.
pub(crate) struct Tensor {
    pub(crate) shape: Vec<usize>,
    pub(crate) data: Data,
}

/// The numbers of a tensor.
pub(crate) enum Data {
    F32(Vec<f32>),
    F64(Vec<f64>),
    I64(Vec<i64>),
}

/// All tensors of a fixture, in the order of their names.
pub(crate) struct Tensors {
    pub(crate) metadata: BTreeMap<String, String>,
    tensors: BTreeMap<String, Tensor>,
}

impl Tensors {
    /// Reads a whole file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).context("cannot be read")?;
        let (_, head) = SafeTensors::read_metadata(&bytes).context("is no safetensors file")?;
        let file = SafeTensors::deserialize(&bytes).context("is no safetensors file")?;
        let metadata = head.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            let bytes = view.data();
            let data = match view.dtype() {
                Dtype::F32 => Data::F32(words(bytes, f32::from_le_bytes)),
                Dtype::F64 => Data::F64(words(bytes, f64::from_le_bytes)),
                Dtype::I64 => Data::I64(words(bytes, i64::from_le_bytes)),
                other => bail!("tensor {name} has type {other:?}; F32, F64 and I64 are known"),
            };
            tensors.insert(name.to_owned(), Tensor { shape: view.shape().to_vec(), data });
        }
        Ok(Self { metadata, tensors })
    }

    /// True where a tensor of this name is there.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// The names that begin with `prefix`, without it.
    pub(crate) fn names_under<'a>(&'a self, prefix: &'a str) -> impl Iterator<Item = &'a str> {
        self.tensors.keys().filter_map(move |name| name.strip_prefix(prefix))
    }

    /// Any tensor by name.
    pub(crate) fn get(&self, name: &str) -> Result<&Tensor> {
        self.tensors.get(name).with_context(|| format!("tensor {name} is missing"))
    }

    /// The numbers of an F32 tensor.
    pub(crate) fn f32(&self, name: &str) -> Result<&[f32]> {
        match &self.get(name)?.data {
            Data::F32(values) => Ok(values),
            _ => bail!("tensor {name} is not F32"),
        }
    }

    /// The only number of an F64 tensor.
    pub(crate) fn f64_scalar(&self, name: &str) -> Result<f64> {
        match &self.get(name)?.data {
            Data::F64(values) if values.len() == 1 => Ok(values[0]),
            _ => bail!("tensor {name} is not one F64"),
        }
    }

    /// The tokens of a batch, each below `n_behaviours`.
    pub(crate) fn tokens(&self, n_behaviours: usize) -> Result<Vec<u32>> {
        let Data::I64(values) = &self.get("token")?.data else { bail!("tensor token is not I64") };
        let token = |&value: &i64| u32::try_from(value).ok().filter(|&token| (token as usize) < n_behaviours);
        values
            .iter()
            .map(|value| {
                token(value).with_context(|| format!("token {value} with {n_behaviours} behaviours"))
            })
            .collect()
    }

    /// Observation rows [B, frames·beams + 4]: `laser` (oldest frame first), `goal`, `velocity`.
    pub(crate) fn observations(&self) -> Result<Observations> {
        let shape = &self.get("laser")?.shape;
        let &[batch, frames, beams] = shape.as_slice() else {
            bail!("laser has shape {shape:?}, not [B, frames, beams]")
        };
        let (laser, goal, velocity) = (self.f32("laser")?, self.f32("goal")?, self.f32("velocity")?);
        if goal.len() != 2 * batch || velocity.len() != 2 * batch {
            bail!("goal or velocity is not [{batch}, 2]");
        }
        let mut rows = Vec::with_capacity(batch * (frames * beams + 4));
        for row in 0..batch {
            rows.extend_from_slice(&laser[row * frames * beams..(row + 1) * frames * beams]);
            rows.extend_from_slice(&goal[2 * row..2 * row + 2]);
            rows.extend_from_slice(&velocity[2 * row..2 * row + 2]);
        }
        Ok(Observations { batch, frames, beams, rows })
    }

    /// Pairs [B, 2] of a tensor.
    pub(crate) fn pairs(&self, name: &str, batch: usize) -> Result<Vec<[f32; 2]>> {
        let values = self.f32(name)?;
        if values.len() != 2 * batch {
            bail!("{name} has {} values, not [{batch}, 2]", values.len());
        }
        Ok(values.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect())
    }
}

/// A batch of observation rows.
pub(crate) struct Observations {
    pub(crate) batch: usize,
    pub(crate) frames: usize,
    pub(crate) beams: usize,
    pub(crate) rows: Vec<f32>,
}

fn words<const N: usize, T>(bytes: &[u8], from: fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|&word| from(word)).collect()
}
