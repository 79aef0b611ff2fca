//! The pieces of a scan: runs of neighbouring beams whose end points are close together.
//!
//! A person or a robot is a small cluster, a wall a large one. The full circle has no end: a
//! cluster may run across the seam between the last beam and the first.

#![allow(clippy::inline_always, reason = "what Isa::run compiles anew must be inlined into it")]

use std::f64::consts::TAU;

/// Neighbouring end points further apart than this belong to different clusters, m.
pub const GAP: f32 = 0.35;
/// A cluster that reaches further than this from its first end point is part of a wall or of
/// several bodies, m. (A body of 0.5 m by 0.5 m has a diagonal of 0.71 m.)
pub const SIZE_MAX: f32 = 0.75;
/// Reading of a beam that meets nothing, in the units of an observation row.
const NOTHING: f32 = 0.5;

/// Beams that are compared side by side.
const LANES: usize = 16;

/// A run of beams that met something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cluster {
    /// Its first beam, counter-clockwise.
    pub first: usize,
    /// Number of beams.
    pub n: usize,
    /// Mean of its end points in the frame of the scan, m; the first one where it is larger than
    /// [`SIZE_MAX`].
    pub centre: [f32; 2],
    /// Least range, m.
    pub nearest: f32,
    /// Largest distance of an end point from the first one, m.
    pub size: f32,
}

/// Unit vectors of the beams of a full circle: beam 0 straight ahead, counter-clockwise.
#[derive(Debug, Clone)]
pub struct Beams {
    cos: Vec<f32>,
    sin: Vec<f32>,
}

impl Beams {
    /// `n` beams.
    pub fn new(n: usize) -> Self {
        let angle = |beam: usize| TAU * beam as f64 / n as f64;
        Self {
            cos: (0..n).map(|beam| libm::cos(angle(beam)) as f32).collect(),
            sin: (0..n).map(|beam| libm::sin(angle(beam)) as f32).collect(),
        }
    }

    /// Number of beams.
    pub fn len(&self) -> usize {
        self.cos.len()
    }

    /// `true` if there is no beam.
    pub fn is_empty(&self) -> bool {
        self.cos.is_empty()
    }
}

/// End points of a scan and its clusters; reused from scan to scan.
#[derive(Debug, Clone, Default)]
pub struct ScanClusters {
    /// End points in the frame of the scan, m.
    pub points: Vec<[f32; 2]>,
    /// Ranges, m.
    pub ranges: Vec<f32>,
    joined: Vec<bool>,
    /// The clusters, by their first beam. One that crosses the seam is the last.
    pub clusters: Vec<Cluster>,
}

impl ScanClusters {
    /// Reads a scan in the units of an observation row (range/10 − ½).
    ///
    /// # Panics
    ///
    /// If the scan has another number of beams.
    #[inline(always)]
    pub fn read(&mut self, beams: &Beams, scan: &[f32]) {
        let n = beams.len();
        assert_eq!(scan.len(), n, "beams of a scan");
        self.ranges.resize(n, 0.0);
        self.points.resize(n, [0.0; 2]);
        self.joined.resize(n, false);
        let (ranges, points, joined) = (&mut self.ranges[..n], &mut self.points[..n], &mut self.joined[..n]);
        let (cos, sin) = (&beams.cos[..n], &beams.sin[..n]);
        for beam in 0..n {
            let range = (scan[beam] + 0.5) * 10.0;
            ranges[beam] = range;
            points[beam] = [range * cos[beam], range * sin[beam]];
        }
        // `true` for a beam whose end point belongs to the same cluster as that of the beam before
        // it. A miss, even a pair of them, is as far away as can be; there are no short cuts, so
        // that all beams are compared at once.
        let apart = |a: usize, b: usize| {
            let missed = scan[a].max(scan[b]) >= NOTHING;
            if missed { f32::INFINITY } else { distance_sq(points[a], points[b]) }
        };
        joined[0] = apart(n - 1, 0) <= GAP * GAP;
        for (beam, joined) in joined.iter_mut().enumerate().skip(1) {
            *joined = apart(beam - 1, beam) <= GAP * GAP;
        }
        self.clusters.clear();
        // The first beam that certainly begins a cluster; if all beams are one cluster, the circle
        // is cut at the seam.
        let start = self.joined.iter().position(|joined| !joined).unwrap_or(0);
        let mut run: Option<(usize, usize)> = None;
        for beam in (start..n).chain(0..start) {
            let goes_on = self.joined[beam];
            match &mut run {
                Some((_, count)) if goes_on => *count += 1,
                _ => {
                    if let Some(ended) = run.take() {
                        self.clusters.push(self.cluster(ended));
                    }
                    run = (scan[beam] < NOTHING).then_some((beam, 1));
                }
            }
        }
        if let Some(ended) = run {
            self.clusters.push(self.cluster(ended));
        }
    }

    #[inline(always)]
    fn cluster(&self, (first, n): (usize, usize)) -> Cluster {
        let total = self.points.len();
        // The run, cut at the seam.
        let (end, wrapped) = ((first + n).min(total), (first + n).saturating_sub(total));
        let runs = [first..end, 0..wrapped];
        let start = self.points[first];
        let (mut nearest, mut size_sq) = ([f32::INFINITY; LANES], [0.0_f32; LANES]);
        for run in &runs {
            let ranges = self.ranges[run.clone()].chunks(LANES);
            for (ranges, points) in ranges.zip(self.points[run.clone()].chunks(LANES)) {
                let lanes = nearest.iter_mut().zip(&mut size_sq);
                for ((nearest, size_sq), (range, point)) in lanes.zip(ranges.iter().zip(points)) {
                    let distance_sq = distance_sq(start, *point);
                    *nearest = if *range < *nearest { *range } else { *nearest };
                    *size_sq = if distance_sq > *size_sq { distance_sq } else { *size_sq };
                }
            }
        }
        let size = size_sq.into_iter().fold(0.0, f32::max).sqrt();
        let mut centre = start;
        if size <= SIZE_MAX {
            // In the order of the beams.
            let mut sum = [0.0_f32; 2];
            for [x, y] in runs.into_iter().flat_map(|run| &self.points[run]) {
                sum = [sum[0] + x, sum[1] + y];
            }
            let scale = 1.0 / n as f32;
            centre = sum.map(|sum| sum * scale);
        }
        Cluster { first, n, centre, nearest: nearest.into_iter().fold(f32::INFINITY, f32::min), size }
    }
}

/// `n` beams of `total` from `first` on, around the circle.
pub(super) fn run_of(first: usize, n: usize, total: usize) -> impl Iterator<Item = usize> {
    let end = first + n;
    (first..end.min(total)).chain(0..end.saturating_sub(total))
}

/// Squared distance of two points.
#[inline]
pub(super) fn distance_sq([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    let (x, y) = (ax - bx, ay - by);
    x * x + y * y
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(ranges: &[f32]) -> ScanClusters {
        let scan: Vec<f32> = ranges.iter().map(|r| r / 10.0 - 0.5).collect();
        let mut clusters = ScanClusters::default();
        clusters.read(&Beams::new(ranges.len()), &scan);
        clusters
    }

    fn runs(clusters: &ScanClusters) -> Vec<(usize, usize)> {
        clusters.clusters.iter().map(|c| (c.first, c.n)).collect()
    }

    #[test]
    fn nothing_in_reach_is_no_cluster() {
        assert!(read(&[10.0; 64]).clusters.is_empty());
    }

    #[test]
    fn a_gap_parts_and_a_miss_parts() {
        let mut ranges = [10.0; 64];
        ranges[10..14].fill(2.0);
        ranges[14..17].fill(3.0);
        ranges[20..22].fill(2.0);
        assert_eq!(runs(&read(&ranges)), [(10, 4), (14, 3), (20, 2)]);
    }

    #[test]
    fn a_scan_that_meets_something_everywhere_but_once_is_one_cluster() {
        let mut ranges = [2.0; 64];
        ranges[5] = 10.0;
        assert_eq!(runs(&read(&ranges)), [(6, 63)]);
    }

    #[test]
    fn a_cluster_runs_across_the_seam() {
        let mut ranges = [10.0; 64];
        ranges[62..].fill(1.0);
        ranges[..3].fill(1.0);
        ranges[30] = 4.0;
        let found = read(&ranges);
        assert_eq!(runs(&found), [(30, 1), (62, 5)]);
        let [x, y] = found.clusters[1].centre;
        // Beams −2 … 2 at 1 m: symmetric around straight ahead.
        let cos = |i: f64| (i * TAU / 64.0).cos();
        let expected = (1.0 + 2.0 * cos(1.0) + 2.0 * cos(2.0)) / 5.0;
        assert!((f64::from(x) - expected).abs() < 1e-6 && y.abs() < 1e-6, "{x} {y}");
    }

    #[test]
    fn a_circle_around_the_robot_is_one_cluster() {
        let found = read(&[2.0; 64]);
        assert_eq!(runs(&found), [(0, 64)]);
        assert!(
            (found.clusters[0].size - 4.0).abs() < 1e-5,
            "its two ends lie side by side, and it is large"
        );
    }
}
