//! Enters a robot of one's own into the leaderboard: `cargo run --release -p jostle-eval --example
//! leaderboard_entry -- runs/board`, then `cargo xtask leaderboard --folder runs/board` makes the
//! page. It turns towards its goal and slows down for what is near ahead.

use std::path::{Path, PathBuf};

use jostle_arena::identity::PolicyIdentity;
use jostle_arena::{LoadedPolicy, PerRow, Pools};
use jostle_eval::EvalError;
use jostle_eval::board::{Board, Entrant, EntryKind};
use jostle_eval::suite::Suite;
use jostle_peds::CrowdKind;
use jostle_sim::SimConfig;

/// The row: three scans of 512 beams (oldest first, range/10 − ½), the goal in the robot's frame, v
/// and ω.
fn act(row: &[f32]) -> [f32; 2] {
    let turn = row[1537].atan2(row[1536]);
    let newest = &row[1024..1536];
    let ahead = newest[..64].iter().chain(&newest[448..]);
    let nearest = ahead.fold(0.5_f32, |least, range| least.min(*range));
    let clear = ((nearest + 0.5) * 10.0 - 0.7).clamp(0.0, 1.0);
    [turn.cos().max(0.0) * clear, (2.0 * turn).clamp(-1.0, 1.0)]
}

/// The shipped pedestrians of a training length.
fn pool(updates: &str) -> Result<Vec<LoadedPolicy>, EvalError> {
    let file = |seed: u32| format!("checkpoints/pool-seed{seed}-{updates}.safetensors");
    (101..=104).map(|seed| Ok(LoadedPolicy::load(Path::new(&file(seed)))?)).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "runs/board".to_owned()));
    let board = Board {
        suite: Suite::standard(),
        crowds: CrowdKind::PAPER.to_vec(),
        episodes: 50,
        seed: 0,
        pools: Pools { full: pool("005000")?, half: pool("002500")? },
    };
    let entrant = Entrant {
        name: "brake-and-turn".to_owned(),
        kind: EntryKind::Own,
        about: "turns to its goal and slows down for what is near ahead".to_owned(),
        command: "cargo run --release -p jostle-eval --example leaderboard_entry".to_owned(),
        // The version changes whenever the robot acts otherwise.
        policy: PolicyIdentity::custom("brake-and-turn", "1"),
        token: 0,
        sim: SimConfig::default(),
    };
    let progress = &mut |scene: &str, crowd: CrowdKind, done: u64| {
        if done == board.episodes {
            eprintln!("{scene}, {crowd}");
        }
    };
    let entry = board.run(&entrant, &mut |_| Ok(Box::new(PerRow::new(act))), progress)?;
    std::fs::create_dir_all(&folder)?;
    let file = folder.join(format!("{}.json", entry.name));
    std::fs::write(&file, entry.text())?;
    println!("{}: mean success {:.3}", file.display(), entry.score.mean);
    Ok(())
}
