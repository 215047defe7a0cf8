//! Finds the control net of a B-spline surface through a grid of points.

use maquette_base::linear::stencils::Stencils;
use maquette_base::parameters::{coincident_line, parameters};
use maquette_node::{Context, Error, FieldError, In, Node, Progress, bail};
use maquette_value::parallel::*;
use maquette_value::{ControlNet, KnotVector, KnotVectorError, ParameterDirection, Surface, Trace};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::solve::control_points::control_points;
use super::solve::extent::absolute_tolerance;
use super::solve::geometric::{FootPoint, FootSearch, Perpendicular};
use super::solve::interpolation::{Direction, Foot, Interpolation, Solver};
use super::solve::limit_matrix::LimitMatrix;
use super::solve::self_crossings::SelfCrossings;
use super::solve::solution::InterpolationResult;

/// Finds the control net of a B-spline surface through a grid of points.
///
/// The surface has no weights; it begins and ends at the first and last rows and columns of points. To write the surface back into a scan
/// with `Blend`, use `FitSurface` instead, which keeps the relation to the scan's cells.
///
/// The form with `foot: Closest` is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear
/// progressive form.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct InterpolateSurface {
    /// Points to interpolate, row by row.
    pub points: In<ControlNet>,
    /// Orders along u and v, which are the degrees plus 1: 2 is linear, 3 quadratic, 4 cubic.
    #[schemars(inner(range(min = 2, max = 10)))]
    #[serde(default = "default_order")]
    pub order: [usize; 2],
    /// Options of the solver.
    #[serde(flatten)]
    pub how: Interpolation,
}

fn default_order() -> [usize; 2] {
    [4, 4]
}

impl Node for InterpolateSurface {
    type Outputs = (Surface, Trace);
    const OUTPUTS: [&'static str; 2] = ["surface", "trace"];

    fn check(&self) -> Result<(), FieldError> {
        self.how.check_fields()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let net = cx.get(&self.points);
        if net.weights().windows(2).any(|pair| pair[0] != pair[1]) {
            cx.warn("the weights of the net are not used: an interpolating surface has none");
        }
        let found = interpolate_surface(net, self.order, &self.how, cx.progress())?;
        if let Some(found) = self_crossings(net, &found.shape, cx.progress())? {
            let [row, column] = [found.nearest / net.columns(), found.nearest % net.columns()];
            let name = format!("row {row}, column {column} of the net, counted from 0");
            cx.warn(found.warning(&name, &fin_help(net, self.order)));
        }
        Ok(found.outputs(cx, "surface"))
    }
}

/// Computes the B-spline surface with the orders `order` through the points of a net. The surface has one control point per point.
///
/// The parameters of the points are centripetal, averaged over all rows or columns, and the knots are averages of these parameters: Piegl
/// and Tiller, *The NURBS Book*, 2nd ed. (1997), section 9.2.5. With `foot: Vertex` the distance of a given point is measured to the
/// surface point at the parameters that were assigned to the given point: Lin, Bao and Wang, "Totally positive bases and progressive
/// iteration approximation", Computers & Mathematics with Applications 50 (2005). With `foot: Closest` the distance is measured to the
/// nearest surface point: Maekawa, Matsumoto and Namiki, "Interpolation by geometric algorithm" (2007). The collocation matrix `A` is not
/// symmetric, so `Solver::Pcg` works on `A A^T`.
///
/// If all points of the first or last row or column coincide within the tolerance, the row or column is a pole. Its control points are then
/// one point, which they share exactly, because control points that differ by the tolerance would turn normals over. If the first and last
/// row or column are the same, so are their control points, so that the surface is closed at its seam.
///
/// Some points have several surfaces with `foot: Closest`. If the control points of the one found are farther outside of the points'
/// bounding box than its diagonal, the surface of `foot: Vertex` is returned instead, which swings least.
///
/// # Errors
/// If there are fewer points than the order, rows or columns coincide, the solver does not support the foot and direction, or the
/// evaluation is cancelled.
pub fn interpolate_surface(
    net: &ControlNet,
    order: [usize; 2],
    options: &Interpolation,
    progress: &Progress<'_>,
) -> Result<InterpolationResult<Surface>, Error> {
    options.check()?;
    let surfaces = NetSurfaces::new(net, order)?;
    let Poles { points, fixed } = Poles::new(net, options.tolerance);
    let seams = Seams::new(net, options.tolerance);
    let mut feet = Feet::new(&surfaces, &points, options.foot);
    let solution = control_points(
        &points,
        options,
        &fixed,
        progress,
        |control, look: FootSearch<'_>| feet.find(control, &look),
        |control| surfaces.sample(control),
        || {
            let free = (0..).zip(&fixed).filter(|(_, fixed)| !**fixed).map(|(k, _)| k);
            let blocks = vec![free.collect()];
            LimitMatrix { rows: surfaces.collocation(), blocks, scale: None }
        },
    )?;
    let found = solution
        .ok_or_else(|| surfaces.undetermined())?
        .outcome
        .try_map(&points, |control| surfaces.surface(seams.close(control)))?;
    if found.reach <= MAX_REACH || options.is_linear() {
        return Ok(found);
    }
    let linear = Interpolation {
        foot: Foot::Vertex,
        direction: Direction::Residual,
        solver: Solver::Direct,
        ..*options
    };
    let other = interpolate_surface(net, order, &linear, progress)?;
    Ok(if other.settled { InterpolationResult { trace: found.trace, ..other } } else { found })
}

/// Returns the help for a surface with fins: a fit with half as many control points.
fn fin_help(net: &ControlNet, order: [usize; 2]) -> String {
    let [rows, columns] = [(net.rows(), order[0]), (net.columns(), order[1])]
        .map(|(count, order)| order.max(count / 2));
    format!(
        "approximate the points, as by `FitSurface` with `method: LeastSquares(rows: {rows}, columns: {columns})`"
    )
}

/// The number of faces along u and v for each distance of two points, in which crossings are searched.
const FACES_PER_POINT: usize = 4;

/// Finds places where the surface through the points of a net crosses itself.
fn self_crossings(
    net: &ControlNet,
    surface: &Surface,
    progress: &Progress<'_>,
) -> Result<Option<SelfCrossings>, Error> {
    let (points, columns) = (net.points(), net.columns());
    let mut spacings = vec![f64::INFINITY; points.len()];
    for k in 0..points.len() {
        let right = (k % columns + 1 < columns).then_some(k + 1);
        let below = (k + columns < points.len()).then_some(k + columns);
        for other in [right, below].into_iter().flatten() {
            let distance = (points[other] - points[k]).norm();
            // Points in one place are a pole.
            if distance > 0.0 {
                spacings[k] = spacings[k].min(distance);
                spacings[other] = spacings[other].min(distance);
            }
        }
    }
    let [u, v] = [net.rows(), columns].map(|count| FACES_PER_POINT * (count - 1));
    let control = surface.net().points();
    let draw = |_: &[u32]| surface.tessellate_open(u, v).ok();
    Ok(SelfCrossings::find(points, control, &spacings, draw, progress)?)
}

/// The distance of control points from the bounding box of the points, relative to its diagonal, beyond which the linear problem is solved.
const MAX_REACH: f64 = 1.0;

/// The points of a net whose poles are single points, and a flag for each point: true if the point belongs to a pole.
struct Poles {
    points: Vec<Point3<f64>>,
    fixed: Vec<bool>,
}

impl Poles {
    fn new(net: &ControlNet, tolerance: f64) -> Self {
        let (rows, columns) = (net.rows(), net.columns());
        let (mut points, mut fixed) = (net.points().to_vec(), vec![false; rows * columns]);
        let within = absolute_tolerance(tolerance, &points);
        fn row(row: usize, columns: usize) -> Vec<usize> {
            (row * columns..(row + 1) * columns).collect::<Vec<_>>()
        }
        fn column(column: usize, rows: usize, columns: usize) -> Vec<usize> {
            (column..rows * columns).step_by(columns).collect()
        }
        for line in [
            row(0, columns),
            row(rows - 1, columns),
            column(0, rows, columns),
            column(columns - 1, rows, columns),
        ] {
            let pole = points[line[0]];
            if line.iter().all(|&k| (net.points()[k] - pole).norm() <= within) {
                for k in line {
                    (points[k], fixed[k]) = (pole, true);
                }
            }
        }
        Self { points, fixed }
    }
}

/// The control points at the seams of a closed net, whose first and last row or column are the same points within the tolerance.
struct Seams {
    /// The indices of points of a last line, and of those of the first line at the same place.
    pairs: Vec<[usize; 2]>,
    /// The maximum distance of control points that become one, in mm.
    within: f64,
}

impl Seams {
    fn new(net: &ControlNet, tolerance: f64) -> Self {
        let (rows, columns, points) = (net.rows(), net.columns(), net.points());
        let within = absolute_tolerance(tolerance, points);
        let last_row = (rows - 1) * columns;
        let of_rows: Vec<_> = (0..columns).map(|k| [last_row + k, k]).collect();
        let of_columns: Vec<_> = (0..rows).map(|k| [(k + 1) * columns - 1, k * columns]).collect();
        let seams = [of_rows, of_columns].into_iter().filter(|pairs| {
            pairs.iter().all(|pair| (points[pair[0]] - points[pair[1]]).norm() <= within)
        });
        // The solution meets the points within the tolerance, and its control points may be farther away than the points.
        Self { pairs: seams.flatten().collect(), within: 100.0 * within }
    }

    /// Makes control points at a seam equal if they differ by no more than the solution's errors.
    fn close(&self, mut control: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
        for &[last, first] in &self.pairs {
            if (control[last] - control[first]).norm() <= self.within {
                control[last] = control[first];
            }
        }
        control
    }
}

/// The B-spline surfaces with the size, knots and parameters of a net of points. They differ only in their control points.
struct NetSurfaces<'a> {
    net: &'a ControlNet,
    knots: [KnotVector; 2],
    /// The surface parameters u of the rows of points, and the surface parameters v of the columns.
    parameters: [Vec<f64>; 2],
}

impl<'a> NetSurfaces<'a> {
    fn new(net: &'a ControlNet, order: [usize; 2]) -> Result<Self, Error> {
        let sizes = [(net.rows(), "rows", 'u'), (net.columns(), "columns", 'v')];
        for ((count, lines, along), order) in sizes.into_iter().zip(order) {
            if count < order {
                bail!(
                    "order {order} along {along} needs at least {order} {lines} of points, the net has {count}; add {lines}, or lower `order`"
                );
            }
        }
        let parameters = [ParameterDirection::U, ParameterDirection::V]
            .map(|along| parameters(net, along, f64::sqrt));
        fn knots(
            k: usize,
            parameters: &[Vec<f64>; 2],
            order: [usize; 2],
        ) -> Result<KnotVector, KnotVectorError> {
            KnotVector::from_parameters(&parameters[k], order[k].saturating_sub(1))
        }
        Ok(Self {
            net,
            knots: [knots(0, &parameters, order)?, knots(1, &parameters, order)?],
            parameters,
        })
    }

    /// Returns the error for points that do not determine a surface.
    fn undetermined(&self) -> Error {
        let lines = [("rows", &self.parameters[0]), ("columns", &self.parameters[1])];
        for (lines, parameters) in lines {
            if let Some(second) = coincident_line(parameters) {
                let first = second - 1;
                return Error::new(format!(
                    "the points do not determine the surface: {lines} {first} and {second} of the net, counted from 0, are in one place; remove one of \
                     them, or use `solver: Pcg`"
                ));
            }
        }
        Error::new("the points do not determine the surface; lower `order`, or use `solver: Pcg`")
    }

    fn surface(&self, control: Vec<Point3<f64>>) -> Result<Surface, Error> {
        let net = ControlNet::new(self.net.rows(), self.net.columns(), control)?;
        let [u, v] = self.knots.clone();
        Ok(Surface::new(net.with_frame(self.net.frame().copied()), u, v)?)
    }

    /// Samples the surface with the control points `control` at the parameters of the net's points and halfway between them. Returns `None`
    /// if a coordinate overflows.
    fn sample(&self, control: &[Point3<f64>]) -> Option<Vec<Point3<f64>>> {
        let surface = self.surface(control.to_vec()).ok()?;
        let [us, vs] = self.parameters.each_ref().map(|parameters| {
            let halves = parameters.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
            parameters.iter().copied().chain(halves).collect::<Vec<_>>()
        });
        Some(surface.grid(&us, &vs))
    }

    /// The collocation matrix: the surface points at the parameters of the net's points as weighted sums of the control points.
    fn collocation(&self) -> Stencils {
        let columns = self.net.columns();
        let bases = [0, 1].map(|k| {
            let at = self.parameters[k].iter().map(|&t| self.knots[k].basis(t));
            at.collect::<Vec<_>>()
        });
        let (rows, _) = Stencils::build(self.net.points().len(), |_: &mut (), k, rows| {
            let ((first_u, us), (first_v, vs)) = (&bases[0][k / columns], &bases[1][k % columns]);
            for (row, u) in (*first_u..).zip(us).filter(|(_, u)| **u != 0.0) {
                for (column, v) in (*first_v..).zip(vs).filter(|(_, v)| **v != 0.0) {
                    rows.push((row * columns + column) as u32, u * v);
                }
            }
            rows.end();
        });
        rows
    }

    /// The parameters `(u, v)` of point `k` of the net.
    fn point_parameters(&self, k: usize) -> [f64; 2] {
        let columns = self.net.columns();
        [self.parameters[0][k / columns], self.parameters[1][k % columns]]
    }
}

/// Finds the foot points of the given points: the nearest points on the current surface, which changes in each iteration.
struct Feet<'a> {
    surfaces: &'a NetSurfaces<'a>,
    pub(super) points: &'a [Point3<f64>],
    foot: Foot,
    /// The surface parameters of the foot points in the previous iteration.
    parameters: Vec<[f64; 2]>,
}

impl<'a> Feet<'a> {
    fn new(surfaces: &'a NetSurfaces<'a>, points: &'a [Point3<f64>], foot: Foot) -> Self {
        let parameters = (0..points.len()).map(|k| surfaces.point_parameters(k)).collect();
        Self { surfaces, points, foot, parameters }
    }

    fn find(&mut self, control: &[Point3<f64>], look: &FootSearch<'_>) -> Vec<FootPoint> {
        // A surface with overflowed coordinates has no foot points; the iteration records infinite distances and ends.
        let Ok(surface) = self.surfaces.surface(control.to_vec()) else {
            return vec![FootPoint::nowhere(); self.points.len()];
        };
        let [u, v] = [surface.u().domain(), surface.v().domain()];
        let points = self.points.par_iter().zip(&mut self.parameters).enumerate();
        let feet = points.map(|(k, (&to, at))| {
            if look.own[k] {
                *at = self.surfaces.point_parameters(k);
                let point = surface.point(at[0], at[1]);
                return FootPoint { point, perpendicular: Perpendicular::Nowhere };
            }
            let found = match self.foot {
                Foot::Vertex => None,
                Foot::Closest if look.whole => Some(surface.closest(to)),
                Foot::Closest => Some(surface.closest_from(to, *at)),
            };
            if let Some(found) = found {
                *at = [found.u, found.v];
            }
            let inside = u.0 < at[0] && at[0] < u.1 && v.0 < at[1] && at[1] < v.1;
            let normal = surface.normal(at[0], at[1]).filter(|_| inside);
            let perpendicular = normal
                .map_or(Perpendicular::Nowhere, |normal| Perpendicular::Along(normal.into_inner()));
            FootPoint { point: surface.point(at[0], at[1]), perpendicular }
        });
        feet.collect()
    }
}

#[cfg(test)]
mod tests;
