//! Scans of fixed scenes, by both kernels: ranges, what is hit, the nearest return, crash.

use anyhow::{Context as _, Result};
use jostle_sim::{EpisodeConfig, Hit, LaserConfig, LaserKernel, ScanScene, SceneScan};
use serde::Deserialize;

use super::verdict::Verdict;

/// Every beam.
const EACH: f64 = 1e-3;
/// All but one beam in a thousand.
const MOST: f64 = 1e-4;

#[derive(Deserialize)]
pub(crate) struct LidarFile {
    beams: usize,
    range: f32,
    body_side: f64,
    scenes: Vec<Scene>,
}

#[derive(Deserialize)]
struct Scene {
    name: String,
    room: Room,
    sensor: [f64; 3],
    bodies: Vec<[f64; 3]>,
    invisible: Vec<usize>,
    polygons: Vec<Vec<[f64; 2]>>,
    expected: Expected,
}

#[derive(Deserialize)]
struct Room {
    min: [f64; 2],
    max: [f64; 2],
}

#[derive(Deserialize)]
struct Expected {
    ranges: Vec<f64>,
    #[serde(default)]
    hit: Option<Vec<Option<(String, usize)>>>,
    min_range: f64,
    crash: bool,
    #[serde(default)]
    unstable_beams: Vec<Unstable>,
}

/// A beam that grazes an edge or a corner: any range in between is right.
#[derive(Deserialize)]
struct Unstable {
    beam: usize,
    low: f64,
    high: f64,
}

/// Checks every scene with both kernels.
pub(crate) fn check(file: &LidarFile, verdict: &mut Verdict) -> Result<()> {
    for kernel in [LaserKernel::Analytic, LaserKernel::Parry] {
        let laser = LaserConfig {
            beams: file.beams,
            range: file.range,
            noise_std: 0.0,
            kernel,
            ..LaserConfig::default()
        };
        let (mut far, mut stable) = (0, 0);
        for scene in &file.scenes {
            let name = format!("{} ({kernel:?})", scene.name);
            let scan = scan(scene, file.body_side, &laser).with_context(|| name.clone())?;
            if scene.expected.ranges.len() != scan.ranges.len() {
                verdict.problem(format!("{name}: {} expected ranges", scene.expected.ranges.len()));
                continue;
            }
            let errors = check_ranges(scene, &scan, &name, verdict);
            far += errors.iter().filter(|&&error| error > MOST).count();
            stable += errors.len();
            check_hits(&scene.expected, &scan, f64::from(file.range), &name, verdict)?;
            check_nearest(&scene.expected, &scan, &name, verdict);
        }
        let share = far as f64 / stable.max(1) as f64;
        verdict.error(share, 1e-3, || format!("{kernel:?}: share of beams off by more than {MOST} m"));
    }
    Ok(())
}

fn scan(scene: &Scene, body_side: f64, laser: &LaserConfig) -> Result<SceneScan> {
    let scene = ScanScene {
        room: Some((scene.room.min, scene.room.max)),
        sensor: scene.sensor,
        bodies: scene.bodies.clone(),
        body_side,
        invisible: scene.invisible.clone(),
        polygons: scene.polygons.clone(),
    };
    Ok(scene.scan(laser)?)
}

/// Errors of the stable beams (m).
fn check_ranges(scene: &Scene, scan: &SceneScan, name: &str, verdict: &mut Verdict) -> Vec<f64> {
    let mut errors = Vec::with_capacity(scan.ranges.len());
    for (beam, (&range, &expected)) in scan.ranges.iter().zip(&scene.expected.ranges).enumerate() {
        let range = f64::from(range);
        if let Some(unstable) = scene.expected.unstable(beam) {
            let outside = (unstable.low - range).max(range - unstable.high).max(0.0);
            verdict.error(outside, EACH, || format!("{name}: unstable beam {beam}"));
        } else {
            verdict.close(range, expected, EACH, 0.0, || format!("{name}: beam {beam}"));
            errors.push((range - expected).abs());
        }
    }
    errors
}

fn check_hits(
    expected: &Expected,
    scan: &SceneScan,
    limit: f64,
    name: &str,
    verdict: &mut Verdict,
) -> Result<()> {
    let Some(wanted) = &expected.hit else { return Ok(()) };
    verdict.same(&scan.hits.len(), &wanted.len(), || format!("{name}: number of hits"));
    for (beam, (&hit, wanted)) in scan.hits.iter().zip(wanted).enumerate() {
        let at_limit = (expected.ranges[beam] - limit).abs() < EACH && wanted.is_some();
        // At the very end of the range rounding decides whether something is hit at all.
        if expected.unstable(beam).is_some() || (at_limit && hit == Hit::None) {
            continue;
        }
        let wanted = match wanted.as_ref().map(|(kind, index)| (kind.as_str(), *index)) {
            None => Hit::None,
            Some(("wall", index)) => Hit::Wall(index),
            Some(("body", index)) => Hit::Body(index),
            Some(("polygon", index)) => Hit::Obstacle(index),
            Some((other, _)) => anyhow::bail!("{name}: a beam hits {other:?}, which is not known"),
        };
        verdict.same(&hit, &wanted, || format!("{name}: what beam {beam} hits"));
    }
    Ok(())
}

fn check_nearest(expected: &Expected, scan: &SceneScan, name: &str, verdict: &mut Verdict) {
    let nearest_is_stable = expected.unstable_beams.iter().all(|beam| beam.low > expected.min_range + EACH);
    if nearest_is_stable {
        verdict
            .close(f64::from(scan.min_range), expected.min_range, EACH, 0.0, || format!("{name}: min_range"));
    }
    let crash_range = EpisodeConfig::default().crash_range;
    if nearest_is_stable && (expected.min_range - f64::from(crash_range)).abs() > MOST {
        verdict.same(&(scan.min_range < crash_range), &expected.crash, || format!("{name}: crash"));
    }
}

impl Expected {
    fn unstable(&self, beam: usize) -> Option<&Unstable> {
        self.unstable_beams.iter().find(|unstable| unstable.beam == beam)
    }
}
