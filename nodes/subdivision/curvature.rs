//! How a surface bends, at each vertex.

use maquette::value::{Attribute, Mesh, MeshError};
use maquette::{Context, Error, In, Node};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Boundary, Scheme, SubdivideError};

mod at_limit;
mod bending;
mod discrete;

pub use bending::Bending;
pub use discrete::{AngleBending, angle_bending};

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

/// What vertex colors show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CurvatureRamp {
    /// The mean of the principal curvatures.
    #[default]
    Mean,
    /// Their product.
    Gaussian,
    /// The larger one.
    K1,
    /// The smaller one.
    K2,
    /// Nothing: colors and picture stay as they are.
    None,
}

/// Why there is no curvature.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CurvatureError {
    /// A mesh that the scheme cannot refine.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// Faces at the border that the surface does not have.
    #[error(
        "with `boundary: None` the surface ends before the border, so that vertices there have no curvature"
    )]
    NoBorder,
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// A mesh whose bending is known.
#[derive(Clone, Debug)]
pub struct BentMesh {
    /// The mesh; for [`CurvatureMethod::Limit`] with its vertices on the surface.
    pub mesh: Mesh,
    /// How it bends at each vertex; none where nothing can be told.
    pub bending: Vec<Option<Bending>>,
    /// Where a limit surface has no curvature of its own.
    pub extraordinary: Vec<bool>,
}

impl Node for Curvature {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let bent = curvature(cx.get(&self.mesh), self.method, self.scheme, self.boundary)?;
        let unknown = bent.bending.iter().filter(|bending| bending.is_none()).count();
        if 0 < unknown {
            cx.warn(format!("nothing can be told of the curvature at {unknown} vertices, which are marked `unknown`"));
        }
        Ok((bent.into_mesh(self.ramp, self.strongest)?,))
    }
}

/// How a mesh bends, or for [`CurvatureMethod::Limit`] the subdivision surface of which it is the control mesh.
///
/// Cost grows with the number of vertices. Sources: for `Mesh` [`angle_bending`]; for `Fit` Petitjean, "A survey of methods for
/// recovering quadrics in triangle meshes" (2002); for `Limit` the derivatives of the uniform B-splines and box splines that the
/// surface consists of, by differences of control points.
///
/// # Errors
/// If the mesh is not one that the scheme can refine.
pub fn curvature(
    mesh: &Mesh,
    method: CurvatureMethod,
    scheme: Scheme,
    boundary: Boundary,
) -> Result<BentMesh, CurvatureError> {
    if method == CurvatureMethod::Limit {
        return at_limit::at_limit(mesh, scheme, boundary);
    }
    let vertices = Vec::from_iter(0..mesh.positions().len() as u32);
    let mut bending = discrete::fitted(mesh, &vertices);
    if method == CurvatureMethod::Mesh {
        let angles = angle_bending(&discrete::triangulated(mesh)?);
        for (bending, angles) in bending.iter_mut().zip(angles) {
            *bending = bending.filter(|_| angles.area > 0.0).map(|fit| fit.replaced(angles));
        }
    }
    let extraordinary = vec![false; vertices.len()];
    Ok(BentMesh { mesh: mesh.clone(), bending, extraordinary })
}

impl BentMesh {
    /// The mesh with its bending as vertex attributes, and colors of one of them.
    ///
    /// # Errors
    /// Never: the attributes are as many as the vertices.
    pub fn into_mesh(self, ramp: CurvatureRamp, strongest: f64) -> Result<Mesh, MeshError> {
        type Number = fn(&Bending) -> f64;
        let number = |of: Number| -> Vec<f64> {
            self.bending.iter().map(|bending| bending.as_ref().map_or(0.0, of)).collect()
        };
        let direction = |k: usize| -> Attribute {
            let of = |bending: &Option<Bending>| {
                bending.map_or([0.0; 3], |bending| bending.directions[k].into())
            };
            Attribute::Vector(self.bending.iter().map(of).collect())
        };
        let flag = |flags: &mut dyn Iterator<Item = bool>| -> Attribute {
            Attribute::Flag(flags.map(u8::from).collect())
        };
        let columns: [(&str, Number, CurvatureRamp); 4] = [
            ("gaussian", |bending| bending.gaussian, CurvatureRamp::Gaussian),
            ("mean", |bending| bending.mean, CurvatureRamp::Mean),
            ("k1", |bending| bending.principal[0], CurvatureRamp::K1),
            ("k2", |bending| bending.principal[1], CurvatureRamp::K2),
        ];
        let mut mesh = self
            .mesh
            .clone()
            .with_vertex("direction1", direction(0))?
            .with_vertex("direction2", direction(1))?
            .with_vertex("extraordinary", flag(&mut self.extraordinary.iter().copied()))?
            .with_vertex("unknown", flag(&mut self.bending.iter().map(Option::is_none)))?;
        for (name, of, shown) in columns {
            let numbers = number(of);
            if shown == ramp {
                let strongest = if strongest > 0.0 { strongest } else { exceeded(&numbers) };
                let color = |&number: &f64| bending::ramp(number / strongest);
                let colors = numbers.iter().map(color).collect();
                mesh = mesh.with_texture(None).with_vertex("color", Attribute::Color(colors))?;
            }
            mesh = mesh.with_vertex(name, Attribute::Number(numbers.into()))?;
        }
        Ok(mesh)
    }
}

/// The size that 5 % of some numbers exceed; not 0.
fn exceeded(numbers: &[f64]) -> f64 {
    let mut sizes = Vec::from_iter(numbers.iter().map(|number| number.abs()));
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() * 95 / 100).copied().unwrap_or(0.0).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests;
