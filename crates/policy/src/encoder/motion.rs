//! Inputs with explicit motion: bodies with their velocities, and the time at which each path would
//! meet them.
//!
//! Only from the observation row: clusters of the newest scan that are small enough to be bodies
//! are matched with those of the scan before, which the row's (v, ω) carries into the frame of now
//! (a velocity acts for one step at once, so this odometry is exact). A network that reads raw
//! scans must learn all of that from pixels; the study (docs/study.md) shows what that costs.
//!
//! | inputs | meaning |
//! |---|---|
//! | 32 | closeness 1/(½ + r) of the nearest return in each sector of 16 beams (for 512) |
//! | 2 × 48 | urgency of each path of [`paths`](super::paths): 1 − t/[`HORIZON`] for the time t to the first body or wall on it, else 0; for what would be a crash, then with a wider berth |
//! | 24 | the full-speed ones of the first 48 again, counted from the goal's direction |
//! | 1 | urgency of staying where it is |
//! | 8 × 7 | the eight nearest bodies: 1, x/5, y/5, closeness, velocity (m/s), approach speed; zeros where there is none |
//! | 4 | the goal: distance/10, min(distance, 2)/2, cosine and sine of its direction |
//! | 2 | v and ω |

#![allow(clippy::inline_always, reason = "what Isa::run compiles anew must be inlined into it")]

use jostle_kernels::{Isa, Work};
use serde::{Deserialize, Serialize};

use super::clusters::{Beams, Cluster, SIZE_MAX, ScanClusters, distance_sq, run_of};
use super::paths::{DIRECTIONS, FREE, HORIZON, Meetings, PATHS, Paths, STEPS};
use crate::observation::TAIL_LEN;

/// Sectors of the scan.
const SECTORS: usize = 32;
/// Bodies listed one by one.
const TRACKS: usize = 8;
/// Values of a listed body.
const TRACK_LEN: usize = 7;
/// Length of an input row.
pub const INPUT_LEN: usize = SECTORS + BERTHS * PATHS + DIRECTIONS + 1 + TRACKS * TRACK_LEN + 4 + 2;

/// A cluster of the scan before is the same body if it is nearer than this, m: 2.5 m/s at 0.1 s.
const MATCH: f32 = 0.25;
/// A centre of mass behind the visible points of a body of 0.5 m, m.
const DEPTH: f32 = 0.2;
/// Berths of paths.
const BERTHS: usize = 2;
/// Centres nearer than the first of these have crashed, m: the crash range and a body's half width
/// (0.25 m, at a corner 0.35 m). The second is a berth that leaves room for someone who turns.
const BODY_RADII: [f32; BERTHS] = [0.82, 1.3];
/// Returns of walls nearer than the first of these have crashed, m, with a little room; the second
/// is a wider berth.
const WALL_RADII: [f32; BERTHS] = [0.55, 0.8];
/// Returns of walls beyond this are met by no path that matters, m.
const WALL_REACH: f32 = 4.0;
/// Distance of the returns of a wall that are looked at, m: discs of the first of [`WALL_RADII`]
/// leave no gap.
const WALL_SPACING: f32 = 0.25;
/// Fewer beams than this share of a body's expected number make no body: specks of walls seen at a
/// grazing angle.
const FEWEST_SHARE: f32 = 0.35;

/// The properties of the robot that the motion encoder must know.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionInputs {
    /// Control period, s.
    pub dt: f32,
    /// Largest linear velocity, m/s.
    pub v_max: f32,
    /// Largest angular velocity, rad/s.
    pub w_max: f32,
}

/// A body that was seen in the newest scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Mean of its visible points in the robot's frame, m.
    pub centre: [f32; 2],
    /// Its velocity over ground, in the robot's frame, m/s; 0 where it was not seen in the scan
    /// before.
    pub velocity: [f32; 2],
    /// Least range, m.
    pub nearest: f32,
}

/// Memory of the encoder: the two newest scans and the bodies in them.
#[derive(Debug, Clone, Default)]
pub struct MotionScratch {
    tracks: Vec<Track>,
    before: ScanClusters,
    now: ScanClusters,
    /// For each cluster of the newest scan, `true` if it may be a body.
    is_track: Vec<bool>,
}

/// One row's encoding.
struct Encoding<'a> {
    encoder: &'a MotionEncoder,
    observation: &'a [f32],
    scratch: &'a mut MotionScratch,
    input: &'a mut [f32],
}

impl Work for Encoding<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.encoder.encode_row(self.observation, self.scratch, self.input);
    }
}

/// The encoder's tables.
#[derive(Debug, Clone)]
pub struct MotionEncoder {
    inputs: MotionInputs,
    beams: Beams,
    paths: Paths,
}

impl MotionEncoder {
    /// An encoder of scans of `beams` beams over the full circle.
    pub fn new(inputs: &MotionInputs, beams: usize) -> Self {
        Self { inputs: *inputs, beams: Beams::new(beams), paths: Paths::new(inputs.v_max, inputs.w_max) }
    }

    /// Encodes one row (see the module).
    pub(super) fn encode(&self, observation: &[f32], scratch: &mut MotionScratch, input: &mut [f32]) {
        self.encode_with(Isa::detect(), observation, scratch, input);
    }

    fn encode_with(&self, isa: Isa, observation: &[f32], scratch: &mut MotionScratch, input: &mut [f32]) {
        isa.run(Encoding { encoder: self, observation, scratch, input });
    }

    #[inline(always)]
    fn encode_row(&self, observation: &[f32], scratch: &mut MotionScratch, input: &mut [f32]) {
        let tail = &observation[observation.len() - TAIL_LEN..];
        let &[goal_x, goal_y, v, w] = tail else { unreachable!("a tail of four values") };
        self.find_tracks(observation, scratch);
        let tracks = &scratch.tracks[..];
        let (sectors, rest) = input.split_at_mut(SECTORS);
        let (urgencies, rest) = rest.split_at_mut(BERTHS * PATHS);
        let (from_goal, rest) = rest.split_at_mut(DIRECTIONS);
        let (standing, rest) = rest.split_at_mut(1);
        let (listed, rest) = rest.split_at_mut(TRACKS * TRACK_LEN);

        self.write_sectors(&scratch.now, sectors);
        let mut meetings: [Meetings; BERTHS] = [[FREE; PATHS]; BERTHS];
        for track in tracks {
            self.paths.meet(body_centre(track), track.velocity, BODY_RADII, &mut meetings);
        }
        self.meet_walls(scratch, &mut meetings);
        for (to, meeting) in urgencies.iter_mut().zip(meetings.as_flattened()) {
            *to = (FREE - meeting) / STEPS as f32;
        }
        let distance = (goal_x * goal_x + goal_y * goal_y).sqrt();
        let (cos, sin) = if distance > 1e-6 { (goal_x / distance, goal_y / distance) } else { (1.0, 0.0) };
        turn_to(libm::atan2f(sin, cos), &urgencies[..DIRECTIONS], from_goal);
        standing[0] = tracks.iter().map(standing_urgency).fold(0.0, f32::max);
        listed.fill(0.0);
        for (to, track) in listed.chunks_exact_mut(TRACK_LEN).zip(tracks) {
            write_track(track, [v, 0.0], to);
        }
        rest.copy_from_slice(&[distance / 10.0, distance.min(2.0) / 2.0, cos, sin, v, w]);
    }

    /// The bodies of an observation row's newest scan, nearest first.
    pub fn tracks<'a>(&self, observation: &[f32], scratch: &'a mut MotionScratch) -> &'a [Track] {
        self.find_tracks(observation, scratch);
        &scratch.tracks
    }

    #[inline(always)]
    fn find_tracks(&self, observation: &[f32], scratch: &mut MotionScratch) {
        let n = self.beams.len();
        let newest = observation.len() - TAIL_LEN - n;
        let MotionScratch { before, now, is_track, tracks } = scratch;
        before.read(&self.beams, &observation[newest - n..newest]);
        now.read(&self.beams, &observation[newest..newest + n]);
        let &[_, _, v, w] = &observation[newest + n..] else { unreachable!("a tail of four values") };
        let dt = self.inputs.dt;
        let (sin, cos) = libm::sincosf(-w * dt);
        // The robot drives along its old heading, then turns.
        let carried = |[x, y]: [f32; 2]| {
            let x = x - v * dt;
            [x * cos - y * sin, x * sin + y * cos]
        };
        is_track.clear();
        tracks.clear();
        for cluster in &now.clusters {
            let is_body = self.is_body(cluster);
            is_track.push(is_body);
            if !is_body {
                continue;
            }
            let bodies = before.clusters.iter().filter(|c| self.is_body(c)).map(|c| carried(c.centre));
            let nearest = bodies
                .map(|centre| (distance_sq(centre, cluster.centre), centre))
                .filter(|(d, _)| *d <= MATCH * MATCH)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let velocity = nearest
                .map_or([0.0; 2], |(_, [x, y])| [(cluster.centre[0] - x) / dt, (cluster.centre[1] - y) / dt]);
            tracks.push(Track { centre: cluster.centre, velocity, nearest: cluster.nearest });
        }
        tracks.sort_by(|a, b| a.nearest.total_cmp(&b.nearest));
    }

    /// `true` if a cluster may be a body: small, and of enough beams for its distance.
    #[inline(always)]
    fn is_body(&self, cluster: &Cluster) -> bool {
        let spacing = std::f32::consts::TAU / self.beams.len() as f32;
        let expected = 0.5 / (cluster.nearest.max(0.1) * spacing);
        cluster.size <= SIZE_MAX && cluster.n as f32 >= (FEWEST_SHARE * expected).max(2.0)
    }

    #[inline(always)]
    fn write_sectors(&self, now: &ScanClusters, sectors: &mut [f32]) {
        let n = self.beams.len();
        for (sector, to) in sectors.iter_mut().enumerate() {
            let (from, end) = (sector * n / SECTORS, (sector + 1) * n / SECTORS);
            let closer = |a: f32, b: f32| if b < a { b } else { a };
            let nearest = now.ranges[from..end].iter().copied().fold(f32::INFINITY, closer);
            *to = 1.0 / (0.5 + nearest);
        }
    }

    /// Brings in everything that is no body, as discs that do not move, at least [`WALL_SPACING`]
    /// apart.
    #[inline(always)]
    fn meet_walls(&self, scratch: &MotionScratch, meetings: &mut [Meetings; BERTHS]) {
        let (now, n) = (&scratch.now, self.beams.len());
        let walls =
            now.clusters.iter().zip(&scratch.is_track).filter(|(c, is)| !**is && c.nearest < WALL_REACH);
        for (cluster, _) in walls {
            let mut last = [f32::INFINITY; 2];
            for beam in run_of(cluster.first, cluster.n, n).filter(|beam| now.ranges[*beam] < WALL_REACH) {
                let point = now.points[beam];
                if distance_sq(point, last) >= WALL_SPACING * WALL_SPACING {
                    self.paths.meet(point, [0.0; 2], WALL_RADII, meetings);
                    last = point;
                }
            }
        }
    }
}

/// The body's centre, behind its visible points.
fn body_centre(track: &Track) -> [f32; 2] {
    let [x, y] = track.centre;
    let scale = 1.0 + DEPTH / (x * x + y * y).sqrt().max(0.1);
    [x * scale, y * scale]
}

/// 1 − t/[`HORIZON`] for the time t until a body comes within the first of [`BODY_RADII`] of a
/// robot that does not move, else 0.
fn standing_urgency(track: &Track) -> f32 {
    let ([x, y], [vx, vy]) = (body_centre(track), track.velocity);
    let (c, speed_sq) = (x * x + y * y - BODY_RADII[0] * BODY_RADII[0], vx * vx + vy * vy);
    if c <= 0.0 {
        return 1.0;
    }
    let b = x * vx + y * vy;
    let discriminant = b * b - speed_sq * c;
    if b >= 0.0 || discriminant < 0.0 || speed_sq == 0.0 {
        return 0.0;
    }
    let time = (-b - discriminant.sqrt()) / speed_sq;
    (1.0 - time / HORIZON).max(0.0)
}

fn write_track(track: &Track, own: [f32; 2], to: &mut [f32]) {
    let ([x, y], [vx, vy]) = (track.centre, track.velocity);
    let distance = (x * x + y * y).sqrt().max(0.1);
    let approach = ((own[0] - vx) * x + (own[1] - vy) * y) / distance;
    to.copy_from_slice(&[1.0, x / 5.0, y / 5.0, 1.0 / (0.5 + track.nearest), vx, vy, approach]);
}

/// Values around the circle, counted anew from `angle` (rad), between the two nearest of them.
fn turn_to(angle: f32, around: &[f32], turned: &mut [f32]) {
    let n = around.len();
    let at = (angle / std::f32::consts::TAU).rem_euclid(1.0) * n as f32;
    let (whole, part) = (at.floor(), at - at.floor());
    let whole = whole as usize;
    for (i, to) in turned.iter_mut().enumerate() {
        let (a, b) = (around[(whole + i) % n], around[(whole + i + 1) % n]);
        *to = a + part * (b - a);
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let inputs = MotionInputs { dt: 0.1, v_max: 1.0, w_max: 1.0 };
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut uniform =
            |low: f32, high: f32| low + (high - low) * (rng.next_u32() as f32 / u32::MAX as f32);
        // Odd numbers of beams leave lanes over.
        for beams in [512, 509, 37] {
            let encoder = MotionEncoder::new(&inputs, beams);
            for _ in 0..50 {
                // Walls with steps between them, bodies before them, misses.
                let mut row = Vec::new();
                for _ in 0..3 {
                    let mut range = uniform(1.0, 10.0);
                    for _ in 0..beams {
                        let event = uniform(0.0, 1.0);
                        range = if event < 0.04 { uniform(0.3, 10.0) } else { range + uniform(-0.02, 0.02) };
                        row.push(if event > 0.98 { 0.5 } else { range.clamp(0.0, 9.9) / 10.0 - 0.5 });
                    }
                }
                row.extend([uniform(-9.0, 9.0), uniform(-9.0, 9.0), uniform(0.0, 1.0), uniform(-1.0, 1.0)]);
                let encoded = Isa::available().into_iter().map(|isa| {
                    let mut input = [0.0; INPUT_LEN];
                    encoder.encode_with(isa, &row, &mut MotionScratch::default(), &mut input);
                    input.map(f32::to_bits)
                });
                let all: Vec<_> = encoded.collect();
                assert!(all.iter().all(|bits| bits == &all[0]), "{beams} beams");
            }
        }
    }
}
