//! Refines a polyline towards a smooth curve.

use maquette_node::{Context, Error, Estimate, In, Limit, Node, bail};
use maquette_value::Curve;
use nalgebra::{Point3, center};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Refines a polyline towards a smooth curve.
///
/// The ends of an open polyline do not move. The new points are in the order of the curve, beginning at the first point or edge.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct SubdivideCurve {
    /// Polyline to refine, open or closed.
    pub curve: In<Curve>,
    /// Subdivision scheme.
    pub scheme: CurveScheme,
    /// Number of refinement steps. Each step divides each edge in two.
    #[schemars(range(max = 16))]
    #[serde(default = "default_levels")]
    pub levels: u32,
}

fn default_levels() -> u32 {
    3
}

/// A subdivision scheme for curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurveScheme {
    /// Chaikin (1974): cuts corners. The limit is a quadratic B-spline that touches the midpoint of every edge.
    Chaikin,
    /// The limit is a cubic B-spline with continuous curvature.
    Cubic,
}

/// The maximum number of points of a refined curve. This many points need about 100 MB of memory.
const POINTS: Limit = Limit { max: 1 << 22, items: "points", help: "choose fewer `levels`" };

impl Node for SubdivideCurve {
    type Outputs = (Curve,);
    const OUTPUTS: [&'static str; 1] = ["curve"];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let bytes = points_after(cx.get(&self.curve), self.levels) * 40.0;
        Some(Estimate { bytes, help: POINTS.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((subdivide_curve(cx.get(&self.curve), self.scheme, self.levels)?,))
    }
}

/// Refines a polyline `levels` times.
///
/// `Chaikin` places `3/4 a + 1/4 b` and `1/4 a + 3/4 b` on each edge, so that n points become 2 n: Chaikin, "An algorithm for high-speed
/// curve generation", Computer Graphics and Image Processing 3 (1974). `Cubic` moves each point `b` with the neighbors `a`, `c` to
/// `1/8 a + 3/4 b + 1/8 c` and adds the midpoint of each edge, so that n points become 2 n, or 2 n - 1 in an open curve: Lane and
/// Riesenfeld, "A theoretical development for the computer generation and display of piecewise polynomial surfaces" (1980).
///
/// # Errors
/// If the curve is a B-spline or the result would be too large.
pub fn subdivide_curve(curve: &Curve, scheme: CurveScheme, levels: u32) -> Result<Curve, Error> {
    if curve.knots().is_some() {
        bail!("the curve is a B-spline and smooth already; only polylines are refined");
    }
    let need = points_after(curve, levels);
    POINTS.check(format_args!("a curve of {levels} levels more"), need)?;
    let mut refined = curve.points().to_vec();
    for _ in 0..levels {
        refined = match scheme {
            CurveScheme::Chaikin => cut_corners(&refined, curve.is_closed()),
            CurveScheme::Cubic => smooth(&refined, curve.is_closed()),
        };
    }
    Ok(Curve::polyline(refined, curve.is_closed())?)
}

/// The number of points that a curve has after `levels` refinement steps.
fn points_after(curve: &Curve, levels: u32) -> f64 {
    curve.points().len() as f64 * libm::exp2(f64::from(levels))
}

fn cut_corners(points: &[Point3<f64>], closed: bool) -> Vec<Point3<f64>> {
    let last = points.len() - 1;
    fn pair(a: Point3<f64>, b: Point3<f64>) -> [Point3<f64>; 2] {
        [a + (b - a) * 0.25, a + (b - a) * 0.75]
    }
    let inner = points.windows(2).flat_map(|edge| pair(edge[0], edge[1]));
    if closed {
        inner.chain(pair(points[last], points[0])).collect()
    } else {
        [points[0]].into_iter().chain(inner).chain([points[last]]).collect()
    }
}

fn smooth(points: &[Point3<f64>], closed: bool) -> Vec<Point3<f64>> {
    let count = points.len();
    let mut refined = Vec::with_capacity(2 * count);
    for (index, &point) in points.iter().enumerate() {
        let [before, after] = [(index + count - 1) % count, (index + 1) % count].map(|k| points[k]);
        let is_end = !closed && (index == 0 || index + 1 == count);
        let middle = center(&before, &after);
        refined.push(if is_end { point } else { point + (middle - point) * 0.25 });
        if closed || index + 1 < count {
            refined.push(center(&point, &after));
        }
    }
    refined
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[[f64; 2]], closed: bool) -> Curve {
        let points = points.iter().map(|&[x, y]| Point3::new(x, y, 0.0));
        Curve::polyline(points.collect::<Vec<_>>(), closed).unwrap()
    }

    fn refine_to_pairs(curve: &Curve, scheme: CurveScheme) -> Vec<[f64; 2]> {
        let refined = subdivide_curve(curve, scheme, 1).unwrap();
        refined.points().iter().map(|point| [point.x, point.y]).collect()
    }

    #[test]
    fn corners_are_cut_and_the_ends_of_an_open_curve_stay() {
        let corner = [[0., 0.], [4., 0.], [4., 4.]];
        assert_eq!(
            refine_to_pairs(&curve(&corner, false), CurveScheme::Chaikin),
            [[0., 0.], [1., 0.], [3., 0.], [4., 1.], [4., 3.], [4., 4.]]
        );
        assert_eq!(
            refine_to_pairs(&curve(&corner, true), CurveScheme::Chaikin),
            [[1., 0.], [3., 0.], [4., 1.], [4., 3.], [3., 3.], [1., 1.]]
        );
    }

    #[test]
    fn the_cubic_rule_moves_points_and_adds_the_middles() {
        let corner = [[0., 0.], [4., 0.], [4., 4.]];
        assert_eq!(
            refine_to_pairs(&curve(&corner, false), CurveScheme::Cubic),
            [[0., 0.], [2., 0.], [3.5, 0.5], [4., 2.], [4., 4.]]
        );
        assert_eq!(
            refine_to_pairs(&curve(&corner, true), CurveScheme::Cubic),
            [[1., 0.5], [2., 0.], [3.5, 0.5], [4., 2.], [3.5, 3.], [2., 2.]]
        );
    }

    #[test]
    fn invalid_input_is_an_error() {
        let ring = curve(&[[0., 0.], [4., 0.], [4., 4.]], true);
        let error = subdivide_curve(&ring, CurveScheme::Cubic, 30).unwrap_err();
        assert_eq!(
            error.to_string(),
            "a curve of 30 levels more would need about 3 200 000 000 points, at most 4 200 000 are made: choose fewer `levels`"
        );
        assert!(subdivide_curve(&ring, CurveScheme::Cubic, u32::MAX).is_err());
        let knots = maquette_value::KnotVector::uniform(3, 3).unwrap();
        let spline = Curve::rational(ring.points().to_vec(), vec![1.0; 3], knots).unwrap();
        let error = subdivide_curve(&spline, CurveScheme::Cubic, 1).unwrap_err();
        let expected = "the curve is a B-spline and smooth already; only polylines are refined";
        assert_eq!(error.to_string(), expected);
    }
}
