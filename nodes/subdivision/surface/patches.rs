//! Regular patches: the bicubic B-spline over a quad and the quartic box spline over a triangle.

use nalgebra::Vector3;

/// A point of a surface with its first and second derivatives: `s`, `s_u`, `s_v`, `s_uu`, `s_uv`, `s_vv`.
pub(crate) type Jet = [Vector3<f64>; 6];

/// The values, first and second derivatives of the four cubic B-splines over a unit interval.
fn cubic(t: f64) -> [[f64; 4]; 3] {
    let r = 1.0 - t;
    [
        [r * r * r, (3.0 * t - 6.0) * t * t + 4.0, (3.0 * r - 6.0) * r * r + 4.0, t * t * t]
            .map(|x| x / 6.0),
        [-r * r, (3.0 * t - 4.0) * t, (4.0 - 3.0 * r) * r, t * t].map(|x| x / 2.0),
        [r, 3.0 * t - 2.0, 3.0 * r - 2.0, t],
    ]
}

/// Evaluates the bicubic B-spline at `(u, v)` in the middle square of a 4 by 4 net of points `[i][j]`, with `i` along `u`.
pub(crate) fn bicubic(net: impl Fn([usize; 2]) -> Vector3<f64>, u: f64, v: f64) -> Jet {
    tensor(net, &cubic(u), &cubic(v))
}

/// Evaluates a tensor-product surface. `along_u` and `along_v` have the values, first and second derivatives of the basis functions.
pub(crate) fn tensor<const N: usize>(
    net: impl Fn([usize; 2]) -> Vector3<f64>,
    along_u: &[[f64; N]; 3],
    along_v: &[[f64; N]; 3],
) -> Jet {
    // The loops are arranged so that the compiler can use SIMD instructions.
    let mut sums = [[0.0; 6]; 3];
    for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))) {
        let weights = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
            .map(|[k, l]: [usize; 2]| along_u[k][i] * along_v[l][j]);
        let point = net([i, j]);
        for (sums, x) in sums.iter_mut().zip(point.iter()) {
            (0..6).for_each(|k| sums[k] += x * weights[k]);
        }
    }
    std::array::from_fn(|k| Vector3::from(sums.map(|sums| sums[k])))
}

/// The quartic box spline over the middle triangle of a regular net, stored as the 15 Bezier points of a polynomial of degree 4.
pub(crate) struct Quartic([Vector3<f64>; 15]);

impl Quartic {
    /// Creates the patch over a triangle. `rings[k]` has the neighbors of corner `k`, counter-clockwise, beginning with the next corner.
    pub(crate) fn new(corners: &[Vector3<f64>; 3], rings: &[[Vector3<f64>; 6]; 3]) -> Self {
        Self(bezier(corners, rings))
    }

    /// Evaluates the patch at `(u, v)`. The corners of the triangle are `(0, 0)`, `(1, 0)`, `(0, 1)`.
    ///
    /// Two steps of de Casteljau's algorithm reduce the polynomial to degree 2, from which the derivatives follow. The Bezier points are
    /// derived from the polynomials in Stam, "Evaluation of Loop subdivision surfaces" (1998), appendix B.
    pub(crate) fn jet(&self, u: f64, v: f64) -> Jet {
        let at = [1.0 - u - v, u, v];
        let three: [_; 10] = blend(&self.0, at);
        let [p, p_u, p_v, p_uu, p_uv, p_vv]: [_; 6] = blend(&three, at);
        let [q, q_u, q_v] = blend(&[p, p_u, p_v, p_uu, p_uv, p_vv], at);
        let [s] = blend(&[q, q_u, q_v], at);
        [
            s,
            (q_u - q) * 4.0,
            (q_v - q) * 4.0,
            (p - p_u * 2.0 + p_uu) * 12.0,
            (p - p_u - p_v + p_uv) * 12.0,
            (p - p_v * 2.0 + p_vv) * 12.0,
        ]
    }
}

/// Computes the Bezier points of the middle triangle, row by row: first the one at corner 0, last those along the opposite side.
fn bezier(corners: &[Vector3<f64>; 3], rings: &[[Vector3<f64>; 6]; 3]) -> [Vector3<f64>; 15] {
    // For each corner k the indices of five Bezier points: at the corner, next to the corner towards the next and the previous corner, half
    // way to the next corner, and inside the triangle.
    const INDICES: [[usize; 5]; 3] = [[0, 1, 2, 3, 4], [10, 11, 6, 12, 7], [14, 9, 13, 5, 8]];
    let mut points = [Vector3::zeros(); 15];
    for (k, index) in INDICES.into_iter().enumerate() {
        let a = corners[k];
        let [b, c, ca, a_c, a_b, ab] = rings[k];
        let (sides, across) = (b + c, ab + ca);
        points[index[0]] = a * 0.5 + (sides + across + (a_b + a_c)) / 12.0;
        points[index[1]] = (a * 12.0 + b * 4.0 + (c + ab) * 3.0 + (ca + a_b)) / 24.0;
        points[index[2]] = (a * 12.0 + c * 4.0 + (b + ca) * 3.0 + (ab + a_c)) / 24.0;
        points[index[3]] = ((a + b) * 2.0 + (c + ab)) / 6.0;
        points[index[4]] = (a * 10.0 + sides * 6.0 + across) / 24.0;
    }
    points
}

/// Performs a step of de Casteljau's algorithm on a triangle of points, stored by rows. The result has one row less.
fn blend<const FROM: usize, const TO: usize>(
    from: &[Vector3<f64>; FROM],
    [a, b, c]: [f64; 3],
) -> [Vector3<f64>; TO] {
    let mut to = [Vector3::zeros(); TO];
    let (mut row, mut first) = (0, 0);
    for (index, to) in to.iter_mut().enumerate() {
        if index > first + row {
            first += row + 1;
            row += 1;
        }
        let below = index + row + 1;
        *to = from[index] * a + from[below] * b + from[below + 1] * c;
    }
    to
}
