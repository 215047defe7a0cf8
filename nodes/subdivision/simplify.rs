//! Mesh simplification by edge collapses.

use std::collections::BinaryHeap;

use maquette_node::{
    CancelledError, Carry, Context, Error, Forecast, In, Node, Progress, Promise, Sizes, Transfer,
    ValueSize,
};
use maquette_value::Mesh;
use net::{Collapse, Net};
use rounds::Rounds;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod net;
mod quadric;
mod rounds;
mod wedges;

/// Simplifies a mesh to a number of triangles by removing the vertices that matter least.
///
/// The ends of an edge are merged into one vertex, at the position with the smallest error: the distance from the planes of the faces
/// around and the shift of a texture. In flat parts, where edges cost nothing, the shortest edges are collapsed first, so that even
/// triangles remain. Borders, creases and texture seams keep their shape: their vertices only move along them, and their ends do not move.
/// The result has only triangles. Vertex attributes are blended with the vertices, corner attributes on each side of a seam separately;
/// face attributes are kept, and normals are dropped.
///
/// In other programs: decimate, PolyReduce.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Simplify {
    /// Mesh to simplify. Polygons are cut into triangles first.
    pub mesh: In<Mesh>,
    /// Target number of triangles; 0 stands for a twentieth. The result may have more if further collapses would fold the surface or damage
    /// creases.
    #[serde(default)]
    pub faces: usize,
}

impl Node for Simplify {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[Promise::always("mesh", "Triangles")];

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
    )];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let mesh = sizes.get(&self.mesh)?;
        let triangles = (mesh.corners - 2.0 * mesh.faces).max(1.0);
        let target = if self.faces == 0 { triangles / 20.0 } else { self.faces as f64 };
        let vertices = (mesh.points - (triangles - target) / 2.0)
            .clamp(target / 4.0, mesh.points.max(target / 4.0));
        let simple = match target < triangles {
            true => ValueSize::mesh(vertices, target, 3.0 * target),
            false => ValueSize::mesh(mesh.points, triangles, 3.0 * triangles),
        };
        Some(Forecast::by_law(simple.at_most(mesh.certainty)))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let triangles: usize = mesh.faces().iter().map(|face| face.len() - 2).sum();
        let target = if self.faces == 0 { triangles / 20 } else { self.faces };
        let simple = simplify(mesh, target, cx.progress())?;
        if simple.faces().len() > target {
            cx.warn(format!(
                "{} triangles are left instead of {target}: further collapses would fold the surface, its creases or seams",
                simple.faces().len()
            ));
        }
        Ok((simple,))
    }
}

/// Simplifies `mesh` to about `target` triangles.
///
/// Edges are collapsed in the order of their cost, the squared distance of the new vertex from the planes of the faces: Garland and
/// Heckbert, "Surface simplification using quadric error metrics" (1997). A collapse is rejected if the surface would no longer be manifold
/// (the link condition of Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction", 1999), if a face would rotate by
/// more than 75 degrees or lose its area, or if it would join two creases. Among edges with equal cost, for example in a plane, the
/// shortest is collapsed first. The faces thus stay evenly sized, vertices have few neighbors, and the running time is O(n log n).
///
/// A mesh of more than 100 000 triangles is first simplified in rounds of many collapses at a time, on all threads. An edge is collapsed in
/// a round if it is among the cheapest and cheaper than those nearby. The error is that of single collapses within one percent.
///
/// Texture coordinates `uv` on corners add the squared distance by which the texture shifts on the surface: Hoppe, "New quadric metric for
/// simplifying meshes with appearance attributes" (1999). An edge is a seam if its two sides differ in a corner attribute. Seams are
/// preserved like borders, but with a smaller weight, because the cost of the texture shift preserves them as well. On each side of a seam
/// a new vertex gets the attributes of the nearest point of the old surface on that side, so a linear texture does not move at all.
///
/// # Errors
/// If the evaluation is cancelled.
pub fn simplify(mesh: &Mesh, target: usize, progress: &Progress<'_>) -> Result<Mesh, Error> {
    simplify_by(Order::of(mesh), mesh, target, progress)
}

/// The order in which edges are collapsed.
#[derive(Clone, Copy, Debug)]
enum Order {
    /// The edge with the lowest cost is always the next one.
    OneByOne,
    /// Edges far apart are collapsed together while many have to be, then the rest one by one.
    Rounds,
}

/// Meshes with more triangles are simplified in rounds.
const MANY: usize = 100_000;

impl Order {
    fn of(mesh: &Mesh) -> Self {
        if mesh.faces().len() <= MANY { Self::OneByOne } else { Self::Rounds }
    }
}

/// The fraction of the time that the preparation of the first collapse takes.
const BEGIN: f64 = 0.3;

/// The number of times that loops visit the elements around each face during the preparation; for progress.
const VISITS_PER_FACE: usize = 60;

fn simplify_by(
    order: Order,
    mesh: &Mesh,
    target: usize,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let visits = VISITS_PER_FACE * mesh.faces().len();
    let (mut net, mut collapses) = progress.part(0.0..BEGIN, |progress| {
        progress.metered(visits, || {
            let net = Net::new(mesh);
            let collapses = net.collapses();
            (net, collapses)
        })
    });
    let begin = net.n_faces;
    progress.check()?;
    let net = progress.part(BEGIN..1.0, |progress| {
        if let Order::Rounds = order {
            collapses = Rounds::new(collapses, &net).run(&mut net, target, progress)?;
        }
        collapse_one_by_one(Simplifier { net, heap: collapses.into() }, begin, target, progress)
    })?;
    Ok(net.into_mesh(mesh)?)
}

/// Collapses the cheapest edge until `target` triangles are left or no edge can be collapsed. `begin` is the number of triangles of the
/// input mesh.
fn collapse_one_by_one(
    mut collapsing: Simplifier,
    begin: usize,
    target: usize,
    progress: &Progress<'_>,
) -> Result<Net, CancelledError> {
    let mut done = 0usize;
    while target < collapsing.net.n_faces {
        let Some(next) = collapsing.heap.pop() else { break };
        done += 1;
        if done.is_multiple_of(1024) {
            let share = (begin - collapsing.net.n_faces) as f64 / (begin - target) as f64;
            progress.tick(share)?;
        }
        collapsing.collapse(&next);
    }
    Ok(collapsing.net)
}

/// The state of a simplification: a mesh and a priority queue of collapses, the cheapest first.
struct Simplifier {
    net: Net,
    heap: BinaryHeap<Collapse>,
}

impl Simplifier {
    /// Performs an edge collapse, unless its cost is outdated or the collapse would make the surface non-manifold or flip a face. Returns
    /// the number of edges whose cost was recomputed.
    fn collapse(&mut self, next: &Collapse) -> usize {
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
