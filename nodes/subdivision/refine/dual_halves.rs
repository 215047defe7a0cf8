//! The connectivity of the faces made by a Doo-Sabin step, computed from the previous mesh by arithmetic, without a search.
//!
//! New faces are in three groups: inside old faces, with a half-edge for each old one; across old edges, with four half-edges; around old
//! vertices. In the face across an edge, half-edge 0 is the twin of the new half-edge that belongs to the edge's owner. Half-edge 2 is the
//! twin of the new half-edge that belongs to the owner's twin; across a border edge it is on the border. Half-edges 1 and 3 border on the
//! faces around the two ends of the edge. Each new edge is owned by the first of its two half-edges in this order.

use maquette_value::Faces;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;

use super::by_faces::{BLOCK, by_faces};
use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE};

/// The new faces of a Doo-Sabin step, from which their half-edges are computed.
pub(crate) struct DualFaces<'a> {
    pub(crate) mesh: &'a Connectivity,
    pub(crate) faces: &'a Faces,
    /// The old edges with a face across them, ascending.
    pub(crate) edges: &'a [u32],
    /// The number of new vertices.
    pub(crate) vertices: usize,
}

/// The connectivity of the new faces, with a half-edge from each new vertex.
pub(crate) struct FinerHalves {
    pub(crate) mesh: Connectivity,
    /// A half-edge from each vertex, for [`HalfEdges::ring`].
    pub(crate) starts: Vec<u32>,
    pub(crate) rings: Rings,
}

/// For each vertex that is surrounded by four faces, the four half-edges that start there; other vertices have [`NONE`]. The list may end
/// before the last vertex.
#[derive(Debug, Default)]
pub(crate) struct Rings(Vec<[u32; 4]>);

impl Rings {
    /// Appends the half-edges that start at `vertex`, as [`HalfEdges::fan`] returns them. `start` is one of these half-edges.
    #[inline]
    pub(crate) fn fan(&self, mesh: &Connectivity, vertex: usize, start: u32, to: &mut Vec<u32>) {
        match self.0.get(vertex) {
            Some(ring) if ring[0] != NONE => to.extend_from_slice(ring),
            _ => to.extend(mesh.fan(start)),
        }
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        size_of_val(&self.0[..])
    }
}

impl DualFaces<'_> {
    /// Computes the half-edges of the new faces.
    pub(crate) fn connectivity(&self) -> FinerHalves {
        let Self { mesh, faces, edges, vertices } = *self;
        let inner = mesh.corners().len();
        let around = inner + 4 * edges.len();
        let total = faces.corners().len();
        // The index of the new face across each old edge. The list is needed only if some old edges have no face across them.
        let mut index = Vec::new();
        if edges.len() < mesh.halves.len() {
            index.resize(mesh.halves.len(), NONE);
            (0..).zip(edges).for_each(|(own, &edge)| index[edge as usize] = own);
        }
        let across = |edge: u32, k: u32| match index.get(edge as usize).copied().unwrap_or(edge) {
            NONE => NONE,
            own => inner as u32 + 4 * own + k,
        };
        let mut edge_of: Vec<u32> = huge_vec(total);
        let mut halves: Vec<[u32; 2]> = huge_vec(inner + 3 * edges.len() + (total - around));
        // The faces inside old faces: each half-edge owns its edge.
        let own = edge_of[..inner].par_iter_mut().zip(&mut halves[..inner]).enumerate();
        own.with_min_len(BLOCK).for_each(|(half, (edge, halves))| {
            let old = mesh.edge_of[half];
            let is_owner = mesh.halves[old as usize][0] == half as u32;
            *edge = half as u32;
            *halves = [half as u32, across(old, if is_owner { 0 } else { 2 })];
        });
        // For each new vertex, the half-edge that starts there and belongs to a face around an old vertex, if there is one.
        let mut from = vec![NONE; vertices];
        let corners = &faces.corners()[..];
        (around as u32..).zip(&corners[around..]).for_each(|(half, &at)| from[at as usize] = half);
        // The faces across old edges: two of their half-edges are owners, or three at the border. The twins of these owners are in the
        // faces around old vertices.
        let (mut next, mut rest) = (inner, &mut halves[inner..]);
        let blocks = edges.chunks(BLOCK).map(|edges| {
            let border = edges.iter().filter(|&&edge| mesh.is_boundary(edge)).count();
            let own = rest.split_off_mut(..2 * edges.len() + border).expect("room for each owner");
            next += own.len();
            (edges, next - own.len(), own)
        });
        let edges_of = edge_of[inner..around].par_chunks_mut(4 * BLOCK);
        edges_of.zip(blocks.collect::<Vec<_>>()).enumerate().for_each(
            |(block, (edge_of, (edges, next, halves)))| {
                let first = inner + 4 * BLOCK * block;
                let mut owners = (next as u32..).zip(halves);
                for (k, edge_of) in edge_of.iter_mut().enumerate() {
                    let [owner, twin] = mesh.halves[edges[k / 4] as usize];
                    *edge_of = match k % 4 {
                        0 => owner,
                        2 if twin != NONE => twin,
                        side => {
                            let (edge, halves) = owners.next().expect("as many owners as counted");
                            let half = first + k;
                            let to = if side == 3 { half - 3 } else { half + 1 };
                            let twin = if side == 2 { NONE } else { from[corners[to] as usize] };
                            *halves = [half as u32, twin];
                            edge
                        }
                    };
                }
            },
        );
        // The faces around old vertices: a half-edge next to a face across an old edge has its owner in that face; all other half-edges are
        // on the border.
        let (before, edge_of_around) = edge_of.split_at_mut(around);
        let first = mesh.faces.len() + edges.len();
        by_faces(faces, first..faces.len(), edge_of_around, |here, to| {
            let around = here.flat_map(|face| {
                let corners = faces.face(face);
                corners.iter().zip(corners[1..].iter().chain(&corners[..1]))
            });
            for ((&from, &to), edge_of) in around.zip(to) {
                let owner = match [from, to].map(|vertex| (vertex as usize) < inner) {
                    [true, _] => {
                        let before = mesh.previous(from);
                        let edge = mesh.edge_of[before as usize];
                        let is_owner = mesh.halves[edge as usize][0] == before;
                        across(edge, if is_owner { 3 } else { 1 })
                    }
                    [false, true] => across(mesh.edge_of[to as usize], 1),
                    [false, false] => NONE,
                };
                *edge_of = if owner == NONE { NONE } else { before[owner as usize] };
            }
        });
        let alone = (around as u32..).zip(edge_of_around).filter(|(_, edge)| **edge == NONE);
        for (half, edge) in alone {
            *edge = next as u32;
            halves[next] = [half, NONE];
            next += 1;
        }
        halves.truncate(next);
        // A new vertex belongs to the face inside an old face, the faces across two edges, and the face around its old vertex.
        let mut rings: Vec<[u32; 4]> = huge_vec(inner);
        rings.par_iter_mut().enumerate().with_min_len(BLOCK).for_each(|(vertex, ring)| {
            let half = vertex as u32;
            let before = mesh.previous(half);
            let beyond = |half: u32, [of_owner, of_twin]: [u32; 2]| {
                let edge = mesh.edge_of[half as usize];
                match mesh.halves[edge as usize] {
                    [_, NONE] => NONE,
                    [owner, _] if owner == half => across(edge, of_owner),
                    _ => across(edge, of_twin),
                }
            };
            *ring = [half, beyond(before, [0, 2]), from[vertex], beyond(half, [1, 3])];
            if ring.contains(&NONE) {
                *ring = [NONE; 4];
            }
        });
        let starts = starts(faces, &halves, inner, vertices);
        let mesh = Connectivity::from_parts(faces.clone(), vertices, edge_of, halves);
        FinerHalves { mesh, starts, rings: Rings(rings) }
    }
}

/// Finds a half-edge that starts at each new vertex; at a border vertex the half-edge along the border.
fn starts(faces: &Faces, halves: &[[u32; 2]], inner: usize, vertices: usize) -> Vec<u32> {
    let mut starts: Vec<_> = (0..inner as u32).collect();
    starts.resize(vertices, NONE);
    if halves.par_iter().with_min_len(BLOCK).all(|[_, twin]| *twin != NONE) {
        return starts;
    }
    let corners = faces.corners();
    for (half, &vertex) in (0u32..).zip(&corners[..]).skip(inner) {
        let start = &mut starts[vertex as usize];
        *start = (*start).min(half);
    }
    for &[half, _] in halves.iter().filter(|[_, twin]| *twin == NONE) {
        starts[corners[half as usize] as usize] = half;
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refine::doo_sabin::Dual;
    use crate::refine::topology::Topology;
    use crate::refine::without_border::select_faces;
    use crate::rules::Rules;
    use crate::shapes::{cube, prism, sphere, torus};
    use crate::{Boundary, Creases, Scheme};

    #[test]
    fn the_half_edges_are_those_of_a_search() {
        let open = select_faces(&torus(6, 5, false), &(0..17).collect::<Vec<_>>()).unwrap();
        let one = select_faces(&cube(), &[3]).unwrap();
        for mesh in [cube(), prism(5), sphere(0), torus(5, 4, false), open, one] {
            for boundary in [Boundary::EdgeAndCorner, Boundary::None] {
                let rules =
                    Rules { scheme: Scheme::DooSabin, boundary, creases: Creases::OpenSubdiv };
                let (vertices, faces) = (mesh.positions().len(), mesh.faces().clone());
                let topology = Topology { rules, vertices, faces, creases: Vec::new() };
                let mut dual = Dual::from_topology(&topology).unwrap();
                for _ in 0..2 {
                    let searched = Connectivity::new(&dual.finer, dual.n_finer()).unwrap();
                    let FinerHalves { mesh: made, starts, rings } = dual.finer_halves().unwrap();
                    assert_eq!(made.edge_of, searched.0.edge_of, "{boundary:?} {:?}", mesh.faces());
                    assert_eq!(made.halves, searched.0.halves);
                    assert_eq!(starts, searched.1);
                    for (vertex, &start) in starts.iter().enumerate() {
                        let mut fan = Vec::new();
                        rings.fan(&made, vertex, start, &mut fan);
                        assert_eq!(fan, made.fan(start).collect::<Vec<_>>(), "{vertex}");
                    }
                    let known = rings.0.iter().filter(|ring| ring[0] != NONE).count();
                    assert!(mesh.faces().len() == 1 || 3 * known > starts.len(), "{known}");
                    dual = dual.next().unwrap();
                }
            }
        }
    }
}
