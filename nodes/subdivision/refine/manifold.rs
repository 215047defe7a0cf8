//! Makes a surface of any mesh, by cutting it where it is none; and cuts along seams.

use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Faces, Mesh, MeshError};

use super::connectivity::Connectivity;
use super::half_edges::{HalfEdges, NONE};

/// The same mesh as a surface: each vertex once for each fan of faces around it, and so each edge with more than two faces once
/// for each pair of faces that fans join, else once for each face. Nothing moves; the first fan keeps the vertex, the others get
/// new ones behind the last, in the order of their corners.
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
            fans.join(a, next[b as usize]);
            fans.join(next[a as usize], b);
        }
    }
    let (numbers, firsts) = fans.numbered();
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
        if let Ok(place) = known.binary_search_by_key(&ends, |crease| crease.0) {
            let [a, b] = [split[half], split[next[half] as usize]];
            creases.push(([a.min(b), a.max(b)], known[place].1));
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

/// The mesh cut along the seams of a corner attribute, which are the edges whose two faces disagree about it: the vertices at its
/// corners, and a corner of each of these vertices.
pub(crate) fn cut<T: PartialEq>(mesh: &Connectivity, attribute: &[T]) -> (Vec<u32>, Vec<u32>) {
    let mut fans = UnionFind::new(mesh.corners().len());
    let same = |a: u32, b: u32| attribute[a as usize] == attribute[b as usize];
    for &[owner, twin] in &mesh.halves {
        if twin == NONE {
            continue;
        }
        let (at_start, at_end) = ([owner, mesh.next(twin)], [mesh.next(owner), twin]);
        if same(at_start[0], at_start[1]) && same(at_end[0], at_end[1]) {
            fans.join(at_start[0], at_start[1]);
            fans.join(at_end[0], at_end[1]);
        }
    }
    fans.numbered()
}

#[cfg(test)]
mod tests {
    use maquette_value::Attribute;
    use nalgebra::Point3;

    use super::*;

    fn of(faces: Vec<[u32; 3]>) -> Mesh {
        let vertices = faces.iter().flatten().max().map_or(0, |&vertex| vertex + 1);
        let positions: Vec<_> =
            (0..vertices).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect();
        Mesh::new(positions, Faces::triangles(faces)).unwrap()
    }

    fn split(faces: Vec<[u32; 3]>) -> Vec<Vec<u32>> {
        let surface = manifold(&of(faces)).unwrap();
        assert!(Connectivity::new(surface.faces(), surface.positions().len()).is_ok());
        surface.faces().iter().map(<[u32]>::to_vec).collect()
    }

    #[test]
    fn three_pages_of_a_book_come_apart() {
        let pages = split(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        assert_eq!(pages, [[0, 1, 2], [5, 6, 3], [7, 8, 4]].map(|page| page.to_vec()));
    }

    #[test]
    fn faces_that_disagree_about_their_side_come_apart() {
        assert_eq!(split(vec![[0, 1, 2], [0, 1, 3]]), [[0, 1, 2], [4, 5, 3]]);
    }

    #[test]
    fn two_tetrahedra_that_share_an_edge_are_closed_again() {
        fn tetrahedron([a, b, c, d]: [u32; 4]) -> [[u32; 3]; 4] {
            [[a, c, b], [a, b, d], [a, d, c], [b, c, d]]
        }
        let both = [tetrahedron([0, 1, 2, 3]), tetrahedron([0, 1, 4, 5])].concat();
        let surface = manifold(&of(both)).unwrap();
        assert_eq!(surface.positions().len(), 8);
        assert!(surface.edges().faces.iter().all(|&faces| faces == 2));
        assert_eq!(surface.positions()[6..], surface.positions()[..2]);
    }

    #[test]
    fn what_is_a_surface_stays_as_it_is_and_the_rest_keeps_its_data() {
        let surface = of(vec![[0, 1, 2], [2, 1, 3]]).with_creases([([1, 2], 2.0)]).unwrap();
        assert_eq!(manifold(&surface).unwrap(), surface);
        let book = of(vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]).with_creases([([0, 1], 2.0)]).unwrap();
        let book =
            book.with_vertex("page", Attribute::Index(vec![7, 8, 9, 10, 11].into())).unwrap();
        let split = manifold(&book).unwrap();
        let pages = Attribute::Index(vec![7, 8, 9, 10, 11, 8, 7, 7, 8].into());
        assert_eq!(split.vertex().get("page"), Some(&pages));
        let creases: Vec<_> = split.creases().collect();
        assert_eq!(creases, [([0, 1], 2.0), ([5, 6], 2.0), ([7, 8], 2.0)]);
    }
}
