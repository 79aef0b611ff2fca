//! Trains what a configuration file describes, one JSON record per update on standard output, and
//! goes on where it was stopped: `cargo run --release -p jostle-ppo --example train_from_file --
//! CONFIG FOLDER [KEY=VALUE]…`
//!
//! (`cargo xtask train` is the command for real runs: it locks the folder, keeps the log and shows
//! progress.)

use std::io::Write;
use std::path::{Path, PathBuf};

use jostle_ppo::{Config, PpoError, Trainer};

fn main() -> Result<(), PpoError> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [config, folder, overrides @ ..] = arguments.as_slice() else {
        eprintln!("usage: train_from_file CONFIG FOLDER [KEY=VALUE]…");
        std::process::exit(2);
    };
    let config = Config::load(Path::new(config), overrides)?;
    let checkpoint = PathBuf::from(folder).join("checkpoint.safetensors");
    let every = config.checkpoint_every;
    let mut trainer =
        if checkpoint.exists() { Trainer::resume_with(&checkpoint, config)? } else { Trainer::new(config)? };
    let mut out = std::io::stdout().lock();
    while !trainer.is_done() {
        let report = trainer.update()?;
        let record = serde_json::to_string(&report).expect("a report is plain numbers");
        writeln!(out, "{record}").expect("standard output is open");
        if trainer.is_done() || (every > 0 && report.update.is_multiple_of(every)) {
            let numbered = PathBuf::from(folder).join(format!("update_{:05}.safetensors", report.update));
            trainer.save(&checkpoint)?;
            trainer.save(&numbered)?;
        }
    }
    Ok(())
}
