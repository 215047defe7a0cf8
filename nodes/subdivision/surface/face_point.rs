//! Positions in a part of a face, which may be divided further.

use super::limit_point::LimitPoint;
use super::patches::Jet;

/// The coordinates of a triangular part's corners.
pub(crate) const TRIANGLE: &[[f64; 2]] = &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

/// The coordinates of a quadrilateral part's corners.
pub(crate) const QUAD: &[[f64; 2]] = &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// A position in a part of a face, and the linear map between the coordinates of the part and of the face.
pub(crate) struct FacePoint {
    pub(crate) at: [f64; 2],
    /// The derivatives of the two coordinates in the part with respect to the coordinates `u` and `v` of the face.
    turn: [[f64; 2]; 2],
}

impl FacePoint {
    pub(crate) fn new(u: f64, v: f64) -> Self {
        Self { at: [u, v], turn: [[1.0, 0.0], [0.0, 1.0]] }
    }

    /// Replaces the part, a quad, by its quarter that contains the position. Returns the index of the corner at which this quarter lies.
    pub(crate) fn halve_quad(&mut self) -> usize {
        let [u, v] = self.at.map(|x| x.clamp(0.0, 1.0));
        let (corner, at, turn) = match (u > 0.5, v > 0.5) {
            (false, false) => (0, [u, v], [[1.0, 0.0], [0.0, 1.0]]),
            (true, false) => (1, [v, 1.0 - u], [[0.0, 1.0], [-1.0, 0.0]]),
            (true, true) => (2, [1.0 - u, 1.0 - v], [[-1.0, 0.0], [0.0, -1.0]]),
            (false, true) => (3, [1.0 - v, u], [[0.0, -1.0], [1.0, 0.0]]),
        };
        self.go(at.map(|x| 2.0 * x), turn);
        corner
    }

    /// Replaces the part, a triangle, by its quarter that contains the position. Returns the index of this quarter.
    pub(crate) fn halve_triangle(&mut self) -> usize {
        let [u, v] = self.at.map(|x| x.max(0.0));
        let over = f64::max(u + v, 1.0);
        let [u, v] = [u / over, v / over];
        let rest = 1.0 - u - v;
        let (part, at, turn) = if rest >= 0.5 {
            (0, [2.0 * u, 2.0 * v], [[1.0, 0.0], [0.0, 1.0]])
        } else if u >= 0.5 {
            (1, [2.0 * v, 2.0 * rest], [[0.0, 1.0], [-1.0, -1.0]])
        } else if v >= 0.5 {
            (2, [2.0 * rest, 2.0 * u], [[-1.0, -1.0], [1.0, 0.0]])
        } else {
            (3, [1.0 - 2.0 * rest, 1.0 - 2.0 * u], [[1.0, 1.0], [-1.0, 0.0]])
        };
        self.go(at.map(|x| x.max(0.0)), turn);
        part
    }

    fn go(&mut self, at: [f64; 2], turn: [[f64; 2]; 2]) {
        let old = self.turn;
        self.at = at;
        self.turn = turn.map(|[a, b]| [0, 1].map(|k| 2.0 * (a * old[0][k] + b * old[1][k])));
    }

    /// Replaces the part, a polygon, by the quad at the corner nearest to the position. Returns the index of this corner.
    pub(crate) fn corner(&mut self, sides: usize) -> usize {
        let [u, v] = self.at;
        let corner = u.floor().clamp(0.0, (sides - 1) as f64);
        self.at = [(u - corner).clamp(0.0, 1.0), v.clamp(0.0, 1.0)];
        corner as usize
    }

    pub(crate) fn is_corner(&self, corners: &[[f64; 2]]) -> Option<usize> {
        corners.iter().position(|corner| *corner == self.at)
    }

    pub(crate) fn nearest_corner(&self, corners: &[[f64; 2]]) -> usize {
        fn distance([x, y]: [f64; 2], at: [f64; 2]) -> f64 {
            (x - at[0]).abs() + (y - at[1]).abs()
        }
        let corners = corners.iter().enumerate();
        let nearest =
            corners.min_by(|a, b| distance(*a.1, self.at).total_cmp(&distance(*b.1, self.at)));
        nearest.map_or(0, |(corner, _)| corner)
    }

    /// Converts a jet (a point with its derivatives) from the coordinates of the part to those of the face.
    pub(crate) fn point(&self, jet: Jet) -> LimitPoint {
        let [s, s_a, s_b, s_aa, s_ab, s_bb] = jet;
        let [a, b] = self.turn;
        LimitPoint {
            point: s.into(),
            first: [0, 1].map(|k| s_a * a[k] + s_b * b[k]),
            second: Some([(0, 0), (0, 1), (1, 1)].map(|(k, l): (usize, usize)| {
                s_aa * (a[k] * a[l]) + s_ab * (a[k] * b[l] + a[l] * b[k]) + s_bb * (b[k] * b[l])
            })),
        }
    }
}
