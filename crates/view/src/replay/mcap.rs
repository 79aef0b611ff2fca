//! Episodes as an MCAP file: what `replay --mcap` writes beside the page.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use anyhow::Result;
use glam::Vec2;
use jostle_arena::config::ArenaConfig;
use jostle_arena::replay::EpisodeTrace;
use jostle_arena::room::metric_scale;
use jostle_mcap::{Episode, Moment, Place, Scanner, Wall};
use jostle_runs::run_folder::write_bytes_atomically;
use jostle_sim::LaserConfig;

/// Writes episodes, each with the name of who drove the robot, one after the other. Their traces
/// hold all beams; the room's walls and obstacles are these polygons.
///
/// # Errors
/// A trace without all beams; a file that cannot be written.
pub fn write(
    file: &Path,
    episodes: &[(&str, &EpisodeTrace)],
    config: &ArenaConfig,
    site: &[Vec<Vec2>],
) -> Result<()> {
    let sim = &config.sim;
    let episodes: Vec<Episode> = episodes.iter().map(|(driver, trace)| episode(driver, trace)).collect();
    let radii = [sim.episode.goal_radius, sim.robot.length.max(sim.robot.width) / 2.0];
    let mut bytes = Cursor::new(Vec::new());
    // 0.1, not the single-precision number nearest to it.
    let dt = metric_scale(config).dt;
    jostle_mcap::write(&mut bytes, &episodes, dt, &scanner(&sim.laser), &walls(site), radii)?;
    write_bytes_atomically(file, &bytes.into_inner())
}

fn scanner(laser: &LaserConfig) -> Scanner {
    let start = laser.beam_angle(0);
    let increment = if laser.beams > 1 { laser.beam_angle(1) - start } else { 0.0 };
    Scanner { angle_min: start, increment, beams: laser.beams, range: laser.range }
}

fn episode(driver: &str, trace: &EpisodeTrace) -> Episode {
    let moments = trace.frames.iter().map(|frame| Moment {
        robot: Place { position: frame.robot.position.to_array(), heading: frame.robot.heading },
        velocity: frame.velocity,
        goal: frame.robot.goal.to_array(),
        ranges: frame.ranges.clone(),
        pedestrians: frame.pedestrians.iter().map(|pedestrian| pedestrian.position.to_array()).collect(),
    });
    let index = trace.finished.episode.to_string();
    let notes = [
        ("driver", driver.to_owned()),
        ("crowd", trace.crowd.to_string()),
        ("episode", index.clone()),
        ("outcome", trace.finished.outcome.to_string()),
    ];
    Episode {
        name: format!("{driver}, {} {index}", trace.crowd),
        notes: BTreeMap::from(notes.map(|(key, value)| (key.to_owned(), value))),
        moments: moments.collect(),
    }
}

/// The sides of the polygons; one of two corners is a single piece.
fn walls(site: &[Vec<Vec2>]) -> Vec<Wall> {
    let sides = |corners: &Vec<Vec2>| -> Vec<Wall> {
        let n = if corners.len() == 2 { 1 } else { corners.len() };
        (0..n).map(|k| [corners[k].to_array(), corners[(k + 1) % corners.len()].to_array()]).collect()
    };
    site.iter().flat_map(sides).collect()
}
