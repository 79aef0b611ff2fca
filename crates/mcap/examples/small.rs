//! Writes a small recording, to try readers on: `cargo run -p jostle-mcap --example small -- small.mcap`.

use std::fs::File;

use jostle_mcap::{Episode, Moment, Place, Scanner, write};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args_os().nth(1).ok_or("name the file to write")?;
    let increment = std::f64::consts::TAU / 8.0;
    let scanner = Scanner { angle_min: 0.0, increment, beams: 8, range: 10.0 };
    let moment = |step: u8| {
        let time = f32::from(step) * 0.1;
        Moment {
            robot: Place { position: [time - 5.0, 0.0], heading: 0.0 },
            velocity: [1.0, 0.0],
            goal: [5.0, 0.0],
            // A wall ahead, nothing behind.
            ranges: [15.0 - time, 7.0, 5.0, 7.0, 10.0, 7.0, 5.0, 7.0]
                .map(|range: f32| range.min(10.0))
                .to_vec(),
            pedestrians: vec![[0.0, 2.0 - time]],
        }
    };
    let episode = Episode { name: "small".to_owned(), moments: (0..30).map(moment).collect() };
    let walls = [[[10.0, -5.0], [10.0, 5.0]], [[-10.0, -5.0], [10.0, -5.0]]];
    Ok(write(File::create(path)?, &[episode], 0.1, &scanner, &walls, [0.5, 0.25])?)
}
