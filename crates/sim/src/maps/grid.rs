//! ROS occupancy grids: `map.yaml` and its image, cells that are not known to be free merged into boxes.
//!
//! A cell's probability of being occupied is (255 − grey)/255, or grey/255 where `negate` is set. Cells at or above
//! `free_thresh`, the unknown ones too, are solid: nobody may walk or appear where the map does not say it is free.

use super::image::{self, GreyImage};
use super::polygon::OBSTACLES_MAX;
use super::read_text;
use super::yaml::MapYaml;
use crate::error::SimError;
use crate::geometry::{Pose, Shape};
use crate::scenario::Scenario;
use glam::{DVec2, Vec2};
use std::path::Path;

/// Reads a `map.yaml` and its image; the walls are the image's border.
pub(super) fn load(path: &Path) -> Result<Scenario, SimError> {
    let yaml = MapYaml::parse(path, &read_text(path)?)?;
    let image = image::load(&yaml.image)?;
    let blocks = merge(&solid_cells(&yaml, &image), image.width).map_err(|n| {
        let expected =
            format!("a map that merges into at most {OBSTACLES_MAX} boxes: a coarser or cleaner one");
        SimError::file(&yaml.image, "boxes", format!("{n} or more"), expected)
    })?;
    let origin = DVec2::from(yaml.origin);
    let corner = |x: usize, y: usize| origin + yaml.resolution * DVec2::new(x as f64, y as f64);
    let obstacle = |block: &Block| {
        let (low, high) = (corner(block.x.0, block.y.0), corner(block.x.1, block.y.1));
        let size = (high - low).as_vec2();
        let pose = Pose { position: ((low + high) / 2.0).as_vec2(), heading: 0.0 };
        (Shape::Box { length: size.x, width: size.y }, pose)
    };
    let walls: (Vec2, Vec2) = (origin.as_vec2(), corner(image.width, image.height).as_vec2());
    Ok(Scenario { walls, obstacles: blocks.iter().map(obstacle).collect() })
}

/// Which cells are solid, row by row from the bottom, as the world's y runs.
fn solid_cells(yaml: &MapYaml, image: &GreyImage) -> Vec<bool> {
    let solid = |grey: &u8| {
        let light = f64::from(*grey) / 255.0;
        let occupied = if yaml.negate { light } else { 1.0 - light };
        occupied >= yaml.free_thresh
    };
    image.grey.chunks_exact(image.width).rev().flat_map(|row| row.iter().map(solid)).collect()
}

/// A rectangle of cells: columns and rows, from the first to one past the last.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Block {
    x: (usize, usize),
    y: (usize, usize),
}

/// Runs of solid cells in each row; a run that stands on an equal one grows it.
///
/// The work is one pass over the cells, and it ends with the number of blocks as soon as there are more than a map may
/// have: a small compressed image can hold millions.
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
}
