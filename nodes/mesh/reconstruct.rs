//! Reconstructs a surface from points.

use cells::Cube;
use cloud::Cloud;
use contour::contour;
use maquette_base::scattered::Scattered;
use maquette_node::{
    Carry, Certainty, Context, Error, Estimate, Forecast, In, Limit, Node, Progress, Promise,
    Sizes, Transfer, ValueSize, bail,
};
use maquette_value::parallel::*;
use maquette_value::{Attribute, CaptureFrame, Mesh};
use nalgebra::{Matrix4, Point3, Vector3};
use pieces::Pieces;
use poisson::Field;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use surfels::{Pyramid, surfels};

use super::common_frame::common_frame;
use super::poses::{Poses, no_pose_error};

mod cells;
mod cloud;
mod colors;
mod contour;
mod doubts;
mod fit;
mod orient;
mod pieces;
mod poisson;
mod relax;
mod surfels;
#[cfg(test)]
mod tests;
mod thin;

/// Reconstructs one surface from points: of a cloud, of captures taken from several sides, of the vertices of meshes, or of all together.
///
/// Noise is averaged, gaps are bridged, and overlapping sources become one surface. Given normals determine the outside; range images know
/// the side of their sensor; otherwise normals are estimated and oriented outward. The surface is manifold with faces of uniform size.
/// Points and vertices with an attribute `confidence` are weighted by it, others by 1. Vertices far from all points are flagged `filled`;
/// colors are kept if all sources have some, and flow smoothly over what is filled.
///
/// In other programs: Poisson, voxel, wrap, shrinkwrap.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Reconstruct {
    /// Points, range images, or meshes. Of meshes, the vertices and normals are used.
    #[schemars(extend("least" = 1))]
    pub points: Vec<In<Scattered>>,
    /// Motion of captures from camera to world coordinates.
    #[serde(default)]
    pub poses: Poses,
    /// Parameters of the reconstruction.
    #[serde(flatten)]
    pub how: Options,
}

/// The source of the normals that determine the outside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Normals {
    /// The normals of the sources, estimated where they have none.
    #[default]
    Given,
    /// Normals that are estimated from the points.
    Estimated,
}

/// The border of the result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum SkinKind {
    /// The result is closed; areas without points are filled.
    #[default]
    Closed,
    /// The result ends at the distance `reach` from the points.
    Open,
}

/// The faces of the result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FaceKind {
    /// Triangles.
    #[default]
    Triangles,
    /// Quads, which need not be planar.
    Quads,
}

/// Minimum number of distinct points; fewer points enclose no volume.
const MIN_POINTS: usize = 4;

/// Maximum number of cells along each side of the cube that contains the points.
const SIDE: Limit = Limit {
    max: 1 << MAX_DEPTH,
    items: "cells along a side",
    help: "choose a larger `spacing`, or remove points that are far away",
};

/// Maximum depth of the grid: the number of times that the cube around the points is halved. With a larger depth, the numbers of cells
/// would overflow.
const MAX_DEPTH: u32 = 12;

/// Maximum number of points of all sources together; each point needs about 200 bytes while the points are sorted.
const POINTS: Limit = Limit { max: 20_000_000, items: "points", help: "leave out some" };

impl Node for Reconstruct {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "Unpinched"),
        Promise::always("mesh", "NonEmpty"),
        Promise::always("mesh", "Closed")
            .only_if("with `skin: Closed`", |it| it.how.skin == SkinKind::Closed),
        Promise::always("mesh", "Triangles")
            .only_if("with `faces: Triangles`", |it| it.how.faces == FaceKind::Triangles),
        Promise::never_has("mesh", "Triangles")
            .only_if("with `faces: Quads`", |it| it.how.faces == FaceKind::Quads),
    ];

    const CARRIES: &'static [Carry] = &[Carry::uniform("points", "mesh", Transfer::Dropped)
        .and_cells(Transfer::Interpolated)
        .excluding(&["filled"])];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let points = self.points.iter().map(|points| valid(&cx.get(points))).sum::<usize>() as f64;
        Some(Estimate { bytes: memory(points), help: poisson::NODES.help })
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let points: Option<Vec<_>> = self.points.iter().map(|points| sizes.get(points)).collect();
        let points = points?.into_iter().reduce(ValueSize::plus)?;
        // Where edges are as long as the points are apart, there is about a vertex for each point.
        let skin = ValueSize::mesh(points.points, 2.0 * points.points, 6.0 * points.points);
        let skin = skin.at_most(Certainty::Guess);
        let bytes = memory(points.points);
        Some(Forecast::by_law(skin).with_memory(bytes, poisson::NODES.help))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let sources: Vec<Scattered> = self.points.iter().map(|points| cx.get(points)).collect();
        let known = sources.iter().filter(|source| pose(source).is_some()).count();
        if self.poses == Poses::Auto && 0 < known && known < sources.len() {
            let all = sources.len();
            let first = 1 + sources.iter().position(|source| pose(source).is_none()).unwrap_or(0);
            cx.warn(format!(
                "only {known} of {all} sources have a pose, not source {first}, so that none is moved; `poses: Ignore` says that this is right"
            ));
        }
        let result = reconstruct_with_warnings(&sources, self.poses, &self.how, cx.progress())?;
        result.warnings.into_iter().for_each(|warning| cx.warn(warning));
        Ok((result.mesh,))
    }
}

/// Returns an upper bound of the memory in bytes that the reconstruction of some points takes.
///
/// The constant term is for the coarse grids, which fill the whole cube. Finer grids cover only the points and unscanned regions between
/// them.
fn memory(points: f64) -> f64 {
    1e7 + points * 3000.0
}

/// Parameters of the reconstruction; see [`Reconstruct`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Options {
    /// Edge length of the result in mm; 0 is as fine as the points and their noise allow. Large values make a first control mesh.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub spacing: f64,
    /// Weight of the points: smaller values give a smoother surface.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(default = "default_screening")]
    pub screening: f64,
    /// Source of the normals that determine the outside.
    #[serde(default)]
    pub normals: Normals,
    /// Closes the result, or ends it where the points end.
    #[serde(default)]
    pub skin: SkinKind,
    /// Maximum distance between the surface and the nearest point, in multiples of the spacing of the points (or of the edge length, if
    /// that is larger).
    #[schemars(range(min = 0.5, max = 1000.0))]
    #[serde(default = "default_reach")]
    pub reach: f64,
    /// The faces of the result.
    #[serde(default)]
    pub faces: FaceKind,
}

fn default_screening() -> f64 {
    4.0
}

fn default_reach() -> f64 {
    2.0
}

impl Default for Options {
    fn default() -> Self {
        Self {
            spacing: 0.0,
            screening: default_screening(),
            normals: Normals::default(),
            skin: SkinKind::default(),
            reach: default_reach(),
            faces: FaceKind::default(),
        }
    }
}

/// Reconstructs one surface from the points of all sources, in mm; see [`Reconstruct`].
///
/// The mesh is a surface net (Gibson, "Constrained elastic surface nets", 1998): a mesh with a vertex in each grid cell that the surface
/// intersects, whose vertices are moved along the surface until they are evenly distributed. The surface is a level set of a screened
/// Poisson function (Kazhdan and Hoppe, 2013) of points with normals, which are estimated and oriented after Hoppe et al. (1992). The
/// net has the edge length `spacing`; the function is computed on finer grids if the points are denser, and the vertices are then moved
/// so that the faces are in the middle of the points (Hoppe et al., "Mesh optimization", 1993). The automatic value of `spacing` is 1.25
/// times the spacing of the points, or 1.5 times the standard deviation of the points from their surface, if that is larger.
///
/// # Errors
/// Returns an error if there is no source, there are too few points, all points are on a line or, for a closed surface, in a plane, a pose
/// is missing with [`Poses::Apply`], a parameter is out of range, or the result would be too large.
pub fn reconstruct(
    sources: &[Scattered],
    poses: Poses,
    options: &Options,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    Ok(reconstruct_with_warnings(sources, poses, options, progress)?.mesh)
}

/// A reconstructed surface, and warnings about points that do not fit to it.
struct Reconstruction {
    mesh: Mesh,
    warnings: Vec<String>,
}

fn reconstruct_with_warnings(
    sources: &[Scattered],
    poses: Poses,
    options: &Options,
    progress: &Progress<'_>,
) -> Result<Reconstruction, Error> {
    options.check()?;
    if sources.is_empty() {
        bail!("the list `points` is empty, so there is nothing to reconstruct");
    }
    let (poses, frame) = place_sources(sources, poses)?;
    let count: usize = sources.iter().map(count).sum();
    POINTS.check("the surface", count as f64)?;
    let mut cloud = Cloud::new(sources, &poses, options.normals == Normals::Given);
    let origin = cloud.move_to_origin();
    let pieces = collect_pieces(&cloud, options, progress)?;
    let mut warnings = doubts::about_points(&pieces);
    let field = progress.part(0.3..0.7, |progress| match pieces.is_thin {
        false => Field::solve(&pieces.pyramid, &pieces.surfels, options.screening, progress),
        true => {
            let surfels = thin::divide(&pieces.pyramid, &pieces.surfels);
            Field::solve(&pieces.pyramid, &surfels, options.screening, progress)
        }
    })?;
    let skin_depth = pieces.skin_depth;
    let mut skin = progress.part(0.7..0.8, |progress| contour(&field, skin_depth, progress))?;
    let net = skin.positions.clone();
    progress.part(0.8..0.9, |progress| relax::relax(&mut skin, &field, skin_depth, progress))?;
    drop(field);
    if options.spacing > 0.0 {
        let missed = progress
            .part(0.9..0.97, |progress| fit::fit(&mut skin, &pieces, &cloud, &net, progress))?;
        let Pieces { gap, .. } = pieces;
        warnings.extend(doubts::about_thin_parts(missed, options.spacing, gap, &origin));
    }
    let mut supported = relax::find_supported(&skin, &pieces, options.reach);
    relax::drop_chance(&mut skin, &mut supported);
    match options.skin {
        SkinKind::Open => relax::remove_unsupported(&mut skin, &mut supported),
        SkinKind::Closed if cloud.has_sides() => {}
        SkinKind::Closed => {
            let warning = doubts::about_filled_parts(&skin, &supported, pieces.gap, &origin);
            warnings.extend(warning);
        }
    }
    if skin.quads.is_empty() {
        return Err(no_surface_error(options, &pieces));
    }
    let faces = skin.faces(options.faces == FaceKind::Quads)?;
    let mesh = Mesh::new(skin.positions.clone(), faces)?.with_frame(frame);
    warnings.extend(doubts::about_parts(&mesh, &relax::parts(&skin)));
    let mesh = match &cloud.colors {
        Some(colors) => {
            let colors = progress.part(0.97..1.0, |progress| {
                colors::vertex_colors(&mesh, &supported, &pieces, colors, progress)
            })?;
            mesh.with_vertex("color", Attribute::Color(colors.into()))?
        }
        None => mesh,
    };
    let mesh = if origin == Vector3::zeros() {
        mesh
    } else {
        let positions = mesh.positions().iter().map(|at| at + origin).collect();
        mesh.with_positions(positions)?
    };
    if supported.iter().all(|&is_supported| is_supported) {
        return Ok(Reconstruction { mesh, warnings });
    }
    let filled: Vec<u8> = supported.iter().map(|&is_supported| u8::from(!is_supported)).collect();
    let mesh = mesh.with_vertex("filled", Attribute::Flag(filled.into()))?;
    Ok(Reconstruction { mesh, warnings })
}

impl Options {
    fn check(&self) -> Result<(), Error> {
        fn check_range(
            name: &str,
            value: f64,
            is_in_range: bool,
            range: &str,
        ) -> Result<(), Error> {
            if !is_in_range {
                bail!("`{name}` is {value}, but must be {range}");
            }
            Ok(())
        }
        let is_spacing = (0.0..1e50).contains(&self.spacing);
        check_range("spacing", self.spacing, is_spacing, "a length, or 0")?;
        let is_screening = (0.0..=100.0).contains(&self.screening);
        check_range("screening", self.screening, is_screening, "from 0 to 100")?;
        let is_reach = (0.5..=1000.0).contains(&self.reach);
        check_range("reach", self.reach, is_reach, "from 0.5 to 1000")
    }
}

/// The transform from a source's capture frame to world coordinates; `None` if it is not known.
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

/// Returns the number of points of a source, without the cells of a range image that have no point.
fn valid(source: &Scattered) -> usize {
    match source {
        Scattered::RangeImage(range) => range.points().iter().filter(|at| at.x.is_finite()).count(),
        other => count(other),
    }
}

/// Returns the pose by which each source is moved (`None` for a source that stays), and the capture frame of the result.
fn place_sources(
    sources: &[Scattered],
    poses: Poses,
) -> Result<(Vec<Pose>, Option<CaptureFrame>), Error> {
    let known: Vec<Pose> = sources.iter().map(pose).collect();
    let nowhere = known.iter().position(Option::is_none);
    if let (Some(place), Poses::Apply) = (nowhere, poses) {
        return Err(no_pose_error(place + 1));
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

/// Minimum edge length of the grid's cells, in multiples of the points' spacing, if `spacing` is automatic. Shorter edges leave holes
/// between the points, longer ones lose detail.
const PER_DISTANCE: f64 = 1.25;

/// Minimum edge length of the grid's cells, in standard deviations of the points from their surface, if `spacing` is automatic. Where the
/// noise is larger than the spacing of the points, about a hundred points are then averaged.
const PER_NOISE: f64 = 1.5;

/// Combines the points of all sources into surface elements.
fn collect_pieces(
    cloud: &Cloud,
    options: &Options,
    progress: &Progress<'_>,
) -> Result<Pieces, Error> {
    let distance = check(&cloud.positions, options.skin)?;
    progress.tick(0.02)?;
    let given = options.spacing > 0.0;
    let edge = if given { options.spacing } else { PER_DISTANCE * distance };
    let halvings = if given { count_halvings(edge, FINEST * distance) } else { 0 };
    let mut grid = Grid { edge, halvings };
    let mut pyramid = grid.pyramid(cloud, progress)?;
    progress.tick(0.06)?;
    let (mut flat, mut noise) = pyramid.flat_depth();
    // Sides that a given `spacing` cannot separate count as one noisy sheet.
    let gap = thin::find_gap(&pyramid, cloud, flat, distance)
        .filter(|gap| !given || gap.width >= GAP * edge);
    // Opposite sides in one neighborhood are not noise.
    noise = gap.map_or(noise, |gap| noise.min(gap.noise));
    let width = gap.map_or(f64::INFINITY, |gap| gap.width);
    let largest = width / thin::RESOLVED;
    let is_thin = largest < edge && !given;
    let noisy_edge = (PER_NOISE * noise).min(largest);
    let better = if given {
        Grid { edge, halvings: count_halvings(edge, noisy_edge).min(halvings) }
    } else if is_thin || noisy_edge > 1.1 * edge {
        Grid { edge: if is_thin { largest } else { noisy_edge }, halvings: 0 }
    } else {
        grid
    };
    if better != grid {
        grid = better;
        pyramid = grid.pyramid(cloud, progress)?;
        pyramid.thickness = gap.map(|_| width / pyramid.cube.edge);
        (flat, noise) = pyramid.flat_depth();
        noise = gap.map_or(noise, |gap| noise.min(gap.noise));
        if is_thin {
            flat = thin::flat_depth(&pyramid.cube, flat);
        }
    }
    pyramid.thickness = gap.map(|_| width / pyramid.cube.edge);
    let mut surfels =
        progress.part(0.1..0.2, |progress| surfels(&pyramid, cloud, flat, progress))?;
    progress.part(0.2..0.3, |progress| orient::orient(&pyramid, &mut surfels, width, progress))?;
    let skin_depth = pyramid.cube.depth - grid.halvings;
    Ok(Pieces { pyramid, surfels, noise, distance, skin_depth, gap, is_thin })
}

/// A grid of cells: the edge length of the result's cells in mm, and the number of times that they are halved.
#[derive(Clone, Copy, PartialEq)]
struct Grid {
    edge: f64,
    halvings: u32,
}

impl Grid {
    fn pyramid(self, cloud: &Cloud, progress: &Progress<'_>) -> Result<Pyramid, Error> {
        let cube = cube(&cloud.positions, self.edge, self.halvings)?;
        Ok(Pyramid::new(cloud, cube, GAP * self.edge, progress)?)
    }
}

/// Minimum distance of two sheets of the surface, in edges of the result.
const GAP: f64 = 0.6;

/// Minimum edge length of the grid's cells, in multiples of the points' spacing, if `spacing` is given.
const FINEST: f64 = 0.7;

/// Returns the number of times that `edge` can be halved without getting shorter than `least`.
fn count_halvings(edge: f64, least: f64) -> u32 {
    (1..=MAX_DEPTH).take_while(|&k| edge >= least * f64::from(1_u32 << k)).count() as u32
}

/// Returns the error for `count` distinct points, which enclose no volume.
fn too_few_error(count: usize) -> Error {
    Error::new(format!(
        "there are only {count} different points, but a surface needs at least {MIN_POINTS}"
    ))
}

/// Returns the error for a result without faces.
fn no_surface_error(options: &Options, pieces: &Pieces) -> Error {
    let Options { spacing, reach, .. } = options;
    let distance = pieces.distance;
    let least = PER_DISTANCE * distance;
    let has_planes = pieces.surfels.iter().any(|surfel| surfel.normal != Vector3::zeros());
    let cause = if !has_planes {
        "they are too few to show where the surface is; add points, or vertices to a mesh by `Remesh`".into()
    } else if *spacing > 0.0 && *spacing < least {
        format!(
            "`spacing` is {spacing} mm, but that of the points about {distance:.3} mm: choose at least {least:.3}, or 0"
        )
    } else if options.normals == Normals::Given {
        format!(
            "their normals are inconsistent, or they are farther from each other than `reach`, {reach}: try `normals: Estimated`, or a larger `reach`"
        )
    } else {
        format!("they are farther from each other than `reach`, {reach}: choose a larger one")
    };
    Error::new(format!("no surface is left near the points: {cause}"))
}

/// Returns the error for coordinates whose squares would overflow or underflow.
fn unmeasurable_error() -> Error {
    Error::new(
        "the points are too far from the origin, or too near to or far from each other, to be measured",
    )
}

/// Checks that the points are distinct and spread enough to define a surface of this kind, and returns their mean spacing in mm.
fn check(positions: &[Point3<f64>], skin: SkinKind) -> Result<f64, Error> {
    let (low, high) = bounds(positions).ok_or_else(|| too_few_error(0))?;
    let size = (high - low).max();
    let far = low.coords.amax().max(high.coords.amax());
    let is_measurable = (size == 0.0 || 1e-100 < size) && size < 1e100 && far < 1e100;
    if !is_measurable {
        return Err(unmeasurable_error());
    }
    let mut different: Vec<[u64; 3]> = positions
        .par_iter()
        .map(|point| [point.x, point.y, point.z].map(|x| (x + 0.0).to_bits()))
        .collect();
    different.par_sort_unstable();
    different.dedup();
    let count = different.len();
    if count < MIN_POINTS {
        return Err(too_few_error(count));
    }
    let middle = nalgebra::center(&low, &high);
    let covariance = positions.iter().fold(nalgebra::Matrix3::zeros(), |sum, point| {
        let offset = (point - middle) / size;
        sum + offset * offset.transpose()
    });
    let mean: Vector3<f64> = positions.iter().map(|point| (point - middle) / size).sum();
    let covariance = covariance - mean * mean.transpose() / positions.len() as f64;
    let eigen = covariance.try_symmetric_eigen(f64::EPSILON, 1000);
    let mut spread: [f64; 3] = eigen.ok_or_else(unmeasurable_error)?.eigenvalues.into();
    spread.sort_by(f64::total_cmp);
    // The spreads are squared lengths, so the limit is the square of a millionth of the length.
    fn is_none(spread: f64, most: f64) -> bool {
        spread.is_nan() || spread <= 1e-12 * most
    }
    if is_none(spread[1], spread[2]) {
        bail!("all points are on a line: they have no surface");
    }
    if is_none(spread[0], spread[2]) && skin == SkinKind::Closed {
        bail!("all points are in a plane, which has no inside: choose `skin: Open`");
    }
    Ok(distance(positions, count, low, size))
}

/// Returns the mean spacing of points on a surface. The spacing is derived from the number of occupied grid cells, at the cell size for
/// which an occupied cell contains four points on average.
fn distance(positions: &[Point3<f64>], count: usize, low: Point3<f64>, size: f64) -> f64 {
    let mut last = (size, count as f64);
    for depth in 1..=MAX_DEPTH {
        let cube = Cube { corner: low, edge: size / f64::from(1_u32 << depth), depth };
        let keys = surfels::by_cell(positions, &cube);
        let occupied = keys.chunk_by(|a, b| a.0 == b.0).count() as f64;
        let each = count as f64 / occupied;
        if each < POINTS_PER_CELL {
            // Interpolate the cell size, on a logarithmic scale, between those of this depth and of the previous depth.
            let share = libm::log(POINTS_PER_CELL / each) / libm::log(last.1 / each).max(1e-9);
            let edge = cube.edge * libm::exp2(share.clamp(0.0, 1.0));
            return edge / (POINTS_PER_CELL * CROSSED).sqrt();
        }
        last = (cube.edge, each);
    }
    last.0 / (last.1 * CROSSED).sqrt()
}

/// Mean number of points per occupied cell at the cell size from which the spacing is computed.
const POINTS_PER_CELL: f64 = 4.0;

/// The number of cells that a surface intersects, divided by its area in squared cells, averaged over all directions.
const CROSSED: f64 = 1.5;

fn bounds(positions: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = *positions.first()?;
    Some(
        positions
            .iter()
            .fold((first, first), |(low, high), point| (low.inf(point), high.sup(point))),
    )
}

/// Returns a cube around all points, with a quarter of their extent as margin, in cells of the given edge length that are halved `halvings`
/// times.
fn cube(positions: &[Point3<f64>], edge: f64, halvings: u32) -> Result<Cube, Error> {
    let (low, high) = bounds(positions).ok_or_else(|| too_few_error(0))?;
    let size = (high - low).max();
    let cells = (1.25 * size / edge).max(1.0) + 8.0;
    SIDE.check("the grid", cells)?;
    let depth = (1..=MAX_DEPTH).find(|&depth| f64::from(1_u32 << depth) >= cells);
    let depth = depth.unwrap_or(MAX_DEPTH);
    let halvings = halvings.min(MAX_DEPTH - depth);
    let half = Vector3::repeat(0.5 * edge * f64::from(1_u32 << depth));
    Ok(Cube {
        corner: nalgebra::center(&low, &high) - half,
        edge: edge / f64::from(1_u32 << halvings),
        depth: depth + halvings,
    })
}
