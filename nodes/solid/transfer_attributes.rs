//! Transfers attributes from one mesh to another.

use maquette_value::{Mesh, MeshError, NearestPoint, TriangleTree};
use nalgebra::{Point3, Vector3};

/// Adds to the mesh `to` the attributes that only `from` has. Each element gets the value at the nearest point of `from`. The texture of
/// `from` is added, too, if `to` has none. `tree` is the tree of `from`, which must have faces.
pub(crate) fn transfer_attributes(
    from: &Mesh,
    tree: &TriangleTree,
    mut to: Mesh,
) -> Result<Mesh, MeshError> {
    // Used for a point whose distance overflows: such a point gets the values of the first face.
    let far = NearestPoint {
        distance_sq: f64::INFINITY,
        face: 0,
        corners: [0; 3],
        barycentric: [1.0, 0.0, 0.0],
    };
    fn nearest(
        points: &[Point3<f64>],
        far: &NearestPoint,
        tree: &TriangleTree,
    ) -> Vec<NearestPoint> {
        let found = tree.nearest_to_all(points).into_iter();
        found.map(|place| place.unwrap_or(*far)).collect()
    }
    // For each vertex of `to`, the nearest corner of the nearest triangle of `from`.
    let of_vertices: Vec<_> = nearest(to.positions(), &far, tree)
        .iter()
        .map(|place| {
            let most =
                (0..3).rev().max_by(|&a, &b| place.barycentric[a].total_cmp(&place.barycentric[b]));
            place.corners[most.expect("three corners")]
        })
        .collect();
    let vertices = of_vertices.iter().map(|&corner| from.faces().corners()[corner as usize]);
    let vertices = Vec::from_iter(vertices);
    let of_corners = to.faces().corners().iter().map(|&vertex| of_vertices[vertex as usize]);
    let of_corners = Vec::from_iter(of_corners);
    let middles = to.faces().iter().map(|face| {
        let sum: Vector3<f64> = face.iter().map(|&it| to.positions()[it as usize].coords).sum();
        Point3::from(sum / face.len() as f64)
    });
    let faces: Vec<_> =
        nearest(&Vec::from_iter(middles), &far, tree).iter().map(|place| place.face).collect();
    // Transfer texture coordinates only together with the texture; without it they are useless.
    if to.materials().is_empty() && !from.materials().is_empty() {
        to = to.without_attribute("uv").with_materials(from.materials().clone());
    }
    fn is_at(mesh: &Mesh, name: &str) -> bool {
        mesh.vertex().get(name).is_some() || mesh.corner().get(name).is_some()
    }
    let own = to.clone();
    for (name, attribute) in from.vertex().iter().filter(|(name, _)| !is_at(&own, name)) {
        to = to.with_vertex(name, attribute.select(&vertices))?;
    }
    for (name, attribute) in from.corner().iter().filter(|(name, _)| !is_at(&own, name)) {
        to = to.with_corner(name, attribute.select(&of_corners))?;
    }
    for (name, attribute) in from.face().iter().filter(|it| own.face().get(it.0).is_none()) {
        to = to.with_face(name, attribute.select(&faces))?;
    }
    Ok(to)
}
