//! What the surface around a point looks like, in numbers that do not change when it moves.

use maquette_value::parallel::*;

use crate::cloud::Cloud;

/// Intervals of each of the three angles.
const INTERVALS: usize = 11;
/// Numbers of a histogram; filled up with zeros, so that they are compared eight by eight.
const NUMBERS: usize = 40;

/// A fast point feature histogram: Rusu, Blodow and Beetz, "Fast point feature histograms (FPFH) for 3D registration" (2009).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Histogram([f32; NUMBERS]);

impl Histogram {
    /// How far two are apart: the square of the distance, or a part of it that is as much as `most`.
    pub(super) fn off(&self, other: &Self, most: f32) -> f32 {
        let mut off = 0.0;
        for (a, b) in self.0.chunks_exact(8).zip(other.0.chunks_exact(8)) {
            off += (0..8).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f32>();
            if off >= most {
                break;
            }
        }
        off
    }

    fn add(&mut self, other: &Self, weight: f32) {
        self.0.iter_mut().zip(&other.0).for_each(|(sum, x)| *sum += weight * x);
    }

    /// Each of the three parts adds up to 1.
    fn normalized(mut self) -> Self {
        for part in self.0[..3 * INTERVALS].chunks_mut(INTERVALS) {
            let sum = part.iter().sum::<f32>().max(f32::MIN_POSITIVE);
            part.iter_mut().for_each(|x| *x /= sum);
        }
        self
    }
}

/// The histograms of all points, of what is nearer than `radius`; none where the surface ends, since only a part of what is around is
/// there.
pub(super) fn histograms(cloud: &Cloud, radius: f64) -> Vec<Option<Histogram>> {
    let points = || (0..cloud.positions.len()).into_par_iter().with_min_len(64);
    let near: Vec<Vec<u32>> =
        points().map(|k| cloud.tree.within(&cloud.positions[k], radius)).collect();
    // Equation 1, of each point and its neighbors.
    let simple: Vec<Histogram> = points()
        .map(|k: usize| {
            let mut simple = Histogram([0.0; NUMBERS]);
            for &other in &near[k] {
                let Some(angles) = angles(cloud, k, other as usize) else { continue };
                for (part, share) in angles.into_iter().enumerate() {
                    let interval = ((share * INTERVALS as f64) as usize).min(INTERVALS - 1);
                    simple.0[part * INTERVALS + interval] += 1.0;
                }
            }
            simple.normalized()
        })
        .collect();
    // Equation 2: with those of the neighbors, the near ones most.
    let whole = |k: usize| {
        if cloud.rim[k] || near[k].len() < 8 {
            return None;
        }
        let mut sum = Histogram([0.0; NUMBERS]);
        for &other in near[k].iter().filter(|&&other| other as usize != k) {
            let distance = (cloud.positions[k] - cloud.positions[other as usize]).norm();
            sum.add(&simple[other as usize], (radius / distance.max(1e-3 * radius)) as f32);
        }
        let mut whole = sum.normalized();
        whole.add(&simple[k], 1.0);
        Some(whole.normalized())
    };
    points().map(whole).collect()
}

/// How two points with normals lie to each other, each number from 0 to 1; none of points at one place, or of one behind the other.
fn angles(cloud: &Cloud, k: usize, other: usize) -> Option<[f64; 3]> {
    let way = cloud.positions[other] - cloud.positions[k];
    let way = way.try_normalize(0.0)?;
    let (mut u, mut v, mut way) = (cloud.normals[k], cloud.normals[other], way);
    // From the one whose normal is nearer to the way.
    if u.dot(&way).abs() < v.dot(&way).abs() {
        (u, v, way) = (v, u, -way);
    }
    let across = way.cross(&u).try_normalize(1e-9)?;
    let third = u.cross(&across);
    let turn = libm::atan2(third.dot(&v), u.dot(&v)) / std::f64::consts::TAU + 0.5;
    Some([turn, 0.5 + 0.5 * across.dot(&v), 0.5 + 0.5 * u.dot(&way)])
}
