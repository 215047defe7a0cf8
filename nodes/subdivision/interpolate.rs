//! Finds the control mesh of a subdivision surface through given vertices.

use maquette_node::{
    Cancelled, Carry, Context, Error, Estimate, Fate, FieldError, In, Node, Progress, Promise,
    TooMuch, Want,
};
use maquette_value::{Attribute, Mesh, MeshError, Trace};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::limit::limit_rows::{Limit, LimitPlaces};
use super::refine::topology::Topology;
use super::solve::blocks::limit_matrix;
use super::solve::control_points::control_points;
use super::solve::extent::stray;
use super::solve::geometric::Look;
use super::solve::interpolation::{Direction, Foot, Interpolation, NotLinear, Solver};
use super::solve::least_squares::least_squares;
use super::solve::limit_matrix::PRODUCTS;
use super::solve::solution::{Diverged, End, Interpolated, Solution};
use super::surface::limit_feet::{ClosestFeet, vertex_feet};
use super::{Boundary, Corners, Creases, Plan, Scheme, SubdivideError, Subdivision};

/// Finds the control mesh whose subdivision surface passes through the vertices of a mesh.
///
/// The control mesh has the same faces and attributes; only its vertices are elsewhere. Refine it with `Subdivide`, with
/// `limit: true` for points on the surface itself: with `levels: 0` the given vertices come out again.
///
/// Borders and creases are curves of their own, and are met first. `Loop` and `DooSabin` have a control mesh for every closed mesh.
/// `CatmullClark` has none for some: a pattern that alternates around vertices of three faces, as on a cube, is smoothed away whole.
///
/// The form with `foot: Closest` is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear
/// progressive form. With `foot: Closest` or `direction: Normal` the surface stays near the vertices, no farther from their bounding
/// box than its diagonal, or there is an error. Control points may be farther away: where the vertices alternate between high and low, those of
/// `CatmullClark` are nine times as high.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Interpolate {
    /// The vertices to meet, and how they hang together.
    pub mesh: In<Mesh>,
    /// The rules of the subdivision.
    pub scheme: Scheme,
    /// How they are met.
    #[serde(flatten)]
    pub options: InterpolateOptions,
    /// A vertex attribute of flags: the control points where it is set stay on their vertices, which the surface then misses. None
    /// if left empty.
    #[serde(default)]
    pub fixed: String,
}

/// What to do if no control mesh has a surface through all vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum OnSingular {
    /// Fails, and says how far the surface stays away.
    #[default]
    Error,
    /// Comes as near as possible with the least change of the control points.
    LeastSquares,
    /// Refines the mesh once, which makes enough control points, and moves them as little as possible.
    RefineOnce,
}

/// Why there is no control mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InterpolateError {
    /// A solver for other feet or directions.
    #[error(transparent)]
    NotLinear(#[from] NotLinear),
    /// A mesh that the scheme cannot refine.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// Faces at the border that the surface does not have.
    #[error(
        "with `boundary: None` the surface ends before the border, whose vertices it therefore cannot meet"
    )]
    NoBorder,
    /// Vertices that no surface of this connectivity passes through.
    #[error(
        "no control mesh of this connectivity has a surface through all vertices: {residual:.3e} mm stay at vertex {vertex}, a pattern \
         that the scheme smooths away; move vertices, or take `on_singular: RefineOnce` or `LeastSquares`"
    )]
    NotInterpolable {
        /// The largest distance that no control points take away, in mm.
        residual: f64,
        /// Where it is.
        vertex: usize,
        /// What is left at each vertex, in mm.
        mode: Vec<[f64; 3]>,
    },
    /// No attribute of flags.
    #[error("the mesh has no vertex attribute `{name}` of flags")]
    Fixed {
        /// Its name.
        name: String,
    },
    /// Equations that would take too much memory and time.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Control points out of all bounds.
    #[error("the iteration diverged: {0}")]
    Mesh(#[from] MeshError),
    /// The iteration leads away from the points.
    #[error(transparent)]
    Diverged(#[from] Diverged),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// How vertices are met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct InterpolateOptions {
    /// What happens at the border of an open mesh.
    #[serde(default)]
    pub boundary: Boundary,
    /// How control points are found.
    #[serde(flatten)]
    pub how: Interpolation,
    /// What to do if no control mesh has a surface through all vertices.
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
            .when("with the scheme `Loop`", |it| it.scheme == Scheme::Loop),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Closed", "mesh"),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Oriented", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh"),
        Promise::from("mesh", "Triangles", "mesh")
            .when("with the scheme `Loop`", |it| it.scheme == Scheme::Loop),
    ];

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let corners = cx.get(&self.mesh).faces().corners().len() as f64;
        let how = self.options.how;
        let (factors, feet) = (how.solver == Solver::Direct, how.foot == Foot::Closest);
        let per_corner = 70.0 + if factors { 700.0 } else { 0.0 } + if feet { 150.0 } else { 0.0 };
        Some(Estimate {
            bytes: corners * per_corner,
            help: "interpolate a coarser mesh (`Simplify`)",
        })
    }

    fn check(&self) -> Result<(), FieldError> {
        self.options.how.check_fields()
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let fixed = fixed_vertices(mesh, &self.fixed)?;
        let (scheme, options) = (self.scheme, &self.options);
        let found =
            interpolate_with::<Error>(mesh, scheme, options, &fixed, cx.progress(), |topology| {
                cx.memo(topology, LimitPlaces::memo)
            })?;
        Ok(found.outputs(cx, "surface"))
    }
}

fn fixed_vertices(mesh: &Mesh, name: &str) -> Result<Vec<bool>, InterpolateError> {
    if name.is_empty() {
        return Ok(Vec::new());
    }
    match mesh.vertex().get(name) {
        Some(Attribute::Flag(flags)) => Ok(flags.iter().map(|&flag| flag == 1).collect()),
        _ => Err(InterpolateError::Fixed { name: name.to_owned() }),
    }
}

/// The control mesh whose limit surface passes through the vertices of `mesh`, but for those whose flags in `fixed`, if there are
/// any, say that their control points stay on them.
///
/// With `foot: Vertex` the distances are those of each vertex from its control point's limit, and the problem is linear: Halstead,
/// Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces" (1993), solved by conjugate gradients or by the
/// progressive iteration of Cheng et al., "Loop subdivision surface based progressive interpolation" (2009). With `foot: Closest` they
/// are those from the nearest point of the surface on the faces at the vertex: Maekawa, Matsumoto and Namiki, "Interpolation by
/// geometric algorithm", Computer-Aided Design 39 (2007). Of this no proof is known that it converges; where it does not, the vertices
/// that are missed by most go on with their control points' limits. At the border of an open mesh Doo's and Sabin's scheme has these alone.
///
/// # Errors
/// If the scheme cannot refine the mesh, no control mesh has such a surface, the solver is not for this foot and direction, a
/// nonlinear iteration diverges, or the evaluation is told to stop.
pub fn interpolate(
    mesh: &Mesh,
    scheme: Scheme,
    options: &InterpolateOptions,
    fixed: &[bool],
    progress: &Progress<'_>,
) -> Result<Interpolated<Mesh>, InterpolateError> {
    interpolate_with(mesh, scheme, options, fixed, progress, |topology| {
        LimitPlaces::new(topology).map_err(InterpolateError::from)
    })
}

/// [`interpolate`] with limits from `limit`.
fn interpolate_with<E: From<InterpolateError>>(
    mesh: &Mesh,
    scheme: Scheme,
    options: &InterpolateOptions,
    fixed: &[bool],
    progress: &Progress<'_>,
    limit: impl Fn(&Topology) -> Result<LimitPlaces, E>,
) -> Result<Interpolated<Mesh>, E> {
    options.how.check().map_err(InterpolateError::from)?;
    if options.boundary == Boundary::None {
        return Err(InterpolateError::NoBorder.into());
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
    let how = &options.how;
    let limits = limit(&Topology::of(mesh, subdivision))?;
    if how.solver == Solver::Direct {
        let products = limits.positions.products();
        PRODUCTS
            .check("solving for the control points by factors", products)
            .map_err(InterpolateError::from)?;
    }
    let matrix = || limit_matrix(&limits, mesh.faces(), fixed);
    let sample = |control: &[Point3<f64>]| sample(mesh, subdivision, control);
    let solved = match how.foot {
        Foot::Closest => {
            let feet = ClosestFeet::new(mesh, subdivision, &limits.positions);
            let mut feet = feet.map_err(InterpolateError::from)?;
            control_points(
                points,
                how,
                fixed,
                progress,
                |control, look: Look<'_>| feet.of(control, look.own),
                sample,
                matrix,
            )
        }
        Foot::Vertex => {
            let normals = how.direction == Direction::Normal;
            let facing = normals.then(|| Limit::new(&limits.topology)).transpose();
            let facing = facing.map_err(InterpolateError::from)?;
            let rows = &limits.positions;
            control_points(
                points,
                how,
                fixed,
                progress,
                |control, look: Look<'_>| vertex_feet(rows, facing.as_ref(), control, look.own),
                sample,
                matrix,
            )
        }
    };
    let solved = solved.map_err(InterpolateError::from)?;
    let mut solution = match solved.filter(|solution| !solution.unreachable) {
        Some(solution) => solution,
        None if options.on_singular == OnSingular::RefineOnce && !scheme.is_dual() => {
            return refined_once(mesh, subdivision, how, progress, limit);
        }
        None => {
            let nearest = least_squares(&limits.positions, points, points, fixed, how, progress);
            let nearest = nearest.map_err(InterpolateError::from)?;
            if options.on_singular != OnSingular::LeastSquares && nearest.unreachable {
                return Err(not_interpolable(&limits, points, &nearest).into());
            }
            nearest
        }
    };
    if !how.is_linear()
        && let Some(stray) = stray(&solution.found.control, points, sample)
    {
        let last = solution.found.trace.steps().last().map_or(0, |step| step.iteration as u32);
        solution.found.end = End::Diverged(Diverged::strayed(last, stray));
    }
    let found = solution
        .found
        .shaped(|control| mesh.with_positions(control).map_err(InterpolateError::from))?;
    Ok(Interpolated { shape: found.shape.without("normal"), ..found })
}

/// Points of the limit surface of `mesh` with other control points: at these and in the middle of edges and faces. `None` if they overflow.
fn sample(
    mesh: &Mesh,
    subdivision: Subdivision,
    control: &[Point3<f64>],
) -> Option<Vec<Point3<f64>>> {
    let control = mesh.with_positions(control.to_vec()).ok()?;
    let plan = Plan::new(&control, Subdivision { levels: 1, limit: true, ..subdivision }).ok()?;
    Some(plan.apply(&control).ok()?.positions().to_vec())
}

fn not_interpolable(
    limits: &LimitPlaces,
    points: &[Point3<f64>],
    solution: &Solution,
) -> InterpolateError {
    let surface = limits.positions.apply(&solution.found.control);
    let left = points.iter().zip(&surface).map(|(point, surface)| (point - surface).into());
    let mode: Vec<[f64; 3]> = left.collect();
    let worst = mode
        .iter()
        .map(|[x, y, z]| (x * x + y * y + z * z).sqrt())
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let (vertex, residual) = worst.unwrap_or_default();
    InterpolateError::NotInterpolable { residual, vertex, mode }
}

/// The control mesh after one refinement whose limit passes through the old vertices, with the least change of the refined one.
///
/// It has many more control points than there are vertices to meet, so that there is one even where the mesh itself has none.
fn refined_once<E: From<InterpolateError>>(
    mesh: &Mesh,
    subdivision: Subdivision,
    how: &Interpolation,
    progress: &Progress<'_>,
    limit: impl Fn(&Topology) -> Result<LimitPlaces, E>,
) -> Result<Interpolated<Mesh>, E> {
    let plan = Plan::new(mesh, Subdivision { levels: 1, ..subdivision });
    let refined = plan.and_then(|plan| plan.apply(mesh)).map_err(InterpolateError::from)?;
    let limits = limit(&Topology::of(&refined, subdivision))?;
    let old = limits.positions.head(mesh.positions().len());
    let solution = least_squares(&old, refined.positions(), mesh.positions(), &[], how, progress);
    let found = solution.map_err(InterpolateError::from)?.found;
    Ok(found.shaped(|control| refined.with_positions(control).map_err(InterpolateError::from))?)
}

#[cfg(test)]
mod tests;
