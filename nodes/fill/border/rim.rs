//! The input mesh around the holes to fill: the triangles at the vertices of each hole's rim.

use std::collections::BTreeMap;

use maquette_base::topology::lists::Lists;
use nalgebra::{Point3, Vector3};

use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, area_vector};

/// The triangles of the input mesh around each vertex on the rim of a hole.
pub(crate) struct OneRings {
    /// For each vertex of the mesh, its index in `triangles` and `shared`; [`NONE`] if the vertex is not on the rim of a hole.
    indices: Vec<u32>,
    triangles: Lists<[u32; 3]>,
    /// For each rim vertex, the number of hole rims that contain it.
    shared: Vec<u8>,
}

impl OneRings {
    pub(crate) fn new(filling: &Filling, rims: &[Vec<u32>]) -> Self {
        let mut places = vec![NONE; filling.n_data_vertices];
        let mut shared: Vec<u8> = Vec::new();
        for &vertex in rims.iter().flatten() {
            if places[vertex as usize] == NONE {
                places[vertex as usize] = shared.len() as u32;
                shared.push(0);
            }
            let count = &mut shared[places[vertex as usize] as usize];
            *count = count.saturating_add(1);
        }
        let near: Vec<[u32; 3]> = filling.faces[..filling.n_data_faces]
            .iter()
            .filter(|face| face.iter().any(|&vertex| places[vertex as usize] != NONE))
            .copied()
            .collect();
        let triangles = Lists::group(shared.len(), || {
            near.iter().flat_map(|face| {
                let face = *face;
                let places = face.map(|vertex| places[vertex as usize]).into_iter();
                places.filter(|&index| index != NONE).map(move |index| (index, face))
            })
        });
        Self { indices: places, triangles, shared }
    }

    /// Returns the triangles of the input mesh around a vertex on the rim of a hole.
    pub(crate) fn triangles_around(&self, vertex: u32) -> &[[u32; 3]] {
        self.triangles.list(self.indices[vertex as usize] as usize)
    }

    /// Returns true if a vertex is on the rims of several holes.
    fn is_shared(&self, vertex: u32) -> bool {
        self.shared[self.indices[vertex as usize] as usize] > 1
    }
}

/// The rim (boundary loop) of a hole and the input mesh around it.
pub(crate) struct Rim {
    /// The vertices of the rim, in the order in which the faces that will fill the hole run along it.
    pub(crate) vertices: Vec<u32>,
    pub(crate) points: Vec<Point3<f64>>,
    /// For each rim edge, the unit normal of the input triangle at the edge; zero if there is no such triangle. Edge `k` runs from vertex
    /// `k` to the next.
    pub(crate) normals: Vec<Vector3<f64>>,
    /// For each rim vertex, the mean length of the input mesh's edges at the vertex.
    pub(crate) lengths: Vec<f64>,
    /// The input vertices that share a triangle with a rim vertex but are not on the rim.
    pub(crate) ring: Vec<Point3<f64>>,
    /// The input triangles that touch the rim. Corners are indices into `points` followed by `ring`.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// For each rim vertex, the indices of the rim vertices to which the mesh already has an edge, or may get one when another hole is
    /// filled. The two neighbors along the rim are not listed.
    pub(crate) connected: Vec<Vec<u32>>,
}

impl Rim {
    pub(crate) fn new(filling: &Filling, one_rings: &OneRings, vertices: &[u32]) -> Self {
        let count = vertices.len();
        let indices: BTreeMap<u32, u32> = vertices.iter().copied().zip(0..).collect();
        let mut rim = Self {
            vertices: vertices.to_vec(),
            points: vertices.iter().map(|&vertex| filling.point(vertex)).collect(),
            normals: Vec::with_capacity(count),
            lengths: Vec::with_capacity(count),
            ring: Vec::new(),
            triangles: Vec::new(),
            connected: Vec::with_capacity(count),
        };
        let shared: Vec<u32> = (0..)
            .zip(vertices)
            .filter(|(_, vertex)| one_rings.is_shared(**vertex))
            .map(|(index, _)| index)
            .collect();
        let mut ring: Vec<u32> = Vec::new();
        for (k, &vertex) in vertices.iter().enumerate() {
            let (after, before) = (vertices[(k + 1) % count], vertices[(k + count - 1) % count]);
            let one_ring = one_rings.triangles_around(vertex);
            let beyond = one_ring.iter().find(|face| {
                // The input triangle contains the rim edge in the opposite direction.
                (0..3).any(|i| face[i] == after && face[(i + 1) % 3] == vertex)
            });
            let normal = beyond.map(|&face| area_vector(filling.corners(face)));
            rim.normals.push(normal.and_then(|area| area.try_normalize(0.0)).unwrap_or_default());
            let (mut length, mut edges) = (0.0, 0.0);
            let mut connected: Vec<u32> =
                if shared.contains(&(k as u32)) { shared.clone() } else { Vec::new() };
            for face in one_ring {
                for &other in face.iter().filter(|other| **other != vertex) {
                    length += (filling.point(other) - filling.point(vertex)).norm();
                    edges += 1.0;
                    match indices.get(&other) {
                        Some(&index) if other != after && other != before => connected.push(index),
                        Some(_) => {}
                        None => ring.push(other),
                    }
                }
            }
            connected.retain(|&index| {
                let other = vertices[index as usize];
                other != after && other != before && other != vertex
            });
            connected.sort_unstable();
            connected.dedup();
            rim.connected.push(connected);
            rim.lengths.push(if edges > 0.0 { length / edges } else { 0.0 });
        }
        ring.sort_unstable();
        ring.dedup();
        rim.ring = ring.iter().map(|&vertex| filling.point(vertex)).collect();
        for &vertex in vertices {
            for face in one_rings.triangles_around(vertex) {
                // Add a triangle that touches several rim vertices only once: for the rim vertex with the lowest index.
                let lowest = face.iter().filter(|&corner| indices.contains_key(corner)).min();
                if lowest == Some(&vertex) {
                    rim.triangles.push(face.map(|vertex: u32| match indices.get(&vertex) {
                        Some(&index) => index,
                        None => count as u32 + ring.binary_search(&vertex).unwrap_or(0) as u32,
                    }));
                }
            }
        }
        rim
    }

    pub(crate) fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Returns true if the mesh has an edge between two rim vertices, given by index, or may get such an edge when another hole is filled.
    pub(crate) fn is_taken(&self, a: usize, b: usize) -> bool {
        self.connected[a].binary_search(&(b as u32)).is_ok()
    }
}
