//! A quad without creases around it, whose first corner may have any number of neighbors: the limit of Catmull's and Clark's scheme
//! anywhere on it. As `smooth_triangle.rs`, with quads.
//!
//! ```text
//! (0,3) (1,3) (2,3) (3,3)     The places of a net. The quad is in the middle, its first corner at (1,1); what lies around that, counter-
//! (0,2) (1,2) (2,2) (3,2)     clockwise from (2,1) on, is the ring: neighbors and the corners across in turn. If the corner is
//! (0,1) (1,1) (2,1) (3,1)     irregular, (0,0) has no meaning, and the ring has more or fewer than the eight places around it.
//! (0,0) (1,0) (2,0) (3,0)
//! ```

use nalgebra::{Point3, Vector3};

use super::patches::{Jet, bicubic};
use super::smooth_triangle::{MOST, scaled};
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::stars::Masks;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;

/// Steps that bring a place as near to a corner as its coordinates can tell.
const DEEPEST: usize = 40;

/// A quad, what lies around it, and what refinement made of it where places of it were asked for.
pub(crate) struct SmoothQuad {
    /// The number of neighbors of the first corner.
    n: usize,
    /// What lies around the quad at the first corner before each step.
    steps: Vec<Around>,
}

/// What lies around a quad.
struct Around {
    /// The points of the patch, `[i][j]` with `i` along `u`; and one row and column more where this comes from a step.
    net: [[Vector3<f64>; 5]; 5],
    ring: Ring,
}

/// The neighbors of the first corner, and the corners across, each after the neighbor that it follows.
type Ring = [[Vector3<f64>; 2]; MOST];

impl SmoothQuad {
    /// The quad in which `half` runs from the first corner, which has `n` neighbors, 3 at least; the others have four.
    pub(crate) fn around(mesh: &Connectivity, points: &[Point3<f64>], half: u32, n: usize) -> Self {
        let corners = mesh.corners();
        let at = |half: u32| points[corners[half as usize] as usize].coords;
        let turned = |half: u32| mesh.twin(mesh.previous(half));
        // Few places need more steps than this.
        let mut steps = Vec::with_capacity(if n == 4 { 1 } else { 8 });
        steps.push(Around::NOTHING);
        let Around { net, ring } = &mut steps[0];
        let mut spoke = half;
        for [neighbor, across] in &mut ring[..n] {
            let next = mesh.next(spoke);
            (*neighbor, *across) = (at(next), at(mesh.next(next)));
            spoke = turned(spoke);
        }
        net[1][1] = at(half);
        // Out of the quad at each other corner there is a quad across it; the two beside it share its edges.
        let [second, third, fourth] = [1, 2, 3].map(|k| half & !3 | (half + k) & 3);
        let end = |half: u32| at(mesh.next(half));
        let far = |half: u32| at(mesh.next(mesh.next(half)));
        let out = turned(turned(turned(second)));
        (net[3][0], net[3][1]) = (far(turned(turned(second))), end(out));
        let out = turned(turned(third));
        (net[3][2], net[3][3]) = (end(out), far(out));
        net[2][3] = end(turned(out));
        let out = turned(turned(fourth));
        (net[1][3], net[0][3]) = (end(out), far(out));
        // What the ring has in common with the net.
        let [[e0, d0], [e1, d1], [e2, d2], ..] = *ring;
        let [last, across] = ring[n - 1];
        (net[2][1], net[2][2], net[1][2]) = (e0, d0, e1);
        (net[0][2], net[0][1], net[0][0]) = (d1, if n > 2 { e2 } else { e0 }, d2);
        (net[1][0], net[2][0]) = (last, across);
        Self { n, steps }
    }

    /// The surface at `(u, v)`, where the corners are `(0, 0)`, `(1, 0)`, `(1, 1)`, `(0, 1)`; none too near to an irregular corner.
    pub(crate) fn jet(&mut self, u: f64, v: f64) -> Option<Jet> {
        if self.n == 4 {
            return Some(self.steps[0].patch([0, 0], [u, v]));
        }
        let (mut u, mut v, mut scale) = (2.0 * u, 2.0 * v, 2.0);
        for step in 1..=DEEPEST {
            let right = usize::from(u > 1.0);
            let up = usize::from(v > 1.0);
            if right + up > 0 {
                while self.steps.len() <= step {
                    self.refine();
                }
                let jet = self.steps[step].patch([right, up], [u - right as f64, v - up as f64]);
                return Some(scaled(jet, scale));
            }
            (u, v, scale) = (2.0 * u, 2.0 * v, 2.0 * scale);
        }
        None
    }

    fn refine(&mut self) {
        let last = self.steps.len() - 1;
        self.steps.push(Around::NOTHING);
        let (before, new) = self.steps.split_at_mut(last + 1);
        before[last].refine(self.n, &mut new[0]);
    }
}

impl Around {
    const NOTHING: Self = Self {
        net: [[Vector3::new(0.0, 0.0, 0.0); 5]; 5],
        ring: [[Vector3::new(0.0, 0.0, 0.0); 2]; MOST],
    };

    /// The surface at a place of the patch over the quad that lies so many places aside.
    fn patch(&self, [right, up]: [usize; 2], [u, v]: [f64; 2]) -> Jet {
        bicubic(|[i, j]| self.net[i + right][j + up], u, v)
    }

    /// The middle of the quad of the net from a place on.
    fn middle(&self, i: usize, j: usize) -> Vector3<f64> {
        let net = &self.net;
        (net[i][j] + net[i + 1][j] + net[i + 1][j + 1] + net[i][j + 1]) * 0.25
    }

    /// The new ring: on the edges from the first corner and in the faces between them.
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

    /// Fills in what lies around the new quad at the first corner, which has `n` neighbors: the new vertex in the quad is at `[2][2]`.
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
        // Those in the other faces at the three regular corners.
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
