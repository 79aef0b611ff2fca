//! The places of a room, enumerated: where a start or a goal can be, and which of them can be
//! reached from one another.
//!
//! A grid covers the room. Each cell knows the distance from its centre to the nearest wall or
//! obstacle; cells in which the body keeps its radius are flood-filled into regions; and the places
//! of a region are the cells that keep the wall clearance and from which a goal is far enough. The
//! farthest place from a point is a corner of the convex hull of its region's places, so that "is
//! there a goal for this start" has an exact answer.
//!
//! Reading order: [`FreeSpace::new`], then its private steps in the order of their calls.

use crate::geometry::Shape;
use crate::solid::Solid;
use crate::world::World;
use glam::{DVec2, Vec2};

/// Cells of one body radius, along each axis, where the room is not too large for that.
const CELLS_PER_RADIUS: f64 = 6.0;
/// Most cells of a grid, about; larger rooms have larger cells.
const CELLS_MAX: f64 = (1_u32 << 21) as f64;
/// The region of a cell in which the body cannot be.
const SOLID: u32 = u32::MAX;

/// The distances that a place of a room has to keep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Demands {
    /// Radius at which the body gets about, m: of its outline or of the crash rule, whichever is
    /// larger.
    pub(crate) radius: f32,
    /// Least distance of a start or a goal from walls and obstacles, m; at least the radius.
    pub(crate) wall_clearance: f32,
    /// Least distance of a goal from its start, m.
    pub(crate) goal_distance: f32,
}

/// The free space of a room.
pub(crate) struct FreeSpace {
    demands: Demands,
    grid: Grid,
    /// Distance from each cell's centre to the nearest wall or obstacle, m; exact up to a little
    /// above what is asked for.
    distances: Vec<f32>,
    /// The region of each cell.
    regions: Vec<u32>,
    /// Convex hull of each region's places, counter-clockwise; empty where no goal is far enough
    /// from any start.
    hulls: Vec<Vec<Vec2>>,
    /// Cells in which a start can be, ascending.
    places: Vec<u32>,
    /// Largest distance between two places of one region that keep the wall clearance, m; 0 if
    /// there are none.
    pub(crate) diameter: f32,
}

impl std::fmt::Debug for FreeSpace {
    /// Without its cells, of which there can be millions.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FreeSpace").field("demands", &self.demands).finish_non_exhaustive()
    }
}

/// Cells of equal size that cover the room, row by row from its least corner.
struct Grid {
    min: DVec2,
    cell: DVec2,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(min: DVec2, max: DVec2, side: f64) -> Self {
        let size = max - min;
        let side = side.max((size.x * size.y / CELLS_MAX).sqrt());
        // An odd count has a cell in the middle, so that a corridor of any width has a row of cells
        // along its axis.
        let odd = |length: f64| (length / side).ceil() as usize | 1;
        let (columns, rows) = (odd(size.x), odd(size.y));
        Self { min, cell: size / DVec2::new(columns as f64, rows as f64), columns, rows }
    }

    fn len(&self) -> usize {
        self.columns * self.rows
    }

    fn centre(&self, cell: usize) -> Vec2 {
        let index = DVec2::new((cell % self.columns) as f64, (cell / self.columns) as f64);
        (self.min + self.cell * (index + 0.5)).as_vec2()
    }

    fn cell_of(&self, point: Vec2) -> usize {
        let at = (point.as_dvec2() - self.min) / self.cell;
        let index = |at: f64, n: usize| (at.max(0.0) as usize).min(n - 1);
        index(at.y, self.rows) * self.columns + index(at.x, self.columns)
    }

    /// Indices of the centres within [low, high] along one axis.
    fn range(low: f64, high: f64, min: f64, cell: f64, n: usize) -> std::ops::Range<usize> {
        let from = ((low - min) / cell - 0.5).ceil().clamp(0.0, n as f64) as usize;
        let to = ((high - min) / cell - 0.5).floor() + 1.0;
        from..(to.clamp(0.0, n as f64) as usize).max(from)
    }

    fn rows_within(&self, low: f64, high: f64) -> std::ops::Range<usize> {
        Self::range(low, high, self.min.y, self.cell.y, self.rows)
    }

    fn columns_within(&self, low: f64, high: f64) -> std::ops::Range<usize> {
        Self::range(low, high, self.min.x, self.cell.x, self.columns)
    }
}

impl FreeSpace {
    /// The free space between `walls`, with the obstacles of a world.
    pub(crate) fn new(demands: Demands, walls: (Vec2, Vec2), world: &World) -> Self {
        let side = f64::from(demands.radius) / CELLS_PER_RADIUS;
        let grid = Grid::new(walls.0.as_dvec2(), walls.1.as_dvec2(), side);
        // Two cells on both sides of a thin wall must not be neighbours, however large the cells.
        let radius = demands.radius.max(grid.cell.max_element() as f32);
        let mut space = Self {
            distances: distances_to_walls(&grid, walls),
            regions: vec![SOLID; grid.len()],
            hulls: Vec::new(),
            places: Vec::new(),
            diameter: 0.0,
            demands,
            grid,
        };
        let reach = f64::from(demands.wall_clearance.max(radius)) + space.slack();
        // What is inside an obstacle is found first: the bands around obstacles then leave it out.
        for reach in [0.0, reach] {
            world.obstacles().iter().for_each(|solid| space.stamp(solid, reach));
        }
        let n_regions = space.flood(radius);
        space.enumerate(n_regions);
        space
    }

    /// Area in which a start can be, m².
    pub(crate) fn area(&self) -> f32 {
        (self.places.len() as f64 * self.grid.cell.x * self.grid.cell.y) as f32
    }

    /// True if bodies that each keep others `clearance` away from their centres leave a place free
    /// wherever they are.
    pub(crate) fn holds(&self, n_others: usize, clearance: f32) -> bool {
        // A disc of this radius covers the whole of every cell whose centre is within the
        // clearance.
        let radius = f64::from(clearance) + self.half_diagonal();
        let covered = n_others as f64 * std::f64::consts::PI * radius * radius;
        covered < self.places.len() as f64 * self.grid.cell.x * self.grid.cell.y
    }

    /// True if there is a start at all.
    pub(crate) fn has_places(&self) -> bool {
        !self.places.is_empty()
    }

    /// True if a cell keeps the wall clearance; `None` if that has to be measured at the point
    /// itself.
    pub(crate) fn is_clear(&self, point: Vec2) -> Option<bool> {
        let (wanted, slack) = (f64::from(self.demands.wall_clearance), self.slack());
        match f64::from(self.distances[self.grid.cell_of(point)]) {
            distance if distance < wanted - slack => Some(false),
            distance if distance >= wanted + slack => Some(true),
            _ => None,
        }
    }

    /// The region of a point in which starts can be; `None` in solid matter and where no goal is
    /// far enough.
    pub(crate) fn region(&self, point: Vec2) -> Option<u32> {
        let region = self.regions[self.grid.cell_of(point)];
        self.hulls.get(region as usize).filter(|hull| !hull.is_empty()).map(|_| region)
    }

    /// As [`Self::region`], and that of the nearest place where the point has none.
    ///
    /// # Panics
    ///
    /// When there is no place at all.
    pub(crate) fn nearest_region(&self, point: Vec2) -> u32 {
        self.region(point).unwrap_or_else(|| {
            let distance = |cell: &usize| self.grid.centre(*cell).distance_squared(point);
            let nearest = self.places().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            self.regions[nearest.expect("a room with a place")]
        })
    }

    /// True if the body gets from one point to the other; points near to solid matter count to the
    /// nearest free cell.
    pub(crate) fn connects(&self, a: Vec2, b: Vec2) -> bool {
        let region = |point: Vec2| {
            let own = self.regions[self.grid.cell_of(point)];
            if own != SOLID {
                return own;
            }
            let distance = |cell: &usize| self.grid.centre(*cell).distance_squared(point);
            let free = (0..self.grid.len()).filter(|cell| self.regions[*cell] != SOLID);
            free.min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(SOLID, |cell| self.regions[cell])
        };
        region(a) == region(b)
    }

    /// The place of a region that is farthest from a point.
    pub(crate) fn farthest(&self, region: u32, point: Vec2) -> Vec2 {
        let further = |best: Vec2, corner: &Vec2| {
            if corner.distance_squared(point) > best.distance_squared(point) { *corner } else { best }
        };
        let hull = &self.hulls[region as usize];
        hull.iter().fold(hull[0], further)
    }

    /// True if some place of a region is a goal distance away from a point.
    pub(crate) fn has_goal(&self, region: u32, point: Vec2) -> bool {
        self.farthest(region, point).distance_squared(point) >= self.demands.goal_distance.powi(2)
    }

    /// The cells in which a start can be.
    pub(crate) fn places(&self) -> impl Iterator<Item = usize> + Clone {
        self.places.iter().map(|cell| *cell as usize)
    }

    /// The middle of a cell.
    pub(crate) fn centre(&self, cell: usize) -> Vec2 {
        self.grid.centre(cell)
    }

    /// Both sides of a cell, m.
    pub(crate) fn cell(&self) -> Vec2 {
        self.grid.cell.as_vec2()
    }

    fn half_diagonal(&self) -> f64 {
        self.grid.cell.length() / 2.0
    }

    /// Largest difference of a point's distance from that of its cell's centre, m, with room for
    /// rounding.
    fn slack(&self) -> f64 {
        self.half_diagonal() * 1.01 + 1e-3
    }

    /// Lowers the distances of those cells whose centres are within `reach` of a solid.
    fn stamp(&mut self, solid: &Solid, reach: f64) {
        let outline = Slab::new(solid);
        let (low, high) = outline.rows();
        for row in self.grid.rows_within(low - reach, high + reach) {
            let y = self.grid.min.y + self.grid.cell.y * (row as f64 + 0.5);
            let Some((left, right)) = outline.columns(y - reach, y + reach) else { continue };
            for column in self.grid.columns_within(left - reach, right + reach) {
                let cell = row * self.grid.columns + column;
                if self.distances[cell] > 0.0 {
                    let distance = solid.distance_to(self.grid.centre(cell));
                    if f64::from(distance) <= reach {
                        self.distances[cell] = self.distances[cell].min(distance);
                    }
                }
            }
        }
    }

    /// Gives the cells that keep `radius` regions: two cells that share an edge are of one. Returns
    /// the number of regions.
    fn flood(&mut self, radius: f32) -> usize {
        let (columns, n) = (self.grid.columns, self.grid.len());
        let (mut n_regions, mut open) = (0, Vec::new());
        for seed in 0..n {
            if self.regions[seed] != SOLID || self.distances[seed] < radius {
                continue;
            }
            self.regions[seed] = n_regions;
            open.push(seed);
            while let Some(cell) = open.pop() {
                let column = cell % columns;
                let neighbours = [
                    (column > 0).then(|| cell - 1),
                    (column + 1 < columns).then(|| cell + 1),
                    cell.checked_sub(columns),
                    Some(cell + columns).filter(|cell| *cell < n),
                ];
                for next in neighbours.into_iter().flatten() {
                    if self.regions[next] == SOLID && self.distances[next] >= radius {
                        self.regions[next] = n_regions;
                        open.push(next);
                    }
                }
            }
            n_regions += 1;
        }
        n_regions as usize
    }

    /// Finds the hulls of the regions and the cells in which starts can be.
    fn enumerate(&mut self, n_regions: usize) {
        let keeps = |space: &Self, cell: usize| {
            space.regions[cell] != SOLID && space.distances[cell] >= space.demands.wall_clearance
        };
        let mut outer: Vec<Vec<Vec2>> = vec![Vec::new(); n_regions];
        for row in 0..self.grid.rows {
            let first = row * self.grid.columns;
            // The hull of a region is that of the outermost cells of its rows.
            let mut ends: Vec<(u32, usize, usize)> = Vec::new();
            for cell in (first..first + self.grid.columns).filter(|cell| keeps(self, *cell)) {
                let region = self.regions[cell];
                match ends.iter_mut().find(|end| end.0 == region) {
                    Some(end) => end.2 = cell,
                    None => ends.push((region, cell, cell)),
                }
            }
            for (region, left, right) in ends {
                let points = &mut outer[region as usize];
                points.push(self.grid.centre(left));
                points.extend((right > left).then(|| self.grid.centre(right)));
            }
        }
        let hulls: Vec<Vec<Vec2>> = outer.iter().map(|points| hull(points)).collect();
        let diameters: Vec<f32> = hulls.iter().map(|hull| diameter(hull)).collect();
        self.diameter = diameters.iter().copied().fold(0.0, f32::max);
        let far = self.demands.goal_distance;
        let holds = |(hull, diameter): (Vec<Vec2>, f32)| if diameter >= far { hull } else { Vec::new() };
        self.hulls = hulls.into_iter().zip(diameters).map(holds).collect();
        let has_goal = |space: &Self, cell: usize| {
            let centre = space.grid.centre(cell);
            let hull = &space.hulls[space.regions[cell] as usize];
            hull.iter().any(|corner| corner.distance_squared(centre) >= far * far)
        };
        let places = (0..self.grid.len()).filter(|cell| keeps(self, *cell) && has_goal(self, *cell));
        self.places = places.map(|cell| cell as u32).collect();
    }
}

fn distances_to_walls(grid: &Grid, (min, max): (Vec2, Vec2)) -> Vec<f32> {
    let distance = |cell: usize| {
        let centre = grid.centre(cell);
        (centre - min).min(max - centre).min_element().max(0.0)
    };
    (0..grid.len()).map(distance).collect()
}

/// The convex hull of points that are sorted by y, then x: counter-clockwise, without points on its
/// edges.
fn hull(points: &[Vec2]) -> Vec<Vec2> {
    let turn = |a: Vec2, b: Vec2, c: Vec2| (b - a).as_dvec2().perp_dot((c - a).as_dvec2());
    let chain = |points: &mut dyn Iterator<Item = &Vec2>| {
        let mut chain: Vec<Vec2> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..] {
                if turn(a, b, *point) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(*point);
        }
        chain
    };
    if points.len() < 2 {
        return points.to_vec();
    }
    let (mut up, down) = (chain(&mut points.iter()), chain(&mut points.iter().rev()));
    up.pop();
    up.extend(&down[..down.len() - 1]);
    up
}

/// The largest distance between two corners.
fn diameter(hull: &[Vec2]) -> f32 {
    let longest = |a: &Vec2| hull.iter().map(|b| a.distance(*b)).fold(0.0, f32::max);
    hull.iter().map(longest).fold(0.0, f32::max)
}

/// A solid's outline in the world, to be cut into rows.
enum Slab {
    Disc { centre: DVec2, radius: f64 },
    Convex(Vec<DVec2>),
}

impl Slab {
    fn new(solid: &Solid) -> Self {
        if let Shape::Circle { radius } = solid.shape {
            return Self::Disc { centre: solid.pose.position.as_dvec2(), radius: f64::from(radius) };
        }
        let in_world = |v: Vec2| (solid.pose.position + solid.rotation.rotate(v)).as_dvec2();
        Self::Convex(solid.shape.vertices().into_iter().map(in_world).collect())
    }

    /// Least and largest y.
    fn rows(&self) -> (f64, f64) {
        match self {
            Self::Disc { centre, radius } => (centre.y - radius, centre.y + radius),
            Self::Convex(vertices) => vertices
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v.y), high.max(v.y))),
        }
    }

    /// Least and largest x of that part of the outline whose y is within [low, high].
    fn columns(&self, low: f64, high: f64) -> Option<(f64, f64)> {
        match self {
            Self::Disc { centre, radius } => Some((centre.x - radius, centre.x + radius)),
            Self::Convex(vertices) => {
                let mut span: Option<(f64, f64)> = None;
                for (i, a) in vertices.iter().enumerate() {
                    let b = &vertices[(i + 1) % vertices.len()];
                    let (a, b) = if a.y <= b.y { (a, b) } else { (b, a) };
                    if b.y < low || a.y > high {
                        continue;
                    }
                    let along = |y: f64| {
                        if b.y > a.y {
                            a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)).clamp(0.0, 1.0)
                        } else {
                            a.x
                        }
                    };
                    let ends = if b.y > a.y { [along(low), along(high)] } else { [a.x, b.x] };
                    for x in ends {
                        span = Some(span.map_or((x, x), |(left, right)| (left.min(x), right.max(x))));
                    }
                }
                span
            }
        }
    }
}
