//! The convex hull of points in a plane.

use maquette_value::parallel::StopFlag;

/// A convex polygon, given by its corners counter-clockwise.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Hull {
    corners: Vec<[f64; 2]>,
}

impl Hull {
    /// Computes the convex hull of some points: Andrew, "Another efficient algorithm for convex hulls in two dimensions" (1979).
    pub(super) fn new(mut points: Vec<[f64; 2]>) -> Self {
        let stop = StopFlag::current();
        points.sort_by(|a, b| {
            stop.check();
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
        });
        points.dedup();
        fn chain(points: &mut dyn Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
            let mut chain: Vec<[f64; 2]> = Vec::new();
            for point in points {
                while let [.., a, b] = chain[..]
                    && doubled_area(a, b, point) <= 0.0
                {
                    chain.pop();
                }
                chain.push(point);
            }
            // Remove the last corner of this chain, which is also the first corner of the other chain.
            chain.pop();
            chain
        }
        let mut corners = chain(&mut points.iter().copied());
        corners.extend(chain(&mut points.iter().rev().copied()));
        Self { corners }
    }

    /// Returns true if a point is inside the hull and at least `inset` away from its boundary.
    pub(super) fn contains(&self, point: [f64; 2], inset: f64) -> bool {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.len() > 2
            && self.corners.iter().zip(next).all(|(&a, &b): (&[f64; 2], &[f64; 2])| {
                let length = libm::hypot(b[0] - a[0], b[1] - a[1]);
                doubled_area(a, b, point) >= inset * length
            })
    }

    /// Returns the corners of the bounding rectangle, counter-clockwise. For an empty hull all four corners are the origin.
    pub(super) fn rectangle(&self) -> [[f64; 2]; 4] {
        let [(left, right), (bottom, top)] = [0, 1].map(|axis| {
            let along = self.corners.iter().map(|corner| corner[axis]);
            (along.clone().reduce(f64::min).unwrap_or(0.0), along.reduce(f64::max).unwrap_or(0.0))
        });
        [[left, bottom], [right, bottom], [right, top], [left, top]]
    }
}

/// Returns twice the signed area of a triangle; positive if the triangle is counter-clockwise.
fn doubled_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_has_only_the_corner_points() {
        let grid = (0..25).map(|k| [f64::from(k % 5), f64::from(k / 5)]);
        let hull = Hull::new(grid.collect());
        assert_eq!(hull.corners, [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        assert!(hull.contains([2.0, 4.0], 0.0) && hull.contains([0.0, 0.0], 0.0));
        assert!(!hull.contains([2.0, 4.1], 0.0) && !hull.contains([-0.1, 2.0], 0.0));
        assert!(hull.contains([1.0, 3.0], 1.0) && !hull.contains([0.9, 3.0], 1.0));
        assert_eq!(hull.rectangle(), [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
    }

    #[test]
    fn a_hull_without_area_contains_nothing() {
        assert!(!Hull::new(vec![[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]).contains([1.0, 1.0], 0.0));
        assert!(!Hull::new(Vec::new()).contains([0.0, 0.0], 0.0));
    }
}
