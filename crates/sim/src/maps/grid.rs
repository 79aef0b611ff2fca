//! ROS occupancy grids: `map.yaml` and its image, cells that are not known to be free merged into
//! boxes.
//!
//! A cell's occupancy is what nav2's `map_io` makes of its pixel ([`occupancy`]). Only what it
//! calls free is free: occupied, unknown and half-occupied cells are solid, so that nobody walks or
//! appears where the map does not say so.
//!
//! The grid is turned by its origin's yaw around its lower left corner. The walls are the
//! axis-parallel rectangle around it; where the rectangle is larger than the turned image,
//! triangles fill it up.

use super::contour::{cell_rings, fit_ring};
use super::image::{self, Cells, Pixel};
use super::polygon::OBSTACLES_MAX;
use super::read_text;
use super::yaml::{MapYaml, Mode};
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::scenario::{Scenario, TracedArea};
use crate::trig::wrap_angle;
use glam::{DVec2, Vec2};
use std::path::Path;

/// Reads a `map.yaml` and its image.
pub(super) fn load(path: &Path) -> Result<Scenario, SimError> {
    let yaml = MapYaml::parse(path, &read_text(path)?)?;
    let image = image::load(&yaml.image, |pixel| !is_free(&yaml, pixel))?;
    let solid = from_below(&image);
    let blocks = merge(&solid, image.width).map_err(|n| {
        let expected =
            format!("a map that merges into at most {OBSTACLES_MAX} boxes: a coarser or cleaner one");
        SimError::file(&yaml.image, "boxes", format!("{n} or more"), expected)
    })?;
    let frame = Frame::new(&yaml);
    let mut obstacles: Vec<(Shape, Pose)> = blocks.iter().map(|block| frame.obstacle(block)).collect();
    let corners = frame.corners(image.width, solid.len() / image.width);
    let walls = bounds(&corners);
    obstacles.extend(fillers(&corners, walls));
    let in_world = |ring: &Vec<glam::IVec2>| {
        fit_ring(ring).into_iter().map(|point| frame.in_world(point)).collect::<Vec<DVec2>>()
    };
    let rings = cell_rings(&solid, image.width).iter().map(in_world).collect();
    let traced = Some(TracedArea { rings, n_obstacles: obstacles.len() });
    Ok(Scenario { walls: (walls.0.as_vec2(), walls.1.as_vec2()), obstacles, traced })
}

/// Keys of a `map.yaml` that are not read.
pub(super) fn ignored(path: &Path) -> Result<Vec<String>, SimError> {
    Ok(MapYaml::parse(path, &read_text(path)?)?.ignored)
}

/// The image that a `map.yaml` names.
pub(super) fn image_of(path: &Path) -> Result<std::path::PathBuf, SimError> {
    Ok(MapYaml::parse(path, &read_text(path)?)?.image)
}

/// The occupancy of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Occupancy {
    Unknown,
    /// From 0, free, to 100, occupied.
    Percent(f64),
}

/// A cell's occupancy by its pixel, as nav2's `map_io` computes it.
///
/// # Formula
///
/// The shade is the mean of red, green and blue, in mode `trinary` of an image with opacity the
/// mean of these and the opacity. The probability p is 1 − shade, or the shade where `negate` is
/// set. Above `occupied_thresh` a cell is 100, below `free_thresh` 0. In between it is unknown in
/// mode `trinary`, and in mode `scale` the rounded share of the way from one threshold to the
/// other; there a pixel that is not opaque is unknown. In mode `raw` the shade times 255, rounded,
/// is the percentage, and more than 100 is unknown.
fn occupancy(yaml: &MapYaml, pixel: Pixel) -> Occupancy {
    let shade = match (yaml.mode, pixel.alpha) {
        (Mode::Trinary, Some(alpha)) => (pixel.colours + alpha) / 4.0,
        _ => pixel.colours / 3.0,
    };
    if yaml.mode == Mode::Raw {
        let percent = (shade * 255.0).round();
        return if percent <= 100.0 { Occupancy::Percent(percent) } else { Occupancy::Unknown };
    }
    let p = if yaml.negate { shade } else { 1.0 - shade };
    if yaml.mode == Mode::Scale && pixel.alpha.is_some_and(|alpha| alpha < 1.0) {
        Occupancy::Unknown
    } else if p > yaml.occupied_thresh {
        Occupancy::Percent(100.0)
    } else if p < yaml.free_thresh {
        Occupancy::Percent(0.0)
    } else if yaml.mode == Mode::Scale {
        let share = (p - yaml.free_thresh) / (yaml.occupied_thresh - yaml.free_thresh);
        // Equal thresholds and a probability that is both give 0/0: it is not free.
        Occupancy::Percent(if share.is_nan() { 100.0 } else { (100.0 * share).round_ties_even() })
    } else {
        Occupancy::Unknown
    }
}

/// True if a cell is free: its percentage is 0 or, in mode `raw`, which applies no threshold to its
/// cells, below `free_thresh`.
fn is_free(yaml: &MapYaml, pixel: Pixel) -> bool {
    match occupancy(yaml, pixel) {
        Occupancy::Unknown => false,
        Occupancy::Percent(percent) => {
            percent == 0.0 || (yaml.mode == Mode::Raw && percent < 100.0 * yaml.free_thresh)
        }
    }
}

/// The cells row by row from the bottom, as the world's y runs.
fn from_below(image: &Cells) -> Vec<bool> {
    image.cells.chunks_exact(image.width).rev().flatten().copied().collect()
}

/// The pose and scale of the grid in the world.
struct Frame {
    origin: DVec2,
    resolution: f64,
    /// (cos, sin) of the yaw.
    rotation: DVec2,
    heading: f32,
}

impl Frame {
    fn new(yaml: &MapYaml) -> Self {
        let [x, y, yaw] = yaml.origin;
        Self {
            origin: DVec2::new(x, y),
            resolution: yaml.resolution,
            rotation: DVec2::new(libm::cos(yaw), libm::sin(yaw)),
            heading: wrap_angle(yaw),
        }
    }

    /// A point in cells from the lower left corner, in the world.
    fn in_world(&self, cells: DVec2) -> DVec2 {
        self.origin + self.rotation.rotate(self.resolution * cells)
    }

    fn obstacle(&self, block: &Block) -> (Shape, Pose) {
        let low = DVec2::new(block.x.0 as f64, block.y.0 as f64);
        let high = DVec2::new(block.x.1 as f64, block.y.1 as f64);
        let size = (self.resolution * (high - low)).as_vec2();
        let position = self.in_world((low + high) / 2.0).as_vec2();
        (Shape::Box { length: size.x, width: size.y }, Pose { position, heading: self.heading })
    }

    /// The corners of the whole grid, counter-clockwise.
    fn corners(&self, width: usize, height: usize) -> [DVec2; 4] {
        let (width, height) = (width as f64, height as f64);
        [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)].map(|at| self.in_world(at.into()))
    }
}

/// Least and largest corner of what holds the points.
fn bounds(points: &[DVec2]) -> (DVec2, DVec2) {
    points
        .iter()
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| (low.min(*at), high.max(*at)))
}

/// Triangles between a turned rectangle and its axis-parallel bounds; none where one side would be
/// below a millimetre.
fn fillers(corners: &[DVec2; 4], (low, high): (DVec2, DVec2)) -> Vec<(Shape, Pose)> {
    let triangle = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        // Of the two corners of the edge's own bounds the one on its outer side.
        let outer = [DVec2::new(a.x, b.y), DVec2::new(b.x, a.y)]
            .into_iter()
            .find(|corner| (b - a).perp_dot(*corner - a) < 0.0)?;
        let centre = (a + b + outer) / 3.0;
        let vertices: Vec<Vec2> = [a, outer, b].map(|v| (v - centre).as_vec2()).to_vec();
        let shape = Shape::Polygon { vertices };
        let fits = low.cmple(outer).all() && outer.cmple(high).all();
        let pose = Pose { position: centre.as_vec2(), heading: 0.0 };
        (fits && shape.validate("filler").is_ok()).then_some((shape, pose))
    };
    (0..4).filter_map(triangle).collect()
}

/// A rectangle of cells: columns and rows, from the first to one past the last.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Block {
    x: (usize, usize),
    y: (usize, usize),
}

/// Runs of solid cells in each row; a run above an equal one grows it.
///
/// The work is one pass over the cells, and it ends with the number of blocks as soon as there are
/// more than a map may have: a small compressed image can hold millions.
fn merge(solid: &[bool], width: usize) -> Result<Vec<Block>, usize> {
    let (mut done, mut open): (Vec<Block>, Vec<Block>) = (Vec::new(), Vec::new());
    for (y, row) in solid.chunks_exact(width).enumerate() {
        let mut next = Vec::new();
        // Both the runs of this row and the open blocks go from left to right.
        let mut below = open.drain(..).peekable();
        let mut x = 0;
        while x < width {
            let length = row[x..].iter().take_while(|cell| **cell).count();
            if length > 0 {
                let run = (x, x + length);
                while let Some(block) = below.next_if(|block| block.x < run) {
                    done.push(block);
                }
                let grown = below.next_if(|block| block.x == run);
                next.push(Block { x: run, y: (grown.map_or(y, |block| block.y.0), y + 1) });
            }
            x += length.max(1);
        }
        done.extend(below);
        open = next;
        if done.len() + open.len() > OBSTACLES_MAX {
            return Err(done.len() + open.len());
        }
    }
    done.append(&mut open);
    done.sort_by_key(|block| (block.y, block.x));
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_merge_into_boxes() {
        let map = ["##..", "##..", "..##"].concat();
        let cells: Vec<bool> = map.chars().map(|c| c == '#').collect();
        let expected = [Block { x: (0, 2), y: (0, 2) }, Block { x: (2, 4), y: (2, 3) }];
        assert_eq!(merge(&cells, 4).as_deref(), Ok(&expected[..]));
    }

    #[test]
    fn a_run_grows_only_an_equal_one() {
        let map = [".##..#", ".#...#", ".#.#.#"].concat();
        let cells: Vec<bool> = map.chars().map(|c| c == '#').collect();
        let block = |x, y| Block { x, y };
        let expected =
            [block((1, 3), (0, 1)), block((5, 6), (0, 3)), block((1, 2), (1, 3)), block((3, 4), (2, 3))];
        assert_eq!(merge(&cells, 6).as_deref(), Ok(&expected[..]));
    }

    fn yaml(mode: Mode) -> MapYaml {
        MapYaml {
            image: "m.pgm".into(),
            resolution: 0.1,
            origin: [0.0; 3],
            negate: false,
            occupied_thresh: 0.65,
            free_thresh: 0.196,
            mode,
            ignored: Vec::new(),
        }
    }

    fn grey(value: u8) -> Pixel {
        Pixel { colours: 3.0 * f64::from(value) / 255.0, alpha: None }
    }

    #[test]
    fn occupancies_of_the_three_modes_by_hand() {
        let of = |mode, value| occupancy(&yaml(mode), grey(value));
        let percent = Occupancy::Percent;
        for (value, trinary) in [(254, percent(0.0)), (205, Occupancy::Unknown), (0, percent(100.0))] {
            assert_eq!(of(Mode::Trinary, value), trinary);
        }
        // (1 − 120/255 − 0.196) / 0.454 = 0.734.
        let scale = [(254, 0.0), (120, 73.0), (89, 100.0), (0, 100.0)];
        assert!(scale.iter().all(|(value, expected)| of(Mode::Scale, *value) == percent(*expected)));
        for value in [0, 30, 100] {
            assert_eq!(of(Mode::Raw, value), percent(f64::from(value)));
        }
        assert_eq!(of(Mode::Raw, 101), Occupancy::Unknown);
        let negated = MapYaml { negate: true, ..yaml(Mode::Trinary) };
        assert_eq!(occupancy(&negated, grey(0)), percent(0.0));
    }

    #[test]
    fn opacity_counts_as_a_colour_in_trinary_and_hides_in_scale() {
        let pixel = |value: f64, alpha: f64| Pixel { colours: 3.0 * value, alpha: Some(alpha) };
        // (3 · 0.9 + 0.3) / 4 = 0.75: neither free nor occupied.
        assert_eq!(occupancy(&yaml(Mode::Trinary), pixel(0.9, 0.3)), Occupancy::Unknown);
        assert_eq!(occupancy(&yaml(Mode::Trinary), pixel(0.9, 1.0)), Occupancy::Percent(0.0));
        assert_eq!(occupancy(&yaml(Mode::Scale), pixel(1.0, 0.99)), Occupancy::Unknown);
        assert_eq!(occupancy(&yaml(Mode::Scale), pixel(1.0, 1.0)), Occupancy::Percent(0.0));
        assert_eq!(occupancy(&yaml(Mode::Raw), pixel(0.0, 0.0)), Occupancy::Percent(0.0));
    }

    #[test]
    fn free_is_what_the_map_says_is_free() {
        let free = |mode, value| is_free(&yaml(mode), grey(value));
        assert!(free(Mode::Trinary, 254) && !free(Mode::Trinary, 205) && !free(Mode::Trinary, 0));
        assert!(free(Mode::Scale, 254) && !free(Mode::Scale, 120) && !free(Mode::Scale, 0));
        assert!(free(Mode::Raw, 0) && free(Mode::Raw, 19) && !free(Mode::Raw, 20) && !free(Mode::Raw, 254));
    }
}
