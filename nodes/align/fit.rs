//! The quality of the fit of two scans.

use maquette_value::parallel::*;
use nalgebra::Isometry3;

use super::cloud::Cloud;

/// The quality of the fit of two scans, expressed by numbers of points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fit {
    /// The number of sample points of each scan.
    pub(super) points: [usize; 2],
    /// For each of the two scans, the number of its sample points that lie on the other scan.
    pub(super) on: [usize; 2],
    /// The number of points of both scans that do not lie on the other scan, although the surface of that scan continues there.
    pub(super) off: usize,
}

impl Fit {
    /// The fraction of a scan's points that lie on the other scan, in percent.
    pub(super) fn overlap(&self, side: usize) -> f64 {
        100.0 * self.on[side] as f64 / self.points[side].max(1) as f64
    }

    /// The fraction of the common surface on which the scans agree, in percent. The common surface is the part that both scans should have
    /// seen.
    pub(super) fn agreement(&self) -> f64 {
        let agreeing = (self.on[0] + self.on[1]) as f64;
        100.0 * agreeing / (agreeing + self.off as f64).max(1.0)
    }

    /// A score that grows with the number of agreeing points and falls with the number of disagreeing points.
    pub(super) fn score(&self) -> f64 {
        (self.on[0] + self.on[1]) as f64 * self.agreement() * self.agreement()
    }
}

/// Computes the fit of two sampled scans if the first one is moved by `motion`. A point lies on the other scan if its distance is at most
/// the roughness of the scans, which measures noise and curvature, plus a fraction of the edge length of the sampling grid's cells.
pub(super) fn fit(clouds: [&Cloud; 2], motion: &Isometry3<f64>) -> Fit {
    let edge = clouds[0].spacing.max(clouds[1].spacing);
    let rough = clouds.map(|cloud| cloud.roughness()).into_iter().fold(0.0, f64::max);
    let tolerance = 0.1 * edge + 3.0 * rough;
    let mut fit = Fit { points: clouds.map(|cloud| cloud.positions.len()), ..Fit::default() };
    for (side, motion) in [(0, *motion), (1, motion.inverse())] {
        let (from, to) = (clouds[side], clouds[1 - side]);
        let comparison = Comparison { from, to, motion, edge, tolerance };
        let verdicts: Vec<Option<bool>> = (0..from.positions.len())
            .into_par_iter()
            .with_min_len(512)
            .map(|k| comparison.is_on(k))
            .collect();
        fit.on[side] = verdicts.iter().filter(|it| **it == Some(true)).count();
        fit.off += verdicts.iter().filter(|it| **it == Some(false)).count();
    }
    fit
}

/// The comparison of a moved scan with another one.
struct Comparison<'a> {
    from: &'a Cloud,
    to: &'a Cloud,
    motion: Isometry3<f64>,
    /// The edge length of the cells of the coarser of the two sampling grids, in mm.
    edge: f64,
    /// The maximum distance, in mm, from the other scan at which a point counts as lying on it.
    tolerance: f64,
}

impl Comparison<'_> {
    /// Returns true if point `k` lies on the other scan; `None` if the other scan has no surface there with which the point could be
    /// compared.
    fn is_on(&self, k: usize) -> Option<bool> {
        let Self { from, to, motion, edge, tolerance } = *self;
        let (at, normal) = (motion * from.positions[k], motion * from.normals[k]);
        let (near, _) = to.tree.nearest(&at, 3.0 * edge)?;
        if to.rim[near] {
            return None;
        }
        let (offset, other) = (at - to.positions[near], to.normals[near]);
        let height = offset.dot(&other).abs();
        // Beyond the border of the other scan, there is no surface with which the point could be compared.
        if (offset.norm_squared() - height * height).sqrt() > 1.2 * edge {
            return None;
        }
        Some(height < tolerance && normal.dot(&other) > 0.7)
    }
}
