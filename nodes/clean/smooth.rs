//! Removes small detail from a surface.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use filter::Filter;
use maquette_base::topology::flat_faces::FlatFaces;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{
    Carry, Context, Error, Forecast, In, Node, Progress, Promise, Sizes, Transfer, bail,
};
use maquette_value::parallel::*;
use maquette_value::{Edges, Faces, Mesh};
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

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let mesh = sizes.get(&self.mesh)?;
        Some(
            Forecast::by_law(mesh)
                .with_memory(mesh.corners * BYTES, "smooth fewer faces at a time"),
        )
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

/// Maximum of the default length, as a fraction of the diagonal of the mesh's bounding box. With a larger one, a coarse mesh such as a box
/// of twelve triangles would collapse.
const MAX_DEFAULT_RATIO: f64 = 0.15;

/// Returns the default length for a mesh.
fn default_length(mesh: &Mesh) -> f64 {
    let (points, edges) = (mesh.positions(), &mesh.edges().vertices);
    let lengths = edges.iter().until_stopped().map(|&ends| edge_length(ends, points));
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

    let net = triangulated(mesh)?;
    let triangles = net.faces().as_triangles().unwrap_or_default();
    // A vertex of a curve may only depend on vertices of curves, and only if it is free to move along its curve.
    let flat =
        FlatFaces::new(points, triangles, |vertex, others| match on_curves[vertex as usize] {
            0 => true,
            2 => others.iter().all(|&other| on_curves[other as usize] > 0),
            _ => false,
        });
    let mut places = points.to_vec();
    if !keep_borders {
        let mut spans = Vec::with_capacity(curves.len());
        let mut masses = vec![0.0; places.len()];
        for &ends in &curves {
            let span = edge_length(ends, points);
            if span > 0.0 {
                spans.push((ends, 1.0 / span));
                ends.iter().for_each(|&end| masses[end as usize] += span / 2.0);
            }
        }
        let along = filter(spans, masses, &flat);
        let is_free: Vec<_> = on_curves.iter().map(|&count| count == 2).collect();
        progress.part(0.0..0.2, |progress| along.apply(&mut places, &is_free, length, progress))?;
    }
    let visits = VISITS_PER_FACE * triangles.len();
    let surface = progress.part(0.2..0.4, |progress| {
        progress.metered(visits, || {
            let (weights, masses) = stiffness(&net, &flat);
            filter(weights, masses, &flat)
        })
    });
    let is_free: Vec<_> = on_curves.iter().map(|&count| count == 0).collect();
    progress.part(0.4..1.0, |progress| surface.apply(&mut places, &is_free, length, progress))?;
    for (vertex, supports) in flat.dependent() {
        let moves = supports.iter().map(|&(support, weight)| {
            (places[support as usize] - points[support as usize]) * weight
        });
        places[vertex as usize] = points[vertex as usize] + moves.sum::<Vector3<f64>>();
    }
    keep_apart(&mut places, mesh, &edges);
    Ok(mesh.with_positions(places)?)
}

/// Restores the distances between neighbors that have come to the same place, as the tip of a spike does: they move together, by the mean
/// of their displacements, so that their faces keep an area. If one of them has not moved, none does.
fn keep_apart(places: &mut [Point3<f64>], mesh: &Mesh, edges: &Edges) {
    let (points, limit) = (mesh.positions(), 10.0 * mesh.flat_height());
    let short = edges.vertices.iter().until_stopped();
    let short = short.filter(|&&ends| edge_length(ends, places) <= limit);
    let short: Vec<[u32; 2]> = short.copied().collect();
    if short.iter().all(|&ends| edge_length(ends, points) <= limit) {
        return;
    }
    let mut groups = UnionFind::new(places.len());
    short.iter().for_each(|&[a, b]| groups.union(a, b));
    let mut members: BTreeMap<u32, BTreeSet<usize>> = BTreeMap::new();
    for &vertex in short.as_flattened() {
        members.entry(groups.find(vertex)).or_default().insert(vertex as usize);
    }
    for group in members.values() {
        let displacements = group.iter().map(|&vertex| places[vertex] - points[vertex]);
        let is_fixed = displacements.clone().any(|step| step == Vector3::zeros());
        let mean = displacements.sum::<Vector3<f64>>() / group.len() as f64;
        let step = if is_fixed { Vector3::zeros() } else { mean };
        group.iter().for_each(|&vertex| places[vertex] = points[vertex] + step);
    }
}

/// Returns the mesh with a fan of triangles, around the first corner, in place of each polygon.
fn triangulated(mesh: &Mesh) -> Result<Cow<'_, Mesh>, Error> {
    if mesh.faces().as_triangles().is_some() {
        return Ok(Cow::Borrowed(mesh));
    }
    let fans = mesh.faces().iter();
    let fans = fans.flat_map(|face| (1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
    Ok(Cow::Owned(Mesh::new(mesh.positions().clone(), Faces::triangles(fans.collect()))?))
}

/// Returns a filter on edges with weights. Instead of dependent vertices, it has those on which they depend.
fn filter(mut edges: Vec<([u32; 2], f64)>, mut masses: Vec<f64>, flat: &FlatFaces) -> Filter {
    if !flat.is_empty() {
        let mut independent = Vec::with_capacity(edges.len());
        for (ends, weight) in edges {
            flat.for_each_edge(ends, weight, |ends, weight| independent.push((ends, weight)));
        }
        edges = independent;
        flat.gather(&mut masses);
    }
    Filter::new(masses, &edges)
}

/// The number of times that loops visit the elements around each face before the solution; for progress.
const VISITS_PER_FACE: usize = 45;

/// Limit to which the cotangents of triangle angles are clamped; larger cotangents occur only in needles (very thin triangles), where they
/// are meaningless.
const MAX_COTANGENT: f64 = 1e3;

/// Returns the edges of a mesh of triangles with half the sum of the cotangents of the angles opposite of them, and for each vertex a third
/// of the area of the triangles around it.
fn stiffness(mesh: &Mesh, flat: &FlatFaces) -> (Vec<([u32; 2], f64)>, Vec<f64>) {
    let (points, edges) = (mesh.positions(), mesh.edges());
    let triangles = mesh.faces().as_triangles().unwrap_or_default();
    let shapes: Vec<([f64; 3], f64)> = triangles
        .par_iter()
        .enumerate()
        .with_min_len(1024)
        .map(|(index, triangle)| {
            if flat.is_flat(index) {
                return ([0.0; 3], 0.0);
            }
            cotangents(triangle.map(|vertex| points[vertex as usize]))
        })
        .collect();
    let mut masses = vec![0.0; points.len()];
    let mut weights: Vec<_> = edges.vertices.iter().map(|&ends| (ends, 0.0)).collect();
    for (index, (cotangents, double_area)) in shapes.into_iter().enumerate() {
        for k in 0..3 {
            weights[edges.of_corner[3 * index + k] as usize].1 += cotangents[(k + 2) % 3] / 2.0;
            masses[triangles[index][k] as usize] += double_area / 6.0;
        }
    }
    (weights, masses)
}

/// Returns the cotangents of the angles of a triangle, and twice its area.
fn cotangents(corners: [Point3<f64>; 3]) -> ([f64; 3], f64) {
    let sides = [0, 1, 2].map(|k| corners[(k + 1) % 3] - corners[k]);
    let double_area = sides[0].cross(&sides[1]).norm();
    let cotangents = [0, 1, 2].map(|k| {
        let cotangent = -sides[k].dot(&sides[(k + 2) % 3]) / double_area;
        if cotangent.is_nan() { 0.0 } else { cotangent.clamp(-MAX_COTANGENT, MAX_COTANGENT) }
    });
    (cotangents, double_area)
}

#[cfg(test)]
mod tests;
