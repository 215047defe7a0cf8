//! Makes any mesh manifold by duplicating vertices, and cuts meshes along seams.

use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Faces, Mesh, MeshError};

use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE};

/// Makes a mesh manifold by duplicating each vertex for each fan of faces around it. An edge with more than two faces is thereby
/// duplicated: once for each pair of faces that remain connected in a fan, and once for each other face. Positions do not change. The first
/// fan keeps the vertex; the other fans get new vertices at the end of the list, in the order of their corners.
///
/// # Errors
/// If there are more vertices than a mesh can hold.
pub(crate) fn manifold(mesh: &Mesh) -> Result<Mesh, MeshError> {
    let (faces, edges) = (mesh.faces(), mesh.edges());
    let next = next_corners(faces);
    let mut halves = vec![[NONE; 2]; edges.vertices.len()];
    for (half, &edge) in (0u32..).zip(&edges.of_corner) {
        let [first, second] = &mut halves[edge as usize];
        *if *first == NONE { first } else { second } = half;
    }
    let corners = faces.corners();
    let mut fans = UnionFind::new(corners.len());
    for ([a, b], &count) in halves.into_iter().zip(&edges.faces) {
        if count == 2 && corners[a as usize] != corners[b as usize] {
            fans.union(a, next[b as usize]);
            fans.union(next[a as usize], b);
        }
    }
    let (numbers, firsts) = fans.into_labels();
    let mut kept = vec![NONE; mesh.positions().len()];
    let mut sources: Vec<u32> = (0..kept.len() as u32).collect();
    let vertices = firsts.iter().map(|&corner| {
        let vertex = corners[corner as usize];
        if kept[vertex as usize] == NONE {
            kept[vertex as usize] = vertex;
            return vertex;
        }
        sources.push(vertex);
        sources.len() as u32 - 1
    });
    let vertices: Vec<u32> = vertices.collect();
    let split: Vec<u32> = numbers.iter().map(|&fan| vertices[fan as usize]).collect();
    let positions: Vec<_> = sources.iter().map(|&v| mesh.positions()[v as usize]).collect();
    let mut creases: Vec<([u32; 2], f64)> = Vec::new();
    let known: Vec<([u32; 2], f64)> = mesh.creases().collect();
    for (half, &edge) in edges.of_corner.iter().enumerate().filter(|_| !known.is_empty()) {
        let ends = edges.vertices[edge as usize];
        if let Ok(index) = known.binary_search_by_key(&ends, |crease| crease.0) {
            let [a, b] = [split[half], split[next[half] as usize]];
            creases.push(([a.min(b), a.max(b)], known[index].1));
        }
    }
    creases.sort_by_key(|crease| crease.0);
    creases.dedup_by_key(|crease| crease.0);
    let sides: Vec<usize> = faces.iter().map(<[u32]>::len).collect();
    let mut surface = Mesh::new(positions, Faces::polygons(&sides, split)?)?
        .with_creases(creases)?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    for (name, attribute) in mesh.vertex().iter() {
        surface = surface.with_vertex(name, attribute.select(&sources))?;
    }
    for (name, attribute) in mesh.corner().iter() {
        surface = surface.with_corner(name, attribute.clone())?;
    }
    for (name, attribute) in mesh.face().iter() {
        surface = surface.with_face(name, attribute.clone())?;
    }
    Ok(surface)
}

fn next_corners(faces: &Faces) -> Vec<u32> {
    let mut next = Vec::with_capacity(faces.corners().len());
    for face in faces.iter() {
        let first = next.len() as u32;
        let sides = face.len() as u32;
        next.extend((0..sides).map(|k| first + (k + 1) % sides));
    }
    next
}

/// Cuts a mesh along the seams of a corner attribute, which are the edges where the values of both faces differ. Returns the index of the
/// new vertex at each corner, and for each new vertex one of its corners.
pub(crate) fn cut<T: PartialEq>(mesh: &Connectivity, attribute: &[T]) -> (Vec<u32>, Vec<u32>) {
    let mut fans = UnionFind::new(mesh.corners().len());
    for &[owner, twin] in &mesh.halves {
        if twin == NONE {
            continue;
        }
        let (at_start, at_end) = ([owner, mesh.next(twin)], [mesh.next(owner), twin]);
        let is_seam = [at_start, at_end]
            .iter()
            .any(|[a, b]| attribute[*a as usize] != attribute[*b as usize]);
        if !is_seam {
            fans.union(at_start[0], at_start[1]);
            fans.union(at_end[0], at_end[1]);
        }
    }
    fans.into_labels()
}

#[cfg(test)]
mod tests {
    use maquette_value::Attribute;
    use nalgebra::Point3;

    use super::*;

    fn mesh_of_triangles(faces: Vec<[u32; 3]>) -> Mesh {
        let vertices = faces.iter().flatten().max().map_or(0, |&vertex| vertex + 1);
        let positions: Vec<_> =
            (0..vertices).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect();
        Mesh::new(positions, Faces::triangles(faces)).unwrap()
    }

    fn split(faces: Vec<[u32; 3]>) -> Vec<Vec<u32>> {
        let surface = manifold(&mesh_of_triangles(faces)).unwrap();
        assert!(Connectivity::new(surface.faces(), surface.positions().len()).is_ok());
        surface.faces().iter().map(<[u32]>::to_vec).collect()
    }

    #[test]
    fn three_faces_at_an_edge_are_separated() {
        let pages = split(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        assert_eq!(pages, [[0, 1, 2], [5, 6, 3], [7, 8, 4]].map(|page| page.to_vec()));
    }

    #[test]
    fn faces_of_opposite_orientation_are_separated() {
        assert_eq!(split(vec![[0, 1, 2], [0, 1, 3]]), [[0, 1, 2], [4, 5, 3]]);
    }

    #[test]
    fn two_tetrahedra_that_share_an_edge_are_closed_again() {
        fn tetrahedron([a, b, c, d]: [u32; 4]) -> [[u32; 3]; 4] {
            [[a, c, b], [a, b, d], [a, d, c], [b, c, d]]
        }
        let both = [tetrahedron([0, 1, 2, 3]), tetrahedron([0, 1, 4, 5])].concat();
        let surface = manifold(&mesh_of_triangles(both)).unwrap();
        assert_eq!(surface.positions().len(), 8);
        assert!(surface.edges().faces.iter().all(|&faces| faces == 2));
        assert_eq!(surface.positions()[6..], surface.positions()[..2]);
    }

    #[test]
    fn a_manifold_mesh_does_not_change_and_other_meshes_keep_their_data() {
        let surface =
            mesh_of_triangles(vec![[0, 1, 2], [2, 1, 3]]).with_creases([([1, 2], 2.0)]).unwrap();
        assert_eq!(manifold(&surface).unwrap(), surface);
        let book = mesh_of_triangles(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]])
            .with_creases([([0, 1], 2.0)])
            .unwrap();
        let book =
            book.with_vertex("page", Attribute::Index(vec![7, 8, 9, 10, 11].into())).unwrap();
        let split = manifold(&book).unwrap();
        let pages = Attribute::Index(vec![7, 8, 9, 10, 11, 8, 7, 7, 8].into());
        assert_eq!(split.vertex().get("page"), Some(&pages));
        let creases: Vec<_> = split.creases().collect();
        assert_eq!(creases, [([0, 1], 2.0), ([5, 6], 2.0), ([7, 8], 2.0)]);
    }
}
