//! Tests a policy of one's own among the two crowds that need no checkpoints: `cargo run --release
//! -p jostle-eval --example custom_policy`. The policy turns towards its goal and slows down for
//! what is near ahead.

use jostle_arena::{ArenaConfig, PerRow, PolicyIdentity, Pools};
use jostle_eval::report::Evaluation;
use jostle_eval::{EvalError, Protocol, Subject};
use jostle_peds::CrowdKind;

/// The row: three scans of 512 beams (oldest first, range/10 − ½), the goal in the robot's frame, v
/// and ω.
fn act(row: &[f32]) -> [f32; 2] {
    let (goal_x, goal_y) = (row[1536], row[1537]);
    let turn = goal_y.atan2(goal_x);
    let newest = &row[1024..1536];
    let ahead = newest[..64].iter().chain(&newest[448..]);
    let nearest = ahead.fold(0.5_f32, |least, range| least.min(*range));
    let clear = ((nearest + 0.5) * 10.0 - 0.7).clamp(0.0, 1.0);
    [turn.cos().max(0.0) * clear, (2.0 * turn).clamp(-1.0, 1.0)]
}

fn main() -> Result<(), EvalError> {
    let protocol = Protocol::new(ArenaConfig::default(), Pools::default())?;
    let identity = PolicyIdentity::custom("goal seeker with a brake", "1");
    let subject = Subject { identity: &identity, token: 0 };
    let mut cells = Vec::new();
    for crowd in [CrowdKind::Vo, CrowdKind::Sf] {
        let run = protocol.evaluate(&mut PerRow::new(act), subject, crowd, 1000, None, |_| ())?;
        cells.push(run.result);
    }
    let evaluation = Evaluation { policy: identity, token: 0, n_agents: 5, cells, remark: None };
    print!("{}", evaluation.text());
    Ok(())
}
