//! Actor and critic: the backward pass.
//!
//! First chunk by chunk, from the outputs to the scans: the gradient of every layer's input, masked
//! by the ReLU in front of it as it is written, and the gradients of convolutions and embedding,
//! which each chunk sums for itself. Then, over the whole batch, the weight gradients of the linear
//! layers; last the chunks' sums are added in the order of the chunks.

use jostle_kernels::{BLOCK, Chunks, Finish, Grid, HALF, PANEL, for_each_piece};

use super::conv::{ConvParts, Convolutions};
use super::network::{FastNetwork, Pool, Scratch};
use crate::config::CONV2_KERNEL;
use crate::observation::TAIL_LEN;

/// Floats between the rows of a chunk's gradient beyond its features, so that rows do not share
/// sets of the cache.
const ROW_GAP: usize = 2 * BLOCK;

/// One chunk's memory in a backward pass.
struct BackwardPart<'a> {
    chunk: usize,
    d_y: &'a mut [f32],
    d_hidden: &'a mut [f32],
    d_feature: &'a mut [f32],
    partial: &'a mut [f32],
}

impl FastNetwork {
    pub(super) fn run_backward(&mut self, chunks: &Chunks, d_outputs: &[f32]) {
        self.refresh_transposed();
        let conv_len = self.conv_len();
        let partial_len =
            (conv_len + self.config.n_behaviours * self.config.embedding).next_multiple_of(BLOCK);
        let [padded, hidden, feature] = [self.head.padded(), self.fc2.outputs(), self.fc1.outputs()]
            .map(|features| chunks.chunk_len(features));
        let mut memory = std::mem::take(&mut self.memory);
        memory.d_y.reserve_len(chunks.count * padded);
        memory.d_hidden.reserve_len(chunks.count * hidden);
        memory.d_feature.reserve_len(chunks.count * feature);
        memory.partial.reserve_len(chunks.count * partial_len);
        let (x, concat, h) = (&memory.x[..], &memory.concat[..], &memory.hidden[..]);
        let (scans, outputs, tokens) = (&memory.scans[..], &memory.outputs[..], &memory.tokens[..]);
        let masks = &memory.masks[..];
        let kept = Kept { scans, x, masks, concat, hidden: h, outputs, tokens, d_outputs };
        let pool: &Pool = &self.pool;
        let slices = [
            (&mut memory.d_y[..], padded),
            (&mut memory.d_hidden[..], hidden),
            (&mut memory.d_feature[..], feature),
            (&mut memory.partial[..], partial_len),
        ];
        for_each_piece(chunks.count, slices, &|chunk, [d_y, d_hidden, d_feature, partial]| {
            let part = BackwardPart { chunk, d_y, d_hidden, d_feature, partial };
            pool.with(&self.conv, |scratch| self.chunk_backward(chunks, &kept, part, scratch));
        });

        let (isa, at) = (self.isa, self.at);
        let gradient = &mut self.gradient;
        let x = &x[..chunks.len(self.fc1.inputs())];
        let concat = &concat[..chunks.len(self.fc2.inputs())];
        let h = &h[..chunks.len(self.fc2.outputs())];
        let (d_y, d_hidden, d_feature) = (
            &memory.d_y[..chunks.count * padded],
            &memory.d_hidden[..chunks.count * hidden],
            &memory.d_feature[..chunks.count * feature],
        );
        let fc1 = &mut gradient[at.fc1_weight..];
        self.fc1.weight_gradient_behind_relu(isa, chunks, x, d_feature, fc1, &mut memory.columns);
        chunks.sum_rows(d_feature, self.fc1.outputs(), &mut gradient[at.fc1_bias..][..self.fc1.outputs()]);
        self.fc2.weight_gradient(isa, chunks, concat, d_hidden, &mut gradient[at.fc2_weight..]);
        chunks.sum_rows(d_hidden, self.fc2.outputs(), &mut gradient[at.fc2_bias..][..self.fc2.outputs()]);
        self.head.weight_gradient(isa, chunks, h, d_y, gradient);

        let embedding_len = self.config.n_behaviours * self.config.embedding;
        gradient[..conv_len].fill(0.0);
        gradient[at.embedding..][..embedding_len].fill(0.0);
        for partial in memory.partial.chunks_exact(partial_len).take(chunks.count) {
            add(&mut gradient[..conv_len], &partial[..conv_len]);
            add(&mut gradient[at.embedding..][..embedding_len], &partial[conv_len..]);
        }
        self.memory = memory;
    }

    /// Parameters of the convolutions: the start of the flat vector.
    fn conv_len(&self) -> usize {
        self.conv.weights1() + CONV2_KERNEL * PANEL * PANEL + 2 * PANEL
    }

    /// Transposes the weights if they have changed since.
    fn refresh_transposed(&mut self) {
        if !self.transposed.fresh {
            let weight2 = super::network::conv_parts(&self.conv, &self.parameters).weight2;
            Convolutions::transpose2(weight2, &mut self.transposed.conv2);
            let transposed = &mut self.transposed;
            self.fc1.transpose(self.isa, &self.parameters[self.at.fc1_weight..], &mut transposed.fc1);
            self.fc2.transpose(self.isa, &self.parameters[self.at.fc2_weight..], &mut transposed.fc2);
            transposed.fresh = true;
        }
    }

    /// One chunk, from the gradient of the outputs down to the convolutions.
    fn chunk_backward(
        &self,
        chunks: &Chunks,
        kept: &Kept<'_>,
        part: BackwardPart<'_>,
        scratch: &mut Scratch,
    ) {
        let BackwardPart { chunk, d_y, d_hidden, d_feature, partial } = part;
        let (isa, rows, first) = (self.isa, chunks.rows(chunk), chunks.first(chunk));
        let stride = chunks.block_stride();
        let of_chunk = |data, features| {
            let len = chunks.chunk_len(features);
            let data: &[f32] = data;
            &data[chunk * len..][..len]
        };
        let x = of_chunk(kept.x, self.fc1.inputs());
        let concat = of_chunk(kept.concat, self.fc2.inputs());
        let hidden = of_chunk(kept.hidden, self.fc2.outputs());

        d_y.fill(0.0);
        let n_outputs = self.activations.len();
        for row in 0..rows {
            for (idx, activation) in self.activations.iter().enumerate() {
                let at = (first + row) * n_outputs + idx;
                d_y[row * BLOCK + idx] = kept.d_outputs[at] * activation.slope(kept.outputs[at]);
            }
        }
        self.head.input_gradient(isa, chunks, rows, d_y, hidden, d_hidden);

        let tail_row = self.fc2.transposed_panels() * PANEL - self.fc1.outputs();
        scratch.d_tail.reserve_len(chunks.size * tail_row);
        for panel in 0..self.fc2.transposed_panels() {
            let at = panel * 2 * stride;
            let feature = panel * PANEL;
            let (finish, d_concat) = if feature < self.fc1.outputs() {
                let mask = Grid { data: &concat[at..], row: BLOCK, half: stride };
                (Finish::Mask(mask), Grid { data: &mut d_feature[at..], row: BLOCK, half: stride })
            } else {
                let d_tail = &mut scratch.d_tail[feature - self.fc1.outputs()..];
                (Finish::Store, Grid { data: d_tail, row: tail_row, half: HALF })
            };
            let transposed = &self.transposed.fc2;
            self.fc2.input_gradient(isa, transposed, panel, chunks, rows, d_hidden, finish, d_concat);
        }

        let x_row = self.fc1.inputs() + ROW_GAP;
        scratch.d_x.reserve_len(chunks.size * x_row);
        let masks = &kept.masks[self.masks_len(chunks) * chunk..];
        self.fc1.input_gradient_between_relus(
            isa,
            &self.transposed.fc1,
            chunks,
            rows,
            d_feature,
            x,
            masks,
            &mut scratch.d_x,
            x_row,
            &mut scratch.masks,
        );

        partial.fill(0.0);
        let (conv_gradient, embedding) = partial.split_at_mut(self.conv_len());
        let (weight1, rest) = conv_gradient.split_at_mut(self.conv.weights1());
        let (bias1, rest) = rest.split_at_mut(PANEL);
        let (weight2, bias2) = rest.split_at_mut(CONV2_KERNEL * PANEL * PANEL);
        let parameters = super::network::conv_parts(&self.conv, &self.parameters);
        let scans_len = self.conv.scans_len();
        let leave_out_zeros = self.fc1.inputs_are_few(chunks, rows, masks);
        for row in 0..rows {
            if leave_out_zeros {
                scratch
                    .conv
                    .masks
                    .set(masks[row..].iter().step_by(chunks.size).take(self.fc1.spans()).copied());
            }
            let width = self.config.embedding;
            let d_embedding = &scratch.d_tail[row * tail_row + TAIL_LEN..][..width];
            add(&mut embedding[kept.tokens[first + row] as usize * width..], d_embedding);
            let mut gradient = ConvParts {
                weight1: &mut *weight1,
                bias1: &mut *bias1,
                weight2: &mut *weight2,
                bias2: &mut *bias2,
            };
            let padded = &kept.scans[(first + row) * scans_len..][..scans_len];
            let d_out = &scratch.d_x[row * x_row..][..self.fc1.inputs()];
            let transposed = &self.transposed.conv2;
            self.conv.backward(
                isa,
                parameters,
                transposed,
                padded,
                d_out,
                leave_out_zeros,
                &mut scratch.conv,
                &mut gradient,
            );
        }
        if leave_out_zeros {
            Convolutions::take_weight2(&mut scratch.conv, weight2);
        }
    }
}

/// The memory that the forward pass kept for all chunks, and the gradient that comes in.
struct Kept<'a> {
    scans: &'a [f32],
    x: &'a [f32],
    masks: &'a [u64],
    concat: &'a [f32],
    hidden: &'a [f32],
    outputs: &'a [f32],
    tokens: &'a [u32],
    d_outputs: &'a [f32],
}

/// `to += from`, as far as the shorter goes.
fn add(to: &mut [f32], from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
}
