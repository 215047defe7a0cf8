//! A mesh without places, and the rules: all that a plan depends on.

use maquette_value::Memo;
use maquette_value::{Encoder, Faces, Mesh};

use crate::Subdivision;
use crate::rules::Rules;

/// A mesh without places, and the rules.
#[derive(Clone, Debug)]
pub(crate) struct Topology {
    pub(crate) rules: Rules,
    /// Number of vertices.
    pub(crate) vertices: usize,
    pub(crate) faces: Faces,
    /// Sharp edges by vertices (a < b), sorted.
    pub(crate) creases: Vec<([u32; 2], f64)>,
}

impl Topology {
    /// That of a mesh.
    pub(crate) fn of(mesh: &Mesh, how: Subdivision) -> Self {
        Self {
            rules: how.rules(),
            vertices: mesh.positions().len(),
            faces: mesh.faces().clone(),
            creases: mesh.creases().collect(),
        }
    }
}

impl Memo for Topology {
    const NAME: &'static str = "SubdivisionTopology";

    fn encode(&self, to: &mut Encoder) {
        let Rules { scheme, boundary, creases } = self.rules;
        to.plain(&[scheme as u8, boundary as u8, creases as u8]).counts(&[self.vertices]);
        self.faces.encode(to);
        for (ends, sharpness) in &self.creases {
            to.plain(ends).plain(sharpness);
        }
    }

    fn size(&self) -> usize {
        self.faces.corners().size() + size_of_val(&self.creases[..])
    }
}
