//! Damage to bytes: flips, cuts, repetitions, lies about lengths, numbers out of any range, deep
//! nesting.

use jostle_sim::StreamRng;
use rand::RngExt as _;

/// Pieces that parsers stumble over.
const PIECES: [&str; 24] = [
    "0",
    "-1",
    "1e309",
    "-1e309",
    "nan",
    "inf",
    "4294967296",
    "18446744073709551616",
    "9223372036854775807",
    "1e-400",
    "0.1e38",
    "3.5e38",
    "\"",
    "[",
    "{",
    "\n",
    "\r",
    "\0",
    "#",
    "=",
    "null",
    "true",
    "\u{202e}\u{1b}[2J",
    "%s/../..",
];
/// Brackets and keys that are repeated to nest.
const NESTS: [&str; 6] = ["[", "{\"a\":", "[[", "a.", "a={", "[a."];
/// Little- and big-endian lengths at the borders.
const LENGTHS: [u64; 9] =
    [0, 1, 7, 0x7f, 0xffff, 0x7fff_ffff, 0xffff_ffff, 0x7fff_ffff_ffff_ffff, 0xffff_ffff_ffff_ffff];

/// Damages `bytes` in one to four places.
pub(super) fn mutate(bytes: &mut Vec<u8>, rng: &mut StreamRng) {
    for _ in 0..rng.random_range(1..=4) {
        once(bytes, rng);
    }
}

/// Damages a text; what is no longer UTF-8 is replaced.
pub(super) fn mutate_text(text: &str, rng: &mut StreamRng) -> String {
    let mut bytes = text.as_bytes().to_vec();
    mutate(&mut bytes, rng);
    String::from_utf8_lossy(&bytes).into_owned()
}

fn once(bytes: &mut Vec<u8>, rng: &mut StreamRng) {
    let at = rng.random_range(0..=bytes.len());
    let some = |rng: &mut StreamRng, most: usize| rng.random_range(0..=most);
    let end = at + some(rng, (bytes.len() - at).min(64));
    match rng.random_range(0..12_u32) {
        0 | 1 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << rng.random_range(0..8);
            }
        }
        2 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte = rng.random();
            }
        }
        3 => bytes.truncate(at),
        4 => drop(bytes.drain(at..end)),
        5 => {
            let copy = bytes[at..end].to_vec();
            let to = some(rng, bytes.len());
            bytes.splice(to..to, copy);
        }
        6 => {
            let piece = PIECES[rng.random_range(0..PIECES.len())];
            bytes.splice(at..end.min(at + some(rng, 8)), piece.bytes());
        }
        7 | 8 => replace_number(bytes, at, rng),
        9 => {
            let length = LENGTHS[rng.random_range(0..LENGTHS.len())];
            let four = rng.random::<bool>();
            let raw = if rng.random() { length.to_le_bytes() } else { length.to_be_bytes() };
            let raw = if four { &raw[raw.len() / 2..] } else { &raw[..] };
            let at = if rng.random() { 0 } else { at };
            for (byte, new) in bytes.iter_mut().skip(at).zip(raw) {
                *byte = *new;
            }
        }
        10 => {
            let nest = NESTS[rng.random_range(0..NESTS.len())].repeat(1 << rng.random_range(0..17_u32));
            bytes.splice(at..at, nest.into_bytes());
        }
        _ => {
            let line = vec![rng.random_range(32..127_u8); 1 << rng.random_range(0..18_u32)];
            bytes.splice(at..at, line);
        }
    }
}

/// Puts another number where a number stands, at or after `at`.
fn replace_number(bytes: &mut Vec<u8>, at: usize, rng: &mut StreamRng) {
    let is_part = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
    let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else {
        return;
    };
    let end = start + bytes[start..].iter().take_while(|byte| is_part(byte)).count();
    let number = match rng.random_range(0..4_u32) {
        0 => PIECES[rng.random_range(0..12_usize)].to_owned(),
        1 => rng.random_range(-10_i64..1000).to_string(),
        2 => (rng.random_range(-40.0..40.0_f64).exp2() * if rng.random() { 1.0 } else { -1.0 }).to_string(),
        _ => "9".repeat(rng.random_range(1..400)),
    };
    bytes.splice(start..end, number.into_bytes());
}
