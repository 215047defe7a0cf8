//! A mesh with the curvature at its vertices.

use maquette_value::{Attribute, Mesh, MeshError};

use super::bending::{self, Bending};
use super::curvature_ramp::CurvatureRamp;

/// A mesh with the curvature at its vertices.
#[derive(Clone, Debug)]
pub struct BentMesh {
    /// The mesh. For [`CurvatureMethod::Limit`](crate::CurvatureMethod::Limit) its vertices have been moved to the limit surface.
    pub mesh: Mesh,
    /// The curvature at each vertex; `None` where the curvature cannot be determined.
    pub bending: Vec<Option<Bending>>,
    /// For each vertex, true if the limit surface has no curvature there.
    pub extraordinary: Vec<bool>,
}

impl BentMesh {
    /// Returns the mesh with the curvature as vertex attributes, and with vertex colors that show the value chosen by `ramp`. `strongest`
    /// is the curvature of the most saturated colors; 0 means the absolute value that 5 % of the vertices exceed.
    ///
    /// # Errors
    /// None occur: the attributes have one value per vertex.
    pub fn into_mesh(self, ramp: CurvatureRamp, strongest: f64) -> Result<Mesh, MeshError> {
        type Number = fn(&Bending) -> f64;
        fn number(of: Number, self_bending: &[Option<Bending>]) -> Vec<f64> {
            self_bending.iter().map(|bending| bending.as_ref().map_or(0.0, of)).collect()
        }
        fn direction(k: usize, self_bending: &[Option<Bending>]) -> Attribute {
            Attribute::Vector(
                self_bending
                    .iter()
                    .map(|bending| bending.map_or([0.0; 3], |bending| bending.directions[k].into()))
                    .collect(),
            )
        }
        fn flag(flags: &mut dyn Iterator<Item = bool>) -> Attribute {
            Attribute::Flag(flags.map(u8::from).collect())
        }
        let columns: [(&str, Number, CurvatureRamp); 4] = [
            ("gaussian", |bending| bending.gaussian, CurvatureRamp::Gaussian),
            ("mean", |bending| bending.mean, CurvatureRamp::Mean),
            ("k1", |bending| bending.principal[0], CurvatureRamp::K1),
            ("k2", |bending| bending.principal[1], CurvatureRamp::K2),
        ];
        let mut mesh = self
            .mesh
            .clone()
            .with_vertex("direction1", direction(0, &self.bending))?
            .with_vertex("direction2", direction(1, &self.bending))?
            .with_vertex("extraordinary", flag(&mut self.extraordinary.iter().copied()))?
            .with_vertex("unknown", flag(&mut self.bending.iter().map(Option::is_none)))?;
        for (name, of, shown) in columns {
            let numbers = number(of, &self.bending);
            if shown == ramp {
                let strongest = if strongest > 0.0 { strongest } else { percentile_95(&numbers) };
                let colors =
                    numbers.iter().map(|&number| bending::ramp(number / strongest)).collect();
                mesh = mesh.with_texture(None).with_vertex("color", Attribute::Color(colors))?;
            }
            mesh = mesh.with_vertex(name, Attribute::Number(numbers.into()))?;
        }
        Ok(mesh)
    }
}

/// Returns the threshold that 5 % of the numbers exceed in absolute value. The threshold is positive even if all numbers are 0.
fn percentile_95(numbers: &[f64]) -> f64 {
    let mut sizes: Vec<_> = numbers.iter().map(|number| number.abs()).collect();
    let rank = sizes.len() * 95 / 100;
    if sizes.is_empty() {
        return f64::MIN_POSITIVE;
    }
    sizes.select_nth_unstable_by(rank, f64::total_cmp).1.max(f64::MIN_POSITIVE)
}
