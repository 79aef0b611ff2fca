//! Every product on every instruction set against sums in double precision, at odd sizes.

use super::*;
use std::io::Write as _;

/// A fixed, irregular sequence in −1 … 1.
pub(super) fn values(len: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12345);
    (0..len)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn assert_near(found: f32, expected: f64) {
    assert!((f64::from(found) - expected).abs() <= 2e-6 * (1.0 + expected.abs()), "{found} {expected}");
}

fn check_rows<const ROW: usize>(
    isa: Isa,
    rows: usize,
    blocks: usize,
    block_len: usize,
    mode: usize,
) -> Vec<u32> {
    let block_stride = rows * ROW + 7;
    let a = values(rows * ROW + blocks * (block_stride + block_len), 1);
    let panel = values(blocks * block_len * PANEL, 2);
    let bias = values(PANEL, 3);
    let (row, half) = if mode == 0 { (PANEL, HALF) } else { (19, 19 * rows + 3) };
    let mut out = values((rows + 1) * row.max(PANEL) + half, 4);
    let before = out.clone();
    let mask_data = values(out.len(), 5);
    let mask = Grid { data: &mask_data[..], row, half };
    let strips = Strips { data: &a, blocks, block_len, block_stride };
    let start = [Start::Zero, Start::Bias(&bias), Start::Accumulate][mode];
    let finish = [Finish::Store, Finish::Relu, Finish::Mask(mask)][mode];
    rows_times_panel::<ROW>(isa, rows, strips, &panel, start, finish, Grid { data: &mut out, row, half });
    let mut expected: Vec<f64> = before.iter().map(|value| f64::from(*value)).collect();
    for m in 0..rows {
        for n in 0..PANEL {
            let at = m * row + n / HALF * half + n % HALF;
            let mut sum = [0.0, f64::from(bias[n]), f64::from(before[at])][mode];
            for k in 0..blocks * block_len {
                let x = a[m * ROW + k / block_len * block_stride + k % block_len];
                sum += f64::from(x) * f64::from(panel[k * PANEL + n]);
            }
            expected[at] = [sum, sum.max(0.0), if mask_data[at] > 0.0 { sum } else { 0.0 }][mode];
        }
    }
    out.iter().zip(expected).for_each(|(found, expected)| assert_near(*found, expected));
    out.iter().map(|value| value.to_bits()).collect()
}

/// Calls `check` for every instruction set; those that fuse multiply-adds must give the same bits.
fn on_all_sets(check: impl Fn(Isa) -> Vec<u32>) {
    let results = Isa::available().into_iter().map(|isa| (isa, check(isa)));
    let fused: Vec<_> = results.filter(|(isa, _)| isa.is_fused()).collect();
    if fused.len() < 2 {
        let names: Vec<&str> = fused.iter().map(|(isa, _)| isa.name()).collect();
        let _ = writeln!(
            std::io::stderr(),
            "skip: bits of two sets of instructions are not compared: this processor has {names:?}"
        );
    }
    for pair in fused.windows(2) {
        assert!(pair[0].1 == pair[1].1, "{} and {} have other bits", pair[0].0.name(), pair[1].0.name());
    }
}

#[test]
fn rows_times_panel_is_the_product() {
    for rows in [1, 2, 5, 13, 14, 15, 29, 67] {
        for mode in 0..3 {
            on_all_sets(|isa| check_rows::<2>(isa, rows, 3, 5, mode));
            on_all_sets(|isa| check_rows::<16>(isa, rows, 4, 16, mode));
            // More steps than AVX2 takes at once.
            on_all_sets(|isa| check_rows::<16>(isa, rows, 9, 16, mode));
            on_all_sets(|isa| check_rows::<32>(isa, rows, 1, 64, mode));
            on_all_sets(|isa| check_rows::<64>(isa, rows, 1, 96, mode));
        }
    }
}

fn check_outer(isa: Isa, rows: usize, count: Count, accumulate: bool) -> Vec<u32> {
    let Count { segments, steps } = count;
    let (a_step, b_step, b_half) = (rows + 1, 37, 18);
    let (a_segment, b_segment) = (steps * a_step + 3, steps * b_step + 5);
    let (a, b) = (values(segments * a_segment + rows, 1), values(segments * b_segment + 64, 2));
    let mut out = values(rows * PANEL + 3, 3);
    let before = out.clone();
    let left = Steps { data: &a, step: a_step, segment: a_segment, half: 0 };
    let right = Steps { data: &b, step: b_step, segment: b_segment, half: b_half };
    outer_products(isa, rows, count, left, right, accumulate, &mut out);
    for at in 0..out.len() {
        let (m, n) = (at / PANEL, at % PANEL);
        let mut sum = if accumulate || m >= rows { f64::from(before[at]) } else { 0.0 };
        for k in 0..if m < rows { segments * steps } else { 0 } {
            let (segment, step) = (k / steps, k % steps);
            let y = b[segment * b_segment + step * b_step + n / HALF * b_half + n % HALF];
            sum += f64::from(a[segment * a_segment + step * a_step + m]) * f64::from(y);
        }
        assert_near(out[at], sum);
    }
    out.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn outer_products_are_summed() {
    for rows in [1, 4, 5, 8, 15, 16, 96] {
        for (segments, steps, accumulate) in [(1, 1, false), (1, 17, true), (3, 6, true), (2, 5, false)] {
            on_all_sets(|isa| check_outer(isa, rows, Count { segments, steps }, accumulate));
        }
    }
}

#[test]
#[should_panic(expected = "left operand")]
fn a_short_operand_is_refused() {
    let a = Strips { data: &[0.0; 31], blocks: 1, block_len: 16, block_stride: 0 };
    let out = Grid { data: &mut [0.0; 64][..], row: PANEL, half: HALF };
    rows_times_panel::<16>(Isa::detect(), 2, a, &[0.0; 512], Start::Zero, Finish::Store, out);
}
