//! The connectivity of the refined mesh of a primal scheme, computed by arithmetic without searching, sorting or hashing.
//!
//! Order of new vertices: first the old vertices, then those on edges in the order of the edges, then, for Catmull-Clark, those inside
//! faces. Loop divides each triangle into four: first the triangles at the corners 0, 1 and 2, each beginning with its corner, then the
//! middle one. Catmull-Clark makes a quad at each corner, in order, beginning with this corner. Both divide the half-edge `h` into
//! `first_half(h)` and `second(h)`, whose indices follow from `h` by arithmetic.
//!
//! New edges are numbered by their owners (the first of their half-edges), like the old edges. The division of a face of `m` corners owns a
//! fixed number of edges inside the face, and two edges for each old edge that the face owns. Since old edges are numbered by their owners,
//! too, the index of the first edge of a face is the number of edges owned by the faces before it. So the index of each new edge is known
//! in advance.

use maquette_value::Faces;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;

use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE};

/// The number of faces per parallel task: about 50 us of work.
const BLOCK: usize = 2048;

/// The origin of a half-edge in the refined mesh.
pub(crate) enum Origin {
    /// The half-edge is the first half of the old half-edge with this index.
    First(u32),
    /// The half-edge is the second half of the old half-edge with this index.
    Second(u32),
    /// The half-edge is inside an old face; its twin is the new half-edge with this index.
    Inside(u32),
}

/// The division of a face by a scheme.
pub(crate) trait Split: Copy + Sync {
    /// The number of neighbors of a regular vertex.
    const VALENCE: usize;

    /// A refinement step divides an old half-edge into two. Returns the new half-edge at the start of the old half-edge `half`.
    fn first_half(self, half: u32) -> u32;

    /// A refinement step divides an old half-edge into two. Returns the new half-edge at the end of the old half-edge `half`.
    fn second(self, mesh: &Connectivity, half: u32) -> u32;

    /// The origin of a half-edge of the refined mesh.
    fn origin(self, mesh: &Connectivity, half: u32) -> Origin;

    /// Returns the new edges inside an old face that count to the new face at corner `k`, and the number of these edges (at most 2). Each
    /// edge is a pair of half-edges, the owner first.
    fn inner_edges(self, first: u32, sides: u32, k: u32) -> ([[u32; 2]; 2], usize);

    /// Writes the new half-edges that start at the new vertex on an edge, counter-clockwise, on the side of `half`.
    fn around_edge(self, mesh: &Connectivity, half: u32, to: &mut [u32]);

    /// Returns the corners of the refined faces, and the number of corners per refined face.
    fn faces(self, mesh: &Connectivity) -> (Vec<u32>, usize);

    /// The number of vertices of the refined mesh.
    fn vertices(self, mesh: &Connectivity) -> usize;
}

/// Divides a triangle into four (Loop).
#[derive(Clone, Copy)]
pub(crate) struct Triangles;

impl Split for Triangles {
    const VALENCE: usize = 6;

    #[inline]
    fn first_half(self, half: u32) -> u32 {
        3 * half + half / 3 * 3
    }

    #[inline]
    fn second(self, _: &Connectivity, half: u32) -> u32 {
        let (face, k) = (half / 3, half % 3);
        12 * face + if k == 2 { 2 } else { 3 * k + 5 }
    }

    fn origin(self, _: &Connectivity, half: u32) -> Origin {
        let (face, part, k) = (half / 12, half % 12 / 3, half % 3);
        match (part, k) {
            (3, _) => Origin::Inside(12 * face + 3 * ((k + 1) % 3) + 1),
            (_, 0) => Origin::First(3 * face + part),
            (_, 1) => Origin::Inside(12 * face + 9 + (part + 2) % 3),
            _ => Origin::Second(3 * face + (part + 2) % 3),
        }
    }

    #[inline]
    fn inner_edges(self, first: u32, _: u32, k: u32) -> ([[u32; 2]; 2], usize) {
        let edge = [4 * first + 3 * k + 1, 4 * first + 9 + (k + 2) % 3];
        ([edge, edge], 1)
    }

    #[inline]
    fn around_edge(self, mesh: &Connectivity, half: u32, to: &mut [u32]) {
        let middle = 12 * (half / 3) + 9 + half % 3;
        to.copy_from_slice(&[self.second(mesh, half), middle, self.first_half(half) + 1]);
    }

    fn faces(self, mesh: &Connectivity) -> (Vec<u32>, usize) {
        let kept = mesh.vertices as u32;
        let (old, edges) = (mesh.corners(), &mesh.edge_of[..]);
        let mut new: Vec<u32> = huge_vec(4 * old.len());
        let blocks = new.par_chunks_mut(12 * BLOCK);
        blocks.zip(old.par_chunks(3 * BLOCK).zip(edges.par_chunks(3 * BLOCK))).for_each(
            |(new, (old, edges))| {
                let old = old.as_chunks::<3>().0.iter().zip(edges.as_chunks::<3>().0);
                for (new, (&[a, b, c], edges)) in new.as_chunks_mut::<12>().0.iter_mut().zip(old) {
                    let [ab, bc, ca] = edges.map(|edge| kept + edge);
                    *new = [a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca];
                }
            },
        );
        (new, 3)
    }

    fn vertices(self, mesh: &Connectivity) -> usize {
        mesh.vertices + mesh.halves.len()
    }
}

/// Divides a polygon into a quad at each corner (Catmull-Clark).
#[derive(Clone, Copy)]
pub(crate) struct Corners;

impl Split for Corners {
    const VALENCE: usize = 4;

    #[inline]
    fn first_half(self, half: u32) -> u32 {
        4 * half
    }

    #[inline]
    fn second(self, mesh: &Connectivity, half: u32) -> u32 {
        4 * mesh.next(half) + 3
    }

    fn origin(self, mesh: &Connectivity, half: u32) -> Origin {
        let (old, k) = (half / 4, half % 4);
        match k {
            0 => Origin::First(old),
            1 => Origin::Inside(4 * mesh.next(old) + 2),
            2 => Origin::Inside(4 * mesh.previous(old) + 1),
            _ => Origin::Second(mesh.previous(old)),
        }
    }

    #[inline]
    fn inner_edges(self, first: u32, sides: u32, k: u32) -> ([[u32; 2]; 2], usize) {
        fn quad(k: u32, first: u32) -> u32 {
            4 * (first + k)
        }
        let last = [quad(0, first) + 2, quad(sides - 1, first) + 1];
        match sides - k {
            1 => ([last, last], 0),
            _ => ([[quad(k, first) + 1, quad(k + 1, first) + 2], last], if k == 0 { 2 } else { 1 }),
        }
    }

    #[inline]
    fn around_edge(self, mesh: &Connectivity, half: u32, to: &mut [u32]) {
        to.copy_from_slice(&[self.second(mesh, half), 4 * half + 1]);
    }

    fn faces(self, mesh: &Connectivity) -> (Vec<u32>, usize) {
        let (kept, middle) = (mesh.vertices as u32, (mesh.vertices + mesh.halves.len()) as u32);
        let (old, edges) = (mesh.corners(), &mesh.edge_of[..]);
        let mut new: Vec<u32> = huge_vec(4 * old.len());
        let blocks = new.par_chunks_mut(16 * BLOCK).enumerate();
        blocks.for_each(|(block, new)| {
            let quads = new.as_chunks_mut::<4>().0.iter_mut();
            if mesh.faces.sides() == Some(4) {
                quads.enumerate().for_each(|(k, quad)| {
                    let half = 4 * BLOCK * block + k;
                    let previous = half & !3 | half.wrapping_sub(1) & 3;
                    let face = middle + (half / 4) as u32;
                    *quad = [old[half], kept + edges[half], face, kept + edges[previous]];
                });
            } else {
                quads.enumerate().for_each(|(k, quad)| {
                    let half = 4 * BLOCK * block + k;
                    let previous = mesh.previous(half as u32) as usize;
                    let face = middle + mesh.face_of(half as u32);
                    *quad = [old[half], kept + edges[half], face, kept + edges[previous]];
                });
            }
        });
        (new, 4)
    }

    fn vertices(self, mesh: &Connectivity) -> usize {
        mesh.vertices + mesh.halves.len() + mesh.faces.len()
    }
}

/// Returns the faces after a refinement step.
pub(crate) fn split_faces(mesh: &Connectivity, split: impl Split) -> Faces {
    let (corners, sides) = split.faces(mesh);
    Faces::uniform(sides, corners).expect("as many corners as their faces have")
}

/// A parallel task: the division of some consecutive old faces.
struct SplitTask<'a, 'b> {
    /// The index of the first old face of the task, and the end of the range.
    faces: [usize; 2],
    /// The index of the first edge that the old faces own.
    first_edge: u32,
    /// The index of the first half-edge of the new faces. `first_new` is the index of the first new edge that these faces own.
    first_half: u32,
    first_new: u32,
    /// The number of new edges of this task that have got their index so far.
    numbered: u32,
    /// The edge index of each new half-edge.
    edge_of: &'a mut [u32],
    /// The half-edges of each new edge.
    halves: &'a mut [[u32; 2]],
    /// The two new edges on each old edge that the old faces own.
    children: &'b mut [[u32; 2]],
}

/// Computes the half-edges of the refined `faces`. Also returns the two new edges on each old edge, first the one at the start of the old
/// edge's owner.
pub(crate) fn split_halves(
    mesh: &Connectivity,
    faces: Faces,
    split: impl Split,
) -> (Connectivity, Vec<[u32; 2]>) {
    let (n_halves, n_edges) = (mesh.corners().len(), mesh.halves.len());
    let mut edge_of: Vec<u32> = huge_vec(4 * n_halves);
    let mut halves: Vec<[u32; 2]> = huge_vec(n_halves + 2 * n_edges);
    let mut children: Vec<[u32; 2]> = huge_vec(n_edges);
    let starts = block_starts(mesh);
    let mut parts = Vec::with_capacity(starts.len());
    let (mut rest, mut rest_of_halves, mut rest_of_children) =
        (&mut edge_of[..], &mut halves[..], &mut children[..]);
    for pair in starts.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let (corners, edges) = (to.corner - from.corner, to.edge - from.edge);
        let part = SplitTask {
            faces: [from.face, to.face],
            first_edge: from.edge as u32,
            first_half: 4 * from.corner as u32,
            first_new: (from.corner + 2 * from.edge) as u32,
            numbered: 0,
            edge_of: rest.split_off_mut(..4 * corners).expect("four for each corner"),
            halves: rest_of_halves.split_off_mut(..corners + 2 * edges).expect("as counted"),
            children: rest_of_children.split_off_mut(..edges).expect("as counted"),
        };
        parts.push(part);
    }
    parts.par_iter_mut().for_each(|part| part.number(mesh, split));
    let edges_of_parts: Vec<_> =
        parts.into_iter().map(|part| (part.faces, part.first_edge, part.edge_of)).collect();
    edges_of_parts.into_par_iter().for_each(|(faces, first_edge, edge_of)| {
        adopt(mesh, split, faces, first_edge, edge_of, &children);
    });
    (Connectivity::from_parts(faces, split.vertices(mesh), edge_of, halves), children)
}

/// The beginning of a block of old faces: its first face, the first corner of that face, and the first edge that the block owns.
#[derive(Clone, Copy)]
struct Start {
    face: usize,
    corner: usize,
    /// The number of edges owned by the faces before the block.
    edge: usize,
}

fn block_starts(mesh: &Connectivity) -> Vec<Start> {
    let n_faces = mesh.faces.len();
    let faces = (0..n_faces).step_by(BLOCK).chain([n_faces]);
    faces
        .map(|face| {
            let corner = mesh.faces.first_corner(face);
            Start { face, corner, edge: mesh.edges_before(corner) }
        })
        .collect()
}

impl SplitTask<'_, '_> {
    /// Numbers the new edges that the division of the task's faces owns.
    fn number(&mut self, mesh: &Connectivity, split: impl Split) {
        let mut owned = self.first_edge;
        for face in self.faces[0]..self.faces[1] {
            let first = mesh.faces.first_corner(face) as u32;
            let sides = mesh.faces.first_corner(face + 1) as u32 - first;
            let owned_before = owned;
            for k in 0..sides {
                let half = first + k;
                let previous = if k == 0 { first + sides - 1 } else { half - 1 };
                let old = mesh.edge_of[half as usize];
                if old >= owned_before {
                    let twin = mesh.halves[old as usize][1];
                    let twin = if twin == NONE { NONE } else { split.second(mesh, twin) };
                    let new = self.add(split.first_half(half), twin);
                    self.children[(old - self.first_edge) as usize][0] = new;
                    owned += 1;
                }
                let (inside, count) = split.inner_edges(first, sides, k);
                for &[owner, twin] in &inside[..count] {
                    let new = self.add(owner, twin);
                    self.edge_of[(twin - self.first_half) as usize] = new;
                }
                let old = mesh.edge_of[previous as usize];
                if old >= owned_before {
                    let twin = mesh.halves[old as usize][1];
                    let twin = if twin == NONE { NONE } else { split.first_half(twin) };
                    let new = self.add(split.second(mesh, previous), twin);
                    self.children[(old - self.first_edge) as usize][1] = new;
                }
            }
        }
    }

    /// Assigns the next index to the edge with the half-edges `owner` and `twin`. Returns the index.
    fn add(&mut self, owner: u32, twin: u32) -> u32 {
        self.edge_of[(owner - self.first_half) as usize] = self.first_new + self.numbered;
        self.halves[self.numbered as usize] = [owner, twin];
        self.numbered += 1;
        self.first_new + self.numbered - 1
    }
}

/// Sets the edge indices of new half-edges that are on an old edge owned by another face.
fn adopt(
    mesh: &Connectivity,
    split: impl Split,
    faces: [usize; 2],
    first_edge: u32,
    edge_of: &mut [u32],
    children: &[[u32; 2]],
) {
    let first_half = 4 * mesh.faces.first_corner(faces[0]) as u32;
    let mut owned = first_edge;
    for face in faces[0]..faces[1] {
        let owned_before = owned;
        for half in mesh.faces.first_corner(face)..mesh.faces.first_corner(face + 1) {
            let old = mesh.edge_of[half];
            if old >= owned_before {
                owned += 1;
                continue;
            }
            let [at_start, at_end] = children[old as usize];
            let [first, second] = [split.first_half(half as u32), split.second(mesh, half as u32)];
            edge_of[(first - first_half) as usize] = at_end;
            edge_of[(second - first_half) as usize] = at_start;
        }
    }
}
