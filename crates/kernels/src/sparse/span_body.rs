//! Products of spans for registers of any width, compiled once for each instruction set.

/// Sums of 64 outputs for 64 inputs.
#[repr(align(64))]
pub(super) struct Square(pub(super) [[f32; super::operands::SPAN]; super::operands::SPAN]);

/// The functions `mask_row`, `mask_block`, `span_rows` and `span_gradient` for one set, with its
/// features. In scope at the call is `lanes`, the set's registers.
macro_rules! span_products {
    ($(#[$feature:meta])?) => {
        use crate::blocked::BLOCK;
        use crate::operands::{PANEL, Start, register_offset};
        use crate::sparse::operands::{After, QUARTERS, SPAN, SpanGradient, SpanProduct};
        use crate::sparse::span_body::Square;
        use lanes::{LANES, V};

        /// Registers of a span.
        const REGISTERS: usize = SPAN / LANES;

        /// The sums of a span.
        type Sums = [V; REGISTERS];

        /// [`mask_row`](crate::sparse::mask_row).
        ///
        /// # Safety
        ///
        /// The instruction set. For each mask, `x` has four blocks of 16 values, `block_stride`
        /// apart.
        $(#[$feature])?
        pub(super) unsafe fn mask_row<'a>(x: &[f32], block_stride: usize, masks: impl Iterator<Item = &'a mut u64>) {
            let mut x = x.as_ptr();
            for mask in masks {
                *mask = 0;
                for i in 0..REGISTERS {
                    // SAFETY: the caller's promise.
                    let values = unsafe { lanes::load(x.wrapping_add(register_offset(i, LANES, block_stride))) };
                    *mask |= lanes::not_zero(values) << (i * LANES);
                }
                x = x.wrapping_add(QUARTERS * block_stride);
            }
        }

        /// Sets bit i of a column's mask where row i is not zero there.
        ///
        /// # Safety
        ///
        /// The instruction set.
        $(#[$feature])?
        pub(super) unsafe fn mask_block(rows: &[[f32; BLOCK]], masks: &mut [u64; BLOCK]) {
            let mut own = [0; BLOCK];
            for (bit, row) in rows.iter().enumerate() {
                own.iter_mut().zip(row).for_each(|(mask, value)| *mask |= u64::from(*value != 0.0) << bit);
            }
            *masks = own;
        }

        /// Adds `value(k) · partner[k · STEP]` to the sums of each partner for all bits k of the
        /// mask, in their order.
        ///
        /// # Safety
        ///
        /// The instruction set; for each bit, `value(k)` can be read, and a register at each
        /// partner.
        #[inline]
        $(#[$feature])?
        unsafe fn add<const N: usize, const STEP: usize>(
            mut sums: [V; N],
            mut mask: u64,
            value: impl Fn(usize) -> *const f32,
            partners: [*const f32; N],
        ) -> [V; N] {
            while mask != 0 {
                let k = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                // SAFETY: the caller's promise.
                unsafe {
                    let value = lanes::broadcast(*value(k));
                    for (sum, partner) in sums.iter_mut().zip(partners) {
                        *sum = lanes::fma(value, lanes::load(partner.add(k * STEP)), *sum);
                    }
                }
            }
            sums
        }

        /// [`rows_times_span`](crate::sparse::rows_times_span).
        ///
        /// # Safety
        ///
        /// The instruction set, and operands as long as `rows_times_span` checks.
        $(#[$feature])?
        pub(super) unsafe fn span_rows(product: &mut SpanProduct<'_>) {
            let SpanProduct { x, block_stride, masks, panels, next, start, after, out } = product;
            let (x, start, after) = (x.as_ptr(), *start, *after);
            let base = out.data.as_mut_ptr();
            let partners = std::array::from_fn(|i| {
                panels[i * LANES / PANEL].as_ptr().wrapping_add(i * LANES % PANEL)
            });
            // From one block to the next, beyond its values.
            let gap = block_stride.wrapping_sub(BLOCK);
            // Lines of the next two panels that each row fetches: that hides the time that the
            // third-level cache takes.
            let ahead = (SPAN * PANEL / BLOCK).div_ceil(masks.len());
            for (row, mask) in masks.iter().enumerate() {
                for line in row * ahead..(row + 1) * ahead {
                    for next in &*next {
                        lanes::prefetch_far(next.as_ptr().wrapping_add(line * BLOCK));
                    }
                }
                // SAFETY: the caller has checked the operands.
                unsafe {
                    let c = base.add(row * out.row);
                    let sums: Sums = match start {
                        Start::Zero => [lanes::zero(); REGISTERS],
                        Start::Bias(bias) => {
                            std::array::from_fn(|i| lanes::load(bias.as_ptr().add(i * LANES)))
                        }
                        Start::Accumulate => {
                            std::array::from_fn(|i| lanes::load(c.add(register_offset(i, LANES, out.half))))
                        }
                    };
                    let x = x.add(row * BLOCK);
                    let value = |k: usize| x.wrapping_add(k.wrapping_add((k / BLOCK).wrapping_mul(gap)));
                    let sums = add::<REGISTERS, PANEL>(sums, *mask, value, partners);
                    for (i, mut sum) in sums.into_iter().enumerate() {
                        match after {
                            After::Store => {}
                            After::Relu => sum = lanes::relu(sum),
                            After::Keep(kept) => sum = lanes::keep(kept.get_unchecked(row) >> (i * LANES), sum),
                        }
                        lanes::store(c.add(register_offset(i, LANES, out.half)), sum);
                    }
                }
            }
        }

        /// [`span_gradient`](crate::sparse::span_gradient): 64 outputs at a time, chunk by chunk,
        /// so that a chunk's inputs (16 KB) stay in the first-level cache for 64 outputs; then rows
        /// of inputs are turned into rows of outputs.
        ///
        /// # Safety
        ///
        /// The instruction set, and operands as `span_gradient` checks.
        $(#[$feature])?
        pub(super) unsafe fn span_gradient(product: &mut SpanGradient<'_>) {
            let SpanGradient { chunks, outputs, dy, columns, x, x_chunk, panel_stride, .. } = *product;
            let stride = chunks.block_stride();
            let row = |square: &mut Square, output: usize| square.0[output].as_mut_ptr();
            let (mut run, mut total) = (Square([[0.0; SPAN]; SPAN]), Square([[0.0; SPAN]; SPAN]));
            for first in (0..outputs).step_by(SPAN) {
                let mut has_total = false;
                for chunk in 0..chunks.count {
                    let begins = chunks.begins_run(chunk);
                    let ends = chunk + 1 == chunks.count || chunks.begins_run(chunk + 1);
                    let x = x.as_ptr().wrapping_add(chunk * x_chunk);
                    let partners = std::array::from_fn(|i| x.wrapping_add(register_offset(i, LANES, stride)));
                    // Each output fetches its share of the next chunk's inputs: that hides the way
                    // from the second-level cache.
                    let next = x.wrapping_add(x_chunk);
                    for output in 0..SPAN {
                        let lines = SPAN / BLOCK;
                        let share = next.wrapping_add(output / BLOCK * stride + output % BLOCK * lines * BLOCK);
                        for line in 0..lines {
                            lanes::prefetch_near(share.wrapping_add(line * BLOCK));
                        }
                        let column = first + output;
                        let at = chunk * chunks.chunk_len(outputs) + column / BLOCK * stride + column % BLOCK;
                        let mask = columns[chunk * outputs + column];
                        // SAFETY: the rows that a mask has bits of are within the chunk; a row of a
                        // square is a span.
                        unsafe {
                            let load = |row: *mut f32| -> Sums {
                                std::array::from_fn(|i| lanes::load(row.add(i * LANES)))
                            };
                            let (run, total) = (row(&mut run, output), row(&mut total, output));
                            let sums = if begins { [lanes::zero(); REGISTERS] } else { load(run) };
                            let dy = dy.as_ptr().add(at);
                            let mut sums =
                                add::<REGISTERS, BLOCK>(sums, mask, |k| dy.wrapping_add(k * BLOCK), partners);
                            if ends && has_total {
                                let before = load(total);
                                sums = std::array::from_fn(|i| lanes::add(before[i], sums[i]));
                            }
                            let to = if ends { total } else { run };
                            for (i, sum) in sums.into_iter().enumerate() {
                                lanes::store(to.add(i * LANES), sum);
                            }
                        }
                    }
                    has_total |= ends;
                }
                for (of_outputs, of_inputs) in
                    (0..REGISTERS).flat_map(|outputs| (0..REGISTERS).map(move |inputs| (outputs, inputs)))
                {
                    let output = first + of_outputs * LANES;
                    let at = output / PANEL * panel_stride + of_inputs * LANES * PANEL + output % PANEL;
                    let sums: [V; LANES] = std::array::from_fn(|output| {
                        let row = &total.0[of_outputs * LANES + output];
                        // SAFETY: a row is a span.
                        unsafe { lanes::load(row.as_ptr().add(of_inputs * LANES)) }
                    });
                    for (input, sum) in lanes::transpose(&sums).into_iter().enumerate() {
                        // SAFETY: a span of inputs of every panel is within `gradient`.
                        unsafe { lanes::store(product.gradient.as_mut_ptr().add(at + input * PANEL), sum) }
                    }
                }
            }
        }
    };
}
pub(super) use span_products;
