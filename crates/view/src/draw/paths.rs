//! Ways through a room, with arrows as long as the robot was fast (the paper's figure of
//! trajectories per token).

use anyhow::{Result, ensure};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use serde::{Deserialize, Serialize};

use super::{Area, DARK, Entry, FONT, GREY, PALE, TITLE, centred, ink, legend, legend_height, sheet, title};

/// Width of the sheet.
const SHEET: u32 = 900;
/// Room for the numbers of the axes.
const MARGIN: i32 = 48;
/// Length of an arrow at full speed (m).
const ARROW: f64 = 0.7;

/// The robot at a step.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct PathPoint {
    /// m.
    pub position: [f64; 2],
    /// rad, counter-clockwise from x.
    pub heading: f64,
    /// m/s.
    pub speed: f64,
}

/// The end of a way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PathEnd {
    /// At the goal: a disc.
    Goal,
    /// In a collision: a cross.
    Collision,
    /// At the time limit: a bar.
    Timeout,
}

/// One way.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RobotPath {
    /// Its name in the legend, such as `z = 0: 9.8 s`.
    pub label: String,
    /// From the start on, a point for each step.
    pub points: Vec<PathPoint>,
    /// Its end.
    pub end: PathEnd,
}

/// Ways from one start to one goal; as JSON, a file that `plot` draws.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PathFigure {
    /// The title.
    pub title: String,
    /// The part of the room that is shown: least and largest corner (m).
    pub view: ([f64; 2], [f64; 2]),
    /// Corners of what stands in the way (m).
    pub obstacles: Vec<Vec<[f64; 2]>>,
    /// Centre of the goal (m).
    pub goal: [f64; 2],
    /// m.
    pub goal_radius: f64,
    /// m/s: an arrow of full length.
    pub v_max: f64,
    /// Steps from one arrow to the next.
    pub arrow_every: usize,
    /// The ways.
    pub paths: Vec<RobotPath>,
    /// A line below the picture.
    pub note: String,
}

/// From metres to pixels, the same scale along both axes, y upwards.
struct Frame {
    scale: f64,
    left: f64,
    top: f64,
}

impl Frame {
    fn at(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        let pixel = |value: f64| value.round() as i32;
        (MARGIN + pixel((x - self.left) * self.scale), pixel((self.top - y) * self.scale))
    }
}

/// Draws the ways over one another, each in the colour of its place.
///
/// # Errors
/// A view without width or height, no step between arrows.
pub fn paths(figure: &PathFigure) -> Result<String> {
    let ([left, bottom], [right, top]) = figure.view;
    let (width, height) = (right - left, top - bottom);
    ensure!(width > 0.0 && height > 0.0 && height < 4.0 * width, "a view of {width} m by {height} m");
    ensure!(figure.arrow_every > 0 && figure.v_max > 0.0, "arrows need a step and a speed above 0");
    let scale = f64::from(SHEET as i32 - 2 * MARGIN) / width;
    let entries: Vec<Entry> =
        figure.paths.iter().enumerate().map(|(k, path)| (path.label.clone(), ink(k))).collect();
    let head = TITLE + legend_height(&entries, SHEET);
    let size = (SHEET, head + (height * scale).round() as u32 + 74);
    sheet(size, |area| {
        let (strip, rest) = area.split_vertically(TITLE);
        title(&strip, &figure.title)?;
        let (strip, body) = rest.split_vertically(legend_height(&entries, SHEET));
        legend(&strip, &entries)?;
        let frame = Frame { scale, left, top };
        draw_room(&body, &frame, figure)?;
        for (index, path) in figure.paths.iter().enumerate() {
            draw_path(&body, &frame, path, ink(index), figure)?;
        }
        draw_note(&body, frame.at([left, bottom]), figure, scale)
    })
}

/// Grid, obstacles and goal.
fn draw_room(body: &Area<'_>, frame: &Frame, figure: &PathFigure) -> Result<()> {
    let ([left, bottom], [right, top]) = figure.view;
    let every = [0.5, 1.0, 2.0, 5.0, 10.0].into_iter().find(|step| (right - left) / step <= 12.0);
    let every = every.unwrap_or(20.0);
    let ticks = |low: f64, high: f64| {
        let first = (low / every).ceil() as i32;
        (first..=(high / every).floor() as i32).map(move |k| f64::from(k) * every)
    };
    for x in ticks(left, right) {
        body.draw(&PathElement::new(vec![frame.at([x, bottom]), frame.at([x, top])], PALE))?;
        let (at, foot) = frame.at([x, bottom]);
        body.draw_text(&format!("{x}"), &centred(12, &GREY, VPos::Top), (at, foot + 6))?;
    }
    for y in ticks(bottom, top) {
        body.draw(&PathElement::new(vec![frame.at([left, y]), frame.at([right, y])], PALE))?;
        let style = TextStyle::from((FONT, 12).into_font()).color(&GREY);
        let (start, at) = frame.at([left, y]);
        body.draw_text(&format!("{y}"), &style.pos(Pos::new(HPos::Right, VPos::Center)), (start - 6, at))?;
    }
    for obstacle in &figure.obstacles {
        let corners: Vec<(i32, i32)> = obstacle.iter().map(|corner| frame.at(*corner)).collect();
        body.draw(&Polygon::new(corners, GREY.mix(0.6).filled()))?;
    }
    let radius = (figure.goal_radius * frame.scale).round() as i32;
    let goal = frame.at(figure.goal);
    body.draw(&Circle::new(goal, radius, DARK.mix(0.08).filled()))?;
    body.draw(&Circle::new(goal, radius, DARK.mix(0.5)))?;
    body.draw_text("goal", &centred(12, &DARK, VPos::Bottom), (goal.0, goal.1 - radius - 3))?;
    let start = figure.paths.iter().find_map(|path| path.points.first());
    if let Some(start) = start {
        let at = frame.at(start.position);
        body.draw(&Circle::new(at, 5, DARK.filled()))?;
        body.draw_text("start", &centred(12, &DARK, VPos::Bottom), (at.0, at.1 - 10))?;
    }
    Ok(())
}

fn draw_path(
    body: &Area<'_>,
    frame: &Frame,
    path: &RobotPath,
    color: RGBColor,
    figure: &PathFigure,
) -> Result<()> {
    let line: Vec<(i32, i32)> = path.points.iter().map(|point| frame.at(point.position)).collect();
    body.draw(&PathElement::new(line.clone(), color.stroke_width(2)))?;
    for point in path.points.iter().step_by(figure.arrow_every).filter(|point| point.speed > 0.0) {
        let length = ARROW * point.speed / figure.v_max;
        arrow(body, frame, point.position, point.heading, length, color)?;
    }
    let Some(&(x, y)) = line.last() else { return Ok(()) };
    match path.end {
        PathEnd::Goal => body.draw(&Circle::new((x, y), 5, color.filled()))?,
        PathEnd::Collision => {
            for slope in [1, -1] {
                let stroke = vec![(x - 7, y - 7 * slope), (x + 7, y + 7 * slope)];
                body.draw(&PathElement::new(stroke, color.stroke_width(3)))?;
            }
        }
        PathEnd::Timeout => body.draw(&Rectangle::new([(x - 2, y - 8), (x + 2, y + 8)], color.filled()))?,
    }
    Ok(())
}

/// An arrow of a length in metres.
fn arrow(
    body: &Area<'_>,
    frame: &Frame,
    [x, y]: [f64; 2],
    heading: f64,
    length: f64,
    color: RGBColor,
) -> Result<()> {
    let along = |reach: f64, side: f64| {
        [x + reach * heading.cos() - side * heading.sin(), y + reach * heading.sin() + side * heading.cos()]
    };
    let (head, half) = (length.min(0.18), 0.4 * length.min(0.18));
    let shaft = vec![frame.at([x, y]), frame.at(along(length - head, 0.0))];
    body.draw(&PathElement::new(shaft, color.stroke_width(2)))?;
    let tip = [along(length, 0.0), along(length - head, half), along(length - head, -half)];
    body.draw(&Polygon::new(tip.map(|corner| frame.at(corner)).to_vec(), color.filled()))?;
    Ok(())
}

/// The note on an arrow's length, and the figure's own note.
fn draw_note(body: &Area<'_>, (left, foot): (i32, i32), figure: &PathFigure, scale: f64) -> Result<()> {
    let style = TextStyle::from((FONT, 12).into_font()).color(&GREY);
    let frame = Frame { scale, left: 0.0, top: 0.0 };
    let key = [f64::from(left - MARGIN) / scale, -f64::from(foot + 36) / scale];
    arrow(body, &frame, key, 0.0, ARROW, GREY)?;
    let after = left + (ARROW * scale).round() as i32 + 10;
    let text = format!(
        "{} m/s (an arrow every {} steps); disc: goal reached, cross: collision, bar: time limit",
        figure.v_max, figure.arrow_every
    );
    body.draw_text(&text, &style, (after, foot + 31))?;
    body.draw_text(&figure.note, &style, (left, foot + 50))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{PathEnd, PathFigure, PathPoint, RobotPath, paths};

    fn figure() -> PathFigure {
        let point = |x: f64| PathPoint { position: [x, 0.0], heading: 0.0, speed: 1.0 };
        PathFigure {
            title: "Ways".to_owned(),
            view: ([-1.0, -1.0], [3.0, 1.0]),
            obstacles: vec![vec![[1.0, 0.5], [1.5, 0.5], [1.5, 0.9]]],
            goal: [2.0, 0.0],
            goal_radius: 0.5,
            v_max: 1.0,
            arrow_every: 5,
            paths: vec![RobotPath {
                label: "z = 0".to_owned(),
                points: (0..11).map(|k| point(0.15 * f64::from(k))).collect(),
                end: PathEnd::Goal,
            }],
            note: String::new(),
        }
    }

    #[test]
    fn arrows_stand_at_every_fifth_step() {
        let picture = paths(&figure()).unwrap();
        // The obstacle, arrows at steps 0, 5 and 10, and the one that explains them.
        assert_eq!(picture.matches("<polygon").count(), 5);
        assert!(picture.contains("z = 0") && picture.contains("start"));
    }

    #[test]
    fn an_empty_view_is_refused() {
        let flat = PathFigure { view: ([0.0, 0.0], [0.0, 1.0]), ..figure() };
        assert!(paths(&flat).is_err());
    }
}
