//! Topological counts, area and volume of meshes.

use nalgebra::Point3;

use super::Mesh;
use super::union_find::UnionFind;
use crate::parallel::join;

/// Topological counts of a mesh. Two meshes must have equal counts before their positions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Topology {
    /// The number of vertices, including those without faces.
    pub vertices: usize,
    /// The number of distinct edges of all faces.
    pub edges: usize,
    /// The number of faces.
    pub faces: usize,
    /// The number of components, each a group of faces that are connected by vertices.
    pub components: usize,
    /// The number of edges with one face.
    pub boundary: usize,
    /// The number of edges with more than two faces.
    pub non_manifold: usize,
    /// The number of edges that two faces traverse in the same direction.
    pub misoriented: usize,
}

impl Topology {
    /// Computes the counts of a mesh.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let (edges, components) = join(|| mesh.edges(), || components(mesh));
        Self {
            vertices: mesh.positions().len(),
            edges: edges.vertices.len(),
            faces: mesh.faces().len(),
            components,
            boundary: edges.faces.iter().filter(|&&n| n == 1).count(),
            non_manifold: edges.faces.iter().filter(|&&n| n > 2).count(),
            misoriented: edges.misoriented,
        }
    }

    /// The Euler characteristic: vertices - edges + faces.
    pub fn euler(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.faces as i64
    }

    /// All counts with their names.
    pub fn facts(&self) -> [(&'static str, i64); 8] {
        [
            ("vertices", self.vertices as i64),
            ("edges", self.edges as i64),
            ("faces", self.faces as i64),
            ("components", self.components as i64),
            ("Euler characteristic", self.euler()),
            ("boundary edges", self.boundary as i64),
            ("non-manifold edges", self.non_manifold as i64),
            ("misoriented edges", self.misoriented as i64),
        ]
    }
}

/// The number of components, each a group of faces that are connected by vertices.
fn components(mesh: &Mesh) -> usize {
    let mut sets = UnionFind::new(mesh.positions().len());
    let mut is_used = vec![false; mesh.positions().len()];
    for face in mesh.faces().iter() {
        for &vertex in face {
            is_used[vertex as usize] = true;
            sets.union(face[0], vertex);
        }
    }
    (0..).zip(is_used).filter(|&(vertex, is_used)| is_used && sets.find(vertex) == vertex).count()
}

/// The number of connected groups of border edges.
pub fn border_loops(mesh: &Mesh) -> usize {
    let border = border(mesh);
    let mut vertices: Vec<u32> = border.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let mut sets = UnionFind::new(vertices.len());
    for edge in &border {
        let [a, b] = edge.map(|vertex| vertices.binary_search(&vertex).unwrap_or(0) as u32);
        sets.union(a, b);
    }
    (0..vertices.len() as u32).filter(|&vertex| sets.find(vertex) == vertex).count()
}

/// The border edges, which are the edges with only one face.
pub fn border(mesh: &Mesh) -> Vec<[u32; 2]> {
    let edges = mesh.edges();
    let alone = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    alone.map(|(edge, _)| *edge).collect()
}

/// The area, volume and edge lengths of a mesh.
pub struct Extent {
    /// The total area of the faces, in mm².
    pub area: f64,
    /// The enclosed volume, in mm³. It is meaningful only for a closed mesh.
    pub volume: f64,
    /// The length of the shortest edge, in mm; infinite if there are no edges.
    pub shortest: f64,
    /// The length of the longest edge, in mm.
    pub longest: f64,
}

impl Extent {
    /// Computes the area, volume and edge lengths of a mesh.
    pub fn from_mesh(mesh: &Mesh) -> Self {
        let middle =
            mesh.bounds().map_or(Point3::origin(), |(low, high)| nalgebra::center(&low, &high));
        let mut extent = Self { area: 0.0, volume: 0.0, shortest: f64::INFINITY, longest: 0.0 };
        fn position(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        for face in mesh.faces().iter() {
            let area = mesh.area_vector(face);
            extent.area += area.norm();
            for k in 1..face.len() - 1 {
                let [a, b, c] =
                    [face[0], face[k], face[k + 1]].map(|vertex| position(vertex, mesh) - middle);
                extent.volume += a.dot(&b.cross(&c)) / 6.0;
            }
            for (&from, &to) in face.iter().zip(face[1..].iter().chain(&face[..1])) {
                let length = (position(from, mesh) - position(to, mesh)).norm();
                extent.shortest = extent.shortest.min(length);
                extent.longest = extent.longest.max(length);
            }
        }
        extent
    }
}
