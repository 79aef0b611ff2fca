//! One episode as an animated GIF, the robots side by side: what the page shows, for places that
//! play no page.
//!
//! Every second step is a frame, shown for one control period, so that the picture runs at twice
//! the speed of life. A file is a function of its traces: shapes are drawn without SIMD, letters
//! are a bitmap font, and colours are counted in a fixed order.
//!
//! Reading order: this file (frames and file), `panel` (a moment of one robot), `letters`,
//! `palette` (from colours to indices).

mod letters;
mod palette;
mod panel;

use std::borrow::Cow;
use std::path::Path;

use ::gif::{DisposalMethod, Encoder, Frame, Repeat};
use anyhow::{Context as _, Result, bail, ensure};
use glam::Vec2;
use jostle_arena::config::ArenaConfig;
use jostle_arena::replay::EpisodeTrace;
use jostle_runs::run_folder::write_bytes_atomically;
use tiny_skia::Pixmap;

use self::palette::{Palette, TRANSPARENT};
use self::panel::Panel;

/// Steps from a frame to the next.
const STRIDE: usize = 2;
/// How long the last frame stays (10 ms).
const HOLD: u16 = 150;
/// Frames whose colours are counted, spread evenly.
const SAMPLES: usize = 16;
/// Pixels between two panels and around them.
const GAP: u32 = 6;
/// Widths of a panel where there is one, where there are two, and so on (pixels).
const WIDTHS: [u32; 4] = [480, 400, 300, 240];
/// Largest side of the whole picture (pixels).
const LARGEST: u32 = 4000;

/// Writes the moving picture of an episode that several robots drove: each one's name and its
/// trace.
///
/// # Errors
/// A room or a number of robots that gives a picture of more than `LARGEST` pixels; a file that
/// cannot be written.
pub fn write(
    file: &Path,
    robots: &[(&str, &EpisodeTrace)],
    config: &ArenaConfig,
    site: &[Vec<Vec2>],
) -> Result<()> {
    write_bytes_atomically(file, &encode(robots, config, site)?)
}

/// The bytes of the file.
fn encode(robots: &[(&str, &EpisodeTrace)], config: &ArenaConfig, site: &[Vec<Vec2>]) -> Result<Vec<u8>> {
    let film = Film::new(robots, config, site)?;
    let moments = film.moments();
    let spread = moments.len().div_ceil(SAMPLES);
    let sampled = moments.iter().rev().step_by(spread).map(|moment| film.draw(*moment));
    let mut palette = Palette::from_pictures(sampled.collect::<Result<Vec<_>>>()?.iter());
    let [width, height] = film.size.map(|side| side as u16);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height, &palette.bytes())?;
    encoder.set_repeat(Repeat::Infinite)?;
    // A hundredth of a second is the format's unit; browsers slow down what is faster than 0.02 s.
    let delay = (config.sim.episode.dt * 100.0).round().clamp(2.0, f32::from(u16::MAX)) as u16;
    let mut shown: Vec<u8> = Vec::new();
    for (k, moment) in moments.iter().enumerate() {
        let next = palette.indices(&film.draw(*moment)?);
        let mut frame = difference(&shown, &next, width, height);
        frame.delay = if k + 1 == moments.len() { HOLD } else { delay };
        encoder.write_frame(&frame)?;
        shown = next;
    }
    drop(encoder);
    Ok(bytes)
}

/// The panels of an episode, with the places that they have in the picture.
struct Film<'a> {
    panels: Vec<Panel<'a>>,
    size: [u32; 2],
    steps: usize,
}

impl<'a> Film<'a> {
    fn new(
        robots: &[(&'a str, &'a EpisodeTrace)],
        config: &'a ArenaConfig,
        site: &'a [Vec<Vec2>],
    ) -> Result<Self> {
        let Some(steps) = robots.iter().map(|(_, trace)| trace.frames.len()).max() else {
            bail!("a picture: found no robot, expected at least one");
        };
        let width = WIDTHS[(robots.len() - 1).min(WIDTHS.len() - 1)];
        let mut panels = Vec::new();
        for (k, (name, trace)) in robots.iter().enumerate() {
            let left = GAP + k as u32 * (width + GAP);
            panels.push(Panel::new(name, trace, (config, site), k, [left, GAP], width));
        }
        let size = [GAP + robots.len() as u32 * (width + GAP), 2 * GAP + panels[0].height()];
        let largest = size[0].max(size[1]);
        ensure!(largest <= LARGEST, "a picture: found {largest} pixels, expected at most {LARGEST}");
        Ok(Self { panels, size, steps: steps - 1 })
    }

    /// The steps that are shown.
    fn moments(&self) -> Vec<usize> {
        let mut moments: Vec<usize> = (0..self.steps).step_by(STRIDE).collect();
        moments.push(self.steps);
        moments
    }

    fn draw(&self, step: usize) -> Result<Pixmap> {
        let [width, height] = self.size;
        let mut picture = Pixmap::new(width, height).context("a picture without pixels")?;
        picture.fill(panel::colour("back"));
        for panel in &self.panels {
            panel.draw(&mut picture, step);
        }
        Ok(picture)
    }
}

/// The part of a picture that is not as `shown` is, as a frame to be laid over it; what is the same
/// in it is transparent.
fn difference(shown: &[u8], next: &[u8], width: u16, height: u16) -> Frame<'static> {
    let wide = usize::from(width);
    let is_new = |at: usize| shown.get(at) != Some(&next[at]);
    let changed = || (0..next.len()).filter(|at| is_new(*at));
    let rows = changed().next().zip(changed().next_back()).map(|(first, last)| (first / wide, last / wide));
    // A frame has at least a pixel.
    let (top, bottom) = rows.unwrap_or((0, 0));
    let left = changed().map(|at| at % wide).min().unwrap_or(0);
    let right = changed().map(|at| at % wide).max().unwrap_or(0);
    let pixel = |at: usize| if is_new(at) { next[at] } else { TRANSPARENT };
    let rectangle = (top..=bottom).flat_map(|row| row * wide + left..=row * wide + right);
    let buffer = rectangle.map(pixel).collect();
    debug_assert!(bottom < usize::from(height));
    Frame {
        dispose: DisposalMethod::Keep,
        transparent: Some(TRANSPARENT),
        left: left as u16,
        top: top as u16,
        width: (right + 1 - left) as u16,
        height: (bottom + 1 - top) as u16,
        buffer: Cow::Owned(buffer),
        ..Frame::default()
    }
}
