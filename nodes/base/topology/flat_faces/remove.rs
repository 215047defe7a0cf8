//! Removes faces without area from meshes: the last step of nodes whose computations may leave such faces.

use std::collections::{BTreeMap, BTreeSet};

use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::Point3;

use crate::linear::attribute_transfer::AttributeTransfer;
use crate::linear::stencils::Stencils;
use crate::topology::lists::Lists;

/// Maximum number of rounds. A step may make further ones possible, as where faces without area lie side by side.
const ROUNDS: usize = 16;

/// Removes the triangles of a manifold mesh that have no area, as [`Mesh::flat_faces`] finds them. A short edge is collapsed. Else the
/// vertex between the others is put into the longest edge: the face across that edge is divided there, or, if it has more than three
/// corners, gets one more. No vertex moves by more than 1e-9 of the diagonal.
///
/// Faces for which `may_change` is false stay as they are, and so do triangles for which neither step keeps the mesh manifold. Other faces
/// and vertices keep their order. Attributes of vertices and faces are kept; those of new corners are interpolated along the edge.
///
/// Returns `None` if nothing changes.
///
/// # Errors
/// Does not fail for a valid mesh.
pub fn remove_flat_faces(
    mesh: &Mesh,
    may_change: impl Fn(u32) -> bool,
) -> Result<Option<Mesh>, MeshError> {
    let mut flat: BTreeSet<u32> = mesh.flat_faces().into_iter().collect();
    if flat.is_empty() {
        return Ok(None);
    }
    let mut net = Net::new(mesh, &may_change);
    for _ in 0..ROUNDS {
        let mut touched = BTreeSet::new();
        for &face in &flat {
            net.remove(face, &mut touched);
        }
        if touched.is_empty() {
            break;
        }
        flat.extend(touched);
    }
    if net.faces.is_empty() { Ok(None) } else { net.into_mesh().map(Some) }
}

/// A corner of a changed face.
#[derive(Clone)]
struct Corner {
    vertex: u32,
    /// The corners of the mesh from which the attributes are interpolated, with their weights.
    shares: Vec<(u32, f64)>,
}

struct Net<'a> {
    mesh: &'a Mesh,
    may_change: &'a dyn Fn(u32) -> bool,
    /// The smallest height of a triangle with an area, in mm.
    min_height: f64,
    /// The faces at each vertex of the mesh.
    around: Lists,
    /// The faces that were changed, removed (without corners) or added.
    faces: BTreeMap<u32, Vec<Corner>>,
    /// The faces at each vertex at which they have changed.
    changed_around: BTreeMap<u32, Vec<u32>>,
    /// For each added face, the face of the mesh of which it was a part.
    origins: Vec<u32>,
    /// The vertices that are gone.
    gone: BTreeSet<u32>,
    creases: BTreeMap<[u32; 2], f64>,
}

impl<'a> Net<'a> {
    fn new(mesh: &'a Mesh, may_change: &'a dyn Fn(u32) -> bool) -> Self {
        let faces = mesh.faces();
        let around = Lists::group(mesh.positions().len(), || {
            (0..).zip(faces.iter()).flat_map(|(face, corners): (u32, _)| {
                corners.iter().map(move |&vertex| (vertex, face))
            })
        });
        Self {
            mesh,
            may_change,
            min_height: mesh.flat_height(),
            around,
            faces: BTreeMap::new(),
            changed_around: BTreeMap::new(),
            origins: Vec::new(),
            gone: BTreeSet::new(),
            creases: mesh.creases().collect(),
        }
    }

    /// Removes a triangle without area, if possible. The faces that change are added to `touched`.
    fn remove(&mut self, face: u32, touched: &mut BTreeSet<u32>) {
        let [a, b, c] = match self.vertices(face)[..] {
            [a, b, c] if self.is_changeable(face) => [a, b, c],
            _ => return,
        };
        if self.height([a, b, c]) > self.min_height {
            return;
        }
        let mut edges = [[a, b, c], [b, c, a], [c, a, b]];
        edges.sort_by(|x, y| self.length(x[0], x[1]).total_cmp(&self.length(y[0], y[1])));
        let [shortest, _, longest] = edges;
        let is_short = self.length(shortest[0], shortest[1]) <= self.min_height;
        let [u, v] = [shortest[0], shortest[1]];
        let is_removed = is_short && (self.collapse(u, v, touched) || self.collapse(v, u, touched));
        if !is_removed {
            self.divide_across(face, longest, touched);
        }
    }

    /// Joins the vertex `goes` with the vertex `stays` at the other end of an edge, if the mesh stays manifold.
    fn collapse(&mut self, goes: u32, stays: u32, touched: &mut BTreeSet<u32>) -> bool {
        let around = self.faces_at(goes);
        if !around.iter().all(|&face| self.is_changeable(face)) {
            return false;
        }
        let (own, others): (Vec<u32>, Vec<u32>) =
            around.iter().partition(|&&face| self.vertices(face).contains(&stays));
        // The edge must not be a diagonal of a polygon, and both vertices on a border only if the edge is.
        let is_edge =
            |face: &u32| self.has_side(*face, goes, stays) || self.has_side(*face, stays, goes);
        let is_inner = own.len() == 2;
        if !own.iter().all(is_edge) || is_inner && self.is_border(goes) && self.is_border(stays) {
            return false;
        }
        let thirds: BTreeSet<u32> = own
            .iter()
            .filter(|&&face| self.vertices(face).len() == 3)
            .flat_map(|&face| self.vertices(face))
            .filter(|&vertex| vertex != goes && vertex != stays)
            .collect();
        let [ring, other] = [goes, stays].map(|vertex| self.neighbors(vertex));
        if !ring.intersection(&other).eq(&thirds) {
            return false;
        }
        // Two faces must not get the same corners.
        let mut near: Vec<Vec<u32>> = Vec::new();
        let kept = self.faces_at(stays).into_iter().filter(|face| !own.contains(face));
        for face in others.iter().copied().chain(kept) {
            let mut vertices = self.vertices(face);
            vertices.iter_mut().filter(|it| **it == goes).for_each(|it| *it = stays);
            vertices.sort_unstable();
            near.push(vertices);
        }
        near.sort_unstable();
        if near.windows(2).any(|pair| pair[0] == pair[1]) {
            return false;
        }
        for face in own {
            let mut corners = self.corners(face);
            corners.retain(|corner| corner.vertex != goes);
            self.set(face, if corners.len() < 3 { Vec::new() } else { corners }, touched);
        }
        for face in others {
            let mut corners = self.corners(face);
            corners.iter_mut().filter(|it| it.vertex == goes).for_each(|it| it.vertex = stays);
            self.set(face, corners, touched);
        }
        self.gone.insert(goes);
        for vertex in ring {
            if let Some(sharpness) = self.creases.remove(&sorted(goes, vertex))
                && vertex != stays
            {
                let other = self.creases.entry(sorted(stays, vertex)).or_insert(sharpness);
                *other = other.max(sharpness);
            }
        }
        true
    }

    /// Removes the triangle of a `tip` on the line from `a` to `b`, its longest edge: puts the tip into the face across that edge.
    fn divide_across(&mut self, face: u32, [a, b, tip]: [u32; 3], touched: &mut BTreeSet<u32>) {
        let across = self.faces_at(a).into_iter().find(|&other| self.has_side(other, b, a));
        let Some(across) = across else {
            if !self.is_border(tip) {
                self.set(face, Vec::new(), touched);
            }
            return;
        };
        let vertices = self.vertices(across);
        if !self.is_changeable(across) || vertices.contains(&tip) {
            return;
        }
        let mut corners = self.corners(across);
        let Some(start) = corners.iter().position(|corner| corner.vertex == b) else { return };
        corners.rotate_left(start);
        let fraction = self.length(b, tip) / (self.length(b, tip) + self.length(tip, a));
        let new = Corner { vertex: tip, shares: between(&corners[0], &corners[1], fraction) };
        if let [at_b, at_a, at_d] = &corners[..] {
            let parts = [[b, tip, at_d.vertex], [tip, a, at_d.vertex]];
            let is_joined = self.neighbors(tip).contains(&at_d.vertex);
            if is_joined || parts.iter().any(|&part| self.height(part) <= self.min_height) {
                return;
            }
            let origin = self.origin(across);
            let added = self.face_count() as u32;
            self.origins.push(origin);
            let parts = [[at_b, &new, at_d], [&new, at_a, at_d]].map(|part| part.map(Clone::clone));
            let [first, second] = parts.map(Vec::from);
            self.set(face, Vec::new(), touched);
            self.set(across, first, touched);
            self.set(added, second, touched);
        } else {
            corners.insert(1, new);
            self.set(face, Vec::new(), touched);
            self.set(across, corners, touched);
        }
        if let Some(sharpness) = self.creases.remove(&sorted(a, b)) {
            for end in [a, b] {
                let other = self.creases.entry(sorted(end, tip)).or_insert(sharpness);
                *other = other.max(sharpness);
            }
        }
    }

    /// Replaces the corners of a face. A face without corners is removed.
    fn set(&mut self, face: u32, corners: Vec<Corner>, touched: &mut BTreeSet<u32>) {
        let is_known = self.faces.contains_key(&face) || (face as usize) < self.mesh.faces().len();
        let before = if is_known { self.vertices(face) } else { Vec::new() };
        for vertex in before.iter().copied().chain(corners.iter().map(|corner| corner.vertex)) {
            let mut around = self.faces_at(vertex);
            around.retain(|it| *it != face);
            if corners.iter().any(|corner| corner.vertex == vertex) {
                around.push(face);
            }
            self.changed_around.insert(vertex, around);
        }
        self.faces.insert(face, corners);
        touched.insert(face);
    }

    fn face_count(&self) -> usize {
        self.mesh.faces().len() + self.origins.len()
    }

    /// Returns the face of the mesh of which a face is a part.
    fn origin(&self, face: u32) -> u32 {
        let added = (face as usize).checked_sub(self.mesh.faces().len());
        added.map_or(face, |index| self.origins[index])
    }

    fn is_changeable(&self, face: u32) -> bool {
        (self.may_change)(self.origin(face))
    }

    fn corners(&self, face: u32) -> Vec<Corner> {
        self.faces.get(&face).cloned().unwrap_or_else(|| {
            let first = self.mesh.faces().first_corner(face as usize) as u32;
            let vertices = self.mesh.faces().face(face as usize).iter();
            let numbered = vertices.zip(first..);
            numbered
                .map(|(&vertex, corner)| Corner { vertex, shares: vec![(corner, 1.0)] })
                .collect()
        })
    }

    fn vertices(&self, face: u32) -> Vec<u32> {
        match self.faces.get(&face) {
            Some(corners) => corners.iter().map(|corner| corner.vertex).collect(),
            None => self.mesh.faces().face(face as usize).to_vec(),
        }
    }

    fn faces_at(&self, vertex: u32) -> Vec<u32> {
        let changed = self.changed_around.get(&vertex);
        changed.cloned().unwrap_or_else(|| self.around.list(vertex as usize).to_vec())
    }

    /// Returns true if a face has a side from `a` to `b`.
    fn has_side(&self, face: u32, a: u32, b: u32) -> bool {
        let vertices = self.vertices(face);
        (0..vertices.len()).any(|k| vertices[k] == a && vertices[(k + 1) % vertices.len()] == b)
    }

    /// Returns the neighbors of a vertex at the ends of edges.
    fn neighbors(&self, vertex: u32) -> BTreeSet<u32> {
        let mut neighbors = BTreeSet::new();
        for face in self.faces_at(vertex) {
            let vertices = self.vertices(face);
            let count = vertices.len();
            for k in (0..count).filter(|&k| vertices[k] == vertex) {
                neighbors.extend([vertices[(k + 1) % count], vertices[(k + count - 1) % count]]);
            }
        }
        neighbors
    }

    /// Returns true if an edge at the vertex has only one face.
    fn is_border(&self, vertex: u32) -> bool {
        let around = self.faces_at(vertex);
        let has = |a: u32, b: u32| around.iter().any(|&face| self.has_side(face, a, b));
        self.neighbors(vertex).into_iter().any(|other| !has(vertex, other) || !has(other, vertex))
    }

    fn at(&self, vertex: u32) -> Point3<f64> {
        self.mesh.positions()[vertex as usize]
    }

    fn length(&self, a: u32, b: u32) -> f64 {
        (self.at(b) - self.at(a)).norm()
    }

    /// Returns the height of a triangle over its longest edge, in mm.
    fn height(&self, [a, b, c]: [u32; 3]) -> f64 {
        let longest = self.length(a, b).max(self.length(b, c)).max(self.length(c, a));
        let [a, b, c] = [a, b, c].map(|vertex| self.at(vertex));
        if longest > 0.0 { (b - a).cross(&(c - a)).norm() / longest } else { 0.0 }
    }

    /// Builds the mesh without the removed faces and vertices.
    fn into_mesh(self) -> Result<Mesh, MeshError> {
        let mesh = self.mesh;
        let kept: Vec<u32> = (0..mesh.positions().len() as u32)
            .filter(|vertex| !self.gone.contains(vertex))
            .collect();
        let mut numbers = vec![u32::MAX; mesh.positions().len()];
        (0..).zip(&kept).for_each(|(number, &vertex)| numbers[vertex as usize] = number);
        let (mut sides, mut corners, mut faces) = (Vec::new(), Vec::new(), Vec::new());
        let (mut starts, mut indices, mut weights) = (vec![0], Vec::new(), Vec::new());
        for face in 0..self.face_count() as u32 {
            let own = self.corners(face);
            if own.is_empty() {
                continue;
            }
            sides.push(own.len());
            faces.push(self.origin(face));
            for Corner { vertex, shares } in own {
                corners.push(numbers[vertex as usize]);
                for (corner, weight) in shares {
                    indices.push(corner);
                    weights.push(weight);
                }
                starts.push(indices.len() as u32);
            }
        }
        let positions: Vec<_> = kept.iter().map(|&vertex| self.at(vertex)).collect();
        let creases = self
            .creases
            .iter()
            .map(|(ends, sharpness)| (ends.map(|end| numbers[end as usize]), *sharpness));
        let mut made = Mesh::new(positions, Faces::polygons(&sides, corners)?)?
            .with_creases(creases)?
            .with_materials(mesh.materials().clone())
            .with_frame(mesh.frame().copied());
        for (name, attribute) in mesh.vertex().iter() {
            made = made.with_vertex(name, attribute.select(&kept))?;
        }
        for (name, attribute) in mesh.face().iter() {
            made = made.with_face(name, attribute.select(&faces))?;
        }
        let of_corners = Stencils::from_parts(starts, indices, weights);
        for (name, attribute) in mesh.corner().iter() {
            made = made.with_corner(name, of_corners.attribute(attribute))?;
        }
        Ok(made)
    }
}

fn sorted(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Returns the weights of a corner between two others.
fn between(from: &Corner, to: &Corner, fraction: f64) -> Vec<(u32, f64)> {
    let from = from.shares.iter().map(|(corner, weight)| (*corner, weight * (1.0 - fraction)));
    from.chain(to.shares.iter().map(|(corner, weight)| (*corner, weight * fraction))).collect()
}

#[cfg(test)]
mod tests {
    use maquette_value::Attribute;

    use super::super::insert::{HEIGHTS, insert_flat_faces};
    use super::*;

    /// Returns an octahedron whose faces are divided into `n * n` triangles, on a sphere of 10 mm.
    fn sphere(n: u32) -> Mesh {
        let mut points: Vec<Point3<f64>> = Vec::new();
        let mut faces = Vec::new();
        for octant in 0..8u32 {
            let signs = [0, 1, 2].map(|k| if octant >> k & 1 == 0 { 1.0 } else { -1.0 });
            let mut add = |i: u32, j: u32| {
                let [i, j] = [i, j].map(f64::from);
                let at = [i, j, f64::from(n) - i - j];
                let at = Point3::new(signs[0] * at[0], signs[1] * at[1], signs[2] * at[2]);
                let at = Point3::from(at.coords.normalize() * 10.0);
                let known = points.iter().position(|it| (it - at).norm() < 1e-9);
                known.unwrap_or_else(|| {
                    points.push(at);
                    points.len() - 1
                }) as u32
            };
            for i in 0..n {
                for j in 0..n - i {
                    let mut triangles = vec![[add(i, j), add(i + 1, j), add(i, j + 1)]];
                    if i + j + 2 <= n {
                        triangles.push([add(i + 1, j), add(i + 1, j + 1), add(i, j + 1)]);
                    }
                    let is_mirrored = octant.count_ones() % 2 == 1;
                    faces.extend(
                        triangles.iter().map(
                            |&[a, b, c]| {
                                if is_mirrored { [b, a, c] } else { [a, b, c] }
                            },
                        ),
                    );
                }
            }
        }
        Mesh::new(points, Faces::triangles(faces)).unwrap()
    }

    fn euler_characteristic(mesh: &Mesh) -> i64 {
        let edges = mesh.edges();
        assert!(edges.faces.iter().all(|&faces| faces == 2) && edges.misoriented == 0);
        mesh.positions().len() as i64 - edges.faces.len() as i64 + mesh.faces().len() as i64
    }

    #[test]
    fn all_faces_without_area_are_removed() {
        let plain = sphere(6);
        for height in HEIGHTS.into_iter().filter(|height| *height < 1e-9) {
            for seed in 0..4 {
                let given = insert_flat_faces(&plain, 20, height, seed);
                let of_corners = given.faces().corners().iter().map(|&vertex| {
                    let at = given.positions()[vertex as usize];
                    [at.x, at.y]
                });
                let uv = Attribute::Pair(of_corners.collect());
                let given = given.with_corner("uv", uv).unwrap();
                assert!(given.flat_faces().len() > 4);
                let made = remove_flat_faces(&given, |_| true).unwrap().unwrap();
                assert!(made.flat_faces().is_empty(), "{height} {seed}");
                assert_eq!(euler_characteristic(&made), 2);
                let uv = made.corner().pairs("uv").unwrap();
                for (&vertex, uv) in made.faces().corners().iter().zip(uv.iter()) {
                    let at = made.positions()[vertex as usize];
                    assert!((at.x - uv[0]).abs() + (at.y - uv[1]).abs() < 1e-7, "{at} {uv:?}");
                }
            }
        }
        assert!(remove_flat_faces(&plain, |_| true).unwrap().is_none());
    }

    #[test]
    fn faces_that_must_not_change_stay() {
        let given = insert_flat_faces(&sphere(4), 5, 0.0, 1);
        assert!(remove_flat_faces(&given, |_| false).unwrap().is_none());
    }

    #[test]
    fn a_vertex_on_the_edge_of_a_polygon_becomes_its_corner() {
        let points =
            [[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.], [1., 0., 0.], [1., -1., 0.]];
        let points: Vec<_> = points.into_iter().map(Point3::from).collect();
        let faces = Faces::polygons(&[4, 3, 3, 3], vec![0, 1, 2, 3, 1, 0, 4, 0, 5, 4, 4, 5, 1]);
        let mesh =
            Mesh::new(points, faces.unwrap()).unwrap().with_creases([([0, 1], 2.0)]).unwrap();
        let made = remove_flat_faces(&mesh, |_| true).unwrap().unwrap();
        let faces: Vec<_> = made.faces().iter().map(<[u32]>::to_vec).collect();
        assert_eq!(faces, [vec![0, 4, 1, 2, 3], vec![0, 5, 4], vec![4, 5, 1]]);
        assert_eq!(Vec::from_iter(made.creases()), [([0, 4], 2.0), ([1, 4], 2.0)]);
    }
}
