//! From cells to lines: the outline of an occupancy grid's free area, and straight edges through
//! it.
//!
//! A rasterised wall is a staircase whose form depends on how the wall lies to the grid.
//! [`fit_ring`] goes along it and takes as many steps as one straight strip of a cell's width
//! holds; the strip's middle line is the edge. The outline of a straight wall runs within half a
//! cell of the wall itself, however it is turned, so such a strip always holds it whole: every
//! step's middle lies within half a cell of its edge's line, and a wall has the same edges in every
//! raster.
//!
//! # References
//!
//! The two rules, steps as far as a strip holds them and vertices where middle lines meet, are
//! those of P. Selinger, "Potrace: a polygon-based tracing algorithm" (2003), with the narrowest
//! strip in place of his best fit.

use glam::{DVec2, IVec2};

/// Width of a strip, cells.
const WIDTH: f64 = 1.0;
/// Largest distance by which an edge's steps go back along it, cells. At the end of a wall of one
/// cell they go back by this.
const BACK: f64 = 0.5;
/// Outlines up to this length, cells, are kept as they are: a pillar of some cells has no straight
/// edges to be found.
const SHORT: i32 = 16;
/// Largest distance of the corner of two edges from its place in the outline, cells; sharper
/// corners are cut off.
const MITRE: f64 = 2.0;
/// Largest distance of a step's middle from its edge, cells, beside corners that were cut off.
const CUT_OFF: f64 = 1.25;
/// Steps at either end of a straight run that are looked at.
const RUN_END: i32 = 6;
/// Steps by which the end of an edge is moved either way to where both edges fit best.
const WINDOW: usize = 4;
const STEPS: [IVec2; 4] = [IVec2::X, IVec2::Y, IVec2::NEG_X, IVec2::NEG_Y];

/// The closed lines between free and solid cells, in cells from the grid's lower left corner, each
/// by its corners: clockwise around free areas, counter-clockwise around the solid in them. Beyond
/// the grid all is solid. Cells that touch at a corner are joined where they are solid and not
/// where they are free, as no body fits through.
pub(super) fn cell_rings(solid: &[bool], width: usize) -> Vec<Vec<IVec2>> {
    let grid = Grid { solid, width: width as i32, height: (solid.len() / width) as i32 };
    let mut seen = vec![false; solid.len() + width];
    let mut rings = Vec::new();
    let outside = vec![true; width];
    let mut below = &outside[..];
    for (y, above) in solid.chunks_exact(width).chain([&outside[..]]).enumerate() {
        for x in 0..width {
            // An edge eastwards has its free cell below.
            if above[x] && !below[x] && !seen[y * width + x] {
                rings.push(grid.trace(IVec2::new(x as i32, y as i32), &mut seen));
            }
        }
        below = above;
    }
    rings
}

struct Grid<'a> {
    solid: &'a [bool],
    width: i32,
    height: i32,
}

impl Grid<'_> {
    fn is_solid(&self, cell: IVec2) -> bool {
        let inside = (0..self.width).contains(&cell.x) && (0..self.height).contains(&cell.y);
        !inside || self.solid[(cell.y * self.width + cell.x) as usize]
    }

    /// The line that leaves a corner eastwards, free cells on its right.
    fn trace(&self, start: IVec2, seen: &mut [bool]) -> Vec<IVec2> {
        let (mut corners, mut at, mut heading) = (Vec::new(), start, 0);
        loop {
            if heading == 0 {
                seen[(at.y * self.width + at.x) as usize] = true;
            }
            at += STEPS[heading];
            let next = self.turn(at, heading);
            if next != heading {
                corners.push(at);
            }
            heading = next;
            if at == start && heading == 0 {
                return corners;
            }
        }
    }

    /// The heading of the line behind a corner: to the right of a solid cell ahead on the free
    /// side, else straight along a solid one on the other side, else to the left.
    fn turn(&self, at: IVec2, heading: usize) -> usize {
        // The cells ahead on the right and on the left, by their lower left corners.
        let (right, left) = match heading {
            0 => (at - IVec2::Y, at),
            1 => (at, at - IVec2::X),
            2 => (at - IVec2::X, at - IVec2::ONE),
            _ => (at - IVec2::ONE, at - IVec2::Y),
        };
        match (self.is_solid(right), self.is_solid(left)) {
            (true, _) => (heading + 3) % 4,
            (false, true) => heading,
            (false, false) => (heading + 1) % 4,
        }
    }
}

/// Straight edges through a line of cells' edges: the vertices of a closed polygon. What is too
/// small for that, or comes out with another area by more than three quarters of a cell along its
/// line, stays as it is.
pub(super) fn fit_ring(corners: &[IVec2]) -> Vec<DVec2> {
    let as_it_is = || corners.iter().map(|corner| corner.as_dvec2()).collect::<Vec<_>>();
    let length: i32 = (0..corners.len()).map(|i| run(corners, i).abs().element_sum()).sum();
    if length <= SHORT {
        return as_it_is();
    }
    let fitted = vertices(&middles(corners));
    let (before, after) = (area(&as_it_is()), area(&fitted));
    let same = fitted.len() >= 3 && (after - before).abs() <= 0.75 * f64::from(length);
    if same && before * after > 0.0 { fitted } else { as_it_is() }
}

fn run(corners: &[IVec2], i: usize) -> IVec2 {
    corners[(i + 1) % corners.len()] - corners[i]
}

/// Middles of the cells' edges. Of those in a long straight run only some at either end, which
/// bound the others; enough that the run keeps some of its own where strips reach around its
/// corners.
fn middles(corners: &[IVec2]) -> Vec<DVec2> {
    let mut points = Vec::with_capacity(4 * corners.len());
    for (i, corner) in corners.iter().enumerate() {
        let run = run(corners, i);
        let (step, n) = (run.signum().as_dvec2(), run.abs().element_sum());
        let kept = (0..n).filter(|k| *k < RUN_END || *k >= n - RUN_END);
        points.extend(kept.map(|k| corner.as_dvec2() + step * (f64::from(k) + 0.5)));
    }
    points
}

/// The area, cells²; positive for counter-clockwise.
fn area(ring: &[DVec2]) -> f64 {
    (0..ring.len()).map(|i| ring[i].perp_dot(ring[(i + 1) % ring.len()])).sum::<f64>() / 2.0
}

/// The polygon through a closed row of points.
fn vertices(points: &[DVec2]) -> Vec<DVec2> {
    let n = points.len();
    // The first edge begins somewhere within a straight part; the second one begins at a corner.
    let start = longest(&twice(points), 0, n) % n;
    let mut points = points.to_vec();
    points.rotate_left(start);
    // Three turns, the edges in the middle one, so that both ends of each can be moved.
    let points = [twice(&points), points].concat();
    let mut edges: Vec<(usize, usize)> = Vec::new();
    let mut at = n;
    while at < 2 * n {
        let end = longest(&points, at, 2 * n);
        edges.push((at, end));
        at = end;
    }
    for _ in 0..2 {
        absorb(&points, n, &mut edges);
        if edges.len() < 3 {
            return Vec::new();
        }
        for i in 0..edges.len() {
            refine(&points, n, &mut edges, i);
        }
        unite(&points, n, &mut edges);
    }
    if edges.len() < 3 {
        return Vec::new();
    }
    let lines: Vec<Strip> = edges.iter().map(|(a, b)| Strip::along(&points[*a..*b])).collect();
    let corner = |i: usize| {
        let next = (i + 1) % edges.len();
        let (last, first) = (points[edges[i].1 - 1], points[edges[next].0]);
        join(&lines[i], &lines[next], (last + first) / 2.0)
    };
    let corners: Vec<Vec<DVec2>> = (0..edges.len()).map(corner).collect();
    let mut ring = Vec::with_capacity(edges.len() + 4);
    for (i, corner) in corners.iter().enumerate() {
        let before = &corners[(i + corners.len() - 1) % corners.len()];
        let own = &points[edges[i].0..edges[i].1];
        // Beside spurs and notches of a cell's width, corners may be cut off that are more than a
        // rough place: there the steps themselves are kept.
        if own.iter().any(|point| off(*point, before[before.len() - 1], corner[0]) > CUT_OFF) {
            ring.extend(own);
        }
        ring.extend(corner);
    }
    ring
}

/// Distance of a point from the straight line between two others.
fn off(point: DVec2, a: DVec2, b: DVec2) -> f64 {
    let t = (point - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE);
    point.distance(a + t.clamp(0.0, 1.0) * (b - a))
}

fn twice(points: &[DVec2]) -> Vec<DVec2> {
    points.iter().chain(points).copied().collect()
}

/// One past the last point of the longest edge that begins at `from`, at most `limit`.
fn longest(points: &[DVec2], from: usize, limit: usize) -> usize {
    let fits = |end: usize| Strip::narrowest(&hull(&points[from..end])).width <= WIDTH + 1e-9;
    let mut size = 2;
    while from + 2 * size <= limit && fits(from + 2 * size) {
        size *= 2;
    }
    let (mut good, mut bad) = ((from + size).min(limit), (from + 2 * size).min(limit) + 1);
    while bad - good > 1 {
        let middle = good.midpoint(bad);
        if fits(middle) { good = middle } else { bad = middle }
    }
    loop {
        match turns_back(&points[from..good]) {
            Some(i) if from + i.max(2) < good => good = from + i.max(2),
            _ => return good,
        }
    }
}

/// True if one edge holds the points: a strip does, and they do not turn back along it.
fn is_straight(points: &[DVec2]) -> bool {
    Strip::narrowest(&hull(points)).width <= WIDTH + 1e-9 && turns_back(points).is_none()
}

/// The first point that goes back along its edge by more than a step to the side takes.
fn turns_back(points: &[DVec2]) -> Option<usize> {
    let strip = Strip::along(points);
    let mut far = f64::NEG_INFINITY;
    points.iter().position(|point| {
        let at = strip.direction.dot(*point);
        far = far.max(at);
        at < far - BACK + 1e-6
    })
}

/// Moves the end of edge `i` and the start of the next one to where both strips are narrowest. One
/// point may be left to neither: the step across the end of a thin wall.
fn refine(points: &[DVec2], n: usize, edges: &mut [(usize, usize)], i: usize) {
    let next = (i + 1) % edges.len();
    // The edge behind the last one is the first one, a whole turn later.
    let turn = if next == 0 { n } else { 0 };
    let ((from, end), (start, to)) = (edges[i], (edges[next].0 + turn, edges[next].1 + turn));
    let low = end.saturating_sub(WINDOW).max(from + 2);
    let high = (end + WINDOW).min(to.saturating_sub(3));
    if low >= high {
        return;
    }
    let (left, right) = (hull(&points[from..low]), hull(&points[high + 1..to]));
    let width = |core: &[DVec2], more: &[DVec2]| {
        let points: Vec<DVec2> = core.iter().chain(more).copied().collect();
        Strip::narrowest(&hull(&points)).width
    };
    let cost = |cut: usize, skipped: usize| {
        let (a, b) = (width(&left, &points[low..cut]), width(&right, &points[cut + skipped..=high]));
        a * a + b * b + 0.01 * skipped as f64
    };
    let mut best = (f64::INFINITY, end, start);
    for distance in 0..=WINDOW {
        for cut in [end.saturating_sub(distance), end + distance] {
            for skipped in 0..=1 {
                if (low..=high).contains(&cut) && cut + skipped <= high + 1 {
                    let cost = cost(cut, skipped);
                    if cost < best.0 - 1e-9 {
                        best = (cost, cut, cut + skipped);
                    }
                }
            }
        }
    }
    edges[i].1 = best.1;
    edges[next].0 = best.2 - turn;
}

/// Drops edges of a few steps that their neighbours can hold between them, all but one: what is
/// left where the last edge meets the start of the first, which had reached around its corner.
fn absorb(points: &[DVec2], n: usize, edges: &mut Vec<(usize, usize)>) {
    let fits = |from: usize, end: usize| is_straight(&points[from..end]);
    let mut i = 0;
    while i < edges.len() && edges.len() > 2 {
        let (from, end) = edges[i];
        let (before, next) = ((i + edges.len() - 1) % edges.len(), (i + 1) % edges.len());
        let back = if i == 0 { n } else { 0 };
        let turn = if next == 0 { n } else { 0 };
        let (first, last) = (edges[before].0 - back, edges[next].1 + turn);
        let cuts = (from..=end).flat_map(|cut| [(cut, cut), (cut, cut + 1)]);
        let mut held = cuts.filter(|(cut, start)| {
            *start <= end && fits(first, *cut) && fits(*start, last.min(points.len()))
        });
        match (end - from <= WINDOW).then(|| held.next()).flatten() {
            Some((cut, start)) => {
                (edges[before].1, edges[next].0) = (cut + back, start - turn);
                edges.remove(i);
            }
            None => i += 1,
        }
    }
}

/// Makes one edge of two neighbours that one strip holds: the first edge may have begun within a
/// straight part.
fn unite(points: &[DVec2], n: usize, edges: &mut Vec<(usize, usize)>) {
    let mut i = 0;
    while i < edges.len() && edges.len() > 3 {
        let next = (i + 1) % edges.len();
        let turn = if next == 0 { n } else { 0 };
        let (a, b) = (edges[i], (edges[next].0 + turn, edges[next].1 + turn));
        let direction = |(from, end): (usize, usize)| Strip::along(&points[from..end]).direction;
        if b.1 <= points.len() && direction(a).dot(direction(b)) > 0.5 && is_straight(&points[a.0..b.1]) {
            // The united edge keeps the later place of the two, within the three turns.
            edges[next] = (a.0 - turn, b.1 - turn);
            edges.remove(i);
        } else {
            i += 1;
        }
    }
}

/// The corner of two edges: where their lines meet; at the end of a thin wall, where they do not,
/// one point on each.
fn join(a: &Strip, b: &Strip, near: DVec2) -> Vec<DVec2> {
    let sine = a.direction.perp_dot(b.direction);
    let meeting = a.centre + a.direction * ((b.centre - a.centre).perp_dot(b.direction) / sine);
    if sine.abs() > 1e-6 && meeting.distance(near) <= MITRE {
        return vec![meeting];
    }
    let (on_a, on_b) = (a.nearest(near), b.nearest(near));
    if a.direction.dot(b.direction) >= 0.0 { vec![(on_a + on_b) / 2.0] } else { vec![on_a, on_b] }
}

/// The narrowest strip around points.
#[derive(Clone, Copy, Debug)]
struct Strip {
    /// A point of the middle line.
    centre: DVec2,
    /// Along the middle line, length 1.
    direction: DVec2,
    width: f64,
}

impl Strip {
    /// Around a convex hull: one of its edges lies on the strip's border.
    fn narrowest(hull: &[DVec2]) -> Self {
        let n = hull.len();
        if n < 3 {
            let direction = (hull[n - 1] - hull[0]).try_normalize().unwrap_or(DVec2::X);
            return Self { centre: (hull[0] + hull[n - 1]) / 2.0, direction, width: 0.0 };
        }
        let mut best = Self { centre: hull[0], direction: DVec2::X, width: f64::INFINITY };
        let mut far = 1;
        for i in 0..n {
            let direction = (hull[(i + 1) % n] - hull[i]).normalize();
            let distance = |k: usize| direction.perp_dot(hull[k % n] - hull[i]);
            // The farthest corner goes round as the edge does.
            while distance(far + 1) > distance(far) {
                far += 1;
            }
            let width = distance(far);
            if width < best.width {
                best = Self { centre: hull[i] + direction.perp() * (width / 2.0), direction, width };
            }
        }
        best
    }

    /// Around a row of points, its direction that in which they go.
    fn along(points: &[DVec2]) -> Self {
        let strip = Self::narrowest(&hull(points));
        let first = strip.direction.dot(points[0]);
        let ahead = |point: &DVec2| strip.direction.dot(*point) - first;
        let farthest = points.iter().map(ahead).fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        if farthest < 0.0 { Self { direction: -strip.direction, ..strip } } else { strip }
    }

    /// The point of the middle line nearest to another.
    fn nearest(&self, point: DVec2) -> DVec2 {
        self.centre + self.direction * self.direction.dot(point - self.centre)
    }
}

/// The convex hull, counter-clockwise (A. M. Andrew 1979, doi:10.1016/0020-0190(79)90072-3).
fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull: Vec<DVec2> = Vec::with_capacity(16);
    let mut add = |point: DVec2, least: usize| {
        while hull.len() > least {
            let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
            if (b - a).perp_dot(point - b) > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(point);
        hull.len()
    };
    let mut lower = 0;
    for point in &sorted {
        lower = add(*point, 1);
    }
    for point in sorted.iter().rev().skip(1) {
        add(*point, lower);
    }
    hull.pop();
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rings(rows: &[&str]) -> Vec<Vec<IVec2>> {
        let cells: Vec<bool> = rows.iter().rev().flat_map(|row| row.chars().map(|c| c == '#')).collect();
        cell_rings(&cells, rows[0].len())
    }

    fn raster(side: i32, is_free: impl Fn(DVec2) -> bool) -> Vec<bool> {
        let centre = |i: i32| DVec2::new(f64::from(i % side) + 0.5, f64::from(i / side) + 0.5);
        (0..side * side).map(|i| !is_free(centre(i))).collect()
    }

    /// The turn the other way.
    fn back(turn: DVec2) -> DVec2 {
        DVec2::new(turn.x, -turn.y)
    }

    #[test]
    fn lines_go_clockwise_around_free_areas_and_counter_clockwise_around_islands() {
        let rings = rings(&["......", ".##...", ".##...", "......"]);
        let areas: Vec<f64> =
            rings.iter().map(|ring| area(&ring.iter().map(|c| c.as_dvec2()).collect::<Vec<_>>())).collect();
        assert_eq!((rings.len(), rings.iter().map(Vec::len).sum::<usize>()), (2, 8));
        assert!(areas.contains(&-24.0) && areas.contains(&4.0), "{areas:?}");
    }

    #[test]
    fn cells_that_touch_at_a_corner_are_one_solid_and_two_free_areas() {
        // One line around both solid cells, through the corner that they share.
        assert_eq!(rings(&["....", ".#..", "..#.", "...."]).len(), 2);
        assert_eq!(rings(&["####", "#.##", "##.#", "####"]).len(), 2);
    }

    #[test]
    fn an_axis_parallel_outline_is_exact() {
        let rows = ["........####", "............", "..##........", "..##........"];
        let wide: Vec<String> =
            rows.iter().map(|row| row.chars().map(|c| c.to_string().repeat(8)).collect()).collect();
        let tall: Vec<&str> = wide.iter().flat_map(|row| [row.as_str(); 8]).collect();
        for ring in rings(&tall) {
            let fitted = fit_ring(&ring);
            assert_eq!(fitted.len(), ring.len());
            for corner in &ring {
                let near = fitted.iter().map(|v| v.distance(corner.as_dvec2())).fold(f64::INFINITY, f64::min);
                assert!(near < 1e-9, "{corner}: {near}");
            }
        }
    }

    #[test]
    fn a_square_has_four_corners_however_it_is_turned() {
        for degrees in 0..90_i32 {
            let turn = DVec2::from_angle(f64::from(degrees).to_radians());
            let middle = DVec2::new(150.3, 149.8);
            let solid = raster(300, |at| {
                let own = back(turn).rotate(at - middle);
                own.abs().max_element() < 100.0
            });
            let rings = cell_rings(&solid, 300);
            let fitted = fit_ring(&rings[0]);
            assert_eq!((rings.len(), fitted.len()), (1, 4), "{degrees}°: {fitted:?}");
            for vertex in fitted {
                let own = back(turn).rotate(vertex - middle).abs();
                assert!((own - 100.0).abs().max_element() < 0.75, "{degrees}°: {own}");
            }
        }
    }

    #[test]
    fn a_thin_wall_keeps_both_sides_and_its_ends() {
        for degrees in [0.0_f64, 7.0, 30.0, 45.0, 90.0] {
            let turn = DVec2::from_angle(degrees.to_radians());
            let solid = raster(120, |at| {
                let own = back(turn).rotate(at - DVec2::new(60.0, 60.0)).abs();
                own.x > 40.0 || own.y > 1.0
            });
            let rings = cell_rings(&solid, 120);
            let wall = rings.iter().map(|ring| fit_ring(ring)).find(|ring| area(ring) > 0.0).expect("a wall");
            assert!((area(&wall) - 160.0).abs() < 60.0, "{degrees}°: {} of {wall:?}", area(&wall));
            let ends = wall.iter().map(|v| turn.dot(*v - DVec2::splat(60.0)));
            let (low, high) = ends.fold((0.0_f64, 0.0_f64), |(low, high), at| (low.min(at), high.max(at)));
            assert!((low + 40.0).abs() < 2.0 && (high - 40.0).abs() < 2.0, "{degrees}°: {low} {high}");
        }
    }

    #[test]
    fn what_is_short_stays_as_it_is() {
        let pillar = rings(&["....", ".#..", "....", "...."]);
        assert_eq!(fit_ring(&pillar[1]).len().min(fit_ring(&pillar[0]).len()), 4);
    }

    #[test]
    fn every_step_of_a_round_outline_is_within_a_cell_of_an_edge() {
        let middle = DVec2::splat(150.0);
        let solid = raster(300, |at| at.distance(middle) < 120.0);
        let ring = &cell_rings(&solid, 300)[0];
        let fitted = fit_ring(ring);
        assert!(fitted.len() < 60, "{}", fitted.len());
        for step in middles(ring) {
            let to_edge = |i: usize| off(step, fitted[i], fitted[(i + 1) % fitted.len()]);
            let distance = (0..fitted.len()).map(to_edge).fold(f64::INFINITY, f64::min);
            assert!(distance <= 1.0, "{step}: {distance}");
        }
    }
}
