//! How well two scans fit.

use maquette_value::parallel::*;
use nalgebra::Isometry3;

use super::cloud::Cloud;

/// How well two scans fit, counted on both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fit {
    /// Points of each.
    pub(super) points: [usize; 2],
    /// Those that lie on the other.
    pub(super) on: [usize; 2],
    /// Those that do not, although the other goes on there.
    pub(super) off: usize,
}

impl Fit {
    /// Which part of a scan lies on the other, in percent.
    pub(super) fn share(&self, side: usize) -> f64 {
        100.0 * self.on[side] as f64 / self.points[side].max(1) as f64
    }

    /// Which part of what both should see agrees, in percent.
    pub(super) fn agreement(&self) -> f64 {
        let on = (self.on[0] + self.on[1]) as f64;
        100.0 * on / (on + self.off as f64).max(1.0)
    }

    /// Much that agrees, and little that does not.
    pub(super) fn score(&self) -> f64 {
        (self.on[0] + self.on[1]) as f64 * self.agreement() * self.agreement()
    }
}

/// How well a scan fits another when it has moved so; both are sampled by grids. What lies on the other may be as far off as
/// neighbors of one scan are off each other's planes, which tells noise and curvature, and a part of the edge more.
pub(super) fn fit(clouds: [&Cloud; 2], motion: &Isometry3<f64>) -> Fit {
    let edge = clouds[0].spacing.max(clouds[1].spacing);
    let rough = clouds.map(|cloud| cloud.roughness()).into_iter().fold(0.0, f64::max);
    let tolerance = 0.1 * edge + 3.0 * rough;
    let mut fit = Fit { points: clouds.map(|cloud| cloud.positions.len()), ..Fit::default() };
    for (side, motion) in [(0, *motion), (1, motion.inverse())] {
        let (from, to) = (clouds[side], clouds[1 - side]);
        // 1 lies on the other, -1 does not.
        let judge = |k: usize| {
            let (at, normal) = (motion * from.positions[k], motion * from.normals[k]);
            let Some((near, _)) = to.tree.nearest(&at, 3.0 * edge) else { return 0 };
            if to.rim[near] {
                return 0;
            }
            let (way, other) = (at - to.positions[near], to.normals[near]);
            let height = way.dot(&other).abs();
            // Beside the end of the other one there is nothing to judge.
            if (way.norm_squared() - height * height).sqrt() > 1.2 * edge {
                return 0;
            }
            if height < tolerance && normal.dot(&other) > 0.7 { 1 } else { -1 }
        };
        let judged: Vec<i32> =
            (0..from.positions.len()).into_par_iter().with_min_len(512).map(judge).collect();
        fit.on[side] = judged.iter().filter(|it| **it == 1).count();
        fit.off += judged.iter().filter(|it| **it == -1).count();
    }
    fit
}
