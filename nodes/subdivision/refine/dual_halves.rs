//! How the faces hang together that a step of Doo and Sabin makes: by arithmetic from the mesh before, nothing is searched.
//!
//! New faces come in three runs: inside the old ones, with a half-edge for each old one; across the old edges, with four; around the
//! old vertices. In the face across an edge, half-edge 0 runs along the owner's new one and half-edge 2 along the twin's, or along
//! the border; 1 and 3 run along the faces around the ends. The first of two half-edges in this order is the owner of their edge.

use maquette_value::Faces;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;

use super::by_faces::{BLOCK, by_faces};
use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE};

/// What is known of the new faces.
pub(crate) struct DualFaces<'a> {
    pub(crate) mesh: &'a Connectivity,
    pub(crate) faces: &'a Faces,
    /// The old edges across which there are faces, ascending.
    pub(crate) edges: &'a [u32],
    /// Number of new vertices.
    pub(crate) vertices: usize,
}

/// How the new faces hang together.
pub(crate) struct FinerHalves {
    pub(crate) mesh: Connectivity,
    /// A half-edge from each vertex as [`HalfEdges::ring`] wants it.
    pub(crate) starts: Vec<u32>,
    pub(crate) rings: Rings,
}

/// The half-edges from each vertex, where they are four all around it; [`NONE`] for the others. Vertices behind the last are others, too.
#[derive(Debug, Default)]
pub(crate) struct Rings(Vec<[u32; 4]>);

impl Rings {
    /// Adds what [`HalfEdges::fan`] gives for a vertex from which `start` runs.
    #[inline]
    pub(crate) fn fan(&self, mesh: &Connectivity, vertex: usize, start: u32, to: &mut Vec<u32>) {
        match self.0.get(vertex) {
            Some(ring) if ring[0] != NONE => to.extend_from_slice(ring),
            _ => to.extend(mesh.fan(start)),
        }
    }

    /// How many bytes they take.
    pub(crate) fn size(&self) -> usize {
        size_of_val(&self.0[..])
    }
}

impl DualFaces<'_> {
    /// The half-edges of the new faces.
    pub(crate) fn connectivity(&self) -> FinerHalves {
        let Self { mesh, faces, edges, vertices } = *self;
        let inner = mesh.corners().len();
        let around = inner + 4 * edges.len();
        let total = faces.corners().len();
        // The place of the face across each old edge, if there is none across some.
        let mut place = Vec::new();
        if edges.len() < mesh.halves.len() {
            place.resize(mesh.halves.len(), NONE);
            (0..).zip(edges).for_each(|(own, &edge)| place[edge as usize] = own);
        }
        let across = |edge: u32, k: u32| match place.get(edge as usize).copied().unwrap_or(edge) {
            NONE => NONE,
            own => inner as u32 + 4 * own + k,
        };
        let mut edge_of: Vec<u32> = huge_vec(total);
        let mut halves: Vec<[u32; 2]> = huge_vec(inner + 3 * edges.len() + (total - around));
        // Inside: each half-edge owns its edge.
        let own = edge_of[..inner].par_iter_mut().zip(&mut halves[..inner]).enumerate();
        own.with_min_len(BLOCK).for_each(|(half, (edge, halves))| {
            let old = mesh.edge_of[half];
            let is_owner = mesh.halves[old as usize][0] == half as u32;
            *edge = half as u32;
            *halves = [half as u32, across(old, if is_owner { 0 } else { 2 })];
        });
        // The half-edge around an old vertex that runs from each new one, if any.
        let mut from = vec![NONE; vertices];
        let corners = &faces.corners()[..];
        (around as u32..).zip(&corners[around..]).for_each(|(half, &at)| from[at as usize] = half);
        // Across: two of them are owners, three at the border; their twins are in the faces around.
        let (mut next, mut rest) = (inner, &mut halves[inner..]);
        let blocks = edges.chunks(BLOCK).map(|edges| {
            let border = edges.iter().filter(|&&edge| mesh.is_boundary(edge)).count();
            let own = rest.split_off_mut(..2 * edges.len() + border).expect("room for each owner");
            next += own.len();
            (edges, next - own.len(), own)
        });
        let edges_of = edge_of[inner..around].par_chunks_mut(4 * BLOCK);
        edges_of.zip(Vec::from_iter(blocks)).enumerate().for_each(
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
        // Around: those beside faces across have their owners there; the others are alone.
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
        // A new vertex lies in the face inside, the faces across two edges, and the one around its old vertex.
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

/// A half-edge from each new vertex: at the border the one along it.
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
                let mut dual = Dual::first(&topology).unwrap();
                for _ in 0..2 {
                    let searched = Connectivity::new(&dual.finer, dual.n_finer()).unwrap();
                    let FinerHalves { mesh: made, starts, rings } = dual.finer_halves().unwrap();
                    assert_eq!(made.edge_of, searched.0.edge_of, "{boundary:?} {:?}", mesh.faces());
                    assert_eq!(made.halves, searched.0.halves);
                    assert_eq!(starts, searched.1);
                    for (vertex, &start) in starts.iter().enumerate() {
                        let mut fan = Vec::new();
                        rings.fan(&made, vertex, start, &mut fan);
                        assert_eq!(fan, Vec::from_iter(made.fan(start)), "{vertex}");
                    }
                    let known = rings.0.iter().filter(|ring| ring[0] != NONE).count();
                    assert!(mesh.faces().len() == 1 || 3 * known > starts.len(), "{known}");
                    dual = dual.next().unwrap();
                }
            }
        }
    }
}
