//! The sample of recorded people that comes with the repository is made by this file, and can be
//! read.

use std::fmt::Write as _;
use std::path::PathBuf;

use jostle_peds::recorded::{Recording, RecordingOptions};

/// Frames between two annotations, which are 0.4 s apart.
const STRIDE: u32 = 10;
/// People in the sample.
const PEOPLE: u32 = 40;

fn path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../recordings/sample.txt")
}

/// A floor of 16 m by 12 m around (8, 6). Every 1.6 s somebody enters on one of the four sides and
/// walks to the opposite one with a sway of 0.3 m; every fifth stands for 4 s halfway.
fn sample() -> String {
    let mut rows = Vec::new();
    for k in 0..PEOPLE {
        let side = k % 4;
        let lane = f64::from(k * 7 % 11) - 5.0;
        let speed = 0.8 + 0.1 * f64::from(k * 3 % 7);
        let length = if side < 2 { 16.0 } else { 12.0 };
        let pause = if k % 5 == 4 { 4.0 } else { 0.0 };
        let last = ((length / speed + pause) / 0.4).floor() as u32;
        for i in 0..=last {
            let time = 0.4 * f64::from(i);
            let half = length / 2.0 / speed;
            let walked = speed * if time < half { time } else { (time - pause).max(half) };
            let (along, across) = (walked.min(length), lane * 0.9 + 0.3 * libm::sin(walked));
            let (x, y) = match side {
                0 => (along, 6.0 + across),
                1 => (16.0 - along, 6.0 - across),
                2 => (8.0 + across, along),
                _ => (8.0 - across, 12.0 - along),
            };
            rows.push((STRIDE * (4 * k + i), k + 1, x, y));
        }
    }
    rows.sort_by_key(|row| (row.0, row.1));
    rows.iter().fold(String::new(), |mut text, (frame, id, x, y)| {
        writeln!(text, "{frame} {id} {x:.3} {y:.3}").unwrap();
        text
    })
}

#[test]
fn the_sample_is_what_this_file_makes() {
    assert!(
        std::fs::read_to_string(path()).unwrap() == sample(),
        "run `cargo test --release -p jostle-eval --test all recorded_sample -- --ignored`"
    );
}

#[test]
#[ignore = "writes the sample"]
fn write_the_sample() {
    std::fs::write(path(), sample()).unwrap();
}

#[test]
fn the_sample_can_be_read() {
    let recording = Recording::read(&path(), &RecordingOptions::default()).unwrap();
    assert_eq!((recording.tracks().len(), recording.n_left_out()), (PEOPLE as usize, 0));
    assert!((8..=16).contains(&recording.n_slots()), "{} at once", recording.n_slots());
    // The last enters after 39 times 1.6 s.
    assert!(recording.n_steps() > 39 * 16 + 70 && recording.n_steps() < 39 * 16 + 250);
    let half = recording.half_extent();
    assert!((7.9..=8.1).contains(&half.x) && (5.9..=6.1).contains(&half.y), "{half}");
}
