//! Finds the control mesh of a subdivision surface through given vertices.

use maquette_node::{
    Carry, Context, Error, Estimate, FieldError, In, Node, Progress, Promise, Transfer, Want, bail,
};
use maquette_value::{Attribute, Mesh, Trace};
use nalgebra::Point3;
use near_fins::faces_near_fins;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::limit::limit_rows::{Limit, LimitPositions};
use super::refine::topology::Topology;
use super::solve::blocks::limit_matrix;
use super::solve::control_points::control_points;
use super::solve::extent::stray;
use super::solve::geometric::FootSearch;
use super::solve::interpolation::{Direction, Foot, Interpolation, Solver};
use super::solve::least_squares::least_squares;
use super::solve::limit_matrix::PRODUCTS;
use super::solve::self_crossings::SelfCrossings;
use super::solve::solution::{End, InterpolationResult, Solution};
use super::surface::limit_feet::{ClosestFeet, vertex_feet};
use super::{Boundary, Corners, Creases, Plan, Scheme, Subdivision};

mod near_fins;

/// Finds the control mesh whose subdivision surface passes through the vertices of a mesh.
///
/// The control mesh has the same faces and attributes, with other positions. Refine it with `Subdivide`, with `limit: true` for points on
/// the surface itself; with `levels: 0` these are the given vertices.
///
/// Borders and creases are independent curves, which are interpolated first. With `Loop` and `DooSabin` every closed mesh has a control
/// mesh. With `CatmullClark` some have none: a pattern that alternates around vertices of three faces, as on a cube, vanishes in the limit.
///
/// The form with `foot: Closest` is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear progressive form.
/// With `foot: Closest` or `direction: Normal` it is an error if the surface is farther from the vertices' bounding box than its diagonal.
/// Control points may be farther away: if the vertices alternate between high and low, those of `CatmullClark` are nine times as high.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Interpolate {
    /// Mesh whose vertices are interpolated. The control mesh has its faces.
    pub mesh: In<Mesh>,
    /// Subdivision scheme.
    pub scheme: Scheme,
    /// Options of the interpolation.
    #[serde(flatten)]
    pub options: InterpolateOptions,
    /// Vertex attribute of flags. Where it is set, control points stay at their vertices, which the surface then does not pass through.
    /// Empty for none.
    #[serde(default)]
    pub fixed: String,
}

/// Fallback if no control mesh has a surface through all vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum OnSingular {
    /// Fails and reports the remaining distance.
    #[default]
    Error,
    /// Minimizes the distances, with the smallest change of the control points.
    LeastSquares,
    /// Refines the mesh once, so that there are enough control points, and moves them as little as possible.
    RefineOnce,
}

/// Options of the interpolation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InterpolateOptions {
    /// Treatment of the border of an open mesh.
    #[serde(default)]
    pub boundary: Boundary,
    /// Options of the solver.
    #[serde(flatten)]
    pub how: Interpolation,
    /// Fallback if no control mesh has a surface through all vertices.
    #[serde(default)]
    pub on_singular: OnSingular,
}

impl Node for Interpolate {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
        Want::new("mesh", "Unpinched"),
        Want::new("mesh", "Triangles")
            .only_if("with the scheme `Loop`", |it| it.scheme == Scheme::Loop),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Closed", "mesh"),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Oriented", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh"),
        Promise::from("mesh", "Triangles", "mesh")
            .only_if("with the scheme `Loop`", |it| it.scheme == Scheme::Loop),
    ];

    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let corners = cx.get(&self.mesh).faces().corners().len() as f64;
        let solver_options = self.options.how;
        let (factors, feet) =
            (solver_options.solver == Solver::Direct, solver_options.foot == Foot::Closest);
        let per_corner = 70.0 + if factors { 700.0 } else { 0.0 } + if feet { 150.0 } else { 0.0 };
        Some(Estimate {
            bytes: corners * per_corner,
            help: "interpolate a coarser mesh (`Simplify`)",
        })
    }

    fn check(&self) -> Result<(), FieldError> {
        self.scheme.check_limit_field()?;
        self.options.how.check_fields()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let fixed = fixed_vertices(mesh, &self.fixed)?;
        let (scheme, options) = (self.scheme, &self.options);
        let found = interpolate_with(mesh, scheme, options, &fixed, cx.progress(), |topology| {
            cx.memo(topology, LimitPositions::memo)
        })?;
        if let Some(found) = self_crossings(mesh, &found.shape, scheme, options, cx.progress())? {
            cx.warn(found.warning(&format!("vertex {}", found.nearest), FIN_HELP));
        }
        Ok(found.outputs(cx, "surface"))
    }
}

/// Help for surfaces with fins.
const FIN_HELP: &str = "approximate the vertices (`FitSubdivision` with the mesh as `points`), or round the mesh first (`Subdivide`, `levels: 1`)";

/// Finds places where the surface of the control mesh `control`, which interpolates the vertices of `mesh`, crosses itself.
fn self_crossings(
    mesh: &Mesh,
    control: &Mesh,
    scheme: Scheme,
    options: &InterpolateOptions,
    progress: &Progress<'_>,
) -> Result<Option<SelfCrossings>, Error> {
    let points = mesh.positions();
    let mut spacings = vec![f64::INFINITY; points.len()];
    for &[a, b] in &*mesh.edges().vertices {
        let length = (points[a as usize] - points[b as usize]).norm();
        for vertex in [a, b].map(|vertex| vertex as usize) {
            spacings[vertex] = spacings[vertex].min(length);
        }
    }
    let subdivision = Subdivision {
        scheme,
        levels: 2,
        limit: true,
        boundary: options.boundary,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    };
    let found = SelfCrossings::find(
        points,
        control.positions(),
        &spacings,
        |far| {
            let near = control.select(&faces_near_fins(control, far));
            Plan::new(&near, subdivision).ok()?.apply(&near).ok()
        },
        progress,
    );
    Ok(found?)
}

fn fixed_vertices(mesh: &Mesh, name: &str) -> Result<Vec<bool>, Error> {
    if name.is_empty() {
        return Ok(Vec::new());
    }
    match mesh.vertex().get(name) {
        Some(Attribute::Flag(flags)) => Ok(flags.iter().map(|&flag| flag == 1).collect()),
        _ => {
            let others = mesh.vertex().iter().filter(|it| matches!(it.1, Attribute::Flag(_)));
            let others: Vec<_> = others.map(|(name, _)| format!("`{name}`")).collect();
            let others = if others.is_empty() { "none".to_owned() } else { others.join(", ") };
            bail!("the mesh has no vertex attribute `{name}` of flags; it has {others}")
        }
    }
}

/// Computes the control mesh whose limit surface passes through the vertices of `mesh`. If `fixed` is given, control points marked in it
/// stay at their vertices, and the surface need not pass through these vertices.
///
/// The *foot* of a vertex is the surface point with which the vertex is compared. With `foot: Vertex` the foot is the limit point of the
/// vertex's own control point, and the problem is linear: Halstead, Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark
/// surfaces" (1993), solved by conjugate gradients or by the progressive iteration of Cheng et al., "Loop subdivision surface based
/// progressive interpolation" (2009). With `foot: Closest` the foot is the nearest surface point on the faces at the vertex: Maekawa,
/// Matsumoto and Namiki, "Interpolation by geometric algorithm", Computer-Aided Design 39 (2007). No proof of convergence is known for
/// `Closest`; where the iteration does not converge, the vertices with the largest distances switch to `Vertex`. At the border of an open
/// mesh the Doo-Sabin scheme always uses `Vertex`.
///
/// # Errors
/// If the scheme cannot refine the mesh, no control mesh has a limit surface through the vertices, the solver does not support the foot and
/// direction, a nonlinear iteration diverges, or the evaluation is cancelled.
pub fn interpolate(
    mesh: &Mesh,
    scheme: Scheme,
    options: &InterpolateOptions,
    fixed: &[bool],
    progress: &Progress<'_>,
) -> Result<InterpolationResult<Mesh>, Error> {
    interpolate_with(mesh, scheme, options, fixed, progress, LimitPositions::new)
}

/// Performs [`interpolate`]. `limit` computes the limit masks or looks them up in a cache.
fn interpolate_with(
    mesh: &Mesh,
    scheme: Scheme,
    options: &InterpolateOptions,
    fixed: &[bool],
    progress: &Progress<'_>,
    limit: impl Fn(&Topology) -> Result<LimitPositions, Error>,
) -> Result<InterpolationResult<Mesh>, Error> {
    options.how.check()?;
    if options.boundary == Boundary::None {
        bail!(
            "with `boundary: None` the surface ends before the border and cannot pass through the vertices there"
        );
    }
    let subdivision = Subdivision {
        scheme,
        levels: 0,
        limit: false,
        boundary: options.boundary,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    };
    let points = mesh.positions();
    let solver_options = &options.how;
    let limits = limit(&Topology::from_mesh(mesh, subdivision))?;
    if solver_options.solver == Solver::Direct {
        let products = limits.positions.products();
        PRODUCTS.check("solving for the control points by factors", products)?;
    }
    let matrix = || limit_matrix(&limits, mesh.faces(), fixed);
    let sample = |control: &[Point3<f64>]| sample(mesh, subdivision, control);
    let solved = match solver_options.foot {
        Foot::Closest => {
            let mut feet = ClosestFeet::new(mesh, subdivision, &limits.positions)?;
            control_points(
                points,
                solver_options,
                fixed,
                progress,
                |control, look: FootSearch<'_>| feet.find(control, look.own),
                sample,
                matrix,
            )
        }
        Foot::Vertex => {
            let normals = solver_options.direction == Direction::Normal;
            let facing = normals.then(|| Limit::new(&limits.topology)).transpose()?;
            let rows = &limits.positions;
            control_points(
                points,
                solver_options,
                fixed,
                progress,
                |control, look: FootSearch<'_>| {
                    vertex_feet(rows, facing.as_ref(), control, look.own)
                },
                sample,
                matrix,
            )
        }
    };
    let mut solution = match solved?.filter(|solution| !solution.unreachable) {
        Some(solution) => solution,
        None if options.on_singular == OnSingular::RefineOnce && !scheme.is_dual() => {
            return refined_once(mesh, subdivision, solver_options, progress, limit);
        }
        None => {
            let nearest =
                least_squares(&limits.positions, points, points, fixed, solver_options, progress)?;
            if options.on_singular != OnSingular::LeastSquares && nearest.unreachable {
                return Err(not_interpolable(&limits, points, &nearest));
            }
            nearest
        }
    };
    if !solver_options.is_linear()
        && solution.outcome.end != End::Settled
        && let Some(stray) = stray(&solution.outcome.control, points, sample)
    {
        let last = solution.outcome.trace.steps().last().map_or(0, |step| step.iteration as u32);
        solution.outcome.end = End::strayed(last, stray);
    }
    let found = solution.outcome.try_map(points, |control| mesh.with_positions(control))?;
    Ok(InterpolationResult { shape: found.shape.without_attribute("normal"), ..found })
}

/// Returns points of the limit surface of `mesh` with its vertices moved to `control`: the limit points of the vertices and the surface
/// points in the middle of edges and faces. Returns `None` if a coordinate overflows.
fn sample(
    mesh: &Mesh,
    subdivision: Subdivision,
    control: &[Point3<f64>],
) -> Option<Vec<Point3<f64>>> {
    let control = mesh.with_positions(control.to_vec()).ok()?;
    let plan = Plan::new(&control, Subdivision { levels: 1, limit: true, ..subdivision }).ok()?;
    Some(plan.apply(&control).ok()?.positions().to_vec())
}

fn not_interpolable(limits: &LimitPositions, points: &[Point3<f64>], solution: &Solution) -> Error {
    let surface = limits.positions.apply(&solution.outcome.control);
    let distances = points.iter().zip(&surface).map(|(point, surface)| (point - surface).norm());
    let worst = distances.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let (vertex, residual) = worst.unwrap_or_default();
    Error::new(format!(
        "no control mesh of this connectivity has a surface through all vertices: a distance of {residual:.3e} mm remains at vertex {vertex}, a pattern \
         that vanishes in the limit; move vertices, or use `on_singular: RefineOnce` or `LeastSquares`"
    ))
}

/// Computes the control mesh, refined once, whose limit surface passes through the vertices of `mesh`, with the smallest change of the
/// refined mesh.
///
/// The refined mesh has many more control points than `mesh` has vertices, so a solution exists even if no control mesh with the faces of
/// `mesh` has one.
fn refined_once(
    mesh: &Mesh,
    subdivision: Subdivision,
    options: &Interpolation,
    progress: &Progress<'_>,
    limit: impl Fn(&Topology) -> Result<LimitPositions, Error>,
) -> Result<InterpolationResult<Mesh>, Error> {
    let plan = Plan::new(mesh, Subdivision { levels: 1, ..subdivision });
    let refined = plan.and_then(|plan| plan.apply(mesh))?;
    let limits = limit(&Topology::from_mesh(&refined, subdivision))?;
    let old = limits.positions.head(mesh.positions().len());
    let solution =
        least_squares(&old, refined.positions(), mesh.positions(), &[], options, progress)?;
    solution.outcome.try_map(mesh.positions(), |control| refined.with_positions(control))
}

#[cfg(test)]
mod tests;
