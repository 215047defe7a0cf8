//! Zips borders that touch: a crack without width is joined instead of filled.
//!
//! Barequet and Sharir, "Filling gaps in the boundary of a polyhedron" (1995); Turk and Levoy, "Zippered polygon meshes from range images"
//! (1994).

use std::collections::BTreeMap;

use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_base::weld::{NO_PLACE, join_places};
use maquette_value::{Attribute, Bounds, BoxTree, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::split_edges::{EdgeSplit, split_edges};

/// The maximum distance between borders that touch, as a fraction of the length of the edges there.
const TOUCHING: f64 = 0.05;

/// The distance up to which borders touch even if their edges are very short, as a fraction of the diagonal of the mesh's bounding box.
const MIN_TOUCHING: f64 = 1e-6;

/// The maximum cosine of the angle between the directions of two borders that run against each other.
const MAX_COSINE: f64 = -0.5;

/// The number of edges on either side of a vertex whose mean length is the length of edges there.
const MEAN_OF: usize = 3;

/// The minimum fraction of the vertices of an outer border that touch others if all of it is zipped.
const MOST: f64 = 0.5;

/// Texture coordinates that differ by more than this fraction of their range belong to two sides of a seam.
const SEAM: f64 = 1e-3;

/// A mesh after zipping.
pub(crate) struct ZippedMesh {
    pub(crate) mesh: Mesh,
    /// For each vertex before, its index in the zipped mesh.
    pub(crate) vertices: Vec<u32>,
    /// The number of vertices that were joined with others.
    pub(crate) joined: usize,
}

/// A rim to zip.
pub(crate) struct ZipRim<'a> {
    pub(crate) vertices: &'a [u32],
    /// True for the outer border of an open surface.
    pub(crate) is_outer: bool,
}

/// Zips the given rims of `mesh` where they touch each other or themselves. Returns `None` if they touch nowhere.
///
/// Each vertex is matched with the nearest edge that runs against one of its own border edges within a twentieth of the length of the edges
/// there: with an end of that edge, or with a new vertex on it. Matches are made in the order of distances, then borders are joined edge by
/// edge along them. Of joined vertices, the one with the lowest index keeps its position. An outer border, which may be jagged, is zipped
/// only where its edges coincide, unless most of it touches other borders.
///
/// # Errors
/// Does not fail for a valid mesh.
pub(crate) fn zip(mesh: &Mesh, rims: &[ZipRim<'_>]) -> Result<Option<ZippedMesh>, MeshError> {
    if rims.is_empty() {
        return Ok(None);
    }
    let border = Border::new(mesh, rims);
    let mut matches = border.find_matches();
    border.drop_outer(rims, &mut matches);
    if matches.is_empty() {
        return Ok(None);
    }
    let mut places = Places::new(mesh);
    let mut splits: Vec<EdgeSplit> = Vec::new();
    for found in &matches {
        let edge = &border.edges[found.edge as usize];
        let end = if found.at < 0.5 { edge.from } else { edge.to };
        let is_near = (border.point(end) - border.point(found.vertex)).norm() <= found.reach;
        if is_near && places.join(found.vertex, end) || found.at <= 0.0 || 1.0 <= found.at {
            continue;
        }
        let corner = border.corners.get(&[edge.to, edge.from]).copied();
        if let Some(corner) = corner.filter(|_| !border.turns_over(found)) {
            // The face runs along the edge in the opposite direction.
            splits.push(EdgeSplit { corner, at: 1.0 - found.at, vertex: found.vertex });
        }
    }
    let split = split_edges(mesh, splits)?;
    let mut numbers = vec![NO_PLACE; split.mesh.positions().len()];
    let count = mesh.positions().len() as u32;
    for (new, &vertex) in (count..).zip(&split.vertices) {
        let place = places.sets.find(vertex);
        numbers[new as usize] = place;
        numbers[vertex as usize] = place;
    }
    for vertex in places.members.values().flatten() {
        numbers[*vertex as usize] = places.sets.find(*vertex);
    }
    let thresholds = seam_thresholds(mesh);
    let joined = join_places(&split.mesh, &numbers, |name, attribute, a, b| {
        let threshold = thresholds.get(name).copied();
        threshold.is_some_and(|threshold| match attribute {
            Attribute::Pair(pairs) => (0..2).any(|k| threshold < (pairs[a][k] - pairs[b][k]).abs()),
            _ => false,
        })
    })?;
    Ok(joined.map(|joined| ZippedMesh {
        joined: split.mesh.positions().len() - joined.mesh.positions().len(),
        vertices: joined.vertices[..count as usize].to_vec(),
        mesh: joined.mesh,
    }))
}

/// Returns, for each attribute of pairs of vertices, the difference from which on two vertices are on different sides of a seam.
fn seam_thresholds(mesh: &Mesh) -> BTreeMap<String, f64> {
    let pairs = mesh.vertex().iter().filter_map(|(name, attribute)| match attribute {
        Attribute::Pair(pairs) => {
            let numbers = pairs.iter().flatten();
            let [low, high] = numbers
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &x| {
                    [low.min(x), high.max(x)]
                });
            Some((name.to_owned(), SEAM * (high - low)))
        }
        _ => None,
    });
    pairs.collect()
}

/// An edge of a rim, in the direction of the rim.
struct RimEdge {
    from: u32,
    to: u32,
    direction: Vector3<f64>,
}

/// A vertex of a rim, with its neighbors along the rim.
struct RimVertex {
    vertex: u32,
    /// The directions of the rim edges before and after the vertex.
    directions: [Vector3<f64>; 2],
    /// The index of the rim.
    rim: usize,
}

/// A vertex and the place on an edge that it touches.
struct Match {
    distance: f64,
    vertex: u32,
    /// The index of the rim of the vertex.
    rim: usize,
    edge: u32,
    /// The position on the edge: 0 at its start, 1 at its end.
    at: f64,
    /// The distance up to which the vertex touches others.
    reach: f64,
}

/// The border that is zipped.
struct Border<'a> {
    mesh: &'a Mesh,
    /// The vertices and edges of all rims; edge k runs from vertex k.
    vertices: Vec<RimVertex>,
    edges: Vec<RimEdge>,
    /// The distance up to which each vertex touches others, in the order of `vertices`.
    reaches: Vec<f64>,
    /// The distance up to which edges coincide.
    rounding: f64,
    /// For the two ends of a border edge in the direction of its face, the corner at its start.
    corners: BTreeMap<[u32; 2], u32>,
}

impl<'a> Border<'a> {
    fn new(mesh: &'a Mesh, rims: &[ZipRim<'_>]) -> Self {
        let points = mesh.positions();
        let diagonal = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
        let rounding = MIN_TOUCHING * diagonal;
        let (mut vertices, mut edges, mut reaches) = (Vec::new(), Vec::new(), Vec::new());
        let mut is_on_rim = vec![false; points.len()];
        for (index, ZipRim { vertices: rim, .. }) in rims.iter().enumerate() {
            let count = rim.len();
            let spans: Vec<Vector3<f64>> = (0..count)
                .map(|k| points[rim[(k + 1) % count] as usize] - points[rim[k] as usize])
                .collect();
            for k in 0..count {
                is_on_rim[rim[k] as usize] = true;
                let before = unit(spans[(k + count - 1) % count]);
                let direction = unit(spans[k]);
                let around = (0..2 * MEAN_OF.min(count))
                    .map(|i| (k + i + count - MEAN_OF.min(count)) % count);
                let length =
                    around.clone().map(|i| spans[i].norm()).sum::<f64>() / around.len() as f64;
                let directions = [before, direction];
                vertices.push(RimVertex { vertex: rim[k], directions, rim: index });
                edges.push(RimEdge { from: rim[k], to: rim[(k + 1) % count], direction });
                reaches.push(rounding.max(TOUCHING * length));
            }
        }
        let mut corners = BTreeMap::new();
        let mut first = 0;
        for face in mesh.faces().iter() {
            for (k, &from) in face.iter().enumerate() {
                let to = face[(k + 1) % face.len()];
                if is_on_rim[from as usize] && is_on_rim[to as usize] {
                    corners.insert([from, to], first + k as u32);
                }
            }
            first += face.len() as u32;
        }
        Self { mesh, vertices, edges, reaches, rounding, corners }
    }

    fn point(&self, vertex: u32) -> Point3<f64> {
        self.mesh.positions()[vertex as usize]
    }

    /// Returns the nearest edge that each vertex touches, the smallest distances first.
    fn find_matches(&self) -> Vec<Match> {
        let boxes = self
            .edges
            .iter()
            .map(|edge| Bounds::from_points(&[self.point(edge.from), self.point(edge.to)]));
        let tree = BoxTree::new(boxes);
        let mut matches: Vec<Match> = (0..self.vertices.len())
            .filter_map(|k| self.find_match(&tree, &self.vertices[k], self.reaches[k]))
            .collect();
        matches.sort_by(|a, b| {
            a.distance.total_cmp(&b.distance).then((a.vertex, a.edge).cmp(&(b.vertex, b.edge)))
        });
        matches
    }

    /// Drops the matches of outer borders that merely come near others.
    fn drop_outer(&self, rims: &[ZipRim<'_>], matches: &mut Vec<Match>) {
        let mut matched = vec![0; rims.len()];
        matches.iter().for_each(|found| matched[found.rim] += 1);
        let is_jagged: Vec<bool> = rims
            .iter()
            .zip(matched)
            .map(|(rim, matched)| {
                rim.is_outer && f64::from(matched) < MOST * rim.vertices.len() as f64
            })
            .collect();
        matches.retain(|found| {
            let of_edge = self.vertices[found.edge as usize].rim;
            found.distance <= self.rounding || !is_jagged[found.rim] && !is_jagged[of_edge]
        });
    }

    fn find_match(&self, tree: &BoxTree, of: &RimVertex, reach: f64) -> Option<Match> {
        let point = self.point(of.vertex);
        let margin = Vector3::repeat(reach);
        let mut best: Option<Match> = None;
        tree.visit_overlapping(&Bounds::from_points(&[point - margin, point + margin]), |k| {
            let edge = &self.edges[k as usize];
            if edge.from == of.vertex
                || edge.to == of.vertex
                || !of.directions.iter().any(|own| edge.direction.dot(own) <= MAX_COSINE)
            {
                return;
            }
            let [start, end] = [self.point(edge.from), self.point(edge.to)];
            let span = end - start;
            let square = span.norm_squared();
            let at = if square > 0.0 { (point - start).dot(&span) / square } else { 0.0 };
            let at = at.clamp(0.0, 1.0);
            let distance = (start + span * at - point).norm();
            let reach = reach.min(self.reaches[k as usize]);
            let is_better =
                best.as_ref().is_none_or(|best| (distance, k) < (best.distance, best.edge));
            if distance <= reach && is_better && !self.is_beside(edge, of.vertex) {
                best = Some(Match { distance, vertex: of.vertex, rim: of.rim, edge: k, at, reach });
            }
        });
        best
    }

    /// Returns true if the face at an edge contains a vertex.
    fn is_beside(&self, edge: &RimEdge, vertex: u32) -> bool {
        let corner = self.corners.get(&[edge.to, edge.from]);
        corner.is_none_or(|&corner| {
            let faces = self.mesh.faces();
            let face = self.face_of(corner);
            faces.face(face).contains(&vertex)
        })
    }

    fn face_of(&self, corner: u32) -> usize {
        let faces = self.mesh.faces();
        match faces.sides() {
            Some(sides) => corner as usize / sides,
            None => {
                let (mut low, mut high) = (0, faces.len());
                while low + 1 < high {
                    let middle = usize::midpoint(low, high);
                    if faces.first_corner(middle) <= corner as usize {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                low
            }
        }
    }

    /// Returns true if a new vertex on the matched edge would turn a part of the face at the edge over.
    fn turns_over(&self, found: &Match) -> bool {
        let edge = &self.edges[found.edge as usize];
        let Some(&corner) = self.corners.get(&[edge.to, edge.from]) else { return true };
        let face = self.mesh.faces().face(self.face_of(corner));
        let normal = self.mesh.area_vector(face);
        let new = self.point(found.vertex);
        let others = face.iter().filter(|&&other| other != edge.from && other != edge.to);
        let [start, end] = [self.point(edge.to), self.point(edge.from)];
        others.map(|&other| self.point(other)).any(|other| {
            let first = (new - start).cross(&(other - start)).dot(&normal);
            let second = (end - new).cross(&(other - new)).dot(&normal);
            first <= 0.0 || second <= 0.0
        })
    }
}

/// Sets of vertices that are to be joined.
struct Places {
    sets: UnionFind,
    /// For the lowest vertex of each set of several, all its members.
    members: BTreeMap<u32, Vec<u32>>,
    /// The faces around each vertex.
    faces: Lists,
}

impl Places {
    fn new(mesh: &Mesh) -> Self {
        let count = mesh.positions().len();
        let faces = Lists::group(count, || {
            (0..)
                .zip(mesh.faces().iter())
                .flat_map(|(face, corners)| corners.iter().map(move |&vertex| (vertex, face)))
        });
        Self { sets: UnionFind::new(count), members: BTreeMap::new(), faces }
    }

    /// Joins the sets of two vertices unless they have corners of one face. Returns true if they are in one set.
    fn join(&mut self, a: u32, b: u32) -> bool {
        let [a, b] = [self.sets.find(a), self.sets.find(b)];
        if a == b {
            return true;
        }
        fn set(root: u32, members: &BTreeMap<u32, Vec<u32>>) -> Vec<u32> {
            members.get(&root).cloned().unwrap_or_else(|| vec![root])
        }
        let (mut all, others) = (set(a, &self.members), set(b, &self.members));
        fn faces(set: &[u32], self_faces: &Lists) -> Vec<u32> {
            let mut faces: Vec<u32> =
                set.iter().flat_map(|&it| self_faces.list(it as usize)).copied().collect();
            faces.sort_unstable();
            faces
        }
        let of_a = faces(&all, &self.faces);
        if faces(&others, &self.faces).iter().any(|face| of_a.binary_search(face).is_ok()) {
            return false;
        }
        all.extend(others);
        self.sets.union(a, b);
        self.members.remove(&a.max(b));
        self.members.insert(a.min(b), all);
        true
    }
}

fn unit(vector: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(1e-9 * vector.amax()).unwrap_or_else(Vector3::zeros)
}
