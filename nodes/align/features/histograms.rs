//! Motion-invariant descriptors of the surface around a point.

use maquette_value::parallel::*;

use crate::cloud::Cloud;

/// The number of histogram intervals for each of the three angles.
const INTERVALS: usize = 11;
/// The length of a histogram, padded with zeros to a multiple of eight for SIMD comparison.
const NUMBERS: usize = 40;

/// A fast point feature histogram: Rusu, Blodow and Beetz, "Fast point feature histograms (FPFH) for 3D registration" (2009).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Histogram([f32; NUMBERS]);

impl Histogram {
    /// Returns the squared distance of two histograms, as a sum over their entries. If the sum reaches `max`, the computation ends early
    /// and returns the partial sum.
    pub(super) fn distance_sq(&self, other: &Self, max: f32) -> f32 {
        let mut off = 0.0;
        for (a, b) in self.0.chunks_exact(8).zip(other.0.chunks_exact(8)) {
            off += (0..8).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f32>();
            if off >= max {
                break;
            }
        }
        off
    }

    fn add(&mut self, other: &Self, weight: f32) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, x)| *sum += weight * x);
    }

    /// Scales each of the histogram's three parts (one per angle) to a sum of 1.
    fn normalize(mut self) -> Self {
        for part in self.0[..3 * INTERVALS].chunks_mut(INTERVALS) {
            let sum = part.iter().sum::<f32>().max(f32::MIN_POSITIVE);
            part.iter_mut().for_each(|x| *x /= sum);
        }
        self
    }
}

/// Computes the histograms of all points from neighbors within `radius`. The result is `None` near the border of the surface, where a part
/// of the neighborhood is missing.
pub(super) fn histograms(cloud: &Cloud, radius: f64) -> Vec<Option<Histogram>> {
    let points = || (0..cloud.positions.len()).into_par_iter().with_min_len(64);
    let near: Vec<Vec<u32>> =
        points().map(|k| cloud.tree.points_within(&cloud.positions[k], radius)).collect();
    // Equation 1 of the publication: the simple histogram of each point, from the angles between the normals of the point and of its
    // neighbors.
    let simple: Vec<Histogram> = points()
        .map(|k: usize| {
            let mut simple = Histogram([0.0; NUMBERS]);
            for &other in &near[k] {
                let Some(angles) = angles(cloud, k, other as usize) else { continue };
                for (part, fraction) in angles.into_iter().enumerate() {
                    let interval = ((fraction * INTERVALS as f64) as usize).min(INTERVALS - 1);
                    simple.0[part * INTERVALS + interval] += 1.0;
                }
            }
            simple.normalize()
        })
        .collect();
    // Equation 2 of the publication: the combined histogram of a point is made from the simple histograms of the point and of its
    // neighbors.
    points().map(|k| combine(cloud, k, &near[k], &simple, radius)).collect()
}

/// Combines the simple histogram of point `k` with those of its neighbors, weighted by inverse distance. Returns `None` near the border of
/// the surface.
fn combine(
    cloud: &Cloud,
    k: usize,
    near: &[u32],
    simple: &[Histogram],
    radius: f64,
) -> Option<Histogram> {
    if cloud.rim[k] || near.len() < 8 {
        return None;
    }
    let mut sum = Histogram([0.0; NUMBERS]);
    for &other in near.iter().filter(|&&other| other as usize != k) {
        let distance = (cloud.positions[k] - cloud.positions[other as usize]).norm();
        sum.add(&simple[other as usize], (radius / distance.max(1e-3 * radius)) as f32);
    }
    let mut combined = sum.normalize();
    combined.add(&simple[k], 1.0);
    Some(combined.normalize())
}

/// Describes the relative position of two points with normals by three angles, each scaled to the range from 0 to 1. Returns `None` if the
/// points coincide or a normal is parallel to the line between them.
fn angles(cloud: &Cloud, k: usize, other: usize) -> Option<[f64; 3]> {
    let way = cloud.positions[other] - cloud.positions[k];
    let way = way.try_normalize(0.0)?;
    let (mut u, mut v, mut way) = (cloud.normals[k], cloud.normals[other], way);
    // Start at that point whose normal makes the smaller angle with the connecting line.
    if u.dot(&way).abs() < v.dot(&way).abs() {
        (u, v, way) = (v, u, -way);
    }
    let across = way.cross(&u).try_normalize(1e-9)?;
    let third = u.cross(&across);
    let rotation = libm::atan2(third.dot(&v), u.dot(&v)) / std::f64::consts::TAU + 0.5;
    Some([rotation, 0.5 + 0.5 * across.dot(&v), 0.5 + 0.5 * u.dot(&way)])
}
