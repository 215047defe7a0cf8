//! Fits a B-spline surface to a net of points.

use maquette_node::{Context, Error, In, Node, Progress};
use maquette_value as value;
use maquette_value::{Chart, ParameterDirection, Surface, Trace};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fit::fit_net::{Direction, fit_points, trace};
use super::fit_method::FitMethod;
use super::fit_parameters::FitParameters;

/// Fits a B-spline surface to the points of a net: unlike `Nurbs`, whose surface only follows its control points, it passes through the
/// points or near them.
///
/// If the net has a chart (a net coordinate for each range cell of its region), so has the surface, and `Blend` can write it back. The
/// surface has no weights.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FitSurface {
    /// The points to fit, row by row.
    pub net: In<value::ControlNet>,
    /// Orders along u and v, the degrees plus one: 2 is linear, 3 quadratic, 4 cubic.
    #[schemars(inner(range(min = 2, max = 10)))]
    #[serde(default = "default_orders")]
    pub order: [usize; 2],
    /// Method of the fit.
    #[serde(default)]
    pub method: FitMethod,
    /// Parameters of the points.
    #[serde(default)]
    pub parameters: FitParameters,
}

fn default_orders() -> [usize; 2] {
    [3, 3]
}

/// A surface fitted to points.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSurface {
    /// The fitted surface.
    pub surface: Surface,
    /// Largest step in mm of a control point in the last round of an iteration that did not converge; 0 if all iterations converged.
    pub unsettled: f64,
    /// The residuals, in mm, before each round of an iteration. First come the distances between the points and the curves along u, then
    /// those between the control points of these curves and the curves along v. The last entry, for all methods, is the residual of the
    /// surface.
    pub trace: Trace,
}

impl Node for FitSurface {
    type Outputs = (Surface, Trace);
    const OUTPUTS: [&'static str; 2] = ["surface", "trace"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let net = cx.get(&self.net);
        if net.weights().windows(2).any(|pair| pair[0] != pair[1]) {
            cx.warn("the weights of the net are not used: a fitted surface has none");
        }
        let fitted = fit_surface(net, self.order, self.method, self.parameters, cx.progress())?;
        if fitted.unsettled > 0.0 {
            cx.warn(format!(
                "the iteration has not settled: its last round moved a control point by {:.3e} mm",
                fitted.unsettled
            ));
        }
        Ok((fitted.surface, fitted.trace))
    }
}

/// Fits a B-spline surface of the given order to the points of a net. Its weights are 1, and its domain is 0 to 1 in both directions.
///
/// First the lines of the net along u are fitted, all with the same parameters, and then the resulting control points along v: Piegl and
/// Tiller, *The NURBS Book*, 2nd ed. (1997), algorithms A9.4 and A9.7. The base points are fitted in the same way, so that the surface
/// before an offset is known, too. With as many control points as points, the fixed points of the net stay marked.
///
/// # Errors
/// Returns an error if there are fewer points or control points than the order, more control points than points, or coincident points that
/// leave the surface undetermined.
pub fn fit_surface(
    net: &value::ControlNet,
    order: [usize; 2],
    method: FitMethod,
    kind: FitParameters,
    progress: &Progress<'_>,
) -> Result<FittedSurface, Error> {
    let counts = match method {
        FitMethod::Interpolate => [0, 0],
        FitMethod::LeastSquares { rows, columns } | FitMethod::Lspia { rows, columns, .. } => {
            [rows, columns]
        }
    };
    let u = Direction::new(net, ParameterDirection::U, order, counts, method, kind)?;
    let v = Direction::new(net, ParameterDirection::V, order, counts, method, kind)?;
    let fit = fit_points(net.points(), net, &u, &v, progress)?;
    let base = match net.base() == net.points() {
        true => None,
        false => Some(fit_points(net.base(), net, &u, &v, progress)?),
    };
    let unsettled = base.as_ref().map_or(0.0, |base| base.unsettled).max(fit.unsettled);
    let base = base.map_or_else(|| fit.points.clone(), |base| base.points);
    let [rows, columns] = [&u, &v].map(|direction| direction.fit.knots().n_control());
    let mut fitted = value::ControlNet::new(rows, columns, base)?
        .with_points(fit.points)?
        .with_frame(net.frame().copied());
    if [rows, columns] == [net.rows(), net.columns()] {
        fitted = fitted.with_fixed(net.fixed_points().to_vec())?;
    }
    if let Some(chart) = net.chart() {
        let coordinates =
            chart.coordinates.iter().map(|&[a, b]| [u.coordinate(a), v.coordinate(b)]).collect();
        fitted = fitted.with_chart(Chart { coordinates, ..chart.clone() });
    }
    fn knots(direction: &Direction) -> maquette_value::KnotVector {
        direction.fit.knots().clone()
    }
    let surface = Surface::new(fitted, knots(&u), knots(&v))?;
    let trace = trace(fit.rounds, net, &surface, &u, &v)?;
    Ok(FittedSurface { surface, unsettled, trace })
}

#[cfg(test)]
mod tests {
    use maquette_base::parameters::{parameters, uniform_parameters};
    use nalgebra::Point3;

    use super::super::blend::blend;
    use super::super::control_net::tests::{range, region};
    use super::super::control_net::{NetMethod, control_net};
    use super::*;
    use crate::blend_mode::BlendMode;

    const ALL_PARAMETERS: [FitParameters; 3] =
        [FitParameters::Uniform, FitParameters::Chord, FitParameters::Centripetal];

    /// Returns a net of unevenly spaced points on a wavy surface.
    fn waves(rows: usize, columns: usize) -> value::ControlNet {
        value::ControlNet::new(
            rows,
            columns,
            (0..rows * columns)
                .map(|k: usize| {
                    let (a, b) = ((k / columns) as f64, (k % columns) as f64);
                    let (y, x) = (a + 0.3 * libm::sin(2.0 * a), b + 0.1 * b * b);
                    Point3::new(x, y, libm::sin(0.7 * x) * libm::cos(0.9 * y))
                })
                .collect::<Vec<_>>(),
        )
        .unwrap()
    }

    fn at_point(
        net: &value::ControlNet,
        kind: FitParameters,
        along: ParameterDirection,
    ) -> Vec<f64> {
        match kind {
            FitParameters::Uniform => uniform_parameters(if along == ParameterDirection::U {
                net.rows()
            } else {
                net.columns()
            }),
            FitParameters::Chord => parameters(net, along, |distance| distance),
            FitParameters::Centripetal => parameters(net, along, f64::sqrt),
        }
    }

    #[test]
    fn an_interpolating_surface_goes_through_all_points() {
        let net = waves(9, 11);
        for order in [[2, 3], [3, 3], [4, 5]] {
            for kind in ALL_PARAMETERS {
                let surface =
                    fit_surface(&net, order, FitMethod::Interpolate, kind, &Progress::silent())
                        .unwrap()
                        .surface;
                let (us, vs) = (
                    at_point(&net, kind, ParameterDirection::U),
                    at_point(&net, kind, ParameterDirection::V),
                );
                for (point, met) in net.points().iter().zip(surface.grid(&us, &vs)) {
                    assert!((point - met).norm() <= 1e-11, "{order:?} {kind:?}");
                }
            }
        }
    }

    #[test]
    fn an_interpolated_scan_is_written_back_as_it_was() {
        let range = range(26, 22, |x, y| 700.0 + libm::sin(5.0 * x) * libm::cos(3.0 * y));
        let disk = region(&range, |x, y| x.abs_diff(12).pow(2) + y.abs_diff(11).pow(2) < 60);
        let net = control_net(&disk, &range, NetMethod::Grid, 0, 0, &Progress::silent()).unwrap();
        for kind in ALL_PARAMETERS {
            let surface =
                fit_surface(&net, [4, 4], FitMethod::Interpolate, kind, &Progress::silent())
                    .unwrap()
                    .surface;
            let same =
                blend(&range, &disk, &surface, BlendMode::Replace, [1, 1], &Progress::silent())
                    .unwrap();
            for (before, after) in range.points().iter().zip(same.range.points()) {
                assert!((before - after).norm() <= 1e-9, "{kind:?}: {before} {after}");
            }
        }
    }

    #[test]
    fn fewer_control_points_come_near_and_the_iteration_gets_there() {
        let net = waves(25, 31);
        fn fit(method: FitMethod, net: &maquette_value::ControlNet) -> FittedSurface {
            fit_surface(net, [4, 4], method, FitParameters::Chord, &Progress::silent()).unwrap()
        }
        let direct = fit(FitMethod::LeastSquares { rows: 12, columns: 14 }, &net);
        assert_eq!((direct.surface.net().rows(), direct.surface.net().columns()), (12, 14));
        let settled = fit(
            FitMethod::Lspia { rows: 12, columns: 14, iterations: 50_000, tolerance: 1e-12 },
            &net,
        );
        assert_eq!(settled.unsettled, 0.0);
        let (a, b) = (direct.surface.net().points(), settled.surface.net().points());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).norm() <= 1e-6));
        let stopped =
            fit(FitMethod::Lspia { rows: 12, columns: 14, iterations: 2, tolerance: 1e-12 }, &net);
        assert!(stopped.unsettled > 1e-4);
        let corners = [(0.0, 0.0, 0), (1.0, 1.0, 25 * 31 - 1), (0.0, 1.0, 30)];
        for (u, v, at) in corners {
            assert!((direct.surface.point(u, v) - net.points()[at]).norm() <= 1e-12);
        }
    }

    #[test]
    fn a_trace_falls_to_what_the_surface_misses() {
        let net = waves(25, 31);
        fn fit(method: FitMethod, net: &maquette_value::ControlNet) -> FittedSurface {
            fit_surface(net, [4, 4], method, FitParameters::Uniform, &Progress::silent()).unwrap()
        }
        let through = fit(FitMethod::Interpolate, &net).trace;
        assert!(through.steps().len() == 1 && through.steps()[0].max <= 1e-11);

        fn rounds(iterations: usize) -> FitMethod {
            FitMethod::Lspia { rows: 0, columns: 0, iterations, tolerance: 0.0 }
        }
        let fitted = fit(rounds(20), &net);
        let steps = fitted.trace.steps();
        assert_eq!(steps.len(), 41);
        assert!(steps.iter().zip(0..).all(|(step, k)| step.iteration == k));
        assert!(steps[..20].windows(2).all(|pair| pair[1].rms < pair[0].rms));
        assert!(steps[20..40].windows(2).all(|pair| pair[1].rms < pair[0].rms));
        assert!(steps.iter().all(|step| step.rms <= step.max));
        let (us, vs) = (uniform_parameters(25), uniform_parameters(31));
        let missed = net.points().iter().zip(fitted.surface.grid(&us, &vs));
        let missed: Vec<f64> = missed.map(|(point, met)| (point - met).norm()).collect();
        assert_eq!(steps[40].max, missed.iter().copied().fold(0.0, f64::max));
        let mean_sq = missed.iter().map(|distance| distance * distance).sum::<f64>() / 775.0;
        assert!((steps[40].rms - mean_sq.sqrt()).abs() <= 1e-15);
    }

    // Regression test: with asymmetric knots in the least-squares fit, the two surfaces differ.
    #[test]
    fn reversed_points_give_the_reversed_surface() {
        let net = waves(14, 17);
        let turned: Vec<_> = net.points().iter().rev().copied().collect();
        let turned = value::ControlNet::new(14, 17, turned).unwrap();
        for method in [
            FitMethod::Interpolate,
            FitMethod::LeastSquares { rows: 7, columns: 9 },
            FitMethod::Lspia { rows: 7, columns: 9, iterations: 5, tolerance: 0.0 },
        ] {
            for kind in ALL_PARAMETERS {
                let [there, back] = [&net, &turned].map(|net| {
                    fit_surface(net, [4, 3], method, kind, &Progress::silent()).unwrap().surface
                });
                for k in 0..50 {
                    let (u, v) = (f64::from(k) / 49.0, f64::from(k * k % 50) / 49.0);
                    let apart = there.point(u, v) - back.point(1.0 - u, 1.0 - v);
                    assert!(apart.norm() <= 1e-11, "{method:?} {kind:?}: {apart}");
                }
            }
        }
    }

    #[test]
    fn nets_and_counts_that_do_not_fit_are_refused() {
        let net = waves(5, 6);
        fn error(net: &value::ControlNet, order: [usize; 2], method: FitMethod) -> String {
            fit_surface(net, order, method, FitParameters::Chord, &Progress::silent())
                .unwrap_err()
                .to_string()
        }
        let count =
            "5 control points along U do not fit: there are 5 points, and order 6 needs 6 of both";
        assert_eq!(error(&net, [6, 3], FitMethod::Interpolate), count);
        for columns in [7, 2, 1] {
            let error = error(&net, [3, 3], FitMethod::LeastSquares { rows: 0, columns });
            assert!(error.contains("control points along V do not fit"), "{error}");
        }
        let order = error(&net, [3, 0], FitMethod::Interpolate);
        assert_eq!(order, "degree 0 is not from 1 to 9");
        // Three of the six columns coincide.
        let crowded = value::ControlNet::new(
            5,
            6,
            (0..30)
                .map(|k: usize| Point3::new((k % 6).saturating_sub(3) as f64, (k / 6) as f64, 0.0))
                .collect::<Vec<_>>(),
        )
        .unwrap();
        let crowded = error(&crowded, [3, 3], FitMethod::Interpolate);
        assert_eq!(crowded, "knot 0 is repeated 5 times; at most 3 are allowed there");
    }

    #[test]
    fn rows_in_one_place_are_named() {
        let mut points = waves(6, 5).points().to_vec();
        points.copy_within(5..10, 10);
        let doubled = value::ControlNet::new(6, 5, points).unwrap();
        for kind in [FitParameters::Chord, FitParameters::Centripetal] {
            let fit = |method| {
                fit_surface(&doubled, [4, 4], method, kind, &Progress::silent())
                    .map_err(|error| error.to_string())
            };
            assert_eq!(
                fit(FitMethod::Interpolate).unwrap_err(),
                "the points along U do not determine the surface: rows 1 and 2 of the net, counted from 0, are in one place; remove one of them, or \
                 use `method: LeastSquares` with fewer rows"
            );
            assert!(fit(FitMethod::LeastSquares { rows: 5, columns: 0 }).is_ok());
        }
    }
}
