//! A k-d tree: finds the points near a position.
//!
//! Bentley, "Multidimensional binary search trees used for associative searching" (1975). Each box is split along its longest side. No
//! nodes are stored: the order of the points determines the tree.

use std::ops::Range;

use maquette_value::parallel::{check_stop, join};
use nalgebra::Point3;

/// The maximum number of points in a leaf of the tree, which is not split further.
const LEAF: usize = 8;

/// The minimum number of points of a branch that is built on a thread of its own: about 100 us.
const MIN_JOINED: usize = 1000;

/// Points in the order of the tree: the points of each branch are contiguous, and the branch is split at its middle point.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    points: Vec<(Point3<f64>, u32)>,
    /// For each branch the axis along which it is split, stored at the index of the branch's middle point.
    axes: Vec<u8>,
}

impl Tree {
    /// Builds the tree for some points in O(n log n).
    pub fn new(points: &[Point3<f64>]) -> Self {
        let mut tree =
            Self { points: points.iter().copied().zip(0..).collect(), axes: vec![0; points.len()] };
        halve(&mut tree.points, &mut tree.axes);
        tree
    }

    /// Returns the index of the point nearest to `at`, and its squared distance from `at`. Returns `None` if no point is less than `reach`
    /// away. Of several equally near points, the one with the lowest index is returned.
    pub fn nearest(&self, at: &Point3<f64>, reach: f64) -> Option<(usize, f64)> {
        let mut best = (reach * reach, u32::MAX);
        self.visit(0..self.points.len(), at, best.0, &mut |point, square| {
            if square < best.0 || (square == best.0 && best.1 != u32::MAX && point < best.1) {
                best = (square, point);
            }
            best.0
        });
        (best.1 != u32::MAX).then_some((best.1 as usize, best.0))
    }

    /// Returns the indices of the points that are less than `reach` away from `at`, ascending.
    pub fn points_within(&self, at: &Point3<f64>, reach: f64) -> Vec<u32> {
        let (mut found, square) = (Vec::new(), reach * reach);
        self.visit(0..self.points.len(), at, square, &mut |point, distance| {
            if distance < square {
                found.push(point);
            }
            square
        });
        found.sort_unstable();
        found
    }

    /// The points with their indices, in the order of the tree: points near each other in the list are near each other in space.
    pub fn points(&self) -> &[(Point3<f64>, u32)] {
        &self.points
    }

    /// Replaces the contents of `squares` by the squared distances from `at` to its `count` nearest points, ascending. The list is shorter
    /// if the tree has fewer points.
    pub fn nearest_squares(&self, at: &Point3<f64>, count: usize, squares: &mut Vec<f64>) {
        squares.clear();
        let limit = if count == 0 { -1.0 } else { f64::INFINITY };
        self.visit(0..self.points.len(), at, limit, &mut |_, square| {
            let index = squares.iter().rposition(|known| *known <= square).map_or(0, |it| it + 1);
            if index < count {
                squares.truncate(count - 1);
                squares.insert(index, square);
            }
            if squares.len() < count { f64::INFINITY } else { squares[count - 1] }
        });
    }

    /// Calls `see` with each point of a branch whose squared distance from `at` may be less than `limit`; the nearer half of the branch is
    /// visited first. `see` returns the new limit. Returns the last limit.
    fn visit(
        &self,
        branch: Range<usize>,
        at: &Point3<f64>,
        limit: f64,
        see: &mut impl FnMut(u32, f64) -> f64,
    ) -> f64 {
        if branch.len() <= LEAF {
            return self.points[branch]
                .iter()
                .fold(limit, |_, (point, index)| see(*index, (point - at).norm_squared()));
        }
        let middle = branch.start + branch.len() / 2;
        let axis = usize::from(self.axes[middle]);
        let off = at[axis] - self.points[middle].0[axis];
        let (low, high) = (branch.start..middle, middle + 1..branch.end);
        let (near, far) = if off < 0.0 { (low, high) } else { (high, low) };
        self.visit(near, at, limit, see);
        let (point, index) = self.points[middle];
        let limit = see(index, (point - at).norm_squared());
        if off * off <= limit { self.visit(far, at, limit, see) } else { limit }
    }
}

fn halve(points: &mut [(Point3<f64>, u32)], axes: &mut [u8]) {
    if points.len() <= LEAF {
        return;
    }
    check_stop();
    let first = points[0].0;
    let (low, high) = points
        .iter()
        .fold((first, first), |(low, high), (point, _)| (low.inf(point), high.sup(point)));
    let axis = (high - low).imax();
    let middle = points.len() / 2;
    points
        .select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    axes[middle] = axis as u8;
    let (low, high) = points.split_at_mut(middle);
    let (low_axes, high_axes) = axes.split_at_mut(middle);
    let (high, high_axes) = (&mut high[1..], &mut high_axes[1..]);
    if low.len() < MIN_JOINED {
        halve(low, low_axes);
        halve(high, high_axes);
    } else {
        join(|| halve(low, low_axes), || halve(high, high_axes));
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::rng::Random;

    use super::*;

    #[test]
    fn results_equal_those_of_a_linear_search() {
        let mut random = Random(3);
        fn random_point(random: &mut Random) -> Point3<f64> {
            Point3::from([0; 3].map(|_| random.next_below(40) as f64))
        }
        let points: Vec<_> = (0..500).map(|_| random_point(&mut random)).collect();
        let tree = Tree::new(&points);
        for at in (0..300)
            .map(|_| random_point(&mut random) + nalgebra::Vector3::new(0.25, 0.0, -0.5))
            .collect::<Vec<_>>()
        {
            let all = || points.iter().map(|point| (point - at).norm_squared()).enumerate();
            for reach in [0.5, 3.0, 100.0] {
                let near = all().filter(|(_, d)| *d < reach * reach);
                let nearest = near.clone().min_by(|a, b| a.1.total_cmp(&b.1));
                assert_eq!(tree.nearest(&at, reach), nearest);
                let near: Vec<_> = near.map(|(point, _)| point as u32).collect();
                assert_eq!(tree.points_within(&at, reach), near);
            }
            let mut squares: Vec<_> = all().map(|(_, square)| square).collect();
            squares.sort_by(f64::total_cmp);
            let mut found = vec![7.0];
            for count in [1, 20, 600] {
                tree.nearest_squares(&at, count, &mut found);
                assert_eq!(found, squares[..count.min(500)]);
            }
        }
        assert_eq!(Tree::new(&[]).nearest(&Point3::origin(), 1.0), None);
    }
}
