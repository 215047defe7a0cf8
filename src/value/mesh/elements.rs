//! The elements of a mesh: its connected parts, or the borders of its holes.

use std::collections::HashSet;

use nalgebra::Point3;

use super::{Crease, DerivedData, Faces, Mesh};
use crate::parallel::*;
use crate::union_find::UnionFind;
use crate::{AnyValue, Curve, Elements, NoElements, value_type};

/// The two ways to split a mesh, `Parts("mesh")` and `Holes("mesh")`.
pub(super) fn elements() -> Vec<Elements<Mesh>> {
    let (mesh, curve) = (value_type::<Mesh>(), value_type::<Curve>());
    vec![
        Elements {
            word: "Parts",
            name: "parts",
            kind: mesh,
            cut: |it, max_count, _| parts(it, max_count),
        },
        Elements {
            word: "Holes",
            name: "holes",
            kind: curve,
            cut: |it, max_count, _| holes(it, max_count),
        },
    ]
}

/// Splits the mesh into parts. The faces of a part are connected by vertices. Parts are in the order of their first faces. A vertex without
/// a face belongs to no part.
fn parts(mesh: &Mesh, max_count: usize) -> Result<Vec<AnyValue>, NoElements> {
    let (of_faces, count) = part_of_faces(mesh);
    if max_count < count {
        return Err(NoElements::TooMany { count });
    }
    let mut faces: Vec<Vec<u32>> = vec![Vec::new(); count];
    for (face, &part) in (0..).zip(&of_faces) {
        faces[part as usize].push(face);
    }
    let mut creases: Vec<Vec<Crease>> = vec![Vec::new(); count];
    let mut of_vertices = vec![u32::MAX; mesh.positions.len()];
    for (face, &part) in mesh.faces.iter().zip(&of_faces) {
        face.iter().for_each(|&vertex| of_vertices[vertex as usize] = part);
    }
    for crease in mesh.creases.iter() {
        let [a, b] = crease.vertices.map(|vertex| of_vertices[vertex as usize]);
        if a == b && a != u32::MAX {
            creases[a as usize].push(*crease);
        }
    }
    let mut new_indices = vec![0; mesh.positions.len()];
    Ok(faces
        .into_iter()
        .zip(creases)
        .map(|(faces, creases): (Vec<u32>, Vec<Crease>)| {
            AnyValue::new(part(mesh, &faces, creases, &mut new_indices))
        })
        .collect())
}

/// The index of the part that contains each face, and the number of parts.
fn part_of_faces(mesh: &Mesh) -> (Vec<u32>, usize) {
    let mut sets = UnionFind::new(mesh.positions.len());
    for face in mesh.faces.iter() {
        face[1..].iter().for_each(|&vertex| sets.union(face[0], vertex));
    }
    let mut numbers = vec![u32::MAX; mesh.positions.len()];
    let mut count = 0;
    let parts: Vec<_> = mesh
        .faces
        .iter()
        .map(|face| {
            let number = &mut numbers[sets.find(face[0]) as usize];
            if *number == u32::MAX {
                *number = count;
                count += 1;
            }
            *number
        })
        .collect();
    (parts, count as usize)
}

/// The mesh of some faces, with their attributes. `new_indices` is a reusable buffer with an entry per vertex of the whole mesh.
fn part(mesh: &Mesh, faces: &[u32], mut creases: Vec<Crease>, new_indices: &mut [u32]) -> Mesh {
    let all = &mesh.faces;
    let mut vertices =
        faces.iter().flat_map(|&face| all.face(face as usize)).copied().collect::<Vec<_>>();
    let mut corners = vertices.clone();
    vertices.par_sort_unstable();
    vertices.dedup();
    for (new_index, &vertex) in (0..).zip(&vertices) {
        new_indices[vertex as usize] = new_index;
    }
    corners.iter_mut().for_each(|corner| *corner = new_indices[*corner as usize]);
    for crease in &mut creases {
        crease.vertices = crease.vertices.map(|vertex| new_indices[vertex as usize]);
    }
    let sides = faces.iter().map(|&face| all.face(face as usize).len());
    let of_corners = faces.iter().until_stopped().flat_map(|&face| {
        let first = all.first_corner(face as usize) as u32;
        first..first + all.face(face as usize).len() as u32
    });
    let positions = vertices.iter().until_stopped();
    let positions = positions.map(|&vertex| mesh.positions[vertex as usize]);
    Mesh {
        positions: positions.collect(),
        faces: Faces::polygons(&Vec::from_iter(sides), corners).expect("faces of a mesh"),
        vertex: mesh.vertex.select(&vertices),
        corner: mesh.corner.select(&Vec::from_iter(of_corners)),
        face: mesh.face.select(faces),
        creases: creases.into(),
        materials: mesh.materials.clone(),
        frame: mesh.frame,
        derived: DerivedData::default(),
    }
}

impl Mesh {
    /// The mesh of some faces, in this order, with their attributes. Vertices that these faces do not use are left out.
    ///
    /// # Panics
    /// If a face does not exist.
    #[must_use]
    pub fn select(&self, faces: &[u32]) -> Self {
        let mut edges = HashSet::new();
        if !self.creases.is_empty() {
            for &face in faces {
                let face = self.faces.face(face as usize);
                let next = face[1..].iter().chain(&face[..1]);
                edges.extend(face.iter().zip(next).map(|(&a, &b)| [a.min(b), a.max(b)]));
            }
        }
        let creases = self
            .creases
            .iter()
            .filter(|crease| {
                let [a, b] = crease.vertices;
                edges.contains(&[a.min(b), a.max(b)])
            })
            .copied()
            .collect();
        part(self, faces, creases, &mut vec![0; self.positions.len()])
    }
}

/// The borders of the mesh's holes as closed curves. The faces are on the left side of each curve. The curves are in the order of their
/// first edges, face by face. Where two borders share a vertex, each is a separate curve.
fn holes(mesh: &Mesh, max_count: usize) -> Result<Vec<AnyValue>, NoElements> {
    let rims = rims(mesh);
    if max_count < rims.len() {
        return Err(NoElements::TooMany { count: rims.len() });
    }
    rims.into_iter()
        .map(|rim: Vec<u32>| {
            let points = rim.iter().map(|&vertex| mesh.positions[vertex as usize]);
            let points: Vec<Point3<f64>> = points.collect();
            let curve = Curve::polyline(points, true);
            curve.map(AnyValue::new).map_err(|why| NoElements::Impossible(why.to_string()))
        })
        .collect()
}

/// The closed loops of edges that belong to only one face, as lists of vertices.
fn rims(mesh: &Mesh) -> Vec<Vec<u32>> {
    let all: Vec<_> = mesh
        .faces
        .iter()
        .flat_map(|face| -> Vec<[u32; 2]> {
            let next = face[1..].iter().chain(&face[..1]);
            face.iter().zip(next).map(|(&a, &b)| [a, b]).collect()
        })
        .collect();
    let mut order = Vec::from_iter(0..all.len());
    fn sorted_ends(edge: usize, all: &[[u32; 2]]) -> [u32; 2] {
        [all[edge][0].min(all[edge][1]), all[edge][0].max(all[edge][1])]
    }
    order.par_sort_unstable_by_key(|&edge| (sorted_ends(edge, &all), edge));
    let of_one_face = order.chunk_by(|&a, &b| sorted_ends(a, &all) == sorted_ends(b, &all));
    let open = of_one_face.filter(|same| same.len() == 1).map(|same| same[0]);
    let mut open = Vec::from_iter(open);
    open.sort_unstable();
    // The edges are sorted by their first vertex, so that the edge that continues a path can be found.
    let mut from = open.clone();
    from.sort_by_key(|&edge| (all[edge][0], edge));
    let mut is_taken = vec![false; all.len()];
    let mut rims = Vec::new();
    for &start in &open {
        let mut path: Vec<u32> = Vec::new();
        let mut next = Some(start).filter(|&start| !is_taken[start]);
        while let Some(edge) = next {
            is_taken[edge] = true;
            let [a, b] = all[edge];
            path.push(a);
            if let Some(met) = path.iter().position(|&vertex| vertex == b) {
                let rim = path.split_off(met);
                if rim.len() > 2 {
                    rims.push(rim);
                }
                if path.is_empty() {
                    break;
                }
            }
            let first = from.partition_point(|&edge| all[edge][0] < b);
            let there = from[first..].iter().copied().take_while(|&edge| all[edge][0] == b);
            next = there.into_iter().find(|&edge| !is_taken[edge]);
        }
    }
    rims
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Attribute, Value, hash_of};

    fn mesh(faces: &[[u32; 3]]) -> Mesh {
        let count = faces.iter().flatten().max().map_or(0, |max_count| max_count + 1);
        Mesh::new(
            (0..count)
                .map(|k: u32| Point3::new(f64::from(k), f64::from(k * k), 0.0))
                .collect::<Vec<_>>(),
            Faces::triangles(faces.to_vec()),
        )
        .unwrap()
    }

    #[test]
    fn a_part_keeps_its_attributes_and_creases() {
        let whole = mesh(&[[3, 4, 5], [0, 1, 2], [5, 4, 6]])
            .with_vertex("weight", Attribute::Number((0..7).map(f64::from).collect()))
            .unwrap()
            .with_corner("uv", Attribute::Pair((0..9).map(|k| [f64::from(k), 0.0]).collect()))
            .unwrap()
            .with_face("region", Attribute::Index(vec![7, 8, 9].into()))
            .unwrap()
            .with_creases([([4, 5], 2.0), ([0, 5], 1.0)])
            .unwrap();
        let parts = parts(&whole, 2).unwrap();
        let [first, second] = [0, 1].map(|k| parts[k].get::<Mesh>().unwrap());
        assert_eq!(first.faces().corners()[..], [0, 1, 2, 2, 1, 3]);
        assert_eq!(
            first.vertex().get("weight"),
            Some(&Attribute::Number(vec![3.0, 4.0, 5.0, 6.0].into()))
        );
        assert_eq!(first.face().get("region"), Some(&Attribute::Index(vec![7, 9].into())));
        let uv = [0.0, 1.0, 2.0, 6.0, 7.0, 8.0].map(|u| [u, 0.0]);
        assert_eq!(first.corner().pairs("uv").unwrap()[..], uv);
        assert_eq!(Vec::from_iter(first.creases()), [([1, 2], 2.0)]);
        assert_eq!(second.positions().len(), 3);
        assert_eq!(super::parts(&whole, 1).unwrap_err(), NoElements::TooMany { count: 2 });
    }

    #[test]
    fn a_part_depends_only_on_itself() {
        let before = parts(&mesh(&[[0, 1, 2], [3, 4, 5]]), 9).unwrap();
        let moved = Point3::new(0.5, 0.5, 0.5);
        let mut positions = mesh(&[[0, 1, 2], [3, 4, 5]]).positions().to_vec();
        positions[1] = moved;
        let after = mesh(&[[0, 1, 2], [3, 4, 5]]).with_positions(positions).unwrap();
        let after = parts(&after, 9).unwrap();
        assert_ne!(before[0].hash(), after[0].hash());
        assert_eq!(before[1].hash(), after[1].hash());
        let part: &Mesh = before[1].get().unwrap();
        assert_eq!(hash_of(part), before[1].hash());
    }

    #[test]
    fn borders_that_share_a_vertex_are_separate() {
        // Each of two triangles that touch at one vertex has a border of its own.
        assert_eq!(rims(&mesh(&[[0, 1, 2], [2, 3, 4]])), [vec![0, 1, 2], vec![2, 3, 4]]);
        let ring = mesh(&[[0, 1, 4], [1, 5, 4], [1, 2, 5], [2, 6, 5], [2, 0, 6], [0, 4, 6]]);
        assert_eq!(rims(&ring).len(), 2);
        let all = holes(&ring, 9).unwrap();
        assert!(all.iter().all(|rim| rim.get::<Curve>().unwrap().is_closed()));
        let closed = mesh(&[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]);
        assert!(rims(&closed).is_empty());
        assert_eq!(Mesh::NAME, "Mesh");
    }
}
