//! The points near to a place.
//!
//! Bentley, "Multidimensional binary search trees used for associative searching" (1975), halved along the longest side of each box; the
//! tree is the order of its points.

use std::ops::Range;

use nalgebra::Point3;

/// Points of a leaf.
const LEAF: usize = 8;

/// Points in the order of a tree: those of each branch stand side by side, halved in the middle.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    points: Vec<(Point3<f64>, u32)>,
    /// The axis along which each branch is halved, by the place of its middle.
    axes: Vec<u8>,
}

impl Tree {
    /// The tree of some points. Cost grows with n log n.
    pub fn new(points: &[Point3<f64>]) -> Self {
        let mut tree =
            Self { points: points.iter().copied().zip(0..).collect(), axes: vec![0; points.len()] };
        halve(&mut tree.points, &mut tree.axes);
        tree
    }

    /// The point that is nearest to a place and nearer than `reach`, with the square of its distance. Of several it is the first.
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

    /// The points that are nearer to a place than `reach`, ascending.
    pub fn within(&self, at: &Point3<f64>, reach: f64) -> Vec<u32> {
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

    /// The points, with their numbers, in such an order that neighbors in it are near each other.
    pub fn points(&self) -> &[(Point3<f64>, u32)] {
        &self.points
    }

    /// The squares of the distances to the `count` nearest points, ascending, in place of what is in `squares`; fewer if there are not so many.
    pub fn nearest_squares(&self, at: &Point3<f64>, count: usize, squares: &mut Vec<f64>) {
        squares.clear();
        let limit = if count == 0 { -1.0 } else { f64::INFINITY };
        self.visit(0..self.points.len(), at, limit, &mut |_, square| {
            let place = squares.iter().rposition(|known| *known <= square).map_or(0, |it| it + 1);
            if place < count {
                squares.truncate(count - 1);
                squares.insert(place, square);
            }
            if squares.len() < count { f64::INFINITY } else { squares[count - 1] }
        });
    }

    /// Shows `see` the points of a branch that may be nearer than the root of `limit`, the nearer half first, and says what the limit is
    /// then: what `see` said last.
    fn visit(
        &self,
        branch: Range<usize>,
        at: &Point3<f64>,
        limit: f64,
        see: &mut impl FnMut(u32, f64) -> f64,
    ) -> f64 {
        fn see_one(
            see: &mut dyn FnMut(u32, f64) -> f64,
            (point, index): &(Point3<f64>, u32),
            at: &Point3<f64>,
        ) -> f64 {
            see(*index, (point - at).norm_squared())
        }
        if branch.len() <= LEAF {
            return self.points[branch].iter().fold(limit, |_, point| see_one(see, point, at));
        }
        let middle = branch.start + branch.len() / 2;
        let axis = usize::from(self.axes[middle]);
        let off = at[axis] - self.points[middle].0[axis];
        let (low, high) = (branch.start..middle, middle + 1..branch.end);
        let (near, far) = if off < 0.0 { (low, high) } else { (high, low) };
        self.visit(near, at, limit, see);
        let limit = see_one(see, &self.points[middle], at);
        if off * off <= limit { self.visit(far, at, limit, see) } else { limit }
    }
}

fn halve(points: &mut [(Point3<f64>, u32)], axes: &mut [u8]) {
    if points.len() <= LEAF {
        return;
    }
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
    halve(low, low_axes);
    halve(&mut high[1..], &mut high_axes[1..]);
}

#[cfg(test)]
mod tests {
    use maquette_value::random::Random;

    use super::*;

    #[test]
    fn the_nearest_point_and_those_around_are_those_of_a_plain_search() {
        let mut random = Random(3);
        fn place(random: &mut Random) -> Point3<f64> {
            Point3::from([0; 3].map(|_| random.below(40) as f64))
        }
        let points: Vec<_> = (0..500).map(|_| place(&mut random)).collect();
        let tree = Tree::new(&points);
        for at in (0..300)
            .map(|_| place(&mut random) + nalgebra::Vector3::new(0.25, 0.0, -0.5))
            .collect::<Vec<_>>()
        {
            let all = || points.iter().map(|point| (point - at).norm_squared()).enumerate();
            for reach in [0.5, 3.0, 100.0] {
                let near = all().filter(|(_, d)| *d < reach * reach);
                let nearest = near.clone().min_by(|a, b| a.1.total_cmp(&b.1));
                assert_eq!(tree.nearest(&at, reach), nearest);
                let near: Vec<_> = near.map(|(point, _)| point as u32).collect();
                assert_eq!(tree.within(&at, reach), near);
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
