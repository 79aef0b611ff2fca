//! A moment of one robot's episode: room, laser, goal, trails, bodies, and a line of words above.
//! The same things as on the page (`scene.js`), without what a small picture cannot show.

use glam::Vec2;
use jostle_arena::Outcome;
use jostle_arena::config::ArenaConfig;
use jostle_arena::replay::{EpisodeTrace, TraceFrame};
use jostle_peds::Pedestrian;
use tiny_skia::{
    Color, FillRule, LineCap, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, StrokeDash, Transform,
};

use super::letters;
use crate::replay::page::STYLE;

/// Around the walls (m), as on the page.
const MARGIN: f32 = 0.35;
/// A pedestrian that is farther than this (m) from where it was a step ago was put there.
const TELEPORT: f32 = 1.0;
/// Steps of a pedestrian's trail.
const PAST: usize = 30;
/// Pixels between the line of words and the room.
const BELOW: u32 = 4;
/// Colours of a robot's trail from slow to fast.
const SPEEDS: usize = 4;
/// The robots' colours, as the page names them.
const INKS: [&str; 3] = ["accent", "second", "third"];

/// One robot's part of the picture.
pub(super) struct Panel<'a> {
    name: &'a str,
    trace: &'a EpisodeTrace,
    config: &'a ArenaConfig,
    site: &'a [Vec<Vec2>],
    /// Directions of the kept beams from the heading (rad).
    beams: Vec<f32>,
    ink: Color,
    crowd: Color,
    /// Upper left corner, and width (pixels).
    corner: [u32; 2],
    width: u32,
    /// Corners of the room (m).
    least: Vec2,
    largest: Vec2,
    /// Pixels a metre.
    scale: f32,
}

impl<'a> Panel<'a> {
    /// The panel of the robot with this index among those that are shown.
    pub(super) fn new(
        name: &'a str,
        trace: &'a EpisodeTrace,
        (config, site): (&'a ArenaConfig, &'a [Vec<Vec2>]),
        index: usize,
        corner: [u32; 2],
        width: u32,
    ) -> Self {
        let corners = || site.iter().flatten().copied();
        let least = corners().fold(Vec2::splat(f32::INFINITY), Vec2::min);
        let largest = corners().fold(Vec2::splat(f32::NEG_INFINITY), Vec2::max);
        let laser = &config.sim.laser;
        let kept = trace.frames.first().map_or(1, |frame| frame.ranges.len().max(1));
        let beams =
            (0..laser.beams).step_by(laser.beams.div_ceil(kept)).map(|beam| laser.beam_angle(beam) as f32);
        Self {
            name,
            trace,
            config,
            site,
            beams: beams.collect(),
            ink: colour(INKS[index % INKS.len()]),
            crowd: colour(trace.crowd.as_str()),
            corner,
            width,
            least,
            largest,
            scale: width as f32 / (largest.x - least.x + 2.0 * MARGIN),
        }
    }

    /// Height with the line of words (pixels).
    pub(super) fn height(&self) -> u32 {
        let room = (self.largest.y - self.least.y + 2.0 * MARGIN) * self.scale;
        letters::HEIGHT + BELOW + room.round() as u32
    }

    /// Draws the moment after a step, or the last one where there is none.
    pub(super) fn draw(&self, picture: &mut Pixmap, step: usize) {
        let frames = &self.trace.frames[..=step.min(self.trace.frames.len() - 1)];
        let Some(now) = frames.last() else { return };
        let mut pen = Pen { picture };
        self.draw_site(&mut pen);
        self.draw_laser(&mut pen, now);
        let goal = self.at(now.robot.goal);
        let radius = self.config.sim.episode.goal_radius * self.scale;
        pen.fill(circle(goal, radius), faint(self.ink, 0.2));
        pen.line(circle(goal, radius), self.ink, 1.5);
        for body in 0..now.pedestrians.len() {
            pen.line(self.trail(frames, body), faint(self.crowd, 0.35), 1.5);
        }
        self.draw_trail(&mut pen, frames);
        for pedestrian in &now.pedestrians {
            pen.fill(self.body(pedestrian), self.crowd);
        }
        pen.fill(self.body(&now.robot), self.ink);
        pen.fill(self.nose(&now.robot), self.ink);
        let ended = step + 1 >= self.trace.frames.len();
        if ended {
            let ring = end_colour(self.trace.finished.outcome);
            pen.line(circle(self.at(now.robot.position), 0.85 * self.scale), ring, 2.5);
        }
        self.write(picture, frames.len() - 1, ended);
    }

    /// The line of words: whose panel it is, and the time or the end.
    fn write(&self, picture: &mut Pixmap, step: usize, ended: bool) {
        let [x, y] = self.corner;
        let time = format!("{:.1} s", step as f32 * self.config.sim.episode.dt);
        let outcome = self.trace.finished.outcome;
        let (said, ink) = if ended {
            (format!("{} {time}", words(outcome)), end_colour(outcome))
        } else {
            (time, colour("muted"))
        };
        letters::write(picture, &said, [x + self.width - letters::width(&said).min(self.width), y], ink);
        let room = self.width.saturating_sub(letters::width(&said) + 2 * letters::HEIGHT);
        letters::write(picture, &letters::fitting(self.name, room), [x, y], self.ink);
    }

    fn draw_site(&self, pen: &mut Pen<'_>) {
        for (index, polygon) in self.site.iter().enumerate() {
            let outline = polyline(polygon.iter().map(|corner| self.at(*corner)), true);
            let is_room = index == 0;
            pen.fill(outline.clone(), colour(if is_room { "floor" } else { "wall" }));
            if is_room || polygon.len() == 2 {
                pen.line(outline, colour("wall"), 2.0);
            }
        }
    }

    fn draw_laser(&self, pen: &mut Pen<'_>, now: &TraceFrame) {
        let Pedestrian { position, heading, .. } = now.robot;
        let end =
            |(range, angle): (&f32, &f32)| self.at(position + Vec2::from_angle(heading + angle) * *range);
        // A sector is closed by way of the robot.
        let hub = (!self.config.sim.laser.is_full_circle()).then(|| self.at(position));
        let outline = polyline(hub.into_iter().chain(now.ranges.iter().zip(&self.beams).map(end)), true);
        let blue = colour("laser");
        pen.fill(outline.clone(), faint(blue, 0.13));
        pen.line(outline, faint(blue, 0.22), 1.0);
        let crash = circle(self.at(position), self.config.sim.episode.crash_range * self.scale);
        pen.dashes(crash, faint(colour("collision_pedestrian"), 0.55));
    }

    /// The robot's way, in the colours of its speed.
    fn draw_trail(&self, pen: &mut Pen<'_>, frames: &[TraceFrame]) {
        let (slow, fast) = (colour("slow"), colour("fast"));
        let level = |frame: &TraceFrame| {
            let share = (frame.velocity[0].abs() / self.config.sim.robot.v_max).clamp(0.0, 1.0);
            (share * (SPEEDS - 1) as f32).round() as usize
        };
        for level_shown in 0..SPEEDS {
            let mut way = PathBuilder::new();
            for pair in frames.windows(2).filter(|pair| level(&pair[1]) == level_shown) {
                let [from, to] = [0, 1].map(|k: usize| self.at(pair[k].robot.position));
                way.move_to(from.x, from.y);
                way.line_to(to.x, to.y);
            }
            let share = level_shown as f32 / (SPEEDS - 1) as f32;
            pen.line(way.finish(), mix(slow, fast, share), 2.0);
        }
    }

    /// A pedestrian's last steps, back to where it was put.
    fn trail(&self, frames: &[TraceFrame], body: usize) -> Option<Path> {
        let mut places = frames.iter().rev().take(PAST).map(|frame| frame.pedestrians[body].position);
        let mut way = vec![places.next()?];
        for place in places {
            if way.last().is_none_or(|last| last.distance(place) > TELEPORT) {
                break;
            }
            way.push(place);
        }
        polyline(way.into_iter().map(|place| self.at(place)), false)
    }

    fn body(&self, body: &Pedestrian) -> Option<Path> {
        let half = Vec2::new(self.config.sim.robot.length, self.config.sim.robot.width) / 2.0;
        self.shape(body, &[half, Vec2::new(-half.x, half.y), -half, Vec2::new(half.x, -half.y)])
    }

    /// Where a body looks.
    fn nose(&self, body: &Pedestrian) -> Option<Path> {
        let (front, side) = (self.config.sim.robot.length / 2.0, self.config.sim.robot.width * 0.3);
        self.shape(
            body,
            &[Vec2::new(front, side), Vec2::new(front + 1.2 * side, 0.0), Vec2::new(front, -side)],
        )
    }

    /// A shape in a body's frame (m).
    fn shape(&self, body: &Pedestrian, corners: &[Vec2]) -> Option<Path> {
        let turn = Vec2::from_angle(body.heading);
        polyline(corners.iter().map(|corner| self.at(body.position + turn.rotate(*corner))), true)
    }

    /// The pixel of a place in the world.
    fn at(&self, place: Vec2) -> Vec2 {
        let [x, y] = self.corner.map(|side| side as f32);
        let above = (letters::HEIGHT + BELOW) as f32;
        let in_room = Vec2::new(place.x - self.least.x, self.largest.y - place.y) + MARGIN;
        Vec2::new(x, y + above) + in_room * self.scale
    }
}

/// What draws on a picture.
struct Pen<'a> {
    picture: &'a mut Pixmap,
}

impl Pen<'_> {
    fn fill(&mut self, path: Option<Path>, ink: Color) {
        if let Some(path) = path {
            self.picture.fill_path(&path, &paint(ink), FillRule::Winding, Transform::identity(), None);
        }
    }

    fn line(&mut self, path: Option<Path>, ink: Color, width: f32) {
        self.stroke(path, ink, &Stroke { width, line_cap: LineCap::Round, ..Stroke::default() });
    }

    fn dashes(&mut self, path: Option<Path>, ink: Color) {
        self.stroke(path, ink, &Stroke { dash: StrokeDash::new(vec![2.0, 3.0], 0.0), ..Stroke::default() });
    }

    fn stroke(&mut self, path: Option<Path>, ink: Color, stroke: &Stroke) {
        if let Some(path) = path {
            self.picture.stroke_path(&path, &paint(ink), stroke, Transform::identity(), None);
        }
    }
}

fn paint(ink: Color) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(ink);
    paint
}

/// `None` for fewer than two points.
fn polyline(points: impl Iterator<Item = Vec2>, closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (k, point) in points.enumerate() {
        if k == 0 {
            path.move_to(point.x, point.y);
        } else {
            path.line_to(point.x, point.y);
        }
    }
    if closed {
        path.close();
    }
    path.finish()
}

fn circle(centre: Vec2, radius: f32) -> Option<Path> {
    let side = 2.0 * radius;
    Rect::from_xywh(centre.x - radius, centre.y - radius, side, side).and_then(PathBuilder::from_oval)
}

fn faint(ink: Color, alpha: f32) -> Color {
    let mut ink = ink;
    ink.set_alpha(alpha);
    ink
}

fn mix(a: Color, b: Color, share: f32) -> Color {
    let between = |a: f32, b: f32| a + (b - a) * share;
    Color::from_rgba(
        between(a.red(), b.red()),
        between(a.green(), b.green()),
        between(a.blue(), b.blue()),
        1.0,
    )
    .unwrap_or(a)
}

/// A colour of the page's light theme by its name; the muted one for a crowd that has none.
pub(super) fn colour(name: &str) -> Color {
    let value = |name: &str| {
        let (_, after) = STYLE.split_once(&format!("--{name}: "))?;
        let (value, _) = after.split_once(';')?;
        let channels: Vec<u8> = match value.strip_prefix('#') {
            Some(hex) => {
                (0..3).filter_map(|k| u8::from_str_radix(hex.get(2 * k..2 * k + 2)?, 16).ok()).collect()
            }
            None => value.split(", ").filter_map(|channel| channel.parse().ok()).collect(),
        };
        let [red, green, blue] = *channels.as_array()?;
        Some(Color::from_rgba8(red, green, blue, 255))
    };
    value(name).or_else(|| value("muted")).unwrap_or(Color::BLACK)
}

fn end_colour(outcome: Outcome) -> Color {
    colour(&outcome.to_string())
}

fn words(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Success => "arrived",
        Outcome::CollisionPedestrian => "hit a pedestrian",
        Outcome::CollisionWall => "hit a wall",
        Outcome::Timeout => "out of time",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_the_light_page() {
        let rgb = |name: &str| {
            let colour = colour(name).to_color_u8();
            [colour.red(), colour.green(), colour.blue()]
        };
        assert_eq!(rgb("laser"), [37, 99, 235]);
        assert_eq!(rgb("SF"), [0xc2, 0x2d, 0x70]);
        assert_eq!(rgb("a-crowd-of-ones-own"), rgb("muted"));
        let others = ["floor", "wall", "slow", "fast", "back"].map(str::to_owned);
        let outcomes = Outcome::ALL.map(|outcome| outcome.to_string());
        for name in INKS.map(str::to_owned).into_iter().chain(others).chain(outcomes) {
            assert!(STYLE.contains(&format!("--{name}: ")), "{name}");
        }
    }
}
