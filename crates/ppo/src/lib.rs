//! Algorithm 1: proximal policy optimisation with a diversity reward, resumable to the bit.
