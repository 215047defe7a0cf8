//! A triangle without creases around it, whose first corner may have any number of neighbors: the limit of Loop's scheme anywhere on it.
//!
//! Refinement makes four triangles of it, three of them regular and the one at the first corner like the whole. What lies around
//! it is so little, and so much the same in every step, that plain arithmetic on lists of fixed places does it: no mesh is made.
//!
//! ```text
//!       beyond[3] -- beyond[2]         ring: around the first corner, counter-clockwise from the second corner on
//!        /    \     /     \            beyond: around the second and third corner, counter-clockwise, what is not in the ring
//! beyond[4] -- ring[1] -- beyond[1]
//!    \        /   \        /   \
//!     ring[2] --  own -- ring[0] -- beyond[0]
//!          \     /   \     /
//!          ...      ring[n - 1]
//! ```

use nalgebra::{Point3, Vector3};

use super::patches::{Jet, Quartic};
use crate::masks::loop_masks::LoopMasks;
use crate::masks::stars::Masks;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;

/// Most neighbors of the first corner.
pub(crate) const MOST: usize = 16;

/// Steps that bring a place as near to a corner as its coordinates can tell.
const DEEPEST: usize = 40;

/// A triangle, what lies around it, and what refinement made of it where places of it were asked for.
pub(crate) struct SmoothTriangle {
    /// What lies around the triangle at the first corner before each step.
    steps: Vec<Around>,
    /// The last patch, and over which new triangle of which step it is; over the whole one if over none.
    last: Option<(Option<Place>, Box<Quartic>)>,
}

/// A new triangle of a step.
type Place = (usize, ChildTriangle);

/// What lies around a triangle.
struct Around {
    own: Vector3<f64>,
    ring: [Vector3<f64>; MOST],
    beyond: [Vector3<f64>; 5],
    n: usize,
}

impl SmoothTriangle {
    /// The triangle in which `half` runs from the first corner, which has `n` neighbors, 3 at least; the others have six.
    pub(crate) fn around(mesh: &Connectivity, points: &[Point3<f64>], half: u32, n: usize) -> Self {
        let corners = mesh.corners();
        fn at(half: u32, points: &[Point3<f64>], corners: &[u32]) -> Vector3<f64> {
            points[corners[half as usize] as usize].coords
        }
        let turned = |half: u32| mesh.twin(mesh.previous(half));
        let end = |half: u32| at(mesh.next(half), points, corners);
        let zero = Vector3::zeros();
        let (mut ring, mut beyond) = ([zero; MOST], [zero; 5]);
        let mut spoke = half;
        for place in &mut ring[..n] {
            *place = end(spoke);
            spoke = turned(spoke);
        }
        // From the second corner: to the third, the first, the last of the ring, and then beyond it.
        let mut spoke = turned(turned(turned(mesh.next(half))));
        for place in &mut beyond[..3] {
            *place = end(spoke);
            spoke = turned(spoke);
        }
        // From the third one: to the first, the second, and what lies across.
        let mut spoke = turned(turned(turned(mesh.previous(half))));
        for place in &mut beyond[3..] {
            *place = end(spoke);
            spoke = turned(spoke);
        }
        Self { steps: vec![Around { own: at(half, points, corners), ring, beyond, n }], last: None }
    }

    /// The surface at `(u, v)`, where the corners are `(0, 0)`, `(1, 0)`, `(0, 1)`; none too near to an irregular corner.
    pub(crate) fn jet(&mut self, u: f64, v: f64) -> Option<Jet> {
        if self.steps[0].n == 6 {
            return Some(self.patch(None)?.jet(u, v));
        }
        let (mut u, mut v, mut scale) = (2.0 * u, 2.0 * v, 2.0);
        for step in 0..DEEPEST {
            if u + v > 1.0 {
                let (child, [u, v], turn) = match (u >= 1.0, v >= 1.0) {
                    (true, _) => (ChildTriangle::Second, [u - 1.0, v], 1.0),
                    (_, true) => (ChildTriangle::Third, [u, v - 1.0], 1.0),
                    _ => (ChildTriangle::Middle, [1.0 - u, 1.0 - v], -1.0),
                };
                return Some(scaled(self.patch(Some((step, child)))?.jet(u, v), turn * scale));
            }
            (u, v, scale) = (2.0 * u, 2.0 * v, 2.0 * scale);
        }
        None
    }

    /// The patch over a new triangle of a step, or over the whole one.
    fn patch(&mut self, over: Option<Place>) -> Option<&Quartic> {
        if self.last.as_ref().is_none_or(|(last, _)| *last != over) {
            let patch = match over {
                None => self.steps[0].whole(),
                Some((step, child)) => {
                    while self.steps.len() <= step + 1 {
                        self.steps.push(self.steps[self.steps.len() - 1].at_first());
                    }
                    self.steps[step].child(&self.steps[step + 1], child)
                }
            };
            self.last = Some((over, Box::new(patch)));
        }
        self.last.as_ref().map(|(_, patch)| &**patch)
    }
}

impl Around {
    /// The new vertex on the edge from the first corner to place `j` of the ring.
    fn on_spoke(&self, j: usize) -> Vector3<f64> {
        let (n, ring) = (self.n, &self.ring);
        let beside =
            ring[if j == 0 { n - 1 } else { j - 1 }] + ring[if j + 1 == n { 0 } else { j + 1 }];
        on_edge(self.own + ring[j], beside)
    }

    /// The new triangle at the first corner.
    fn at_first(&self) -> Self {
        let Self { own, ring, beyond, n } = self;
        let [weight, beside, _] = LoopMasks.vertex(*n);
        let sum: Vector3<f64> = ring[..*n].iter().sum();
        let mut new = [Vector3::zeros(); MOST];
        (0..*n).for_each(|j| new[j] = self.on_spoke(j));
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

    /// The patch over the triangle itself, if it is regular.
    fn whole(&self) -> Quartic {
        let Self { own: a, ring, beyond, .. } = self;
        let [b, c, ca, a_c, a_b, ab] = [0, 1, 2, 3, 4, 5].map(|k| ring[k]);
        let [b_a, b_c, bc, c_b, c_a] = *beyond;
        Quartic::new(
            &[*a, b, c],
            &[[b, c, ca, a_c, a_b, ab], [c, *a, ab, b_a, b_c, bc], [*a, b, bc, c_b, c_a, ca]],
        )
    }

    /// The patch over a new triangle that is not the `first` one; each lies as the whole does, but for the middle one, which is turned by
    /// half a turn.
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

/// A new triangle that is regular: at the second or third corner, or in the middle.
#[derive(Clone, Copy, PartialEq)]
enum ChildTriangle {
    Second,
    Third,
    Middle,
}

fn on_edge(ends: Vector3<f64>, across: Vector3<f64>) -> Vector3<f64> {
    ends * 0.375 + across * 0.125
}

/// A new vertex at one with six neighbors, of which this is the sum.
fn at_vertex(own: Vector3<f64>, neighbors: Vector3<f64>) -> Vector3<f64> {
    own * 0.625 + neighbors * 0.0625
}

/// A jet by coordinates that run so many times as slowly.
pub(crate) fn scaled([s, s_u, s_v, s_uu, s_uv, s_vv]: Jet, scale: f64) -> Jet {
    let twice = scale * scale;
    [s, s_u * scale, s_v * scale, s_uu * twice, s_uv * twice, s_vv * twice]
}
