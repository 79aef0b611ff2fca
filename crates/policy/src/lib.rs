//! The behaviour-conditioned actor and critic: definition, parameters, inference and gradients.
