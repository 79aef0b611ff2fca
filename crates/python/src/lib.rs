//! The extension module under the Python package `jostle`: rooms to train in and to be tested in.
//!
//! Reading order: [`settings`] (what a Python caller may set), [`crowd_rooms`] (a robot among a
//! crowd, many rooms at once), [`robot_rooms`] (several robots in one room), [`peer_room`] (a robot
//! that another simulator moves), [`picture`] (rooms from above), [`finite`] (the gate before a
//! policy), [`threads`] (a process that was forked); with the feature `extension`, `extension` (the
//! classes that Python sees). The Python side is in `python/jostle`.
//!
//! Architecture invariants: what these rooms do is decided in `jostle-sim`, `jostle-peds` and
//! `jostle-eval` alone; arrays belong to Python, and each row is written into them once, in place:
//! there is no array in between, and no memory is shared that Python could change under a running
//! room.

#![forbid(unsafe_code)]

pub mod crowd_rooms;
#[cfg(feature = "extension")]
mod extension;
pub mod finite;
pub mod peer_room;
pub mod picture;
pub mod robot_rooms;
pub mod settings;
pub mod threads;

pub use crowd_rooms::{CrowdRooms, RoomStep};
pub use peer_room::PeerRoom;
pub use robot_rooms::RobotRoom;
pub use settings::Settings;
