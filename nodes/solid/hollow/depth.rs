//! Depths of the nodes of a grid inside a solid.

use maquette_base::solid_angle::half_solid_angle;
use maquette_node::{CancelledError, Limit, LimitError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Mesh, TriangleTree};
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

/// Number of points whose distances are measured between two checks for cancellation. Measuring this many points takes some milliseconds.
const CHUNK: usize = 4096;

/// A grid around a solid, with the depth of each node below the solid's surface.
pub(super) struct Depth {
    low: Point3<f64>,
    spacing: f64,
    /// The number of nodes along x, y and z.
    counts: [usize; 3],
    /// The depth of each node in mm; negative outside, and next to the surface. Depths greater than the requested maximum are only lower
    /// bounds.
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

impl Depth {
    /// Measures depths up to `deepest`, which is at least twice the spacing, for a mesh whose minimum coordinates are `low`.
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
        let distances = grid.distances(tree, deepest + spacing, progress)?;
        progress.tick(0.8)?;
        let is_inside = grid.find_inside(mesh, &distances, deepest, progress)?;
        grid.depths = distances
            .iter()
            .zip(&is_inside)
            .map(|(distance, is_inside): (&f64, &bool)| match is_inside {
                true => *distance,
                false => distance.min(spacing) - 2.0 * spacing,
            })
            .collect();
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
        let mut contour = Contour::new(0.02);
        let [width, height, layers] = self.counts.map(|count| count - 1);
        for z in 0..layers {
            progress.check()?;
            for y in 0..height {
                for x in 0..width {
                    let depths = std::array::from_fn(|k| {
                        self.depths[self.node([x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)])]
                            - depth
                    });
                    contour.add([x, y, z], depths, |at| self.place(at));
                }
            }
        }
        Ok(contour)
    }

    fn node(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    fn place(&self, at: [usize; 3]) -> Point3<f64> {
        self.low + Vector3::from(at.map(|k| k as f64)) * self.spacing
    }

    /// Returns the distance of each node from the surface of the solid, in mm. Distances greater than `farthest` are only lower bounds.
    fn distances(
        &self,
        tree: &TriangleTree,
        farthest: f64,
        progress: &Progress<'_>,
    ) -> Result<Vec<f64>, CancelledError> {
        let blocks = self.counts.map(|count| count.div_ceil(BLOCK));
        /// Returns the coordinates of the block with the index `k`.
        fn block(k: usize, blocks: [usize; 3]) -> [usize; 3] {
            [k % blocks[0], k / blocks[0] % blocks[1], k / blocks[0] / blocks[1]]
        }
        let half = (BLOCK - 1) as f64 / 2.0 * self.spacing;
        let count = blocks.iter().product();
        /// Returns the distance of each point from the surface of the solid, in mm.
        fn distances_to(
            tree: &TriangleTree,
            points: &[Point3<f64>],
        ) -> impl Iterator<Item = f64> + use<> {
            let found = tree.nearest_to_all(points).into_iter();
            found.map(|place| place.map_or(f64::INFINITY, |place| place.distance_sq.sqrt()))
        }
        let mut of_blocks = Vec::with_capacity(count);
        for first in (0..count).step_by(CHUNK) {
            progress.tick(0.2 * first as f64 / count as f64)?;
            let chunk = first..count.min(first + CHUNK);
            of_blocks.extend(distances_to(
                tree,
                &chunk
                    .map(|k: usize| {
                        self.place(block(k, blocks).map(|k| BLOCK * k)) + Vector3::repeat(half)
                    })
                    .collect::<Vec<_>>(),
            ));
        }
        let mut distances = vec![0.0; self.counts.iter().product()];
        let (mut nodes, mut places) = (Vec::new(), Vec::new());
        for (number, &distance) in of_blocks.iter().enumerate() {
            let least = distance - 3f64.sqrt() * half;
            let first = block(number, blocks).map(|k| BLOCK * k);
            let last = [0, 1, 2].map(|axis| (first[axis] + BLOCK).min(self.counts[axis]));
            for z in first[2]..last[2] {
                for y in first[1]..last[1] {
                    for x in first[0]..last[0] {
                        let node = self.node([x, y, z]);
                        if farthest < least {
                            distances[node] = least;
                        } else {
                            nodes.push(node);
                            places.push(self.place([x, y, z]));
                        }
                    }
                }
            }
            if CHUNK <= nodes.len() || number + 1 == count {
                nodes
                    .drain(..)
                    .zip(distances_to(tree, &places))
                    .for_each(|(node, it)| distances[node] = it);
                places.clear();
                progress.tick(0.2 + 0.6 * (number + 1) as f64 / count as f64)?;
            }
        }
        Ok(distances)
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
                let [x, y, z] = [node % width, node / width % height, node / width / height];
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
                let at = [node % width, node / width % height, node / width / height];
                if winding(mesh, self.place(at)) > 0.5 {
                    part.iter().for_each(|&node| is_inside[node] = true);
                }
            }
            part.clear();
        }
        Ok(is_inside)
    }
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
