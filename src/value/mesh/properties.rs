//! Properties of meshes: closed, manifold, oriented and so on.

use super::super::{Property, Violation};
use super::Mesh;
use crate::union_find::UnionFind;

/// The properties that ports can require of a mesh.
pub(super) const PROPERTIES: &[Property<Mesh>] = &[
    Property::new("Closed", "No edge has only one face: there is no border.", |mesh| {
        let found = mesh.edges();
        let mut violation = edges(
            mesh,
            "edges with one face",
            (0..found.faces.len()).filter(|&edge| found.faces[edge] == 1),
            &found.vertices,
        )?;
        if let unjoined @ 1.. = mesh.count_unjoined() {
            violation.what += &format!(
                "; {unjoined} vertices at its borders share a position with another: `Weld` joins them"
            );
        }
        Some(violation)
    }),
    Property::new("Manifold", "No edge has more than two faces.", |mesh| {
        let found = mesh.edges();
        let many = (0..found.faces.len()).filter(|&edge| 2 < found.faces[edge]);
        edges(mesh, "edges with more than two faces", many, &found.vertices)
    }),
    Property::new("Oriented", "Faces that share an edge have the same orientation.", |mesh| {
        let found = mesh.edges();
        if found.misoriented == 0 {
            return None;
        }
        let twisted = twisted_edges(mesh, &found.of_corner, found.faces.len());
        edges(
            mesh,
            "edges between faces of opposite orientation",
            twisted.into_iter(),
            &found.vertices,
        )
    }),
    Property::new("Unpinched", "The faces around each vertex are connected by edges.", |mesh| {
        Violation::from_elements(
            &pinched_vertices(mesh),
            "vertices that join fans of faces",
            |vertex| format!("vertex {vertex}"),
            |vertex| vec![mesh.positions()[vertex as usize]],
        )
    }),
    Property::new("Triangles", "Each face has three corners.", |mesh| {
        if mesh.faces().sides() == Some(3) {
            return None;
        }
        fn sides(face: &u32, mesh: &Mesh) -> usize {
            mesh.faces().face(*face as usize).len()
        }
        let others: Vec<_> =
            (0..mesh.faces().len() as u32).filter(|face| sides(face, mesh) != 3).collect();
        Violation::from_elements(
            &others,
            "faces of more than three corners",
            |face: u32| format!("face {face} has {}", sides(&face, mesh)),
            |face: u32| {
                let face = mesh.faces().face(face as usize).iter();
                face.map(|&vertex| mesh.positions()[vertex as usize]).collect()
            },
        )
    }),
    Property::new("NonEmpty", "It has faces.", |mesh| {
        mesh.faces().is_empty().then(|| Violation::lack_of("faces"))
    }),
];

fn edges(
    mesh: &Mesh,
    what: &str,
    offending: impl Iterator<Item = usize>,
    ends: &[[u32; 2]],
) -> Option<Violation> {
    let offending: Vec<_> = offending.map(|edge| ends[edge]).collect();
    Violation::from_elements(
        &offending,
        what,
        |[a, b]: [u32; 2]| format!("edge {a}-{b}"),
        |ends| ends.map(|vertex: u32| mesh.positions()[vertex as usize]).to_vec(),
    )
}

/// The edges that two faces traverse in the same direction, in ascending order.
fn twisted_edges(mesh: &Mesh, edge_of: &[u32], count: usize) -> Vec<usize> {
    // For each edge, the number of faces that traverse it from the vertex with the lower index to the vertex with the higher index, and the
    // number of faces that traverse it in the opposite direction.
    let mut runs = vec![[0u8; 2]; count];
    let mut corner = 0;
    for face in mesh.faces().iter() {
        for (&from, &to) in face.iter().zip(face[1..].iter().chain(&face[..1])) {
            let run = &mut runs[edge_of[corner] as usize][usize::from(to < from)];
            *run = run.saturating_add(1);
            corner += 1;
        }
    }
    (0..count).filter(|&edge| runs[edge].iter().any(|run| 1 < *run)).collect()
}

/// The vertices whose faces are not all connected by edges at that vertex, in ascending order.
fn pinched_vertices(mesh: &Mesh) -> Vec<u32> {
    const NONE: u32 = u32::MAX;
    let edges = mesh.edges();
    let corners = mesh.faces().corners();
    let mut sets = UnionFind::new(corners.len());
    // For each edge, one corner at the end with the lower vertex index, and one corner at the other end.
    let mut known = vec![[NONE; 2]; edges.vertices.len()];
    let mut first = 0;
    for face in mesh.faces().iter() {
        for k in 0..face.len() {
            let (here, next) = (first + k, first + (k + 1) % face.len());
            let ends = &mut known[edges.of_corner[here] as usize];
            let is_down = corners[next] < corners[here];
            let [low, high] = if is_down { [next, here] } else { [here, next] };
            for (end, corner) in ends.iter_mut().zip([low as u32, high as u32]) {
                match *end {
                    NONE => *end = corner,
                    other => sets.union(other, corner),
                }
            }
        }
        first += face.len();
    }
    let mut fan = vec![NONE; mesh.positions().len()];
    let mut pinched = Vec::new();
    for (corner, &vertex) in corners.iter().enumerate() {
        let root = sets.find(corner as u32);
        match fan[vertex as usize] {
            NONE => fan[vertex as usize] = root,
            other if other != root => pinched.push(vertex),
            _ => {}
        }
    }
    pinched.sort_unstable();
    pinched.dedup();
    pinched
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::super::super::{AnyValue, Faces};
    use super::*;

    /// Returns the violations of all properties by a mesh whose vertices are on a line.
    fn violations(vertices: u32, faces: &[&[u32]]) -> Vec<String> {
        let positions: Vec<_> =
            (0..vertices).map(|x| Point3::new(f64::from(x), 0.0, 0.0)).collect();
        let sides: Vec<_> = faces.iter().map(|face| face.len()).collect();
        let faces = Faces::polygons(&sides, faces.concat()).unwrap();
        let mesh = AnyValue::new(Mesh::new(positions, faces).unwrap());
        let names = mesh.kind().properties().into_iter();
        let messages =
            names.filter_map(|(name, _)| Some(format!("{name}: {}", mesh.violation(name)?.what)));
        messages.collect()
    }

    #[test]
    fn a_tetrahedron_has_every_property() {
        assert_eq!(violations(4, &[&[0, 2, 1], &[0, 1, 3], &[0, 3, 2], &[1, 2, 3]]), [""; 0]);
    }

    #[test]
    fn violations_name_elements_and_positions() {
        let open = "Closed: has 4 edges with one face (edge 0-1, edge 1-2, edge 2-3, edge 0-3; the first is at (0.5, 0, 0))";
        let quad = "Triangles: has 1 faces of more than three corners (face 0 has 4; the first is at (1.5, 0, 0))";
        assert_eq!(violations(4, &[&[0, 1, 2, 3]]), [open, quad]);
        let fan = violations(5, &[&[0, 1, 2], &[1, 0, 3], &[0, 1, 4]]);
        assert!(fan.contains(&"Manifold: has 1 edges with more than two faces (edge 0-1; the first is at (0.5, 0, 0))".into()), "{fan:#?}");
        let twisted = violations(4, &[&[0, 1, 2], &[0, 1, 3]]);
        assert!(
            twisted.iter().any(
                |it| it.starts_with("Oriented: has 1 edges between") && it.contains("edge 0-1")
            ),
            "{twisted:#?}"
        );
        let bow = violations(5, &[&[0, 1, 2], &[0, 3, 4]]);
        assert!(bow.contains(&"Unpinched: has 1 vertices that join fans of faces (vertex 0; the first is at (0, 0, 0))".into()), "{bow:#?}");
        assert_eq!(violations(3, &[]), ["NonEmpty: has no faces"]);
    }
}
