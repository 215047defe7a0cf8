//! The limit masks of the Doo-Sabin scheme; notation as in `refine/doo_sabin.rs`.

use maquette_base::linear::stencils::{Rows, Stencils, push_merged};
use maquette_value::Column;

use crate::Boundary;
use crate::masks::roots_of_unity::root_of_unity;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, Ring};

/// Computes the limit points and tangents at the vertices of a mesh by the Doo-Sabin scheme.
#[derive(Debug)]
pub(crate) struct DualLimit {
    pub(crate) mesh: Connectivity,
    pub(crate) starts: Vec<u32>,
    boundary: Boundary,
}

/// Scratch space for one vertex.
#[derive(Default)]
pub(crate) struct Scratch {
    ring: Ring,
    row: Vec<(u32, f64)>,
}

impl DualLimit {
    pub(crate) fn new(mesh: Connectivity, starts: Vec<u32>, boundary: Boundary) -> Self {
        Self { mesh, starts, boundary }
    }

    /// Returns the indices of all vertices.
    pub(crate) fn vertices(&self) -> Vec<u32> {
        (0..self.starts.len() as u32).collect()
    }

    /// Returns the limit points assigned to some vertices. The limit point of an inner vertex is the centroid of the face that one step
    /// makes around the vertex. On the border it is a point of a quadratic B-spline; if the border shrinks, it is the middle of the edge or
    /// face next to the vertex.
    pub(crate) fn positions(&self, vertices: &[u32]) -> Stencils {
        let (stencils, _) = Stencils::build(vertices.len(), |scratch: &mut Scratch, item, rows| {
            let vertex = vertices[item] as usize;
            let Scratch { ring, row } = scratch;
            self.mesh.ring(self.starts[vertex], ring);
            row.clear();
            let last = ring.neighbors.len().wrapping_sub(1);
            if ring.halves.is_empty() {
                row.push((vertex as u32, 1.0));
            } else if ring.closed {
                let share = 1.0 / ring.halves.len() as f64;
                ring.halves.iter().for_each(|&half| self.push_inner(half, share, row));
            } else if let Some(corners) = self.lone_face(ring) {
                // The new vertices in a face have the same centroid as the corners of the face.
                let share = 1.0 / corners.len() as f64;
                row.extend(corners.iter().map(|&corner| (corner, share)));
            } else if self.boundary == Boundary::None {
                let middle = self.middle(ring);
                let share = 1.0 / middle.len() as f64;
                middle.into_iter().for_each(|half| self.push_inner(half, share, row));
            } else {
                row.push((vertex as u32, 0.75));
                row.extend([0, last].map(|index| (ring.neighbors[index], 0.125)));
            }
            push_merged(rows, row);
            rows.end();
        });
        stencils
    }

    /// Returns two tangents for each of the given vertices, but none for a vertex without faces. Also returns the index of each vertex's
    /// first tangent.
    pub(crate) fn tangents(&self, vertices: &[u32]) -> (Stencils, Column<u32>) {
        Stencils::build(vertices.len(), |scratch: &mut Scratch, item, rows| {
            let vertex = vertices[item] as usize;
            let Scratch { ring, row } = scratch;
            self.mesh.ring(self.starts[vertex], ring);
            if ring.halves.is_empty() {
                return;
            }
            if let Some(corners) = self.lone_face(ring) {
                // The tangents are the first Fourier mode of the face's corners. A refinement step halves this mode, because the
                // convolution of this mode with `alpha` is half of the mode.
                for part in 0..2 {
                    let n = corners.len();
                    (0..n).zip(corners).for_each(|(j, &corner)| {
                        rows.push(corner, root_of_unity(j, n)[part] / 2.0);
                    });
                    rows.end();
                }
                return;
            }
            if ring.closed || self.boundary == Boundary::None {
                let middle = if ring.closed { ring.halves.clone() } else { self.middle(ring) };
                return self.push_polygon(&middle, row, rows);
            }
            let last = ring.neighbors[ring.neighbors.len() - 1];
            rows.push(ring.neighbors[0], 1.0);
            rows.push(last, -1.0);
            rows.end();
            self.push_across(vertex as u32, ring, row);
            push_merged(rows, row);
            rows.end();
        })
    }

    /// Writes the tangents at the middle of the face whose corners are the new vertices at `halves`.
    fn push_polygon(&self, halves: &[u32], row: &mut Vec<(u32, f64)>, rows: &mut Rows) {
        for part in 0..2 {
            row.clear();
            for (j, &half) in halves.iter().enumerate() {
                let weight = match halves.len() {
                    // If the vertex has two edges, one tangent connects the two new vertices, and the other tangent runs across this
                    // connection.
                    2 if part == 1 => 0.0,
                    n => root_of_unity(j, n)[part],
                };
                self.push_inner(half, weight, row);
            }
            push_merged(rows, row);
            rows.end();
        }
    }

    /// Writes the tangent across the border. After one step the face around the vertex has an edge on the border, and the middle of this
    /// edge is the limit point. The tangent points from the limit point to the middle of the new vertices next to this edge.
    fn push_across(&self, vertex: u32, ring: &Ring, row: &mut Vec<(u32, f64)>) {
        row.clear();
        let m = ring.halves.len() + 2;
        let ends = [ring.neighbors[0], ring.neighbors[ring.neighbors.len() - 1]];
        for k in 0..m {
            // Corner 0 is on the first edge of the ring, corner m - 1 on the last one.
            let weight = (alpha(k, m) + alpha((k + 1) % m, m)) / 2.0;
            if k == 0 || k == m - 1 {
                row.push((vertex, 0.75 * (weight - 0.5)));
                row.push((ends[usize::from(k > 0)], 0.25 * (weight - 0.5)));
            } else {
                self.push_inner(ring.halves[k - 1], weight, row);
            }
        }
    }

    /// Used if the border shrinks: returns the corners of the face of a border vertex that has only one face. The limit point of the vertex
    /// is the middle of this face.
    fn lone_face(&self, ring: &Ring) -> Option<&[u32]> {
        let is_lone = !ring.closed && self.boundary == Boundary::None && ring.halves.len() == 1;
        is_lone.then(|| self.mesh.faces.face(self.mesh.face_of(ring.halves[0]) as usize))
    }

    /// Used if the border shrinks: returns the new vertices around the middle edge of a border vertex with several faces. Their mean is
    /// the limit point of the vertex.
    fn middle(&self, ring: &Ring) -> Vec<u32> {
        let [owner, twin] = self.mesh.halves[ring.edges[ring.halves.len() / 2] as usize];
        vec![owner, self.mesh.next(twin), twin, self.mesh.next(owner)]
    }

    /// Adds to `row` the weights of the new vertex at a corner, multiplied by `share`.
    fn push_inner(&self, half: u32, share: f64, row: &mut Vec<(u32, f64)>) {
        let face = self.mesh.face_of(half) as usize;
        let (corners, k) =
            (self.mesh.faces.face(face), half as usize - self.mesh.faces.first_corner(face));
        let m = corners.len();
        let weights = (0..m).map(|j| share * alpha((m + j - k) % m, m));
        row.extend(corners.iter().copied().zip(weights));
    }
}

/// Returns the weight of the `j`-th next corner in the new vertex at a corner of a face with `m` corners.
pub(crate) fn alpha(j: usize, m: usize) -> f64 {
    let [cosine, _] = root_of_unity(j, m);
    let own = if j == 0 { 0.25 } else { 0.0 };
    own + (3.0 + 2.0 * cosine) / (4.0 * m as f64)
}
