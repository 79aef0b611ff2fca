//! The observation row that the simulator writes and every network reads (spec: paper section III,
//! observation).
//!
//! ```text
//! index   0 ……………………… 1535   1536   1537   1538   1539
//!         scans, oldest first   goal x goal y   v      ω
//!         frame · 512 + beam    (metres, robot  (m/s)  (rad/s)
//!         each range/10 − 0.5    frame)
//! ```
//!
//! The constants are those of the paper. A network of another
//! [`NetworkConfig`](crate::NetworkConfig) has the same order with its own number of frames and
//! beams.

/// Laser scans in an observation, oldest first.
pub const FRAMES: usize = 3;
/// Beams in one scan.
pub const BEAMS: usize = 512;
/// Laser values of a row: `FRAMES · BEAMS`.
pub const SCANS_LEN: usize = FRAMES * BEAMS;
/// Values behind the scans: the goal in the robot frame (2), then v and ω.
pub const TAIL_LEN: usize = 4;
/// Length of one row.
pub const OBSERVATION_LEN: usize = SCANS_LEN + TAIL_LEN;
