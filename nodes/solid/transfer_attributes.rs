//! Transfers attributes from one mesh to another.

use std::collections::BTreeMap;

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::stencils::Stencils;
use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Mesh, MeshError, NearestPoint, TriangleTree};
use nalgebra::{Point3, Vector3};

/// Adds to the mesh `to` the attributes that only `from` has, interpolated at the nearest point of `from`. Corner attributes have seams:
/// all corners of a face get the values of the seam's side on which the nearest point of the face's middle is. Face attributes come from
/// the face that is nearest to the middle. The texture of `from` is added, too, if `to` has none. `tree` is the tree of `from`, which must
/// have faces.
pub(crate) fn transfer_attributes(
    from: &Mesh,
    tree: &TriangleTree,
    mut to: Mesh,
) -> Result<Mesh, MeshError> {
    // Transfer texture coordinates only together with the texture; without it they are useless.
    if to.materials().is_empty() && !from.materials().is_empty() {
        to = to.without_attribute("uv").with_materials(from.materials().clone());
    }
    fn has(mesh: &Mesh, name: &str) -> bool {
        mesh.vertex().get(name).is_some() || mesh.corner().get(name).is_some()
    }
    let own = to.clone();
    let is_missing = |(name, _): (&str, _)| !has(&own, name);
    let has_faces = from.face().iter().any(|(name, _)| own.face().get(name).is_none());
    if !has_faces && !from.vertex().iter().any(is_missing) && !from.corner().iter().any(is_missing)
    {
        return Ok(to);
    }
    let of_vertices = nearest(tree, own.positions());
    let middles = own.faces().iter().map(|face| {
        let sum: Vector3<f64> = face.iter().map(|&it| own.positions()[it as usize].coords).sum();
        Point3::from(sum / face.len() as f64)
    });
    let of_faces = nearest(tree, &middles.collect::<Vec<_>>());
    if from.vertex().iter().any(|(name, _)| !has(&own, name)) {
        let corners = from.faces().corners();
        let mixed = stencils(&of_vertices, |corner| corners[corner as usize]);
        for (name, attribute) in from.vertex().iter().filter(|(name, _)| !has(&own, name)) {
            to = to.with_vertex(name, mixed.attribute(attribute))?;
        }
    }
    if from.corner().iter().any(|(name, _)| !has(&own, name)) {
        let mixed = stencils(&on_sides(from, &own, &of_vertices, &of_faces), |corner| corner);
        for (name, attribute) in from.corner().iter().filter(|(name, _)| !has(&own, name)) {
            to = to.with_corner(name, mixed.attribute(attribute))?;
        }
    }
    let faces: Vec<_> = of_faces.iter().map(|place| place.face).collect();
    for (name, attribute) in from.face().iter().filter(|it| own.face().get(it.0).is_none()) {
        to = to.with_face(name, attribute.select(&faces))?;
    }
    Ok(to)
}

/// Returns the nearest place of a mesh for each point. A point whose distance overflows gets the first corner.
fn nearest(tree: &TriangleTree, points: &[Point3<f64>]) -> Vec<NearestPoint> {
    let far = NearestPoint {
        distance_sq: f64::INFINITY,
        face: 0,
        corners: [0; 3],
        barycentric: [1.0, 0.0, 0.0],
    };
    tree.nearest_to_all(points).into_iter().map(|place| place.unwrap_or(far)).collect()
}

/// Returns a matrix with a row for each place: the weights of the elements at the corners of its triangle.
fn stencils(places: &[NearestPoint], element: impl Fn(u32) -> u32) -> Stencils {
    let starts = (0..=places.len() as u32).map(|place| 3 * place).collect();
    let indices = places.iter().flat_map(|place| place.corners.map(&element)).collect();
    let weights = places.iter().flat_map(|place| place.barycentric).collect();
    Stencils::from_parts(starts, indices, weights)
}

/// Returns the nearest place for each corner of `to`, on the side of the seams on which the middle of the corner's face is.
fn on_sides(
    from: &Mesh,
    to: &Mesh,
    of_vertices: &[NearestPoint],
    of_faces: &[NearestPoint],
) -> Vec<NearestPoint> {
    let charts = charts(from);
    fn chart(place: &NearestPoint, charts: &[u32]) -> u32 {
        charts[place.face as usize]
    }
    let mut places = Vec::with_capacity(to.faces().corners().len());
    // The corners whose nearest place is on another side, by chart.
    let mut others: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (face, middle) in to.faces().iter().zip(of_faces) {
        for &vertex in face {
            let place = of_vertices[vertex as usize];
            if chart(&place, &charts) != chart(middle, &charts) {
                others.entry(chart(middle, &charts)).or_default().push(places.len());
            }
            places.push(place);
        }
    }
    let mut faces: BTreeMap<u32, Vec<u32>> = others.keys().map(|&it| (it, Vec::new())).collect();
    for (face, chart) in (0..).zip(&charts) {
        if let Some(faces) = faces.get_mut(chart) {
            faces.push(face);
        }
    }
    for (chart, corners) in others {
        let faces = &faces[&chart];
        let vertices = corners.iter().map(|&corner| to.faces().corners()[corner]);
        let points: Vec<_> = vertices.map(|it| to.positions()[it as usize]).collect();
        let part = from.select(faces);
        for (corner, mut place) in
            corners.into_iter().zip(nearest(&TriangleTree::new(&part), &points))
        {
            let face = faces[place.face as usize];
            let first = from.faces().first_corner(face as usize) as u32;
            let own = part.faces().first_corner(place.face as usize) as u32;
            place.corners = place.corners.map(|corner| corner - own + first);
            places[corner] = NearestPoint { face, ..place };
        }
    }
    places
}

/// Returns for each face the number of its chart: a set of faces that are joined by edges at which no corner attribute has a seam.
fn charts(mesh: &Mesh) -> Vec<u32> {
    let (faces, edges) = (mesh.faces(), mesh.edges());
    let mut charts = UnionFind::new(faces.len());
    let mut older: Vec<Option<(u32, [usize; 2])>> = vec![None; edges.vertices.len()];
    for face in 0..faces.len() {
        let (first, count) = (faces.first_corner(face), faces.face(face).len());
        for k in 0..count {
            let ends = [first + k, first + (k + 1) % count];
            let edge = edges.of_corner[first + k] as usize;
            let Some((other, mut others)) = older[edge].replace((face as u32, ends)) else {
                continue;
            };
            fn vertex(corner: usize, faces: &maquette_value::Faces) -> u32 {
                faces.corners()[corner]
            }
            if vertex(others[0], faces) != vertex(ends[0], faces) {
                others.reverse();
            }
            let is_seam = mesh.corner().iter().any(|(name, attribute)| {
                name != "normal" && (0..2).any(|k| !attribute.is_same(ends[k], others[k]))
            });
            if !is_seam {
                charts.union(other, face as u32);
            }
        }
    }
    charts.into_labels().0
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces};

    use super::*;

    /// Returns a grid of n x n cells of two triangles over 8 x 8 mm at the given height.
    fn grid(n: u32, height: f64) -> Mesh {
        let width = n + 1;
        fn place(k: u32, n: u32) -> f64 {
            f64::from(k) * 8.0 / f64::from(n)
        }
        let positions: Vec<_> = (0..width * width)
            .map(|k| Point3::new(place(k % width, n), place(k / width, n), height))
            .collect();
        let cells = (0..n * n).map(|k| k % n + k / n * width);
        let faces = cells.flat_map(|k| [[k, k + 1, k + width + 1], [k, k + width + 1, k + width]]);
        Mesh::new(positions, Faces::triangles(faces.collect())).unwrap()
    }

    #[test]
    fn corners_are_interpolated_on_the_side_of_the_seam_of_their_face() {
        let from = grid(4, 0.0);
        // The seam is at x = 4 mm: texture coordinates are 100 larger beyond it.
        let uv = from.faces().iter().flat_map(|face| {
            let places = [0, 1, 2].map(|k| from.positions()[face[k] as usize]);
            let beyond = places.iter().any(|at| 4.0 < at.x);
            places.map(|at| [at.x + if beyond { 100.0 } else { 0.0 }, at.y])
        });
        let uv: Vec<_> = uv.collect();
        let from = from.with_corner("uv", Attribute::Pair(uv.into())).unwrap();
        let heights = from.positions().iter().map(|at| 3.0 * at.x - at.y).collect::<Vec<_>>();
        let from = from.with_vertex("sum", Attribute::Number(heights.into())).unwrap();

        let to = transfer_attributes(&from, &TriangleTree::new(&from), grid(11, 0.7)).unwrap();
        let uv = to.corner().pairs("uv").unwrap();
        for (face, uv) in to.faces().iter().zip(uv.chunks(3)) {
            let places = [0, 1, 2].map(|k| to.positions()[face[k] as usize]);
            let middle = places.iter().map(|at| at.x).sum::<f64>() / 3.0;
            for (at, [u, v]) in places.iter().zip(uv) {
                // A corner on the other side of the seam has the values of the nearest place on this side.
                let expected = if 4.0 < middle { at.x.max(4.0) + 100.0 } else { at.x.min(4.0) };
                assert!((u - expected).abs() < 1e-9 && (v - at.y).abs() < 1e-9, "{at} {u} {v}");
            }
        }
        let Some(Attribute::Number(sums)) = to.vertex().get("sum") else { panic!("no numbers") };
        for (at, sum) in to.positions().iter().zip(sums.iter()) {
            assert!((sum - (3.0 * at.x - at.y)).abs() < 1e-9);
        }
    }
}
