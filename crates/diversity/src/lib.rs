//! Behaviour discriminators, intrinsic rewards and the diversity metric D.
