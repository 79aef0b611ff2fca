//! The intrinsic rewards that are compared in the paper's Table 3.
//!
//! `Difference` is the paper's (its Eq. 2): it asks for actions that tell the behaviour *beyond*
//! what the visited observation tells. The other three are its ablations.

use serde::{Deserialize, Serialize};

/// The intrinsic reward that is added to the task reward, before its weight α.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum IntrinsicReward {
    /// log q(z|s,a) − log q(z|s), the paper's.
    #[default]
    Difference,
    /// log q(z|s,a).
    StateAction,
    /// log q(z|s), as in DIAYN (Eysenbach et al. 2018).
    State,
    /// 0: no diversity is asked for.
    None,
}

impl IntrinsicReward {
    /// The reward of one step, from the two discriminators' log-probabilities of the true
    /// behaviour.
    ///
    /// With `add_log_m`, log M = −log p(z) of the uniform prior is added to `StateAction` and
    /// `State` (as DIAYN does), so that a discriminator that knows nothing gives 0. In `Difference`
    /// the priors cancel, and `None` stays 0.
    pub fn value(
        self,
        log_q_state_action: f64,
        log_q_state: f64,
        add_log_m: bool,
        n_behaviours: usize,
    ) -> f64 {
        let prior = if add_log_m { (n_behaviours as f64).ln() } else { 0.0 };
        match self {
            Self::Difference => log_q_state_action - log_q_state,
            Self::StateAction => log_q_state_action + prior,
            Self::State => log_q_state + prior,
            Self::None => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_variant_by_hand() {
        let (sa, s) = (-0.5, -1.25);
        assert_eq!(IntrinsicReward::Difference.value(sa, s, false, 5), 0.75);
        assert_eq!(IntrinsicReward::Difference.value(sa, s, true, 5), 0.75);
        assert_eq!(IntrinsicReward::StateAction.value(sa, s, false, 5), -0.5);
        assert_eq!(IntrinsicReward::State.value(sa, s, false, 5), -1.25);
        assert_eq!(IntrinsicReward::None.value(sa, s, true, 5), 0.0);
    }

    #[test]
    fn with_log_m_a_guess_is_worth_nothing() {
        let guess = -(5.0_f64.ln());
        assert_eq!(IntrinsicReward::StateAction.value(guess, 0.0, true, 5), 0.0);
        assert_eq!(IntrinsicReward::State.value(0.0, guess, true, 5), 0.0);
    }
}
