//! The same surface on other knots: refined, of a higher degree, in parts; and its lines of one constant parameter.

use nalgebra::{Point3, Vector4};

use super::super::{Chart, ControlNet, KnotChange, KnotVector, KnotVectorError};
use super::{Along, Surface};

/// A line of a surface on which one parameter is constant: a rational B-spline curve.
#[derive(Clone, Debug, PartialEq)]
pub struct IsoCurve {
    /// Its knots, those of the surface along the line.
    pub knots: KnotVector,
    /// Its control points.
    pub points: Vec<Point3<f64>>,
    /// Their weights.
    pub weights: Vec<f64>,
}

impl Surface {
    /// The knots along one direction.
    pub fn knots(&self, along: Along) -> &KnotVector {
        match along {
            Along::U => &self.u,
            Along::V => &self.v,
        }
    }

    /// The same surface with one more knot along a direction, repeated `times`: Boehm's insertion.
    ///
    /// # Errors
    /// If `at` is not inside the domain, or the knot would be there more than degree times.
    pub fn insert_knot(
        &self,
        along: Along,
        at: f64,
        times: usize,
    ) -> Result<Self, KnotVectorError> {
        Ok(self.changed(along, &self.knots(along).insert(at, times)?))
    }

    /// The same surface with all these knots added along a direction, in any order.
    ///
    /// # Errors
    /// If one is not inside the domain, or would be there more than degree times.
    pub fn refine(&self, along: Along, more: &[f64]) -> Result<Self, KnotVectorError> {
        Ok(self.changed(along, &self.knots(along).refine(more)?))
    }

    /// The same surface with pieces of a degree that is higher by one along a direction.
    ///
    /// # Errors
    /// If the degree is 9 already.
    pub fn elevate(&self, along: Along) -> Result<Self, KnotVectorError> {
        Ok(self.changed(along, &self.knots(along).elevate()?))
    }

    /// The parts of the surface before and after a parameter. Each keeps the cells of the chart that lie on it.
    ///
    /// # Errors
    /// If `at` is not inside the domain.
    pub fn split(&self, along: Along, at: f64) -> Result<[Self; 2], KnotVectorError> {
        Ok(self.knots(along).split(at)?.map(|part| self.changed(along, &part)))
    }

    /// The same surface of Bezier pieces: piece (k, l) has the rows `k p ..= (k + 1) p` and the columns `l q ..= (l + 1) q` of
    /// the new net.
    pub fn bezier(&self) -> Self {
        self.changed(Along::U, &self.u.bezier()).changed(Along::V, &self.v.bezier())
    }

    /// The line of the surface at the parameter `at` of a direction; it runs along the other one. `at` is clamped to the domain.
    pub fn iso_curve(&self, along: Along, at: f64) -> IsoCurve {
        let (across, other) = match along {
            Along::U => (&self.u, &self.v),
            Along::V => (&self.v, &self.u),
        };
        let basis = across.basis_derivative(at, 0);
        let factors = basis.values[..=across.degree()].iter().enumerate();
        let sources: Vec<_> = factors.map(|(k, &factor)| (basis.first + k, factor)).collect();
        let lines = Lines::new(&self.net, along);
        let points = |from: &[Point3<f64>]| -> Vec<(Point3<f64>, f64)> {
            (0..other.n_control()).map(|line| lines.mean(from, line, &sources)).collect()
        };
        let (points, weights) = points(self.net.points()).into_iter().unzip();
        IsoCurve { knots: other.clone(), points, weights }
    }

    /// The surface on changed knots. Base points change in the same way; a control point is fixed if all that it depends on are;
    /// cells of the chart keep their places on the surface.
    fn changed(&self, along: Along, change: &KnotChange) -> Self {
        let net = &self.net;
        let lines = Lines::new(net, along);
        let across = lines.count;
        let n_new = change.knots().n_control();
        let [rows, columns] = match along {
            Along::U => [n_new, across],
            Along::V => [across, n_new],
        };
        let sources: Vec<Vec<(usize, f64)>> =
            (0..n_new).map(|control| change.sources(control).collect()).collect();
        let place = |at: usize| match along {
            Along::U => (at % columns, &sources[at / columns]),
            Along::V => (at / columns, &sources[at % columns]),
        };
        let mean = |from: &[Point3<f64>]| -> (Vec<Point3<f64>>, Vec<f64>) {
            (0..rows * columns)
                .map(|at: usize| {
                    let (line, sources) = place(at);
                    lines.mean(from, line, sources)
                })
                .unzip()
        };
        let (points, weights) = mean(net.points());
        let (base, _) = mean(net.base());
        let fixed = (0..rows * columns)
            .map(|at: usize| {
                let (line, sources) = place(at);
                u8::from(sources.iter().all(|&(k, _)| net.fixed()[lines.at(line, k)] == 1))
            })
            .collect();
        let build = || {
            ControlNet::new(rows, columns, base)?
                .with_points(points)?
                .with_weights(weights)?
                .with_fixed(fixed)
        };
        let mut changed = build()
            .expect("means of finite points with finite weights are finite")
            .with_frame(net.frame().copied());
        if let Some(chart) = net.chart() {
            changed = changed.with_chart(moved_chart(chart, along, self.knots(along), change));
        }
        let knots = change.knots().clone();
        let [u, v] = match along {
            Along::U => [knots, self.v.clone()],
            Along::V => [self.u.clone(), knots],
        };
        Self::new(changed, u, v).expect("weights that are positive somewhere on a piece stay so")
    }
}

/// The lines of a net that run along a direction.
struct Lines<'a> {
    net: &'a ControlNet,
    along: Along,
    /// How many.
    count: usize,
}

impl<'a> Lines<'a> {
    fn new(net: &'a ControlNet, along: Along) -> Self {
        let count = match along {
            Along::U => net.columns(),
            Along::V => net.rows(),
        };
        Self { net, along, count }
    }

    /// The index in the net of the `k`-th point of a line.
    fn at(&self, line: usize, k: usize) -> usize {
        match self.along {
            Along::U => k * self.net.columns() + line,
            Along::V => line * self.net.columns() + k,
        }
    }

    /// The weighted mean of points of a line and its weight. Without any weight the plain mean, which no surface shows.
    fn mean(
        &self,
        from: &[Point3<f64>],
        line: usize,
        sources: &[(usize, f64)],
    ) -> (Point3<f64>, f64) {
        let mut sum = Vector4::zeros();
        let mut plain = Vector4::zeros();
        for &(k, factor) in sources {
            let at = self.at(line, k);
            let (point, weight) = (from[at].coords, self.net.weights()[at]);
            sum += (point * weight).push(weight) * factor;
            plain += point.push(1.0) * factor;
        }
        let of = if sum.w > 0.0 { sum } else { plain };
        let point = Point3::from(of.xyz() / of.w);
        // Of points near the largest number the weighted sum overflows, the mean does not.
        let finite = point.coords.iter().all(|x| x.is_finite());
        (if finite { point } else { from[self.at(line, sources[0].0)] }, sum.w)
    }
}

/// The chart of the changed net: each cell keeps its parameter; those beyond the new domain are left out.
fn moved_chart(chart: &Chart, along: Along, before: &KnotVector, change: &KnotChange) -> Chart {
    let axis = match along {
        Along::U => 0,
        Along::V => 1,
    };
    let (start, end) = change.knots().domain();
    let kept: Vec<_> = chart
        .cells
        .iter()
        .zip(chart.coordinates.iter())
        .filter_map(|(&cell, coordinate): (&u32, &[f64; 2])| {
            let at = before.parameter(coordinate[axis]);
            let mut coordinate = *coordinate;
            coordinate[axis] = change.knots().net_coordinate(at);
            (start <= at && at <= end).then_some((cell, coordinate))
        })
        .collect();
    Chart {
        grid: chart.grid,
        cells: kept.iter().map(|(cell, _)| *cell).collect(),
        coordinates: kept.iter().map(|(_, coordinate)| *coordinate).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate::tests::{samples, surface};
    use super::*;

    fn same(before: &Surface, after: &Surface) {
        for u in samples(after.u(), 13) {
            for v in samples(after.v(), 15) {
                let [old, new] = [before, after].map(|surface| surface.derivatives(u, v));
                assert!((old.point - new.point).norm() <= 1e-12, "({u}, {v})");
            }
        }
        // Between knots the derivatives are the same, too.
        for (u, v) in [(0.313, 0.771), (1.613, 2.237)] {
            let [old, new] = [before, after].map(|surface| surface.derivatives(u, v));
            for [old, new] in [[old.u, new.u], [old.v, new.v], [old.uv, new.uv]] {
                assert!((old - new).norm() <= 1e-10);
            }
        }
    }

    // On surfaces.
    #[test]
    fn refined_and_elevated_surfaces_are_the_same_surface() {
        for orders in [[2, 3], [4, 3], [3, 5]] {
            let before = surface(orders);
            for along in [Along::U, Along::V] {
                let times = before.knots(along).degree();
                same(&before, &before.insert_knot(along, 1.37, times).unwrap());
                same(&before, &before.refine(along, &[0.2, 2.2, 0.7, 0.2001]).unwrap());
                same(&before, &before.elevate(along).unwrap());
            }
            same(&before, &before.bezier());
            let pieces = before.bezier();
            fn whole(knots: &KnotVector) -> usize {
                (knots.n_control() - 1) % knots.degree()
            }
            assert_eq!([whole(pieces.u()), whole(pieces.v())], [0, 0]);
        }
    }

    #[test]
    fn the_parts_of_a_surface_meet() {
        let before = surface([4, 3]);
        let [left, right] = before.split(Along::V, 2.5).unwrap();
        for u in samples(before.u(), 9) {
            assert!((left.point(u, 2.5) - right.point(u, 2.5)).norm() <= 1e-12);
            assert!((left.point(u, 1.1) - before.point(u, 1.1)).norm() <= 1e-12);
            assert!((right.point(u, 4.4) - before.point(u, 4.4)).norm() <= 1e-12);
        }
        assert_eq!(left.point(0.3, 2.6), left.point(0.3, 2.5));
        assert!(before.split(Along::U, 0.0).is_err());
    }

    #[test]
    fn an_iso_curve_is_a_line_of_the_surface() {
        let surface = surface([4, 3]);
        for (along, at) in [(Along::U, 1.7), (Along::V, 0.0), (Along::V, 3.9)] {
            let curve = surface.iso_curve(along, at);
            for t in samples(&curve.knots, 20) {
                let (first, basis) = curve.knots.basis(t);
                let mut sum = Vector4::zeros();
                for (k, factor) in (first..).zip(basis) {
                    let weight = curve.weights[k];
                    sum += (curve.points[k].coords * weight).push(weight) * factor;
                }
                let expected = match along {
                    Along::U => surface.point(at, t),
                    Along::V => surface.point(t, at),
                };
                assert!((Point3::from(sum.xyz() / sum.w) - expected).norm() <= 1e-12);
            }
        }
    }

    #[test]
    fn cells_fixed_points_and_base_stay_where_they_are() {
        let before = surface([3, 3]);
        let chart = Chart {
            grid: [4, 1],
            cells: vec![0, 1, 2, 3].into(),
            coordinates: vec![[0.0, 0.0], [2.3, 4.0], [6.0, 7.5], [7.0, 8.0]].into(),
        };
        let fixed = (0..72).map(|k| u8::from(k / 9 < 3)).collect();
        let raised: Vec<_> = before.net().points().iter().map(|p| p + p.coords).collect();
        let net = before.net().clone().with_points(raised).unwrap();
        let net = net.with_chart(chart.clone()).with_fixed(fixed).unwrap();
        let before = Surface::new(net, before.u().clone(), before.v().clone()).unwrap();
        let after = before.refine(Along::U, &[1.5, 2.5]).unwrap();
        let after_chart = after.net().chart().unwrap();
        assert_eq!(after_chart.cells, chart.cells);
        for k in 0..4 {
            let [old, new] = [
                before.parameters(chart.coordinates[k]),
                after.parameters(after_chart.coordinates[k]),
            ];
            assert!((old[0] - new[0]).abs() <= 1e-12 && (old[1] - new[1]).abs() <= 1e-12);
        }
        fn on_base(surface: &Surface) -> Point3<f64> {
            let net = surface.net().clone().with_points(surface.net().base().to_vec()).unwrap();
            Surface::new(net, surface.u().clone(), surface.v().clone()).unwrap().point(1.9, 2.2)
        }
        assert!((on_base(&before) - on_base(&after)).norm() <= 1e-12);
        assert_eq!((after.net().fixed()[9 * 2], after.net().fixed()[9 * 4]), (1, 0));
        let [_, last] = before.split(Along::U, 3.0).unwrap();
        assert_eq!(*last.net().chart().unwrap().cells, [2, 3]);
    }
}
