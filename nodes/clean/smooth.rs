//! Removes small detail from a surface.

use std::borrow::Cow;

use filter::Filter;
use maquette_base::topology::flat_faces::FlatFaces;
use maquette_node::{Carry, Context, Error, Estimate, In, Node, Progress, Promise, Transfer, bail};
use maquette_value::Mesh;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod filter;

/// Removes detail smaller than a length, such as noise, without shrinking the surface.
///
/// Waves of twice `length` keep 95 % of their height, waves of `length` half of it, and waves of half `length` a seventeenth. A sphere with
/// the radius `length` loses less than one percent of its volume. Edges that must stay sharp have to be creases: `Crease` finds them.
/// Creases and borders are smoothed along themselves, which rounds the corners of a border; their vertices stay where they end or meet.
/// Attributes are kept, normals are dropped.
///
/// In other programs: relax, Laplacian.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Smooth {
    /// The surface.
    pub mesh: In<Mesh>,
    /// Length in mm below which detail is removed; 0 takes six times the mean edge length, but at most 15 % of the bounding box's diagonal.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub length: f64,
    /// If true, borders and creases do not change; otherwise they are smoothed along themselves.
    #[serde(default)]
    pub keep_borders: bool,
}

impl Node for Smooth {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Closed", "mesh"),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Oriented", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh"),
        Promise::from("mesh", "Triangles", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh"),
    ];

    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let bytes = mesh.faces().corners().len() as f64 * BYTES;
        Some(Estimate { bytes, help: "smooth fewer faces at a time" })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let size = diagonal(mesh);
        if MAX_LENGTH_RATIO * size < self.length {
            cx.warn(format!(
                "`length` is {} mm, and the mesh {size:.3e} mm large: its shape is lost, too; choose at most {:.3e}, or 0",
                self.length,
                MAX_LENGTH_RATIO * size
            ));
        }
        Ok((smooth(mesh, self.length, self.keep_borders, cx.progress())?,))
    }
}

/// Memory in bytes for each corner of a face during the computation.
const BYTES: f64 = 150.0;

/// If `length` is above this fraction of the diagonal of the mesh's bounding box, smoothing changes the shape of the mesh: a sphere loses a
/// hundredth of its volume.
const MAX_LENGTH_RATIO: f64 = 0.3;

/// Default length below which detail is removed, as a multiple of the mean edge length.
const DEFAULT_EDGE_LENGTHS: f64 = 6.0;

/// Maximum of the default length, as a fraction of the diagonal of the mesh's bounding box. With a larger one, a coarse mesh such as a box of
/// twelve triangles would collapse.
const MAX_DEFAULT_RATIO: f64 = 0.15;

/// Returns the default length for a mesh.
fn default_length(mesh: &Mesh) -> f64 {
    let (points, edges) = (mesh.positions(), &mesh.edges().vertices);
    let lengths = edges.iter().map(|&ends| edge_length(ends, points));
    let length = DEFAULT_EDGE_LENGTHS * lengths.sum::<f64>() / edges.len().max(1) as f64;
    length.min(MAX_DEFAULT_RATIO * diagonal(mesh))
}

/// Returns the diagonal of the mesh's bounding box.
fn diagonal(mesh: &Mesh) -> f64 {
    mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm())
}

/// Returns the length of the edge between two vertices.
fn edge_length([a, b]: [u32; 2], points: &[Point3<f64>]) -> f64 {
    (points[b as usize] - points[a as usize]).norm()
}

/// Smooths `mesh`: removes detail smaller than `length` mm. 0 takes six times the mean edge length, but at most 15 % of the bounding box's
/// diagonal.
///
/// Implicit fairing of the second order: Desbrun, Meyer, Schroeder and Barr, "Implicit fairing of irregular meshes using diffusion and
/// curvature flow" (1999), section 2.4. It solves `(1 + (length / 2 pi)^4 L^2) x = x_before`, where the Laplacian `L` is that of cotangents
/// divided by areas (equation 14 of that paper). A wave of the length `w` keeps `1 / (1 + (length / w)^4)` of its height. This is the
/// low-pass filter that Taubin, "A signal processing approach to fair surface design" (1995), approximates by steps; because the equation
/// is solved exactly, shrinking needs no correction. Borders and creases are smoothed first, each as a curve, then the surface between
/// them. The running time grows with the number of faces times the ratio of `length` to the edge length.
///
/// # Errors
/// Returns an error if the length is invalid, the mesh is too distorted for a solution, or the evaluation is cancelled.
pub fn smooth(
    mesh: &Mesh,
    length: f64,
    keep_borders: bool,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    if !(0.0 <= length && length.is_finite()) {
        bail!("`length` is {length} mm, but must be a number from 0 on");
    }
    let edges = mesh.edges();
    let points = mesh.positions();
    let length = if length == 0.0 { default_length(mesh) } else { length };
    if length == 0.0 {
        return Ok(mesh.clone());
    }
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    let creases = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
    let mut curves: Vec<_> = borders
        .map(|(&[a, b], _)| [a.min(b), a.max(b)])
        .chain(creases.map(|(ends, _)| ends))
        .collect();
    curves.sort_unstable();
    curves.dedup();
    let mut on_curves = vec![0u32; mesh.positions().len()];
    curves.as_flattened().iter().for_each(|&vertex| on_curves[vertex as usize] += 1);

    let triangles = fans(mesh);
    // A vertex of a curve may only depend on vertices of curves, and only if it is free to move along its curve.
    let flat =
        FlatFaces::new(points, &triangles, |vertex, others| match on_curves[vertex as usize] {
            0 => true,
            2 => others.iter().all(|&other| on_curves[other as usize] > 0),
            _ => false,
        });
    let mut places = points.to_vec();
    if !keep_borders {
        let mut along = Filter::new(places.len());
        for &ends in &curves {
            let span = edge_length(ends, points);
            if span > 0.0 {
                flat.for_each_edge(ends, 1.0 / span, |ends, weight| along.add_edge(ends, weight));
                ends.iter().for_each(|&end| along.add_mass(end, span / 2.0));
            }
        }
        along.gather_masses(&flat);
        let is_free: Vec<_> = on_curves.iter().map(|&count| count == 2).collect();
        progress.part(0.0..0.2, |progress| along.apply(&mut places, &is_free, length, progress))?;
    }
    let mut surface = Filter::new(places.len());
    for (index, &triangle) in triangles.iter().enumerate() {
        if !flat.is_flat(index) {
            add_triangle(&mut surface, &flat, triangle, points);
        }
    }
    surface.gather_masses(&flat);
    let is_free: Vec<_> = on_curves.iter().map(|&count| count == 0).collect();
    progress.part(0.2..1.0, |progress| surface.apply(&mut places, &is_free, length, progress))?;
    for (vertex, supports) in flat.dependent() {
        let moves = supports.iter().map(|&(support, weight)| {
            (places[support as usize] - points[support as usize]) * weight
        });
        places[vertex as usize] = points[vertex as usize] + moves.sum::<Vector3<f64>>();
    }
    Ok(mesh.with_positions(places)?)
}

/// Returns the triangles of all faces, those of a polygon as a fan around its first corner.
fn fans(mesh: &Mesh) -> Cow<'_, [[u32; 3]]> {
    if let Some(triangles) = mesh.faces().as_triangles() {
        return Cow::Borrowed(triangles);
    }
    let fans = mesh.faces().iter();
    let fans = fans.flat_map(|face| (1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
    Cow::Owned(fans.collect())
}

/// Limit to which the cotangents of triangle angles are clamped; larger cotangents occur only in needles (very thin triangles), where they
/// are meaningless.
const MAX_COTANGENT: f64 = 1e3;

fn add_triangle(filter: &mut Filter, flat: &FlatFaces, corners: [u32; 3], points: &[Point3<f64>]) {
    let places = corners.map(|vertex| points[vertex as usize]);
    let double_area = (places[1] - places[0]).cross(&(places[2] - places[0])).norm();
    for k in 0..3 {
        let [b, c] = [(k + 1) % 3, (k + 2) % 3];
        let (to_b, to_c) = (places[b] - places[k], places[c] - places[k]);
        let cotangent = to_b.dot(&to_c) / double_area;
        if !cotangent.is_nan() {
            let cotangent = cotangent.clamp(-MAX_COTANGENT, MAX_COTANGENT);
            flat.for_each_edge([corners[b], corners[c]], cotangent / 2.0, |ends, weight| {
                filter.add_edge(ends, weight);
            });
        }
        filter.add_mass(corners[k], double_area / 6.0);
    }
}

#[cfg(test)]
mod tests;
