//! Regular patches: the bicubic B-spline over a quad and the quartic box spline over a triangle.

use nalgebra::Vector3;

/// A place on a surface with its first and second derivatives: `s`, `s_u`, `s_v`, `s_uu`, `s_uv`, `s_vv`.
pub(crate) type Jet = [Vector3<f64>; 6];

/// Values, first and second derivatives of the four cubic B-splines over a unit interval.
fn cubic(t: f64) -> [[f64; 4]; 3] {
    let r = 1.0 - t;
    [
        [r * r * r, (3.0 * t - 6.0) * t * t + 4.0, (3.0 * r - 6.0) * r * r + 4.0, t * t * t]
            .map(|x| x / 6.0),
        [-r * r, (3.0 * t - 4.0) * t, (4.0 - 3.0 * r) * r, t * t].map(|x| x / 2.0),
        [r, 3.0 * t - 2.0, 3.0 * r - 2.0, t],
    ]
}

/// The surface at `(u, v)` in the middle square of `net[i][j]`, `i` along `u`.
pub(crate) fn bicubic(net: &[[Vector3<f64>; 4]; 4], u: f64, v: f64) -> Jet {
    let (along_u, along_v) = (cubic(u), cubic(v));
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]].map(|[k, l]| {
        let mut sum = Vector3::zeros();
        for (row, weight) in net.iter().zip(along_u[k]) {
            for (point, other) in row.iter().zip(along_v[l]) {
                sum += point * (weight * other);
            }
        }
        sum
    })
}

/// The surface at `(u, v)` in the middle triangle, where its corners are `(0, 0)`, `(1, 0)`, `(0, 1)`; `rings[k]` is what lies around
/// corner `k`, counter-clockwise, from the next corner on.
///
/// The box spline is a polynomial of degree 4 there, whose Bezier points are taken together two times in a row, until those of a
/// polynomial of degree 2 are left: the algorithm of de Casteljau. The points follow from the polynomials in Stam, "Evaluation of
/// Loop subdivision surfaces" (1998), appendix B.
pub(crate) fn quartic(
    corners: &[Vector3<f64>; 3],
    rings: &[[Vector3<f64>; 6]; 3],
    u: f64,
    v: f64,
) -> Jet {
    let at = [1.0 - u - v, u, v];
    let three: [_; 10] = blend(&bezier(corners, rings), at);
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

/// The Bezier points of the middle triangle, by rows: first the one at corner 0, last those along the side across from it.
fn bezier(corners: &[Vector3<f64>; 3], rings: &[[Vector3<f64>; 6]; 3]) -> [Vector3<f64>; 15] {
    // Where those next to corner k are: itself, towards the next and the last corner, half way to the next, and inside.
    const PLACES: [[usize; 5]; 3] = [[0, 1, 2, 3, 4], [10, 11, 6, 12, 7], [14, 9, 13, 5, 8]];
    let mut points = [Vector3::zeros(); 15];
    for (k, place) in PLACES.into_iter().enumerate() {
        let a = corners[k];
        let [b, c, ca, a_c, a_b, ab] = rings[k];
        let (sides, across) = (b + c, ab + ca);
        points[place[0]] = a * 0.5 + (sides + across + (a_b + a_c)) / 12.0;
        points[place[1]] = (a * 12.0 + b * 4.0 + (c + ab) * 3.0 + (ca + a_b)) / 24.0;
        points[place[2]] = (a * 12.0 + c * 4.0 + (b + ca) * 3.0 + (ab + a_c)) / 24.0;
        points[place[3]] = ((a + b) * 2.0 + (c + ab)) / 6.0;
        points[place[4]] = (a * 10.0 + sides * 6.0 + across) / 24.0;
    }
    points
}

/// The points of a triangle of points, by rows, taken together three by three: one row less.
fn blend<const FROM: usize, const TO: usize>(
    from: &[Vector3<f64>; FROM],
    [a, b, c]: [f64; 3],
) -> [Vector3<f64>; TO] {
    let mut to = [Vector3::zeros(); TO];
    let (mut row, mut first) = (0, 0);
    for (place, to) in to.iter_mut().enumerate() {
        if place > first + row {
            first += row + 1;
            row += 1;
        }
        let below = place + row + 1;
        *to = from[place] * a + from[below] * b + from[below + 1] * c;
    }
    to
}
