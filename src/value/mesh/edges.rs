//! The edges between the faces of a mesh.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use super::Faces;
use crate::parallel::*;

/// The edges of a mesh as pairs of vertices a < b, in the order in which the faces first use them.
#[derive(Clone, Debug, PartialEq)]
pub struct Edges {
    /// The two vertices of each edge, the lower index first.
    pub vertices: Vec<[u32; 2]>,
    /// The number of faces at each edge: 1 at a boundary, and more than 2 where the mesh is not manifold.
    pub faces: Vec<u32>,
    /// The number of edges that two faces traverse in the same direction, which means that the orientations of these faces disagree.
    pub misoriented: usize,
    /// For each corner, the edge from that corner to the next corner of its face.
    pub of_corner: Vec<u32>,
}

impl Edges {
    /// Finds the edges of faces, each edge once.
    ///
    /// Each corner is listed at the lower vertex of the edge that begins there. In the sorted list of a vertex, the corners of one edge
    /// follow each other. The order in which threads add to a list has no influence on the result.
    pub(super) fn new(faces: &Faces) -> Self {
        let corners = &faces.corners()[..];
        let vertices = corners.par_iter().copied().reduce(|| 0, u32::max) as usize + 1;
        let starts = atomics(vertices + 1);
        for_each_side(faces, |_, [from, to]| {
            starts[from.min(to) as usize + 1].fetch_add(1, Relaxed);
        });
        let mut end = 0;
        for start in &starts {
            end += start.load(Relaxed);
            start.store(end, Relaxed);
        }
        // The entries of each list: the higher vertex of an edge, followed by a corner.
        let listed: Vec<AtomicU64> =
            (0..corners.len()).into_par_iter().map(|_| AtomicU64::new(0)).collect();
        for_each_side(faces, |corner, [from, to]| {
            let at = starts[from.min(to) as usize].fetch_add(1, Relaxed);
            listed[at as usize].store(pack(from.max(to), corner), Relaxed);
        });

        // For each corner the first one with the same edge.
        let first = atomics(corners.len());
        // For the first corner of each edge the vertex at the edge's other end, and the number of faces.
        let ends: Vec<AtomicU64> =
            (0..corners.len()).into_par_iter().map(|_| AtomicU64::new(0)).collect();
        let misoriented = (0..vertices)
            .into_par_iter()
            .with_min_len(1024)
            .map_init(Vec::new, |list: &mut Vec<u64>, low: usize| {
                // Each start has moved on to the end of its list.
                let begin = if low == 0 { 0 } else { starts[low - 1].load(Relaxed) };
                let range = begin as usize..starts[low].load(Relaxed) as usize;
                list.clear();
                list.extend(listed[range].iter().map(|entry| entry.load(Relaxed)));
                list.sort_unstable();
                let mut misoriented = 0;
                for edge in list.chunk_by(|a, b| a >> 32 == b >> 32) {
                    let [high, leader] = unpack(edge[0]);
                    for &entry in edge {
                        first[unpack(entry)[1] as usize].store(leader, Relaxed);
                    }
                    let from = corners[leader as usize];
                    let to = if from == high { low as u32 } else { high };
                    ends[leader as usize].store(pack(to, edge.len() as u32), Relaxed);
                    misoriented += edge
                        .windows(2)
                        .filter(|pair| {
                            let [a, b] =
                                [pair[0], pair[1]].map(|entry| corners[unpack(entry)[1] as usize]);
                            a == b
                        })
                        .count();
                }
                misoriented
            })
            .sum::<usize>();
        drop(listed);

        let leaders: Vec<u32> = (0..corners.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .filter(|&corner| first[corner as usize].load(Relaxed) == corner)
            .collect();
        let (vertices, counts) = leaders
            .par_iter()
            .with_min_len(4096)
            .map(|&corner| {
                let from = corners[corner as usize];
                let [to, count] = unpack(ends[corner as usize].load(Relaxed));
                ([from.min(to), from.max(to)], count)
            })
            .unzip();
        drop(ends);
        let edge_of = atomics(corners.len());
        leaders.par_iter().zip(0..leaders.len() as u32).with_min_len(4096).for_each(
            |(&corner, edge)| {
                edge_of[corner as usize].store(edge, Relaxed);
            },
        );
        let of_corner = first
            .par_iter()
            .with_min_len(4096)
            .map(|first| edge_of[first.load(Relaxed) as usize].load(Relaxed))
            .collect();
        Self { vertices, faces: counts, misoriented, of_corner }
    }
}

/// Calls `f` with each corner and the vertices of the edge that begins there.
fn for_each_side(faces: &Faces, f: impl Fn(u32, [u32; 2]) + Sync) {
    (0..faces.len()).into_par_iter().with_min_len(1024).for_each(|face| {
        let corners = faces.face(face);
        let next = corners[1..].iter().chain(&corners[..1]);
        for (corner, (&from, &to)) in
            (faces.first_corner(face) as u32..).zip(corners.iter().zip(next))
        {
            f(corner, [from, to]);
        }
    });
}

fn atomics(count: usize) -> Vec<AtomicU32> {
    (0..count).into_par_iter().with_min_len(4096).map(|_: usize| AtomicU32::new(0)).collect()
}

/// Packs two numbers into one that is ordered by the first, then by the second.
fn pack(a: u32, b: u32) -> u64 {
    u64::from(a) << 32 | u64::from(b)
}

fn unpack(packed: u64) -> [u32; 2] {
    [(packed >> 32) as u32, packed as u32]
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    /// Finds the edges one after the other.
    fn in_order(faces: &Faces) -> Edges {
        let mut known: HashMap<[u32; 2], (u32, u32)> = HashMap::new();
        let mut edges =
            Edges { vertices: vec![], faces: vec![], misoriented: 0, of_corner: vec![] };
        for face in faces.iter() {
            for (k, &from) in face.iter().enumerate() {
                let to = face[(k + 1) % face.len()];
                let ends = [from.min(to), from.max(to)];
                let next = known.len() as u32;
                let (edge, last) = known.entry(ends).or_insert((next, u32::MAX));
                if *edge == edges.vertices.len() as u32 {
                    edges.vertices.push(ends);
                    edges.faces.push(0);
                }
                edges.misoriented += usize::from(*last == from);
                *last = from;
                edges.faces[*edge as usize] += 1;
                edges.of_corner.push(*edge);
            }
        }
        edges
    }

    #[test]
    fn edges_are_those_of_one_search_after_the_other_for_any_number_of_threads() {
        let mut state = 1_u32;
        let mut below = |limit: u32| {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) % limit
        };
        for (count, vertices) in [(0, 3), (1, 3), (50, 7), (3_000, 40), (20_000, 9_000)] {
            // Vertices with low indices have many faces.
            let faces = (0..count).map(|_| {
                let mut face = Vec::new();
                while face.len() < 3 + below(2) as usize {
                    let vertex = below(vertices).min(below(vertices));
                    if !face.contains(&vertex) {
                        face.push(vertex);
                    }
                }
                face
            });
            let faces = Vec::from_iter(faces);
            let sides = Vec::from_iter(faces.iter().map(Vec::len));
            let faces = Faces::polygons(&sides, faces.concat()).unwrap();
            let expected = in_order(&faces);
            for threads in [1, 2, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                assert_eq!(pool.install(|| faces.edges()), expected);
            }
        }
    }
}
