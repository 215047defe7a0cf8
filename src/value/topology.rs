//! The topology of a mesh in numbers, and its size.

use nalgebra::Point3;

use super::Mesh;

/// The topology of a mesh in numbers, which must be equal before any position is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Topology {
    /// Vertices, those without faces included.
    pub vertices: usize,
    /// Edges.
    pub edges: usize,
    /// Faces.
    pub faces: usize,
    /// Components of faces that are connected by vertices.
    pub components: usize,
    /// Edges of one face.
    pub boundary: usize,
    /// Edges of more than two faces.
    pub non_manifold: usize,
    /// Edges whose faces run through them in the same direction.
    pub misoriented: usize,
}

impl Topology {
    /// That of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        let (edges, components) = rayon::join(|| mesh.edges(), || components(mesh));
        fn count(wanted: fn(&u32) -> bool, edges_faces: &[u32]) -> usize {
            edges_faces.iter().filter(|n| wanted(n)).count()
        }
        Self {
            vertices: mesh.positions().len(),
            edges: edges.vertices.len(),
            faces: mesh.faces().len(),
            components,
            boundary: count(|&n| n == 1, &edges.faces),
            non_manifold: count(|&n| n > 2, &edges.faces),
            misoriented: edges.misoriented,
        }
    }

    /// Vertices - edges + faces.
    pub fn euler(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.faces as i64
    }

    /// Its numbers with their names.
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

/// How many groups of faces there are that share no vertex.
fn components(mesh: &Mesh) -> usize {
    let mut parents: Vec<u32> = (0..mesh.positions().len() as u32).collect();
    fn root(parents: &mut [u32], mut vertex: u32) -> u32 {
        while parents[vertex as usize] != vertex {
            // Halves the way for those who come later.
            parents[vertex as usize] = parents[parents[vertex as usize] as usize];
            vertex = parents[vertex as usize];
        }
        vertex
    }
    let mut used = vec![false; parents.len()];
    for face in mesh.faces().iter() {
        used[face[0] as usize] = true;
        for &vertex in &face[1..] {
            used[vertex as usize] = true;
            let (a, b) = (root(&mut parents, face[0]), root(&mut parents, vertex));
            parents[a.max(b) as usize] = a.min(b);
        }
    }
    (0..parents.len()).filter(|vertex| used[*vertex] && parents[*vertex] == *vertex as u32).count()
}

/// Closed chains of edges with one face.
pub fn border_loops(mesh: &Mesh) -> usize {
    let border = border(mesh);
    let mut vertices: Vec<u32> = border.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    fn index(vertex: &u32, vertices: &[u32]) -> usize {
        vertices.binary_search(vertex).unwrap_or(0)
    }
    let mut leaders: Vec<usize> = (0..vertices.len()).collect();
    fn leader(leaders: &mut [usize], mut of: usize) -> usize {
        while leaders[of] != of {
            leaders[of] = leaders[leaders[of]];
            of = leaders[of];
        }
        of
    }
    for edge in &border {
        let [a, b] = [0, 1].map(|end| leader(&mut leaders, index(&edge[end], &vertices)));
        leaders[a.max(b)] = a.min(b);
    }
    (0..leaders.len()).filter(|&at| leaders[at] == at).count()
}

/// The edges with one face.
pub fn border(mesh: &Mesh) -> Vec<[u32; 2]> {
    let edges = mesh.edges();
    let alone = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    alone.map(|(edge, _)| *edge).collect()
}

/// Area, volume (of a closed mesh), and the shortest and longest edge.
pub struct Extent {
    /// Area, in mm².
    pub area: f64,
    /// Volume, in mm³: what it means only of a closed mesh.
    pub volume: f64,
    /// The shortest edge, in mm; infinite if there is none.
    pub shortest: f64,
    /// The longest edge, in mm.
    pub longest: f64,
}

impl Extent {
    /// That of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        let middle =
            mesh.bounds().map_or(Point3::origin(), |(low, high)| nalgebra::center(&low, &high));
        let mut extent = Self { area: 0.0, volume: 0.0, shortest: f64::INFINITY, longest: 0.0 };
        fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        for face in mesh.faces().iter() {
            let area = mesh.area_vector(face);
            extent.area += area.norm();
            for k in 1..face.len() - 1 {
                let [a, b, c] =
                    [face[0], face[k], face[k + 1]].map(|vertex| place(vertex, mesh) - middle);
                extent.volume += a.dot(&b.cross(&c)) / 6.0;
            }
            for (&from, &to) in face.iter().zip(face[1..].iter().chain(&face[..1])) {
                let length = (place(from, mesh) - place(to, mesh)).norm();
                extent.shortest = extent.shortest.min(length);
                extent.longest = extent.longest.max(length);
            }
        }
        extent
    }
}
