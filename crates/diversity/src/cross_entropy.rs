//! Cross-entropy over behaviours: loss, gradient and accuracy from logits (Algorithm 1, lines
//! 23–24).
//!
//! Logits are f32, sums are f64 and run in row order, so that the result does not depend on any
//! thread.

/// Mean loss and accuracy of a batch of predictions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossEntropy {
    /// −mean log q(z), in nats; ln M for a discriminator that knows nothing.
    pub loss: f64,
    /// Share of rows whose largest logit (the first of equals) is the true behaviour's; 1/M for one
    /// that knows nothing.
    pub accuracy: f64,
}

/// log q(z) of one row: its log-softmax at `token`.
///
/// # Panics
///
/// When `token` is not an index into `logits`.
pub fn log_softmax_at(logits: &[f32], token: u32) -> f64 {
    f64::from(logits[token as usize]) - log_sum_exp(logits)
}

fn log_sum_exp(logits: &[f32]) -> f64 {
    let max = f64::from(logits.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    max + logits.iter().map(|&x| (f64::from(x) - max).exp()).sum::<f64>().ln()
}

fn argmax(row: &[f32]) -> usize {
    (1..row.len()).fold(0, |best, i| if row[i] > row[best] { i } else { best })
}

/// Loss and accuracy of `logits` for `tokens`, without gradient.
///
/// # Shapes
///
/// `logits` row-major `[B, M]`, `tokens` `[B]`.
///
/// # Panics
///
/// When `tokens` is empty or `logits` is not a whole number of rows for it.
pub fn evaluate(logits: &[f32], tokens: &[u32]) -> CrossEntropy {
    let ((loss, hits), n) = (totals(logits, tokens), tokens.len() as f64);
    CrossEntropy { loss: loss / n, accuracy: hits / n }
}

/// Sums over the rows, for batches that are a part of a larger one: −Σ log q(z), and the number of
/// rows whose behaviour is guessed.
///
/// # Panics
///
/// As [`evaluate`].
pub fn totals(logits: &[f32], tokens: &[u32]) -> (f64, f64) {
    let m = row_len(logits, tokens);
    let (mut loss, mut hits) = (0.0, 0_usize);
    for (row, &token) in logits.chunks_exact(m).zip(tokens) {
        loss -= log_softmax_at(row, token);
        hits += usize::from(argmax(row) == token as usize);
    }
    (loss, hits as f64)
}

/// As [`evaluate`], and writes the gradient of the mean loss with respect to the logits.
///
/// # Formula
///
/// `∂loss/∂logit_k = (softmax_k − [k = z]) / B`
///
/// # Panics
///
/// As [`evaluate`], and when `d_logits` has another length than `logits`.
pub fn evaluate_with_gradient(logits: &[f32], tokens: &[u32], d_logits: &mut [f32]) -> CrossEntropy {
    write_gradient(logits, tokens, tokens.len(), d_logits);
    evaluate(logits, tokens)
}

/// Writes the part of these rows in the gradient of the mean loss of a batch of `n` rows.
///
/// # Panics
///
/// As [`evaluate_with_gradient`].
pub fn write_gradient(logits: &[f32], tokens: &[u32], n: usize, d_logits: &mut [f32]) {
    let m = row_len(logits, tokens);
    assert_eq!(d_logits.len(), logits.len(), "d_logits has the shape of logits");
    let scale = 1.0 / n as f64;
    for ((row, &token), d_row) in logits.chunks_exact(m).zip(tokens).zip(d_logits.chunks_exact_mut(m)) {
        let log_sum = log_sum_exp(row);
        for (k, (&logit, d)) in row.iter().zip(d_row).enumerate() {
            let target = if k == token as usize { 1.0 } else { 0.0 };
            *d = (((f64::from(logit) - log_sum).exp() - target) * scale) as f32;
        }
    }
}

fn row_len(logits: &[f32], tokens: &[u32]) -> usize {
    assert!(!tokens.is_empty(), "a batch has at least one row");
    let m = logits.len() / tokens.len();
    assert!(m > 0 && m * tokens.len() == logits.len(), "logits are [B, M] for B tokens");
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn equal_logits_cost_ln_m() {
        let result = evaluate(&[0.5; 15], &[0, 1, 4]);
        assert!((result.loss - 5.0_f64.ln()).abs() < 1e-12);
        // Ties go to the first behaviour, so one of the three tokens is met.
        assert!((result.accuracy - 1.0 / 3.0).abs() < 1e-15);
    }

    #[test]
    fn huge_logits_do_not_overflow() {
        assert_eq!(log_softmax_at(&[3e38, -3e38], 0), 0.0);
        assert!((log_softmax_at(&[1000.0, 1001.0], 0) - -(1.0 + (-1.0_f64).exp()).ln() + 1.0).abs() < 1e-9);
    }

    #[test]
    fn one_behaviour_is_known_for_sure() {
        let mut gradient = [1.0; 2];
        let result = evaluate_with_gradient(&[0.7, -3.0], &[0, 0], &mut gradient);
        assert_eq!(result, CrossEntropy { loss: 0.0, accuracy: 1.0 });
        assert_eq!(gradient, [0.0; 2]);
    }

    proptest! {
        #[test]
        fn gradient_is_the_finite_difference(
            logits in proptest::collection::vec(-3.0..3.0_f32, 12), tokens in proptest::collection::vec(0..4_u32, 3),
        ) {
            let mut gradient = vec![0.0; 12];
            evaluate_with_gradient(&logits, &tokens, &mut gradient);
            for k in 0..12 {
                let at = |delta: f32| {
                    let mut moved = logits.clone();
                    moved[k] += delta;
                    (evaluate(&moved, &tokens).loss, f64::from(moved[k]))
                };
                let ((up, x_up), (down, x_down)) = (at(1e-2), at(-1e-2));
                let difference = (up - down) / (x_up - x_down);
                prop_assert!((difference - f64::from(gradient[k])).abs() < 1e-5);
            }
        }
    }
}
