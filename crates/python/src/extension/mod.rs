//! The classes and functions of the Python module `jostle._jostle`.
//!
//! Reading order: [`crowd_rooms`], [`robot_room`], [`peer_room`], [`evaluate`], [`board`],
//! [`policy`], [`planner`]; [`arguments`] holds what they share. Every array is Python's,
//! C-contiguous and of the type that is asked for; the Python side sees to both.

#![allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    reason = "that is how Python hands them over"
)]

mod arguments;
mod board;
mod crowd_rooms;
mod evaluate;
mod peer_room;
mod planner;
mod policy;
mod robot_room;

use pyo3::prelude::*;

/// Rooms of robots with lasers among people.
#[pymodule]
mod _jostle {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::board::board_entry;
    #[pymodule_export]
    use super::crowd_rooms::PyCrowdRooms;
    #[pymodule_export]
    use super::evaluate::{evaluate, evaluate_planner, evaluate_policy, notes};
    #[pymodule_export]
    use super::peer_room::PyPeerRoom;
    #[pymodule_export]
    use super::planner::PyPlanner;
    #[pymodule_export]
    use super::policy::PyPolicy;
    #[pymodule_export]
    use super::robot_room::PyRobotRoom;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
