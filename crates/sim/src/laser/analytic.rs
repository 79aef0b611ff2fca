//! Closed forms for a beam against walls, faces and discs, eight beams at a time.
//!
//! Plain array code: the compiler turns each loop over eight lanes into vector instructions of
//! whatever width it may use. Only IEEE additions, multiplications, divisions and roots occur, none
//! fused, so every width gives the same bits.
//!
//! A beam meets a face when it lies between its two ends: 0 ≤ right × d and 0 ≤ d × left.
//! Neighbouring faces share an end and so the very same product: no beam slips between them. The
//! range is interpolated between the ends, which keeps it bounded even for a face seen edge-on,
//! where dividing by the angle of incidence does not.
// A kernel must be inlined into the function that is compiled for a CPU feature, or it is compiled
// without it.
#![allow(clippy::inline_always)]
// A lazy `&&` is a branch; a kernel wants none.
#![allow(clippy::needless_bitwise_bool)]

use super::span::Span;
use super::targets::{Disc, Edge, NOTHING, Targets, WALL, WallsInFrame, decode};
use super::{Chunk, Directions, Hit, LANES};
use std::ops::Range;

/// Ranges of eight beams to the walls.
///
/// # Formula
///
/// With the beam's world direction (wx, wy) and the distances hx, hy to the faces ahead: min(hx /
/// |wx|, hy / |wy|), the smaller chosen by hx·|wy| < hy·|wx|, so that one division does.
#[inline(always)]
fn walls_chunk(walls: &WallsInFrame, x: &Chunk, y: &Chunk, range: f32, out: &mut Chunk) {
    let (cos, sin) = (walls.rotation.x, walls.rotation.y);
    for k in 0..LANES {
        let (wx, wy) = (cos * x[k] - sin * y[k], sin * x[k] + cos * y[k]);
        let hx = if wx > 0.0 { walls.to_max.x } else { walls.to_min.x };
        let hy = if wy > 0.0 { walls.to_max.y } else { walls.to_min.y };
        let (ax, ay) = (wx.abs(), wy.abs());
        let x_first = hx * ay < hy * ax;
        let t = if x_first { hx } else { hy } / if x_first { ax } else { ay };
        out[k] = if t < range { t } else { range };
    }
}

/// Shortens eight ranges by a face, and notes whose it is.
#[inline(always)]
fn edge_chunk(edge: &Edge, x: &Chunk, y: &Chunk, ranges: &mut Chunk, codes: Option<&mut [u32; LANES]>) {
    let (right, left, along) = (edge.right, edge.left, edge.left - edge.right);
    let mut t = [0.0; LANES];
    for k in 0..LANES {
        let from_right = right.x * y[k] - right.y * x[k];
        let from_left = x[k] * left.y - y[k] * left.x;
        let part = from_right / (from_right + from_left);
        let at = (x[k] * right.x + y[k] * right.y) + part * (x[k] * along.x + y[k] * along.y);
        t[k] = if (from_right >= 0.0) & (from_left >= 0.0) { at } else { f32::INFINITY };
    }
    shorten(&t, edge.code, ranges, codes);
}

/// Shortens eight ranges by a disc, and notes whose it is.
///
/// # Formula
///
/// With b = d·c and q = d × c: t = b − √((r − q)(r + q)), for b > 0 and |q| ≤ r.
#[inline(always)]
fn disc_chunk(disc: &Disc, x: &Chunk, y: &Chunk, ranges: &mut Chunk, codes: Option<&mut [u32; LANES]>) {
    let (centre, radius) = (disc.centre, disc.radius);
    let mut t = [0.0; LANES];
    for k in 0..LANES {
        let ahead = x[k] * centre.x + y[k] * centre.y;
        let beside = x[k] * centre.y - y[k] * centre.x;
        let chord_sq = (radius - beside) * (radius + beside);
        let at = ahead - chord_sq.max(0.0).sqrt();
        t[k] = if (chord_sq >= 0.0) & (ahead > 0.0) { at } else { f32::INFINITY };
    }
    shorten(&t, disc.code, ranges, codes);
}

/// Takes the smaller of two ranges per lane; NaN (a beam without a direction) never wins.
#[inline(always)]
fn shorten(t: &Chunk, code: u32, ranges: &mut Chunk, codes: Option<&mut [u32; LANES]>) {
    if let Some(codes) = codes {
        for k in 0..LANES {
            codes[k] = if t[k] < ranges[k] { code } else { codes[k] };
        }
    }
    for k in 0..LANES {
        ranges[k] = if t[k] < ranges[k] { t[k] } else { ranges[k] };
    }
}

/// The chunks of a span as two runs; a closure per chunk would not inherit the caller's CPU
/// features.
#[inline(always)]
fn runs(span: Span, n: usize) -> [Range<usize>; 2] {
    let (first, last) = (span.first as usize, span.last as usize);
    if first <= last { [first..last + 1, 0..0] } else { [first..n, 0..last + 1] }
}

/// Casts all beams; returns the least range.
///
/// # Shapes
///
/// `ranges`: one chunk per chunk of `directions`; the fill-up beams of the last chunk read the
/// laser's range.
#[inline(always)]
pub(super) fn cast(directions: &Directions, targets: &Targets, ranges: &mut [Chunk]) -> f32 {
    let (x, y) = (&directions.x[..], &directions.y[..]);
    let n = ranges.len();
    assert!(x.len() == n && y.len() == n);
    if targets.around.is_some() {
        ranges.fill([0.0; LANES]);
        return 0.0;
    }
    match &targets.walls {
        Some(walls) => {
            for ((x, y), out) in x.iter().zip(y).zip(ranges.iter_mut()) {
                walls_chunk(walls, x, y, targets.range, out);
            }
        }
        None => ranges.fill([targets.range; LANES]),
    }
    for edge in &targets.edges {
        for run in runs(edge.span, n) {
            for i in run {
                edge_chunk(edge, &x[i], &y[i], &mut ranges[i], None);
            }
        }
    }
    for disc in &targets.discs {
        for run in runs(disc.span, n) {
            for i in run {
                disc_chunk(disc, &x[i], &y[i], &mut ranges[i], None);
            }
        }
    }
    let mut least = [targets.range; LANES];
    for chunk in ranges.iter() {
        for k in 0..LANES {
            least[k] = if chunk[k] < least[k] { chunk[k] } else { least[k] };
        }
    }
    least.into_iter().fold(targets.range, f32::min)
}

/// Casts one chunk with codes: the same arithmetic as [`cast`].
fn cast_chunk(directions: &Directions, targets: &Targets, i: usize) -> (Chunk, [u32; LANES]) {
    let (x, y) = (&directions.x[i], &directions.y[i]);
    let (mut ranges, mut codes) = ([targets.range; LANES], [NOTHING; LANES]);
    if let Some(code) = targets.around {
        return ([0.0; LANES], [code; LANES]);
    }
    if let Some(walls) = &targets.walls {
        walls_chunk(walls, x, y, targets.range, &mut ranges);
        codes = ranges.map(|t| if t < targets.range { WALL } else { NOTHING });
    }
    for edge in targets.edges.iter().filter(|edge| edge.span.holds(i)) {
        edge_chunk(edge, x, y, &mut ranges, Some(&mut codes));
    }
    for disc in targets.discs.iter().filter(|disc| disc.span.holds(i)) {
        disc_chunk(disc, x, y, &mut ranges, Some(&mut codes));
    }
    (ranges, codes)
}

/// Casts all beams with codes.
pub(super) fn cast_codes(
    directions: &Directions,
    targets: &Targets,
    ranges: &mut [Chunk],
    codes: &mut [[u32; LANES]],
) {
    for (i, (ranges, codes)) in ranges.iter_mut().zip(codes).enumerate() {
        (*ranges, *codes) = cast_chunk(directions, targets, i);
    }
}

/// The thing that one beam meets.
pub(super) fn identify(directions: &Directions, targets: &Targets, beam: usize) -> Hit {
    let (_, codes) = cast_chunk(directions, targets, beam / LANES);
    decode(codes[beam % LANES])
}
