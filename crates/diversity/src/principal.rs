//! Principal components of behaviours: how many directions the M behaviours really differ in.
//!
//! A behaviour is a row (for example its mean actions over a list of states); the components are
//! the right singular vectors of the centred rows, from faer's thin SVD.

use faer::Mat;

use crate::DiversityError;

/// The principal components of a set of rows, largest variance first.
#[derive(Debug, Clone, PartialEq)]
pub struct PrincipalComponents {
    mean: Vec<f64>,
    /// [k, d], orthonormal rows.
    components: Vec<f64>,
    variances: Vec<f64>,
}

impl PrincipalComponents {
    /// Fits `rows`, row-major [n, `n_features`]; k = min(n, `n_features`) components.
    ///
    /// A component's sign is chosen so that its entry of largest magnitude is positive: the result
    /// does not depend on the solver's (but for entries that tie to the last bit).
    ///
    /// # Errors
    ///
    /// [`DiversityError::Shape`] for fewer than two whole rows; [`DiversityError::Decomposition`]
    /// for input that is not finite.
    pub fn fit(rows: &[f64], n_features: usize) -> Result<Self, DiversityError> {
        let n = rows.len() / n_features.max(1);
        if n < 2 || n_features == 0 || rows.len() != n * n_features {
            let expected = n.max(2) * n_features.max(1);
            return Err(DiversityError::Shape { name: "rows", expected, found: rows.len() });
        }
        if rows.iter().any(|x| !x.is_finite()) {
            return Err(DiversityError::Decomposition);
        }
        let mean: Vec<f64> = (0..n_features)
            .map(|f| rows.iter().skip(f).step_by(n_features).sum::<f64>() / n as f64)
            .collect();
        let centred = Mat::from_fn(n, n_features, |i, f| rows[i * n_features + f] - mean[f]);
        let svd = centred.thin_svd().map_err(|_| DiversityError::Decomposition)?;
        let k = n.min(n_features);
        let singular = svd.S().column_vector();
        let variances = (0..k).map(|c| singular[c] * singular[c] / (n - 1) as f64).collect();
        let components =
            (0..k).flat_map(|c| with_positive_peak(svd.V().col(c).iter().copied().collect())).collect();
        Ok(Self { mean, components, variances })
    }

    /// Variance along each component (divisor n − 1), in descending order.
    pub fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Share of the total variance along each component; all zero when the rows are identical.
    pub fn explained(&self) -> Vec<f64> {
        let total: f64 = self.variances.iter().sum();
        self.variances.iter().map(|v| if total > 0.0 { v / total } else { 0.0 }).collect()
    }

    /// Component `index` as a unit vector over the features.
    pub fn component(&self, index: usize) -> &[f64] {
        let d = self.mean.len();
        &self.components[index * d..(index + 1) * d]
    }

    /// Coordinates of `row` along the components.
    ///
    /// # Panics
    ///
    /// When `row` has not the number of features that was fitted.
    pub fn project(&self, row: &[f64]) -> Vec<f64> {
        assert_eq!(row.len(), self.mean.len(), "a row has as many features as were fitted");
        let dot = |c: &[f64]| c.iter().zip(row).zip(&self.mean).map(|((c, x), m)| c * (x - m)).sum();
        self.components.chunks_exact(self.mean.len()).map(dot).collect()
    }
}

/// Turns a vector so that its entry of largest magnitude (the first of equals) is positive.
fn with_positive_peak(mut vector: Vec<f64>) -> Vec<f64> {
    let peak = vector.iter().fold(0.0_f64, |peak, &x| if x.abs() > peak.abs() { x } else { peak });
    if peak < 0.0 {
        for x in &mut vector {
            *x = -*x;
        }
    }
    vector
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_a_line_have_one_component() {
        // (2t, 3t, −6t) for t = −1, 0, 1, 2 around (5, 0, 1): direction ∓(2, 3, −6)/7, variance
        // 49·var(t) = 49·5/3.
        let rows: Vec<f64> =
            [-1.0, 0.0, 1.0, 2.0].iter().flat_map(|t| [5.0 + 2.0 * t, 3.0 * t, 1.0 - 6.0 * t]).collect();
        let pca = PrincipalComponents::fit(&rows, 3).unwrap();
        assert!((pca.variances()[0] - 245.0 / 3.0).abs() < 1e-12);
        assert!(pca.variances()[1..].iter().all(|v| v.abs() < 1e-12));
        assert!((pca.explained()[0] - 1.0).abs() < 1e-12);
        let expected = [-2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0];
        assert!(pca.component(0).iter().zip(expected).all(|(c, e)| (c - e).abs() < 1e-12));
        // The mean is t = 0.5; t = 2 lies 1.5 steps of length 7 from it, against the component's
        // direction.
        assert!((pca.project(&rows[9..])[0] + 10.5).abs() < 1e-12);
    }

    #[test]
    fn components_are_orthonormal() {
        let rows = [1.0, 0.2, -0.5, 0.3, 1.5, 0.7, -1.0, 0.1, 0.9, 0.4, -0.8, 2.0, 0.6, 0.0, -1.1];
        let pca = PrincipalComponents::fit(&rows, 3).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let dot: f64 = pca.component(i).iter().zip(pca.component(j)).map(|(a, b)| a * b).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
        assert!(pca.variances().is_sorted_by(|a, b| a >= b));
    }

    #[test]
    fn identical_rows_explain_nothing_and_bad_input_is_refused() {
        let pca = PrincipalComponents::fit(&[1.0, 2.0, 1.0, 2.0], 2).unwrap();
        assert_eq!(pca.explained(), vec![0.0, 0.0]);
        assert!(PrincipalComponents::fit(&[1.0, 2.0], 2).is_err());
        let not_finite = PrincipalComponents::fit(&[1.0, f64::NAN], 1);
        assert!(matches!(not_finite, Err(DiversityError::Decomposition)));
    }
}
