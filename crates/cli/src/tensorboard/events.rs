//! TensorBoard's event file: protocol buffers (`Event`, `Summary`) in the TFRecord framing.
//!
//! A record is the length (u64), its masked CRC-32C (u32), the bytes, their masked CRC-32C; all
//! little-endian. An event has the fields 1 `wall_time` (double), 2 `step` (int64), 3
//! `file_version` (string), 5 `summary` (message); a summary has repeated 1 `value` with 1 `tag`
//! (string) and 2 `simple_value` (float).
//!
//! # References
//!
//! TensorFlow, `tensorflow/core/lib/io/record_writer.h`, `core/util/event.proto`,
//! `core/framework/summary.proto`; CRC-32C: RFC 3720, appendix B.4.

/// Wire types of protocol buffers.
const VARINT: u8 = 0;
const DOUBLE: u8 = 1;
const BYTES: u8 = 2;
const FLOAT: u8 = 5;

/// An event file in memory.
pub(crate) struct EventFile(Vec<u8>);

impl EventFile {
    /// A file with its version alone.
    pub(crate) fn new() -> Self {
        let mut event = Vec::new();
        double(&mut event, 1, 0.0);
        bytes(&mut event, 3, b"brain.Event:2");
        let mut file = Self(Vec::new());
        file.record(&event);
        file
    }

    /// Adds the scalars of a step.
    pub(crate) fn add(&mut self, wall_time: f64, step: u64, scalars: &[(&str, f32)]) {
        let mut summary = Vec::new();
        for (tag, value) in scalars {
            let mut entry = Vec::new();
            bytes(&mut entry, 1, tag.as_bytes());
            key(&mut entry, 2, FLOAT);
            entry.extend(value.to_le_bytes());
            bytes(&mut summary, 1, &entry);
        }
        let mut event = Vec::new();
        double(&mut event, 1, wall_time);
        key(&mut event, 2, VARINT);
        varint(&mut event, step);
        bytes(&mut event, 5, &summary);
        self.record(&event);
    }

    /// The file's bytes.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    fn record(&mut self, data: &[u8]) {
        let length = (data.len() as u64).to_le_bytes();
        self.0.extend(length);
        self.0.extend(masked(crc32c(&length)).to_le_bytes());
        self.0.extend(data);
        self.0.extend(masked(crc32c(data)).to_le_bytes());
    }
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value > 127 {
        out.push((value as u8 & 127) | 128);
        value >>= 7;
    }
    out.push(value as u8);
}

fn key(out: &mut Vec<u8>, field: u8, wire: u8) {
    out.push((field << 3) | wire);
}

fn double(out: &mut Vec<u8>, field: u8, value: f64) {
    key(out, field, DOUBLE);
    out.extend(value.to_le_bytes());
}

fn bytes(out: &mut Vec<u8>, field: u8, data: &[u8]) {
    key(out, field, BYTES);
    varint(out, data.len() as u64);
    out.extend(data);
}

/// CRC-32C (Castagnoli), bit by bit: event files are small.
fn crc32c(data: &[u8]) -> u32 {
    !data.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0x82F6_3B78 & (crc & 1).wrapping_neg()))
    })
}

/// TFRecord keeps its checksums rotated and shifted, so that a checksum of checksums is not weak.
fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xA282_EAD8)
}

#[cfg(test)]
mod tests {
    use super::{EventFile, crc32c, masked};

    #[test]
    fn the_checksum_of_rfc_3720() {
        assert_eq!(crc32c(b"123456789"), 0xE306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8A91_36AA);
        assert_eq!(masked(0xE306_9283), 0xC78A_B0E5);
    }

    #[test]
    fn the_first_record_is_the_one_that_tensorflow_writes() {
        let file = EventFile::new().into_bytes();
        assert_eq!(file[..8], 24_u64.to_le_bytes());
        assert_eq!(file[12..21], [0x09, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(&file[21..36], b"\x1a\x0dbrain.Event:2");
        assert_eq!(file.len(), 8 + 4 + 24 + 4);
    }

    #[test]
    fn a_step_of_two_bytes() {
        let head = EventFile::new().into_bytes().len();
        let mut file = EventFile::new();
        file.add(1.5, 300, &[("a", 2.0)]);
        let event = &file.into_bytes()[head + 12..];
        let expected = [
            0x09, 0, 0, 0, 0, 0, 0, 0xF8, 0x3F, // wall time 1.5
            0x10, 0xAC, 0x02, // step 300
            0x2A, 10, 0x0A, 8, 0x0A, 1, b'a', 0x15, 0, 0, 0, 0x40, // summary { value { tag "a", 2.0 } }
        ];
        assert_eq!(event[..expected.len()], expected);
    }
}
