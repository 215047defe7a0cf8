//! Faces without area, which have neither a normal nor angles: how computations on a mesh do without them.
//!
//! A face without area joins three vertices on a line. So its middle vertex is on the edge between the other two: a hanging node, as in
//! finite elements on locally refined grids. [`FlatFaces`] replaces the value at such a vertex by the mean of the values at the ends of
//! that edge, weighted by distance, which is exact for values that are linear on each face. Therefore a computation gives the same result
//! as on the mesh without the face and the vertex. The limits are where cotangents exceed 1000 and would cancel each other badly.

#[cfg(test)]
mod insert;
mod remove;

use std::collections::BTreeMap;

use maquette_value::parallel::*;
use maquette_value::{Edges, Mesh};
use nalgebra::{Point3, Vector3};
pub use remove::remove_flat_faces;

/// A triangle is a cap, whose middle vertex depends on its longest edge, if the cotangent of its largest angle is below the negative of
/// this number: if the angle is less than 0.06 degrees from a straight one.
const MAX_COTANGENT: f64 = 1e3;

/// Two vertices are one if their distance is below this fraction of the other edges of all triangles at the edge between them.
const SHORT: f64 = 1e-4;

/// Maximum number of vertices on which a vertex depends. A vertex that would depend on more stays independent.
const MAX_SUPPORTS: usize = 8;

/// A vertex on which another one depends, with its weight. The weights of all supports of a vertex add up to 1.
pub type Support = (u32, f64);

/// The triangles without area of a mesh, and the vertices that depend on other vertices because of them.
#[derive(Clone, Debug, Default)]
pub struct FlatFaces {
    is_flat: Vec<bool>,
    /// The supports of each dependent vertex. Supports are independent.
    supports: BTreeMap<u32, Vec<Support>>,
    /// For each support, the vertices that depend on it. Vertices that no longer do may be among them.
    users: BTreeMap<u32, Vec<u32>>,
}

impl FlatFaces {
    /// Finds the triangles without area. A vertex `v` becomes dependent on vertices `others` only if `may_depend(v, others)`.
    pub fn new(
        points: &[Point3<f64>],
        triangles: &[[u32; 3]],
        may_depend: impl Fn(u32, &[u32]) -> bool,
    ) -> Self {
        let flat: Vec<(u32, Flat)> = triangles
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .filter_map(|(face, triangle)| {
                Some((face as u32, Flat::of(triangle.map(|vertex| points[vertex as usize]))?))
            })
            .collect();
        if flat.is_empty() {
            return Self::default();
        }
        let mut found = Self { is_flat: vec![false; triangles.len()], ..Self::default() };
        for [a, b] in found.mark_needles(&flat, triangles) {
            let (low, high) = (a.min(b), a.max(b));
            if may_depend(high, &[low]) {
                found.add_dependency(high, &[(low, 1.0)]);
            } else if may_depend(low, &[high]) {
                found.add_dependency(low, &[(high, 1.0)]);
            }
        }
        let mut caps = Vec::new();
        for &(face, flat) in &flat {
            if let Flat::Cap { middle, fraction, square } = flat {
                found.is_flat[face as usize] = true;
                caps.push((square, face, middle, fraction));
            }
        }
        // The longest first: where caps lie on each other, their vertices then depend on the ends of the longest edge.
        caps.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, face, middle, fraction) in caps {
            let [own, a, b] = [0, 1, 2].map(|step| triangles[face as usize][(middle + step) % 3]);
            if may_depend(own, &[a, b]) {
                found.add_dependency(own, &[(a, 1.0 - fraction), (b, fraction)]);
            }
        }
        found
    }

    /// Marks the needles at edges that are short for all triangles beside them, and returns these edges.
    fn mark_needles(&mut self, flat: &[(u32, Flat)], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
        let mut needles: Vec<(u32, [u32; 2])> = Vec::new();
        for &(face, flat) in flat {
            let tips = match flat {
                Flat::Point => 0..3,
                Flat::Needle { tip } => tip..tip + 1,
                Flat::Cap { .. } => 0..0,
            };
            needles.extend(tips.map(|tip| (face, opposite(triangles[face as usize], tip))));
        }
        // For each short edge, the number of its triangles that are not needles with this edge.
        let mut others: BTreeMap<[u32; 2], i64> = BTreeMap::new();
        needles.iter().for_each(|(_, edge)| *others.entry(*edge).or_insert(0) -= 1);
        let Some(last) = others.keys().map(|edge| edge[1]).max() else { return Vec::new() };
        let mut is_end = vec![false; last as usize + 1];
        others.keys().flatten().for_each(|&end| is_end[end as usize] = true);
        for &triangle in triangles {
            for edge in [0, 1, 2].map(|tip| opposite(triangle, tip)) {
                if edge[1] <= last && edge.iter().all(|&end| is_end[end as usize]) {
                    others.entry(edge).and_modify(|count| *count += 1);
                }
            }
        }
        for (face, edge) in needles {
            self.is_flat[face as usize] |= others[&edge] == 0;
        }
        others.into_iter().filter(|(_, count)| *count == 0).map(|(edge, _)| edge).collect()
    }

    /// Makes a vertex dependent on `parents`, and replaces dependent parents by their supports.
    fn add_dependency(&mut self, vertex: u32, parents: &[Support]) {
        if self.supports.contains_key(&vertex) {
            return;
        }
        let mut supports = self.substitute(parents);
        // The parents may depend on the vertex. Solve the equation for it.
        let own: f64 = supports.iter().filter(|it| it.0 == vertex).map(|it| it.1).sum();
        supports.retain(|it| it.0 != vertex);
        if own > 0.999 || supports.is_empty() || supports.len() > MAX_SUPPORTS {
            return;
        }
        supports.iter_mut().for_each(|it| it.1 /= 1.0 - own);
        supports.iter().for_each(|it| self.users.entry(it.0).or_default().push(vertex));
        self.supports.insert(vertex, supports);
        for user in self.users.remove(&vertex).unwrap_or_default() {
            let Some(old) = self.supports.get(&user) else { continue };
            let new = self.substitute(old);
            new.iter().for_each(|it| self.users.entry(it.0).or_default().push(user));
            self.supports.insert(user, new);
        }
    }

    /// Replaces dependent vertices by their supports, and merges equal vertices.
    fn substitute(&self, parents: &[Support]) -> Vec<Support> {
        let mut merged: Vec<Support> = Vec::new();
        for &(parent, weight) in parents {
            let own = [(parent, 1.0)];
            for &(support, fraction) in self.supports.get(&parent).map_or(&own[..], Vec::as_slice) {
                match merged.iter_mut().find(|it| it.0 == support) {
                    Some(known) => known.1 += weight * fraction,
                    None => merged.push((support, weight * fraction)),
                }
            }
        }
        merged
    }

    /// Returns true if no triangle is flat.
    pub fn is_empty(&self) -> bool {
        self.is_flat.is_empty()
    }

    /// Returns true if a triangle has no area that a computation could use.
    #[inline]
    pub fn is_flat(&self, triangle: usize) -> bool {
        !self.is_flat.is_empty() && self.is_flat[triangle]
    }

    /// The dependent vertices with their supports, by the index of the vertex.
    pub fn dependent(&self) -> impl Iterator<Item = (u32, &[Support])> {
        self.supports.iter().map(|(vertex, supports)| (*vertex, &supports[..]))
    }

    /// The supports of a vertex; `None` if it is independent.
    pub fn supports(&self, vertex: u32) -> Option<&[Support]> {
        self.supports.get(&vertex).map(Vec::as_slice)
    }

    /// Returns the support with the largest weight, or the vertex itself if it is independent.
    pub fn main_support(&self, vertex: u32) -> u32 {
        let Some(supports) = self.supports(vertex) else { return vertex };
        supports
            .iter()
            .copied()
            .reduce(|a, b| if a.1 < b.1 { b } else { a })
            .map_or(vertex, |it| it.0)
    }

    /// Calls `add` for the supports of a vertex, or for the vertex itself with the weight 1 if it is independent.
    pub fn for_each_support(&self, vertex: u32, mut add: impl FnMut(u32, f64)) {
        match self.supports(vertex) {
            Some(supports) => supports.iter().for_each(|&(support, weight)| add(support, weight)),
            None => add(vertex, 1.0),
        }
    }

    /// Calls `add` for edges between independent vertices with weights that give the same energy `weight (x - y)^2` as the given edge.
    pub fn for_each_edge(&self, ends: [u32; 2], weight: f64, mut add: impl FnMut([u32; 2], f64)) {
        if ends.iter().all(|end| !self.supports.contains_key(end)) {
            return add(ends, weight);
        }
        let mut terms = self.substitute(&[(ends[0], 1.0), (ends[1], -1.0)]);
        terms.sort_by_key(|it| it.0);
        for (k, &(a, of_a)) in terms.iter().enumerate() {
            for &(b, of_b) in &terms[k + 1..] {
                add([a, b], -weight * of_a * of_b);
            }
        }
    }

    /// Adds the value of each dependent vertex to those of its supports, by weight, and sets it to zero: for values that are sums over the
    /// surroundings of a vertex, such as areas.
    pub fn gather<T>(&self, values: &mut [T])
    where
        T: Copy + Default + std::ops::AddAssign + std::ops::Mul<f64, Output = T>,
    {
        for (vertex, supports) in &self.supports {
            let value = std::mem::take(&mut values[*vertex as usize]);
            for &(support, weight) in supports {
                values[support as usize] += value * weight;
            }
        }
    }
}

/// Returns the edge opposite of a corner, the lower vertex first.
fn opposite(triangle: [u32; 3], corner: usize) -> [u32; 2] {
    let [a, b] = [triangle[(corner + 1) % 3], triangle[(corner + 2) % 3]];
    [a.min(b), a.max(b)]
}

/// The kinds of triangles without area.
#[derive(Clone, Copy, Debug)]
enum Flat {
    /// The corner `middle` is between the other two. From the next corner on, it is at this fraction of the longest edge. `square` is the
    /// squared length of that edge.
    Cap { middle: usize, fraction: f64, square: f64 },
    /// The edge opposite of the corner `tip` has almost no length.
    Needle { tip: usize },
    /// All corners are in one place.
    Point,
}

impl Flat {
    /// Returns the kind of a triangle; `None` if it has an area.
    fn of(points: [Point3<f64>; 3]) -> Option<Self> {
        let edges = [0, 1, 2].map(|k| points[(k + 2) % 3] - points[(k + 1) % 3]);
        let squares = edges.map(|edge| edge.norm_squared());
        let double_area = edges[0].cross(&edges[1]).norm();
        let longest = squares[0].max(squares[1]).max(squares[2]);
        // No cotangent is larger than the squared longest edge divided by the double area.
        if longest <= MAX_COTANGENT * double_area && 0.0 < double_area || !longest.is_finite() {
            return None;
        }
        if longest == 0.0 {
            return Some(Self::Point);
        }
        let tip = (0..3).fold(0, |tip, k| if squares[k] < squares[tip] { k } else { tip });
        let others = squares[(tip + 1) % 3].min(squares[(tip + 2) % 3]);
        if squares[tip] <= SHORT * SHORT * others {
            return Some(Self::Needle { tip });
        }
        let middle = (0..3).fold(0, |top, k| if squares[k] > squares[top] { k } else { top });
        let cosine = -edges[(middle + 1) % 3].dot(&edges[(middle + 2) % 3]);
        (cosine < -MAX_COTANGENT * double_area).then(|| {
            let from_next = points[middle] - points[(middle + 1) % 3];
            let fraction = (from_next.dot(&edges[middle]) / squares[middle]).clamp(0.0, 1.0);
            Self::Cap { middle, fraction, square: squares[middle] }
        })
    }
}

/// Returns the unit normals of the faces of a mesh. A face without area has the normal of the face across its longest edge; if that one has
/// no area, either, or does not exist, of another neighbor. The normal is zero if no face around has an area.
///
/// The angle between two faces is then found at one of the edges of a face without area between them.
pub fn unit_normals(mesh: &Mesh, edges: &Edges) -> Vec<Vector3<f64>> {
    let (faces, points) = (mesh.faces(), mesh.positions());
    let mut normals: Vec<Vector3<f64>> = (0..faces.len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|face: usize| {
            mesh.area_vector(faces.face(face)).try_normalize(0.0).unwrap_or_default()
        })
        .collect();
    let flat = flat_faces(mesh);
    flat.iter().for_each(|&face| normals[face as usize] = Vector3::zeros());
    if flat.is_empty() {
        return normals;
    }
    // The faces at the edges of flat faces.
    let mut at_edges: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &face in &flat {
        corners_of(mesh, face).for_each(|corner| {
            at_edges.entry(edges.of_corner[corner]).or_default();
        });
    }
    for face in 0..faces.len() as u32 {
        for corner in corners_of(mesh, face) {
            if let Some(list) = at_edges.get_mut(&edges.of_corner[corner]) {
                list.push(face);
            }
        }
    }
    // The neighbors of each flat face, in descending order of the length of the common edge.
    let mut open = Vec::new();
    for face in flat {
        let mut sides: Vec<(f64, u32)> = corners_of(mesh, face)
            .map(|corner| edges.of_corner[corner])
            .map(|edge| {
                let [a, b] = edges.vertices[edge as usize].map(|vertex| points[vertex as usize]);
                ((b - a).norm_squared(), edge)
            })
            .collect();
        sides.sort_by(|a, b| b.0.total_cmp(&a.0));
        let neighbors = sides.iter().flat_map(|(_, edge)| &at_edges[edge]).copied();
        open.push((face, neighbors.filter(|&other| other != face).collect::<Vec<_>>()));
    }
    // First only across the longest edges, then across any.
    for reach in [1, usize::MAX] {
        loop {
            let known = open.iter().enumerate().filter_map(|(index, (_, neighbors))| {
                let near = neighbors.iter().take(reach);
                let normal =
                    near.map(|&other| normals[other as usize]).find(|it| *it != Vector3::zeros());
                Some((index, normal?))
            });
            let known = Vec::from_iter(known);
            if known.is_empty() {
                break;
            }
            for (index, normal) in known {
                normals[open[index].0 as usize] = normal;
            }
            open.retain(|(face, _)| normals[*face as usize] == Vector3::zeros());
        }
    }
    normals
}

/// Maximum area of a polygon without area, as a fraction of its squared longest side.
const MIN_POLYGON_AREA: f64 = 1e-9;

/// Returns the faces of a mesh that have no area that a computation could use.
fn flat_faces(mesh: &Mesh) -> Vec<u32> {
    let (faces, points) = (mesh.faces(), mesh.positions());
    if let Some(triangles) = faces.as_triangles() {
        let flat = FlatFaces::new(points, triangles, |_, _| false);
        return (0..triangles.len())
            .filter(|&face| flat.is_flat(face))
            .map(|face| face as u32)
            .collect();
    }
    (0..faces.len())
        .into_par_iter()
        .with_min_len(1024)
        .filter_map(|index: usize| {
            let face = faces.face(index);
            let sides = face.iter().zip(face[1..].iter().chain(&face[..1]));
            let squares =
                sides.map(|(&a, &b)| (points[b as usize] - points[a as usize]).norm_squared());
            let longest = squares.fold(0.0, f64::max);
            let is_flat = match *face {
                [a, b, c] => matches!(
                    Flat::of([a, b, c].map(|vertex| points[vertex as usize])),
                    Some(Flat::Cap { .. } | Flat::Point)
                ),
                _ => mesh.area_vector(face).norm() <= MIN_POLYGON_AREA * longest,
            };
            is_flat.then_some(index as u32)
        })
        .collect()
}

fn corners_of(mesh: &Mesh, face: u32) -> std::ops::Range<usize> {
    let face = face as usize;
    mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1)
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;

    use super::*;

    fn flat(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> FlatFaces {
        let points: Vec<_> = points.iter().map(|&point| Point3::from(point)).collect();
        FlatFaces::new(&points, triangles, |_, _| true)
    }

    #[test]
    fn triangles_with_an_area_are_not_flat() {
        let points = [[0., 0., 0.], [1., 0., 0.], [0.5, 0.01, 0.], [0.5, 1.0, 0.]];
        assert!(flat(&points, &[[0, 1, 2], [0, 2, 3]]).is_empty());
        assert!(flat(&[], &[]).is_empty());
    }

    #[test]
    fn a_vertex_in_an_edge_depends_on_its_ends() {
        for height in [0.0, 1e-16, 1e-9, 1e-4] {
            let points =
                [[0., 0., 0.], [1., 0., 0.], [0.25, height, 0.], [0., 1., 0.], [0., -1., 0.]];
            let flat = flat(&points, &[[0, 1, 3], [1, 0, 2], [0, 4, 2], [4, 1, 2]]);
            assert_eq!([0, 1, 2, 3].map(|face| flat.is_flat(face)), [false, true, false, false]);
            let supports = Vec::from_iter(flat.dependent());
            assert!(supports.len() == 1 && supports[0].0 == 2, "{supports:?}");
            for (vertex, weight) in [(0, 0.75), (1, 0.25)] {
                let found = supports[0].1.iter().find(|it| it.0 == vertex).unwrap();
                assert!((found.1 - weight).abs() < 1e-12);
            }
            assert_eq!(flat.main_support(2), 0);
        }
    }

    #[test]
    fn two_vertices_in_one_place_are_one() {
        let points =
            [[0., 0., 0.], [0., 0., 0.], [1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.]];
        let fan = [[0, 1, 2], [1, 0, 3], [0, 2, 4], [0, 4, 3], [1, 3, 5], [1, 5, 2]];
        let flat = flat(&points, &fan);
        assert_eq!((0..6).filter(|&face| flat.is_flat(face)).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(flat.supports(1), Some(&[(0, 1.0)][..]));
        assert_eq!(flat.supports(0), None);
        let mut areas = vec![1.0; 6];
        flat.gather(&mut areas);
        assert_eq!(areas, [2.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
        let mut edges = Vec::new();
        flat.for_each_edge([0, 1], 5.0, |ends, weight| edges.push((ends, weight)));
        flat.for_each_edge([1, 5], 5.0, |ends, weight| edges.push((ends, weight)));
        assert_eq!(edges, [([0, 5], 5.0)]);
    }

    #[test]
    fn vertices_of_one_line_depend_on_its_ends() {
        let points = [[0., 0., 0.], [4., 0., 0.], [1., 0., 0.], [2., 0., 0.], [3., 0., 0.]];
        for fan in [[[0, 3, 2], [0, 4, 3], [0, 1, 4]], [[0, 1, 3], [0, 3, 2], [3, 1, 4]]] {
            let flat = flat(&points, &fan);
            for (vertex, fraction) in [(2, 0.25), (3, 0.5), (4, 0.75)] {
                let supports = flat.supports(vertex).unwrap();
                assert_eq!(supports.len(), 2);
                let to_end: f64 = supports.iter().filter(|it| it.0 == 1).map(|it| it.1).sum();
                assert!((to_end - fraction).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn vertices_that_depend_on_each_other_are_solved_for() {
        // Vertex 1 is between 0 and 2, and vertex 2 is between 1 and 3.
        let points = [[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [3., 0., 0.]];
        let flat = flat(&points, &[[0, 1, 2], [1, 2, 3]]);
        fn of(vertex: u32, flat: &FlatFaces) -> f64 {
            flat.supports(vertex).unwrap().iter().map(|it| f64::from(it.0) * it.1).sum::<f64>()
        }
        assert!((of(1, &flat) - 1.0).abs() < 1e-12 && (of(2, &flat) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_face_without_area_has_the_normal_across_its_longest_edge() {
        // The first face is horizontal, the others are vertical. A face without area is between them.
        let points = [[0., 0., 0.], [1., 0., 0.], [0.5, 0., 0.], [0., 1., 0.], [0.5, 0., -1.]];
        let points = points.map(Point3::from).to_vec();
        let triangles = vec![[0, 1, 3], [1, 0, 2], [0, 4, 2], [4, 1, 2]];
        let mesh = Mesh::new(points.clone(), Faces::triangles(triangles)).unwrap();
        let normals = unit_normals(&mesh, &mesh.edges());
        assert_eq!(normals.iter().map(|it| it.z).collect::<Vec<_>>(), [1.0, 1.0, 0.0, 0.0]);
        // Of two such faces on each other, each has the normal of a neighbor.
        let triangles = vec![[0, 1, 2], [1, 0, 2], [0, 2, 3]];
        let mesh = Mesh::new(points, Faces::triangles(triangles)).unwrap();
        assert!(unit_normals(&mesh, &mesh.edges()).iter().all(|it| it.z == 1.0));
    }
}
