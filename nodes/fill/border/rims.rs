//! The rims of a mesh: the boundary loops into which its border is cut, none of which visits a vertex twice.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh};
use nalgebra::Vector3;

use crate::triangles::triangulation::{NONE, next, previous};

/// Places where a mesh is no surface, some of them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NotManifold {
    pub(crate) edges: Vec<[u32; 2]>,
    pub(crate) vertices: Vec<u32>,
}

/// As many places are listed as a message can hold.
const LISTED: usize = 8;

/// The rims of a mesh: its boundary loops, none of which visits a vertex twice. Each begins at its lowest vertex, and they are in the order
/// of these. A rim runs as the faces do that would fill it: against the faces that are there.
///
/// # Errors
/// If an edge has more than two faces, or two that disagree about their side; or a vertex has separate fans of faces one of which is
/// closed.
pub(crate) fn rims(mesh: &Mesh) -> Result<Vec<Vec<u32>>, NotManifold> {
    let count = mesh.positions().len();
    let vertex_faces = VertexFaces::new(mesh.faces(), count);
    // The border edges that leave one vertex are a linked list, of which `newest` has the head.
    let mut newest = vec![NONE; count];
    let mut edges: Vec<BorderEdge> = Vec::new();
    for corner in vertex_faces.border()? {
        let [to, from] =
            [corner, vertex_faces.next(corner)].map(|corner| vertex_faces.corners[corner as usize]);
        edges.push(BorderEdge { to, older: newest[from as usize], used: false });
        newest[from as usize] = edges.len() as u32 - 1;
    }
    let mut walk = Walk { mesh, newest, edges, places: vec![NONE; count] };
    let mut rims = Vec::new();
    for vertex in 0..count as u32 {
        while let Some(edge) = walk.any(vertex) {
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

/// The faces around each vertex, by the corners that they have there.
struct VertexFaces<'a> {
    corners: &'a [u32],
    /// The corner after each and the one before, where faces are no triangles.
    beside: Option<Vec<[u32; 2]>>,
    /// The corners at each vertex.
    by_vertex: Lists,
}

/// A face at a vertex, by the vertices after and before that one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Spoke {
    after: u32,
    before: u32,
    corner: u32,
}

/// Vertices that one task inspects.
const BLOCK: usize = 2048;

/// Around a vertex with more faces than these, neighbors are found by a search in sorted order.
const FEW: usize = 16;

impl<'a> VertexFaces<'a> {
    fn new(faces: &'a Faces, count: usize) -> Self {
        let corners: &[u32] = faces.corners();
        let beside = (faces.sides() != Some(3)).then(|| {
            let mut beside = Vec::with_capacity(corners.len());
            let mut first = 0;
            for sides in faces.iter().map(|face| face.len() as u32) {
                fn place(k: u32, first: u32, sides: u32) -> u32 {
                    first + k % sides
                }
                beside.extend(
                    (0..sides)
                        .map(|k| [place(k + 1, first, sides), place(k + sides - 1, first, sides)]),
                );
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

    /// The corners, ascending, from which edges of one face run to the next corner.
    fn border(&self) -> Result<Vec<u32>, NotManifold> {
        let vertices = 0..self.by_vertex.len() as u32;
        let blocks = vertices.into_par_iter().with_min_len(BLOCK);
        let parts = blocks.fold_parts(Found::default, |mut found, vertex| {
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
        edges.truncate(LISTED);
        // Where edges have too many faces, there are no fans.
        vertices.truncate(if edges.is_empty() { LISTED } else { 0 });
        Err(NotManifold { edges, vertices })
    }

    fn inspect(&self, vertex: u32, found: &mut Found) {
        let Found { edges, vertices, border, spokes } = found;
        spokes.clear();
        spokes.extend(self.by_vertex.of(vertex as usize).iter().map(|&corner| {
            let beside = [self.next(corner), self.previous(corner)];
            let [after, before] = beside.map(|corner| self.corners[corner as usize]);
            Spoke { after, before, corner }
        }));
        if spokes.len() <= FEW && is_closed(spokes) {
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

/// What was found at some vertices.
#[derive(Default)]
struct Found {
    edges: Vec<[u32; 2]>,
    vertices: Vec<u32>,
    border: Vec<u32>,
    /// The spokes of the vertex that is inspected.
    spokes: Vec<Spoke>,
}

/// Whether faces make one fan that goes all around.
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

/// Whether the faces at a vertex make several fans, one of which is closed: then no fill can make it manifold. Each face is given by the
/// vertices after and before the one in the middle, sorted.
pub(crate) fn has_closed_fan_beside_others(spokes: &[[u32; 2]]) -> bool {
    let mut met = vec![false; spokes.len()];
    fn walk(start: usize, met: &mut Vec<bool>, spokes: &[[u32; 2]]) {
        let mut at = start;
        loop {
            met[at] = true;
            // The face beyond the edge to the vertex before.
            match spokes.binary_search_by_key(&spokes[at][1], |spoke| spoke[0]) {
                Ok(next) if met[next] => return,
                Ok(next) => at = next,
                Err(_) => return,
            }
        }
    }
    let mut ends: Vec<u32> = spokes.iter().map(|spoke| spoke[1]).collect();
    ends.sort_unstable();
    fn begins(spoke: &[u32; 2], ends: &[u32]) -> bool {
        ends.binary_search(&spoke[0]).is_err()
    }
    let open: Vec<usize> = (0..spokes.len()).filter(|&k| begins(&spokes[k], &ends)).collect();
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

/// A border edge, from the vertex in whose list it is.
struct BorderEdge {
    to: u32,
    /// The next in the list of the same vertex.
    older: u32,
    used: bool,
}

struct Walk<'a> {
    mesh: &'a Mesh,
    newest: Vec<u32>,
    edges: Vec<BorderEdge>,
    /// The place of each vertex on the path walked so far.
    places: Vec<u32>,
}

impl Walk<'_> {
    fn unused(&self, vertex: u32) -> impl Iterator<Item = u32> {
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

    fn any(&self, vertex: u32) -> Option<u32> {
        self.unused(vertex).last()
    }

    /// Walks along the border from a vertex until it is back. Whenever it comes to a vertex again, the edges since then are a rim.
    fn follow(&mut self, start: u32, first: u32, rims: &mut Vec<Vec<u32>>) {
        let mut path = vec![start];
        self.places[start as usize] = 0;
        let mut edge = first;
        loop {
            self.edges[edge as usize].used = true;
            let (from, at) = (path[path.len() - 1], self.edges[edge as usize].to);
            let place = self.places[at as usize];
            if place != NONE {
                let rim = path.split_off(place as usize);
                rim.iter().for_each(|&vertex| self.places[vertex as usize] = NONE);
                rims.push(rim);
                if place == 0 {
                    return;
                }
            }
            self.places[at as usize] = path.len() as u32;
            path.push(at);
            let Some(next) = self.onwards(from, at) else { return };
            edge = next;
        }
    }

    /// The border edge on which to go on at a vertex. Where several fans of faces touch in it, each gap between them is a hole of its own:
    /// the edge that lies nearest is taken.
    fn onwards(&self, from: u32, at: u32) -> Option<u32> {
        let mut edges = self.unused(at);
        let first = edges.next()?;
        let Some(second) = edges.next() else { return Some(first) };
        fn place(vertex: u32, mesh: &Mesh) -> nalgebra::Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        let back = (place(from, self.mesh) - place(at, self.mesh)).normalize();
        let fits = |edge: u32| {
            let ahead =
                (place(self.edges[edge as usize].to, self.mesh) - place(at, self.mesh)).normalize();
            let same_fan = self.is_same_fan(from, at, self.edges[edge as usize].to);
            (u8::from(!same_fan), ahead.dot(&back))
        };
        let mut best = (fits(first), first);
        for edge in std::iter::once(second).chain(edges) {
            let fit = fits(edge);
            if fit.0 > best.0.0 || (fit.0 == best.0.0 && fit.1 > best.0.1) {
                best = (fit, edge);
            }
        }
        Some(best.1)
    }

    /// Whether the border edges from `from` to `at` and on to `to` are the two sides of one fan of faces around `at`.
    fn is_same_fan(&self, from: u32, at: u32, to: u32) -> bool {
        // The edge of the fan that the walk came along, turned from face to face until there is none.
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

/// Of each face around a vertex the corner after it and the one before.
fn spokes(faces: &Faces, vertex: u32) -> Vec<[u32; 2]> {
    let around = faces.iter().filter_map(|face| {
        let place = face.iter().position(|&corner| corner == vertex)?;
        Some([face[(place + 1) % face.len()], face[(place + face.len() - 1) % face.len()]])
    });
    around.collect()
}

/// The vector area of a rim: half the sum of the cross products along it.
pub(crate) fn enclosed(mesh: &Mesh, rim: &[u32]) -> Vector3<f64> {
    fn place(vertex: u32, mesh: &Mesh) -> nalgebra::Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let Some(&first) = rim.first() else { return Vector3::zeros() };
    let origin = place(first, mesh);
    rim.windows(2)
        .map(|pair| (place(pair[0], mesh) - origin).cross(&(place(pair[1], mesh) - origin)) / 2.0)
        .sum()
}
