//! Evaluation of Loop's limit surface over a triangle without creases near it. The first corner may have any number of neighbors.
//!
//! A refinement step makes four triangles: three are regular, and the triangle at the first corner is like the original one. The
//! neighborhood is small and has the same structure in every step, so it is refined as arrays, without a mesh.
//!
//! ```text
//!       beyond[3] -- beyond[2]         ring: around the first corner, counter-clockwise from the second corner on
//!        /    \     /     \            beyond: the other neighbors of the second and third corner, counter-clockwise
//! beyond[4] -- ring[1] -- beyond[1]
//!    \        /   \        /   \
//!     ring[2] --  own -- ring[0] -- beyond[0]
//!          \     /   \     /
//!          ...      ring[n - 1]
//! ```

use nalgebra::{Point3, Vector3};

use super::patches::{Jet, Quartic};
use crate::masks::loop_masks::LoopMasks;
use crate::masks::vertex_rings::Masks;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;

/// The maximum number of neighbors of the first corner.
pub(crate) const MAX_VALENCE: usize = 16;

/// The maximum number of refinement steps. After so many halvings, floating-point numbers cannot distinguish positions near a corner.
const MAX_DEPTH: usize = 40;

/// A triangle with its neighborhood, and a cache of the refined neighborhoods.
pub(crate) struct SmoothTriangle {
    /// The neighborhood, before each step, of the (refined) triangle at the first corner.
    steps: Vec<TriangleNeighborhood>,
    /// The patch that was evaluated last, together with its triangle: one of the refined triangles, or `None` for the original triangle.
    last: Option<(Option<Place>, Box<Quartic>)>,
}

/// The number of a refinement step, and one of the new triangles that the step makes.
type Place = (usize, ChildTriangle);

/// The neighborhood of a triangle.
struct TriangleNeighborhood {
    own: Vector3<f64>,
    ring: [Vector3<f64>; MAX_VALENCE],
    beyond: [Vector3<f64>; 5],
    n: usize,
}

impl SmoothTriangle {
    /// Creates the triangle of `half`, which starts at the first corner. The first corner has `n` neighbors, at least 3; the other corners
    /// have six.
    pub(crate) fn from_half_edge(
        mesh: &Connectivity,
        points: &[Point3<f64>],
        half: u32,
        n: usize,
    ) -> Self {
        let corners = mesh.corners();
        fn tip_coordinates(half: u32, points: &[Point3<f64>], corners: &[u32]) -> Vector3<f64> {
            points[corners[half as usize] as usize].coords
        }
        let end = |half: u32| tip_coordinates(mesh.next(half), points, corners);
        let zero = Vector3::zeros();
        let (mut ring, mut beyond) = ([zero; MAX_VALENCE], [zero; 5]);
        let mut spoke = half;
        for point in &mut ring[..n] {
            *point = end(spoke);
            spoke = mesh.next_around(spoke);
        }
        // The neighbors of the second corner are: the third corner, the first corner, the last point of the ring, and then the points of
        // `beyond`.
        let mut spoke = mesh.next_around(mesh.next_around(mesh.next_around(mesh.next(half))));
        for point in &mut beyond[..3] {
            *point = end(spoke);
            spoke = mesh.next_around(spoke);
        }
        // The neighbors of the third corner are: the first corner, the second corner, `beyond[2]`, and then the rest of `beyond`.
        let mut spoke = mesh.next_around(mesh.next_around(mesh.next_around(mesh.previous(half))));
        for point in &mut beyond[3..] {
            *point = end(spoke);
            spoke = mesh.next_around(spoke);
        }
        Self {
            steps: vec![TriangleNeighborhood {
                own: tip_coordinates(half, points, corners),
                ring,
                beyond,
                n,
            }],
            last: None,
        }
    }

    /// Evaluates the surface at `(u, v)`. The corners are `(0, 0)`, `(1, 0)`, `(0, 1)`. Returns `None` if `(u, v)` is too close to an
    /// irregular corner.
    pub(crate) fn jet(&mut self, u: f64, v: f64) -> Option<Jet> {
        if self.steps[0].n == 6 {
            return Some(self.patch(None)?.jet(u, v));
        }
        let (mut u, mut v, mut scale) = (2.0 * u, 2.0 * v, 2.0);
        for step in 0..MAX_DEPTH {
            if u + v > 1.0 {
                let (child, [u, v], turn) = match (u >= 1.0, v >= 1.0) {
                    (true, _) => (ChildTriangle::Second, [u - 1.0, v], 1.0),
                    (_, true) => (ChildTriangle::Third, [u, v - 1.0], 1.0),
                    _ => (ChildTriangle::Middle, [1.0 - u, 1.0 - v], -1.0),
                };
                return Some(scale_jet(self.patch(Some((step, child)))?.jet(u, v), turn * scale));
            }
            (u, v, scale) = (2.0 * u, 2.0 * v, 2.0 * scale);
        }
        None
    }

    /// Returns the patch over the new triangle `over`; if it is `None`, the patch over the original triangle.
    fn patch(&mut self, over: Option<Place>) -> Option<&Quartic> {
        if self.last.as_ref().is_none_or(|(last, _)| *last != over) {
            let patch = match over {
                None => self.steps[0].regular_patch(),
                Some((step, child)) => {
                    while self.steps.len() <= step + 1 {
                        self.steps.push(self.steps[self.steps.len() - 1].first_child());
                    }
                    self.steps[step].child(&self.steps[step + 1], child)
                }
            };
            self.last = Some((over, Box::new(patch)));
        }
        self.last.as_ref().map(|(_, patch)| &**patch)
    }
}

impl TriangleNeighborhood {
    /// Computes the new vertex on the edge between the first corner and point `j` of the ring.
    fn spoke_vertex(&self, j: usize) -> Vector3<f64> {
        let (n, ring) = (self.n, &self.ring);
        let beside =
            ring[if j == 0 { n - 1 } else { j - 1 }] + ring[if j + 1 == n { 0 } else { j + 1 }];
        on_edge(self.own + ring[j], beside)
    }

    /// Computes the neighborhood of the new triangle at the first corner.
    fn first_child(&self) -> Self {
        let Self { own, ring, beyond, n } = self;
        let [weight, beside, _] = LoopMasks.vertex(*n);
        let sum: Vector3<f64> = ring[..*n].iter().sum();
        let mut new = [Vector3::zeros(); MAX_VALENCE];
        (0..*n).for_each(|j| new[j] = self.spoke_vertex(j));
        let [b, c, ab, ca] = [ring[0], ring[1], ring[n - 1], ring[2 % n]];
        let [b_a, b_c, bc, c_b, c_a] = *beyond;
        let beyond = [
            on_edge(b + ab, own + b_a),
            at_vertex(b, own + c + ab + bc + b_a + b_c),
            on_edge(b + c, own + bc),
            at_vertex(c, own + b + ca + bc + c_a + c_b),
            on_edge(c + ca, own + c_a),
        ];
        Self { own: own * weight + sum * beside, ring: new, beyond, n: *n }
    }

    /// Returns the patch over the triangle. All three corners must be regular.
    fn regular_patch(&self) -> Quartic {
        let Self { own: a, ring, beyond, .. } = self;
        let [b, c, ca, a_c, a_b, ab] = [0, 1, 2, 3, 4, 5].map(|k| ring[k]);
        let [b_a, b_c, bc, c_b, c_a] = *beyond;
        Quartic::new(
            &[*a, b, c],
            &[[b, c, ca, a_c, a_b, ab], [c, *a, ab, b_a, b_c, bc], [*a, b, bc, c_b, c_a, ca]],
        )
    }

    /// Returns the patch over one of the other three new triangles; `first` is the new triangle at the first corner. The new triangles have
    /// the orientation of the original one, except for the middle triangle, which is rotated by 180 degrees.
    fn child(&self, first: &Self, child: ChildTriangle) -> Quartic {
        let Self { ring, beyond, n, .. } = self;
        let [old_b, old_c, old_ab, old_ca] = [ring[0], ring[1], ring[n - 1], ring[2 % n]];
        let [b_a, b_c, bc, c_b, c_a] = *beyond;
        let [b_ab, b, middle, c, c_ca] = first.beyond;
        let (a, ab, ac) = (first.own, first.ring[0], first.ring[1]);
        let (before, after) = (first.ring[n - 1], first.ring[2 % n]);
        let b_bc = on_edge(old_b + bc, old_c + b_c);
        let c_bc = on_edge(old_c + bc, old_b + c_b);
        match child {
            ChildTriangle::Second => {
                let b_b_a = on_edge(old_b + b_a, old_ab + b_c);
                let b_b_c = on_edge(old_b + b_c, b_a + bc);
                let around_b = [middle, ab, b_ab, b_b_a, b_b_c, b_bc];
                let around_ab = [b, middle, ac, a, before, b_ab];
                let around_middle = [ab, b, b_bc, c_bc, c, ac];
                Quartic::new(&[ab, b, middle], &[around_ab, around_b, around_middle])
            }
            ChildTriangle::Third => {
                let c_c_b = on_edge(old_c + c_b, bc + c_a);
                let c_c_a = on_edge(old_c + c_a, c_b + old_ca);
                let around_c = [ac, middle, c_bc, c_c_b, c_c_a, c_ca];
                let around_middle = [c, ac, ab, b, b_bc, c_bc];
                let around_ac = [middle, c, c_ca, after, a, ab];
                Quartic::new(&[ac, middle, c], &[around_ac, around_middle, around_c])
            }
            ChildTriangle::Middle => {
                let around_middle = [ac, ab, b, b_bc, c_bc, c];
                let around_ac = [ab, middle, c, c_ca, after, a];
                let around_ab = [middle, ac, a, before, b_ab, b];
                Quartic::new(&[middle, ac, ab], &[around_middle, around_ac, around_ab])
            }
        }
    }
}

/// One of the three regular new triangles: at the second or third corner, or in the middle.
#[derive(Clone, Copy, PartialEq)]
enum ChildTriangle {
    Second,
    Third,
    Middle,
}

fn on_edge(ends: Vector3<f64>, across: Vector3<f64>) -> Vector3<f64> {
    ends * 0.375 + across * 0.125
}

/// Computes the new vertex of a regular vertex at the position `own`; `neighbors` is the sum of its six neighbors.
fn at_vertex(own: Vector3<f64>, neighbors: Vector3<f64>) -> Vector3<f64> {
    own * 0.625 + neighbors * 0.0625
}

/// Converts a jet (a point with its derivatives) to coordinates that are multiplied by `1 / scale`: multiplies first derivatives by
/// `scale`, second derivatives by its square.
pub(crate) fn scale_jet([s, s_u, s_v, s_uu, s_uv, s_vv]: Jet, scale: f64) -> Jet {
    let twice = scale * scale;
    [s, s_u * scale, s_v * scale, s_uu * twice, s_uv * twice, s_vv * twice]
}
