//! Takes vertices out of a mesh where they matter least.

use std::collections::BinaryHeap;

use maquette_node::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress, Promise};
use maquette_value::{Mesh, MeshError};
use net::{Collapse, Net};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod net;
mod quadric;
mod wedges;

/// Takes vertices out of a mesh where they matter least, until it has so many faces.
///
/// Two ends of an edge become one vertex, in the place that is nearest to the planes of all faces around and where a texture slips least.
/// On flat parts, where nothing is lost, the shortest edges go first: even triangles are left there, and of a mesh that bends elsewhere
/// few. Borders, creases and the seams of a texture keep their shape: their vertices only move along them, and their ends stay. The result
/// is triangles; vertex attributes are mixed as the vertices are, those of corners on each side of a seam by itself; face attributes stay
/// with their faces, normals are dropped.
///
/// In other programs: decimate, PolyReduce.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Simplify {
    /// What becomes coarser; polygons are cut into triangles first.
    pub mesh: In<Mesh>,
    /// Number of triangles to end with; 0 takes a twentieth. More may be left where shape and creases forbid to go on.
    #[serde(default)]
    pub faces: usize,
}

/// Why a mesh was not simplified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimplifyError {
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for Simplify {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[Promise::always("mesh", "Triangles")];

    const CARRIES: &'static [Carry] = &[Carry::each(
        "mesh",
        "mesh",
        [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
    )];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let triangles: usize = mesh.faces().iter().map(|face| face.len() - 2).sum();
        let target = if self.faces == 0 { triangles / 20 } else { self.faces };
        let simple = simplify(mesh, target, cx.progress())?;
        if simple.faces().len() > target {
            cx.warn(format!(
                "{} triangles are left instead of {target}: taking out more would fold the surface, its creases or seams",
                simple.faces().len()
            ));
        }
        Ok((simple,))
    }
}

/// `mesh` with about `target` triangles.
///
/// Edges are collapsed in the order of the squared distance that it costs from the planes of the faces: Garland and Heckbert,
/// "Surface simplification using quadric error metrics" (1997). One is refused if the surface would no longer be one, the link
/// condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction" (1999), if a face would turn by more than
/// 75 degrees or lose its area, or if it joined two creases. Of edges that cost the same, as all in a plane, the shortest comes first: faces
/// stay even, vertices have few neighbors, and the whole takes n log n.
///
/// Texture coordinates `uv` on corners count with the squared distance by which the texture slips on the surface, as Hoppe's metric measures
/// it: "New quadric metric for simplifying meshes with appearance attributes" (1999). Edges whose sides differ in an attribute of corners are
/// seams, which are held as borders are, but less: the slip holds them, too. What a side of a new vertex has is what was on the nearest place
/// of that side before, so that a texture that lies evenly stays exactly where it is.
///
/// # Errors
/// If the evaluation is told to stop.
pub fn simplify(
    mesh: &Mesh,
    target: usize,
    progress: &Progress<'_>,
) -> Result<Mesh, SimplifyError> {
    let mut collapsing = Collapsing::new(mesh, progress)?;
    let begin = collapsing.net.n_faces;
    let mut done = 0usize;
    while target < collapsing.net.n_faces {
        let Some(next) = collapsing.heap.pop() else { break };
        done += 1;
        if done.is_multiple_of(1024) {
            let share = (begin - collapsing.net.n_faces) as f64 / (begin - target) as f64;
            progress.tick(share)?;
        }
        collapsing.make(&next);
    }
    Ok(collapsing.net.into_mesh(mesh)?)
}

/// A mesh whose edges collapse, the cheapest first.
struct Collapsing {
    net: Net,
    heap: BinaryHeap<Collapse>,
}

impl Collapsing {
    fn new(mesh: &Mesh, progress: &Progress<'_>) -> Result<Self, Cancelled> {
        let net = Net::new(mesh);
        let mut heap = BinaryHeap::new();
        for (index, edge) in net.edges().into_iter().enumerate() {
            if index.is_multiple_of(4096) {
                progress.check()?;
            }
            heap.extend(net.collapse(edge));
        }
        Ok(Self { net, heap })
    }

    /// Makes a collapse, if it still may be; returns how many edges were judged anew.
    fn make(&mut self, next: &Collapse) -> usize {
        if !self.net.is_current(next) || !self.net.allows(next) {
            return 0;
        }
        self.net.apply(next);
        let [vertex, _] = next.ends;
        let neighbors = self.net.neighbors(vertex);
        let judged = neighbors.iter().filter_map(|&neighbor| self.net.collapse([vertex, neighbor]));
        self.heap.extend(judged);
        neighbors.len()
    }
}

#[cfg(test)]
mod tests;
