//! Damage below a checksum: what a random flip in a checkpoint or a PNG would never get past.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result};
use jostle_policy::{TensorFile, TensorOut, Values, write_tensors};
use jostle_sim::StreamRng;
use rand::RngExt as _;

use super::mutate::{mutate, mutate_text};

/// A safetensors file in parts.
pub(super) struct Archive {
    tensors: Vec<(String, Vec<usize>, Content)>,
    metadata: BTreeMap<String, String>,
}

#[derive(Clone)]
enum Content {
    Floats(Vec<f32>),
    Blob(Vec<u8>),
}

impl Archive {
    /// The parts of a file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let file = TensorFile::read(path)?;
        let mut tensors = Vec::new();
        for name in file.names() {
            let shape = file.shape(name)?.to_vec();
            let content = match file.f32s(name, &shape) {
                Ok(values) => Content::Floats(values),
                Err(_) => Content::Blob(file.raw(name)?.1.to_vec()),
            };
            tensors.push((name.to_owned(), shape, content));
        }
        Ok(Self { tensors, metadata: file.metadata().clone() })
    }

    /// Writes a damaged copy with a checksum that holds. False where the writer itself refuses it.
    pub(super) fn write_damaged(&self, path: &Path, rng: &mut StreamRng) -> bool {
        let mut metadata = self.metadata.clone();
        let mut tensors = self.tensors.clone();
        for _ in 0..rng.random_range(1..=3) {
            match rng.random_range(0..6_u32) {
                0..3 => damage_metadata(&mut metadata, rng),
                _ => damage_tensor(&mut tensors, rng),
            }
        }
        let out: Vec<TensorOut<'_>> = tensors
            .iter()
            .map(|(name, shape, content)| TensorOut {
                name: name.clone(),
                shape: shape.clone(),
                values: match content {
                    Content::Floats(values) => Values::F32(values),
                    Content::Blob(bytes) => Values::U8(bytes),
                },
            })
            .collect();
        write_tensors(path, &out, &metadata).is_ok()
    }
}

fn damage_metadata(metadata: &mut BTreeMap<String, String>, rng: &mut StreamRng) {
    let keys: Vec<String> = metadata.keys().cloned().collect();
    let key = &keys[rng.random_range(0..keys.len())];
    let value = mutate_text(&metadata[key], rng);
    // A configuration that is valid but another needs its own hash to be believed.
    if key == "config"
        && let Ok(config) = jostle_ppo::Config::parse(&value, "config", &[] as &[&str])
    {
        metadata.insert("config_hash".to_owned(), config.hash());
    }
    if rng.random_ratio(1, 20) {
        metadata.remove(key);
    } else {
        metadata.insert(key.clone(), value);
    }
}

fn damage_tensor(tensors: &mut Vec<(String, Vec<usize>, Content)>, rng: &mut StreamRng) {
    if tensors.is_empty() {
        return;
    }
    let blobs: Vec<usize> =
        (0..tensors.len()).filter(|i| matches!(tensors[*i].2, Content::Blob(_))).collect();
    let any = rng.random_range(0..tensors.len());
    let chosen = if blobs.is_empty() || rng.random() { any } else { blobs[rng.random_range(0..blobs.len())] };
    let (name, shape, content) = &mut tensors[chosen];
    match (rng.random_range(0..8_u32), content) {
        (0, _) => drop(tensors.remove(chosen)),
        (1, _) => *name = mutate_text(name, rng),
        (2, _) => shape.reverse(),
        (3, _) => shape.push(1),
        (_, Content::Blob(bytes)) => {
            mutate(bytes, rng);
            *shape = vec![bytes.len()];
        }
        (_, Content::Floats(values)) => {
            let scale = rng.random_range(-140.0..127.0_f32).exp2();
            for value in values.iter_mut().skip(rng.random_range(0..64)).step_by(rng.random_range(1..64)) {
                *value = (*value * scale).clamp(f32::MIN, f32::MAX);
            }
        }
    }
}

/// Damages a PNG; mostly inside its chunks, whose checksums are then made to hold again.
pub(super) fn damage_png(bytes: &[u8], rng: &mut StreamRng) -> Result<Vec<u8>> {
    const SIGNATURE: usize = 8;
    let mut damaged = bytes.to_vec();
    if rng.random_ratio(1, 4) {
        mutate(&mut damaged, rng);
        return Ok(damaged);
    }
    let mut out = bytes[..SIGNATURE].to_vec();
    let mut rest = &bytes[SIGNATURE..];
    while rest.len() >= 12 {
        let length = u32::from_be_bytes(rest[..4].try_into().context("four bytes")?) as usize;
        let mut chunk = rest[4..8 + length].to_vec();
        if rng.random_ratio(1, 2) {
            let mut data = chunk.split_off(4);
            if &chunk == b"IHDR" && rng.random() {
                let field = rng.random_range(0..data.len());
                data[field] = [0, 1, 2, 3, 4, 6, 8, 16, 255][rng.random_range(0..9_usize)];
            } else {
                mutate(&mut data, rng);
            }
            chunk.extend(data);
        }
        out.extend((chunk.len() as u32 - 4).to_be_bytes());
        out.extend(&chunk);
        out.extend(crc32(&chunk).to_be_bytes());
        rest = &rest[12 + length..];
    }
    Ok(out)
}

/// CRC-32 as PNG defines it (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _: u32| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step))
}

#[cfg(test)]
mod tests {
    use super::crc32;

    #[test]
    fn the_check_value_of_crc_32() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }
}
