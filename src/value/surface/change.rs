//! Conversion of surfaces to other knots: refinement, degree elevation and splitting. Also the curves of constant parameter on a surface.

use nalgebra::{Point3, Vector4};

use super::super::{Chart, ControlNet, KnotChange, KnotVector, KnotVectorError};
use super::{ParameterDirection, Surface};

/// A curve on a surface along which one parameter is constant. It is a rational B-spline curve.
#[derive(Clone, Debug, PartialEq)]
pub struct IsoCurve {
    /// The knots, which are those of the surface in the direction of the curve.
    pub knots: KnotVector,
    /// The control points of the curve.
    pub points: Vec<Point3<f64>>,
    /// The weights of the control points.
    pub weights: Vec<f64>,
}

impl Surface {
    /// The knot vector for a direction.
    pub fn knots(&self, along: ParameterDirection) -> &KnotVector {
        match along {
            ParameterDirection::U => &self.u,
            ParameterDirection::V => &self.v,
        }
    }

    /// Inserts a knot in a direction, with the given number of repetitions, `times`: Boehm's insertion.
    ///
    /// # Errors
    /// If `at` is not inside the domain, or the knot's multiplicity would exceed the degree.
    pub fn insert_knot(
        &self,
        along: ParameterDirection,
        at: f64,
        times: usize,
    ) -> Result<Self, KnotVectorError> {
        Ok(self.with_knots(along, &self.knots(along).insert(at, times)?))
    }

    /// Inserts all knots of the list in a direction, in any order.
    ///
    /// # Errors
    /// If a knot is not inside the domain, or its multiplicity would exceed the degree.
    pub fn refine(&self, along: ParameterDirection, more: &[f64]) -> Result<Self, KnotVectorError> {
        Ok(self.with_knots(along, &self.knots(along).refine(more)?))
    }

    /// Raises the degree in a direction by one.
    ///
    /// # Errors
    /// If the degree is already 9.
    pub fn elevate(&self, along: ParameterDirection) -> Result<Self, KnotVectorError> {
        Ok(self.with_knots(along, &self.knots(along).elevate()?))
    }

    /// Splits the surface at a parameter. Each part keeps those cells of the chart that are on it.
    ///
    /// # Errors
    /// If `at` is not inside the domain.
    pub fn split(&self, along: ParameterDirection, at: f64) -> Result<[Self; 2], KnotVectorError> {
        Ok(self.knots(along).split(at)?.map(|part| self.with_knots(along, &part)))
    }

    /// Converts the surface to Bezier pieces. Piece (k, l) has the rows `k p ..= (k + 1) p` and the columns `l q ..= (l + 1) q` of the new
    /// net, where p and q are the degrees.
    pub fn bezier(&self) -> Self {
        self.with_knots(ParameterDirection::U, &self.u.bezier())
            .with_knots(ParameterDirection::V, &self.v.bezier())
    }

    /// The curve on the surface where the parameter in the direction `along` is constantly `at`. The curve runs in the other direction.
    /// `at` is clamped to the domain.
    pub fn iso_curve(&self, along: ParameterDirection, at: f64) -> IsoCurve {
        let (across, other) = match along {
            ParameterDirection::U => (&self.u, &self.v),
            ParameterDirection::V => (&self.v, &self.u),
        };
        let basis = across.basis_derivative(at, 0);
        let factors = basis.values[..=across.degree()].iter().enumerate();
        let sources: Vec<_> = factors.map(|(k, &factor)| (basis.first + k, factor)).collect();
        let lines = Lines::new(&self.net, along);
        let (points, weights) = (0..other.n_control())
            .map(|line| lines.mean(self.net.points(), line, &sources))
            .unzip();
        IsoCurve { knots: other.clone(), points, weights }
    }

    /// Converts the surface to other knots. Base points are converted like points. A new control point is fixed if all points on which it
    /// depends are fixed. Cells of the chart keep their positions on the surface.
    fn with_knots(&self, along: ParameterDirection, change: &KnotChange) -> Self {
        let net = &self.net;
        let lines = Lines::new(net, along);
        let across = lines.count;
        let n_new = change.knots().n_control();
        let [rows, columns] = match along {
            ParameterDirection::U => [n_new, across],
            ParameterDirection::V => [across, n_new],
        };
        let sources: Vec<Vec<(usize, f64)>> =
            (0..n_new).map(|control| change.sources(control).collect()).collect();
        let line_and_sources = |at: usize| match along {
            ParameterDirection::U => (at % columns, &sources[at / columns]),
            ParameterDirection::V => (at / columns, &sources[at % columns]),
        };
        let mean = |from: &[Point3<f64>]| -> (Vec<Point3<f64>>, Vec<f64>) {
            (0..rows * columns)
                .map(|at: usize| {
                    let (line, sources) = line_and_sources(at);
                    lines.mean(from, line, sources)
                })
                .unzip()
        };
        let (points, weights) = mean(net.points());
        let (base, _) = mean(net.base());
        let fixed = (0..rows * columns)
            .map(|at: usize| {
                let (line, sources) = line_and_sources(at);
                u8::from(
                    sources.iter().all(|&(k, _)| net.fixed_points()[lines.index(line, k)] == 1),
                )
            })
            .collect();
        let mut changed = ControlNet::new(rows, columns, base)
            .and_then(|net| net.with_points(points)?.with_weights(weights)?.with_fixed(fixed))
            .expect("means of finite points with finite weights are finite")
            .with_frame(net.frame().copied());
        if let Some(chart) = net.chart() {
            changed = changed.with_chart(moved_chart(chart, along, self.knots(along), change));
        }
        let knots = change.knots().clone();
        let [u, v] = match along {
            ParameterDirection::U => [knots, self.v.clone()],
            ParameterDirection::V => [self.u.clone(), knots],
        };
        Self::new(changed, u, v).expect("weights that are positive somewhere on a piece stay so")
    }
}

/// The lines (rows or columns) of a net that run along a direction.
struct Lines<'a> {
    net: &'a ControlNet,
    along: ParameterDirection,
    /// The number of lines in the net.
    count: usize,
}

impl<'a> Lines<'a> {
    fn new(net: &'a ControlNet, along: ParameterDirection) -> Self {
        let count = match along {
            ParameterDirection::U => net.columns(),
            ParameterDirection::V => net.rows(),
        };
        Self { net, along, count }
    }

    /// The index in the net of the `k`-th point of a line.
    fn index(&self, line: usize, k: usize) -> usize {
        match self.along {
            ParameterDirection::U => k * self.net.columns() + line,
            ParameterDirection::V => line * self.net.columns() + k,
        }
    }

    /// The weighted mean of points of a line, and its weight. If all weights are 0, the unweighted mean is used, which does not affect the
    /// surface.
    fn mean(
        &self,
        from: &[Point3<f64>],
        line: usize,
        sources: &[(usize, f64)],
    ) -> (Point3<f64>, f64) {
        let mut sum = Vector4::zeros();
        let mut plain = Vector4::zeros();
        for &(k, factor) in sources {
            let at = self.index(line, k);
            let (point, weight) = (from[at].coords, self.net.weights()[at]);
            sum += (point * weight).push(weight) * factor;
            plain += point.push(1.0) * factor;
        }
        let of = if sum.w > 0.0 { sum } else { plain };
        let point = Point3::from(of.xyz() / of.w);
        // If points are close to the maximum of `f64`, the weighted sum overflows. Use the first of the points then.
        let finite = point.coords.iter().all(|x| x.is_finite());
        (if finite { point } else { from[self.index(line, sources[0].0)] }, sum.w)
    }
}

/// Converts the chart. Each cell keeps its parameters (u, v); cells outside of the new domain are removed.
fn moved_chart(
    chart: &Chart,
    along: ParameterDirection,
    before: &KnotVector,
    change: &KnotChange,
) -> Chart {
    let axis = match along {
        ParameterDirection::U => 0,
        ParameterDirection::V => 1,
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

    fn check_same_surface(before: &Surface, after: &Surface) {
        for u in samples(after.u(), 13) {
            for v in samples(after.v(), 15) {
                let [old, new] = [before, after].map(|surface| surface.derivatives(u, v));
                assert!((old.point - new.point).norm() <= 1e-12, "({u}, {v})");
            }
        }
        // Between knots, the derivatives of the two surfaces are equal, too.
        for (u, v) in [(0.313, 0.771), (1.613, 2.237)] {
            let [old, new] = [before, after].map(|surface| surface.derivatives(u, v));
            for [old, new] in [[old.u, new.u], [old.v, new.v], [old.uv, new.uv]] {
                assert!((old - new).norm() <= 1e-10);
            }
        }
    }

    #[test]
    fn refined_and_elevated_surfaces_are_the_same_surface() {
        for orders in [[2, 3], [4, 3], [3, 5]] {
            let before = surface(orders);
            for along in [ParameterDirection::U, ParameterDirection::V] {
                let times = before.knots(along).degree();
                check_same_surface(&before, &before.insert_knot(along, 1.37, times).unwrap());
                check_same_surface(
                    &before,
                    &before.refine(along, &[0.2, 2.2, 0.7, 0.2001]).unwrap(),
                );
                check_same_surface(&before, &before.elevate(along).unwrap());
            }
            check_same_surface(&before, &before.bezier());
            let pieces = before.bezier();
            fn repeated_inner_knots(knots: &KnotVector) -> usize {
                (knots.n_control() - 1) % knots.degree()
            }
            assert_eq!(
                [repeated_inner_knots(pieces.u()), repeated_inner_knots(pieces.v())],
                [0, 0]
            );
        }
    }

    #[test]
    fn the_parts_of_a_surface_meet() {
        let before = surface([4, 3]);
        let [left, right] = before.split(ParameterDirection::V, 2.5).unwrap();
        for u in samples(before.u(), 9) {
            assert!((left.point(u, 2.5) - right.point(u, 2.5)).norm() <= 1e-12);
            assert!((left.point(u, 1.1) - before.point(u, 1.1)).norm() <= 1e-12);
            assert!((right.point(u, 4.4) - before.point(u, 4.4)).norm() <= 1e-12);
        }
        assert_eq!(left.point(0.3, 2.6), left.point(0.3, 2.5));
        assert!(before.split(ParameterDirection::U, 0.0).is_err());
    }

    #[test]
    fn an_iso_curve_is_a_line_of_the_surface() {
        let surface = surface([4, 3]);
        for (along, at) in [
            (ParameterDirection::U, 1.7),
            (ParameterDirection::V, 0.0),
            (ParameterDirection::V, 3.9),
        ] {
            let curve = surface.iso_curve(along, at);
            for t in samples(&curve.knots, 20) {
                let (first, basis) = curve.knots.basis(t);
                let mut sum = Vector4::zeros();
                for (k, factor) in (first..).zip(basis) {
                    let weight = curve.weights[k];
                    sum += (curve.points[k].coords * weight).push(weight) * factor;
                }
                let expected = match along {
                    ParameterDirection::U => surface.point(at, t),
                    ParameterDirection::V => surface.point(t, at),
                };
                assert!((Point3::from(sum.xyz() / sum.w) - expected).norm() <= 1e-12);
            }
        }
    }

    #[test]
    fn refinement_keeps_cells_fixed_points_and_base() {
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
        let after = before.refine(ParameterDirection::U, &[1.5, 2.5]).unwrap();
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
        assert_eq!((after.net().fixed_points()[9 * 2], after.net().fixed_points()[9 * 4]), (1, 0));
        let [_, last] = before.split(ParameterDirection::U, 3.0).unwrap();
        assert_eq!(*last.net().chart().unwrap().cells, [2, 3]);
    }
}
