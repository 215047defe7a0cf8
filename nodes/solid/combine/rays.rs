//! Intersections of triangles with rays along a coordinate axis, in double precision.

/// How a ray passes a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hit {
    None,
    /// The ray passes too close to an edge, or begins too close to the triangle, for double precision.
    Unclear,
    /// The ray passes from the front of the triangle to its back.
    Enters,
    /// The ray passes from the back of the triangle to its front.
    Leaves,
}

/// Barycentric weights of the points of a triangle from which rays start. The next point is used if a ray is unclear.
pub(super) const STARTS: [[f64; 3]; 6] = [
    [0.3333, 0.3333, 0.3334],
    [0.41, 0.27, 0.32],
    [0.23, 0.45, 0.32],
    [0.29, 0.18, 0.53],
    [0.51, 0.31, 0.18],
    [0.13, 0.37, 0.50],
];

/// Intersects a triangle with a ray in the positive direction of an axis. `near` is the distance below which the ray begins too close to
/// the triangle.
pub(super) fn hit(corners: [[f64; 3]; 3], from: [f64; 3], axis: usize, near: f64) -> Hit {
    let [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
    let offset = corners.map(|corner| [0, 1, 2].map(|k| corner[k] - from[k]));
    let areas = [[1, 2], [2, 0], [0, 1]].map(|[a, b]: [usize; 2]| {
        let [left, right] = [offset[a][i] * offset[b][j], offset[a][j] * offset[b][i]];
        (left - right, 1e-14 * (left.abs() + right.abs()))
    });
    fn is_in(sign: f64, areas: &[(f64, f64); 3]) -> bool {
        areas.iter().all(|(area, error)| *error < area * sign)
    }
    fn is_out(sign: f64, areas: &[(f64, f64); 3]) -> bool {
        areas.iter().any(|(area, error)| area * sign < -error)
    }
    if is_out(1.0, &areas) && is_out(-1.0, &areas) {
        return Hit::None;
    }
    let sum: f64 = areas.iter().map(|it| it.0).sum();
    let along = (0..3).map(|k| areas[k].0 * offset[k][axis]).sum::<f64>() / sum;
    match along {
        // A triangle without an area in the projection is not hit, and one that is behind the ray neither.
        _ if (0..3).all(|k| offset[k][axis] < -near) || areas.iter().all(|it| it.0 == 0.0) => {
            Hit::None
        }
        _ if !is_in(1.0, &areas) && !is_in(-1.0, &areas) || along.abs() < near => Hit::Unclear,
        _ if along < 0.0 => Hit::None,
        _ if 0.0 < sum => Hit::Leaves,
        _ => Hit::Enters,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_enters_the_front_and_leaves_the_back() {
        let triangle = [[0., 0., 2.], [4., 0., 2.], [0., 4., 2.]];
        let turned = [triangle[0], triangle[2], triangle[1]];
        assert_eq!(hit(triangle, [1., 1., 0.], 2, 1e-9), Hit::Leaves);
        assert_eq!(hit(turned, [1., 1., 0.], 2, 1e-9), Hit::Enters);
        assert_eq!(hit(triangle, [1., 1., 3.], 2, 1e-9), Hit::None);
        assert_eq!(hit(triangle, [3., 3., 0.], 2, 1e-9), Hit::None);
        assert_eq!(hit(triangle, [2., 2., 0.], 2, 1e-9), Hit::Unclear);
        assert_eq!(hit(triangle, [1., 1., 2.], 2, 1e-9), Hit::Unclear);
        assert_eq!(hit(triangle, [1., 0.5, 2.], 0, 1e-9), Hit::None);
    }
}
