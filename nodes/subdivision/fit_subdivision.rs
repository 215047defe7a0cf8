//! Fits a subdivision surface to scattered points.

use maquette::value::{
    self, Mesh, MeshError, NearestPlace, RangeImage, Trace, TraceStep, TriangleTree,
};
use maquette::{Cancelled, Context, Error, In, Node, Progress};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SubdivideError;
use super::columns::{self, Column};
use super::composed::{Composed, laplacian};
use super::geometric::Missed;
use super::stencils::Stencils;
use crate::cholesky::Cholesky;

pub use moves::{Prices, fit_by_moves};
use scan::{Foot, Scan};

mod local;
mod moves;
mod net;
mod scan;

/// Moves the control points of a Loop subdivision surface until it is as near as possible to given points.
///
/// Start with `Simplify` of a dense mesh of the points. Creases and borders stay sharp, so that the surface is smooth piece by piece. With
/// `moves: ByEnergy()` the faces change, too: vertices go where the surface is simple and come where it is not, and edges become
/// sharp or smooth wherever the scan is. Points whose nearest place is farther away than two edges of the control mesh are left out:
/// they belong to parts that the mesh does not have.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FitSubdivision {
    /// The control mesh to start with: triangles.
    pub mesh: In<Mesh>,
    /// What the surface is to be near: points, the cells of a range image, or the vertices of a mesh.
    pub points: In<Scattered>,
    /// Weight of smoothness beside nearness: more for noisy points.
    #[schemars(range(min = 0.0, max = 1000.0))]
    #[serde(default = "thousandth")]
    pub smoothing: f64,
    /// How often the nearest places are looked for anew.
    #[schemars(range(max = 1000))]
    #[serde(default = "six")]
    pub iterations: u32,
    /// What may change beside the places of control points.
    #[serde(default)]
    pub moves: Moves,
}

/// What may change beside the places of control points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Moves {
    /// Nothing: the control mesh keeps its faces and creases.
    #[default]
    Nothing,
    /// Edges are collapsed, split, swapped, made sharp and made smooth wherever that is worth its price. `points` must be a mesh, because
    /// what lies between points counts, too; the result has no attributes.
    ByEnergy(Prices),
}

fn thousandth() -> f64 {
    1e-3
}

fn six() -> u32 {
    6
}

maquette::union! {
    /// Points in space.
    pub enum Scattered {
        Points(value::Points),
        RangeImage(RangeImage),
        Mesh(Mesh),
    }
}

/// Why no surface was fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitSubdivisionError {
    /// No points near the mesh.
    #[error("none of the {count} points is near the mesh: are both in the same place and unit?")]
    Apart {
        /// Number of points.
        count: usize,
    },
    /// Points without a surface, where faces are to change.
    #[error(
        "`moves: ByEnergy` looks at what lies between the points, too: give a mesh with faces as `points`, which `Reconstruct` makes of \
         points and `Triangulate` of range data"
    )]
    NoSurface,
    /// A mesh that Loop's scheme cannot refine.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for FitSubdivision {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (mesh, scattered) = (cx.get(&self.mesh), cx.get(&self.points));
        let points = match &scattered {
            Scattered::Points(points) => points.positions().to_vec(),
            Scattered::Mesh(mesh) => mesh.positions().to_vec(),
            Scattered::RangeImage(range) => {
                (0..range.points().len()).filter_map(|cell| range.point(cell)).collect()
            }
        };
        let Self { smoothing, iterations, .. } = *self;
        let fitted = match (self.moves, &scattered) {
            (Moves::Nothing, _) => {
                fit_subdivision(mesh, &points, smoothing, iterations, cx.progress())?
            }
            (Moves::ByEnergy(prices), Scattered::Mesh(scan)) => {
                if [mesh.vertex(), mesh.corner(), mesh.face()]
                    .iter()
                    .any(|all| all.iter().next().is_some())
                {
                    cx.warn("the attributes of the mesh are dropped: `moves` makes other faces");
                }
                fit_by_moves(mesh, scan, smoothing, iterations, prices, cx.progress())?
            }
            (Moves::ByEnergy(_), _) => return Err(FitSubdivisionError::NoSurface.into()),
        };
        if 0 < fitted.left_out {
            let (count, all) = (fitted.left_out, points.len());
            cx.warn(format!("{count} of {all} points are far from the mesh and were left out"));
        }
        Ok((fitted.mesh, fitted.trace))
    }
}

/// A fitted control mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSubdivision {
    /// The control mesh.
    pub mesh: Mesh,
    /// The points' distances from the surface before each iteration and at the end, in mm.
    pub trace: Trace,
    /// How many points were left out at the end.
    pub left_out: usize,
}

/// Steps of subdivision after which the surface is measured; its limit is met at the vertices of that mesh.
const LEVELS: u32 = 2;

/// The iteration ends when it takes less than this share of the mean distance away.
const LEAST_GAIN: f64 = 1e-3;

/// The control mesh of Loop's scheme, with the faces of `mesh`, whose surface is nearest to the points by squares.
///
/// Hoppe, DeRose, Duchamp, Halstead, Jin, McDonald, Schweitzer and Stuetzle, "Piecewise smooth surface reconstruction" (1994), section
/// 4, for a fixed topology: nearest places on the surface, then least squares for the control points with these places held, in turn.
/// The surface is measured as the mesh of its limit points after two steps. `smoothing` times the number of points per control point
/// weighs how far control points are from the mean of their neighbors, on creases of their two neighbors there.
///
/// # Errors
/// If a face is no triangle, the mesh is not manifold, no point is near it, or the evaluation is told to stop.
pub fn fit_subdivision(
    mesh: &Mesh,
    points: &[Point3<f64>],
    smoothing: f64,
    iterations: u32,
    progress: &Progress<'_>,
) -> Result<FittedSubdivision, FitSubdivisionError> {
    let mut fit = Fit { points, scan: None, smoothing, iterations, steps: Vec::new() };
    let (mesh, nearest) = fit.settled(mesh, progress)?;
    Ok(fit.end(mesh, &nearest))
}

/// The place of a surface that is nearest to a point.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    distance_sq: f64,
    /// The face of the control mesh.
    face: u32,
}

impl Nearest {
    /// A place after so many steps of subdivision: each cuts a face in four.
    fn new(place: &NearestPlace, levels: u32) -> Self {
        Self { distance_sq: place.distance_sq, face: place.face >> (2 * levels) }
    }
}

/// The iteration.
struct Fit<'a> {
    points: &'a [Point3<f64>],
    /// What lies between the points, if that counts: the surface is to be near it everywhere, and must not begin to fold.
    scan: Option<&'a Scan<'a>>,
    smoothing: f64,
    iterations: u32,
    steps: Vec<TraceStep>,
}

impl Fit<'_> {
    /// The mesh with its control points where its surface is nearest to the points, and for each point its nearest place, if it is near.
    fn settled(
        &mut self,
        mesh: &Mesh,
        progress: &Progress<'_>,
    ) -> Result<(Mesh, Vec<Option<Nearest>>), FitSubdivisionError> {
        let surface = Composed::new(mesh, LEVELS)?;
        let stiffness = laplacian(mesh);
        let reach = 2.0 * mean_edge(mesh);
        let mut mesh = mesh.clone();
        let mut before = f64::INFINITY;
        for iteration in 0..=self.iterations {
            match self.scan {
                None => progress.tick(f64::from(iteration) / f64::from(self.iterations.max(1)))?,
                Some(_) => progress.check()?,
            }
            let fine = surface.surface(mesh.positions())?;
            let mut feet = Feet::new(&fine, self.points, reach);
            if feet.points.is_empty() {
                return Err(FitSubdivisionError::Apart { count: self.points.len() });
            }
            let [max, rms] = feet.missed.distances();
            let has_settled = before - rms < LEAST_GAIN * before;
            before = rms;
            self.steps.push(TraceStep { iteration: self.steps.len() as u64, max, rms });
            if has_settled || iteration == self.iterations {
                return Ok((mesh, feet.nearest));
            }
            let share = feet.points.len() as f64 / mesh.positions().len() as f64;
            if let Some(scan) = self.scan {
                feet.hold(&scan.feet(&fine));
            }
            let system = System::new(&surface, &feet, &stiffness, self.smoothing * share);
            let found = system.solve(mesh.positions(), progress)?;
            mesh = match self.scan {
                None => mesh.with_positions(found)?,
                Some(_) => unfolded(&surface, &mesh, found)?,
            };
        }
        unreachable!("the last iteration returns")
    }

    fn end(self, mesh: Mesh, nearest: &[Option<Nearest>]) -> FittedSubdivision {
        let left_out = nearest.iter().filter(|nearest| nearest.is_none()).count();
        let trace = Trace::new(self.steps).expect("iterations are counted up");
        FittedSubdivision { mesh, trace, left_out }
    }
}

/// The mesh with its control points in new places, but for those around new folds, which stay.
fn unfolded(
    surface: &Composed,
    mesh: &Mesh,
    mut places: Vec<Point3<f64>>,
) -> Result<Mesh, MeshError> {
    let before = folds(&surface.surface(mesh.positions())?, LEVELS);
    loop {
        let mut after = folds(&surface.surface(&places)?, LEVELS);
        after.retain(|face| before.binary_search(face).is_err());
        let mut is_near = vec![false; places.len()];
        let corners = after.iter().flat_map(|&face| mesh.faces().face(face as usize));
        corners.for_each(|&vertex| is_near[vertex as usize] = true);
        let mut has_changed = false;
        for face in mesh.faces().iter().filter(|face| face.iter().any(|&v| is_near[v as usize])) {
            for &vertex in face {
                let old = mesh.positions()[vertex as usize];
                let place = std::mem::replace(&mut places[vertex as usize], old);
                has_changed |= place != old;
            }
        }
        if !has_changed {
            return mesh.with_positions(places);
        }
    }
}

/// The least cosine between the normals of two neighboring faces of a refined surface that does not fold.
const LEAST_COSINE: f64 = -0.2;

/// The control faces at which a surface after so many steps of subdivision folds, sorted.
fn folds(fine: &Mesh, levels: u32) -> Vec<u32> {
    let edges = fine.edges();
    let mut sides = vec![None; edges.vertices.len()];
    let mut folds = Vec::new();
    for ((face, corners), of_corner) in
        (0_u32..).zip(fine.faces().iter()).zip(edges.of_corner.chunks(3))
    {
        let normal = fine.area_vector(corners).try_normalize(0.0).unwrap_or_default();
        for edge in of_corner {
            if let Some((other, there)) = sides[*edge as usize].replace((normal, face))
                && normal.dot(&other) < LEAST_COSINE
            {
                folds.extend([face, there].map(|face| face >> (2 * levels)));
            }
        }
    }
    folds.sort_unstable();
    folds.dedup();
    folds
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let edges = mesh.edges().vertices;
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let lengths = edges.iter().map(|&[a, b]| (place(a) - place(b)).norm());
    lengths.sum::<f64>() / edges.len().max(1) as f64
}

/// The points that count, and their nearest places on a fine mesh.
struct Feet {
    points: Vec<Column>,
    /// Each place as the mean of three vertices.
    rows: Stencils,
    missed: Missed,
    /// For each point given.
    nearest: Vec<Option<Nearest>>,
}

impl Feet {
    fn new(fine: &Mesh, points: &[Point3<f64>], reach: f64) -> Self {
        let is_near = |place: &NearestPlace| place.distance_sq <= reach * reach;
        let mut places = TriangleTree::new(fine).nearest_to_all(points);
        places.iter_mut().for_each(|place| *place = place.filter(is_near));
        let nearest =
            places.iter().map(|place| Some(Nearest::new(place.as_ref()?, LEVELS))).collect();
        let near = points.iter().zip(places);
        let near = near.filter_map(|(point, place)| Some((Column::from(point.coords), place?)));
        let (points, places): (Vec<Column>, Vec<_>) = near.unzip();
        let corners = fine.faces().corners();
        let (rows, _) = Stencils::build(places.len(), |_: &mut (), k, rows| {
            for (corner, share) in places[k].corners(fine).into_iter().zip(places[k].shares) {
                rows.push(corners[corner], share);
            }
            rows.end();
        });
        let missed = places.iter().map(|place| place.distance_sq);
        let missed = missed.fold(Missed::none(), Missed::and_by);
        Self { points, rows, missed, nearest }
    }

    /// Adds vertices of the fine mesh, which are to be at their feet.
    fn hold(&mut self, feet: &[Foot]) {
        let weighted = feet.iter().map(|foot| Column::from(foot.place.coords * foot.weight.sqrt()));
        self.points.extend(weighted);
        let (rows, _) = Stencils::build(feet.len(), |_: &mut (), k, rows| {
            rows.push(feet[k].vertex, feet[k].weight.sqrt());
            rows.end();
        });
        self.rows = self.rows.above(&rows, 1.0);
    }
}

/// The equations `A P = X` of the feet of points and `weight^(1/2) L P = 0` below them, which least squares meet as nearly as possible.
struct System {
    rows: Stencils,
    transposed: Stencils,
    right: Vec<Column>,
}

/// The residual that is left of the one at the start where the equations are solved step by step: far below what the next nearest
/// places change.
const PRECISION: f64 = 1e-6;

/// Most steps.
const MOST_STEPS: usize = 500;

impl System {
    fn new(surface: &Composed, feet: &Feet, stiffness: &Stencils, weight: f64) -> Self {
        let rows = feet.rows.times(&surface.rows).above(stiffness, weight.sqrt());
        let mut right = feet.points.clone();
        right.resize(rows.len(), [0.0; 3]);
        Self { transposed: rows.transposed(stiffness.len()), rows, right }
    }

    /// The control points: by factors, or where these do not determine them all, with the least change from those that are known.
    fn solve(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        progress.check()?;
        let Some(factors) = Cholesky::new(&self.rows.squared_with(&self.transposed)) else {
            return self.conjugate_gradients(start, progress);
        };
        let mut control = self.transposed.apply(&self.right);
        factors.solve(&mut control);
        Ok(control.into_iter().map(Point3::from).collect())
    }

    fn conjugate_gradients(
        &self,
        start: &[Point3<f64>],
        progress: &Progress<'_>,
    ) -> Result<Vec<Point3<f64>>, Cancelled> {
        let mut control: Vec<Column> = start.iter().map(|point| point.coords.into()).collect();
        let ones = vec![1.0; control.len()];
        let mut residual = self.transposed.apply(&self.right);
        columns::add(&mut residual, &self.apply(&control), [-1.0; 3]);
        let mut way = residual.clone();
        let mut energy = columns::dot(&residual, &residual, &ones);
        let enough = energy.map(|energy| energy * PRECISION * PRECISION);
        for _ in 0..MOST_STEPS {
            let moves = [0, 1, 2].map(|k| energy[k] > enough[k]);
            if !moves.contains(&true) {
                break;
            }
            progress.check()?;
            let bent = self.apply(&way);
            let curving = columns::dot(&bent, &way, &ones);
            let step = [0, 1, 2].map(|k| match moves[k] && curving[k] > 0.0 {
                true => energy[k] / curving[k],
                false => 0.0,
            });
            columns::add(&mut control, &way, step);
            columns::add(&mut residual, &bent, step.map(|step| -step));
            let after = columns::dot(&residual, &residual, &ones);
            let ratio = [0, 1, 2].map(|k| if moves[k] { after[k] / energy[k] } else { 0.0 });
            columns::follow(&mut way, &residual, ratio);
            energy = after;
        }
        Ok(control.into_iter().map(Point3::from).collect())
    }

    /// The matrix of the normal equations times a column.
    fn apply(&self, x: &[Column]) -> Vec<Column> {
        self.transposed.apply(&self.rows.apply(x))
    }
}

#[cfg(test)]
mod tests;
