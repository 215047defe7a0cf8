//! Depths of the nodes of a grid inside a solid.

use maquette_base::solid_angle::half_solid_angle;
use maquette_node::{CancelledError, Limit, LimitError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Bounds, Mesh, TriangleTree};
use nalgebra::{Point3, Vector3};

use crate::contour::Contour;

/// Maximum number of grid nodes; measuring this many takes a few seconds and half a gigabyte of memory.
const NODES: Limit = Limit {
    max: 60_000_000,
    items: "nodes of a grid",
    help: "choose a larger `spacing`, or a thicker wall",
};

/// Number of nodes along an edge of a block. The distance of a block's center is measured first; far blocks need no distances of single
/// nodes.
const BLOCK: usize = 8;

/// Number of points whose distances are measured between two checks for cancellation. Measuring this many points takes some milliseconds,
/// and employs eight threads.
const CHUNK: usize = 16_384;

/// Minimum distance of a contour's vertex from a grid node, as a fraction of a grid edge.
const NEAREST: f64 = 0.02;

/// Distance below the surface of what is filled, in cells, up to which a node stays in the cavity: interpolated between nodes, the material
/// around such a node would be a needle.
const TIP: f64 = 0.15;

/// Distance behind a cavity's surface, in cells, beyond which a node in a cavity belongs to another place of the surface.
const AHEAD: f64 = 0.75;

/// A grid around a solid, with the depth of each node below the solid's surface.
pub(super) struct Depth {
    low: Point3<f64>,
    spacing: f64,
    /// The number of nodes along x, y and z.
    counts: [usize; 3],
    /// The depth of each node in mm; negative outside, and next to the surface. Away from the requested depth they are only lower bounds.
    depths: Vec<f64>,
}

/// Returns the number of grid nodes along x, y and z that cover the box with some extra nodes beyond each of its ends.
///
/// # Errors
/// Returns an error if the grid has too many nodes.
pub(super) fn counts(
    [low, high]: [Point3<f64>; 2],
    spacing: f64,
) -> Result<[usize; 3], LimitError> {
    let sizes = [0, 1, 2].map(|axis| ((high - low)[axis] / spacing).ceil() + 4.0);
    NODES.check("the inside of the solid", sizes.iter().product())?;
    Ok(sizes.map(|size| size as usize))
}

/// Returns the smallest edge length of cells, in mm and rounded up to three digits, at which the grid does not have too many nodes.
pub(super) fn smallest_spacing([low, high]: [Point3<f64>; 2]) -> f64 {
    let size = high - low;
    let mut spacing = libm::cbrt(size.product() / NODES.max as f64).max(1e-3);
    while counts([low, high], spacing).is_err() {
        spacing *= 1.05;
    }
    (spacing * 1000.0).ceil() / 1000.0
}

impl Depth {
    /// Measures which nodes are deeper than `deepest`, which is at least twice the spacing, and the depths of all nodes beside the surface
    /// of that depth. The minimum coordinates of the mesh are `low`.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(super) fn new(
        (mesh, tree): (&Mesh, &TriangleTree),
        low: Point3<f64>,
        (counts, spacing): ([usize; 3], f64),
        deepest: f64,
        progress: &Progress<'_>,
    ) -> Result<Self, CancelledError> {
        // Shift the grid, so that its nodes do not coincide with vertices, whose coordinates are often round numbers.
        let low = low - Vector3::repeat(1.37 * spacing);
        let mut grid = Self { low, spacing, counts, depths: Vec::new() };
        let mut distances = grid.distances(tree, deepest, progress)?;
        progress.tick(0.7)?;
        let mut is_inside = grid.find_inside(mesh, &distances, deepest, progress)?;
        progress.tick(0.8)?;
        grid.measure_ends(tree, deepest, (&mut distances, &mut is_inside), progress)?;
        for (distance, is_inside) in distances.iter_mut().zip(&is_inside) {
            if !is_inside {
                *distance = distance.min(spacing) - 2.0 * spacing;
            }
        }
        grid.depths = distances;
        Ok(grid)
    }

    /// Returns the surface inside the solid on which all points have the given depth, in mm.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(super) fn contour(
        &self,
        depth: f64,
        progress: &Progress<'_>,
    ) -> Result<Contour, CancelledError> {
        let mut contour = Contour::new(NEAREST);
        let [width, height, layers] = self.counts.map(|count| count - 1);
        for z in 0..layers {
            progress.check()?;
            for y in 0..height {
                for x in 0..width {
                    self.add_cell(&mut contour, [x, y, z], depth);
                }
            }
        }
        Ok(contour)
    }

    /// Returns true if some nodes beside the way of `length` mm from a point of a cavity's surface into the material are in a cavity, and
    /// not beside the point itself.
    pub(super) fn is_cavity_ahead(
        &self,
        from: Point3<f64>,
        way: Vector3<f64>,
        length: f64,
    ) -> bool {
        let steps = (2.0 * length / self.spacing).ceil() as usize;
        (2..=steps).any(|step| {
            let at = from + way * (step as f64 * self.spacing / 2.0);
            let cell = [0, 1, 2].map(|axis| {
                let cell = ((at[axis] - self.low[axis]) / self.spacing).max(0.0) as usize;
                cell.min(self.counts[axis] - 2)
            });
            (0..8).any(|k| {
                let node = [cell[0] + (k & 1), cell[1] + (k >> 1 & 1), cell[2] + (k >> 2)];
                length < self.depths[self.node(node)]
                    && AHEAD * self.spacing < (self.place(node) - from).dot(&way)
            })
        })
    }

    /// Returns the part of the surface of all points at the given depth, in mm, that is within `reach` mm of a mesh, and more beside it.
    pub(super) fn contour_near(&self, mesh: &Mesh, depth: f64, reach: f64) -> Contour {
        let mut contour = Contour::new(NEAREST);
        let is_near = self.find_near(mesh, reach + self.spacing);
        let [width, height, layers] = self.counts.map(|count| count - 1);
        for z in 0..layers {
            for y in 0..height {
                for x in (0..width).filter(|&x| is_near[self.node([x, y, z])]) {
                    self.add_cell(&mut contour, [x, y, z], depth);
                }
            }
        }
        contour
    }

    fn add_cell(&self, contour: &mut Contour, at @ [x, y, z]: [usize; 3], depth: f64) {
        let depths = std::array::from_fn(|k| {
            self.depths[self.node([x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)])] - depth
        });
        contour.add(at, depths, |at| self.place(at));
    }

    /// Returns for each node true if it is in the box around a face of a mesh, grown by `reach` mm.
    fn find_near(&self, mesh: &Mesh, reach: f64) -> Vec<bool> {
        let mut is_near = vec![false; self.depths.len()];
        for face in mesh.faces().iter() {
            let corners: Vec<_> = face.iter().map(|&it| mesh.positions()[it as usize]).collect();
            let bounds = Bounds::from_points(&corners);
            let [x, y, z] = [0, 1, 2].map(|axis| {
                let [from, to] = [bounds.low[axis] - reach, bounds.high[axis] + reach]
                    .map(|at| ((at - self.low[axis]) / self.spacing).max(0.0) as usize);
                from..(to + 1).min(self.counts[axis])
            });
            for (z, y) in z.flat_map(|z| y.clone().map(move |y| (z, y))) {
                is_near[self.node([x.start, y, z])..self.node([x.end, y, z])].fill(true);
            }
        }
        is_near
    }

    /// Reduces depths so that all points within `radius` mm of a mesh, less [`TIP`], are less deep than `depth`.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(super) fn fill_around(
        &mut self,
        (sheet, tree): (&Mesh, &TriangleTree),
        (radius, depth): (f64, f64),
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        // The ends of a grid edge that crosses the depth are at most a cell's diagonal apart.
        let reach = radius + 3f64.sqrt() * self.spacing;
        let is_near = self.find_near(sheet, reach);
        let near: Vec<usize> =
            (0..is_near.len()).filter(|&node| is_near[node] && 0.0 < self.depths[node]).collect();
        for chunk in near.chunks(CHUNK) {
            progress.check()?;
            let places: Vec<_> =
                chunk.iter().map(|&node| self.place(self.coordinates(node))).collect();
            for (&node, distance) in chunk.iter().zip(distances_to(tree, &places)) {
                let is_tip = distance <= radius && radius - TIP * self.spacing < distance;
                let above = if is_tip { NEAREST * self.spacing } else { distance - radius };
                self.depths[node] = self.depths[node].min(depth + above);
            }
        }
        Ok(())
    }

    fn node(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    fn coordinates(&self, node: usize) -> [usize; 3] {
        let [width, height, _] = self.counts;
        [node % width, node / width % height, node / width / height]
    }

    fn place(&self, at: [usize; 3]) -> Point3<f64> {
        self.low + Vector3::from(at.map(|k| k as f64)) * self.spacing
    }

    /// Returns the distance of each node from the surface of the solid, in mm. All are lower bounds, on the right side of `deepest`.
    ///
    /// The distance of a block's center is measured first. Blocks are divided only while their nodes may be on both sides of `deepest`.
    fn distances(
        &self,
        tree: &TriangleTree,
        deepest: f64,
        progress: &Progress<'_>,
    ) -> Result<Vec<f64>, CancelledError> {
        let [width, height, layers] = self.counts.map(|count| count.div_ceil(BLOCK));
        let blocks = (0..width * height * layers)
            .map(|k| [k % width, k / width % height, k / width / height].map(|k| BLOCK * k));
        let (mut blocks, mut size) = (blocks.collect::<Vec<_>>(), BLOCK);
        let mut distances = vec![0.0; self.counts.iter().product()];
        while !blocks.is_empty() {
            let half = (size - 1) as f64 / 2.0 * self.spacing;
            let radius = 3f64.sqrt() * half;
            let mut divided = Vec::new();
            for (number, chunk) in blocks.chunks(CHUNK).enumerate() {
                progress.tick(0.7 * (number * CHUNK) as f64 / blocks.len() as f64)?;
                let centers = chunk.iter().map(|block| self.place(*block) + Vector3::repeat(half));
                let of_centers = distances_to(tree, &centers.collect::<Vec<_>>());
                for (&block, distance) in chunk.iter().zip(of_centers) {
                    if size > 1 && (distance - deepest).abs() <= radius {
                        divided.extend(self.nodes(block, size, size / 2));
                    } else {
                        for node in self.nodes(block, size, 1) {
                            distances[self.node(node)] = (distance - radius).max(0.0);
                        }
                    }
                }
            }
            (blocks, size) = (divided, size / 2);
        }
        Ok(distances)
    }

    /// Returns every `step`-th node of a block along each axis.
    fn nodes(
        &self,
        first: [usize; 3],
        size: usize,
        step: usize,
    ) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [x, y, z] =
            [0, 1, 2].map(|axis| first[axis]..(first[axis] + size).min(self.counts[axis]));
        z.step_by(step).flat_map(move |z| {
            let x = x.clone();
            y.clone()
                .step_by(step)
                .flat_map(move |y| x.clone().step_by(step).map(move |x| [x, y, z]))
        })
    }

    /// Measures the distances of the nodes at both ends of each grid edge that crosses `deepest` inside of the solid.
    fn measure_ends(
        &self,
        tree: &TriangleTree,
        deepest: f64,
        (distances, is_inside): (&mut [f64], &mut [bool]),
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        let [width, height, layers] = self.counts;
        let steps: [[usize; 3]; 7] =
            std::array::from_fn(|k| [(k + 1) & 1, (k + 1) >> 1 & 1, (k + 1) >> 2]);
        let mut is_end = vec![false; distances.len()];
        for z in 0..layers {
            progress.check()?;
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let node = self.node([x, y, z]);
                for [i, j, k] in steps {
                    if x + i == width || y + j == height || z + k == layers {
                        continue;
                    }
                    let other = self.node([x + i, y + j, z + k]);
                    let is_deep = [node, other].map(|it| deepest < distances[it]);
                    if is_deep[0] != is_deep[1] && is_inside[if is_deep[0] { node } else { other }]
                    {
                        (is_end[node], is_end[other]) = (true, true);
                    }
                }
            }
        }
        let ends: Vec<usize> = (0..is_end.len()).filter(|&node| is_end[node]).collect();
        for (number, chunk) in ends.chunks(CHUNK).enumerate() {
            progress.tick(0.8 + 0.2 * (number * CHUNK) as f64 / ends.len() as f64)?;
            let places: Vec<_> =
                chunk.iter().map(|&node| self.place(self.coordinates(node))).collect();
            for (&node, distance) in chunk.iter().zip(distances_to(tree, &places)) {
                // Both ends are inside, as a grid edge is shorter than the depth.
                (distances[node], is_inside[node]) = (distance, true);
            }
        }
        Ok(())
    }

    /// Returns, for each node, true if it is inside of the solid and farther from the surface than the grid spacing.
    ///
    /// The surface cannot pass between two neighboring nodes that are both farther than the spacing, so connected nodes are on the same
    /// side.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    fn find_inside(
        &self,
        mesh: &Mesh,
        distances: &[f64],
        deepest: f64,
        progress: &Progress<'_>,
    ) -> Result<Vec<bool>, CancelledError> {
        let [width, height, depth] = self.counts;
        let mut is_seen = vec![false; distances.len()];
        let mut is_inside = vec![false; distances.len()];
        let mut part = Vec::new();
        for start in 0..distances.len() {
            if is_seen[start] || distances[start] <= self.spacing {
                continue;
            }
            is_seen[start] = true;
            part.push(start);
            let (mut next, mut deep) = (0, None);
            while let Some(&node) = part.get(next) {
                next += 1;
                if next.is_multiple_of(CHUNK) {
                    progress.check()?;
                }
                if deepest < distances[node] && deep.is_none() {
                    deep = Some(node);
                }
                let [x, y, z] = self.coordinates(node);
                let neighbors = [
                    (0 < x).then(|| node - 1),
                    (x + 1 < width).then(|| node + 1),
                    (0 < y).then(|| node - width),
                    (y + 1 < height).then(|| node + width),
                    (0 < z).then(|| node - width * height),
                    (z + 1 < depth).then(|| node + width * height),
                ];
                for neighbor in neighbors.into_iter().flatten() {
                    if !is_seen[neighbor] && self.spacing < distances[neighbor] {
                        is_seen[neighbor] = true;
                        part.push(neighbor);
                    }
                }
            }
            if let Some(node) = deep {
                progress.check()?;
                if winding(mesh, self.place(self.coordinates(node))) > 0.5 {
                    part.iter().for_each(|&node| is_inside[node] = true);
                }
            }
            part.clear();
        }
        Ok(is_inside)
    }
}

/// Returns the distance of each point from a mesh, in mm.
fn distances_to(tree: &TriangleTree, points: &[Point3<f64>]) -> impl Iterator<Item = f64> + use<> {
    let found = tree.nearest_to_all(points).into_iter();
    found.map(|place| place.map_or(f64::INFINITY, |place| place.distance_sq.sqrt()))
}

/// Returns the winding number of a mesh around a point: the sum of the solid angles of its faces, divided by 4 pi.
fn winding(mesh: &Mesh, at: Point3<f64>) -> f64 {
    let halves: Vec<f64> = (0..mesh.faces().len())
        .into_par_iter()
        .map(|face: usize| -> f64 {
            let face = mesh.faces().face(face);
            let fan = face[1..].windows(2).map(|pair| {
                [face[0], pair[0], pair[1]].map(|vertex: u32| mesh.positions()[vertex as usize])
            });
            fan.map(|corners| half_solid_angle(corners, &at)).sum()
        })
        .collect();
    halves.iter().sum::<f64>() / std::f64::consts::TAU
}
