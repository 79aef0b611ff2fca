//! An entry of the leaderboard from Python: a function on every scene of the standard suite among
//! the six crowds.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

use jostle_arena::{ArenaConfig, PolicyIdentity, Robot};
use jostle_eval::board::{Board, Entrant, EntryKind};
use jostle_eval::suite::Suite;
use jostle_peds::CrowdKind;
use pyo3::prelude::*;

use super::arguments::{base, check_threads, value_error};
use super::evaluate::PythonRobot;

/// The texts of an entry.
#[derive(FromPyObject)]
pub(super) struct Words {
    #[pyo3(item)]
    name: String,
    #[pyo3(item)]
    version: String,
    #[pyo3(item)]
    about: String,
    #[pyo3(item)]
    command: String,
}

/// Runs a function on all cells; the entry as the text of its file. `act` and `zeros` are those of
/// `evaluate`.
#[pyfunction]
pub(super) fn board_entry(
    py: Python<'_>,
    act: Py<PyAny>,
    zeros: Bound<'_, PyAny>,
    words: Words,
    config: Option<PathBuf>,
    overrides: Vec<String>,
    pool: Vec<PathBuf>,
    pool_half: Vec<PathBuf>,
    episodes: u64,
) -> PyResult<String> {
    check_threads(true)?;
    let sim = base(config, &overrides)?.sim;
    let pools = jostle_runs::policies::pools(&pool, &pool_half, &CrowdKind::PAPER, "pool_half");
    let (pools, crowds) = (pools.map_err(value_error)?, CrowdKind::PAPER.to_vec());
    let board = Board { suite: Suite::standard(), crowds, episodes, seed: 0, pools };
    let Words { name, version, about, command } = words;
    let policy = PolicyIdentity::custom(&name, &version);
    let width = sim.observation_len();
    let entrant = Entrant { name, kind: EntryKind::Own, about, command, policy, token: 0, sim };
    let lock_step = ArenaConfig::default().lock_step;
    let n_rows = usize::try_from(episodes).map_or(lock_step, |episodes| episodes.min(lock_step));
    let failure = Arc::default();
    let robot = PythonRobot::new(act, &zeros, n_rows, width, Arc::clone(&failure))?;
    let entry = py.detach(|| {
        let mut copy = |_: &_| Ok(Box::new(Python::attach(|py| robot.clone_ref(py))) as Box<dyn Robot>);
        board.run(&entrant, &mut copy, &mut |_, _, _| ())
    });
    // An exception of Python's comes before the refusal that it led to.
    if let Some(error) = failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
        return Err(error);
    }
    Ok(entry.map_err(value_error)?.text())
}
