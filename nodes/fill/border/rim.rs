//! The data around the holes that are filled: the one-rings of their rims' vertices.

use maquette_base::topology::lists::Lists;
use nalgebra::{Point3, Vector3};

use crate::triangles::filling::Filling;
use crate::triangles::triangulation::{NONE, area_vector};

/// The one-ring of each vertex of some rims: the data's triangles around it.
pub(crate) struct OneRings {
    /// The place of each vertex among those of the rims; [`NONE`] for all others.
    places: Vec<u32>,
    triangles: Lists<[u32; 3]>,
    /// On how many rims each vertex of the rims is.
    shared: Vec<u8>,
}

impl OneRings {
    pub(crate) fn new(filling: &Filling, rims: &[Vec<u32>]) -> Self {
        let mut places = vec![NONE; filling.data];
        let mut shared: Vec<u8> = Vec::new();
        for &vertex in rims.iter().flatten() {
            if places[vertex as usize] == NONE {
                places[vertex as usize] = shared.len() as u32;
                shared.push(0);
            }
            let count = &mut shared[places[vertex as usize] as usize];
            *count = count.saturating_add(1);
        }
        let near: Vec<[u32; 3]> = filling.faces[..filling.kept]
            .iter()
            .filter(|face| face.iter().any(|&vertex| places[vertex as usize] != NONE))
            .copied()
            .collect();
        let triangles = Lists::group(shared.len(), || {
            near.iter().flat_map(|face| {
                let face = *face;
                let places = face.map(|vertex| places[vertex as usize]).into_iter();
                places.filter(|&place| place != NONE).map(move |place| (place, face))
            })
        });
        Self { places, triangles, shared }
    }

    /// The triangles around a vertex of a rim.
    pub(crate) fn of(&self, vertex: u32) -> &[[u32; 3]] {
        self.triangles.of(self.places[vertex as usize] as usize)
    }

    /// Whether a vertex is on several rims.
    fn is_shared(&self, vertex: u32) -> bool {
        self.shared[self.places[vertex as usize] as usize] > 1
    }
}

/// A rim with what has to be known of the data around it.
pub(crate) struct Rim {
    /// The vertices, in the order in which the faces that fill it meet them.
    pub(crate) vertices: Vec<u32>,
    pub(crate) points: Vec<Point3<f64>>,
    /// The unit normal of the data beyond the edge from each vertex to the next; zero if it has none.
    pub(crate) normals: Vec<Vector3<f64>>,
    /// The mean length of the data's edges at each vertex.
    pub(crate) lengths: Vec<f64>,
    /// Vertices of the data next to the rim, behind those of the rim itself in `triangles`.
    pub(crate) ring: Vec<Point3<f64>>,
    /// The data's triangles at the rim, by place: first those of the rim, then those of `ring`.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// For each vertex the other places on the rim, except its neighbors, to which the mesh has an edge or may get one.
    taken: Vec<Vec<u32>>,
}

impl Rim {
    pub(crate) fn new(filling: &Filling, one_rings: &OneRings, vertices: &[u32]) -> Self {
        let count = vertices.len();
        let place = |vertex: u32| filling.points[vertex as usize];
        let mut places: Vec<(u32, u32)> = vertices.iter().copied().zip(0..).collect();
        places.sort_unstable();
        fn on_rim(vertex: u32, places: &[(u32, u32)]) -> Option<u32> {
            let found = places.binary_search_by_key(&vertex, |(vertex, _)| *vertex);
            found.ok().map(|index| places[index].1)
        }
        let mut rim = Self {
            vertices: vertices.to_vec(),
            points: vertices.iter().map(|&vertex| place(vertex)).collect(),
            normals: Vec::with_capacity(count),
            lengths: Vec::with_capacity(count),
            ring: Vec::new(),
            triangles: Vec::new(),
            taken: Vec::with_capacity(count),
        };
        let shared: Vec<u32> = (0..)
            .zip(vertices)
            .filter(|(_, vertex)| one_rings.is_shared(**vertex))
            .map(|(place, _)| place)
            .collect();
        let mut ring: Vec<u32> = Vec::new();
        for (k, &vertex) in vertices.iter().enumerate() {
            let (after, before) = (vertices[(k + 1) % count], vertices[(k + count - 1) % count]);
            let one_ring = one_rings.of(vertex);
            let beyond = one_ring.iter().find(|face| {
                // The data runs through the edge the other way.
                (0..3).any(|i| face[i] == after && face[(i + 1) % 3] == vertex)
            });
            let normal = beyond.map(|face| area_vector(face.map(place)));
            rim.normals.push(normal.and_then(|area| area.try_normalize(0.0)).unwrap_or_default());
            let (mut length, mut edges) = (0.0, 0.0);
            let mut taken: Vec<u32> =
                if shared.contains(&(k as u32)) { shared.clone() } else { Vec::new() };
            for face in one_ring {
                for &other in face.iter().filter(|other| **other != vertex) {
                    length += (place(other) - place(vertex)).norm();
                    edges += 1.0;
                    match on_rim(other, &places) {
                        Some(at) if other != after && other != before => taken.push(at),
                        Some(_) => {}
                        None => ring.push(other),
                    }
                }
            }
            taken.retain(|&at| {
                let other = vertices[at as usize];
                other != after && other != before && other != vertex
            });
            taken.sort_unstable();
            taken.dedup();
            rim.taken.push(taken);
            rim.lengths.push(if edges > 0.0 { length / edges } else { 0.0 });
        }
        ring.sort_unstable();
        ring.dedup();
        rim.ring = ring.iter().map(|&vertex| place(vertex)).collect();
        for &vertex in vertices {
            for face in one_rings.of(vertex) {
                // A triangle at several vertices of the rim counts once: at the lowest one.
                let lowest = face.iter().filter(|&&corner| on_rim(corner, &places).is_some()).min();
                if lowest == Some(&vertex) {
                    rim.triangles.push(face.map(|vertex: u32| match on_rim(vertex, &places) {
                        Some(at) => at,
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

    /// Whether the mesh has an edge between two places of the rim, or may get one by filling another hole.
    pub(crate) fn is_taken(&self, a: usize, b: usize) -> bool {
        self.taken[a].binary_search(&(b as u32)).is_ok()
    }
}
