//! The curvature of a mesh itself: of its angles, and of fitted quadratic surfaces.

use maquette::value::{Edges, Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::bending::Bending;

/// What the angles around a vertex tell.
#[derive(Clone, Copy, Debug, Default)]
pub struct AngleBending {
    /// The angle that is missing to a full turn, at a border to a half one, over the area: the Gaussian curvature.
    pub gaussian: f64,
    /// The mean curvature.
    pub mean: f64,
    /// The area of the surface that is nearest to the vertex.
    pub area: f64,
}

/// The curvature at the vertices of a triangle mesh, from angles and cotangents; 0 at vertices of no area.
///
/// Meyer, Desbrun, Schroeder and Barr, "Discrete differential-geometry operators for triangulated 2-manifolds" (2003), eqs. 8 to
/// 10. The sum of `gaussian * area` over a closed mesh is 2 pi times its Euler characteristic, exactly.
pub fn angle_bending(mesh: &Mesh) -> Vec<AngleBending> {
    let count = mesh.positions().len();
    let (mut angles, mut areas) = (vec![0.0; count], vec![0.0; count]);
    let mut pull = vec![Vector3::zeros(); count];
    for face in mesh.faces().iter() {
        let places = [0, 1, 2].map(|k| mesh.positions()[face[k] as usize]);
        let corners = [0, 1, 2].map(|k| Corner::new(places, k));
        let area = (places[1] - places[0]).cross(&(places[2] - places[0])).norm() / 2.0;
        let obtuse = corners.iter().position(|corner| corner.angle > std::f64::consts::FRAC_PI_2);
        for (k, corner) in corners.iter().enumerate() {
            let vertex = face[k] as usize;
            let [next, last] = [(k + 1) % 3, (k + 2) % 3];
            angles[vertex] += corner.angle;
            areas[vertex] += match obtuse {
                Some(other) if other == k => area / 2.0,
                Some(_) => area / 4.0,
                None => {
                    let part = |to: usize, across: usize| {
                        corners[across].cotangent * (places[to] - places[k]).norm_squared()
                    };
                    (part(next, last) + part(last, next)) / 8.0
                }
            };
            for (to, across) in [(next, last), (last, next)] {
                pull[vertex] += (places[k] - places[to]) * corners[across].cotangent;
            }
        }
    }
    let edges = mesh.edges();
    let mut turns = vec![std::f64::consts::TAU; count];
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    borders.flat_map(|(ends, _)| ends).for_each(|&end| turns[end as usize] = std::f64::consts::PI);
    let normals = mesh.vertex_normals();
    let at = |vertex: usize| {
        let area = areas[vertex];
        let determined = area > 0.0;
        if !determined {
            return AngleBending::default();
        }
        let along = pull[vertex] / (2.0 * area);
        let mean = along.norm() / 2.0;
        AngleBending {
            gaussian: (turns[vertex] - angles[vertex]) / area,
            mean: if along.dot(&normals[vertex]) < 0.0 { -mean } else { mean },
            area,
        }
    };
    (0..count).map(at).collect()
}

/// A corner of a triangle.
struct Corner {
    angle: f64,
    /// 0 in a triangle without area, which then has no say.
    cotangent: f64,
}

impl Corner {
    fn new(places: [Point3<f64>; 3], k: usize) -> Self {
        let [u, v] = [1, 2].map(|step| places[(k + step) % 3] - places[k]);
        let (sine, cosine) = (u.cross(&v).norm(), u.dot(&v));
        let cotangent = if sine > 0.0 { cosine / sine } else { 0.0 };
        Self { angle: libm::atan2(sine, cosine), cotangent }
    }
}

/// Who is whose neighbor in a mesh.
pub(super) struct Neighbors {
    starts: Vec<u32>,
    others: Vec<u32>,
}

impl Neighbors {
    pub(super) fn new(edges: &Edges, vertices: usize) -> Self {
        let mut starts = vec![0u32; vertices + 1];
        edges.vertices.iter().flatten().for_each(|&end| starts[end as usize + 1] += 1);
        for vertex in 0..vertices {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut others = vec![0; 2 * edges.vertices.len()];
        for &[a, b] in &edges.vertices {
            for (from, to) in [(a, b), (b, a)] {
                others[next[from as usize] as usize] = to;
                next[from as usize] += 1;
            }
        }
        Self { starts, others }
    }

    pub(super) fn of(&self, vertex: u32) -> &[u32] {
        let [start, end] = [0, 1].map(|k| self.starts[vertex as usize + k] as usize);
        &self.others[start..end]
    }

    /// The vertices that are two edges away or less, or as many more rings as make `least`; without the vertex.
    pub(super) fn near(&self, vertex: u32, least: usize) -> Vec<u32> {
        let mut found = vec![vertex];
        let mut ring = vec![vertex];
        let mut rings = 0;
        while !ring.is_empty() && (rings < 2 || found.len() <= least) {
            let next = ring.iter().flat_map(|&other| self.of(other));
            ring = next.copied().filter(|other| found.binary_search(other).is_err()).collect();
            ring.sort_unstable();
            ring.dedup();
            found.extend(&ring);
            found.sort_unstable();
            rings += 1;
        }
        found.retain(|&other| other != vertex);
        found
    }
}

/// The same mesh with each polygon cut into triangles around its middle, which comes after the vertices.
pub(super) fn triangulated(mesh: &Mesh) -> Result<Mesh, MeshError> {
    if mesh.faces().sides() == Some(3) {
        return Ok(mesh.clone());
    }
    let mut places = mesh.positions().to_vec();
    let mut triangles = Vec::new();
    for face in mesh.faces().iter() {
        if let Ok(triangle) = face.try_into() {
            triangles.push(triangle);
            continue;
        }
        let middle = places.len() as u32;
        let corners = face.iter().map(|&vertex| mesh.positions()[vertex as usize].coords);
        places.push((corners.sum::<Vector3<f64>>() / face.len() as f64).into());
        let next = face.iter().cycle().skip(1);
        triangles.extend(face.iter().zip(next).map(|(&a, &b)| [a, b, middle]));
    }
    Mesh::new(places, Faces::triangles(triangles))
}

/// Fewest points that a quadratic surface is fitted to.
const LEAST: usize = 6;

/// The curvature at some vertices of a mesh by a quadratic surface through the vertices around; none where they do not
/// determine one.
pub(super) fn fitted(mesh: &Mesh, vertices: &[u32]) -> Vec<Option<Bending>> {
    let neighbors = Neighbors::new(&mesh.edges(), mesh.positions().len());
    let normals = mesh.vertex_normals();
    let at = |&vertex: &u32| {
        let near = neighbors.near(vertex, LEAST);
        let around = Vec::from_iter(near.iter().map(|&other| mesh.positions()[other as usize]));
        let middle = mesh.positions()[vertex as usize];
        Bending::of_points(middle, normals[vertex as usize], &around)
    };
    vertices.par_iter().with_min_len(64).map(at).collect()
}
