//! Surface elements (surfels). Each combines the points of one cell, with an unoriented normal and the area that the points represent.
//!
//! Normals are those of the least-squares planes of neighborhoods: Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface reconstruction
//! from unorganized points" (1992), section 3.1. In that paper, a neighborhood consists of the k nearest points. Here, its points are
//! weighted by a B-spline, on sums over cells. The cost therefore does not depend on the size of a neighborhood, which can be large enough
//! to average out noise.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{Matrix3, Point3, Vector3};

use super::cells::{CellIndex, Cube, Places, bell};
use super::cloud::Cloud;

/// Sums over the points of a cell. Coordinates are relative to the corner of the cube, in units of the cube's finest cells.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    pub(super) count: f64,
    sum: [f64; 3],
    /// Second moments xx, xy, xz, yy, yz, zz.
    squares: [f64; 6],
}

impl Moments {
    fn of_point(at: [f64; 3]) -> Self {
        let [x, y, z] = at;
        Self { count: 1.0, sum: at, squares: [x * x, x * y, x * z, y * y, y * z, z * z] }
    }

    fn add(&mut self, other: &Self, weight: f64) {
        self.count += weight * other.count;
        self.sum.iter_mut().zip(other.sum).for_each(|(a, b)| *a += weight * b);
        self.squares.iter_mut().zip(other.squares).for_each(|(a, b)| *a += weight * b);
    }

    pub(super) fn mean(&self) -> [f64; 3] {
        self.sum.map(|x| x / self.count)
    }

    fn covariance(&self) -> Matrix3<f64> {
        let [x, y, z] = self.mean();
        let [xx, xy, xz, yy, yz, zz] = self.squares.map(|x| x / self.count);
        let (xy, xz, yz) = (xy - x * y, xz - x * z, yz - y * z);
        Matrix3::new(xx - x * x, xy, xz, xy, yy - y * y, yz, xz, yz, zz - z * z)
    }
}

/// The occupied cells of one depth.
pub(super) struct Layer {
    pub(super) cells: Places,
    pub(super) moments: Vec<Moments>,
    /// For each cell, the index of the finest cell that represents it: among the finest cells inside of the cell, the one with the most
    /// points.
    pub(super) finest: Vec<u32>,
}

/// All points, sorted into the cells of the cube at every depth (cell size).
pub(super) struct Pyramid {
    pub(super) cube: Cube,
    /// The occupied cells of each depth.
    pub(super) layers: Vec<Layer>,
    /// The indices of the points, ordered by finest cell.
    pub(super) order: Vec<u32>,
    pub(super) starts: Vec<u32>,
    /// Minimum distance of two parallel sheets, in finest cells; nearer ones count as one noisy sheet. Infinite where the sides of the
    /// points are known, as sheets that face the same side are scans that do not fit together.
    pub(super) min_gap: f64,
    /// The distance of the opposite sides of thin parts, in finest cells, if it is known.
    pub(super) thickness: Option<f64>,
}

/// Returns the points sorted by their cells: the cell of each point, as a sort key, and the index of the point.
pub(super) fn by_cell(positions: &[Point3<f64>], cube: &Cube) -> Vec<(u64, u32)> {
    let places = 0..positions.len();
    let mut keys: Vec<(u64, u32)> = positions
        .par_iter()
        .zip(places)
        .map(|(point, place): (&Point3<f64>, usize)| {
            let [x, y, z] =
                cube.cell(cube.in_cells(point, cube.depth), cube.depth).map(|x| x as u64);
            (z << 32 | y << 16 | x, place as u32)
        })
        .collect();
    keys.par_sort_unstable();
    keys
}

fn place_of(key: u64) -> [u16; 3] {
    [key as u16, (key >> 16) as u16, (key >> 32) as u16]
}

impl Pyramid {
    /// Sorts the points of a cloud. Parallel sheets that are nearer to each other than `min_gap`, in mm, count as one.
    pub(super) fn new(
        cloud: &Cloud,
        cube: Cube,
        min_gap: f64,
        progress: &Progress<'_>,
    ) -> Result<Self, CancelledError> {
        let positions = &cloud.positions;
        let keys = by_cell(positions, &cube);
        let mut starts: Vec<u32> = (0..keys.len() as u32)
            .filter(|&at| at == 0 || keys[at as usize].0 != keys[at as usize - 1].0)
            .collect();
        let places = starts.iter().map(|&at| place_of(keys[at as usize].0)).collect();
        starts.push(keys.len() as u32);
        let order: Vec<u32> = keys.into_iter().map(|(_, point)| point).collect();
        let moments: Vec<Moments> = starts
            .par_windows(2)
            .map(|of_cell| {
                let mut moments = Moments::default();
                for &point in &order[of_cell[0] as usize..of_cell[1] as usize] {
                    let weight = cloud.weights.get(point as usize).copied().unwrap_or(1.0);
                    let at = cube.in_cells(&positions[point as usize], cube.depth);
                    moments.add(&Moments::of_point(at), weight);
                }
                moments
            })
            .collect();
        let finest = (0..moments.len() as u32).collect();
        let cells = Places::new(1 << cube.depth, places);
        let mut layers = vec![Layer { cells, moments, finest }];
        for depth in (0..cube.depth).rev() {
            progress.check()?;
            let coarser = coarser(&layers[layers.len() - 1], depth);
            layers.push(coarser);
        }
        layers.reverse();
        let min_gap = if cloud.has_sides() { f64::INFINITY } else { min_gap / cube.edge };
        Ok(Self { cube, layers, order, starts, min_gap, thickness: None })
    }

    pub(super) fn finest(&self) -> &Layer {
        &self.layers[self.cube.depth as usize]
    }

    /// Returns weighted sums around a position, given in finest cells: the moments, and the number of points whose weight is not 0.
    pub(super) fn sums_around(&self, at: [f64; 3], depth: u32) -> (Moments, f64) {
        let layer = &self.layers[depth as usize];
        let scale = 1.0 / f64::from(1_u32 << (self.cube.depth - depth));
        let place = self.cube.cell(at.map(|x| x * scale), depth);
        let (mut sums, mut count) = (Moments::default(), 0.0);
        for cell in layer.cells.neighbors(place) {
            let moments = &layer.moments[cell];
            let mean = moments.mean();
            let weight: f64 = (0..3).map(|axis| bell((mean[axis] - at[axis]) * scale)).product();
            if weight > 0.0 {
                sums.add(moments, weight);
                count += moments.count;
            }
        }
        (sums, count)
    }

    /// Returns the least-squares plane of the points around a position, which is given in finest cells; `None` if there are too few points.
    /// Where the points form two parallel sheets, only those of the nearer sheet count.
    fn plane(&self, at: [f64; 3], depth: u32) -> Option<Plane> {
        let (sums, count) = self.sums_around(at, depth);
        if count < MIN_PLANE_POINTS {
            return None;
        }
        let plane = self.plane_of(&sums, depth);
        let thickness = plane.as_ref().map_or(f64::INFINITY, |plane| plane.spread[0].sqrt());
        if thickness < SMALLEST_DEVIATION * self.min_gap {
            return plane;
        }
        // If the sheets are as far apart as the neighborhood is wide, only a larger neighborhood shows the direction from one to the other.
        let is_wide = plane.as_ref().is_none_or(|plane| plane.flatness() > FLAT);
        let larger = (if is_wide { 1 } else { depth }..depth).rev().take(2).filter_map(|depth| {
            let (sums, _) = self.sums_around(at, depth);
            self.plane_of(&sums, depth)
        });
        let normals: Vec<Vector3<f64>> = plane
            .iter()
            .map(|plane| plane.normal)
            .chain(larger.map(|plane| plane.normal))
            .collect();
        normals
            .iter()
            .find_map(|normal| self.plane_of(&self.sums_of_sheet(at, depth, normal)?, depth))
            .or_else(|| self.plane_of_noisy_sheet(at, depth, &normals))
            .or(plane)
    }

    /// Returns the plane of the nearer one of two sheets whose distance is known, from a neighborhood of twice the size, in which noise is
    /// averaged better.
    fn plane_of_noisy_sheet(
        &self,
        at: [f64; 3],
        depth: u32,
        normals: &[Vector3<f64>],
    ) -> Option<Plane> {
        self.thickness?;
        let larger = depth.checked_sub(1)?;
        let sums = normals.iter().find_map(|normal| self.sums_of_sheet(at, larger, normal))?;
        let plane = self.plane_of(&sums, depth)?;
        // As many points as the neighborhood of this depth would have.
        Some(Plane { weight: plane.weight / 4.0, ..plane })
    }

    pub(super) fn plane_of(&self, sums: &Moments, depth: u32) -> Option<Plane> {
        let eigen = sums.covariance().try_symmetric_eigen(f64::EPSILON, 1000)?;
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let spread = order.map(|k| eigen.eigenvalues[k].max(0.0));
        // For collinear points, any plane through the line fits equally well.
        if spread[1] < LINE * spread[2] || spread[1] == 0.0 {
            return None;
        }
        let normal = eigen.eigenvectors.column(order[0]).into_owned();
        let middle = self.cube.point(sums.mean(), self.cube.depth);
        Some(Plane { normal, middle, spread, weight: sums.count, depth })
    }

    /// Returns the weighted sums of the nearer one of two sheets perpendicular to `normal`; `None` if there are not two sheets.
    ///
    /// The heights of the points above a plane are divided into two classes such that the variance between them is largest: Otsu, "A
    /// threshold selection method from gray-level histograms" (1979). The fraction of the variance that is between the classes is 0.75 for
    /// a bent sheet, whose heights are evenly distributed, and 1 for two sheets without noise.
    fn sums_of_sheet(&self, at: [f64; 3], depth: u32, normal: &Vector3<f64>) -> Option<Moments> {
        let finer = (depth + 2).min(self.cube.depth);
        let layer = &self.layers[finer as usize];
        let scale = 1.0 / f64::from(1_u32 << (self.cube.depth - depth));
        let cells = f64::from(1_u32 << (self.cube.depth - finer));
        let low = self.cube.cell(at.map(|x| (x - 1.5 / scale) / cells), finer);
        let high = self.cube.cell(at.map(|x| (x + 1.5 / scale) / cells), finer);
        let mut heights = Vec::new();
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let row = layer.cells.row(y, z);
                let first = layer.cells.from(row.clone(), low[0]);
                for cell in
                    (first..row.end).take_while(|&cell| layer.cells.place(cell)[0] <= high[0])
                {
                    let mean = layer.moments[cell].mean();
                    let away = [0, 1, 2].map(|axis| mean[axis] - at[axis]);
                    let weight: f64 = away.iter().map(|x| bell(x * scale)).product();
                    if weight > 0.0 {
                        heights.push((Vector3::from(away).dot(normal), weight, cell));
                    }
                }
            }
        }
        heights.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let weighted = heights
            .iter()
            .map(|&(height, weight, cell)| (height, weight * layer.moments[cell].count));
        let split = split(weighted).filter(|split| self.are_sheets(split))?;
        let (below, above) = heights.split_at(split.lower);
        let threshold = (below[below.len() - 1].0 + above[0].0) / 2.0;
        let own = if threshold < 0.0 { above } else { below };
        let (mut sums, mut count) = (Moments::default(), 0.0);
        for &(_, weight, cell) in own {
            sums.add(&layer.moments[cell], weight);
            count += layer.moments[cell].count;
        }
        (count >= MIN_SHEET_POINTS).then_some(sums)
    }

    /// Returns true if two classes of heights are two sheets. Where the distance of sheets is known, noise may fill the gap between them.
    fn are_sheets(&self, split: &Split) -> bool {
        let is_known = self.thickness.is_some_and(|thickness| {
            let ratio = split.gap / thickness;
            split.between > NOISY_SHEETS && SAME_GAP < ratio && ratio * SAME_GAP < 1.0
        });
        is_known || split.between > TWO_SHEETS && split.gap >= self.min_gap
    }

    /// Returns the depth at which most neighborhoods are flat, and the deviation of the points from the surface, in mm.
    ///
    /// Larger neighborhoods contain more curvature, whose variance grows with the fourth power of the size. Comparing two sizes separates
    /// it from the variance of the noise.
    pub(super) fn flat_depth(&self) -> (u32, f64) {
        let finest = self.cube.depth;
        let mut best = (finest, f64::INFINITY, 0.0);
        let mut last = None;
        for depth in (finest.saturating_sub(COARSEST).max(1).min(finest)..=finest).rev() {
            let Some([flatness, variance]) = self.flatness(depth) else { continue };
            // Stop the search as soon as flatness gets worse: larger neighborhoods would include the global shape.
            if best.1 < MAX_PERPENDICULAR && best.1 < flatness {
                break;
            }
            if flatness < best.1 {
                let finer = last.unwrap_or(variance);
                best = (depth, flatness, ((16.0 * finer - variance) / 15.0).max(0.0));
            }
            if flatness < FLAT {
                break;
            }
            last = Some(variance);
        }
        (best.0, best.2.sqrt() * self.cube.edge)
    }

    /// Fits planes to neighborhoods at a depth. Returns the median of their flatness, and the median variance perpendicular to a plane, in
    /// squared finest cells. Returns `None` if most positions have no plane.
    fn flatness(&self, depth: u32) -> Option<[f64; 2]> {
        let layer = self.finest();
        let step = layer.moments.len().div_ceil(SAMPLES).max(1);
        let samples = layer.moments.par_chunks(step);
        let mut spreads: Vec<[f64; 2]> = samples
            .filter_map(|moments| self.plane(moments[0].mean(), depth))
            .map(|plane| [plane.flatness(), plane.spread[0]])
            .collect();
        let middle = spreads.len() / 2;
        if 2 * spreads.len() * step < layer.moments.len() || spreads.is_empty() {
            return None;
        }
        Some([0, 1].map(|k| {
            spreads.select_nth_unstable_by(middle, |a, b| a[k].total_cmp(&b[k]));
            spreads[middle][k]
        }))
    }
}

/// Minimum number of points from which a plane is computed: with fewer points, the direction of the plane is random.
const MIN_PLANE_POINTS: f64 = 9.0;

/// Points count as collinear if the second largest of their principal variances is less than this fraction of the largest.
const LINE: f64 = 0.02;

/// Two classes of heights.
pub(super) struct Split {
    /// The number of heights in the lower class.
    pub(super) lower: usize,
    /// The difference between the means of the classes.
    pub(super) gap: f64,
    /// The fraction of the variance that is between the classes.
    pub(super) between: f64,
    /// The standard deviation inside of the classes.
    pub(super) deviation: f64,
}

/// Divides heights into the two classes with the largest variance between them; `None` if all heights are equal or there are too few. The
/// heights are ascending, each with a weight.
pub(super) fn split(heights: impl Iterator<Item = (f64, f64)> + Clone) -> Option<Split> {
    let (all, sum, squares) =
        heights.clone().fold((0.0, 0.0, 0.0), |(all, sum, squares), (x, w)| {
            (all + w, sum + w * x, squares + w * x * x)
        });
    let variance = squares / all - (sum / all) * (sum / all);
    let (mut below, mut sum_below) = (0.0, 0.0);
    let mut best = Split { lower: 0, gap: 0.0, between: 0.0, deviation: 0.0 };
    for (lower, (x, weight)) in heights.enumerate() {
        let above = all - below;
        if SMALLEST_SHEET * all < below && SMALLEST_SHEET * all < above {
            let gap = (sum - sum_below) / above - sum_below / below;
            let between = below * above * gap * gap / (all * all * variance);
            if between > best.between {
                let deviation = (variance * (1.0 - between)).max(0.0).sqrt();
                best = Split { lower, gap, between, deviation };
            }
        }
        below += weight;
        sum_below += weight * x;
    }
    (best.between > 0.0).then_some(best)
}

/// Minimum standard deviation of the heights of two sheets, as a fraction of their distance, if the smaller sheet has a tenth of the
/// points.
const SMALLEST_DEVIATION: f64 = 0.3;

/// Minimum fraction of the variance of the heights that is between two sheets.
pub(super) const TWO_SHEETS: f64 = 0.82;

/// Minimum fraction of the variance that is between two sheets of known distance; with noise of a third of the distance, it is 0.69.
const NOISY_SHEETS: f64 = 0.7;

/// Minimum ratio of two distances of sheets that count as equal.
const SAME_GAP: f64 = 0.75;

/// Minimum fraction of the points that is in each of two sheets.
const SMALLEST_SHEET: f64 = 0.1;

/// Minimum number of points of a sheet from which a plane is computed.
const MIN_SHEET_POINTS: f64 = 6.0;

/// Maximum fraction of a neighborhood's variance that is perpendicular to its plane, for the neighborhood to count as flat. Noise whose
/// deviation is a tenth of the neighborhood's size reaches this fraction. In smaller neighborhoods, normals are wrong by more than 15
/// degrees.
const FLAT: f64 = 0.1;

/// Maximum fraction of variance perpendicular to a plane; neighborhoods with a larger fraction have no plane. For a few random points in a
/// ball, it is 0.4.
const MAX_PERPENDICULAR: f64 = 0.35;

/// Number of neighborhoods from which the noise is estimated.
const SAMPLES: usize = 4096;

/// Maximum number of times the resolution is halved in search of a plane.
const COARSEST: u32 = 6;

pub(super) struct Plane {
    pub(super) normal: Vector3<f64>,
    middle: Point3<f64>,
    /// The variances along the principal axes, ascending, in squared finest cells.
    spread: [f64; 3],
    weight: f64,
    depth: u32,
}

impl Plane {
    /// Returns the variance perpendicular to the plane, as a fraction of the smaller variance in the plane.
    fn flatness(&self) -> f64 {
        self.spread[0] / self.spread[1]
    }
}

fn coarser(layer: &Layer, depth: u32) -> Layer {
    let mut keys: Vec<(u64, u32)> = (0..layer.cells.len())
        .into_par_iter()
        .map(|cell: usize| {
            let [x, y, z] = layer.cells.place(cell).map(|x| x as u64 / 2);
            (z << 32 | y << 16 | x, cell as u32)
        })
        .collect();
    keys.par_sort_unstable();
    let (mut places, mut moments, mut finest) = (Vec::new(), Vec::new(), Vec::new());
    for cells in keys.chunk_by(|a, b| a.0 == b.0) {
        let mut sums = Moments::default();
        let mut largest = cells[0].1 as usize;
        for &(_, cell) in cells {
            sums.add(&layer.moments[cell as usize], 1.0);
            if layer.moments[cell as usize].count > layer.moments[largest].count {
                largest = cell as usize;
            }
        }
        places.push(place_of(cells[0].0));
        moments.push(sums);
        finest.push(layer.finest[largest]);
    }
    Layer { cells: Places::new(1 << depth, places), moments, finest }
}

/// A surface element: the combined points of one cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surfel {
    pub(super) at: Point3<f64>,
    /// The position projected onto the plane of the surfel's neighborhood. It has less noise, but is on the inner side of curved surfaces.
    pub(super) on_plane: Point3<f64>,
    /// The unit normal, with an unknown sign unless `is_sided`; 0 if the surfel belongs to no surface.
    pub(super) normal: Vector3<f64>,
    /// The area that the surfel represents, in mm^2.
    pub(super) area: f64,
    /// The spacing of points around the surfel, in mm.
    pub(super) spacing: f64,
    /// True if the normal is known to point outward.
    pub(super) is_sided: bool,
    /// Edge length of the cells of the surfel's neighborhood, in mm.
    pub(super) reach: f64,
    /// The depth of the cells of the surfel's neighborhood.
    pub(super) depth: u32,
}

/// The sum of the weights of points on a plane, divided by the density of the points: the integral of the weights over the plane, in
/// squared cells. It is 0.75 if the plane is parallel to the cells and about 0.66 if it is diagonal.
const PLANE: f64 = 0.7;

/// Returns the surfels of all finest cells.
pub(super) fn surfels(
    pyramid: &Pyramid,
    cloud: &Cloud,
    flat: u32,
    progress: &Progress<'_>,
) -> Result<Vec<Surfel>, CancelledError> {
    let cube = &pyramid.cube;
    let mut surfels = Vec::with_capacity(pyramid.finest().moments.len());
    let cells: Vec<usize> = (0..pyramid.finest().moments.len()).collect();
    for part in cells.chunks(1 << 14) {
        let of_part = part.par_iter().map(|&cell| surfel(pyramid, cloud, flat, cell));
        of_part.collect_into(&mut surfels);
        progress.tick(surfels.len() as f64 / cells.len() as f64)?;
    }
    // Limit the spacing of each surfel from below, so that it is never 0.
    for surfel in &mut surfels {
        surfel.spacing = surfel.spacing.max(1e-3 * cube.edge);
    }
    Ok(surfels)
}

fn surfel(pyramid: &Pyramid, cloud: &Cloud, flat: u32, cell: usize) -> Surfel {
    let cube = &pyramid.cube;
    let moments = &pyramid.finest().moments[cell];
    let mean = moments.mean();
    let points = &pyramid.order[pyramid.starts[cell] as usize..pyramid.starts[cell + 1] as usize];
    fn sum(vectors: &[Vector3<f64>], points: &[u32], moments_count: f64) -> Vector3<f64> {
        points.iter().map(|&point| vectors[point as usize]).sum::<Vector3<f64>>() / moments_count
    }
    let (given, view) =
        (sum(&cloud.normals, points, moments.count), sum(&cloud.views, points, moments.count));
    let plane = (1..=flat).rev().find_map(|depth| pyramid.plane(mean, depth));
    let at = cube.point(mean, cube.depth);
    let (mut normal, mut area, mut depth) = (Vector3::zeros(), cube.edge * cube.edge, flat);
    if let Some(plane) = &plane {
        let edge = cube.edge_at(plane.depth);
        (normal, depth) = (plane.normal, plane.depth);
        area = PLANE * edge * edge / plane.weight;
    }
    let mut spacing = area.sqrt();
    if depth < flat {
        // The neighborhood was enlarged because there are too few points nearby, so the spacing of points is large.
        spacing = spacing.max(SPARSE * cube.edge_at(depth));
    }
    let mut is_sided = false;
    if given.norm() > AGREED {
        (normal, is_sided) = (given.normalize(), true);
    } else if view.norm() > AGREED && (normal.dot(&view)).abs() > GRAZING_COSINE {
        (normal, is_sided) = (normal * normal.dot(&view).signum(), true);
    }
    // Points that are far from all others and from their plane belong to no surface.
    let is_stray = plane.as_ref().is_some_and(|plane| {
        let off = (plane.middle - at).dot(&plane.normal).abs();
        plane.depth < flat
            && (plane.flatness() > 2.0 * FLAT || off > STRAY * cube.edge_at(plane.depth))
    });
    if is_stray || plane.is_none() {
        normal = Vector3::zeros();
    }
    let off = plane.map_or(0.0, |plane| (plane.middle - at).dot(&normal));
    let on_plane = at + normal * off;
    Surfel {
        at,
        on_plane,
        normal,
        area: area * moments.count,
        spacing,
        is_sided,
        reach: cube.edge_at(depth),
        depth,
    }
}

/// Minimum length of the mean of the given unit normals, or of the directions to the sensor, in a cell. If the mean is shorter, they point
/// in too many directions to be used.
const AGREED: f64 = 0.3;

/// The spacing of points, in cells, at which a neighborhood contains just as many points as a plane needs.
const SPARSE: f64 = 0.6;

/// Maximum distance of a point from the plane of a sparse neighborhood, in cells; points farther away are stray points.
const STRAY: f64 = 0.35;

/// Minimum cosine of the viewing angle for which the front of a surface can be distinguished from its back.
const GRAZING_COSINE: f64 = 0.2;

/// Returns the cell at a depth that contains a point.
pub(super) fn place(cube: &Cube, at: &Point3<f64>, depth: u32) -> CellIndex {
    cube.cell(cube.in_cells(at, depth), depth)
}
