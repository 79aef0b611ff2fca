//! Criterion benches of every hot path, and the peers measured side by side.
