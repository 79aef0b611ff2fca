//! The targets: for each kind of file, a valid start, and the function that a command would call.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use jostle_arena::Outcome;
use jostle_arena::config::ArenaConfig;
use jostle_arena::driving::DrivingMeter;
use jostle_arena::identity::PolicyIdentity;
use jostle_arena::loaded::LoadedPolicy;
use jostle_arena::metrics::{EpisodeMetrics, MetricScale};
use jostle_arena::recording::RecordingConfig;
use jostle_arena::robot::TrainedRobot;
use jostle_arena::room::{ArenaRoom, RoomPlan};
use jostle_eval::records::{EpisodeRecord, read_records};
use jostle_peds::{Command, CrowdKind};
use jostle_policy::Backend;
use jostle_ppo::{Config, Trainer};
use jostle_sim::{Laser, Rooms, SimConfig, StreamRng, Streams};
use rand::RngExt as _;

use super::archive::{Archive, damage_png};
use super::mutate::{mutate, mutate_text};

/// A parser's answer.
pub(super) enum Verdict {
    Accepted,
    Refused(String),
}

/// Tries one input that it draws.
type Case = Box<dyn FnMut(&mut StreamRng) -> Result<Verdict>>;

/// A parser.
pub(super) struct Target {
    pub(super) name: &'static str,
    /// Prepares valid inputs in a scratch folder.
    pub(super) prepare: fn(&Path) -> Result<Case>,
}

/// All parsers of files that a stranger may have made.
pub(super) const TARGETS: [Target; 9] = [
    Target { name: "config", prepare: config },
    Target { name: "checkpoint", prepare: checkpoint },
    Target { name: "policy", prepare: policy },
    Target { name: "map-yaml", prepare: map_yaml },
    Target { name: "map-pgm", prepare: map_pgm },
    Target { name: "map-png", prepare: map_png },
    Target { name: "polygons", prepare: polygons },
    Target { name: "records", prepare: records },
    Target { name: "recording", prepare: recording },
];

/// A run of two agents with 16 beams.
const TINY: &str = "\
    N = 2\nM = 2\nR = 1\nhorizon = 8\nminibatch = 8\nalpha = 0.1\nintrinsic_reward = \"difference\"\n\
    network = { embedding = 4, laser_feature = 32, hidden = 32, log_std_init = -0.5 }\n\
    discriminator = { hidden = 32, learning_rate = 1e-3 }\n\
    [sim]\nroom = { width = 12.0, height = 12.0 }\nlaser = { beams = 16, noise_std = 0.02 }\n\
    episode = { step_limit = 20, goal_radius = 0.5 }\nspawn = { goal_distance = 2.0 }\n";
const NONE: &[&str] = &[];
/// Transitions of an update that is cheap enough to be tried.
const CHEAP: usize = 4096;

fn verdict<T>(result: Result<T, impl std::fmt::Display>) -> Verdict {
    result.map_or_else(|error| Verdict::Refused(error.to_string()), |_| Verdict::Accepted)
}

/// Configurations with overrides; one that is accepted must survive its own canonical form.
fn config(scratch: &Path) -> Result<Case> {
    let path = scratch.join("input.toml");
    let full = toml::to_string(&Config::default()).context("the default is TOML")?;
    Ok(Box::new(move |rng| {
        let seed = if rng.random() { TINY } else { &full };
        let text = mutate_text(seed, rng);
        let overrides: Vec<String> = (0..rng.random_range(0..2_u32))
            .map(|_| {
                mutate_text(
                    ["alpha=0.3", "sim.laser.beams = 64", "backend=fast", "N=3"]
                        [rng.random_range(0..4_usize)],
                    rng,
                )
            })
            .collect();
        fs::write(&path, format!("{text}\n# overrides: {overrides:?}"))?;
        let parsed = Config::parse(&text, "input.toml", &overrides);
        if let Ok(config) = &parsed {
            let read =
                Config::parse(&config.canonical_toml(), "canonical", NONE).map_err(|error| error.to_string());
            assert_eq!(read.map(|again| again.hash()), Ok(config.hash()), "the canonical form reads back");
        }
        Ok(verdict(parsed))
    }))
}

/// Checkpoints, raw and below their checksum; one that is accepted must be able to go on, or say
/// why not.
fn checkpoint(scratch: &Path) -> Result<Case> {
    let path = scratch.join("input.safetensors");
    let mut trainer = Trainer::new(Config::parse(TINY, "tiny", NONE)?)?;
    trainer.update()?;
    trainer.save(&path)?;
    let (whole, archive) = (fs::read(&path)?, Archive::read(&path)?);
    Ok(Box::new(move |rng| {
        damage_archive(&path, &whole, &archive, rng)?;
        Ok(match Trainer::resume(&path) {
            Ok(mut trainer) if trainer.config().rollout_len() <= CHEAP => verdict(trainer.update()),
            resumed => verdict(resumed),
        })
    }))
}

/// Policies as evaluation reads them.
fn policy(scratch: &Path) -> Result<Case> {
    let path = scratch.join("input.safetensors");
    Trainer::new(Config::parse(TINY, "tiny", NONE)?)?.save(&path)?;
    let loaded = LoadedPolicy::load(&path)?;
    loaded.file.write(&path, jostle_policy::file::Precision::F16)?;
    let (whole, archive) = (fs::read(&path)?, Archive::read(&path)?);
    Ok(Box::new(move |rng| {
        damage_archive(&path, &whole, &archive, rng)?;
        let use_it = || -> Result<(), jostle_arena::ArenaError> {
            let policy = LoadedPolicy::load(&path)?;
            let n_agents = usize::try_from(policy.file.provenance.n_agents).unwrap_or(usize::MAX);
            ArenaConfig { sim: policy.sim_config()?, n_agents, ..ArenaConfig::default() }.validate()?;
            TrainedRobot::new(&policy, 0, Backend::Fast).map(drop)
        };
        Ok(verdict(use_it()))
    }))
}

fn damage_archive(path: &Path, whole: &[u8], archive: &Archive, rng: &mut StreamRng) -> Result<()> {
    if rng.random_ratio(1, 3) || !archive.write_damaged(path, rng) {
        let mut bytes = whole.to_vec();
        mutate(&mut bytes, rng);
        fs::write(path, bytes)?;
    }
    Ok(())
}

const YAML: &str = "image: input.pgm\nresolution: 0.5\norigin: [-4.0, -3.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n";

/// The same keys in other words and forms, and a map that is turned.
const YAML_IN_FULL: &str = "# a map\n---\nimage: 'input.pgm'\nresolution: &r 0.5\norigin:\n  - -4.0\n  - -3.0\n  - 0.4\nnegate: off\n\
    occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: scale\nother: {a: [1, *r], b: ~}\n";

/// `map.yaml` beside a sound image.
fn map_yaml(scratch: &Path) -> Result<Case> {
    let path = scratch.join("input.yaml");
    fs::write(scratch.join("input.pgm"), pgm(true))?;
    Ok(Box::new(move |rng| {
        let seed = if rng.random() { YAML } else { YAML_IN_FULL };
        let mut bytes = seed.as_bytes().to_vec();
        mutate(&mut bytes, rng);
        fs::write(&path, bytes)?;
        Ok(live_in(&path))
    }))
}

/// PGM images, text and binary, beside a sound yaml.
fn map_pgm(scratch: &Path) -> Result<Case> {
    let (path, image) = (scratch.join("input.yaml"), scratch.join("input.pgm"));
    fs::write(&path, YAML)?;
    Ok(Box::new(move |rng| {
        let mut bytes = pgm(rng.random());
        mutate(&mut bytes, rng);
        fs::write(&image, bytes)?;
        Ok(live_in(&path))
    }))
}

/// PNG images of every colour type beside a sound yaml.
fn map_png(scratch: &Path) -> Result<Case> {
    let (path, image) = (scratch.join("input.yaml"), scratch.join("input.png"));
    fs::write(&path, YAML.replace("input.pgm", "input.png"))?;
    let images = [
        png_image(png::ColorType::Grayscale, png::BitDepth::Eight)?,
        png_image(png::ColorType::Grayscale, png::BitDepth::One)?,
        png_image(png::ColorType::GrayscaleAlpha, png::BitDepth::Sixteen)?,
        png_image(png::ColorType::Rgb, png::BitDepth::Eight)?,
        png_image(png::ColorType::Rgba, png::BitDepth::Sixteen)?,
        png_image(png::ColorType::Indexed, png::BitDepth::Four)?,
    ];
    Ok(Box::new(move |rng| {
        let bytes = damage_png(&images[rng.random_range(0..images.len())], rng)?;
        fs::write(&image, bytes)?;
        Ok(live_in(&path))
    }))
}

/// Polygon maps in TOML and JSON.
fn polygons(scratch: &Path) -> Result<Case> {
    const MAP: &str = "walls = { min = [-8.0, -8.0], max = [8.0, 8.0] }\n\
        [[obstacle]]\npolygon = [[1.0, 0.0], [2.0, 0.0], [1.5, 1.0]]\n[[obstacle]]\nsegment = [[-3.0, 0.0], [-3.0, 4.0]]\n\
        [[obstacle]]\ncircle = { centre = [5.0, 5.0], radius = 0.4 }\n\
        [[obstacle]]\nbox = { centre = [0.0, -5.0], heading = 0.3, length = 2.0, width = 0.5 }\n";
    let json = serde_json::to_string(&toml::from_str::<serde_json::Value>(MAP)?)?;
    let paths = [scratch.join("input.toml"), scratch.join("input.json")];
    Ok(Box::new(move |rng| {
        let (path, seed) = if rng.random() { (&paths[0], MAP) } else { (&paths[1], json.as_str()) };
        let mut bytes = seed.as_bytes().to_vec();
        mutate(&mut bytes, rng);
        fs::write(path, bytes)?;
        Ok(live_in(path))
    }))
}

/// Makes a room of a map and takes a few steps in it.
fn live_in(map: &Path) -> Verdict {
    let mut config = SimConfig::default();
    config.room.map = Some(map.to_owned());
    config.laser.beams = 16;
    config.spawn.goal_distance = 1.0;
    match Rooms::new(&config, 1, 1, 1, &Streams::new(1)) {
        Ok(mut rooms) => {
            (0..3).for_each(|_| rooms.step(&[[1.0, 0.5]]));
            Verdict::Accepted
        }
        Err(error) => Verdict::Refused(error.to_string()),
    }
}

/// Records of episodes.
fn records(scratch: &Path) -> Result<Case> {
    let path = scratch.join("input.ndjson");
    let scale = MetricScale { dt: 0.1, goal_radius: 0.5, v_max: 1.0 };
    let line = |k: u64| {
        let outcome = Outcome::ALL[k as usize % Outcome::ALL.len()];
        let record = EpisodeRecord {
            episode: k,
            crowd: CrowdKind::Sf.into(),
            token: 0,
            outcome,
            steps: 123,
            start: [0.1, -9.87],
            goal: [0.3, 5.0],
            metrics: EpisodeMetrics::from_totals(&scale, outcome, 123, 12.5, 10.0),
            driving: (k > 0).then(|| DrivingMeter::new(scale.dt).driving()),
            cell: "0123456789abcdef".to_owned(),
            provenance: PolicyIdentity::custom("fuzz", "1").reference(),
        };
        serde_json::to_string(&record).map(|text| text + "\n")
    };
    let text = (0..4).map(line).collect::<Result<String, _>>()?;
    Ok(Box::new(move |rng| {
        let mut bytes = text.as_bytes().to_vec();
        mutate(&mut bytes, rng);
        fs::write(&path, bytes)?;
        Ok(verdict(read_records(&path)))
    }))
}

/// Recorded people in every form; those that are accepted walk a few steps.
fn recording(scratch: &Path) -> Result<Case> {
    let (mut plain, mut obsmat, mut trajnet) = (String::new(), String::new(), String::new());
    trajnet += "{\"scene\": {\"id\": 0, \"p\": 1, \"s\": 0, \"e\": 50, \"fps\": 2.5, \"tag\": [1, []]}}\n";
    for frame in (0..=50).step_by(10) {
        for (id, y) in [(1, 0.0), (2, 6.5)] {
            let x = f64::from(frame) * 0.06;
            writeln!(plain, "{frame} {id} {x} {y}")?;
            writeln!(obsmat, "{frame}.0e+00 {id}.0e+00 {x} 0 {y} 0.9 0 0")?;
            writeln!(trajnet, "{{\"track\": {{\"f\": {frame}, \"p\": {id}, \"x\": {x}, \"y\": {y}}}}}")?;
        }
    }
    let files = [("input.txt", plain), ("obsmat.txt", obsmat), ("input.ndjson", trajnet)]
        .map(|(name, text)| (scratch.join(name), text));
    Ok(Box::new(move |rng| {
        let (path, text) = &files[rng.random_range(0..files.len())];
        let mut bytes = text.as_bytes().to_vec();
        mutate(&mut bytes, rng);
        fs::write(path, bytes)?;
        let max_gap = rng.random::<bool>().then_some(5.0);
        Ok(verdict(walk_through(path, max_gap)))
    }))
}

/// Reads a recording and makes a room of it for a few steps.
fn walk_through(path: &Path, max_gap: Option<f64>) -> Result<(), jostle_arena::ArenaError> {
    let mut base = ArenaConfig::default();
    base.sim.laser.beams = 16;
    let config = RecordingConfig::read(path, None, max_gap, 0.1)?.config(&base)?;
    let plan = RoomPlan::new(&config, CrowdKind::Recorded)?;
    let mut room = ArenaRoom::new(&plan, &Laser::new(&config.sim.laser)?, 0)?;
    let still = vec![Command::STILL; config.n_pedestrians()];
    for _ in 0..3 {
        if room.step(&plan, [1.0, 0.5], &still)?.is_some() {
            break;
        }
    }
    Ok(())
}

/// A room of 16 by 12 cells with a few obstacles.
fn cells() -> Vec<u8> {
    (0..16 * 12).map(|i| if i % 37 == 0 || (i / 16 == 6 && i % 16 < 5) { 0 } else { 254 }).collect()
}

fn pgm(binary: bool) -> Vec<u8> {
    if binary {
        return [b"P5\n# a comment\n16 12\n255\n".to_vec(), cells()].concat();
    }
    let cells: Vec<String> = cells().iter().map(u8::to_string).collect();
    format!("P2\n16 12\n255\n{}\n", cells.join(" ")).into_bytes()
}

fn png_image(colour: png::ColorType, depth: png::BitDepth) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 16, 12);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == png::ColorType::Indexed {
        encoder.set_palette([0, 0, 0, 254, 254, 254].as_slice());
    }
    let row = (16 * colour.samples() * depth as usize).div_ceil(8);
    let value = if colour == png::ColorType::Indexed { 0x11 } else { 254 };
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&vec![value; row * 12])?;
    writer.finish()?;
    Ok(bytes)
}
