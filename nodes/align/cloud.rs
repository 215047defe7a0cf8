//! What scans are compared by: points with normals, which know where the surface ends.

use std::collections::{BTreeSet, BinaryHeap};

use maquette_base::tree::Tree;
use maquette_range::{GRAZING, JUMP, triangulate};
use maquette_scan::Scan;
use maquette_value::parallel::*;
use maquette_value::{Mesh, RangeImage};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::align_error::AlignError;

/// Points with normals.
#[derive(Clone, Debug, Default)]
pub(super) struct Cloud {
    pub(super) positions: Vec<Point3<f64>>,
    /// Unit normals.
    pub(super) normals: Vec<Vector3<f64>>,
    /// Whether the surface ends there.
    pub(super) rim: Vec<bool>,
    /// How far neighbors are apart, in mm: the edge of the grid by which they were sampled.
    pub(super) spacing: f64,
    pub(super) tree: Tree,
}

/// So many points must a scan have.
pub(super) const FEWEST: usize = 6;

impl Cloud {
    /// The points of some scans.
    ///
    /// # Errors
    /// If one has too few points, or cannot be measured.
    pub(super) fn of_all(scans: &[&Scan]) -> Result<Vec<Self>, AlignError> {
        scans.iter().zip(1..).map(|(scan, number)| Self::of(scan, number)).collect()
    }

    /// The points of a scan, which is number `number` from 1 among others. Normals and rims are those of its faces; points without faces
    /// have those of their neighbors.
    fn of(scan: &Scan, number: usize) -> Result<Self, AlignError> {
        let all = || scan.places().iter().filter(|place| !place.x.is_nan());
        let different = all().map(|place| place.coords.data.0[0].map(f64::to_bits));
        let points = BTreeSet::from_iter(different.take(1000)).len();
        if points < FEWEST {
            return Err(AlignError::TooFewPoints { scan: number, points, least: FEWEST });
        }
        let (low, high) = bounds(all());
        let size = (high - low).norm();
        let farthest = high.coords.amax().max(low.coords.amax());
        if !(1e-9..1e9).contains(&size) || farthest > 1e6 * size {
            return Err(AlignError::Size { scan: number, size });
        }
        // From where a grid without a camera was seen is not known: it may have moved.
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
            return Ok(Self::of_points(all().copied().collect(), normals.map(|it| &**it)));
        };
        let mut cloud = Self::of_mesh(&mesh, number)?;
        if matches!(scan, Scan::RangeImage(range) if !is_seen(range)) {
            let everything = Vec::from_iter(0..cloud.positions.len());
            turn_outwards(&cloud.positions, &mut cloud.normals, &everything);
        }
        Ok(cloud)
    }

    /// Points with normals that are given, or else those of the planes through their neighbors.
    fn of_points(positions: Vec<Point3<f64>>, given: Option<&[[f64; 3]]>) -> Self {
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
            None => oriented(&positions, estimated, &tree, radius),
        };
        Self { positions, normals, rim, spacing, tree }
    }

    /// The vertices of the faces, with their normals.
    fn of_mesh(mesh: &Mesh, number: usize) -> Result<Self, AlignError> {
        let mut is_rim = vec![false; mesh.positions().len()];
        let edges = mesh.edges();
        for (ends, _) in edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1) {
            ends.iter().for_each(|&end| is_rim[end as usize] = true);
        }
        // A vertex without faces, or whose faces have no area, has no normal.
        let normals = mesh.vertex_normals();
        let kept: Vec<_> = (0..is_rim.len()).filter(|&k| normals[k].norm_squared() > 0.5).collect();
        if kept.len() < FEWEST {
            return Err(AlignError::TooFewPoints {
                scan: number,
                points: kept.len(),
                least: FEWEST,
            });
        }
        let positions: Vec<_> = kept.iter().map(|&vertex| mesh.positions()[vertex]).collect();
        let tree = Tree::new(&positions);
        Ok(Self {
            spacing: spacing(&positions, &tree),
            tree,
            normals: kept.iter().map(|&vertex| normals[vertex]).collect(),
            rim: kept.iter().map(|&vertex| is_rim[vertex]).collect(),
            positions,
        })
    }

    /// How far neighbors are off each other's planes, in mm: root mean square of up to a thousand.
    pub(super) fn roughness(&self) -> f64 {
        let step = self.positions.len().div_ceil(1000).max(1);
        let some: Vec<_> = (0..self.positions.len()).step_by(step).collect();
        fn way(from: usize, to: u32, positions: &[Point3<f64>]) -> Vector3<f64> {
            positions[to as usize] - positions[from]
        }
        let heights: Vec<f64> = some
            .par_iter()
            .filter_map(|&k| {
                let near = self.tree.within(&self.positions[k], 1.5 * self.spacing);
                let others = near.into_iter().filter(|&other| other as usize != k);
                fn distance(other: u32, k: usize, positions: &[Point3<f64>]) -> f64 {
                    way(k, other, positions).norm_squared()
                }
                let next = others.min_by(|&a, &b| {
                    distance(a, k, &self.positions).total_cmp(&distance(b, k, &self.positions))
                })?;
                Some(
                    0.5 * way(k, next, &self.positions)
                        .dot(&(self.normals[k] + self.normals[next as usize])),
                )
            })
            .collect();
        let squares = heights.iter().map(|height| height * height).sum::<f64>();
        (squares / heights.len().max(1) as f64).sqrt()
    }

    /// Lowest and highest coordinates.
    pub(super) fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        bounds(self.positions.iter())
    }

    /// Fewer points: the means of those in each cell of a grid with this edge, with the means of their normals.
    pub(super) fn sampled(&self, edge: f64) -> Self {
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
            let all = || cell.iter().map(|&(_, k)| k);
            let sum = all().map(|k| self.normals[k]).sum::<Vector3<f64>>();
            // Both sides of something thin have no common normal.
            let Some(normal) = sum.try_normalize(0.3 * cell.len() as f64) else { continue };
            let middle =
                all().map(|k| self.positions[k] - low).sum::<Vector3<f64>>() / cell.len() as f64;
            sampled.positions.push(low + middle);
            sampled.normals.push(normal);
            sampled.rim.push(all().any(|k| self.rim[k]));
        }
        sampled.tree = Tree::new(&sampled.positions);
        sampled
    }
}

pub(super) fn bounds<'a>(
    points: impl Iterator<Item = &'a Point3<f64>>,
) -> (Point3<f64>, Point3<f64>) {
    let none = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    points.fold(none, |(low, high), point| (low.inf(point), high.sup(point)))
}

/// The distance from a point to the nearest other one, in the middle of up to a thousand.
fn spacing(points: &[Point3<f64>], tree: &Tree) -> f64 {
    let (low, high) = bounds(points.iter());
    let all = (high - low).norm();
    let some: Vec<_> = points.iter().step_by(points.len().div_ceil(1000).max(1)).collect();
    // Wider and wider, until there is another one.
    let to_next = |at: &&Point3<f64>| {
        let mut reach = 0.5 * all / (points.len() as f64).sqrt();
        loop {
            let squares = tree
                .within(at, reach)
                .into_iter()
                .map(|k| (points[k as usize] - *at).norm_squared());
            let next = squares.filter(|square| *square > 0.0).fold(f64::INFINITY, f64::min);
            if next.is_finite() || reach > all {
                return next.min(all * all).sqrt();
            }
            reach *= 2.0;
        }
    };
    let mut distances: Vec<f64> = some.par_iter().map(to_next).collect();
    distances.sort_by(f64::total_cmp);
    distances[distances.len() / 2]
}

/// What the neighbors of a point tell.
struct Neighbors {
    /// Across the plane that is nearest to them; 0 if there is none.
    normal: Vector3<f64>,
    /// Whether a third of what is around it is empty.
    is_rim: bool,
}

impl Neighbors {
    fn new(at: &Point3<f64>, points: &[Point3<f64>], tree: &Tree, radius: f64) -> Self {
        let near = tree
            .within(at, radius)
            .into_iter()
            .map(|k| points[k as usize] - at)
            .collect::<Vec<_>>();
        let mean = near.iter().sum::<Vector3<f64>>() / near.len() as f64;
        let spread =
            near.iter().map(|off| (off - mean) * (off - mean).transpose()).sum::<Matrix3<f64>>();
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [least, middle, most] = order.map(|k| eigen.eigenvectors.column(k).into_owned());
        if near.len() < 4 || eigen.eigenvalues[order[1]] <= 1e-9 * eigen.eigenvalues[order[2]] {
            return Self { normal: Vector3::zeros(), is_rim: true };
        }
        let around = near.iter().filter(|off| off.norm_squared() > 0.0);
        let mut angles =
            around.map(|off| libm::atan2(middle.dot(off), most.dot(off))).collect::<Vec<_>>();
        angles.sort_by(f64::total_cmp);
        let last = angles.last().map_or(0.0, |last| last - std::f64::consts::TAU);
        let ends = std::iter::once(last).chain(angles.iter().copied());
        let gap = angles.iter().zip(ends).map(|(angle, before)| angle - before).fold(0.0, f64::max);
        Self { normal: least, is_rim: gap > std::f64::consts::TAU / 3.0 }
    }
}

/// Normals turned so that neighbors agree and that most of each part look away from its middle.
///
/// Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface reconstruction from unorganized points" (1992), section 3.3.
fn oriented(
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
        // The pair that agrees most comes first: by the bits of a cosine from 0 to 1, which are in its order.
        let mut open = BinaryHeap::from([(u64::MAX, first, first)]);
        while let Some((_, from, to)) = open.pop() {
            if std::mem::replace(&mut seen[to], true) {
                continue;
            }
            if normals[from].dot(&normals[to]) < 0.0 {
                normals[to] = -normals[to];
            }
            part.push(to);
            for next in tree.within(&points[to], radius).into_iter().map(|k| k as usize) {
                if !seen[next] {
                    open.push((normals[to].dot(&normals[next]).abs().to_bits(), to, next));
                }
            }
        }
        turn_outwards(points, &mut normals, &part);
    }
    normals
}

/// Turns the normals of some points so that most look away from their middle.
fn turn_outwards(points: &[Point3<f64>], normals: &mut [Vector3<f64>], part: &[usize]) {
    let middle = part.iter().map(|&k| points[k].coords).sum::<Vector3<f64>>() / part.len() as f64;
    let outwards = part.iter().map(|&k| normals[k].dot(&(points[k].coords - middle)));
    if outwards.sum::<f64>() < 0.0 {
        part.iter().for_each(|&k| normals[k] = -normals[k]);
    }
}
