//! Texture coordinates for any mesh: charts without folds, packed into a square.

use chart::Chart;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Error, FieldError, Limit, Progress, bail};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Mesh};
use nalgebra::Vector3;
use pack::{Piece, pack};
use schemars::JsonSchema;
use segment::segment;
use serde::{Deserialize, Serialize};
use sides::{NONE, faces_of_corners, opposites};

mod chart;
mod clusters;
mod overlaps;
mod pack;
mod segment;
mod sides;
#[cfg(test)]
mod tests;

pub(crate) use overlaps::overlap;

/// Parameters of the layout of a surface in a square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Layout {
    /// Width and height of the atlas in texels.
    #[schemars(range(min = 16, max = 8192), extend("unit" = "px"))]
    #[serde(default = "default_size")]
    pub size: usize,
    /// Minimum distance of two charts in texels; at the border of the atlas it is half of that. It prevents interpolation and smaller
    /// versions of the texture from mixing the colors of two charts.
    #[schemars(range(max = 256), extend("unit" = "px"))]
    #[serde(default = "default_padding")]
    pub padding: usize,
    /// Maximum bend of a chart: the angle in degrees between its faces and its mean normal. Large values give fewer charts with more
    /// stretch.
    #[schemars(range(min = 1.0, max = 80.0), extend("unit" = "deg"))]
    #[serde(default = "default_bend")]
    pub bend: f64,
}

fn default_size() -> usize {
    1024
}

fn default_padding() -> usize {
    4
}

fn default_bend() -> f64 {
    40.0
}

impl Default for Layout {
    fn default() -> Self {
        Self { size: default_size(), padding: default_padding(), bend: default_bend() }
    }
}

/// Maximum width of an atlas.
pub(crate) const SIZE: Limit =
    Limit { max: 8192, items: "pixels along a side", help: "choose a smaller `size`" };

impl Layout {
    /// Checks that a chart and its padding fit into the atlas.
    ///
    /// # Errors
    /// Returns an error if no chart of any mesh can fit.
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
    /// Returns an error if a parameter is out of range.
    pub(crate) fn check(&self) -> Result<(), Error> {
        SIZE.check("the atlas", self.size as f64)?;
        if self.size < 16 {
            bail!("`size` is {}, but must be at least 16 px", self.size);
        }
        if 256 < self.padding {
            bail!("`padding` is {}, but must be at most 256 px", self.padding);
        }
        if !(1.0..=80.0).contains(&self.bend) {
            bail!("`bend` is {}, but must be from 1 to 80 degrees", self.bend);
        }
        Ok(())
    }
}

/// A mesh with new texture coordinates, and the size of their layout.
#[derive(Clone, Debug)]
pub struct LaidOut {
    /// The mesh with `uv` at its corners, and without a texture, which would no longer fit.
    pub mesh: Mesh,
    /// The number of charts into which the mesh was cut.
    pub charts: usize,
    /// Scale of the layout: texels per mm of the surface.
    pub scale: f64,
}

/// Returns the mesh with texture coordinates `uv` in which no two faces overlap and none is inverted. Polygons are divided as fans around
/// their first corners.
///
/// Charts are as flat as `bend` demands. They are cut where the orientation changes or more than two faces meet at an edge. Each chart is
/// flattened as rigidly as possible (see `chart.rs`). If flattening folds the chart, the chart is projected along its mean normal instead.
/// If the projection folds the chart, too, the chart is cut further. A single polygon whose fan is folded stays folded. The cost is O(n log
/// n).
///
/// # Errors
/// Returns an error if there are no faces, a parameter is out of range, or the charts do not fit.
pub fn lay_out(mesh: &Mesh, layout: &Layout, progress: &Progress<'_>) -> Result<LaidOut, Error> {
    layout.check()?;
    check(mesh)?;
    let surface = Surface { mesh, opposites: opposites(mesh), of_corner: faces_of_corners(mesh) };
    let flatness = libm::cos(layout.bend.to_radians());
    let segments = progress.part(0.0..0.5, |progress| {
        segment(mesh, &surface.opposites, &surface.of_corner, flatness, progress)
    })?;
    progress.tick(0.5)?;
    let charts = surface.settle(segments, progress)?;
    progress.tick(0.8)?;
    let pieces: Vec<_> = charts
        .iter()
        .map(|chart| Piece { triangles: &chart.triangles, flat: chart.flat.clone() })
        .collect();
    let Layout { size, padding, .. } = *layout;
    let Some(packed) = pack(&pieces, size, padding, progress)? else {
        bail!(
            "{} charts with a padding of {padding} px do not fit into {size} x {size} px: choose a larger `size` or `bend`, or a \
             smaller `padding`",
            charts.len()
        );
    };
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
        .without_attribute("uv")
        .with_texture(None)
        .with_corner("uv", Attribute::Pair(uv.into()))?;
    Ok(LaidOut { mesh, charts: charts.len(), scale: packed.scale })
}

fn check(mesh: &Mesh) -> Result<(), Error> {
    let Some((low, high)) = mesh.bounds().filter(|_| !mesh.faces().is_empty()) else {
        bail!(
            "the mesh has no faces, so that there is nothing to lay out: use `Reconstruct` to make a surface of points"
        );
    };
    let extent = (high - low).amax();
    let far = low.coords.amax().max(high.coords.amax());
    if !(extent < 1e100 && far < 1e100) {
        bail!(
            "the mesh is {extent:e} mm large and reaches {far:e} mm from the origin, expected less than 1e100 mm; scale it (`Transform`), or state its `unit` where it is read"
        );
    }
    let area: f64 = mesh.faces().iter().map(|face| mesh.area_vector(face).norm()).sum();
    if !(0.0 < area && 1e-100 < extent) {
        let faces = mesh.faces().len();
        bail!(
            "all {faces} faces of the mesh have no area, so that nothing can be laid out; check the positions of its vertices, which extend over {extent:e} mm"
        );
    }
    Ok(())
}

/// A mesh, and the adjacency of its faces along edges.
struct Surface<'a> {
    mesh: &'a Mesh,
    opposites: Vec<u32>,
    of_corner: Vec<u32>,
}

/// Maximum deviation of the flatness (the ratio of projected area to area) from 1, for a chart that counts as plane and has no stretch.
const PLANE: f64 = 1e-9;

/// Minimum cosine of the angle between the normal of a face and the mean normal of its chart; at larger angles the projected face is too
/// narrow.
const STEEP: f64 = 0.2;

/// Number of rings of faces around a fold that are cut out of the chart together with the fold.
const RINGS: usize = 3;

/// Connected faces on their way to a chart.
enum State {
    /// Faces that are not flattened yet.
    Open(Vec<u32>),
    Done(Box<Chart>),
}

impl Surface<'_> {
    /// Makes charts of sets of connected faces, and cuts the charts until each can be flattened without a fold.
    fn settle(
        &self,
        segments: Vec<Vec<u32>>,
        progress: &Progress<'_>,
    ) -> Result<Vec<Chart>, CancelledError> {
        let mut all: Vec<_> = segments.into_iter().map(State::Open).collect();
        while all.iter().any(|state| matches!(state, State::Open(_))) {
            let states = all.into_par_iter().map(|state| match state {
                State::Open(faces) => self.flatten(faces, progress),
                State::Done(chart) => Ok(vec![State::Done(chart)]),
            });
            let states: Vec<_> = states.collect::<Result<_, CancelledError>>()?;
            all = states.into_iter().flatten().collect();
        }
        let charts = all.into_iter().filter_map(|state| match state {
            State::Open(_) => None,
            State::Done(chart) => Some(*chart),
        });
        Ok(charts.collect())
    }

    /// Makes a chart of connected faces, or cuts them into parts if they cannot be flattened without a fold.
    fn flatten(
        &self,
        faces: Vec<u32>,
        progress: &Progress<'_>,
    ) -> Result<Vec<State>, CancelledError> {
        progress.check()?;
        let mut chart = Chart::new(self.mesh, &self.opposites, &self.of_corner, faces);
        let relaxed = (!self.is_plane(&chart.faces)).then(|| chart.relax()).flatten();
        if let Some(flat) =
            relaxed.filter(|flat| overlaps::are_free_of_overlaps(&chart.triangles, flat))
        {
            chart.flat = flat;
        } else if chart.faces.len() > 1
            && (!overlaps::are_free_of_overlaps(&chart.triangles, &chart.flat)
                || self.look_away(&chart.faces).contains(&true))
        {
            return Ok(self.cut(&chart).into_iter().rev().map(State::Open).collect());
        }
        Ok(vec![State::Done(Box::new(chart))])
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

    /// Returns, for each of `faces`, true if its normal is so far from the mean normal of all of them that projection would distort the
    /// face too much.
    fn look_away(&self, faces: &[u32]) -> Vec<bool> {
        let normal = self.sum(faces).try_normalize(0.0).unwrap_or_default();
        let vectors = faces.iter().map(|&face| self.sum(&[face]));
        vectors.map(|vector| vector.dot(&normal) < STEEP * vector.norm()).collect()
    }

    /// Divides a chart into parts. One part consists of the faces whose normals are far from the chart's mean normal, with the faces around
    /// them. If there are no such faces, the chart is divided into two halves.
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
            let parts = [true, false].map(|side| {
                let faces = chart.faces.iter().zip(&is_away).filter(|it| *it.1 == side);
                self.pieces(faces.map(|it| *it.0).collect())
            });
            return parts.concat();
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
        [halves.0, halves.1].map(|half| self.pieces(half.iter().map(|it| it.1).collect())).concat()
    }

    /// Returns, for each of `faces`, true if the face or one of its adjacent faces is marked.
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

    /// Returns the faces that share an edge with a face.
    fn neighbors(&self, face: u32) -> impl Iterator<Item = u32> {
        let first = self.mesh.faces().first_corner(face as usize);
        let sides = first..first + self.mesh.faces().face(face as usize).len();
        let opposites = sides.map(|side| self.opposites[side]).filter(|&it| it != NONE);
        opposites.map(|it| self.of_corner[it as usize])
    }

    /// Returns the connected components of some faces; the faces of each component are in ascending order.
    fn pieces(&self, mut faces: Vec<u32>) -> Vec<Vec<u32>> {
        faces.sort_unstable();
        let mut sets = UnionFind::new(faces.len());
        for (own, &face) in (0u32..).zip(&faces) {
            for neighbor in self.neighbors(face) {
                if let Ok(other) = faces.binary_search(&neighbor) {
                    sets.union(own, other as u32);
                }
            }
        }
        let (numbers, firsts) = sets.into_labels();
        let mut pieces = vec![Vec::new(); firsts.len()];
        numbers.iter().zip(faces).for_each(|(&piece, face)| pieces[piece as usize].push(face));
        pieces
    }
}
