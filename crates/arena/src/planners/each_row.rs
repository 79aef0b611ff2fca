//! A planner that reads one observation row at a time, as a policy for many.

use rayon::prelude::*;

use super::reader::RowReader;
use crate::robot::RobotPolicy;

/// Rows that one task plans for. Results do not depend on it.
const CHUNK: usize = 16;

/// A function of one observation row. It has no memory: `scratch` keeps its allocations and nothing
/// that is read.
pub trait RowPlanner: Send + Sync {
    /// Working memory of a decision.
    type Scratch: Default + Send;

    /// The reader of its rows.
    fn reader(&self) -> &RowReader;

    /// The action (v, ω) for a row.
    fn plan(&self, row: &[f32], scratch: &mut Self::Scratch) -> [f32; 2];
}

/// A planner as a policy: rows are planned for on all threads.
pub struct EachRow<P: RowPlanner> {
    planner: P,
    scratch: P::Scratch,
}

impl<P: RowPlanner> EachRow<P> {
    /// Wraps a planner.
    pub fn new(planner: P) -> Self {
        Self { planner, scratch: P::Scratch::default() }
    }
}

impl<P: RowPlanner> RobotPolicy for EachRow<P> {
    fn act(&mut self, observations: &[f32], actions: &mut [[f32; 2]]) {
        let (planner, row_len) = (&self.planner, self.planner.reader().row_len());
        // A single row needs no thread, which a forked process would not have.
        if actions.len() <= 1 {
            for (row, action) in observations.chunks_exact(row_len).zip(actions) {
                *action = planner.plan(row, &mut self.scratch);
            }
            return;
        }
        let rows = observations.par_chunks(CHUNK * row_len).zip(actions.par_chunks_mut(CHUNK));
        rows.for_each_init(P::Scratch::default, |scratch, (rows, actions)| {
            for (row, action) in rows.chunks_exact(row_len).zip(actions) {
                *action = planner.plan(row, scratch);
            }
        });
    }
}
