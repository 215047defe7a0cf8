//! The part of a control mesh around a move, fitted for itself.

use maquette_value::{Faces, Mesh, TriangleTree};
use nalgebra::{DMatrix, Point3};

use super::feet::Nearest;
use super::folds::folds;
use super::net::{Change, Net, set, with_sharp};
use super::scan::Scan;
use super::surroundings::Surroundings;
use crate::limit::composed::{Composed, laplacian};
use crate::refine::manifold::manifold;

/// Steps of subdivision after which the surface is measured where a move is judged, before and after it alike.
const LEVELS: u32 = 1;

/// The part of a control mesh that a move changes, and what lies around.
pub(super) struct Local {
    mesh: Mesh,
    /// The vertices in the net.
    vertices: Vec<u32>,
    surface: Composed,
    /// Number of faces that are measured: the first ones.
    measured: usize,
    /// The vertices that may move.
    free: Vec<usize>,
}

/// What such a part is worth.
pub(super) struct Measure {
    /// The sum of the squared distances between surface and scan, both ways.
    pub(super) cost: f64,
    pub(super) folds: usize,
    /// What is nearest to each point.
    pub(super) nearest: Vec<Nearest>,
}

impl Local {
    /// The part of a net after a change; none if it is no surface.
    pub(super) fn new(net: &Net, change: &Change, around: &Surroundings) -> Option<Self> {
        fn stay(faces: &[u32], change_removed: &[u32], net_faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
            let stay = faces.iter().filter(|face| !change_removed.contains(face));
            stay.map(|&face| net_faces[face as usize]).collect()
        }
        let measured =
            [&stay(&around.measured, &change.removed, &net.faces)[..], &change.added].concat();
        let faces =
            measured.iter().copied().chain(stay(&around.margin, &change.removed, &net.faces));
        let (mesh, vertices) = net
            .part(faces, |vertex: u32| match change.place {
                Some((moved, place)) if moved == vertex => place,
                _ => net.places[vertex as usize],
            })
            .ok()?;
        let mesh = with_sharp(&mesh, &vertices, |ends| net.sharpness(ends, change)).ok()?;
        // A part may meet itself in a vertex of its margin.
        let mesh = manifold(&mesh).ok()?;
        let moved = change.place.map(|(vertex, _)| vertex);
        let free = set(around.free.iter().copied().chain(moved).collect());
        let free = free.iter().filter_map(|free| vertices.binary_search(free).ok()).collect();
        let surface = Composed::new(&mesh, LEVELS).ok()?;
        Some(Self { mesh, vertices, surface, measured: measured.len(), free })
    }

    /// What it is worth as it is.
    pub(super) fn measure(&self, points: &[Point3<f64>], scan: &Scan<'_>) -> Option<Measure> {
        let fine = self.fine()?;
        let nearest = TriangleTree::new(&fine).nearest_to_all(points).into_iter();
        let nearest = nearest.map(|place| Some(Nearest::new(&place?, LEVELS)));
        let nearest: Vec<Nearest> = nearest.collect::<Option<_>>()?;
        let cost = nearest.iter().map(|nearest| nearest.distance_sq).sum::<f64>();
        Some(Measure { cost: cost + scan.cost(&fine), folds: folds(&fine, LEVELS).len(), nearest })
    }

    /// Moves the free vertices where they bring points and scan nearest; returns what it is worth then.
    pub(super) fn fit(
        &mut self,
        points: &[Point3<f64>],
        scan: &Scan<'_>,
        weight: f64,
    ) -> Option<Measure> {
        self.mesh = self.mesh.with_positions(self.solved(points, scan, weight)?).ok()?;
        self.measure(points, scan)
    }

    /// The free vertices' numbers in the net, and their places.
    pub(super) fn places(&self) -> Vec<(u32, Point3<f64>)> {
        self.free.iter().map(|&k| (self.vertices[k], self.mesh.positions()[k])).collect()
    }

    /// The refined surface of the faces that are measured.
    fn fine(&self) -> Option<Mesh> {
        let fine = self.surface.surface(self.mesh.positions()).ok()?;
        let count = self.measured << (2 * LEVELS);
        let faces = fine.faces().as_triangles()?[..count].to_vec();
        Mesh::new(fine.positions().clone(), Faces::triangles(faces)).ok()
    }

    /// All places, the free ones by least squares.
    fn solved(
        &self,
        points: &[Point3<f64>],
        scan: &Scan<'_>,
        weight: f64,
    ) -> Option<Vec<Point3<f64>>> {
        let fine = self.fine()?;
        let mut equations = Equations::new(self);
        let mut entries = Vec::new();
        for (point, place) in points.iter().zip(TriangleTree::new(&fine).nearest_to_all(points)) {
            let place = place?;
            entries.clear();
            for (corner, share) in place.corners.into_iter().zip(place.shares) {
                let row = self.surface.rows.row(fine.faces().corners()[corner as usize] as usize);
                entries.extend(row.0.iter().zip(row.1).map(|(&index, part)| (index, part * share)));
            }
            equations.add(&entries, *point, 1.0);
        }
        let mut add = |(indices, weights): (&[u32], &[f64]), point, weight| {
            entries.clear();
            entries.extend(indices.iter().copied().zip(weights.iter().copied()));
            equations.add(&entries, point, weight);
        };
        for foot in scan.feet(&fine) {
            add(self.surface.rows.row(foot.vertex as usize), foot.place, foot.weight);
        }
        for (_, indices, weights) in laplacian(&self.mesh).rows_from(0) {
            add((indices, weights), Point3::origin(), weight);
        }
        equations.solved()
    }
}

/// Equations whose unknowns are the free vertices of a part.
struct Equations<'a> {
    local: &'a Local,
    /// The place of each vertex among the free ones.
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

    /// One more: the sum of weighted vertices is `point`.
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

    /// All vertices, the free ones where the equations are met as nearly as possible. What nothing determines stays where it is.
    fn solved(mut self) -> Option<Vec<Point3<f64>>> {
        let mut places = self.local.mesh.positions().to_vec();
        let least = 1e-9 * (1.0 + self.matrix.trace());
        for (k, &vertex) in self.local.free.iter().enumerate() {
            self.matrix[(k, k)] += least;
            (0..3).for_each(|axis| self.right[(k, axis)] += least * places[vertex][axis]);
        }
        let found = self.matrix.cholesky()?.solve(&self.right);
        for (k, &vertex) in self.local.free.iter().enumerate() {
            places[vertex] = Point3::new(found[(k, 0)], found[(k, 1)], found[(k, 2)]);
        }
        Some(places)
    }
}
