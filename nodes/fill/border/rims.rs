//! Finds the rims of a mesh: its border, split into loops that visit no vertex twice.

use std::fmt::{self, Display, Formatter};

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh};
use nalgebra::{Point3, Vector3};

use crate::triangles::triangulation::{NONE, next, previous};

/// The first edges and vertices at which a mesh is not manifold.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NotManifold {
    pub(crate) edges: Vec<[u32; 2]>,
    pub(crate) vertices: Vec<u32>,
}

impl Display for NotManifold {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let edges = self.edges.iter().map(|[a, b]| format!("edge {a}-{b}"));
        let vertices = self.vertices.iter().map(|vertex| format!("vertex {vertex}"));
        f.write_str(&edges.chain(vertices).collect::<Vec<_>>().join(", "))
    }
}

/// Maximum number of edges or vertices listed in an error message.
const MAX_LISTED: usize = 8;

/// Returns the rims of a mesh: its boundary loops, none of which visits a vertex twice. Each rim begins at its vertex with the lowest
/// index, and rims are sorted by this index. A rim has the direction of the faces that would fill it, opposite to the direction of the
/// existing faces.
///
/// # Errors
/// Returns an error if an edge has more than two faces or two faces of opposite orientation, or if a vertex has several face fans, one of
/// them closed.
pub(crate) fn rims(mesh: &Mesh) -> Result<Vec<Vec<u32>>, NotManifold> {
    let count = mesh.positions().len();
    let vertex_faces = VertexFaces::new(mesh.faces(), count);
    // The border edges that leave a vertex form a linked list; `newest` has the head of each list.
    let mut newest = vec![NONE; count];
    let mut edges: Vec<BorderEdge> = Vec::new();
    for corner in vertex_faces.border()? {
        let [to, from] =
            [corner, vertex_faces.next(corner)].map(|corner| vertex_faces.corners[corner as usize]);
        edges.push(BorderEdge { to, older: newest[from as usize], used: false });
        newest[from as usize] = edges.len() as u32 - 1;
    }
    let mut walk = BorderWalk { mesh, newest, edges, path_indices: vec![NONE; count] };
    let mut rims = Vec::new();
    for vertex in 0..count as u32 {
        while let Some(edge) = walk.oldest_unused_edge(vertex) {
            walk.follow(vertex, edge, &mut rims);
        }
    }
    rims.iter_mut().for_each(|rim: &mut Vec<u32>| {
        let lowest = (0..rim.len()).min_by_key(|&k| rim[k]).unwrap_or(0);
        rim.rotate_left(lowest);
    });
    rims.sort();
    Ok(rims)
}

/// The faces around each vertex. A face is given by its corner at the vertex.
struct VertexFaces<'a> {
    corners: &'a [u32],
    /// For each corner, the next and the previous corner of its face. `None` if all faces are triangles: then both follow from the corner's
    /// index.
    beside: Option<Vec<[u32; 2]>>,
    /// The corners at each vertex.
    by_vertex: Lists,
}

/// A face at a vertex, given by the face's vertices after and before that vertex.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Spoke {
    after: u32,
    before: u32,
    corner: u32,
}

/// The number of vertices that one task inspects.
const BLOCK_SIZE: usize = 2048;

/// Maximum number of faces around a vertex for which neighbors are found by linear search; more faces are sorted first.
const MAX_UNSORTED: usize = 16;

impl<'a> VertexFaces<'a> {
    fn new(faces: &'a Faces, count: usize) -> Self {
        let corners: &[u32] = faces.corners();
        let beside = (faces.sides() != Some(3)).then(|| {
            let mut beside = Vec::with_capacity(corners.len());
            let mut first = 0;
            for sides in faces.iter().map(|face| face.len() as u32) {
                beside
                    .extend((0..sides).map(|k| [k + 1, k + sides - 1].map(|k| first + k % sides)));
                first += sides;
            }
            beside
        });
        let by_vertex = Lists::group(count, || corners.iter().copied().zip(0u32..));
        Self { corners, beside, by_vertex }
    }

    fn next(&self, corner: u32) -> u32 {
        match &self.beside {
            Some(beside) => beside[corner as usize][0],
            None => next(corner),
        }
    }

    fn previous(&self, corner: u32) -> u32 {
        match &self.beside {
            Some(beside) => beside[corner as usize][1],
            None => previous(corner),
        }
    }

    /// Returns the corners, in ascending order, that start a border edge: an edge with only one face.
    fn border(&self) -> Result<Vec<u32>, NotManifold> {
        let vertices = 0..self.by_vertex.len() as u32;
        let blocks = vertices.into_par_iter().with_min_len(BLOCK_SIZE);
        let parts = blocks.fold_parts(Inspection::default, |mut found, vertex| {
            self.inspect(vertex, &mut found);
            found
        });
        let (mut edges, mut vertices, mut border) = (Vec::new(), Vec::new(), Vec::new());
        for found in parts {
            edges.extend(found.edges);
            vertices.extend(found.vertices);
            border.extend(found.border);
        }
        if edges.is_empty() && vertices.is_empty() {
            border.sort_unstable();
            return Ok(border);
        }
        edges.sort_unstable();
        edges.dedup();
        edges.truncate(MAX_LISTED);
        // If an edge has too many faces, the face fans at its ends are not well defined. Report only the edges then.
        vertices.truncate(if edges.is_empty() { MAX_LISTED } else { 0 });
        Err(NotManifold { edges, vertices })
    }

    fn inspect(&self, vertex: u32, found: &mut Inspection) {
        let Inspection { edges, vertices, border, spokes } = found;
        spokes.clear();
        spokes.extend(self.by_vertex.list(vertex as usize).iter().map(|&corner| {
            let beside = [self.next(corner), self.previous(corner)];
            let [after, before] = beside.map(|corner| self.corners[corner as usize]);
            Spoke { after, before, corner }
        }));
        if spokes.len() <= MAX_UNSORTED && is_closed(spokes) {
            return;
        }
        spokes.sort_unstable();
        let twice = spokes.windows(2).filter(|pair| pair[0].after == pair[1].after);
        edges.extend(twice.map(|pair| [vertex.min(pair[0].after), vertex.max(pair[0].after)]));
        let mut ends: Vec<u32> = spokes.iter().map(|spoke| spoke.before).collect();
        ends.sort_unstable();
        let open = spokes.iter().filter(|spoke| ends.binary_search(&spoke.after).is_err());
        border.extend(open.map(|spoke| spoke.corner));
        let fans: Vec<[u32; 2]> = spokes.iter().map(|spoke| [spoke.after, spoke.before]).collect();
        if has_closed_fan_beside_others(&fans) {
            vertices.push(vertex);
        }
    }
}

/// The results of inspecting a block of vertices.
#[derive(Default)]
struct Inspection {
    edges: Vec<[u32; 2]>,
    vertices: Vec<u32>,
    border: Vec<u32>,
    /// Scratch memory for the faces at the vertex being inspected.
    spokes: Vec<Spoke>,
}

/// Returns true if the faces form one closed fan around their vertex.
fn is_closed(spokes: &[Spoke]) -> bool {
    let mut at = 0;
    for met in 1..=spokes.len() {
        match spokes.iter().position(|spoke| spoke.after == spokes[at].before) {
            Some(0) => return met == spokes.len(),
            Some(next) => at = next,
            None => return false,
        }
    }
    false
}

/// Returns true if the faces at a vertex form several fans, one of them closed: then no fill can make the vertex manifold. Each face is
/// given by its vertices after and before the center vertex. Faces must be sorted.
pub(crate) fn has_closed_fan_beside_others(spokes: &[[u32; 2]]) -> bool {
    let mut met = vec![false; spokes.len()];
    fn walk(start: usize, met: &mut [bool], spokes: &[[u32; 2]]) {
        let mut at = start;
        loop {
            met[at] = true;
            // Find the face on the other side of the edge to the previous vertex.
            match spokes.binary_search_by_key(&spokes[at][1], |spoke| spoke[0]) {
                Ok(next) if met[next] => return,
                Ok(next) => at = next,
                Err(_) => return,
            }
        }
    }
    let mut ends: Vec<u32> = spokes.iter().map(|spoke| spoke[1]).collect();
    ends.sort_unstable();
    let open: Vec<usize> =
        (0..spokes.len()).filter(|&k| ends.binary_search(&spokes[k][0]).is_err()).collect();
    open.iter().for_each(|&start| walk(start, &mut met, spokes));
    let mut fans = open.len();
    let mut closed = 0;
    while let Some(start) = met.iter().position(|met| !met) {
        fans += 1;
        closed += 1;
        let mut at = start;
        while !std::mem::replace(&mut met[at], true) {
            match spokes.binary_search_by_key(&spokes[at][1], |spoke| spoke[0]) {
                Ok(next) => at = next,
                Err(_) => break,
            }
        }
    }
    closed > 0 && fans > 1
}

/// An entry in the linked list of the border edges that begin at a vertex.
struct BorderEdge {
    to: u32,
    /// The next border edge that begins at the same vertex; [`NONE`] at the end of the list.
    older: u32,
    used: bool,
}

struct BorderWalk<'a> {
    mesh: &'a Mesh,
    newest: Vec<u32>,
    edges: Vec<BorderEdge>,
    /// The position of each vertex on the current path; [`NONE`] if the vertex is not on the path.
    path_indices: Vec<u32>,
}

impl BorderWalk<'_> {
    fn unused_edges(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let mut edge = self.newest[vertex as usize];
        std::iter::from_fn(move || {
            while edge != NONE {
                let this = edge;
                edge = self.edges[edge as usize].older;
                if !self.edges[this as usize].used {
                    return Some(this);
                }
            }
            None
        })
    }

    fn oldest_unused_edge(&self, vertex: u32) -> Option<u32> {
        self.unused_edges(vertex).last()
    }

    /// Walks along the border from `start` until the walk returns to `start`. When the walk reaches a vertex of its path again, the part of
    /// the path since the last visit becomes a rim.
    fn follow(&mut self, start: u32, first: u32, rims: &mut Vec<Vec<u32>>) {
        let mut path = vec![start];
        self.path_indices[start as usize] = 0;
        let mut edge = first;
        loop {
            self.edges[edge as usize].used = true;
            let (from, at) = (path[path.len() - 1], self.edges[edge as usize].to);
            let path_index = self.path_indices[at as usize];
            if path_index != NONE {
                let rim = path.split_off(path_index as usize);
                rim.iter().for_each(|&vertex| self.path_indices[vertex as usize] = NONE);
                rims.push(rim);
                if path_index == 0 {
                    return;
                }
            }
            self.path_indices[at as usize] = path.len() as u32;
            path.push(at);
            let Some(next) = self.next_edge(from, at) else { return };
            edge = next;
        }
    }

    /// Returns the border edge that continues the walk at vertex `at`. If several face fans touch at `at`, each gap between fans is a
    /// separate hole. So edges of other fans are preferred, and among them the edge with the smallest angle to the edge `at`-`from`.
    fn next_edge(&self, from: u32, at: u32) -> Option<u32> {
        let mut edges = self.unused_edges(at);
        let first = edges.next()?;
        let Some(second) = edges.next() else { return Some(first) };
        let mut best = (self.preference(from, at, first), first);
        for edge in std::iter::once(second).chain(edges) {
            let preference = self.preference(from, at, edge);
            if preference.0 & !best.0.0 || (preference.0 == best.0.0 && preference.1 > best.0.1) {
                best = (preference, edge);
            }
        }
        Some(best.1)
    }

    /// Rates a border edge as continuation of a walk from `from` to `at`. Returns whether `edge` belongs to another face fan than the edge
    /// `from`-`at`, and the cosine of the angle between `edge` and the edge `at`-`from`.
    fn preference(&self, from: u32, at: u32, edge: u32) -> (bool, f64) {
        let to = self.edges[edge as usize].to;
        let origin = position(self.mesh, at);
        let back = (position(self.mesh, from) - origin).normalize();
        let ahead = (position(self.mesh, to) - origin).normalize();
        (!self.is_same_fan(from, at, to), ahead.dot(&back))
    }

    /// Returns true if the border edges `from`-`at` and `at`-`to` are the two border edges of one face fan around `at`.
    fn is_same_fan(&self, from: u32, at: u32, to: u32) -> bool {
        // Walk through the fan from the edge `from`-`at`, face by face in both directions.
        let faces: Vec<[u32; 2]> = spokes(self.mesh.faces(), at);
        let mut end = from;
        while let Some(&[_, next]) = faces.iter().find(|[first, _]| *first == end) {
            end = next;
            if end == from {
                return false;
            }
        }
        let mut begin = from;
        while let Some(&[next, _]) = faces.iter().find(|[_, last]| *last == begin) {
            begin = next;
            if begin == from {
                return false;
            }
        }
        end == to || begin == to
    }
}

/// Returns, for each face around a vertex, the vertices after and before that vertex.
fn spokes(faces: &Faces, vertex: u32) -> Vec<[u32; 2]> {
    let spokes = faces.iter().filter_map(|face| {
        let k = face.iter().position(|&corner| corner == vertex)?;
        Some([face[(k + 1) % face.len()], face[(k + face.len() - 1) % face.len()]])
    });
    spokes.collect()
}

/// Returns the vector area that a rim (boundary loop) encloses: half the sum of the cross products along the rim.
pub(crate) fn vector_area(mesh: &Mesh, rim: &[u32]) -> Vector3<f64> {
    let Some(&first) = rim.first() else { return Vector3::zeros() };
    let origin = position(mesh, first);
    rim.windows(2)
        .map(|pair| {
            (position(mesh, pair[0]) - origin).cross(&(position(mesh, pair[1]) - origin)) / 2.0
        })
        .sum()
}

fn position(mesh: &Mesh, vertex: u32) -> Point3<f64> {
    mesh.positions()[vertex as usize]
}
