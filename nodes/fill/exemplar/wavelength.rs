//! Measures the wavelength of a relief: the distance at which the heights of a surface over its smoothed shape repeat.

use nalgebra::{Point3, Vector3};

use super::hole::Hole;
use super::surface::{Marks, Surface};

/// Distance from the hole up to which the relief is measured, in hole widths.
const REACH: f64 = 3.0;

/// Maximum number of smoothing steps. With it, smoothing reaches about 10 edges, and wavelengths of up to 20 edges are found.
const MAX_STEPS: usize = 200;

/// Number of vertices around which heights are compared.
const CENTERS: usize = 400;

/// Width of the distance classes of the autocorrelation, in edge lengths.
const CLASS: f64 = 0.5;

/// Minimum autocorrelation at the wavelength. Noise and single bumps have less.
const MIN_CORRELATION: f64 = 0.15;

/// Maximum autocorrelation between the origin and the wavelength: half a wavelength away, heights are opposite.
const MAX_VALLEY: f64 = -0.05;

/// Minimum root mean square height of a relief, in edge lengths.
const MIN_HEIGHT: f64 = 0.05;

/// Returns the wavelength of the relief around the holes, in mm; `None` if the heights do not repeat regularly.
///
/// It is the distance of the first maximum of the autocorrelation of heights, over distances only. Heights are measured along the normals
/// over the surface smoothed by means of neighbors.
pub(super) fn wavelength(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    data: usize,
    hole: &Hole,
) -> Option<f64> {
    let reach = REACH * hole.width;
    let missing = data as u32..points.len() as u32;
    let nearest = surface.nearest(points, missing, reach);
    let near: Vec<u32> =
        (0..points.len() as u32).filter(|&vertex| nearest[vertex as usize] != u32::MAX).collect();
    let edge = mean_edge(surface, points, &near)?;
    // A step of averaging neighbors spreads a point over a variance of half the squared edge length in each direction.
    let smoothing = (0.5 * hole.width / edge).max(4.0);
    let steps = ((2.0 * smoothing * smoothing) as usize).min(MAX_STEPS);
    let smooth = smooth(surface, points, &near, steps);
    let mut heights = vec![f64::NAN; points.len()];
    let (mut sum, mut count) = (0.0, 0.0);
    let own: Vec<u32> = near.iter().copied().filter(|&vertex| (vertex as usize) < data).collect();
    for &vertex in &own {
        let normal = surface.area(&smooth, vertex).try_normalize(0.0).unwrap_or_default();
        let height = (points[vertex as usize] - smooth[vertex as usize]).dot(&normal);
        heights[vertex as usize] = height;
        sum += height;
        count += 1.0;
    }
    let mean = sum / count;
    let variance = own
        .iter()
        .map(|&v| (heights[v as usize] - mean) * (heights[v as usize] - mean))
        .sum::<f64>()
        / count;
    if variance.is_nan() || variance.sqrt() < MIN_HEIGHT * edge {
        return None;
    }
    let farthest = 2.5 * smoothing.min(10.0) * edge;
    let n_classes = (farthest / (CLASS * edge)) as usize + 1;
    let mut classes = vec![(0.0, 0.0); n_classes];
    let mut marks = Marks::new(points.len());
    let every = own.len().div_ceil(CENTERS).max(1);
    for &center in own.iter().step_by(every) {
        let from = heights[center as usize] - mean;
        for other in surface.ball(
            points,
            center,
            farthest,
            |other| heights[other as usize].is_finite(),
            &mut marks,
        ) {
            let distance = (points[other as usize] - points[center as usize]).norm();
            let class = &mut classes[((distance / (CLASS * edge)) as usize).min(n_classes - 1)];
            class.0 += from * (heights[other as usize] - mean);
            class.1 += 1.0;
        }
    }
    let correlations: Vec<f64> = classes
        .iter()
        .map(|&(sum, count)| if count > 0.0 { sum / count / variance } else { 0.0 })
        .collect();
    first_maximum(&correlations).map(|class| (class + 0.5) * CLASS * edge)
}

/// Returns the position of the first maximum after the correlations have become negative, between classes.
fn first_maximum(correlations: &[f64]) -> Option<f64> {
    let smooth: Vec<f64> = (0..correlations.len())
        .map(|k| {
            let beside = [k.saturating_sub(1), (k + 1).min(correlations.len() - 1)];
            0.5 * correlations[k] + 0.25 * (correlations[beside[0]] + correlations[beside[1]])
        })
        .collect();
    let valley = smooth.iter().position(|&correlation| correlation < MAX_VALLEY)?;
    let peak = (valley + 1..smooth.len() - 1).find(|&k| {
        smooth[k] > MIN_CORRELATION && smooth[k - 1] <= smooth[k] && smooth[k] > smooth[k + 1]
    })?;
    let [before, at, after] = [smooth[peak - 1], smooth[peak], smooth[peak + 1]];
    Some(peak as f64 + 0.5 * (before - after) / (before - 2.0 * at + after))
}

fn mean_edge(surface: &Surface<'_>, points: &[Point3<f64>], vertices: &[u32]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for &vertex in vertices {
        for &other in surface.ring(vertex) {
            sum += (points[other as usize] - points[vertex as usize]).norm();
            count += 1.0;
        }
    }
    (sum > 0.0).then(|| sum / count)
}

/// Moves vertices to the means of their neighbors, repeatedly. Other vertices stay.
fn smooth(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    vertices: &[u32],
    steps: usize,
) -> Vec<Point3<f64>> {
    let mut now = points.to_vec();
    for _ in 0..steps {
        let moved: Vec<Point3<f64>> = vertices
            .iter()
            .map(|&vertex| {
                let ring = surface.ring(vertex);
                let sum: Vector3<f64> = ring.iter().map(|&other| now[other as usize].coords).sum();
                if ring.is_empty() {
                    now[vertex as usize]
                } else {
                    Point3::from(sum / ring.len() as f64)
                }
            })
            .collect();
        vertices.iter().zip(moved).for_each(|(&vertex, point)| now[vertex as usize] = point);
    }
    now
}
