//! Joins the borders of a mesh edge by edge.

use std::f64::consts::TAU;

use maquette_value::parallel::*;
use maquette_value::rng::mix;
use maquette_value::{Faces, Mesh};
use nalgebra::{Point3, Vector3};

use crate::topology::lists::Lists;

/// The place of a vertex that is not joined with any other.
pub const NO_PLACE: u32 = u32::MAX;

/// The vertices and faces of a mesh after joining.
pub(super) struct Joined {
    /// For each vertex, the lowest vertex of those with which it is joined.
    pub(super) roots: Vec<u32>,
    /// For each face, true if it is left out because it equals another one.
    pub(super) is_equal: Vec<bool>,
}

impl Joined {
    pub(super) fn is_unchanged(&self) -> bool {
        (0..).zip(&self.roots).all(|(vertex, &root)| vertex == root)
            && !self.is_equal.contains(&true)
    }
}

/// Joins vertices with the same place where border edges coincide. If `may_twist` is true, two edges of equal positions that have no other
/// one beside them are joined even if their faces have opposite orientations, and equal faces are left out.
pub(super) fn join(mesh: &Mesh, places: &[u32], may_twist: bool) -> Joined {
    let faces = mesh.faces().iter();
    let mut edges: Vec<HalfEdge> = (0..)
        .zip(faces)
        .flat_map(|(face, corners)| {
            let ends = corners.iter().zip(corners[1..].iter().chain(&corners[..1]));
            ends.map(move |(&from, &to)| HalfEdge { face, from, to })
        })
        .filter(|edge| edge.places(places).is_some())
        .collect();
    edges.par_sort_unstable_by_key(|edge| (edge.places(places), edge.ends(), edge.face, edge.from));
    let is_equal = match may_twist {
        true => equal_faces(mesh, places, &edges),
        false => vec![false; mesh.faces().len()],
    };
    edges.retain(|edge| !is_equal[edge.face as usize]);
    let mut stitcher = Stitcher::new(mesh, &is_equal);
    let mut crowded = Vec::new();
    for same in edges.chunk_by(|a, b| a.places(places) == b.places(places)) {
        let free: Vec<HalfEdge> = same
            .chunk_by(|a, b| a.ends() == b.ends())
            .filter(|of_edge| of_edge.len() == 1)
            .map(|of_edge| of_edge[0])
            .collect();
        match free[..] {
            [] | [_] => {}
            [a, b] if a.is_opposite(b, places) => stitcher.stitch(a, b.turned()),
            [a, b] => {
                if may_twist && stitcher.have_equal_positions(a, b) {
                    stitcher.stitch(a, b);
                }
            }
            _ => crowded.push(free),
        }
    }
    for free in crowded {
        for [a, b] in stitcher.pairs_around(&free, places) {
            stitcher.stitch(a, b.turned());
        }
    }
    let mut roots = stitcher.roots;
    join_loose(mesh, places, &is_equal, &mut roots);
    Joined { roots, is_equal }
}

/// An edge of a face, in the direction of the face.
#[derive(Clone, Copy, Debug, PartialEq)]
struct HalfEdge {
    face: u32,
    from: u32,
    to: u32,
}

impl HalfEdge {
    /// Returns the places of both ends in ascending order; `None` if an end stays or both are the same.
    fn places(self, places: &[u32]) -> Option<[u32; 2]> {
        let [a, b] = [self.from, self.to].map(|vertex| places[vertex as usize]);
        (a != b && a != NO_PLACE && b != NO_PLACE).then_some([a.min(b), a.max(b)])
    }

    /// Returns the vertices of both ends in ascending order.
    fn ends(self) -> [u32; 2] {
        [self.from.min(self.to), self.from.max(self.to)]
    }

    fn is_opposite(self, other: Self, places: &[u32]) -> bool {
        places[self.from as usize] == places[other.to as usize]
    }

    fn turned(self) -> Self {
        Self { from: self.to, to: self.from, ..self }
    }
}

/// Finds faces that equal another one: those with the vertices of an earlier face, and those of which no edge belongs to another face and
/// whose corners are near those of another face, at the same places in the same order.
fn equal_faces(mesh: &Mesh, places: &[u32], edges: &[HalfEdge]) -> Vec<bool> {
    let faces = mesh.faces();
    let mut is_equal = vec![false; faces.len()];
    // The number of edges of each face that belong to no other face.
    let mut free = vec![0; faces.len()];
    for of_edge in edges.chunk_by(|a, b| a.ends() == b.ends()) {
        if let [edge] = of_edge {
            free[edge.face as usize] += 1;
        }
    }
    let mut keys: Vec<(Vec<u32>, bool, u32)> = (0..)
        .zip(faces.iter())
        .filter(|(_, face)| face.iter().all(|&vertex| places[vertex as usize] != NO_PLACE))
        .map(|(face, corners)| {
            let is_alone = free[face as usize] == corners.len();
            (rotate(corners.iter().map(|&vertex| places[vertex as usize])), is_alone, face)
        })
        .collect();
    keys.par_sort_unstable();
    for same in keys.chunk_by(|a, b| a.0 == b.0) {
        let (first, others) = same.split_at(1);
        for (_, _, face) in others.iter().filter(|(_, is_alone, _)| *is_alone) {
            is_equal[*face as usize] = are_close(mesh, places, first[0].2, *face);
        }
    }
    let twins = possible_twins(faces);
    if twins.windows(2).all(|pair| pair[0].0 != pair[1].0) {
        return is_equal;
    }
    let mut edges = mesh.edges();
    let is_closed = edges.faces.iter().all(|&faces| faces != 1);
    for same in twins.chunk_by(|a, b| a.0 == b.0) {
        for (_, face) in &same[1..] {
            let corners =
                faces.first_corner(*face as usize)..faces.first_corner(*face as usize + 1);
            let of_face = &edges.of_corner[corners];
            // A closed mesh stays closed.
            if !is_closed || of_face.iter().all(|&edge| 2 < edges.faces[edge as usize]) {
                of_face.iter().for_each(|&edge| edges.faces[edge as usize] -= 1);
                is_equal[*face as usize] = true;
            }
        }
    }
    is_equal
}

/// Returns all faces that have the same vertices in the same cyclic order as another face, and perhaps some others. Each comes with its
/// vertices, beginning with the lowest one. The list is in ascending order.
fn possible_twins(faces: &Faces) -> Vec<(Vec<u32>, u32)> {
    // A sum of hashes does not depend on the order of the vertices. It is enough for most faces, and needs no list for each.
    fn hash(face: &[u32]) -> u64 {
        face.iter().fold(0, |sum, &vertex| mix(u64::from(vertex)).wrapping_add(sum))
    }
    let numbers = (0..faces.len()).into_par_iter().with_min_len(1024);
    let hashes: Vec<u64> = numbers.map(|face| hash(faces.face(face))).collect();
    let mut sorted = hashes.clone();
    sorted.par_sort_unstable();
    let pairs = sorted.par_windows(2).with_min_len(1024);
    let repeated: Vec<u64> =
        pairs.filter(|pair| pair[0] == pair[1]).map(|pair: &[u64]| pair[0]).collect();
    if repeated.is_empty() {
        return Vec::new();
    }
    let candidates = (0..).zip(faces.iter()).zip(&hashes);
    let mut twins: Vec<(Vec<u32>, u32)> = candidates
        .filter(|(_, hash)| repeated.binary_search(hash).is_ok())
        .map(|((face, corners), _)| (rotate(corners.iter().copied()), face))
        .collect();
    twins.sort_unstable();
    twins
}

/// The maximum distance of corresponding corners of equal faces, as a fraction of the shortest edge.
const EQUAL: f64 = 0.1;

/// Returns true if the corners of two faces at the same places are much nearer to each other than the ends of their edges.
fn are_close(mesh: &Mesh, places: &[u32], a: u32, b: u32) -> bool {
    fn corners(face: u32, mesh: &Mesh, places: &[u32]) -> Vec<Point3<f64>> {
        let mut corners = mesh.faces().face(face as usize).to_vec();
        let lowest = (0..corners.len()).min_by_key(|&k| places[corners[k] as usize]).unwrap_or(0);
        corners.rotate_left(lowest);
        corners.into_iter().map(|vertex| mesh.positions()[vertex as usize]).collect::<Vec<_>>()
    }
    let (a, b) = (corners(a, mesh, places), corners(b, mesh, places));
    let edges = b.iter().zip(b[1..].iter().chain(&b[..1]));
    let shortest = edges.map(|(from, to)| (to - from).norm()).fold(f64::INFINITY, f64::min);
    a.iter().zip(&b).all(|(a, b)| (a - b).norm() <= EQUAL * shortest)
}

/// Returns the numbers in the same cyclic order, beginning with the lowest one.
fn rotate(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut numbers: Vec<u32> = numbers.collect();
    let lowest = (0..numbers.len()).min_by_key(|&k| numbers[k]).unwrap_or(0);
    numbers.rotate_left(lowest);
    numbers
}

/// Joins vertices without faces with the lowest vertex at their place, preferably one that has faces.
fn join_loose(mesh: &Mesh, places: &[u32], is_equal: &[bool], roots: &mut [u32]) {
    let mut has_face = vec![false; roots.len()];
    for (face, _) in mesh.faces().iter().zip(is_equal).filter(|(_, is_equal)| !**is_equal) {
        face.iter().for_each(|&vertex| has_face[vertex as usize] = true);
    }
    let count = places.iter().filter(|&&place| place != NO_PLACE).max().map_or(0, |&it| it + 1);
    let mut leaders = vec![NO_PLACE; count as usize];
    for with_faces in [true, false] {
        for (vertex, &place) in (0..).zip(places).filter(|it| *it.1 != NO_PLACE) {
            let leader = &mut leaders[place as usize];
            if *leader == NO_PLACE && has_face[vertex as usize] == with_faces {
                *leader = vertex;
            }
        }
    }
    for vertex in 0..roots.len() {
        if places[vertex] != NO_PLACE && !has_face[vertex] {
            roots[vertex] = roots[leaders[places[vertex] as usize] as usize];
        }
    }
    // The lowest vertex of a set stands for it, even if it has no faces.
    let mut lowest: Vec<u32> = (0..roots.len() as u32).collect();
    for (vertex, &root) in (0..).zip(&*roots) {
        lowest[root as usize] = lowest[root as usize].min(vertex);
    }
    roots.iter_mut().for_each(|root| *root = lowest[*root as usize]);
}

/// A corner of a face: the vertices before and after it.
#[derive(Clone, Copy, Default)]
struct Sector {
    face: u32,
    before: u32,
    after: u32,
}

/// Joins vertices and checks that the mesh remains a surface.
struct Stitcher<'a> {
    mesh: &'a Mesh,
    sectors: Lists<Sector>,
    roots: Vec<u32>,
    /// For each vertex that is a root, all vertices of its set; empty if it is the only one.
    members: Vec<Vec<u32>>,
}

impl<'a> Stitcher<'a> {
    fn new(mesh: &'a Mesh, is_equal: &[bool]) -> Self {
        let count = mesh.positions().len();
        let sectors = Lists::group(count, || {
            let faces = (0..).zip(mesh.faces().iter());
            faces.filter(|(face, _)| !is_equal[*face as usize]).flat_map(|(face, corners)| {
                let n = corners.len();
                (0..n).map(move |k| {
                    let [before, after] = [corners[(k + n - 1) % n], corners[(k + 1) % n]];
                    (corners[k], Sector { face, before, after })
                })
            })
        });
        Self { mesh, sectors, roots: (0..count as u32).collect(), members: vec![Vec::new(); count] }
    }

    /// Joins the starts and the ends of two edges, unless the surface would no longer be one.
    fn stitch(&mut self, a: HalfEdge, b: HalfEdge) {
        let is_twisted = !self.is_turned(a, b);
        if !self.can_union(a.from, b.from, is_twisted) {
            return;
        }
        let undo = self.union(a.from, b.from);
        if self.can_union(a.to, b.to, is_twisted) {
            self.union(a.to, b.to);
        } else {
            self.split(undo);
        }
    }

    /// Returns true if the faces of two edges, which were brought into the same direction, run along them in opposite directions.
    fn is_turned(&self, a: HalfEdge, b: HalfEdge) -> bool {
        fn runs(edge: HalfEdge, self_sectors: &Lists<Sector>) -> bool {
            let mut sectors = self_sectors.list(edge.from as usize).iter();
            sectors.any(|sector| sector.face == edge.face && sector.after == edge.to)
        }
        runs(a, &self.sectors) != runs(b, &self.sectors)
    }

    fn set(&self, vertex: u32) -> &[u32] {
        let root = self.roots[vertex as usize] as usize;
        match &self.members[root][..] {
            [] => std::slice::from_ref(&self.roots[root]),
            members => members,
        }
    }

    fn sectors_of_set(&self, vertex: u32) -> impl Iterator<Item = Sector> {
        let set = self.set(vertex).iter();
        set.flat_map(|&member| self.sectors.list(member as usize).iter().copied())
    }

    /// Returns true if two sets of vertices have no common face, and no edge would get more than two faces or, unless `is_twisted`, two of
    /// opposite orientation.
    fn can_union(&self, a: u32, b: u32, is_twisted: bool) -> bool {
        if self.roots[a as usize] == self.roots[b as usize] {
            return true;
        }
        let mut faces: Vec<u32> = self.sectors_of_set(a).map(|sector| sector.face).collect();
        faces.sort_unstable();
        if self.sectors_of_set(b).any(|sector| faces.binary_search(&sector.face).is_ok()) {
            return false;
        }
        let spokes = |vertex: u32| {
            let mut spokes: Vec<(u32, bool)> = self
                .sectors_of_set(vertex)
                .flat_map(|Sector { before, after, .. }| [(before, false), (after, true)])
                .map(|(vertex, leaves)| (self.roots[vertex as usize], leaves))
                .collect();
            spokes.sort_unstable();
            spokes
        };
        let (of_a, of_b) = (spokes(a), spokes(b));
        of_b.chunk_by(|a, b| a.0 == b.0).all(|of_b| {
            let from = of_a.partition_point(|spoke| spoke.0 < of_b[0].0);
            let of_a = &of_a[from..];
            let of_a = &of_a[..of_a.partition_point(|spoke| spoke.0 == of_b[0].0)];
            match (of_a, of_b) {
                ([], _) => true,
                ([a], [b]) => is_twisted || a.1 != b.1,
                _ => false,
            }
        })
    }

    /// Joins two sets. Returns the root that is no longer one, and the number of members of the other set before.
    fn union(&mut self, a: u32, b: u32) -> Option<(u32, usize)> {
        let [a, b] = [a, b].map(|vertex| self.roots[vertex as usize]);
        if a == b {
            return None;
        }
        let (low, high) = (a.min(b), a.max(b));
        let moved = self.set(high).to_vec();
        let mut all = self.set(low).to_vec();
        let before = all.len();
        moved.iter().for_each(|&vertex| self.roots[vertex as usize] = low);
        all.extend(&moved);
        self.members[low as usize] = all;
        self.members[high as usize] = moved;
        Some((high, before))
    }

    fn split(&mut self, undo: Option<(u32, usize)>) {
        let Some((high, before)) = undo else { return };
        let low = self.roots[high as usize] as usize;
        self.members[low].truncate(before);
        for k in 0..self.members[high as usize].len() {
            let vertex = self.members[high as usize][k];
            self.roots[vertex as usize] = high;
        }
    }

    fn have_equal_positions(&self, a: HalfEdge, b: HalfEdge) -> bool {
        fn position(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        position(a.from, self.mesh) == position(b.from, self.mesh)
            && position(a.to, self.mesh) == position(b.to, self.mesh)
    }

    /// Pairs edges in opposite directions at one place. Of several choices, the two faces that enclose the smallest angle of the inside
    /// are paired. Faces that coincide do not enclose anything.
    fn pairs_around(&self, free: &[HalfEdge], places: &[u32]) -> Vec<[HalfEdge; 2]> {
        fn place(vertex: u32, places: &[u32]) -> u32 {
            places[vertex as usize]
        }
        let (there, back): (Vec<HalfEdge>, Vec<HalfEdge>) =
            free.iter().partition(|edge| place(edge.from, places) < place(edge.to, places));
        let Some(first) = there.first() else { return Vec::new() };
        fn position(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        let axis = position(first.to, self.mesh) - position(first.from, self.mesh);
        let Some(axis) = axis.try_normalize(0.0) else { return Vec::new() };
        let side = |edge: HalfEdge| -> Vector3<f64> {
            let face = self.mesh.faces().face(edge.face as usize);
            // The direction into the face is across the edge, in the plane of the face.
            self.mesh
                .area_vector(face)
                .cross(&(position(edge.to, self.mesh) - position(edge.from, self.mesh)))
        };
        let x = side(*first);
        let y = axis.cross(&x);
        let angle = |edge: HalfEdge| {
            let side = side(edge);
            libm::atan2(side.dot(&y), side.dot(&x))
        };
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (i, a) in there.iter().enumerate() {
            for (j, b) in back.iter().enumerate() {
                let enclosed = (angle(*a) - angle(*b)).rem_euclid(TAU);
                pairs.push((if enclosed < 1e-9 { TAU } else { enclosed }, i, j));
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let (mut is_used_there, mut is_used_back) =
            (vec![false; there.len()], vec![false; back.len()]);
        let mut chosen = Vec::new();
        for (_, i, j) in pairs {
            if !is_used_there[i] && !is_used_back[j] {
                (is_used_there[i], is_used_back[j]) = (true, true);
                chosen.push([there[i], back[j]]);
            }
        }
        chosen
    }
}
