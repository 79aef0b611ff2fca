//! Moving things in a scan: clusters of neighbouring returns, and their velocities from the scan
//! before.
//!
//! A row tells exactly how the robot moved between its last two scans: v·dt along the heading that
//! it had, then a turn of ω·dt. So a return of the scan before is known in the present frame, and
//! what is left of a cluster's displacement is its own. Only clusters that are small in both scans
//! are matched: the ends of a wall wander as the robot moves.
//!
//! # References
//!
//! D. Fox, W. Burgard, S. Thrun, "The dynamic window approach to collision avoidance", 1997,
//! doi:10.1109/100.580977, leaves moving obstacles out; this module is what the planner `dwa` adds.

use glam::Vec2;

use super::reader::RowReader;

/// When returns are one thing, and when two things are the same one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TrackConfig {
    /// Neighbouring returns farther apart than this are of two clusters (m).
    pub gap: f32,
    /// Only clusters up to this size may move (m). What is seen of a square of 0.5 m is 0.71 m
    /// across at most.
    pub size_max: f32,
    /// The same thing moves at most so far between two scans (m).
    pub shift_max: f32,
}

impl Default for TrackConfig {
    fn default() -> Self {
        Self { gap: 0.35, size_max: 0.8, shift_max: 0.3 }
    }
}

/// Neighbouring returns that are one thing, in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// The first beam, counter-clockwise.
    pub first: usize,
    /// Number of beams; they go on at beam 0 after the last one.
    pub beams: usize,
    /// Mean of its returns (m).
    pub centre: Vec2,
    /// Distance of its outermost returns (m).
    pub size: f32,
    /// Velocity over ground along the robot's axes (m/s); `None` where the scan before has nothing
    /// that fits.
    pub velocity: Option<Vec2>,
}

/// The newest scan of a row: its returns and their clusters. It keeps its memory from row to row.
#[derive(Clone, Debug, Default)]
pub struct ScanTracks {
    /// The end of each beam, in the robot's frame (m); `None` where it met nothing within the
    /// laser's range.
    pub returns: Vec<Option<Vec2>>,
    /// Counter-clockwise by their first beam.
    pub clusters: Vec<Cluster>,
    before: Vec<Cluster>,
    returns_before: Vec<Option<Vec2>>,
}

impl ScanTracks {
    /// Finds the clusters of a row's newest scan and their velocities. A function of the row alone.
    ///
    /// # Panics
    ///
    /// When the row is not of the reader's length.
    pub fn find(&mut self, reader: &RowReader, config: &TrackConfig, row: &[f32]) {
        assert_eq!(row.len(), reader.row_len(), "length of an observation row");
        cluster(reader, config, row, 0, &mut self.returns, &mut self.clusters);
        cluster(reader, config, row, 1, &mut self.returns_before, &mut self.before);
        let [v, w] = reader.velocity(row);
        let (dt, back) = (reader.dt(), -w * reader.dt());
        let turned = Vec2::new(libm::cosf(back), libm::sinf(back));
        self.before.retain(|cluster| cluster.size <= config.size_max);
        for cluster in &mut self.before {
            cluster.centre = turned.rotate(cluster.centre - Vec2::new(v * dt, 0.0));
        }
        let may_move = |cluster: &Cluster| cluster.size <= config.size_max;
        let small: Vec<Vec2> = self.clusters.iter().filter(|c| may_move(c)).map(|c| c.centre).collect();
        for cluster in self.clusters.iter_mut().filter(|c| may_move(c)) {
            // The same thing only if each is the other's nearest.
            let Some(old) = nearest(cluster.centre, self.before.iter().map(|c| c.centre)) else { continue };
            let shift = cluster.centre - old;
            if nearest(old, small.iter().copied()) == Some(cluster.centre)
                && shift.length() <= config.shift_max
            {
                cluster.velocity = Some(shift / dt);
            }
        }
    }
}

/// The nearest of some points; of equally near ones the first.
fn nearest(point: Vec2, others: impl Iterator<Item = Vec2>) -> Option<Vec2> {
    others.min_by(|a, b| a.distance_squared(point).total_cmp(&b.distance_squared(point)))
}

/// The returns of a scan and their clusters.
fn cluster(
    reader: &RowReader,
    config: &TrackConfig,
    row: &[f32],
    age: usize,
    returns: &mut Vec<Option<Vec2>>,
    clusters: &mut Vec<Cluster>,
) {
    returns.clear();
    clusters.clear();
    let limit = reader.limit();
    let beams = reader.ranges(row, age).zip(reader.directions());
    returns.extend(beams.map(|(range, direction)| (range < limit).then_some(range * *direction)));
    let n = returns.len();
    let joined = |a: Option<Vec2>, b: Option<Vec2>| {
        a.zip(b).is_some_and(|(a, b)| a.distance_squared(b) <= config.gap * config.gap)
    };
    // The circle is opened where a cluster begins; without such a place the whole scan is one.
    let start = (0..n).find(|&k| !joined(returns[(k + n - 1) % n], returns[k])).unwrap_or(0);
    let mut at = 0;
    while at < n {
        let first = (start + at) % n;
        let Some(point) = returns[first] else {
            at += 1;
            continue;
        };
        let (mut sum, mut beams, mut last) = (point, 1, point);
        while at + beams < n {
            let next = returns[(first + beams) % n];
            let Some(next) = next.filter(|_| joined(Some(last), next)) else { break };
            (sum, beams, last) = (sum + next, beams + 1, next);
        }
        let centre = sum / beams as f32;
        let members = (0..beams).filter_map(|k| returns[(first + k) % n]);
        let reach = |from: Vec2| members.clone().map(|p| p.distance_squared(from)).fold(0.0, f32::max);
        let size = reach(point).max(reach(last)).sqrt();
        clusters.push(Cluster { first, beams, centre, size, velocity: None });
        at += beams;
    }
    clusters.sort_by_key(|cluster| cluster.first);
}

#[cfg(test)]
mod tests {
    use jostle_sim::SimConfig;

    use super::super::scene::Scene;
    use super::*;

    fn find(scene: &Scene) -> ScanTracks {
        let mut tracks = ScanTracks::default();
        tracks.find(&RowReader::new(&SimConfig::default()), &TrackConfig::default(), &scene.row());
        tracks
    }

    #[track_caller]
    fn only(scene: &Scene) -> Cluster {
        let tracks = find(scene);
        assert_eq!(tracks.clusters.len(), 1, "{:?}", tracks.clusters);
        tracks.clusters[0]
    }

    #[test]
    fn a_walker_has_its_place_its_size_and_its_velocity() {
        let walker = only(&Scene::empty().with_walker([3.0, 0.5], 0.25, [-0.5, 0.8]));
        // The middle of what is seen of a disc: π/4 of its radius before its centre, if it is far.
        let seen = Vec2::new(3.0, 0.5) * (1.0 - 0.25 * std::f32::consts::FRAC_PI_4 / 3.04);
        assert!(walker.centre.distance(seen) < 0.03, "{walker:?}");
        assert!((0.45..=0.5).contains(&walker.size), "{walker:?}");
        // Which beams meet it changes from scan to scan: that alone moves its middle by some
        // millimetres.
        assert!(walker.velocity.unwrap().distance(Vec2::new(-0.5, 0.8)) < 0.15, "{walker:?}");
    }

    #[test]
    fn the_robots_own_motion_is_nobody_elses() {
        for (v, w) in [(1.0, 0.0), (0.0, 1.0), (0.7, -0.9)] {
            let scene = Scene::empty().with_velocity(v, w).with_disc([2.0, -1.5], 0.25);
            let standing = only(&scene).velocity.unwrap();
            assert!(standing.length() < 0.2, "({v}, {w}): {standing}");
            let scene = Scene::empty().with_velocity(v, w).with_walker([2.0, -1.5], 0.25, [0.6, 0.6]);
            let walking = only(&scene).velocity.unwrap();
            assert!(walking.distance(Vec2::splat(0.6)) < 0.2, "({v}, {w}): {walking}");
        }
    }

    #[test]
    fn what_is_large_does_not_move() {
        let wall = only(&Scene::empty().with_velocity(1.0, 0.5).with_wall([3.0, -2.0], [3.0, 2.0]));
        assert_eq!(wall.velocity, None);
        assert!((wall.size - 4.0).abs() < 0.1, "{wall:?}");
        assert_eq!(only(&Scene::empty().with_disc([3.0, 0.0], 0.5)).velocity, None);
    }

    #[test]
    fn things_are_apart_from_the_gap_on() {
        let step = |depth: f32| {
            let far = 2.0 + depth;
            let scene = Scene::empty().with_wall([2.0, 0.0], [2.0, 1.0]).with_wall([far, 0.0], [far, -1.0]);
            find(&scene).clusters.len()
        };
        assert_eq!((step(0.3), step(0.4)), (1, 2));
        // Between these two a beam meets nothing.
        let beside = Scene::empty().with_disc([2.0, 0.25], 0.2).with_disc([2.0, -0.25], 0.2);
        assert_eq!(find(&beside).clusters.len(), 2);
    }

    #[test]
    fn a_thing_across_the_first_beam_is_one() {
        let ahead = only(&Scene::empty().with_disc([2.0, 0.0], 0.3));
        assert!(ahead.first > 256 && ahead.first + ahead.beams > 512, "{ahead:?}");
        assert!(ahead.centre.y.abs() < 1e-3, "{ahead:?}");
        let beside = only(&Scene::empty().with_disc([0.0, 2.0], 0.3));
        assert!(beside.first > 100 && beside.first + beside.beams < 156, "{beside:?}");
    }

    #[test]
    fn an_empty_scan_has_no_cluster_and_a_closed_room_one() {
        let empty = find(&Scene::empty());
        assert!(empty.clusters.is_empty() && empty.returns.iter().all(Option::is_none));
        let corners = [[3.0, 2.0], [-3.0, 2.0], [-3.0, -2.0], [3.0, -2.0]];
        let room = (0..4).fold(Scene::empty(), |scene, k| scene.with_wall(corners[k], corners[(k + 1) % 4]));
        let walls = only(&room);
        assert_eq!((walls.first, walls.beams), (0, 512));
    }

    #[test]
    fn who_was_not_there_or_moves_too_fast_has_no_velocity() {
        // Beyond the laser's range in the scan before.
        let new = only(&Scene::empty().with_walker([10.1, 0.0], 0.25, [-2.0, 0.0]));
        assert_eq!(new.velocity, None);
        let fast = |u: f32| only(&Scene::empty().with_walker([3.0, 0.0], 0.25, [0.0, u])).velocity;
        assert!(fast(2.8).is_some() && fast(3.3).is_none());
    }

    #[test]
    fn of_two_that_could_be_one_the_nearer_is() {
        // One walks; a second one comes into sight 0.25 m from where the first was.
        let scene = Scene::empty().with_walker([3.0, 0.5], 0.1, [0.0, 0.5]).with_disc([3.0, -0.1], 0.1);
        let velocities: Vec<Vec2> = find(&scene).clusters.iter().filter_map(|c| c.velocity).collect();
        assert_eq!(velocities.len(), 2);
        assert!(velocities.iter().any(|u| u.length() < 0.1), "{velocities:?}");
        assert!(velocities.iter().any(|u| u.distance(Vec2::new(0.0, 0.5)) < 0.15), "{velocities:?}");
    }

    #[test]
    fn an_answer_depends_on_the_row_alone() {
        let scenes = [
            Scene::empty().with_walker([3.0, 0.5], 0.25, [-0.5, 0.8]),
            Scene::empty().with_wall([2.0, -3.0], [2.0, 3.0]).with_disc([-1.0, 0.0], 0.2),
        ];
        let (reader, config) = (RowReader::new(&SimConfig::default()), TrackConfig::default());
        let mut used = ScanTracks::default();
        used.find(&reader, &config, &scenes[0].row());
        used.find(&reader, &config, &scenes[1].row());
        let fresh = find(&scenes[1]);
        assert_eq!((used.clusters, used.returns), (fresh.clusters, fresh.returns));
    }

    #[test]
    fn a_turned_scene_is_seen_turned() {
        // A quarter turn is 128 beams.
        let turned = |[x, y]: [f32; 2]| [-y, x];
        let (at, velocity) = ([2.5, -0.8], [0.4, 0.9]);
        let [before, after] = [
            only(&Scene::empty().with_walker(at, 0.25, velocity)),
            only(&Scene::empty().with_walker(turned(at), 0.25, turned(velocity))),
        ];
        assert_eq!((after.first, after.beams), ((before.first + 128) % 512, before.beams));
        assert!(after.centre.distance(before.centre.perp()) < 1e-4);
        assert!(after.velocity.unwrap().distance(before.velocity.unwrap().perp()) < 1e-3);
    }
}
