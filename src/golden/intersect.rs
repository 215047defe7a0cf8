//! Self-intersections: faces of a mesh that intersect each other.

use nalgebra::Point3;

use crate::parallel::*;
use crate::value::Mesh;

struct Triangle {
    corners: [Point3<f64>; 3],
    vertices: [u32; 3],
    face: u32,
    low: [f64; 3],
    high: [f64; 3],
}

/// Pairs of faces of which an edge of one pierces the other, sorted. Faces that share a vertex are not compared, and faces that merely
/// touch, or lie in one plane, do not count.
pub(super) fn intersections(mesh: &Mesh) -> Vec<[u32; 2]> {
    let mut triangles = triangles(mesh);
    // Sweeps along x: only triangles whose boxes overlap there are compared.
    triangles.sort_by(|a, b| a.low[0].total_cmp(&b.low[0]));
    let meets = |index: usize| {
        let a = &triangles[index];
        let behind = triangles[index + 1..].iter().take_while(|b| b.low[0] <= a.high[0]);
        let pairs = behind.filter(|b| {
            let apart = |k: usize| b.high[k] < a.low[k] || a.high[k] < b.low[k];
            let neighbors = a.vertices.iter().any(|vertex| b.vertices.contains(vertex));
            !apart(1)
                && !apart(2)
                && !neighbors
                && a.face != b.face
                && (pierces(a, b) || pierces(b, a))
        });
        pairs.map(|b| [a.face.min(b.face), a.face.max(b.face)]).collect::<Vec<_>>()
    };
    let mut pairs: Vec<[u32; 2]> =
        (0..triangles.len()).into_par_iter().flat_map_iter(meets).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

fn triangles(mesh: &Mesh) -> Vec<Triangle> {
    let mut triangles = Vec::with_capacity(mesh.faces().len());
    for (index, face) in mesh.faces().iter().enumerate() {
        for k in 1..face.len() - 1 {
            let vertices = [face[0], face[k], face[k + 1]];
            let corners = vertices.map(|vertex| mesh.positions()[vertex as usize]);
            let low =
                [0, 1, 2].map(|axis| corners.iter().map(|c| c[axis]).fold(f64::INFINITY, f64::min));
            let high = [0, 1, 2]
                .map(|axis| corners.iter().map(|c| c[axis]).fold(f64::NEG_INFINITY, f64::max));
            triangles.push(Triangle { corners, vertices, face: index as u32, low, high });
        }
    }
    triangles
}

/// Whether an edge of `a` runs through the inside of `b`: its ends lie on different sides of b's plane, and all three volumes
/// between the edge and b's edges have one sign.
fn pierces(a: &Triangle, b: &Triangle) -> bool {
    let volume = |p: &Point3<f64>, q: &Point3<f64>, r: &Point3<f64>, s: &Point3<f64>| {
        (q - p).dot(&(r - p).cross(&(s - p)))
    };
    let [u, v, w] = &b.corners;
    (0..3).any(|k| {
        let (p, q) = (&a.corners[k], &a.corners[(k + 1) % 3]);
        let sides = [volume(p, u, v, w), volume(q, u, v, w)];
        if sides[0] * sides[1] >= 0.0 {
            return false;
        }
        let around = [volume(p, q, u, v), volume(p, q, v, w), volume(p, q, w, u)];
        around.iter().all(|&x| x > 0.0) || around.iter().all(|&x| x < 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::Faces;

    #[test]
    fn two_crossing_triangles_are_named_and_neighbors_are_not() {
        let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let flat = [at(0., 0., 0.), at(4., 0., 0.), at(0., 4., 0.), at(4., 4., 0.)];
        let mut positions = flat.to_vec();
        let faces = vec![[0, 1, 2], [1, 3, 2], [4, 5, 6]];
        positions.extend([at(1., 1., -1.), at(1., 1.2, 1.), at(1.3, 1., 1.)]);
        let mesh = Mesh::new(positions.clone(), Faces::triangles(faces.clone())).unwrap();
        assert_eq!(intersections(&mesh), [[0, 2]]);
        let above = positions
            .iter()
            .enumerate()
            .map(|(k, p)| if k < 4 { *p } else { p + nalgebra::Vector3::z() * 2.0 });
        let mesh = Mesh::new(above.collect::<Vec<_>>(), Faces::triangles(faces)).unwrap();
        assert!(intersections(&mesh).is_empty());
    }
}
