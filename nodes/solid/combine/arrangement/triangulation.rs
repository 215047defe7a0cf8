//! Triangulates points and lines in a triangle, with exact predicates.

use std::cmp::Ordering;
use std::collections::VecDeque;

use super::points::Points;

/// Maximum number of passes over all edges that improve the shapes of triangles.
const PASSES: usize = 12;

/// Triangulates the triangle `corners`, which is counter-clockwise in the projection along `axes`. All points become corners of triangles,
/// and all `sides`, which cross each other only at their ends, become edges.
///
/// Points are inserted one by one, and edges that cross a side are flipped: Sloan, "A fast algorithm for generating constrained Delaunay
/// triangulations" (1993). Then edges are flipped where this makes the smaller height of both triangles larger.
pub(super) fn triangulate(
    corners: [u32; 3],
    inner: &[u32],
    sides: &[[u32; 2]],
    axes: [usize; 2],
    points: &Points,
) -> Vec<[u32; 3]> {
    let mut triangulation = Triangulation { triangles: vec![corners], axes, points };
    inner.iter().filter(|it| !corners.contains(it)).for_each(|&it| triangulation.insert(it));
    triangulation.improve(&[]);
    sides.iter().for_each(|&side| triangulation.enforce(side));
    triangulation.improve(sides);
    triangulation.triangles
}

struct Triangulation<'a> {
    triangles: Vec<[u32; 3]>,
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
                self.triangles[number] = first;
                self.triangles.extend([second, third]);
            }
            Some(k) => {
                let [p, q] = edges(triangle)[k];
                for number in 0..self.triangles.len() {
                    let own = self.triangles[number];
                    let side = edges(own).into_iter().position(|it| it == [p, q] || it == [q, p]);
                    if let Some(side) = side {
                        let [a, b, c] = rotate(own, side);
                        self.triangles[number] = [a, point, c];
                        self.triangles.push([point, b, c]);
                    }
                }
            }
        }
    }

    /// Finds the two triangles at an edge; `None` at the border.
    fn quad(&self, [p, q]: [u32; 2]) -> Option<Quad> {
        let find = |edge: [u32; 2]| {
            self.triangles.iter().enumerate().find_map(|(number, &own)| {
                let side = edges(own).into_iter().position(|it| it == edge)?;
                Some((number, rotate(own, side)[2]))
            })
        };
        let ((left, tip), (right, other)) = find([p, q]).zip(find([q, p]))?;
        Some(Quad { triangles: [left, right], ends: [p, q], tips: [tip, other] })
    }

    /// Returns true if the edge of a quad can be flipped: both new triangles are counter-clockwise.
    fn is_convex(&self, quad: &Quad) -> bool {
        let Quad { ends: [p, q], tips: [left, right], .. } = *quad;
        self.orientation([left, right, q]).is_gt() && self.orientation([right, left, p]).is_gt()
    }

    fn flip(&mut self, quad: &Quad) {
        let Quad { triangles, ends: [p, q], tips: [left, right] } = *quad;
        self.triangles[triangles[0]] = [left, right, q];
        self.triangles[triangles[1]] = [right, left, p];
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
        let mut crossing: VecDeque<[u32; 2]> = self
            .triangles
            .iter()
            .flat_map(|&own| edges(own))
            .filter(|&[p, q]| p < q && self.do_cross([p, q], side))
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

    /// Flips edges, except those in the sorted list `fixed`, such that triangles become higher.
    fn improve(&mut self, fixed: &[[u32; 2]]) {
        for _ in 0..PASSES {
            let all: Vec<[u32; 2]> = self
                .triangles
                .iter()
                .flat_map(|&own| edges(own))
                .filter(|&[p, q]| p < q && fixed.binary_search(&[p, q]).is_err())
                .collect();
            let mut is_changed = false;
            for edge in all {
                let Some(quad) = self.quad(edge) else { continue };
                let Quad { ends: [p, q], tips: [left, right], .. } = quad;
                let before = self.height([p, q, left]).min(self.height([q, p, right]));
                let after = self.height([left, right, q]).min(self.height([right, left, p]));
                if before * 1.01 < after && self.is_convex(&quad) {
                    self.flip(&quad);
                    is_changed = true;
                }
            }
            if !is_changed {
                return;
            }
        }
    }

    /// Returns the height of a triangle over its longest edge in the projection, divided by that edge's length.
    fn height(&self, corners: [u32; 3]) -> f64 {
        let places = corners.map(|it| self.axes.map(|axis| self.points.rounded(it)[axis]));
        let [u, v, w] = [[0, 1], [1, 2], [2, 0]]
            .map(|[a, b]: [usize; 2]| [0, 1].map(|k| places[b][k] - places[a][k]));
        let longest = [u, v, w].iter().map(|e| e[0] * e[0] + e[1] * e[1]).fold(0.0, f64::max);
        if longest > 0.0 { (u[0] * v[1] - u[1] * v[0]).abs() / longest } else { 0.0 }
    }
}

fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Rotates the corners of a triangle such that it begins with its edge `side`.
fn rotate([a, b, c]: [u32; 3], side: usize) -> [u32; 3] {
    [[a, b, c], [b, c, a], [c, a, b]][side]
}
