//! The six unseen crowds, paired episodes, metrics, intervals and reports.
