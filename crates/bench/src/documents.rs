//! The Rust in the documentation, compiled with the doctests. It stands here because this crate
//! knows all others.

#[doc = include_str!("../../../docs/how-to-crowd.md")]
struct HowToCrowd;
#[doc = include_str!("../../../docs/how-to-own-policy.md")]
struct HowToOwnPolicy;
#[doc = include_str!("../../../docs/how-to-reward.md")]
struct HowToReward;
#[doc = include_str!("../../../README.md")]
struct Root;
#[doc = include_str!("../../arena/README.md")]
struct Arena;
#[doc = include_str!("../../diversity/README.md")]
struct Diversity;
#[doc = include_str!("../../eval/README.md")]
struct Eval;
#[doc = include_str!("../../peds/README.md")]
struct Peds;
#[doc = include_str!("../../policy/README.md")]
struct Policy;
#[doc = include_str!("../../ppo/README.md")]
struct Ppo;
#[doc = include_str!("../../sim/README.md")]
struct Sim;
