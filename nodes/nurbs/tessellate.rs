//! Tessellates a surface.

use maquette_base::limits::VERTICES;
use maquette_node::{
    Certainty, Context, Error, Estimate, FieldError, Forecast, In, Node, Promise, Sizes, ValueSize,
    bail,
};
use maquette_value::{Mesh, Surface};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Tessellates a surface into a mesh of quads, with exact normals and with the parameters, scaled to 0..1, as `uv`.
///
/// A surface that is closed in a direction is joined at its seam, and a row or column in one place, a pole, is one vertex with triangles
/// around it: a ball or a vase that closes is a closed mesh. Then `uv` belongs to corners: at the far side of a seam it is 1, and at a pole
/// each triangle has the mean of its two columns. So do the normals if the surface has an edge at its seam or a tip at a pole. Points
/// within 1e-9 of the diagonal of the net's bounding box are the same. A seam with fewer than three quads around stays open.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Tessellate {
    /// The surface.
    pub surface: In<Surface>,
    /// Number of quads along u, evenly spaced in the parameter. 0 is automatic: each span is divided evenly, so that all quads are within
    /// 1/1000 of the diagonal of the net's bounding box.
    #[schemars(range(max = 8192))]
    #[serde(default)]
    pub u: usize,
    /// Number of quads along v; 0 is automatic.
    #[schemars(range(max = 8192))]
    #[serde(default)]
    pub v: usize,
    /// Maximum distance in mm between edges and the surface: flat parts get large quads and curved parts small ones, joined without gaps by
    /// triangles. 0 gives evenly spaced quads.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub tolerance: f64,
}

/// The error message if both a number of quads and a tolerance are given.
const BOTH: &str = "`tolerance` chooses the quads itself: leave `u` and `v` out";

impl Node for Tessellate {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] =
        &[Promise::always("mesh", "Manifold"), Promise::always("mesh", "Oriented")];

    fn check(&self) -> Result<(), FieldError> {
        match (self.tolerance == 0.0, [self.u, self.v]) {
            (true, _) | (false, [0, 0]) => Ok(()),
            (false, _) => {
                let help = "leave `tolerance` out, or `u` and `v`";
                Err(FieldError::new("tolerance", BOTH, help))
            }
        }
    }

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let vertices = vertices(cx.get(&self.surface), [self.u, self.v]);
        // With a tolerance, the number of quads is not known in advance; the computation stops at a million.
        let bytes = if cx.get(&self.surface).has_joints() { 280.0 } else { 110.0 };
        let estimate = Estimate { bytes: vertices * bytes, help: VERTICES.help };
        (self.tolerance == 0.0).then_some(estimate)
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let net = sizes.get(&self.surface).map(|net| net.points);
        if self.tolerance != 0.0 {
            return None;
        }
        // An omitted number of quads is that of the control points, of which a net has about as many along u as along v.
        let quads = |given: usize| if given == 0 { net.map(f64::sqrt) } else { Some(given as f64) };
        let (u, v) = (quads(self.u)?, quads(self.v)?);
        let vertices = (u + 1.0) * (v + 1.0);
        let is_given = self.u > 0 && self.v > 0;
        let certainty = if is_given { Certainty::Predicted } else { Certainty::Guess };
        let mesh = ValueSize::mesh(vertices, u * v, 4.0 * u * v).with_more_bytes(40.0 * vertices);
        let memory = 110.0 * vertices;
        Some(Forecast::by_law(mesh.at_most(certainty)).with_memory(memory, VERTICES.help))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((tessellate(cx.get(&self.surface), [self.u, self.v], self.tolerance)?,))
    }
}

/// Tessellates a surface, either with the given number of quads along u and v (0 for automatic), or with a tolerance in mm that is not 0.
///
/// # Errors
/// Returns an error if both a number of quads and a tolerance are given, or the mesh would be too large or not finite.
pub fn tessellate(surface: &Surface, [u, v]: [usize; 2], tolerance: f64) -> Result<Mesh, Error> {
    match (tolerance == 0.0, [u, v]) {
        (true, _) => {
            VERTICES.check("the mesh of the surface", vertices(surface, [u, v]))?;
            Ok(surface.tessellate(u, v)?)
        }
        (false, [0, 0]) => Ok(surface.tessellate_within(tolerance)?),
        (false, _) => bail!("{BOTH}"),
    }
}

/// Returns an estimate of the number of vertices of a mesh with the given numbers of quads. In each direction it uses the number of quads
/// or the number of control points, whichever is larger.
fn vertices(surface: &Surface, [u, v]: [usize; 2]) -> f64 {
    fn count_or(given: usize, control: usize) -> f64 {
        given.max(control).saturating_add(1) as f64
    }
    let net = surface.net();
    count_or(u, net.rows()) * count_or(v, net.columns())
}

#[cfg(test)]
mod tests {
    use super::super::nurbs::nurbs;
    use super::super::revolve::revolve;
    use super::*;

    #[test]
    fn a_tolerance_and_a_number_of_quads_contradict_each_other() {
        let surface = nurbs(&revolve(&[[1.0, 0.0], [1.0, 2.0]]).unwrap(), None, None, Some([2, 3]));
        let surface = surface.unwrap();
        assert_eq!(tessellate(&surface, [2, 3], 0.0).unwrap().faces().len(), 6);
        assert!(tessellate(&surface, [0, 0], 0.01).unwrap().faces().len() > 6);
        assert_eq!(tessellate(&surface, [2, 0], 0.01).unwrap_err().to_string(), BOTH);
    }

    #[test]
    fn more_quads_than_memory_holds_are_refused_with_numbers() {
        let surface = nurbs(&revolve(&[[1.0, 0.0], [1.0, 2.0]]).unwrap(), None, None, Some([2, 3]));
        let error = tessellate(&surface.unwrap(), [8192, 8192], 0.0).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the mesh of the surface would need about 67 000 000 vertices, at most 17 000 000 are made: choose fewer rows, columns or sides"
        );
    }
}
