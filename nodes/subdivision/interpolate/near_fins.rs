//! The faces of a control mesh whose surface may meet a fin.

use maquette_value::{Bounds, BoxTree, Mesh};

/// Returns the faces, ascending, whose surface may meet that around the vertices `far`, and all faces beside them, on which that surface
/// depends.
///
/// The surface of a face is in the convex hull of the control points of all faces at its corners, so only boxes of these are compared.
pub(super) fn faces_near_fins(control: &Mesh, far: &[u32]) -> Vec<u32> {
    let (faces, points) = (control.faces(), control.positions());
    let mut around_vertex: Vec<Bounds> =
        points.iter().map(|&point| Bounds { low: point, high: point }).collect();
    for face in faces.iter() {
        let corners: Vec<_> = face.iter().map(|&vertex| points[vertex as usize]).collect();
        let bounds = Bounds::from_points(&corners);
        for &vertex in face {
            let around = &mut around_vertex[vertex as usize];
            *around = around.join(&bounds);
        }
    }
    let hulls: Vec<Bounds> = faces
        .iter()
        .map(|face| {
            let first = around_vertex[face[0] as usize];
            face[1..].iter().fold(first, |hull, &vertex| hull.join(&around_vertex[vertex as usize]))
        })
        .collect();
    let mut is_far = vec![false; points.len()];
    far.iter().for_each(|&vertex| is_far[vertex as usize] = true);
    let fins = faces.iter().zip(&hulls);
    let fins = fins.filter(|(face, _)| face.iter().any(|&vertex| is_far[vertex as usize]));
    let fins = BoxTree::new(fins.map(|(_, hull)| *hull));
    let mut is_near = vec![false; points.len()];
    for (face, hull) in faces.iter().zip(&hulls) {
        let mut meets = false;
        fins.visit_overlapping(hull, |_| meets = true);
        if meets {
            face.iter().for_each(|&vertex| is_near[vertex as usize] = true);
        }
    }
    let near = (0..).zip(faces.iter());
    let near = near.filter(|(_, face)| face.iter().any(|&vertex| is_near[vertex as usize]));
    near.map(|(face, _)| face).collect()
}
