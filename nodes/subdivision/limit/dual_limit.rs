//! Where the vertices of a mesh go by the scheme of Doo and Sabin, as rows; notation as in `refine/doo_sabin.rs`.

use maquette_base::linear::stencils::{Rows, Stencils, push_merged};
use maquette_value::Column;

use crate::Boundary;
use crate::masks::turns::turn;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, Ring};

/// The limit of each vertex of a mesh.
#[derive(Debug)]
pub(crate) struct DualLimit {
    pub(crate) mesh: Connectivity,
    pub(crate) starts: Vec<u32>,
    boundary: Boundary,
}

/// Space for one vertex.
#[derive(Default)]
pub(crate) struct Scratch {
    ring: Ring,
    row: Vec<(u32, f64)>,
}

impl DualLimit {
    pub(crate) fn new(mesh: Connectivity, starts: Vec<u32>, boundary: Boundary) -> Self {
        Self { mesh, starts, boundary }
    }

    /// All vertices.
    pub(crate) fn all(&self) -> Vec<u32> {
        (0..self.starts.len() as u32).collect()
    }

    /// The limit point that goes with each of some vertices: the centroid of the face around it after one step; on the border the place
    /// of a quadratic B-spline; where the border shrinks, the middle of the edge or the face that lies next to the vertex.
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
                // Its new vertices have the same middle as its corners.
                let share = 1.0 / corners.len() as f64;
                row.extend(corners.iter().map(|&corner| (corner, share)));
            } else if self.boundary == Boundary::None {
                let middle = self.middle(ring);
                let share = 1.0 / middle.len() as f64;
                middle.into_iter().for_each(|half| self.push_inner(half, share, row));
            } else {
                row.push((vertex as u32, 0.75));
                row.extend([0, last].map(|place| (ring.neighbors[place], 0.125)));
            }
            push_merged(rows, row);
            rows.end();
        });
        stencils
    }

    /// Two tangents for each of some vertices, if it has a face.
    pub(crate) fn tangents(&self, vertices: &[u32]) -> (Stencils, Column<u32>) {
        Stencils::build(vertices.len(), |scratch: &mut Scratch, item, rows| {
            let vertex = vertices[item] as usize;
            let Scratch { ring, row } = scratch;
            self.mesh.ring(self.starts[vertex], ring);
            if ring.halves.is_empty() {
                return;
            }
            if let Some(corners) = self.lone_face(ring) {
                // Waves once around a face are halved by a step: their sum with `alpha` is half of them.
                for part in 0..2 {
                    let n = corners.len();
                    (0..n)
                        .zip(corners)
                        .for_each(|(j, &corner)| rows.push(corner, turn(j, n)[part] / 2.0));
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

    /// The tangents at the middle of the face with these new vertices.
    fn push_polygon(&self, halves: &[u32], row: &mut Vec<(u32, f64)>, rows: &mut Rows) {
        for part in 0..2 {
            row.clear();
            for (j, &half) in halves.iter().enumerate() {
                let weight = match halves.len() {
                    // Two edges at the vertex: one tangent joins the new vertices, the other one points across.
                    2 if part == 1 => 0.0,
                    n => turn(j, n)[part],
                };
                self.push_inner(half, weight, row);
            }
            push_merged(rows, row);
            rows.end();
        }
    }

    /// The tangent across the border: the face around the vertex after one step has an edge on the border, whose middle is
    /// the limit; it points to the middle of the new vertices next to this edge.
    fn push_across(&self, vertex: u32, ring: &Ring, row: &mut Vec<(u32, f64)>) {
        row.clear();
        let m = ring.halves.len() + 2;
        let ends = [ring.neighbors[0], ring.neighbors[ring.neighbors.len() - 1]];
        for k in 0..m {
            // Corner 0 is on the first edge, corner m - 1 on the last one.
            let weight = (alpha(k, m) + alpha((k + 1) % m, m)) / 2.0;
            if k == 0 || k == m - 1 {
                row.push((vertex, 0.75 * (weight - 0.5)));
                row.push((ends[usize::from(k > 0)], 0.25 * (weight - 0.5)));
            } else {
                self.push_inner(ring.halves[k - 1], weight, row);
            }
        }
    }

    /// Where the border shrinks, the corners of the only face at a vertex of it: the limit point that goes with the vertex is the face's
    /// middle.
    fn lone_face(&self, ring: &Ring) -> Option<&[u32]> {
        let is_lone = !ring.closed && self.boundary == Boundary::None && ring.halves.len() == 1;
        is_lone.then(|| self.mesh.faces.face(self.mesh.face_of(ring.halves[0]) as usize))
    }

    /// Where the border shrinks, the new vertices across the middle edge at a vertex of it, which has several faces: next to the limit
    /// point that goes with the vertex.
    fn middle(&self, ring: &Ring) -> Vec<u32> {
        let [owner, twin] = self.mesh.halves[ring.edges[ring.halves.len() / 2] as usize];
        vec![owner, self.mesh.next(twin), twin, self.mesh.next(owner)]
    }

    /// Adds a share of the new vertex at a corner.
    fn push_inner(&self, half: u32, share: f64, row: &mut Vec<(u32, f64)>) {
        let face = self.mesh.face_of(half) as usize;
        let (corners, k) =
            (self.mesh.faces.face(face), half as usize - self.mesh.faces.first_corner(face));
        let m = corners.len();
        let weights = (0..m).map(|j| share * alpha((m + j - k) % m, m));
        row.extend(corners.iter().copied().zip(weights));
    }
}

/// The weight of the corner `j` places after a vertex of a face of `m` corners.
pub(crate) fn alpha(j: usize, m: usize) -> f64 {
    let [cosine, _] = turn(j, m);
    let own = if j == 0 { 0.25 } else { 0.0 };
    own + (3.0 + 2.0 * cosine) / (4.0 * m as f64)
}
