//! Reconstructs a surface from points.

use cells::Cube;
use cloud::Cloud;
use contour::{Skin, contour};
use maquette_base::scattered::Scattered;
use maquette_node::{
    Cancelled, Carry, Context, Error, Estimate, Fate, In, Limit, Node, Progress, Promise, TooMuch,
};
use maquette_value::parallel::*;
use maquette_value::{Attribute, CaptureFrame, Faces, Mesh, MeshError, Rgb};
use nalgebra::{Matrix4, Point3, Vector3};
use poisson::{Field, SolveError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use surfels::{Pyramid, Surfel, surfels};

use super::Poses;
use super::common_frame::common_frame;
use super::merge_error::MergeError;

mod cells;
mod cloud;
mod contour;
mod orient;
mod poisson;
mod relax;
mod surfels;
#[cfg(test)]
mod tests;

/// Makes one skin of points: of a cloud, of captures taken from several sides, of the vertices of meshes, or of all together.
///
/// Noise is averaged away, gaps are bridged, and sources that overlap become one skin. Where normals are given, they say what is
/// outside; range images know their sensor's side; elsewhere normals are estimated and turned outwards. The skin is manifold, its faces
/// are evenly large. Points and vertices with an attribute `confidence` count as much as it says, those without 1. Vertices far from all
/// points are flagged `filled`; colors are kept if all sources have some.
///
/// In other programs: Poisson, voxel, wrap, shrinkwrap.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Reconstruct {
    /// Points, range images, or meshes, of which the vertices and normals are taken.
    #[schemars(extend("least" = 1))]
    pub points: Vec<In<Scattered>>,
    /// Whether captures are moved from their cameras' places to the world's.
    #[serde(default)]
    pub poses: Poses,
    /// How the skin is made.
    #[serde(flatten)]
    pub how: Options,
}

/// Which normals tell the outside of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Normals {
    /// Those of the sources where they have some, else estimated ones.
    #[default]
    Given,
    /// Estimated ones.
    Estimated,
}

/// Whether a skin has borders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum SkinKind {
    /// It has none: what no point shows is filled.
    #[default]
    Closed,
    /// It ends at `reach`.
    Open,
}

/// What a skin is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FaceKind {
    /// Triangles.
    #[default]
    Triangles,
    /// Quads, which need not be flat.
    Quads,
}

/// Why points have no skin.
#[derive(Debug, thiserror::Error)]
pub enum ReconstructError {
    /// No source at all.
    #[error("the list `points` is empty, and nothing has no skin")]
    NoSource,
    /// Too few points.
    #[error("there are only {count} different points, but a skin needs at least {FEWEST}")]
    TooFew {
        /// Different places.
        count: usize,
    },
    /// Points without a surface.
    #[error("all points lie on a line: they have no surface")]
    Line,
    /// Points without an inside.
    #[error("all points lie in a plane, which has no inside: choose `skin: Open`")]
    Plane,
    /// Places or a parameter out of the numbers.
    #[error("`{what}` is {value}, but must be {must}")]
    Parameter {
        /// Its name.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Coordinates too far apart.
    #[error(
        "the points are too far from the origin, or too near to or far from each other, to be measured"
    )]
    Far,
    /// No skin at all.
    #[error(
        "no skin is left near the points: their normals point to all sides, or `reach` or `spacing` does not fit them"
    )]
    Nothing,
    /// Sources that do not fit.
    #[error(transparent)]
    Sources(#[from] MergeError),
    /// More than memory should hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Too many vertices.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<SolveError> for ReconstructError {
    fn from(error: SolveError) -> Self {
        match error {
            SolveError::TooMuch(error) => Self::TooMuch(error),
            SolveError::Cancelled(error) => Self::Cancelled(error),
        }
    }
}

/// A tetrahedron has so many corners; fewer points have no inside.
const FEWEST: usize = 4;

/// Cells along each side of the cube around the points.
const SIDE: Limit = Limit {
    most: 1 << MOST_DEPTH,
    of: "cells along a side",
    help: "choose a larger `spacing`, or leave out points that lie far away",
};

/// More halvings than this do not fit the numbers of cells.
const MOST_DEPTH: u32 = 12;

/// Points of all sources; each has some 200 bytes while they are sorted.
const POINTS: Limit = Limit { most: 20_000_000, of: "points", help: "leave out some" };

impl Node for Reconstruct {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "Unpinched"),
        Promise::always("mesh", "NonEmpty"),
        Promise::always("mesh", "Closed")
            .when("with `skin: Closed`", |it| it.how.skin == SkinKind::Closed),
        Promise::always("mesh", "Triangles")
            .when("with `faces: Triangles`", |it| it.how.faces == FaceKind::Triangles),
        Promise::never("mesh", "Triangles")
            .when("with `faces: Quads`", |it| it.how.faces == FaceKind::Quads),
    ];

    const CARRIES: &'static [Carry] = &[Carry::all("points", "mesh", Fate::Dropped)
        .and_cells(Fate::Interpolated)
        .but(&["filled"])];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let points = self.points.iter().map(|points| valid(&cx.get(points))).sum::<usize>() as f64;
        // The grids of the first depths are whole; the finer ones follow the points, and what is not seen between them.
        Some(Estimate { bytes: 1e7 + points * 3000.0, help: poisson::NODES.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let sources: Vec<Scattered> = self.points.iter().map(|points| cx.get(points)).collect();
        let known = sources.iter().filter(|source| pose(source).is_some()).count();
        if self.poses == Poses::Auto && 0 < known && known < sources.len() {
            let all = sources.len();
            cx.warn(format!(
                "only {known} of {all} sources have a pose, so that all stay as they lie"
            ));
        }
        Ok((reconstruct(&sources, self.poses, &self.how, cx.progress())?,))
    }
}

/// How a skin is made; see [`Reconstruct`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Options {
    /// Length of the skin's edges; 0 is as fine as the points and their noise allow. Large ones make a first control mesh.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub spacing: f64,
    /// How strongly the skin is held to the points: less is smoother.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "four")]
    pub screening: f64,
    /// Which normals tell the outside.
    #[serde(default)]
    pub normals: Normals,
    /// Whether the skin is closed, or ends where the points do.
    #[serde(default)]
    pub skin: SkinKind,
    /// How far from the nearest point the skin still belongs to the points, in multiples of the points' distance from each other
    /// (or of the skin's edges, if these are longer).
    #[schemars(range(min = 0.5, max = 1000.0))]
    #[serde(default = "two")]
    pub reach: f64,
    /// What the skin is made of.
    #[serde(default)]
    pub faces: FaceKind,
}

fn four() -> f64 {
    4.0
}

fn two() -> f64 {
    2.0
}

impl Default for Options {
    fn default() -> Self {
        Self {
            spacing: 0.0,
            screening: four(),
            normals: Normals::default(),
            skin: SkinKind::default(),
            reach: two(),
            faces: FaceKind::default(),
        }
    }
}

/// One skin of the points of all sources, in mm; see [`Reconstruct`].
///
/// Vertices are those of a grid's cells in rows, moved along the surface until they are evenly spread: Gibson, "Constrained elastic
/// surface nets" (1998), of a screened Poisson function (Kazhdan and Hoppe, 2013) of points with normals, which are estimated and
/// oriented after Hoppe et al. (1992). The finest grid has the edge `spacing`; chosen, it is 1.25 times the distance of points, or
/// 1.5 times the deviation of the points from their surface, if that is more.
///
/// # Errors
/// If there is no source, there are too few points, all lie on a line or, for a closed skin, in a plane, a pose is missing with [`Poses::Apply`], a
/// parameter is out of its range, or the result would be too large.
pub fn reconstruct(
    sources: &[Scattered],
    poses: Poses,
    options: &Options,
    progress: &Progress<'_>,
) -> Result<Mesh, ReconstructError> {
    options.check()?;
    if sources.is_empty() {
        return Err(ReconstructError::NoSource);
    }
    let (poses, frame) = placed(sources, poses)?;
    let count: usize = sources.iter().map(count).sum();
    POINTS.check("the skin", count as f64)?;
    let cloud = Cloud::new(sources, &poses, options.normals == Normals::Given);
    let pieces = Pieces::new(&cloud, options, progress)?;
    let field = progress.part(0.3..0.7, |progress| {
        Field::solve(&pieces.pyramid, &pieces.surfels, options.screening, progress)
    })?;
    let mut skin = progress.part(0.7..0.85, |progress| contour(&field, progress))?;
    progress.part(0.85..0.95, |progress| relax::relax(&mut skin, &field, progress))?;
    drop(field);
    let Pieces { pyramid, surfels, noise } = &pieces;
    let mut supported = relax::supported(&skin, pyramid, surfels, options.reach, *noise);
    relax::drop_chance(&mut skin, &mut supported);
    if options.skin == SkinKind::Open {
        relax::open(&mut skin, &mut supported);
    }
    if skin.quads.is_empty() {
        return Err(ReconstructError::Nothing);
    }
    let colors = cloud.colors.as_ref().map(|colors| painted(&skin, &pieces, colors));
    let mesh = Mesh::new(skin.positions.clone(), faces(&skin, options.faces)?)?.with_frame(frame);
    let mesh = match colors {
        Some(colors) => mesh.with_vertex("color", Attribute::Color(colors.into()))?,
        None => mesh,
    };
    if supported.iter().all(|&is_supported| is_supported) {
        return Ok(mesh);
    }
    let filled: Vec<u8> = supported.iter().map(|&is_supported| u8::from(!is_supported)).collect();
    Ok(mesh.with_vertex("filled", Attribute::Flag(filled.into()))?)
}

impl Options {
    fn check(&self) -> Result<(), ReconstructError> {
        fn outside(
            what: &'static str,
            value: f64,
            is_right: bool,
            must: &'static str,
        ) -> Result<(), ReconstructError> {
            match is_right {
                true => Ok(()),
                false => Err(ReconstructError::Parameter { what, value, must }),
            }
        }
        let is_spacing = (0.0..1e50).contains(&self.spacing);
        outside("spacing", self.spacing, is_spacing, "a length, or 0")?;
        let is_screening = (0.0..=100.0).contains(&self.screening);
        outside("screening", self.screening, is_screening, "from 0 to 100")?;
        let is_reach = (0.5..=1000.0).contains(&self.reach);
        outside("reach", self.reach, is_reach, "from 0.5 to 1000")
    }
}

/// From a source's frame to the world's, if it is known.
type Pose = Option<Matrix4<f64>>;

fn pose(source: &Scattered) -> Pose {
    match source {
        Scattered::Points(_) => None,
        Scattered::RangeImage(range) => range.world_from_camera().copied(),
        Scattered::Mesh(mesh) => mesh.frame()?.world_from_camera,
    }
}

fn count(source: &Scattered) -> usize {
    match source {
        Scattered::Points(points) => points.positions().len(),
        Scattered::RangeImage(range) => range.points().len(),
        Scattered::Mesh(mesh) => mesh.positions().len(),
    }
}

/// How many of a source's points are there.
fn valid(source: &Scattered) -> usize {
    match source {
        Scattered::RangeImage(range) => range.points().iter().filter(|at| at.x.is_finite()).count(),
        other => count(other),
    }
}

/// The pose of each source that is moved, and the frame of the skin.
fn placed(
    sources: &[Scattered],
    poses: Poses,
) -> Result<(Vec<Pose>, Option<CaptureFrame>), ReconstructError> {
    let known: Vec<Pose> = sources.iter().map(pose).collect();
    let nowhere = known.iter().position(Option::is_none);
    if let (Some(place), Poses::Apply) = (nowhere, poses) {
        return Err(MergeError::NoPose { mesh: place + 1 }.into());
    }
    if nowhere.is_none() && poses != Poses::Ignore {
        return Ok((known, None));
    }
    let frames: Vec<Option<CaptureFrame>> = sources
        .iter()
        .map(|source| match source {
            Scattered::Points(_) => None,
            Scattered::RangeImage(range) => range.capture_frame().ok(),
            Scattered::Mesh(mesh) => mesh.frame().copied(),
        })
        .collect();
    Ok((vec![None; sources.len()], common_frame(&frames)))
}

/// The points as pieces of a surface.
struct Pieces {
    pyramid: Pyramid,
    surfels: Vec<Surfel>,
    /// Deviation of the points from their surface, in mm.
    noise: f64,
}

/// Edges of the grid, in distances of points: with shorter ones holes appear between the points, longer ones lose detail.
const PER_DISTANCE: f64 = 1.25;

/// Edges of the grid, in deviations of the points: then some hundred points are averaged where noise is larger than their distance.
const PER_NOISE: f64 = 1.5;

impl Pieces {
    fn new(
        cloud: &Cloud,
        options: &Options,
        progress: &Progress<'_>,
    ) -> Result<Self, ReconstructError> {
        let distance = check(&cloud.positions, options.skin)?;
        progress.tick(0.02)?;
        let given = options.spacing > 0.0;
        let mut edge = if given { options.spacing } else { PER_DISTANCE * distance };
        let mut pyramid = Pyramid::new(cloud, cube(&cloud.positions, edge)?);
        progress.tick(0.06)?;
        let (mut flat, mut noise) = pyramid.flat_depth();
        if !given && PER_NOISE * noise > 1.1 * edge {
            edge = PER_NOISE * noise;
            pyramid = Pyramid::new(cloud, cube(&cloud.positions, edge)?);
            (flat, noise) = pyramid.flat_depth();
        }
        let mut surfels =
            progress.part(0.1..0.2, |progress| surfels(&pyramid, cloud, flat, progress))?;
        progress.part(0.2..0.3, |progress| orient::orient(&pyramid, &mut surfels, progress))?;
        Ok(Self { pyramid, surfels, noise })
    }
}

/// The mean distance of points, after a check that they lie on a surface at all.
fn check(positions: &[Point3<f64>], skin: SkinKind) -> Result<f64, ReconstructError> {
    let (low, high) = bounds(positions).ok_or(ReconstructError::TooFew { count: 0 })?;
    let size = (high - low).max();
    let far = low.coords.amax().max(high.coords.amax());
    let is_measurable = (size == 0.0 || 1e-100 < size) && size < 1e100 && far < 1e100;
    if !is_measurable {
        return Err(ReconstructError::Far);
    }
    let mut different: Vec<[u64; 3]> = positions
        .par_iter()
        .map(|point| [point.x, point.y, point.z].map(|x| (x + 0.0).to_bits()))
        .collect();
    different.par_sort_unstable();
    different.dedup();
    let count = different.len();
    if count < FEWEST {
        return Err(ReconstructError::TooFew { count });
    }
    let middle = nalgebra::center(&low, &high);
    let covariance = positions.iter().fold(nalgebra::Matrix3::zeros(), |sum, point| {
        let offset = (point - middle) / size;
        sum + offset * offset.transpose()
    });
    let mean: Vector3<f64> = positions.iter().map(|point| (point - middle) / size).sum();
    let covariance = covariance - mean * mean.transpose() / positions.len() as f64;
    let eigen = covariance.try_symmetric_eigen(f64::EPSILON, 1000);
    let mut spread: [f64; 3] = eigen.ok_or(ReconstructError::Far)?.eigenvalues.into();
    spread.sort_by(f64::total_cmp);
    // Squares: a millionth of the length.
    fn is_none(spread: f64, most: f64) -> bool {
        spread.is_nan() || spread <= 1e-12 * most
    }
    if is_none(spread[1], spread[2]) {
        return Err(ReconstructError::Line);
    }
    if is_none(spread[0], spread[2]) && skin == SkinKind::Closed {
        return Err(ReconstructError::Plane);
    }
    Ok(distance(positions, count, low, size))
}

/// The mean distance of points on a surface: from the cells that they lie in, if these are so large that each has four of them.
fn distance(positions: &[Point3<f64>], count: usize, low: Point3<f64>, size: f64) -> f64 {
    let mut last = (size, count as f64);
    for depth in 1..=MOST_DEPTH {
        let cube = Cube { corner: low, edge: size / f64::from(1_u32 << depth), depth };
        let keys = surfels::by_cell(positions, &cube);
        let occupied = keys.chunk_by(|a, b| a.0 == b.0).count() as f64;
        let each = count as f64 / occupied;
        if each < PER_CELL {
            // Between both depths by what each of them has, on a logarithmic scale.
            let share = libm::log(PER_CELL / each) / libm::log(last.1 / each).max(1e-9);
            let edge = cube.edge * libm::exp2(share.clamp(0.0, 1.0));
            return edge / (PER_CELL * CROSSED).sqrt();
        }
        last = (cube.edge, each);
    }
    last.0 / (last.1 * CROSSED).sqrt()
}

/// Points in a cell whose size tells their distance.
const PER_CELL: f64 = 4.0;

/// Cells that a surface runs through are so many times as many as its area in squared cells, on average over all directions.
const CROSSED: f64 = 1.5;

fn bounds(positions: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = *positions.first()?;
    Some(
        positions
            .iter()
            .fold((first, first), |(low, high), point| (low.inf(point), high.sup(point))),
    )
}

/// A cube around all points, with a quarter of their size as margin, in cells of this edge.
fn cube(positions: &[Point3<f64>], edge: f64) -> Result<Cube, ReconstructError> {
    let (low, high) = bounds(positions).ok_or(ReconstructError::TooFew { count: 0 })?;
    let size = (high - low).max();
    let cells = (1.25 * size / edge).max(1.0) + 8.0;
    SIDE.check("the grid", cells)?;
    let depth = (1..=MOST_DEPTH).find(|&depth| f64::from(1_u32 << depth) >= cells);
    let depth = depth.unwrap_or(MOST_DEPTH);
    let half = Vector3::repeat(0.5 * edge * f64::from(1_u32 << depth));
    Ok(Cube { corner: nalgebra::center(&low, &high) - half, edge, depth })
}

/// Quads, or two triangles of each, along its shorter diagonal.
fn faces(skin: &Skin, kind: FaceKind) -> Result<Faces, MeshError> {
    if kind == FaceKind::Quads {
        return Faces::uniform(4, skin.quads.concat());
    }
    fn at(vertex: u32, skin_positions: &[Point3<f64>]) -> Point3<f64> {
        skin_positions[vertex as usize]
    }
    Ok(Faces::triangles(
        skin.quads
            .par_iter()
            .flat_map_iter(|&[a, b, c, d]| {
                let is_first = (at(a, &skin.positions) - at(c, &skin.positions)).norm_squared()
                    <= (at(b, &skin.positions) - at(d, &skin.positions)).norm_squared();
                if is_first { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
            })
            .collect(),
    ))
}

/// The mean color of the points around each vertex.
fn painted(skin: &Skin, pieces: &Pieces, colors: &[Rgb]) -> Vec<Rgb> {
    let of_cells = pieces.pyramid.colors(colors);
    skin.positions.par_iter().map(|at| pieces.pyramid.color_at(at, &of_cells)).collect()
}
