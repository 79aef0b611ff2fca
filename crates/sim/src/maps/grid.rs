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
    let blocks = merge(&solid_cells(&yaml, &image), image.width);
    if blocks.len() > OBSTACLES_MAX {
        let expected =
            format!("a map that merges into at most {OBSTACLES_MAX} boxes: a coarser or cleaner one");
        return Err(SimError::file(&yaml.image, "boxes", blocks.len(), expected));
    }
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
fn merge(solid: &[bool], width: usize) -> Vec<Block> {
    let (mut done, mut open): (Vec<Block>, Vec<Block>) = (Vec::new(), Vec::new());
    for (y, row) in solid.chunks_exact(width).enumerate() {
        let mut next = Vec::new();
        let mut x = 0;
        while x < width {
            let length = row[x..].iter().take_while(|cell| **cell).count();
            if length > 0 {
                let run = (x, x + length);
                let below = open.iter().position(|block| block.x == run).map(|i| open.swap_remove(i));
                next.push(Block { x: run, y: (below.map_or(y, |b| b.y.0), y + 1) });
            }
            x += length.max(1);
        }
        done.append(&mut open);
        open = next;
    }
    done.append(&mut open);
    done.sort_by_key(|block| (block.y, block.x));
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_merge_into_boxes() {
        let map = ["##..", "##..", "..##"].concat();
        let cells: Vec<bool> = map.chars().map(|c| c == '#').collect();
        let expected = [Block { x: (0, 2), y: (0, 2) }, Block { x: (2, 4), y: (2, 3) }];
        assert_eq!(merge(&cells, 4), expected);
    }
}
