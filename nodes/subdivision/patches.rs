//! Regular patches: the bicubic B-spline over a quad and the quartic box spline over a triangle.

use nalgebra::Vector3;

/// A place on a surface with its first and second derivatives: `s`, `s_u`, `s_v`, `s_uu`, `s_uv`, `s_vv`.
pub(super) type Jet = [Vector3<f64>; 6];

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
pub(super) fn bicubic(net: &[[Vector3<f64>; 4]; 4], u: f64, v: f64) -> Jet {
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

/// A term `coefficient a^i b^j c^k` of a polynomial in barycentric coordinates.
type Term = (f64, [i32; 3]);

/// The weight of the corner `a` of the middle triangle, times 12. These polynomials: Stam, "Evaluation of Loop subdivision
/// surfaces" (1998), appendix B.
const CORNER: &[Term] = &[
    (6.0, [4, 0, 0]),
    (24.0, [3, 1, 0]),
    (24.0, [3, 0, 1]),
    (24.0, [2, 2, 0]),
    (60.0, [2, 1, 1]),
    (24.0, [2, 0, 2]),
    (8.0, [1, 3, 0]),
    (36.0, [1, 2, 1]),
    (36.0, [1, 1, 2]),
    (8.0, [1, 0, 3]),
    (1.0, [0, 4, 0]),
    (6.0, [0, 3, 1]),
    (12.0, [0, 2, 2]),
    (6.0, [0, 1, 3]),
    (1.0, [0, 0, 4]),
];

/// That of the vertex across the edge from `a` to `b`.
const ACROSS: &[Term] = &[
    (1.0, [4, 0, 0]),
    (6.0, [3, 1, 0]),
    (2.0, [3, 0, 1]),
    (12.0, [2, 2, 0]),
    (6.0, [2, 1, 1]),
    (6.0, [1, 3, 0]),
    (6.0, [1, 2, 1]),
    (1.0, [0, 4, 0]),
    (2.0, [0, 3, 1]),
];

/// That of the vertex behind `a` on the side of `b`.
const BEHIND: &[Term] = &[(1.0, [4, 0, 0]), (2.0, [3, 1, 0])];

/// The surface at `(u, v)` in the middle triangle, where its corners are `(0, 0)`, `(1, 0)`, `(0, 1)`; `rings[k]` is what lies around
/// corner `k`, counter-clockwise, from the next corner on.
pub(super) fn quartic(
    corners: &[Vector3<f64>; 3],
    rings: &[[Vector3<f64>; 6]; 3],
    u: f64,
    v: f64,
) -> Jet {
    let at = [1.0 - u - v, u, v];
    let mut jet = [Vector3::zeros(); 6];
    for k in 0..3 {
        // Around corner a: b, c, across ca, two behind, across ab.
        let [_, _, _, behind_c, behind_b, across] = rings[k];
        let (b, c) = ((k + 1) % 3, (k + 2) % 3);
        let weights = [
            (corners[k], CORNER, [k, b, c]),
            (across, ACROSS, [k, b, c]),
            (behind_b, BEHIND, [k, b, c]),
            (behind_c, BEHIND, [k, c, b]),
        ];
        for (point, terms, order) in weights {
            let weights = derivatives(terms, order, at);
            jet.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += point * (weight / 12.0));
        }
    }
    jet
}

/// A polynomial at a place, and its derivatives by `u` and `v`, which grow where the first coordinate shrinks. `order[i]` is the
/// coordinate that the `i`-th exponent belongs to.
fn derivatives(terms: &[Term], order: [usize; 3], at: [f64; 3]) -> [f64; 6] {
    let power = |x: f64, n: i32| (0..n).fold(1.0, |product, _| product * x);
    let mut gradient = [0.0; 3];
    let mut hessian = [[0.0; 3]; 3];
    let mut value = 0.0;
    for &(coefficient, exponents) in terms {
        let mut n = [0; 3];
        order.iter().zip(exponents).for_each(|(&place, exponent)| n[place] = exponent);
        let term = |n: [i32; 3]| (0..3).map(|i| power(at[i], n[i])).product::<f64>();
        value += coefficient * term(n);
        for i in (0..3).filter(|&i| n[i] > 0) {
            let mut once = n;
            once[i] -= 1;
            gradient[i] += coefficient * f64::from(n[i]) * term(once);
            for j in (0..3).filter(|&j| once[j] > 0) {
                let mut twice = once;
                twice[j] -= 1;
                hessian[i][j] += coefficient * f64::from(n[i] * once[j]) * term(twice);
            }
        }
    }
    let second = |i: usize, j: usize| hessian[i][j] - hessian[0][j] - hessian[i][0] + hessian[0][0];
    [
        value,
        gradient[1] - gradient[0],
        gradient[2] - gradient[0],
        second(1, 1),
        second(1, 2),
        second(2, 2),
    ]
}
