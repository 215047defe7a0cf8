//! Evaluation of the Catmull-Clark limit surface over a quad without creases near it. The first corner may have any number of neighbors.
//! The method is the one described in `smooth_triangle.rs`.
//!
//! ```text
//! (0,3) (1,3) (2,3) (3,3)     The indices of a net. The quad is in the middle, with its first corner at (1,1). The ring has the points
//! (0,2) (1,2) (2,2) (3,2)     around this corner counter-clockwise from (2,1) on: alternately neighbors and opposite corners. If the
//! (0,1) (1,1) (2,1) (3,1)     corner is irregular, (0,0) is unused, and the ring has more or fewer than eight points.
//! (0,0) (1,0) (2,0) (3,0)
//! ```

use nalgebra::{Point3, Vector3};

use super::patches::{Jet, bicubic};
use super::smooth_triangle::{MAX_VALENCE, scale_jet};
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::vertex_rings::Masks;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;

/// The maximum number of refinement steps. After so many halvings, floating-point numbers cannot distinguish positions near a corner.
const MAX_DEPTH: usize = 40;

/// A quad with its neighborhood, and a cache of the refined neighborhoods.
pub(crate) struct SmoothQuad {
    /// The number of neighbors of the first corner.
    n: usize,
    /// The neighborhood, before each step, of the (refined) quad at the first corner.
    steps: Vec<QuadNeighborhood>,
}

/// The neighborhood of a quad.
struct QuadNeighborhood {
    /// The control points of the patch, `[i][j]` with `i` along `u`. After a refinement step there is one more row and column.
    net: [[Vector3<f64>; 5]; 5],
    ring: Ring,
}

/// The points around the first corner: each entry has a neighbor and the next opposite corner.
type Ring = [[Vector3<f64>; 2]; MAX_VALENCE];

impl SmoothQuad {
    /// Creates the quad of `half`, which starts at the first corner. The first corner has `n` neighbors, at least 3; the other corners have
    /// four.
    pub(crate) fn from_half_edge(
        mesh: &Connectivity,
        points: &[Point3<f64>],
        half: u32,
        n: usize,
    ) -> Self {
        let corners = mesh.corners();
        let at = |half: u32| points[corners[half as usize] as usize].coords;
        // Few positions need more than eight steps.
        let mut steps = Vec::with_capacity(if n == 4 { 1 } else { 8 });
        steps.push(QuadNeighborhood::NOTHING);
        let QuadNeighborhood { net, ring } = &mut steps[0];
        let mut spoke = half;
        for [neighbor, across] in &mut ring[..n] {
            let next = mesh.next(spoke);
            (*neighbor, *across) = (at(next), at(mesh.next(next)));
            spoke = mesh.next_around(spoke);
        }
        net[1][1] = at(half);
        // At each of the other three corners there is a quad diagonally opposite, and two quads that share edges with this quad.
        let [second, third, fourth] = [1, 2, 3].map(|k| half & !3 | (half + k) & 3);
        let end = |half: u32| at(mesh.next(half));
        let far = |half: u32| at(mesh.next(mesh.next(half)));
        let out = mesh.next_around(mesh.next_around(mesh.next_around(second)));
        (net[3][0], net[3][1]) = (far(mesh.next_around(mesh.next_around(second))), end(out));
        let out = mesh.next_around(mesh.next_around(third));
        (net[3][2], net[3][3]) = (end(out), far(out));
        net[2][3] = end(mesh.next_around(out));
        let out = mesh.next_around(mesh.next_around(fourth));
        (net[1][3], net[0][3]) = (end(out), far(out));
        // Copy the points that are in both the ring and the net.
        let [[e0, d0], [e1, d1], [e2, d2], ..] = *ring;
        let [last, across] = ring[n - 1];
        (net[2][1], net[2][2], net[1][2]) = (e0, d0, e1);
        (net[0][2], net[0][1], net[0][0]) = (d1, if n > 2 { e2 } else { e0 }, d2);
        (net[1][0], net[2][0]) = (last, across);
        Self { n, steps }
    }

    /// Evaluates the surface at `(u, v)`. The corners are `(0, 0)`, `(1, 0)`, `(1, 1)`, `(0, 1)`. Returns `None` if `(u, v)` is too close
    /// to an irregular corner.
    pub(crate) fn jet(&mut self, u: f64, v: f64) -> Option<Jet> {
        if self.n == 4 {
            return Some(self.steps[0].patch([0, 0], [u, v]));
        }
        let (mut u, mut v, mut scale) = (2.0 * u, 2.0 * v, 2.0);
        for step in 1..=MAX_DEPTH {
            let right = usize::from(u > 1.0);
            let up = usize::from(v > 1.0);
            if right + up > 0 {
                while self.steps.len() <= step {
                    self.refine();
                }
                let jet = self.steps[step].patch([right, up], [u - right as f64, v - up as f64]);
                return Some(scale_jet(jet, scale));
            }
            (u, v, scale) = (2.0 * u, 2.0 * v, 2.0 * scale);
        }
        None
    }

    fn refine(&mut self) {
        let last = self.steps.len() - 1;
        self.steps.push(QuadNeighborhood::NOTHING);
        let (before, new) = self.steps.split_at_mut(last + 1);
        before[last].refine(self.n, &mut new[0]);
    }
}

impl QuadNeighborhood {
    const NOTHING: Self = Self {
        net: [[Vector3::new(0.0, 0.0, 0.0); 5]; 5],
        ring: [[Vector3::new(0.0, 0.0, 0.0); 2]; MAX_VALENCE],
    };

    /// Evaluates the patch over the quad that is shifted from the first one by `right` quads along `u` and `up` quads along `v`.
    fn patch(&self, [right, up]: [usize; 2], [u, v]: [f64; 2]) -> Jet {
        bicubic(|[i, j]| self.net[i + right][j + up], u, v)
    }

    /// Returns the center of the quad whose lowest corner is at index `(i, j)` of the net.
    fn middle(&self, i: usize, j: usize) -> Vector3<f64> {
        let net = &self.net;
        (net[i][j] + net[i + 1][j] + net[i + 1][j + 1] + net[i][j + 1]) * 0.25
    }

    /// Refines the ring around the first corner of the patch: computes a new vertex for each edge at that corner, and one for each face
    /// between two of these edges.
    fn new_ring(&self, n: usize, new: &mut Ring) {
        let (own, ring) = (self.net[1][1], &self.ring);
        for j in 0..n {
            let next = if j + 1 == n { 0 } else { j + 1 };
            new[j][1] = (own + ring[j][0] + ring[j][1] + ring[next][0]) * 0.25;
        }
        for j in 0..n {
            let before = if j == 0 { n - 1 } else { j - 1 };
            new[j][0] = (own + ring[j][0] + new[before][1] + new[j][1]) * 0.25;
        }
    }

    /// Computes the neighborhood of the new quad at the first corner, which has `n` neighbors. The new vertex inside the quad is stored at
    /// `[2][2]`.
    fn refine(&self, n: usize, Self { net: fine, ring }: &mut Self) {
        self.new_ring(n, ring);
        let net = &self.net;
        let [weight, at_neighbor, at_face] = CatmullClarkMasks.vertex(n);
        fn sum(k: usize, of: &[[Vector3<f64>; 2]]) -> Vector3<f64> {
            of.iter().map(|pair| pair[k]).sum::<Vector3<f64>>()
        }
        fine[1][1] = net[1][1] * weight
            + sum(0, &self.ring[..n]) * at_neighbor
            + sum(1, &ring[..n]) * at_face;
        [fine[2][1], fine[2][2]] = ring[0];
        [fine[1][2], fine[0][2]] = ring[1];
        fine[0][1] = ring[2 % n][0];
        [fine[1][0], fine[2][0]] = ring[n - 1];
        // Now compute the new vertices inside the other faces at the three regular corners.
        (fine[4][0], fine[4][2]) = (self.middle(2, 0), self.middle(2, 1));
        fine[4][4] = self.middle(2, 2);
        (fine[2][4], fine[0][4]) = (self.middle(1, 2), self.middle(0, 2));
        fn on_edge(a: Vector3<f64>, b: Vector3<f64>, beside: [Vector3<f64>; 2]) -> Vector3<f64> {
            (a + b + beside[0] + beside[1]) * 0.25
        }
        fine[3][0] = on_edge(net[2][1], net[2][0], [fine[2][0], fine[4][0]]);
        fine[3][2] = on_edge(net[2][1], net[2][2], [fine[2][2], fine[4][2]]);
        fine[3][4] = on_edge(net[2][2], net[2][3], [fine[2][4], fine[4][4]]);
        fine[4][1] = on_edge(net[2][1], net[3][1], [fine[4][0], fine[4][2]]);
        fine[4][3] = on_edge(net[2][2], net[3][2], [fine[4][2], fine[4][4]]);
        fine[0][3] = on_edge(net[1][2], net[0][2], [fine[0][2], fine[0][4]]);
        fine[2][3] = on_edge(net[1][2], net[2][2], [fine[2][2], fine[2][4]]);
        fine[1][4] = on_edge(net[1][2], net[1][3], [fine[0][4], fine[2][4]]);
        for [i, j] in [[2, 1], [2, 2], [1, 2]] {
            let neighbors = (net[i - 1][j] + net[i + 1][j]) + (net[i][j - 1] + net[i][j + 1]);
            let (a, b) = (2 * i, 2 * j);
            let faces = (fine[a - 2][b - 2] + fine[a][b - 2]) + (fine[a][b] + fine[a - 2][b]);
            fine[a - 1][b - 1] = net[i][j] * 0.5 + (neighbors + faces) * 0.0625;
        }
    }
}
