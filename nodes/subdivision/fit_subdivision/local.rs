//! Local fitting of the part of a control mesh around a move (an edge operation).

use maquette_value::{Faces, Mesh, TriangleTree};
use nalgebra::{DMatrix, Point3};

use super::feet::Nearest;
use super::folds::folds;
use super::net::{Change, Net, sort_and_dedup, with_sharp};
use super::scan::Scan;
use super::surroundings::Surroundings;
use crate::limit::composed::{ComposedLimit, laplacian};
use crate::refine::manifold::manifold;

/// The number of refinement steps that make the surface whose distances are measured before and after a move.
const LEVELS: u32 = 1;

/// The part of a control mesh that a move (an edge operation) changes, together with its neighborhood.
pub(super) struct Local {
    mesh: Mesh,
    /// For each vertex of this part of the control net, the vertex's index in the whole net.
    vertices: Vec<u32>,
    surface: ComposedLimit,
    /// The number of faces over which distances are measured. They are the first faces of `mesh`.
    measured: usize,
    /// The indices of the vertices that the fit may move. All other vertices stay.
    free: Vec<usize>,
}

/// The measured distances between a part of a control mesh's surface and the scan.
pub(super) struct Measure {
    /// The sum of the squared distances in both directions: from the surface to the scan, and from the scan to the surface.
    pub(super) cost: f64,
    pub(super) folds: usize,
    /// For each point of the scan the nearest point of the surface.
    pub(super) nearest: Vec<Nearest>,
}

impl Local {
    /// Extracts the part of a net around a change by an edge operation, as the part is after the change. Returns `None` if the part is not
    /// manifold.
    pub(super) fn new(net: &Net, change: &Change, around: &Surroundings) -> Option<Self> {
        let [measured, margin] = [&around.measured, &around.margin].map(|faces| {
            let kept = faces.iter().filter(|face| !change.removed.contains(face));
            kept.map(|&face| net.faces[face as usize]).collect::<Vec<_>>()
        });
        let measured = [&measured[..], &change.added].concat();
        let faces = measured.iter().copied().chain(margin);
        let (mesh, vertices) = net
            .part(faces, |vertex: u32| match change.position {
                Some((moved, position)) if moved == vertex => position,
                _ => net.positions[vertex as usize],
            })
            .ok()?;
        let mesh = with_sharp(&mesh, &vertices, |ends| net.sharpness(ends, change)).ok()?;
        // The extracted part may touch itself at a vertex on its margin. Duplicate such a vertex.
        let mesh = manifold(&mesh).ok()?;
        let moved = change.position.map(|(vertex, _)| vertex);
        let free = sort_and_dedup(around.free.iter().copied().chain(moved).collect());
        let free = free.iter().filter_map(|free| vertices.binary_search(free).ok()).collect();
        let surface = ComposedLimit::new(&mesh, LEVELS).ok()?;
        Some(Self { mesh, vertices, surface, measured: measured.len(), free })
    }

    /// Measures the distances between the part's surface and `points`, and between the part's surface and the scan. Returns `None` if the
    /// part has no nearest point to one of the points.
    pub(super) fn measure(&self, points: &[Point3<f64>], scan: &Scan<'_>) -> Option<Measure> {
        let fine = self.fine()?;
        let nearest = TriangleTree::new(&fine).nearest_to_all(points).into_iter();
        let nearest = nearest.map(|position| Some(Nearest::new(&position?, LEVELS)));
        let nearest: Vec<Nearest> = nearest.collect::<Option<_>>()?;
        let cost = nearest.iter().map(|nearest| nearest.distance_sq).sum::<f64>();
        Some(Measure { cost: cost + scan.cost(&fine), folds: folds(&fine, LEVELS).len(), nearest })
    }

    /// Moves the free vertices to minimize the distances between surface and scan. Returns the distances afterwards.
    pub(super) fn fit(
        &mut self,
        points: &[Point3<f64>],
        scan: &Scan<'_>,
        weight: f64,
    ) -> Option<Measure> {
        self.mesh = self.mesh.with_positions(self.solve_positions(points, scan, weight)?).ok()?;
        self.measure(points, scan)
    }

    /// Returns the free vertices, as indices in the net, with their positions.
    pub(super) fn positions(&self) -> Vec<(u32, Point3<f64>)> {
        self.free.iter().map(|&k| (self.vertices[k], self.mesh.positions()[k])).collect()
    }

    /// The refined surface of the measured faces.
    fn fine(&self) -> Option<Mesh> {
        let fine = self.surface.surface(self.mesh.positions()).ok()?;
        let count = self.measured << (2 * LEVELS);
        let faces = fine.faces().as_triangles()?[..count].to_vec();
        Mesh::new(fine.positions().clone(), Faces::triangles(faces)).ok()
    }

    /// Returns the positions of all vertices of the part: those of free vertices by least squares, the others unchanged. Returns `None` if
    /// the system cannot be set up or solved.
    fn solve_positions(
        &self,
        points: &[Point3<f64>],
        scan: &Scan<'_>,
        weight: f64,
    ) -> Option<Vec<Point3<f64>>> {
        let fine = self.fine()?;
        let mut equations = Equations::new(self);
        let mut entries = Vec::new();
        for (point, position) in points.iter().zip(TriangleTree::new(&fine).nearest_to_all(points))
        {
            let position = position?;
            entries.clear();
            for (corner, share) in position.corners.into_iter().zip(position.barycentric) {
                let row = self.surface.rows.row(fine.faces().corners()[corner as usize] as usize);
                entries.extend(row.0.iter().zip(row.1).map(|(&index, part)| (index, part * share)));
            }
            equations.add(&entries, *point, 1.0);
        }
        for foot in scan.feet(&fine) {
            let (indices, weights) = self.surface.rows.row(foot.vertex as usize);
            entries.clear();
            entries.extend(indices.iter().copied().zip(weights.iter().copied()));
            equations.add(&entries, foot.position, foot.weight);
        }
        for (_, indices, weights) in laplacian(&self.mesh).rows_from(0) {
            entries.clear();
            entries.extend(indices.iter().copied().zip(weights.iter().copied()));
            equations.add(&entries, Point3::origin(), weight);
        }
        equations.solve_equations()
    }
}

/// The least-squares equations of the free vertices of a part.
struct Equations<'a> {
    local: &'a Local,
    /// For each vertex of the part of the control net, its index among the free vertices; `None` if the vertex is not free.
    unknown: Vec<Option<usize>>,
    matrix: DMatrix<f64>,
    right: DMatrix<f64>,
}

impl<'a> Equations<'a> {
    fn new(local: &'a Local) -> Self {
        let count = local.free.len();
        let mut unknown = vec![None; local.mesh.positions().len()];
        local.free.iter().enumerate().for_each(|(k, &vertex)| unknown[vertex] = Some(k));
        let (matrix, right) = (DMatrix::zeros(count, count), DMatrix::zeros(count, 3));
        Self { local, unknown, matrix, right }
    }

    /// Adds the equation that the weighted sum `entries` of vertices equals `point`.
    fn add(&mut self, entries: &[(u32, f64)], point: Point3<f64>, weight: f64) {
        let mut shares = vec![0.0; self.local.free.len()];
        let mut rest = point.coords;
        for &(vertex, share) in entries {
            match self.unknown[vertex as usize] {
                Some(k) => shares[k] += share,
                None => rest -= self.local.mesh.positions()[vertex as usize].coords * share,
            }
        }
        for (a, &share) in shares.iter().enumerate().filter(|(_, share)| **share != 0.0) {
            for (b, &other) in shares.iter().enumerate() {
                self.matrix[(a, b)] += weight * share * other;
            }
            (0..3).for_each(|axis| self.right[(a, axis)] += weight * share * rest[axis]);
        }
    }

    /// Solves for the free vertices and returns the positions of all vertices; `None` if the equations cannot be solved. Vertices that the
    /// equations do not determine do not move.
    fn solve_equations(mut self) -> Option<Vec<Point3<f64>>> {
        let mut positions = self.local.mesh.positions().to_vec();
        let least = 1e-9 * (1.0 + self.matrix.trace());
        for (k, &vertex) in self.local.free.iter().enumerate() {
            self.matrix[(k, k)] += least;
            (0..3).for_each(|axis| self.right[(k, axis)] += least * positions[vertex][axis]);
        }
        let found = self.matrix.cholesky()?.solve(&self.right);
        for (k, &vertex) in self.local.free.iter().enumerate() {
            positions[vertex] = Point3::new(found[(k, 0)], found[(k, 1)], found[(k, 2)]);
        }
        Some(positions)
    }
}
