//! The page: traces as compact JSON inside one HTML file that needs nothing else.
//!
//! Positions are whole centimetres, angles milliradians, speeds mm/s, as little-endian 16-bit
//! integers in base 64; a range is a byte. An episode of 150 steps takes about 40 kB.

use anyhow::{Context as _, Result, ensure};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use glam::Vec2;
use jostle_arena::Outcome;
use jostle_arena::config::ArenaConfig;
use jostle_arena::metrics::EpisodeMetrics;
use jostle_arena::replay::{EpisodeTrace, TraceFrame, beam_stride};
use jostle_eval::protocol::Protocol;
use jostle_peds::{CrowdName, Pedestrian};
use jostle_sim::LaserConfig;
use serde::Serialize;

use super::BEAMS;
use super::driver::Driver;

const TEMPLATE: &str = include_str!("page.html");
/// Colours and parts that the live page has, too.
pub const STYLE: &str = include_str!("style.css");
/// The drawing of a moment, which the live page shares.
pub const SCENE: &str = include_str!("scene.js");
/// Elements and words of both pages.
pub const PARTS: &str = include_str!("parts.js");
const PLAYER: &str = include_str!("player.js");

/// Largest coordinate and range that the page's integers hold (m).
const LARGEST: f32 = 320.0;

/// The things that all episodes have in common.
#[derive(Serialize)]
pub struct Scene {
    /// Walls, then obstacles: corners in metres.
    site: Vec<Vec<[f32; 2]>>,
    /// Length and width of every body (m).
    body: [f32; 2],
    dt: f32,
    goal_radius: f32,
    crash_range: f32,
    v_max: f32,
    laser: LaserScene,
}

#[derive(Serialize)]
struct LaserScene {
    /// Beams that are kept.
    beams: usize,
    /// Angle of the first one from straight ahead (rad).
    start: f32,
    /// Angle between two kept beams (rad).
    step: f32,
    range: f32,
    /// True if the beams go all round, so that the last one is the first one's neighbour.
    circle: bool,
}

impl LaserScene {
    fn new(laser: &LaserConfig) -> Self {
        let stride = beam_stride(laser.beams, BEAMS);
        Self {
            beams: laser.beams.div_ceil(stride),
            start: laser.angle_min,
            step: (laser.beam_angle(stride) - laser.beam_angle(0)) as f32,
            range: laser.range,
            circle: laser.is_full_circle(),
        }
    }
}

impl Scene {
    /// The scene of a configuration's room.
    ///
    /// # Errors
    /// A room or a laser beyond what the page's numbers hold.
    pub fn new(config: &ArenaConfig, site: &[Vec<Vec2>]) -> Result<Self> {
        let sim = &config.sim;
        let reach =
            site.iter().flatten().map(|corner| corner.abs().max_element()).fold(sim.laser.range, f32::max);
        ensure!(reach <= LARGEST, "a replay shows rooms and lasers up to {LARGEST} m, found {reach} m");
        Ok(Self {
            site: site.iter().map(|polygon| polygon.iter().map(Vec2::to_array).collect()).collect(),
            body: [sim.robot.length, sim.robot.width],
            dt: sim.episode.dt,
            goal_radius: sim.episode.goal_radius,
            crash_range: sim.episode.crash_range,
            v_max: sim.robot.v_max,
            laser: LaserScene::new(&sim.laser),
        })
    }
}

#[derive(Serialize)]
struct PolicyEntry {
    name: String,
    note: String,
    token: Option<u32>,
}

#[derive(Serialize)]
#[expect(clippy::struct_field_names, reason = "the page's script reads these names")]
struct Episode {
    crowd: CrowdName,
    episode: u64,
    goal: [f32; 2],
    /// One for each policy.
    runs: Vec<Run>,
}

#[derive(Serialize)]
struct Run {
    outcome: Outcome,
    steps: u64,
    metrics: EpisodeMetrics,
    pedestrian_token: Option<u32>,
    speed_factors: Vec<f32>,
    /// x, y, heading of each frame.
    robot: String,
    /// v, ω of each frame.
    command: String,
    /// Distance to the nearest thing all round, of each frame.
    near: String,
    ranges: String,
    /// x, y, heading of each pedestrian of each frame.
    pedestrians: String,
    /// Step, pedestrian, x, y: a goal that is new at a step.
    goals: Vec<(usize, usize, f32, f32)>,
}

/// Everything that a page shows.
#[derive(Serialize)]
pub struct Page {
    format: &'static str,
    note: String,
    world: Scene,
    policies: Vec<PolicyEntry>,
    episodes: Vec<Episode>,
}

impl Page {
    /// A page without episodes.
    pub fn new(world: Scene, drivers: &[Driver], protocol: &Protocol) -> Self {
        let entry = |driver: &Driver| PolicyEntry {
            name: driver.name.clone(),
            note: driver.note.clone(),
            token: driver.token,
        };
        let config = protocol.config();
        Self {
            format: "jostle-replay-1",
            note: format!("{} pedestrians, seed {}", config.n_pedestrians(), config.seed),
            world,
            policies: drivers.iter().map(entry).collect(),
            episodes: Vec::new(),
        }
    }

    /// Adds the same episodes as each policy drove them.
    ///
    /// # Panics
    /// If the columns are not the same episodes.
    pub fn add(&mut self, columns: &[Vec<EpisodeTrace>]) {
        for (row, trace) in columns[0].iter().enumerate() {
            let range = self.world.laser.range;
            let traces: Vec<&EpisodeTrace> = columns.iter().map(|column| &column[row]).collect();
            assert!(traces.iter().all(|other| other.finished.episode == trace.finished.episode));
            self.episodes.push(Episode {
                crowd: trace.crowd,
                episode: trace.finished.episode,
                goal: trace.finished.goal,
                runs: traces.into_iter().map(|trace| run_of(trace, range)).collect(),
            });
        }
    }

    /// The content of the page, a line for each policy.
    pub fn summary(&self) -> String {
        let line = |(k, policy): (usize, &PolicyEntry)| {
            let count = |outcome| self.episodes.iter().filter(|e| e.runs[k].outcome == outcome).count();
            format!(
                "{} ({}): {} episodes: {} reached the goal, {} hit a pedestrian, {} a wall, {} ran out of time",
                policy.name,
                policy.note,
                self.episodes.len(),
                count(Outcome::Success),
                count(Outcome::CollisionPedestrian),
                count(Outcome::CollisionWall),
                count(Outcome::Timeout)
            )
        };
        self.policies.iter().enumerate().map(line).collect::<Vec<_>>().join("\n")
    }

    /// The whole file.
    pub fn html(&self) -> Result<String> {
        // `<` can stand in strings alone, where its escape means the same; so no name can close the
        // script.
        let data = serde_json::to_string(self).context("a page that is no JSON")?.replace('<', "\\u003c");
        let names: Vec<&str> = self.policies.iter().map(|policy| policy.name.as_str()).collect();
        let title = format!("jostle: {}", names.join(" and ")).replace('&', "&amp;").replace('<', "&lt;");
        let parts = [
            ("title", title.as_str()),
            ("style", STYLE),
            ("data", &data),
            ("scene", SCENE),
            ("parts", PARTS),
            ("player", PLAYER),
        ];
        Ok(fill(TEMPLATE, &parts))
    }
}

/// The template with each `{{name}}` replaced once; what is put in is not searched again.
pub fn fill(template: &str, parts: &[(&str, &str)]) -> String {
    let mut text = String::new();
    let mut rest = template;
    for (name, part) in parts {
        let (before, after) =
            rest.split_once(&format!("{{{{{name}}}}}")).expect("the template names its parts in order");
        text.push_str(before);
        text.push_str(part);
        rest = after;
    }
    text + rest
}

/// `range` is the laser's (m).
fn run_of(trace: &EpisodeTrace, range: f32) -> Run {
    let frames = &trace.frames;
    let pose = |body: &Pedestrian| [centi(body.position.x), centi(body.position.y), milli(body.heading)];
    let integers = |of: &dyn Fn(&TraceFrame) -> Vec<i16>| -> String {
        BASE64_STANDARD.encode(frames.iter().flat_map(of).flat_map(i16::to_le_bytes).collect::<Vec<u8>>())
    };
    Run {
        outcome: trace.finished.outcome,
        steps: trace.finished.steps,
        metrics: trace.finished.metrics,
        pedestrian_token: trace.pedestrian_token,
        speed_factors: trace.speed_factors.clone(),
        robot: integers(&|frame| pose(&frame.robot).to_vec()),
        command: integers(&|frame| frame.velocity.map(milli).to_vec()),
        near: integers(&|frame| vec![centi(frame.min_range)]),
        ranges: BASE64_STANDARD
            .encode(frames.iter().flat_map(|frame| ranges_of(frame, range)).collect::<Vec<u8>>()),
        pedestrians: integers(&|frame| frame.pedestrians.iter().flat_map(pose).collect()),
        goals: goals_of(frames),
    }
}

/// The ranges of the beams that a page keeps, of those that the trace has: 0 is 0 m and 255 the
/// laser's range.
fn ranges_of(frame: &TraceFrame, range: f32) -> impl Iterator<Item = u8> {
    let quantise = move |reading: &f32| (reading / range * 255.0).round().clamp(0.0, 255.0) as u8;
    frame.ranges.iter().step_by(beam_stride(frame.ranges.len(), BEAMS)).map(quantise)
}

/// The pedestrians' first goals and each one that replaces another.
fn goals_of(frames: &[TraceFrame]) -> Vec<(usize, usize, f32, f32)> {
    let mut goals = Vec::new();
    for (step, frame) in frames.iter().enumerate() {
        for (body, pedestrian) in frame.pedestrians.iter().enumerate() {
            if step == 0 || frames[step - 1].pedestrians[body].goal != pedestrian.goal {
                goals.push((step, body, pedestrian.goal.x, pedestrian.goal.y));
            }
        }
    }
    goals
}

fn centi(value: f32) -> i16 {
    (value * 100.0).round() as i16
}

fn milli(value: f32) -> i16 {
    (value * 1000.0).round() as i16
}

#[cfg(test)]
mod tests {
    use jostle_sim::LaserConfig;

    use super::{LaserScene, fill};

    #[test]
    fn kept_beams_are_drawn_where_the_laser_points_them() {
        let sector = LaserConfig { beams: 541, fov: 4.7, angle_min: -2.35, ..LaserConfig::default() };
        let half = LaserConfig { beams: 16, fov: std::f32::consts::PI, ..LaserConfig::default() };
        for (laser, kept) in [(LaserConfig::default(), 128), (sector, 109), (half, 16)] {
            let scene = LaserScene::new(&laser);
            let stride = laser.beams.div_ceil(kept);
            assert_eq!((scene.beams, scene.circle), (kept, laser.is_full_circle()));
            for k in 0..kept {
                let drawn = f64::from(scene.start + k as f32 * scene.step);
                assert!((drawn - laser.beam_angle(k * stride)).abs() < 1e-5, "beam {k} of {laser:?}");
            }
        }
    }

    #[test]
    fn what_is_filled_in_is_not_searched() {
        assert_eq!(fill("<{{a}}|{{b}}>", &[("a", "{{b}}"), ("b", "x")]), "<{{b}}|x>");
    }
}
