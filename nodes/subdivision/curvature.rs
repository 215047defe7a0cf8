//! How a surface bends, at each vertex.

use maquette_node::{Carry, Context, Error, Fate, In, Node, Progress, Promise};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Boundary, Scheme};

mod angle_bending;
mod at_limit;
mod bending;
mod bent_mesh;
mod curvature_error;
mod curvature_ramp;
mod discrete;

pub use angle_bending::{AngleBending, angle_bending};
pub use bending::Bending;
pub use bent_mesh::BentMesh;
pub use curvature_error::CurvatureError;
pub use curvature_ramp::CurvatureRamp;

/// How a surface bends, at each vertex: attributes `gaussian`, `mean`, `k1` and `k2` (the larger and the smaller principal
/// curvature), `direction1` and `direction2` (unit tangents in which it bends so).
///
/// Normals point outward and what bends away from them is positive: a sphere of radius r has `k1 = k2 = 1 / r`. The flag
/// `extraordinary` marks vertices where the limit of a subdivision has no curvature of its own (more or fewer faces than the scheme
/// likes, borders and creases): there it is that of the surface close by. The flag `unknown` marks vertices where nothing could be
/// told, and all is 0.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Curvature {
    /// The mesh: for `Limit` the control mesh of a subdivision surface, whose vertices then come out on that surface.
    pub mesh: In<Mesh>,
    /// How the curvature is found.
    #[serde(default)]
    pub method: CurvatureMethod,
    /// The rules of the subdivision, for `Limit`.
    #[serde(default = "loop_scheme")]
    pub scheme: Scheme,
    /// What happens at the border of an open mesh, for `Limit`.
    #[serde(default)]
    pub boundary: Boundary,
    /// What the vertex colors show: blue below 0, light gray at 0, red above.
    #[serde(default)]
    pub ramp: CurvatureRamp,
    /// The curvature of the strongest colors, in 1/mm, for `Gaussian` in 1/mm^2; 0 takes the one that 5 % of the vertices exceed.
    #[schemars(range(min = 0.0))]
    #[serde(default)]
    pub strongest: f64,
}

fn loop_scheme() -> Scheme {
    Scheme::Loop
}

/// How the curvature of a mesh is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurvatureMethod {
    /// That of the subdivision surface: exact where it is regular.
    #[default]
    Limit,
    /// From the angles of the mesh's own faces; the directions by `Fit`.
    Mesh,
    /// Of a quadratic surface fitted to the vertices around.
    Fit,
}

impl Node for Curvature {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] =
        &Promise::faces_kept_when("mesh", "mesh", "without `Limit`", |it: &Self| {
            it.method != CurvatureMethod::Limit
        });

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept).but(&["color"])];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (mesh, progress) = (cx.get(&self.mesh), cx.progress());
        let bent = curvature(mesh, self.method, self.scheme, self.boundary, progress)?;
        let unknown = bent.bending.iter().filter(|bending| bending.is_none()).count();
        if 0 < unknown {
            cx.warn(format!("nothing can be told of the curvature at {unknown} vertices, which are marked `unknown`"));
        }
        Ok((bent.into_mesh(self.ramp, self.strongest)?,))
    }
}

/// How a mesh bends, or for [`CurvatureMethod::Limit`] the subdivision surface of which it is the control mesh.
///
/// Cost grows with the number of vertices. Sources: for `Mesh` [`angle_bending()`]; for `Fit` Petitjean, "A survey of methods for
/// recovering quadrics in triangle meshes" (2002); for `Limit` the derivatives of the uniform B-splines and box splines that the
/// surface consists of, by differences of control points.
///
/// # Errors
/// If the mesh is not one that the scheme can refine, or the evaluation is told to stop.
pub fn curvature(
    mesh: &Mesh,
    method: CurvatureMethod,
    scheme: Scheme,
    boundary: Boundary,
    progress: &Progress<'_>,
) -> Result<BentMesh, CurvatureError> {
    if method == CurvatureMethod::Limit {
        return at_limit::at_limit(mesh, scheme, boundary, progress);
    }
    let vertices: Vec<_> = (0..mesh.positions().len() as u32).collect();
    let mut bending = discrete::fitted(mesh, &vertices, progress)?;
    if method == CurvatureMethod::Mesh {
        let angles = angle_bending(&discrete::triangulated(mesh)?);
        for (bending, angles) in bending.iter_mut().zip(angles) {
            *bending = bending.filter(|_| angles.area > 0.0).map(|fit| fit.replaced(angles));
        }
    }
    let extraordinary = vec![false; vertices.len()];
    Ok(BentMesh { mesh: mesh.clone(), bending, extraordinary })
}

#[cfg(test)]
mod tests;
