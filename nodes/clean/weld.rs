//! Joins vertices at the same place.

use maquette_base::weld::{WeldedMesh, weld};
use maquette_node::{
    Carry, Certainty, Context, Error, Forecast, In, Node, Promise, Sizes, Transfer, ValueSize,
};
use maquette_value::parallel::UntilStopped;
use maquette_value::{Mesh, Trace, TraceStep};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Joins vertices at the same place, so that faces that meet there become connected.
///
/// Many files store each face with vertices of its own, or cut the mesh along the seams of its texture; then it has a border where it looks
/// closed. Borders are joined edge by edge: two vertices become one if a border edge at one coincides with a border edge at the other, and
/// take the position of the one with the lowest index. Parts that touch in a single vertex stay separate, and so do corners of one face. No
/// edge gets more than two faces: where several parts meet at an edge, the faces around the same inside are joined. Of faces with equal
/// corners, one is kept.
///
/// An attribute that differs where vertices are joined, such as `uv` at a seam, becomes an attribute of corners. Faces of opposite
/// orientation are joined if their positions are equal: `Orient` makes them agree. Vertices without faces are joined with those of borders.
/// The result does not change if it is welded again. The `trace` has one step: its iteration is the number of vertices that are gone
/// because they were joined with another, and its distances are those by which they moved.
///
/// In other programs: merge by distance, remove doubles, stitch, unify vertices.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Weld {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// Maximum distance in mm between vertices that are joined; 0 joins only equal positions. It should be much smaller than the edges.
    /// Vertices do not form chains: the one with the lowest index takes those around itself, the nearest first.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub within: f64,
}

impl Node for Weld {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Closed", "mesh"),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh"),
        Promise::from("mesh", "Triangles", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh"),
    ];

    // Texture coordinates and colors of vertices move to corners where joined vertices differ.
    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["uv", "color"])];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let mesh = sizes.get(&self.mesh)?;
        let forecast = Forecast::new([
            Some(mesh.at_most(Certainty::Predicted)),
            Some(ValueSize::items(1.0, 0.0)),
        ]);
        Some(forecast.with_memory(mesh.corners * BYTES, "weld fewer faces at a time"))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let visits = VISITS_PER_FACE * mesh.faces().len();
        let welded = cx.progress().metered(visits, || weld(mesh, self.within))?;
        let trace = trace(mesh, &welded)?;
        if trace.steps().iter().all(|step| step.iteration == 0) && welded.equal_faces == 0 {
            cx.warn(match self.within {
                0.0 => "no borders coincide: nothing is joined; `within` joins vertices that are near each other".to_owned(),
                within => format!("no borders are within {within} mm of each other: nothing is joined"),
            });
        }
        Ok((welded.mesh, trace))
    }
}

/// The number of times that loops visit the elements around each face; for progress.
const VISITS_PER_FACE: usize = 12;

/// Memory in bytes for each corner of a face during the computation.
const BYTES: f64 = 230.0;

/// Returns the number of vertices that are gone as the iteration of a single step, and the distances by which they moved.
fn trace(mesh: &Mesh, welded: &WeldedMesh) -> Result<Trace, Error> {
    let joined = &welded.mesh;
    let gone = mesh.positions().len() - joined.positions().len();
    let moves = mesh.positions().iter().zip(&welded.vertices).until_stopped();
    let (mut max, mut sum) = (0.0f64, 0.0);
    for distance in moves.map(|(point, &vertex): (&Point3<f64>, &u32)| {
        (joined.positions()[vertex as usize] - point).norm()
    }) {
        max = max.max(distance);
        sum += distance * distance;
    }
    let rms = libm::sqrt(sum / gone.max(1) as f64);
    Ok(Trace::new(vec![TraceStep { iteration: gone as u64, max, rms }])?)
}

#[cfg(test)]
mod tests;
