//! The form to which all scans are converted for registration: points with normals, and flags that mark the border of the surface.

use std::collections::{BTreeSet, BinaryHeap};

use maquette_base::tree::Tree;
use maquette_node::{Error, bail};
use maquette_range::{GRAZING, JUMP, triangulate};
use maquette_scan::Scan;
use maquette_value::parallel::*;
use maquette_value::{Mesh, RangeImage};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::local_origin::LocalOrigin;

/// A point cloud with normals, and with flags that mark the border of the surface.
#[derive(Clone, Debug, Default)]
pub(super) struct Cloud {
    pub(super) positions: Vec<Point3<f64>>,
    /// Unit normals of the points.
    pub(super) normals: Vec<Vector3<f64>>,
    /// For each point, true if the point is at the border of the surface.
    pub(super) rim: Vec<bool>,
    /// The distance between neighboring points, in mm. After sampling this is the edge length of the sampling grid's cells.
    pub(super) spacing: f64,
    pub(super) tree: Tree,
}

/// The minimum number of points of a scan.
pub(super) const MIN_POINTS: usize = 6;

impl Cloud {
    /// Converts scans to point clouds with normals, in the order of the scans. Positions are relative to the returned origin, so that
    /// rounding does not depend on the distance of the scans from the origin of their coordinates.
    ///
    /// # Errors
    /// If a scan has too few points, its size is extreme, or it is far from the first scan.
    pub(super) fn from_scans(scans: &[&Scan]) -> Result<(Vec<Self>, LocalOrigin), Error> {
        let origin = scans.first().map_or_else(LocalOrigin::default, |scan| LocalOrigin::new(scan));
        let clouds = scans
            .par_iter()
            .zip(1..scans.len() + 1)
            .map(|(scan, number): (&&Scan, usize)| Self::from_scan(scan, origin, number))
            .collect::<Result<_, _>>()?;
        Ok((clouds, origin))
    }

    /// Converts a scan to a cloud. `number` is the number of the scan, from 1, for error messages. Normals and border flags are computed
    /// from the faces; without faces they are estimated from neighboring points.
    fn from_scan(scan: &Scan, origin: LocalOrigin, number: usize) -> Result<Self, Error> {
        let all = scan.positions().iter().filter(|point| !point.x.is_nan());
        let different = all.clone().map(|point| point.coords.data.0[0].map(f64::to_bits));
        let points = different.take(1000).collect::<BTreeSet<_>>().len();
        if points < MIN_POINTS {
            return Err(too_few_points(number, points));
        }
        let (low, high) = bounds(all.clone());
        let size = (high - low).norm();
        if !(1e-9..1e9).contains(&size) {
            bail!(
                "the bounding box of scan {number} has a diagonal of {size:e} mm, expected 1e-9 to 1e9 mm; scale all scans (`Transform`), or state their `unit` where they are read"
            );
        }
        let distance = origin.distance(&nalgebra::center(&low, &high));
        if distance > 1e6 * size {
            bail!(
                "scan {number} is {distance:e} mm from {}, but only {size:e} mm large; move it nearer (`Transform`)",
                if number == 1 { "the origin" } else { "scan 1" }
            );
        }
        // If the range image has no camera, the position of the sensor is unknown, because the grid may have been moved.
        fn is_seen(range: &RangeImage) -> bool {
            range.camera().is_some()
        }
        let (faces, normals) = match scan {
            Scan::RangeImage(range) => {
                let grazing = if is_seen(range) { GRAZING } else { 90.0 };
                (triangulate(range, JUMP, grazing, 0).ok(), None)
            }
            Scan::Mesh(mesh) => (Some(mesh.clone()), mesh.vertex().vectors("normal")),
            Scan::Points(points) => (None, points.attributes().vectors("normal")),
        };
        let Some(mesh) = faces.filter(|mesh| !mesh.faces().is_empty()) else {
            let positions = all.map(|point| origin.localize(point)).collect();
            return Ok(Self::from_points(positions, normals.map(|it| &**it)));
        };
        let mut cloud = Self::from_mesh(&mesh, origin, number)?;
        if matches!(scan, Scan::RangeImage(range) if !is_seen(range)) {
            let everything = (0..cloud.positions.len()).collect::<Vec<_>>();
            flip_outwards(&cloud.positions, &mut cloud.normals, &everything);
        }
        Ok(cloud)
    }

    /// Converts points to a cloud. The normals are `given`; if that is `None`, they are the normals of planes fitted to neighboring points.
    fn from_points(positions: Vec<Point3<f64>>, given: Option<&[[f64; 3]]>) -> Self {
        let tree = Tree::new(&positions);
        let spacing = spacing(&positions, &tree);
        let radius = 3.0 * spacing;
        let near = positions
            .par_iter()
            .map(|at| Neighbors::new(at, &positions, &tree, radius))
            .map(|it| (it.normal, it.is_rim));
        let (estimated, rim): (Vec<_>, Vec<_>) = near.unzip();
        let normals = match given {
            Some(given) => given
                .iter()
                .map(|it| Vector3::from(*it).try_normalize(1e-9).unwrap_or_default())
                .collect(),
            None => orient_normals(&positions, estimated, &tree, radius),
        };
        Self { positions, normals, rim, spacing, tree }
    }

    /// Converts the vertices of a mesh, with their normals, to a cloud.
    fn from_mesh(mesh: &Mesh, origin: LocalOrigin, number: usize) -> Result<Self, Error> {
        let mut is_rim = vec![false; mesh.positions().len()];
        let edges = mesh.edges();
        for (ends, _) in edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1) {
            ends.iter().for_each(|&end| is_rim[end as usize] = true);
        }
        // A vertex has no normal if it has no faces, or if its faces have no area.
        let normals = mesh.vertex_normals();
        let kept: Vec<_> = (0..is_rim.len()).filter(|&k| normals[k].norm_squared() > 0.5).collect();
        if kept.len() < MIN_POINTS {
            return Err(too_few_points(number, kept.len()));
        }
        let positions: Vec<_> =
            kept.iter().map(|&vertex| origin.localize(&mesh.positions()[vertex])).collect();
        let tree = Tree::new(&positions);
        Ok(Self {
            spacing: spacing(&positions, &tree),
            tree,
            normals: kept.iter().map(|&vertex| normals[vertex]).collect(),
            rim: kept.iter().map(|&vertex| is_rim[vertex]).collect(),
            positions,
        })
    }

    /// The roughness of the surface, in mm: the root mean square distance of neighboring points from each other's tangent planes. It is
    /// computed from at most a thousand points.
    pub(super) fn roughness(&self) -> f64 {
        let step = self.positions.len().div_ceil(1000).max(1);
        let some: Vec<_> = (0..self.positions.len()).step_by(step).collect();
        let heights: Vec<f64> = some
            .par_iter()
            .filter_map(|&k| {
                let near = self.tree.points_within(&self.positions[k], 1.5 * self.spacing);
                let (next, offset) = near
                    .into_iter()
                    .map(|other| other as usize)
                    .filter(|&other| other != k)
                    .map(|other| (other, self.positions[other] - self.positions[k]))
                    .min_by(|(_, a), (_, b)| a.norm_squared().total_cmp(&b.norm_squared()))?;
                Some(0.5 * offset.dot(&(self.normals[k] + self.normals[next])))
            })
            .collect();
        let squares = heights.iter().map(|height| height * height).sum::<f64>();
        (squares / heights.len().max(1) as f64).sqrt()
    }

    /// The lowest and the highest corner of the bounding box of the points, in mm.
    pub(super) fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        bounds(self.positions.iter())
    }

    /// Downsamples the cloud: averages the points and the normals in each cell of a grid whose cells have the edge length `edge`, in mm.
    pub(super) fn sample(&self, edge: f64) -> Self {
        let (low, _) = self.bounds();
        let mut cells: Vec<([u64; 3], usize)> = (0..self.positions.len())
            .into_par_iter()
            .map(|k: usize| {
                let at = (self.positions[k] - low) / edge;
                ([at.x, at.y, at.z].map(|x| x as u64), k)
            })
            .collect();
        cells.par_sort_unstable();
        let mut sampled = Self { spacing: edge, ..Self::default() };
        for cell in cells.chunk_by(|a, b| a.0 == b.0) {
            let members = cell.iter().map(|&(_, k)| k);
            let sum = members.clone().map(|k| self.normals[k]).sum::<Vector3<f64>>();
            // Skip a cell that contains both sides of a thin part: the normals in it have no meaningful mean.
            let Some(normal) = sum.try_normalize(0.3 * cell.len() as f64) else { continue };
            let middle = members.clone().map(|k| self.positions[k] - low).sum::<Vector3<f64>>()
                / cell.len() as f64;
            sampled.positions.push(low + middle);
            sampled.normals.push(normal);
            sampled.rim.push(members.clone().any(|k| self.rim[k]));
        }
        sampled.tree = Tree::new(&sampled.positions);
        sampled
    }
}

/// The error message for a scan that has only `points` different points. `number` is the number of the scan, from 1.
fn too_few_points(number: usize, points: usize) -> Error {
    Error::new(format!(
        "scan {number} has {points} different points, expected at least {MIN_POINTS}"
    ))
}

pub(super) fn bounds<'a>(
    points: impl Iterator<Item = &'a Point3<f64>>,
) -> (Point3<f64>, Point3<f64>) {
    let none = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    points.fold(none, |(low, high), point| (low.inf(point), high.sup(point)))
}

/// The median distance between a point and its nearest neighbor, computed from at most a thousand points.
fn spacing(points: &[Point3<f64>], tree: &Tree) -> f64 {
    let (low, high) = bounds(points.iter());
    let diagonal = (high - low).norm();
    let some: Vec<_> = points.iter().step_by(points.len().div_ceil(1000).max(1)).collect();
    let mut distances: Vec<f64> =
        some.par_iter().map(|at| neighbor_distance(at, points, tree, diagonal)).collect();
    distances.sort_by(f64::total_cmp);
    distances[distances.len() / 2]
}

/// The distance from a point to its nearest neighbor. Points at the same position do not count. The result is at most `diagonal`, the
/// diagonal of the bounding box.
fn neighbor_distance(at: &Point3<f64>, points: &[Point3<f64>], tree: &Tree, diagonal: f64) -> f64 {
    // Enlarge the search radius until another point is found.
    let mut reach = 0.5 * diagonal / (points.len() as f64).sqrt();
    loop {
        let squares = tree
            .points_within(at, reach)
            .into_iter()
            .map(|k| (points[k as usize] - at).norm_squared());
        let next = squares.filter(|square| *square > 0.0).fold(f64::INFINITY, f64::min);
        if next.is_finite() || reach > diagonal {
            return next.min(diagonal * diagonal).sqrt();
        }
        reach *= 2.0;
    }
}

/// Properties of a point that are estimated from its neighbors.
struct Neighbors {
    /// The normal of the plane fitted to the neighbors; 0 if no plane can be fitted.
    normal: Vector3<f64>,
    /// True if a sector of at least a third of the full circle contains no neighbors.
    is_rim: bool,
}

impl Neighbors {
    fn new(at: &Point3<f64>, points: &[Point3<f64>], tree: &Tree, radius: f64) -> Self {
        let near = tree
            .points_within(at, radius)
            .into_iter()
            .map(|k| points[k as usize] - at)
            .collect::<Vec<_>>();
        let mean = near.iter().sum::<Vector3<f64>>() / near.len() as f64;
        let spread =
            near.iter().map(|off| (off - mean) * (off - mean).transpose()).sum::<Matrix3<f64>>();
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [normal, middle, longest] = order.map(|k| eigen.eigenvectors.column(k).into_owned());
        if near.len() < 4 || eigen.eigenvalues[order[1]] <= 1e-9 * eigen.eigenvalues[order[2]] {
            return Self { normal: Vector3::zeros(), is_rim: true };
        }
        let around = near.iter().filter(|off| off.norm_squared() > 0.0);
        let mut angles =
            around.map(|off| libm::atan2(middle.dot(off), longest.dot(off))).collect::<Vec<_>>();
        angles.sort_by(f64::total_cmp);
        let last = angles.last().map_or(0.0, |last| last - std::f64::consts::TAU);
        let ends = std::iter::once(last).chain(angles.iter().copied());
        let gap = angles.iter().zip(ends).map(|(angle, before)| angle - before).fold(0.0, f64::max);
        Self { normal, is_rim: gap > std::f64::consts::TAU / 3.0 }
    }
}

/// Orients the normals: neighboring normals should agree, and in each connected part most normals should point away from the centroid.
///
/// Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface reconstruction from unorganized points" (1992), section 3.3.
fn orient_normals(
    points: &[Point3<f64>],
    mut normals: Vec<Vector3<f64>>,
    tree: &Tree,
    radius: f64,
) -> Vec<Vector3<f64>> {
    let mut seen = vec![false; points.len()];
    for first in 0..points.len() {
        if seen[first] {
            continue;
        }
        let mut part = Vec::new();
        // The pair of neighbors whose normals agree most is taken first. The bit patterns of cosines from 0 to 1 have the same order as the
        // cosines.
        let mut open = BinaryHeap::from([(u64::MAX, first, first)]);
        while let Some((_, from, to)) = open.pop() {
            if std::mem::replace(&mut seen[to], true) {
                continue;
            }
            if normals[from].dot(&normals[to]) < 0.0 {
                normals[to] = -normals[to];
            }
            part.push(to);
            for next in tree.points_within(&points[to], radius).into_iter().map(|k| k as usize) {
                if !seen[next] {
                    open.push((normals[to].dot(&normals[next]).abs().to_bits(), to, next));
                }
            }
        }
        flip_outwards(points, &mut normals, &part);
    }
    normals
}

/// Flips the normals of the points in `part` if most of these normals point towards the centroid of the points.
fn flip_outwards(points: &[Point3<f64>], normals: &mut [Vector3<f64>], part: &[usize]) {
    let middle = part.iter().map(|&k| points[k].coords).sum::<Vector3<f64>>() / part.len() as f64;
    let outwards = part.iter().map(|&k| normals[k].dot(&(points[k].coords - middle)));
    if outwards.sum::<f64>() < 0.0 {
        part.iter().for_each(|&k| normals[k] = -normals[k]);
    }
}
