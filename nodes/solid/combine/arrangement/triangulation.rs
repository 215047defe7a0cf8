//! Triangulates points and lines in a triangle, with exact predicates.

use std::cmp::Ordering;
use std::collections::{BTreeMap, VecDeque};

use super::points::Points;

/// Triangulates the triangle `corners`, which is counter-clockwise in the projection along `axes`. All points become corners of triangles,
/// and all `sides`, which cross each other only at their ends, become edges.
///
/// Points are inserted one by one, and edges that cross a side are flipped: Sloan, "A fast algorithm for generating constrained Delaunay
/// triangulations" (1993). Then edges are flipped until the triangulation is the constrained Delaunay triangulation. Ties are broken by the
/// numbers of the points, so it is unique: two triangles in one plane are divided alike where they overlap.
pub(super) fn triangulate(
    corners: [u32; 3],
    inner: &[u32],
    sides: &[[u32; 2]],
    axes: [usize; 2],
    points: &Points,
) -> Vec<[u32; 3]> {
    let mut triangulation =
        Triangulation { triangles: vec![corners], sides: BTreeMap::new(), axes, points };
    triangulation.set(0, corners);
    inner.iter().filter(|it| !corners.contains(it)).for_each(|&it| triangulation.insert(it));
    sides.iter().for_each(|&side| triangulation.enforce(side));
    triangulation.make_delaunay(sides);
    triangulation.triangles
}

struct Triangulation<'a> {
    triangles: Vec<[u32; 3]>,
    /// The triangle to the left of each directed edge.
    sides: BTreeMap<[u32; 2], usize>,
    axes: [usize; 2],
    points: &'a Points,
}

/// Two triangles at an edge: their indices, the ends of the edge, and the corners opposite to it. The first triangle is to the left.
struct Quad {
    triangles: [usize; 2],
    ends: [u32; 2],
    tips: [u32; 2],
}

impl Triangulation<'_> {
    fn orientation(&self, corners: [u32; 3]) -> Ordering {
        self.points.orientation(corners, self.axes)
    }

    fn insert(&mut self, point: u32) {
        let sides =
            |triangle: [u32; 3]| edges(triangle).map(|[p, q]| self.orientation([p, q, point]));
        let found = (0..self.triangles.len())
            .map(|number| (number, sides(self.triangles[number])))
            .find(|(_, sides)| !sides.contains(&Ordering::Less));
        let Some((number, sides)) = found else { return };
        let triangle = self.triangles[number];
        match sides.iter().position(|side| side.is_eq()) {
            None => {
                let [first, second, third] = edges(triangle).map(|[p, q]| [p, q, point]);
                self.set(number, first);
                self.set(self.triangles.len(), second);
                self.set(self.triangles.len(), third);
            }
            Some(k) => {
                let [p, q] = edges(triangle)[k];
                let halves = [[p, q], [q, p]].map(|edge| (edge, self.sides.remove(&edge)));
                for ([a, b], number) in halves {
                    if let Some(number) = number {
                        let tip = self.tip(number, [a, b]);
                        self.set(number, [a, point, tip]);
                        self.set(self.triangles.len(), [point, b, tip]);
                    }
                }
            }
        }
    }

    /// Replaces a triangle, or adds one at the end of the list. Its edges replace those of older triangles.
    fn set(&mut self, number: usize, triangle: [u32; 3]) {
        match self.triangles.get_mut(number) {
            Some(place) => *place = triangle,
            None => self.triangles.push(triangle),
        }
        self.sides.extend(edges(triangle).map(|edge| (edge, number)));
    }

    /// Returns the corner of a triangle opposite to an edge.
    fn tip(&self, number: usize, edge: [u32; 2]) -> u32 {
        let corners = self.triangles[number];
        corners.into_iter().find(|it| !edge.contains(it)).unwrap_or(corners[0])
    }

    /// Finds the two triangles at an edge; `None` at the border.
    fn quad(&self, [p, q]: [u32; 2]) -> Option<Quad> {
        let (&left, &right) = self.sides.get(&[p, q]).zip(self.sides.get(&[q, p]))?;
        let tips = [self.tip(left, [p, q]), self.tip(right, [p, q])];
        Some(Quad { triangles: [left, right], ends: [p, q], tips })
    }

    /// Returns true if the edge of a quad can be flipped: both new triangles are counter-clockwise.
    fn is_convex(&self, quad: &Quad) -> bool {
        let Quad { ends: [p, q], tips: [left, right], .. } = *quad;
        self.orientation([left, right, q]).is_gt() && self.orientation([right, left, p]).is_gt()
    }

    fn flip(&mut self, quad: &Quad) {
        let Quad { triangles, ends: [p, q], tips: [left, right] } = *quad;
        self.sides.remove(&[p, q]);
        self.sides.remove(&[q, p]);
        self.set(triangles[0], [left, right, q]);
        self.set(triangles[1], [right, left, p]);
    }

    fn do_cross(&self, [p, q]: [u32; 2], [u, v]: [u32; 2]) -> bool {
        if [p, q].iter().any(|it| [u, v].contains(it)) {
            return false;
        }
        let sides = [[p, q, u], [p, q, v], [u, v, p], [u, v, q]].map(|it| self.orientation(it));
        sides[0] != sides[1] && sides[2] != sides[3]
    }

    /// Makes `side` an edge: flips the edges that cross it.
    fn enforce(&mut self, side: [u32; 2]) {
        let [p, q] = side;
        if self.sides.contains_key(&[p, q]) || self.sides.contains_key(&[q, p]) {
            return;
        }
        let bounds = self.points.bounds(side, self.axes);
        let mut crossing: VecDeque<[u32; 2]> = self
            .triangles
            .iter()
            .flat_map(|&own| edges(own))
            .filter(|&[p, q]| p < q && bounds.overlaps(&self.points.bounds([p, q], self.axes)))
            .filter(|&edge| self.do_cross(edge, side))
            .collect();
        // Each edge is visited a few times only; the limit protects from endless loops.
        let limit = 64 + 16 * crossing.len() * crossing.len();
        for _ in 0..limit {
            let Some(edge) = crossing.pop_front() else { return };
            let Some(quad) = self.quad(edge) else { continue };
            if !self.is_convex(&quad) {
                crossing.push_back(edge);
                continue;
            }
            self.flip(&quad);
            if self.do_cross(quad.tips, side) {
                crossing.push_back(quad.tips);
            }
        }
    }

    /// Flips edges, except those in the sorted list `fixed`, until no triangle has the tip of its neighbor in its circumcircle.
    fn make_delaunay(&mut self, fixed: &[[u32; 2]]) {
        fn is_free([p, q]: [u32; 2], fixed: &[[u32; 2]]) -> bool {
            fixed.binary_search(&[p.min(q), p.max(q)]).is_err()
        }
        let mut open: Vec<[u32; 2]> = self.sides.keys().copied().filter(|[p, q]| p < q).collect();
        while let Some(edge) = open.pop() {
            let Some(quad) = self.quad(edge).filter(|_| is_free(edge, fixed)) else { continue };
            let Quad { ends: [p, q], tips: [left, right], .. } = quad;
            let is_flipped = match self.points.in_circle([p, q, left, right], self.axes) {
                Ordering::Less => false,
                Ordering::Greater => true,
                // Of four points on a circle, the edge begins at the one with the lowest number.
                Ordering::Equal => left.min(right) < p.min(q),
            };
            if is_flipped && self.is_convex(&quad) {
                self.flip(&quad);
                open.extend([[p, left], [left, q], [q, right], [right, p]]);
            }
        }
    }
}

fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}
