//! The one error type of this crate.

/// Why a policy cannot be exported as asked.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ExportError {
    /// A behaviour token that the policy does not have.
    #[error("token: found {found}, expected 0 to {} (the policy has {n_behaviours} behaviours)", n_behaviours - 1)]
    Token {
        /// The token asked for.
        found: u32,
        /// Behaviours of the policy.
        n_behaviours: usize,
    },
}
