//! The topology of a mesh and the rules of its subdivision: everything that a plan depends on.

use maquette_value::Memo;
use maquette_value::{Encoder, Faces, Mesh};

use crate::Subdivision;
use crate::rules::Rules;

/// The topology of a mesh and the rules of its subdivision.
#[derive(Clone, Debug)]
pub(crate) struct Topology {
    pub(crate) rules: Rules,
    /// The number of vertices of the mesh, including those without faces.
    pub(crate) vertices: usize,
    pub(crate) faces: Faces,
    /// The sharp edges, sorted: the two vertices of each edge in ascending order, and the sharpness of the edge.
    pub(crate) creases: Vec<([u32; 2], f64)>,
}

impl Topology {
    /// Returns the topology of a mesh.
    pub(crate) fn from_mesh(mesh: &Mesh, options: Subdivision) -> Self {
        Self {
            rules: options.rules(),
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
