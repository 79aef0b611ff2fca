//! A fast, deterministic 2D world of laser robots among people, and the decision process on top of it.
