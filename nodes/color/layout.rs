//! Texture coordinates for any mesh: charts, each flat without a fold, side by side in a square.

use chart::Chart;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Cancelled, FieldError, Limit, Progress, TooMuch};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Mesh, MeshError};
use nalgebra::{Vector2, Vector3};
use pack::{PackError, Piece, pack};
use schemars::JsonSchema;
use segment::{NONE, faces_of_corners, opposites, segment};
use serde::{Deserialize, Serialize};

mod chart;
mod overlaps;
mod pack;
mod segment;
#[cfg(test)]
mod tests;

pub(crate) use overlaps::overlap;

/// How a surface is laid out in a square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Layout {
    /// Width and height of the atlas.
    #[schemars(range(min = 16, max = 8192), extend("unit" = "px"))]
    #[serde(default = "thousand")]
    pub size: usize,
    /// Least distance of two charts, so that neither interpolation nor smaller copies of the picture mix their colors; at the border of the
    /// atlas it is half of that.
    #[schemars(range(max = 256), extend("unit" = "px"))]
    #[serde(default = "four")]
    pub padding: usize,
    /// How far a chart bends: the angle by which its faces turn away from its mean normal. Large ones make few charts and stretch them
    /// more.
    #[schemars(range(min = 1.0, max = 80.0), extend("unit" = "deg"))]
    #[serde(default = "forty")]
    pub bend: f64,
}

fn thousand() -> usize {
    1024
}

fn four() -> usize {
    4
}

fn forty() -> f64 {
    40.0
}

impl Default for Layout {
    fn default() -> Self {
        Self { size: thousand(), padding: four(), bend: forty() }
    }
}

/// Width of an atlas.
pub(crate) const SIZE: Limit =
    Limit { most: 8192, of: "pixels along a side", help: "choose a smaller `size`" };

/// Why a mesh has no layout.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LayoutError {
    /// A mesh without faces.
    #[error("the mesh has no faces, so that there is nothing to lay out")]
    Empty,
    /// Faces that are lines or points.
    #[error("all {faces} faces of the mesh are without an area: nothing can be laid out")]
    NoArea {
        /// How many there are.
        faces: usize,
    },
    /// Places out of the numbers.
    #[error(
        "the mesh is {extent:e} mm large, or too far from the origin, which cannot be measured"
    )]
    Far {
        /// How large it is, in mm.
        extent: f64,
    },
    /// A parameter out of its range.
    #[error("`{what}` is {value}, but must be {must}")]
    Parameter {
        /// Its name.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Too many charts.
    #[error(
        "{charts} charts with a padding of {padding} px do not fit into {size} x {size} px: choose a larger `size` or `bend`, or a \
         smaller `padding`"
    )]
    Full {
        /// How many charts.
        charts: usize,
        /// Texels between them.
        padding: usize,
        /// The atlas.
        size: usize,
    },
    /// An atlas that is too large.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// More corners than a mesh can hold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Layout {
    /// Checks that there is room for a chart beside its padding.
    ///
    /// # Errors
    /// If the atlas holds no chart of any mesh.
    pub(crate) fn check_fields(&self) -> Result<(), FieldError> {
        let Self { size, padding, .. } = *self;
        if padding < size {
            return Ok(());
        }
        let message =
            format!("`padding` is {padding} px, which leaves no room in {size} x {size} px");
        Err(FieldError::new("padding", message, "choose a larger `size`, or a smaller `padding`"))
    }

    /// # Errors
    /// If a parameter is out of its range.
    pub(crate) fn check(&self) -> Result<(), LayoutError> {
        SIZE.check("the atlas", self.size as f64)?;
        fn wrong(what: &'static str, value: f64, must: &'static str) -> Result<(), LayoutError> {
            Err(LayoutError::Parameter { what, value, must })
        }
        if self.size < 16 {
            return wrong("size", self.size as f64, "at least 16 px");
        }
        if 256 < self.padding {
            return wrong("padding", self.padding as f64, "at most 256 px");
        }
        if !(1.0..=80.0).contains(&self.bend) {
            return wrong("bend", self.bend, "from 1 to 80 degrees");
        }
        Ok(())
    }
}

/// A mesh with texture coordinates.
#[derive(Clone, Debug)]
pub struct LaidOut {
    /// The mesh with `uv` at its corners, and without a picture, which would no longer fit.
    pub mesh: Mesh,
    /// How many charts there are.
    pub charts: usize,
    /// Texels for each mm.
    pub scale: f64,
}

/// The mesh with texture coordinates `uv` in which no two faces overlap and none is turned over; polygons count as fans around their first
/// corners.
///
/// Charts are as flat as `bend` says, and cut where faces are turned round or more than two of them meet. Each lies as rigidly as it can
/// (see `chart.rs`), or, where that folds it, as it is seen along its mean normal; where that folds it, too, it is cut further. A
/// polygon whose fan is folded by itself stays so. Cost grows with n log n.
///
/// # Errors
/// If there is nothing to lay out, a parameter is out of its range, or the charts do not fit.
pub fn lay_out(
    mesh: &Mesh,
    layout: &Layout,
    progress: &Progress<'_>,
) -> Result<LaidOut, LayoutError> {
    layout.check()?;
    check(mesh)?;
    let surface = Surface { mesh, opposites: opposites(mesh), of_corner: faces_of_corners(mesh) };
    let flatness = libm::cos(layout.bend.to_radians());
    let segments = progress
        .part(0.0..0.5, |progress| segment(mesh, &surface.opposites, flatness, progress))?;
    progress.tick(0.5)?;
    let charts = segments
        .par_iter()
        .map(|faces| surface.settle(faces.clone(), progress))
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let charts: Vec<_> = charts.into_iter().flatten().collect();
    progress.tick(0.8)?;
    let pieces: Vec<_> = charts
        .iter()
        .map(|chart| Piece { triangles: &chart.triangles, flat: chart.flat.clone() })
        .collect();
    let Layout { size, padding, .. } = *layout;
    let packed = pack(&pieces, size, padding, progress).map_err(|error| match error {
        PackError::Full => LayoutError::Full { charts: charts.len(), padding, size },
        PackError::Cancelled(error) => error.into(),
    })?;
    let mut uv = vec![[0.0; 2]; mesh.faces().corners().len()];
    for (chart, places) in charts.iter().zip(&packed.places) {
        let corners = chart.faces.iter().flat_map(|&face| {
            let first = mesh.faces().first_corner(face as usize);
            first..first + mesh.faces().face(face as usize).len()
        });
        for (corner, &vertex) in corners.zip(&chart.corners) {
            uv[corner] = places[vertex as usize];
        }
    }
    let mesh = mesh
        .clone()
        .without("uv")
        .with_texture(None)
        .with_corner("uv", Attribute::Pair(uv.into()))?;
    Ok(LaidOut { mesh, charts: charts.len(), scale: packed.scale })
}

fn check(mesh: &Mesh) -> Result<(), LayoutError> {
    let Some((low, high)) = mesh.bounds().filter(|_| !mesh.faces().is_empty()) else {
        return Err(LayoutError::Empty);
    };
    let extent = (high - low).amax();
    let far = low.coords.amax().max(high.coords.amax());
    if !(extent < 1e100 && far < 1e100) {
        return Err(LayoutError::Far { extent });
    }
    let area: f64 = mesh.faces().iter().map(|face| mesh.area_vector(face).norm()).sum();
    match 0.0 < area && 1e-100 < extent {
        true => Ok(()),
        false => Err(LayoutError::NoArea { faces: mesh.faces().len() }),
    }
}

/// A mesh with its neighborhoods.
struct Surface<'a> {
    mesh: &'a Mesh,
    opposites: Vec<u32>,
    of_corner: Vec<u32>,
}

/// Where the mean of the normals is so near to all of them, there is no stretch.
const PLANE: f64 = 1e-9;

/// The cosine of the angle from which on a face is seen as too narrow.
const STEEP: f64 = 0.2;

/// Faces around a fold that are cut out with it, counted from it outwards.
const RINGS: usize = 3;

impl Surface<'_> {
    /// Charts of some faces that hang together, cut until each lies well.
    fn settle(&self, faces: Vec<u32>, progress: &Progress<'_>) -> Result<Vec<Chart>, Cancelled> {
        let (mut open, mut done) = (vec![faces], Vec::new());
        while let Some(faces) = open.pop() {
            progress.check()?;
            let mut chart = Chart::new(self.mesh, &self.opposites, &self.of_corner, faces);
            let lies_well = |flat: &Vec<Vector2<f64>>| overlaps::lie_well(&chart.triangles, flat);
            let relaxed = (!self.is_plane(&chart.faces)).then(|| chart.relaxed()).flatten();
            if let Some(flat) = relaxed.filter(&lies_well) {
                chart.flat = flat;
                done.push(chart);
            } else if chart.faces.len() == 1
                || lies_well(&chart.flat) && !self.look_away(&chart.faces).contains(&true)
            {
                done.push(chart);
            } else {
                open.extend(self.cut(&chart));
            }
        }
        Ok(done)
    }

    fn sum(&self, faces: &[u32]) -> Vector3<f64> {
        let vectors =
            faces.iter().map(|&face| self.mesh.area_vector(self.mesh.faces().face(face as usize)));
        vectors.sum()
    }

    fn is_plane(&self, faces: &[u32]) -> bool {
        let areas = faces.iter().map(|&face| self.sum(&[face]).norm());
        (1.0 - PLANE) * areas.sum::<f64>() <= self.sum(faces).norm()
    }

    /// Which of some faces look away from their mean normal, so that they would be stretched much where they are seen along it.
    fn look_away(&self, faces: &[u32]) -> Vec<bool> {
        let normal = self.sum(faces).try_normalize(0.0).unwrap_or_default();
        let vectors = faces.iter().map(|&face| self.sum(&[face]));
        vectors.map(|vector| vector.dot(&normal) < STEEP * vector.norm()).collect()
    }

    /// The parts of a chart: what looks away from its mean normal, with what is around it, by itself; or, if nothing does, two halves.
    fn cut(&self, chart: &Chart) -> Vec<Vec<u32>> {
        let mut is_away = self.look_away(&chart.faces);
        if is_away.contains(&true) && is_away.contains(&false) {
            for _ in 0..RINGS {
                let wider = self.with_neighbors(&chart.faces, &is_away);
                if !wider.contains(&false) {
                    break;
                }
                is_away = wider;
            }
            let part = |side: bool| {
                let faces = chart.faces.iter().zip(&is_away).filter(|it| *it.1 == side);
                self.pieces(faces.map(|it| *it.0).collect())
            };
            return [part(true), part(false)].concat();
        }
        let (low, high) = chart
            .flat
            .iter()
            .fold((chart.flat[0], chart.flat[0]), |(low, high), at| (low.inf(at), high.sup(at)));
        let axis = (high - low).imax();
        let mut corners = chart.corners.iter();
        let mut sorted: Vec<_> = chart
            .faces
            .iter()
            .map(|&face| {
                let count = self.mesh.faces().face(face as usize).len();
                let sum: f64 =
                    corners.by_ref().take(count).map(|&it| chart.flat[it as usize][axis]).sum();
                (sum / count as f64, face)
            })
            .collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let halves = sorted.split_at(sorted.len() / 2);
        let half = |it: &[(f64, u32)]| self.pieces(it.iter().map(|it| it.1).collect::<Vec<_>>());
        [half(halves.0), half(halves.1)].concat()
    }

    /// Those of some faces that are marked or have a neighbor that is.
    fn with_neighbors(&self, faces: &[u32], is_marked: &[bool]) -> Vec<bool> {
        faces
            .iter()
            .enumerate()
            .map(|(own, &face)| {
                let mut around =
                    self.neighbors(face).filter_map(|it| faces.binary_search(&it).ok());
                is_marked[own] || around.any(|it| is_marked[it])
            })
            .collect()
    }

    /// The faces beyond the sides of one.
    fn neighbors(&self, face: u32) -> impl Iterator<Item = u32> {
        let first = self.mesh.faces().first_corner(face as usize);
        let sides = first..first + self.mesh.faces().face(face as usize).len();
        let opposites = sides.map(|side| self.opposites[side]).filter(|&it| it != NONE);
        opposites.map(|it| self.of_corner[it as usize])
    }

    /// What of some faces hangs together by sides; the faces of each piece ascending.
    fn pieces(&self, mut faces: Vec<u32>) -> Vec<Vec<u32>> {
        faces.sort_unstable();
        let mut sets = UnionFind::new(faces.len());
        for (own, &face) in (0u32..).zip(&faces) {
            for neighbor in self.neighbors(face) {
                if let Ok(other) = faces.binary_search(&neighbor) {
                    sets.join(own, other as u32);
                }
            }
        }
        let (numbers, firsts) = sets.numbered();
        let mut pieces = vec![Vec::new(); firsts.len()];
        numbers.iter().zip(faces).for_each(|(&piece, face)| pieces[piece as usize].push(face));
        pieces
    }
}
