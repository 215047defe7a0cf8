//! The sizes of holes, and patch radii that suit them.

use nalgebra::Point3;

use super::ExemplarOptions;
use super::surface::Surface;

/// The holes of a mesh: the fill's vertices and their distances from the holes' rims.
pub(super) struct Hole {
    /// For each vertex, the nearest vertex on a hole's rim.
    pub(super) rim: Vec<u32>,
    /// For each vertex of the fill, the maximum distance of the vertices in the same hole from the hole's rim.
    pub(super) widths: Vec<f64>,
    /// For each vertex of the fill, the index of its hole.
    pub(super) numbers: Vec<u32>,
    /// The maximum distance between the rim of a hole and a vertex of its fill.
    pub(super) width: f64,
    /// The mean length of the input mesh's edges at the rims.
    pub(super) edge: f64,
}

impl Hole {
    /// Measures the holes. The fill's vertices have the indices from `data` on. Returns `None` if there are no such vertices, or if the
    /// input mesh has no edges at the rims.
    pub(super) fn new(surface: &Surface<'_>, points: &[Point3<f64>], data: usize) -> Option<Self> {
        let missing = data as u32..points.len() as u32;
        let mut border: Vec<u32> = missing
            .flat_map(|vertex| surface.ring(vertex))
            .copied()
            .filter(|&vertex| (vertex as usize) < data)
            .collect();
        border.sort_unstable();
        border.dedup();
        let edge = mean_edge(surface, points, &border, data as u32)?;
        let rim = surface.nearest(points, border.iter().copied(), f64::INFINITY);
        let (widths, numbers) = widths(surface, points, &rim, data);
        let width = widths.iter().copied().fold(0.0, f64::max);
        Some(Self { rim, widths, numbers, width, edge })
    }

    /// The number of holes.
    pub(super) fn count(&self) -> usize {
        self.numbers.iter().max().map_or(0, |last| *last as usize + 1)
    }

    /// Returns the vertices of the fill of each hole. The fill's vertices have the indices from `data` on.
    pub(super) fn fills(&self, data: usize) -> Vec<Vec<u32>> {
        let mut fills = vec![Vec::new(); self.count()];
        for (vertex, &number) in (data as u32..).zip(&self.numbers) {
            fills[number as usize].push(vertex);
        }
        fills
    }

    /// Returns the minimum radius of a patch: [`SAMPLES`] times the mean edge length at the rims.
    pub(super) fn smallest_radius(&self) -> f64 {
        SAMPLES * self.edge
    }

    /// Returns the patch radii of all levels, from a radius that spans the hole down to the minimum. If the data are a relief with a known
    /// wavelength, the largest radius is [`WAVELENGTHS`] of it instead: a patch must hold the largest regular feature (Efros and Leung,
    /// "Texture synthesis by non-parametric sampling", 1999), and a patch with several features has few similar ones.
    pub(super) fn radii(
        &self,
        options: &ExemplarOptions,
        wavelength: Option<f64>,
        data: &[Point3<f64>],
    ) -> Vec<f64> {
        fn corner(pick: fn(f64, f64) -> f64, data: &[Point3<f64>]) -> nalgebra::Vector3<f64> {
            let start = data[0].coords;
            data.iter().fold(start, |corner, point| corner.zip_map(&point.coords, pick))
        }
        let diagonal = (corner(f64::max, data) - corner(f64::min, data)).norm();
        let mut largest = 1.5 * self.width;
        let mut levels = options.levels.clamp(1, 8) as usize;
        if let Some(wavelength) = wavelength.filter(|&wavelength| wavelength < 2.0 * self.width) {
            largest = WAVELENGTHS * wavelength;
            let steps = libm::log(largest / self.smallest_radius()) / libm::log(MAX_RADIUS_RATIO);
            levels = levels.max((steps.ceil() as usize + 1).min(MAX_LEVELS));
        }
        let largest = largest.min(0.25 * diagonal);
        let levels = levels.max(options.radii.len());
        let mut radii = self.spaced_radii(largest, levels);
        radii.resize(radii.len().max(options.radii.len()), self.smallest_radius());
        for (radius, &given) in radii.iter_mut().zip(&options.radii) {
            if given > 0.0 {
                *radius = given;
            }
        }
        radii
    }

    /// Returns a geometric sequence of radii from `largest` down to the minimum radius; only the minimum if `largest` is not above it.
    pub(super) fn spaced_radii(&self, largest: f64, levels: usize) -> Vec<f64> {
        let smallest = self.smallest_radius();
        if levels == 1 || largest <= smallest {
            return vec![smallest];
        }
        fn fraction(k: usize, levels: usize) -> f64 {
            k as f64 / (levels - 1) as f64
        }
        (0..levels).map(|k| largest * libm::pow(smallest / largest, fraction(k, levels))).collect()
    }
}

/// The largest radius of a patch of a relief, in wavelengths.
const WAVELENGTHS: f64 = 2.0;

/// Maximum ratio of the radii of consecutive levels on a relief, and maximum number of levels that are used for it.
const MAX_RADIUS_RATIO: f64 = 1.8;
const MAX_LEVELS: usize = 5;

/// The number of samples along the radius of a patch.
pub(super) const SAMPLES: f64 = 3.5;

/// Returns the mean length of the input mesh's edges at the rims; `None` if there are no such edges.
fn mean_edge(surface: &Surface<'_>, points: &[Point3<f64>], rim: &[u32], data: u32) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_u32);
    for &vertex in rim {
        for &other in surface.ring(vertex).iter().filter(|&&other| other < data) {
            sum += (points[vertex as usize] - points[other as usize]).norm();
            count += 1;
        }
    }
    (sum > 0.0).then(|| sum / f64::from(count))
}

/// Returns, for each vertex of the fill, the maximum distance of its hole's vertices from the rim, and the index of the hole.
fn widths(
    surface: &Surface<'_>,
    points: &[Point3<f64>],
    near_rim: &[u32],
    data: usize,
) -> (Vec<f64>, Vec<u32>) {
    let mut widths = vec![-1.0; points.len() - data];
    let (mut numbers, mut count) = (vec![0; points.len() - data], 0);
    for first in data..points.len() {
        if widths[first - data] >= 0.0 {
            continue;
        }
        let mut hole = vec![first];
        let (mut next, mut width) = (0, 0.0_f64);
        widths[first - data] = 0.0;
        while let Some(&vertex) = hole.get(next) {
            next += 1;
            if let Some(rim) = points.get(near_rim[vertex] as usize) {
                width = width.max((points[vertex] - rim).norm());
            }
            for &other in surface.ring(vertex as u32) {
                let other = other as usize;
                if data <= other && widths[other - data] < 0.0 {
                    widths[other - data] = 0.0;
                    hole.push(other);
                }
            }
        }
        for vertex in hole {
            (widths[vertex - data], numbers[vertex - data]) = (width, count);
        }
        count += 1;
    }
    (widths, numbers)
}
