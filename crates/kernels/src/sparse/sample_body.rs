//! conv2 for registers of any width, compiled once for each instruction set.

/// The functions `mask_rows`, `sample_forward`, `sample_input_gradient` and
/// `sample_weight_gradient` for one set, with its features. In scope at the call is what
/// [`span_products`](super::span_body::span_products) leaves there.
macro_rules! sample_products {
    ($(#[$feature:meta])?) => {
        use crate::sparse::operands::{SampleForward, SampleGradient, WINDOW, WINDOW_STEP};

        /// Registers of a row of channels.
        const ROW: usize = PANEL / LANES;
        /// Registers of a window.
        const WINDOW_REGISTERS: usize = WINDOW / LANES;

        /// Sets a bit for each value of rows of 32 that is not zero; returns how many there are.
        ///
        /// # Safety
        ///
        /// The instruction set.
        $(#[$feature])?
        pub(super) unsafe fn mask_rows(rows: &[[f32; PANEL]], masks: &mut [u32]) -> u32 {
            let mut kept = 0;
            for (row, mask) in rows.iter().zip(masks) {
                *mask = 0;
                for i in 0..ROW {
                    // SAFETY: a row is `ROW` registers.
                    let values = unsafe { lanes::load(row.as_ptr().add(i * LANES)) };
                    *mask |= (lanes::not_zero(values) as u32) << (i * LANES);
                }
                kept += mask.count_ones();
            }
            kept
        }

        /// [`SampleForward::run_if_few`] for rows with these masks.
        ///
        /// # Safety
        ///
        /// The instruction set, and operands as long as `run_if_few` checks.
        $(#[$feature])?
        pub(super) unsafe fn sample_forward(sample: &mut SampleForward<'_>, masks: &[u32]) {
            let (input, weights, bias) = (sample.input.as_ptr(), sample.weights.as_ptr(), sample.bias.as_ptr());
            let (out, row, half) = (sample.out.data.as_mut_ptr(), sample.out.row, sample.out.half);
            let of_kernel = |kernel: usize| -> [*const f32; ROW] {
                std::array::from_fn(|i| weights.wrapping_add(kernel * PANEL * PANEL + i * LANES))
            };
            let ([first, second, third], positions) = ([0, 1, 2].map(of_kernel), masks.len() / 2);
            let both: [*const f32; 2 * ROW] =
                std::array::from_fn(|i| if i < ROW { third[i] } else { first[i - ROW] });
            let (masks, last) = (masks.chunks_exact(2), masks[2 * positions]);
            // SAFETY: rows of 32 values, kernels of 32 × 32 weights and positions are among those
            // checked.
            unsafe {
                let bias: [V; ROW] = std::array::from_fn(|i| lanes::load(bias.add(i * LANES)));
                let store = |position: usize, sums: [V; ROW]| {
                    for (i, sum) in sums.into_iter().enumerate() {
                        let to = out.add(position * row + register_offset(i, LANES, half));
                        lanes::store(to, lanes::relu(sum));
                    }
                };
                let of_row = |row: usize| move |k: usize| input.wrapping_add(row * PANEL + k);
                let mut sums = bias;
                for (position, mask) in masks.enumerate() {
                    let even: [V; 2 * ROW] =
                        std::array::from_fn(|i| if i < ROW { sums[i] } else { bias[i - ROW] });
                    let even = add::<{ 2 * ROW }, PANEL>(even, u64::from(mask[0]), of_row(2 * position), both);
                    if position > 0 {
                        store(position - 1, std::array::from_fn(|i| even[i]));
                    }
                    let own = std::array::from_fn(|i| even[ROW + i]);
                    sums = add::<ROW, PANEL>(own, u64::from(mask[1]), of_row(2 * position + 1), second);
                }
                let sums = add::<ROW, PANEL>(sums, u64::from(last), of_row(2 * positions), third);
                store(positions - 1, sums);
            }
        }

        /// [`SampleGradient::input_gradient`].
        ///
        /// # Safety
        ///
        /// The instruction set, and operands as long as `input_gradient` checks.
        $(#[$feature])?
        pub(super) unsafe fn sample_input_gradient(
            sample: &SampleGradient<'_>,
            transposed: &[f32],
            d_input: &mut [f32],
            rows: usize,
        ) {
            let (d_out, input, d_input) = (sample.d_out.as_ptr(), sample.input.as_ptr(), d_input.as_mut_ptr());
            let weights = transposed.as_ptr();
            // Kernel indices 0, 1, 2 lie behind one another as 2, 0, 1.
            let partners: [*const f32; WINDOW_REGISTERS] = std::array::from_fn(|i| {
                weights.wrapping_add((i / ROW + 1) % 3 * PANEL * PANEL + i % ROW * LANES)
            });
            let store = |row: usize, sums: [V; ROW]| {
                for (i, sum) in sums.into_iter().enumerate() {
                    let at = row * PANEL + i * LANES;
                    // SAFETY: rows up to `rows` of both are checked.
                    unsafe {
                        lanes::store(d_input.add(at), lanes::keep_positive(lanes::load(input.add(at)), sum));
                    }
                }
            };
            let positions = &sample.masks.positions;
            let mut waiting = [lanes::zero(); ROW];
            for (position, mask) in positions.iter().enumerate() {
                let d_out = d_out.wrapping_add(position * PANEL);
                let sums = std::array::from_fn(|i| if i < ROW { waiting[i] } else { lanes::zero() });
                // SAFETY: a position has 32 output gradients, each kernel index 32 × 32 weights.
                let sums = unsafe {
                    add::<WINDOW_REGISTERS, PANEL>(sums, u64::from(*mask), |k| d_out.wrapping_add(k), partners)
                };
                if position > 0 {
                    store(2 * position, std::array::from_fn(|i| sums[i]));
                }
                store(2 * position + 1, std::array::from_fn(|i| sums[ROW + i]));
                waiting = std::array::from_fn(|i| sums[2 * ROW + i]);
            }
            if rows == 2 * positions.len() {
                store(rows, waiting);
            }
        }

        /// [`SampleGradient::add_weight_gradient`].
        ///
        /// # Safety
        ///
        /// The instruction set, and operands as long as `add_weight_gradient` checks.
        $(#[$feature])?
        pub(super) unsafe fn sample_weight_gradient(
            sample: &SampleGradient<'_>,
            sums: &mut [f32],
            gradient: &mut [f32],
        ) {
            let parts = &sample.masks.channels;
            for (part, masks) in parts.iter().enumerate() {
                let first = part * SPAN;
                let input = sample.input.as_ptr().wrapping_add(first * WINDOW_STEP);
                let partners = std::array::from_fn(|i| input.wrapping_add(i * LANES));
                for (channel, mask) in masks.iter().enumerate() {
                    // SAFETY: a part has bits for the sample's positions only; sums and gradient
                    // have a window for each channel.
                    unsafe {
                        let d_out = sample.d_out.as_ptr().add(first * PANEL + channel);
                        let own = sums.as_mut_ptr().add(channel * WINDOW);
                        let load = |from: *mut f32| -> [V; WINDOW_REGISTERS] {
                            std::array::from_fn(|i| lanes::load(from.add(i * LANES)))
                        };
                        let before = if part == 0 { [lanes::zero(); WINDOW_REGISTERS] } else { load(own) };
                        let value = |k: usize| d_out.wrapping_add(k * PANEL);
                        let mut after = add::<WINDOW_REGISTERS, WINDOW_STEP>(before, *mask, value, partners);
                        let mut to = own;
                        if part + 1 == parts.len() {
                            to = gradient.as_mut_ptr().add(channel * WINDOW);
                            let before = load(to);
                            after = std::array::from_fn(|i| lanes::add(before[i], after[i]));
                        }
                        for (i, sum) in after.into_iter().enumerate() {
                            lanes::store(to.add(i * LANES), sum);
                        }
                    }
                }
            }
        }
    };
}
pub(super) use sample_products;
