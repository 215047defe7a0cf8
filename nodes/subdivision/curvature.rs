//! Curvature of a surface at each vertex.

use maquette_base::topology::flat_faces::FlatFaces;
use maquette_node::{Carry, Context, Error, FieldError, In, Node, Progress, Promise, Transfer};
use maquette_value::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Boundary, Scheme};

mod angle_bending;
mod at_limit;
mod bending;
mod bent_mesh;
mod border_fit;
mod curvature_ramp;
mod discrete;

pub use angle_bending::{AngleBending, angle_bending};
pub use bending::Bending;
pub use bent_mesh::BentMesh;
pub use curvature_ramp::CurvatureRamp;

/// Computes the curvature of a surface at each vertex: attributes `gaussian`, `mean`, `k1` and `k2` (the larger and the smaller principal
/// curvature), `direction1` and `direction2` (the principal directions as unit tangents).
///
/// Normals point outward, and curvature away from the normal is positive: a sphere of radius r has `k1 = k2 = 1 / r`. The flag
/// `extraordinary` marks vertices where the limit surface has no curvature (irregular vertices, borders and creases): they get the
/// curvature of the surface nearby. The flag `unknown` marks vertices whose curvature cannot be determined; all values are 0 there.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Curvature {
    /// Mesh. For `Limit` it is the control mesh of a subdivision surface, and the vertices of the result are on that surface.
    pub mesh: In<Mesh>,
    /// Method of computation.
    #[serde(default)]
    pub method: CurvatureMethod,
    /// Subdivision scheme, for `Limit`.
    #[serde(default = "default_scheme")]
    pub scheme: Scheme,
    /// Treatment of the border of an open mesh, for `Limit`.
    #[serde(default)]
    pub boundary: Boundary,
    /// Curvature shown by vertex colors: blue below 0, light gray at 0, red above.
    #[serde(default)]
    pub ramp: CurvatureRamp,
    /// Curvature of the most saturated colors, in 1/mm, for `Gaussian` in 1/mm^2; 0 stands for the one that 5 % of the vertices exceed.
    #[schemars(range(min = 0.0))]
    #[serde(default)]
    pub strongest: f64,
}

/// The number of times that loops visit the elements around each face; for progress.
const VISITS_PER_FACE: usize = 60;

fn default_scheme() -> Scheme {
    Scheme::Loop
}

/// A method of computing curvature.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurvatureMethod {
    /// The curvature of the subdivision surface: exact where it is regular.
    #[default]
    Limit,
    /// From the angles of the mesh's faces, with the directions of `Fit`. At borders, from a quadratic and a cubic surface that are fitted
    /// to the neighboring vertices; `unknown` if their curvatures differ by more than 15 %.
    Mesh,
    /// The curvature of a quadratic surface that is fitted to the neighboring vertices.
    Fit,
}

impl Node for Curvature {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] =
        &Promise::faces_kept_when("mesh", "mesh", "without `Limit`", |it: &Self| {
            it.method != CurvatureMethod::Limit
        });

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["color"])];

    fn check(&self) -> Result<(), FieldError> {
        match self.method {
            CurvatureMethod::Limit => self.scheme.check_limit_field(),
            CurvatureMethod::Mesh | CurvatureMethod::Fit => Ok(()),
        }
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (mesh, progress) = (cx.get(&self.mesh), cx.progress());
        let (method, scheme, boundary) = (self.method, self.scheme, self.boundary);
        let bent = progress.metered(VISITS_PER_FACE * mesh.faces().len(), || {
            curvature(mesh, method, scheme, boundary, progress)
        })?;
        let unknown = bent.bending.iter().filter(|bending| bending.is_none()).count();
        if 0 < unknown {
            cx.warn(format!("the curvature at {unknown} vertices cannot be determined; they are marked `unknown`"));
        }
        Ok((bent.into_mesh(self.ramp, self.strongest)?,))
    }
}

/// Computes the curvature of a mesh at each vertex. With [`CurvatureMethod::Limit`] the mesh is taken as a control mesh, and the curvature
/// is that of its subdivision surface.
///
/// The running time is linear in the number of vertices. Sources: for `Mesh` see [`angle_bending()`]; for `Fit` Petitjean, "A survey of
/// methods for recovering quadrics in triangle meshes" (2002). For `Limit`, the surface consists of uniform B-splines or box splines; its
/// derivatives are computed as differences of control points.
///
/// # Errors
/// If the scheme cannot refine the mesh, or the evaluation is cancelled.
pub fn curvature(
    mesh: &Mesh,
    method: CurvatureMethod,
    scheme: Scheme,
    boundary: Boundary,
    progress: &Progress<'_>,
) -> Result<BentMesh, Error> {
    if method == CurvatureMethod::Limit {
        return at_limit::at_limit(mesh, scheme, boundary, progress);
    }
    let count = mesh.positions().len();
    let triangles = discrete::triangulate_polygons(mesh)?;
    // The centers of polygons are no vertices of the mesh.
    let is_vertex = |vertex: &u32| (*vertex as usize) < count;
    let flat = FlatFaces::new(triangles.positions(), &triangles.triangles(), |vertex, others| {
        is_vertex(&vertex) && others.iter().all(is_vertex)
    });
    let mut bending = discrete::fit_quadrics(mesh, &flat, progress)?;
    if method == CurvatureMethod::Mesh {
        let is_at_border = border_vertices(mesh);
        let angles = angle_bending::bend_independent(&triangles, &flat);
        let mut at_borders = border_fit::fit_borders(mesh, &flat, &is_at_border).into_iter();
        for ((bending, angles), is_at_border) in bending.iter_mut().zip(angles).zip(is_at_border) {
            *bending = match is_at_border {
                true => at_borders.next().flatten(),
                false => bending.map(|fit| fit.replace_curvatures(angles)),
            };
            *bending = bending.filter(|_| angles.area > 0.0);
        }
    }
    for (vertex, supports) in flat.dependent() {
        let parts =
            supports.iter().map(|&(support, weight)| Some((bending[support as usize]?, weight)));
        let parts: Option<Vec<_>> = parts.collect();
        bending[vertex as usize] = parts.and_then(|parts| Bending::mean(&parts));
    }
    Ok(BentMesh { mesh: mesh.clone(), bending, extraordinary: vec![false; count] })
}

/// Returns for each vertex of a mesh whether it is at a border.
fn border_vertices(mesh: &Mesh) -> Vec<bool> {
    let edges = mesh.edges();
    let mut is_at_border = vec![false; mesh.positions().len()];
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    borders.flat_map(|(ends, _)| ends).for_each(|&end| is_at_border[end as usize] = true);
    is_at_border
}

#[cfg(test)]
mod tests;
