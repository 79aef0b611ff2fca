//! The inputs of a network: observation rows and behaviour tokens, or a subset of them.

use crate::error::PolicyError;

/// Observation rows and their behaviour tokens.
///
/// # Shapes
///
/// `observations` `[N, width]` row-major, `tokens` `[N]`; `rows` `[B]` picks B of the N rows, in
/// that order (a minibatch of a rollout, without copying it). Without `rows`, B = N.
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// Rows of [`OBSERVATION_LEN`](crate::observation::OBSERVATION_LEN) values (or the network's
    /// own width).
    pub observations: &'a [f32],
    /// One behaviour token z for each row of `observations`.
    pub tokens: &'a [u32],
    /// The rows to be read; `None` reads all.
    pub rows: Option<&'a [u32]>,
}

impl<'a> Batch<'a> {
    /// All rows.
    pub fn new(observations: &'a [f32], tokens: &'a [u32]) -> Self {
        Self { observations, tokens, rows: None }
    }

    /// The rows given, in that order; a row may occur more than once.
    pub fn subset(observations: &'a [f32], tokens: &'a [u32], rows: &'a [u32]) -> Self {
        Self { observations, tokens, rows: Some(rows) }
    }

    /// Number of rows that the network computes (B).
    pub fn len(&self) -> usize {
        self.rows.map_or(self.tokens.len(), <[u32]>::len)
    }

    /// `true` if there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The index in `observations` of the batch's row `idx`.
    #[inline]
    pub fn row(&self, idx: usize) -> usize {
        self.rows.map_or(idx, |rows| rows[idx] as usize)
    }

    /// The batch's observation `idx`, of `width` values.
    #[inline]
    pub fn observation(&self, idx: usize, width: usize) -> &'a [f32] {
        let row = self.row(idx);
        &self.observations[row * width..(row + 1) * width]
    }

    /// The batch's token `idx`.
    #[inline]
    pub fn token(&self, idx: usize) -> u32 {
        self.tokens[self.row(idx)]
    }

    /// Refuses a batch that a network of this input width and number of behaviours cannot read.
    ///
    /// Networks check by this and panic on its error: a batch is made by code, not by a user. Where
    /// tokens come from outside (a command line, a file), call it first.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Batch`] names the first field that does not fit.
    pub fn check(&self, width: usize, n_behaviours: usize) -> Result<(), PolicyError> {
        let refuse =
            |field, found: String, expected: String| Err(PolicyError::Batch { field, found, expected });
        if self.observations.len() != self.tokens.len() * width {
            let found = format!("{} values", self.observations.len());
            return refuse("observations", found, format!("{} rows of {width}", self.tokens.len()));
        }
        let n_rows = self.tokens.len();
        if let Some(row) = self.rows.and_then(|rows| rows.iter().find(|row| **row as usize >= n_rows)) {
            return refuse("rows", row.to_string(), format!("less than {n_rows}"));
        }
        if let Some(token) = self.tokens.iter().find(|token| **token as usize >= n_behaviours) {
            return refuse("tokens", token.to_string(), format!("less than {n_behaviours}"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_pick_and_repeat() {
        let (observations, tokens, rows) = ([1.0, 2.0, 3.0, 4.0], [0, 1], [1, 0, 1]);
        let batch = Batch::subset(&observations, &tokens, &rows);
        assert_eq!(batch.len(), 3);
        assert_eq!(batch.observation(0, 2), [3.0, 4.0]);
        assert_eq!((batch.token(0), batch.token(1)), (1, 0));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let check = |batch: Batch<'_>, message: &str| {
            assert_eq!(batch.check(2, 2).unwrap_err().to_string(), message);
        };
        assert!(Batch::new(&[0.0; 4], &[0, 1]).check(2, 2).is_ok());
        assert!(Batch::new(&[], &[]).check(2, 2).is_ok());
        check(Batch::new(&[0.0; 3], &[0, 1]), "batch: observations: found 3 values, expected 2 rows of 2");
        check(Batch::new(&[0.0; 4], &[0, 2]), "batch: tokens: found 2, expected less than 2");
        check(Batch::subset(&[0.0; 4], &[0, 1], &[2]), "batch: rows: found 2, expected less than 2");
    }
}
