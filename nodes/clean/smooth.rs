//! Takes small detail out of a surface.

use filter::{Filter, FilterError};
use maquette_node::{Carry, Context, Error, Estimate, Fate, In, Node, Progress, Promise};
use maquette_value::{Mesh, MeshError};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

mod filter;

/// Takes out of a surface what is smaller than a length, such as noise; it does not shrink.
///
/// Waves twice as long as `length` keep nineteen twentieths of their height, such as long half of it, half as long a seventeenth. So a ball
/// with a radius of `length` loses less than one percent of its volume. Edges that shall stay sharp must be creases: `Crease` finds
/// them. They and borders are smoothed along themselves, which rounds the corners of a border, and stay where they end or meet. Attributes
/// stay, normals are dropped.
///
/// In other programs: relax, Laplacian.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Smooth {
    /// The surface.
    pub mesh: In<Mesh>,
    /// What is smaller goes; 0 takes six times the mean length of the edges.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub length: f64,
    /// Leaves borders and creases as they are; otherwise they are smoothed along themselves.
    #[serde(default)]
    pub keep_borders: bool,
}

/// Why a surface was not smoothed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SmoothError {
    /// A length that is none.
    #[error("`length` is {0} mm, but must be a number from 0 on")]
    Length(f64),
    /// Its filter has no solution.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
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

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept)];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let bytes = mesh.faces().corners().len() as f64 * BYTES;
        Some(Estimate { bytes, help: "smooth fewer faces at a time" })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let size = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
        if MOST_OF_SIZE * size < self.length {
            cx.warn(format!(
                "`length` is {} mm, and the mesh {size:.0} mm large: its shape goes, too",
                self.length
            ));
        }
        Ok((smooth(mesh, self.length, self.keep_borders, cx.progress())?,))
    }
}

/// Bytes for each corner of a face.
const BYTES: f64 = 150.0;

/// With a length of more than this share of its diagonal a mesh loses its shape: a ball a hundredth of its volume.
const MOST_OF_SIZE: f64 = 0.3;

/// Times the mean length of edges.
const OF_EDGES: f64 = 6.0;

/// `mesh` without what is smaller than `length` mm (six times the mean length of its edges if 0).
///
/// Implicit fairing of the second order, Desbrun, Meyer, Schroeder and Barr, "Implicit fairing of irregular meshes using diffusion and curvature
/// flow" (1999), section 2.4: `(1 + (length / 2 pi)^4 L^2) x = x_before` with the Laplacian `L` of cotangents over areas, equation 14 there. A
/// wave of the length `w` keeps `1 / (1 + (length / w)^4)` of its height: the low-pass filter that Taubin, "A signal processing approach to fair surface
/// design" (1995), approximates by steps, so that nothing must be done against shrinking. Borders and creases go first, each as a curve, then the
/// surface between them. Cost grows with the number of faces times `length` over that of edges.
///
/// # Errors
/// If the length is none, the mesh is so distorted that there is no solution, or the evaluation is told to stop.
pub fn smooth(
    mesh: &Mesh,
    length: f64,
    keep_borders: bool,
    progress: &Progress<'_>,
) -> Result<Mesh, SmoothError> {
    if !(0.0 <= length && length.is_finite()) {
        return Err(SmoothError::Length(length));
    }
    let edges = mesh.edges();
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let span = |[a, b]: [u32; 2]| (place(b) - place(a)).norm();
    let length = match length {
        0.0 => {
            OF_EDGES * edges.vertices.iter().map(|&ends| span(ends)).sum::<f64>()
                / edges.vertices.len().max(1) as f64
        }
        given => given,
    };
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

    let mut places = mesh.positions().to_vec();
    if !keep_borders {
        let mut along = Filter::new(places.len());
        for &ends in &curves {
            let span = span(ends);
            if span > 0.0 {
                along.add_edge(ends, 1.0 / span);
                ends.iter().for_each(|&end| along.add_mass(end, span / 2.0));
            }
        }
        let is_free: Vec<_> = on_curves.iter().map(|&count| count == 2).collect();
        progress.part(0.0..0.2, |progress| along.apply(&mut places, &is_free, length, progress))?;
    }
    let mut surface = Filter::new(places.len());
    for face in mesh.faces().iter() {
        for k in 1..face.len() - 1 {
            add_triangle(&mut surface, [face[0], face[k], face[k + 1]], place);
        }
    }
    let is_free: Vec<_> = on_curves.iter().map(|&count| count == 0).collect();
    progress.part(0.2..1.0, |progress| surface.apply(&mut places, &is_free, length, progress))?;
    Ok(mesh.with_positions(places)?)
}

/// Cotangents of angles beyond this are those of needles, which mean nothing.
const MOST_COTANGENT: f64 = 1e3;

fn add_triangle(filter: &mut Filter, corners: [u32; 3], place: impl Fn(u32) -> Point3<f64>) {
    let places = corners.map(place);
    let double_area = (places[1] - places[0]).cross(&(places[2] - places[0])).norm();
    for k in 0..3 {
        let [b, c] = [(k + 1) % 3, (k + 2) % 3];
        let (to_b, to_c) = (places[b] - places[k], places[c] - places[k]);
        let cotangent = to_b.dot(&to_c) / double_area;
        if !cotangent.is_nan() {
            let cotangent = cotangent.clamp(-MOST_COTANGENT, MOST_COTANGENT);
            filter.add_edge([corners[b], corners[c]], cotangent / 2.0);
        }
        filter.add_mass(corners[k], double_area / 6.0);
    }
}

#[cfg(test)]
mod tests;
