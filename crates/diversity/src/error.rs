//! The one error type of this crate.

/// Faults in the inputs of a diversity computation.
#[derive(Debug, thiserror::Error)]
pub enum DiversityError {
    /// A buffer's length does not fit the shape it is said to have.
    #[error("{name}: expected {expected} values, found {found}")]
    Shape {
        /// The argument.
        name: &'static str,
        /// The length that its shape asks for.
        expected: usize,
        /// The length that was given.
        found: usize,
    },
    /// A configuration value lies outside its range.
    #[error("{field}: expected {expected}, found {found}")]
    Config {
        /// The key, as it is spelled in the configuration file.
        field: &'static str,
        /// The range in words.
        expected: &'static str,
        /// The value that was given.
        found: String,
    },
    /// A covariance matrix is not symmetric positive definite.
    #[error("{name}: the covariance matrix is not positive definite")]
    NotPositiveDefinite {
        /// The argument.
        name: &'static str,
    },
    /// The singular value decomposition did not converge (inputs that are not finite).
    #[error("principal components: the decomposition did not converge")]
    Decomposition,
    /// A discriminator's parameters or device were refused.
    #[error(transparent)]
    Network(#[from] jostle_policy::PolicyError),
}
