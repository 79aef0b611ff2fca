//! KL divergence between Gaussians with full covariance, through faer's Cholesky factors.
//!
//! Used where actions of a behaviour are described by their sample covariance (v and ω correlate
//! along a path) instead of the policy's diagonal head.

use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, Par, Side};

use crate::DiversityError;

/// A Gaussian in d dimensions, held as its mean and the Cholesky factor of its covariance.
#[derive(Debug, Clone)]
pub struct FullGaussian {
    mean: Vec<f64>,
    factor: Mat<f64>,
}

impl FullGaussian {
    /// From a mean of length d and a row-major d × d covariance (its lower triangle is read).
    ///
    /// # Errors
    ///
    /// [`DiversityError::Shape`] for a covariance that is not d × d or an empty mean, and
    /// [`DiversityError::NotPositiveDefinite`] when it has no Cholesky factor.
    pub fn new(mean: &[f64], covariance: &[f64]) -> Result<Self, DiversityError> {
        let d = mean.len();
        if d == 0 || covariance.len() != d * d {
            let (expected, found) = (d.max(1) * d.max(1), covariance.len());
            return Err(DiversityError::Shape { name: "covariance", expected, found });
        }
        let matrix = Mat::from_fn(d, d, |i, j| covariance[i * d + j]);
        let not_definite = || DiversityError::NotPositiveDefinite { name: "covariance" };
        let factor = matrix.llt(Side::Lower).map_err(|_| not_definite())?.L().to_owned();
        if (0..d).all(|i| factor[(i, i)].is_finite()) {
            Ok(Self { mean: mean.to_vec(), factor })
        } else {
            Err(not_definite())
        }
    }

    /// Mean and sample covariance (divisor n − 1) of `rows`, row-major [n, `n_dims`].
    ///
    /// # Errors
    ///
    /// [`DiversityError::Shape`] for fewer than two whole rows;
    /// [`DiversityError::NotPositiveDefinite`] when the rows lie in a hyperplane.
    pub fn fit(rows: &[f64], n_dims: usize) -> Result<Self, DiversityError> {
        let n = rows.len() / n_dims.max(1);
        if n < 2 || n_dims == 0 || rows.len() != n * n_dims {
            let expected = n.max(2) * n_dims.max(1);
            return Err(DiversityError::Shape { name: "rows", expected, found: rows.len() });
        }
        let mean: Vec<f64> =
            (0..n_dims).map(|d| rows.iter().skip(d).step_by(n_dims).sum::<f64>() / n as f64).collect();
        let mut covariance = vec![0.0; n_dims * n_dims];
        for row in rows.chunks_exact(n_dims) {
            for i in 0..n_dims {
                for j in 0..n_dims {
                    covariance[i * n_dims + j] += (row[i] - mean[i]) * (row[j] - mean[j]);
                }
            }
        }
        for c in &mut covariance {
            *c /= (n - 1) as f64;
        }
        Self::new(&mean, &covariance)
    }

    /// Number of dimensions d.
    pub fn n_dims(&self) -> usize {
        self.mean.len()
    }

    /// KL(self ‖ other) in nats.
    ///
    /// # Formula
    ///
    /// `½ (‖L_q⁻¹ L_p‖²_F + ‖L_q⁻¹ (μ_q − μ_p)‖² − d) + ln det L_q − ln det L_p`, with Σ = L Lᵀ.
    ///
    /// # Errors
    ///
    /// [`DiversityError::Shape`] when the dimensions differ.
    pub fn kl(&self, other: &Self) -> Result<f64, DiversityError> {
        let d = self.n_dims();
        if other.n_dims() != d {
            return Err(DiversityError::Shape { name: "other", expected: d, found: other.n_dims() });
        }
        // One triangular solve for both terms: the columns of L_p, then the difference of the
        // means.
        let mut columns = Mat::from_fn(d, d + 1, |i, j| {
            if j < d { if j <= i { self.factor[(i, j)] } else { 0.0 } } else { other.mean[i] - self.mean[i] }
        });
        solve_lower_triangular_in_place(other.factor.as_ref(), columns.as_mut(), Par::Seq);
        let squares: f64 =
            (0..=d).flat_map(|j| (0..d).map(move |i| (i, j))).map(|ij| columns[ij] * columns[ij]).sum();
        let log_det = |factor: &Mat<f64>| (0..d).map(|i| factor[(i, i)].ln()).sum::<f64>();
        Ok(0.5 * (squares - d as f64) + log_det(&other.factor) - log_det(&self.factor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::divergence::kl_normal;

    #[test]
    fn a_diagonal_covariance_gives_the_sum_of_one_dimensional_divergences() {
        let p = FullGaussian::new(&[0.2, -0.4], &[0.25, 0.0, 0.0, 1.44]).unwrap();
        let q = FullGaussian::new(&[0.5, 0.1], &[0.64, 0.0, 0.0, 0.81]).unwrap();
        let expected = kl_normal(0.2, 0.5_f64.ln(), 0.5, 0.8_f64.ln())
            + kl_normal(-0.4, 1.2_f64.ln(), 0.1, 0.9_f64.ln());
        assert!((p.kl(&q).unwrap() - expected).abs() < 1e-14);
        assert!(p.kl(&p).unwrap().abs() < 1e-15);
    }

    #[test]
    fn divergence_survives_a_change_of_coordinates() {
        // y = A x with A = [[2, 1], [0, 3]]: KL is invariant; Σ' = A Σ Aᵀ worked out by hand for Σ
        // = diag(1, 4) and I.
        let p = FullGaussian::new(&[1.0, 0.0], &[1.0, 0.0, 0.0, 4.0]).unwrap();
        let q = FullGaussian::new(&[0.0, 0.0], &[1.0, 0.0, 0.0, 1.0]).unwrap();
        let p_turned = FullGaussian::new(&[2.0, 0.0], &[8.0, 12.0, 12.0, 36.0]).unwrap();
        let q_turned = FullGaussian::new(&[0.0, 0.0], &[5.0, 3.0, 3.0, 9.0]).unwrap();
        let plain = p.kl(&q).unwrap();
        // ½(1 + 4 + 1 − 2) − ln 2
        assert!((plain - (2.0 - 2.0_f64.ln())).abs() < 1e-14);
        assert!((p_turned.kl(&q_turned).unwrap() - plain).abs() < 1e-13);
    }

    #[test]
    fn fit_is_the_sample_covariance() {
        let fitted = FullGaussian::fit(&[0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 2.0, 2.0], 2).unwrap();
        let by_hand = FullGaussian::new(&[1.0, 1.0], &[4.0 / 3.0, 0.0, 0.0, 4.0 / 3.0]).unwrap();
        assert!(fitted.kl(&by_hand).unwrap().abs() < 1e-15);
    }

    #[test]
    fn bad_covariances_are_refused() {
        let indefinite = FullGaussian::new(&[0.0, 0.0], &[1.0, 2.0, 2.0, 1.0]);
        assert!(matches!(indefinite, Err(DiversityError::NotPositiveDefinite { .. })));
        assert!(matches!(
            FullGaussian::new(&[0.0], &[f64::NAN]),
            Err(DiversityError::NotPositiveDefinite { .. })
        ));
        assert!(matches!(FullGaussian::new(&[0.0, 0.0], &[1.0]), Err(DiversityError::Shape { .. })));
        assert!(matches!(FullGaussian::fit(&[1.0, 2.0], 2), Err(DiversityError::Shape { .. })));
        assert!(matches!(
            FullGaussian::fit(&[1.0, 2.0, 1.0, 2.0], 2),
            Err(DiversityError::NotPositiveDefinite { .. })
        ));
    }
}
