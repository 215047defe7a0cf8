//! The mesh made by the last step of a primal scheme. Since it is not refined further, its half-edges are not stored: those around its few
//! odd (irregular or sharp) vertices are computed from the previous mesh.
//!
//! The lists of the previous mesh are a quarter as long. Code that walks around vertices uses the trait `HalfEdges`, which both kinds of
//! meshes implement. Not storing the half-edges saves a fifth to a quarter of the time and memory of computing a limit.

use std::sync::Arc;

use maquette_value::Faces;

use super::connectivity::Connectivity;
use super::face_order::FaceOrder;
use super::half_edges::{HalfEdges, NONE};
use super::level::{Level, PairedSlices, VertexInput};
use super::split::{Corners, Origin, Split, Triangles};
use crate::masks::sharpness::Sharpness;
use crate::scheme::PrimalScheme;

/// A refined mesh. The index of an edge is the index of its owner, which is the first of its half-edges.
#[derive(Debug)]
pub(crate) struct FinalMesh {
    pub(crate) coarser: Arc<Level>,
    faces: Faces,
    turns: FaceOrder,
    /// The odd (irregular or sharp) vertices, sorted, each with a half-edge from it for [`HalfEdges::ring`].
    pub(crate) odd: Vec<[u32; 2]>,
}

impl FinalMesh {
    /// Creates the mesh that results from refining `coarser`; `faces` are the faces after the step.
    pub(crate) fn from_coarser(coarser: Arc<Level>, faces: Faces) -> Self {
        let odd = match coarser.rules.scheme {
            PrimalScheme::Loop => coarser.odd_children(Triangles),
            PrimalScheme::CatmullClark => coarser.odd_children(Corners),
        };
        Self { coarser, turns: FaceOrder::new(&faces), faces, odd }
    }

    /// Returns the sharp edges with their sharpness, sorted by edge, including border edges.
    pub(crate) fn creases(&self) -> Vec<(u32, f64)> {
        match self.coarser.rules.scheme {
            PrimalScheme::Loop => self.creases_by(Triangles),
            PrimalScheme::CatmullClark => self.creases_by(Corners),
        }
    }

    fn creases_by(&self, split: impl Split) -> Vec<(u32, f64)> {
        let Level { mesh, rules, creases, .. } = &*self.coarser;
        Sharpness::new(mesh, *rules, creases).refine(|edge| {
            let [owner, _] = mesh.halves(edge);
            [split.first_half(owner), split.second(mesh, owner)].map(|half| self.edge_of(half))
        })
    }

    /// Calls `make` for each regular vertex, like [`Level::at_regular`].
    pub(crate) fn at_regular<A: Send, B: Send, K: Split>(
        &self,
        around: VertexInput<'_>,
        to: PairedSlices<'_, A, B>,
        split: K,
        make: impl Fn(usize, &[u32]) -> (A, B) + Sync,
    ) {
        self.coarser.at_children(around, to, split, make);
    }

    /// Returns the half-edges from a regular vertex, like [`Level::ring_of`].
    pub(crate) fn ring_of<K: Split>(&self, vertex: usize, split: K) -> [u32; 6] {
        self.coarser.ring_of_child(vertex, 0, split)
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        self.coarser.size() + self.faces.corners().size() + self.odd.len() * 8
    }
}

impl HalfEdges for FinalMesh {
    fn vertices(&self) -> usize {
        match self.coarser.rules.scheme {
            PrimalScheme::Loop => Triangles.vertices(&self.coarser.mesh),
            PrimalScheme::CatmullClark => Corners.vertices(&self.coarser.mesh),
        }
    }

    fn faces(&self) -> &Faces {
        &self.faces
    }

    fn face_order(&self) -> &FaceOrder {
        &self.turns
    }

    fn twin(&self, half: u32) -> u32 {
        let mesh = &self.coarser.mesh;
        match self.coarser.rules.scheme {
            PrimalScheme::Loop => twin(mesh, half, Triangles),
            PrimalScheme::CatmullClark => twin(mesh, half, Corners),
        }
    }

    fn edge_of(&self, half: u32) -> u32 {
        half.min(self.twin(half))
    }

    fn halves(&self, edge: u32) -> [u32; 2] {
        [edge, self.twin(edge)]
    }
}

/// Computes the twin of a half-edge in the mesh that results from refining `mesh`.
fn twin(mesh: &Connectivity, half: u32, split: impl Split) -> u32 {
    match split.origin(mesh, half) {
        Origin::Inside(twin) => twin,
        Origin::First(old) => match mesh.twin(old) {
            NONE => NONE,
            twin => split.second(mesh, twin),
        },
        Origin::Second(old) => match mesh.twin(old) {
            NONE => NONE,
            twin => split.first_half(twin),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refine::primal::Primal;
    use crate::refine::topology::Topology;
    use crate::refine::without_border::select_faces;
    use crate::rules::Rules;
    use crate::shapes::{cube, prism, sphere, torus};
    use crate::{Boundary, Creases, Scheme};

    #[test]
    fn the_half_edges_are_those_of_lists() {
        let open = select_faces(&sphere(1), &(0..17).collect::<Vec<_>>()).unwrap();
        let quads = [cube(), prism(5), torus(5, 4, false)].map(|m| (Scheme::CatmullClark, m));
        let triangles = [sphere(0), open].map(|m| (Scheme::Loop, m));
        for (scheme, mesh) in quads.into_iter().chain(triangles) {
            let edges = mesh.edges();
            let ends = edges.vertices.iter().step_by(3).map(|&ends| (ends, 1.5));
            let mesh = mesh.with_creases(ends.collect::<Vec<_>>()).unwrap();
            let (boundary, creases) = (Boundary::EdgeAndCorner, Creases::Chaikin);
            let topology = Topology {
                rules: Rules { scheme, boundary, creases },
                vertices: mesh.positions().len(),
                faces: mesh.faces().clone(),
                creases: mesh.creases().collect(),
            };
            let step = Level::from_topology(&topology, scheme.primal().unwrap()).unwrap();
            let step = Primal::new(step.into());
            let (last, level) = (step.final_mesh(), step.next());
            let mesh = &level.mesh;
            assert_eq!((last.vertices(), &last.odd), (mesh.vertices, &level.odd));
            for half in 0..mesh.corners().len() as u32 {
                let [owner, _] = mesh.halves(mesh.edge_of(half));
                assert_eq!((last.twin(half), last.edge_of(half)), (mesh.twin(half), owner));
            }
            let by_owner = level.creases.iter().map(|&(edge, sharp)| (mesh.halves(edge)[0], sharp));
            assert_eq!(last.creases(), by_owner.collect::<Vec<_>>());
        }
    }
}
