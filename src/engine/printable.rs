//! Checks that a mesh can be 3D-printed: it must be the closed surface of a solid whose material is thick enough everywhere.

use maquette_value::{AnyValue, Backing, Mesh, TriangleTree};

use super::defects::Defect;
use super::digits::six_digits;
use super::expect::{check_closed, check_manifold, check_no_self_intersection};

/// The maximum number of positions of a defect that are reported.
const MAX_POSITIONS: usize = 1000;

/// The maximum number of violating faces that an error message names.
const MAX_NAMED: usize = 5;

/// Checks that a mesh is the surface of a solid: closed, manifold, without self-intersections, and with normals that point outward. Also
/// checks that the solid is at least `thickness` mm thick at each face. The thickness is measured from the center of the face straight
/// inward.
pub(super) fn check_printable(mesh: &Mesh, thickness: f64) -> Defect {
    if mesh.faces().is_empty() {
        return Some(("has no faces".into(), Vec::new()));
    }
    fn check_unpinched(mesh: &Mesh) -> Option<(String, Vec<nalgebra::Point3<f64>>)> {
        let violation = AnyValue::new(mesh.clone()).violation("Unpinched")?;
        let places = violation.elements.iter().map(|element| element.center());
        Some((violation.what, places.collect()))
    }
    let wrong = [
        check_closed(mesh),
        check_manifold(mesh),
        check_unpinched(mesh),
        check_no_self_intersection(mesh),
    ];
    let wrong = wrong.into_iter().flatten();
    let (what, places): (Vec<String>, Vec<Vec<_>>) = wrong.unzip();
    if !what.is_empty() {
        return Some((what.join(", "), places.concat()));
    }
    check_walls(mesh, thickness)
}

fn check_walls(mesh: &Mesh, thickness: f64) -> Defect {
    let behind = mesh.backings(&TriangleTree::new(mesh));
    fn middle(face: usize, mesh: &Mesh) -> nalgebra::Point3<f64> {
        mesh.first_triangle_center(mesh.faces().face(face))
    }
    fn describe(
        offending: &[usize],
        what: &str,
        mesh: &Mesh,
    ) -> (String, Vec<nalgebra::Point3<f64>>) {
        let names =
            offending.iter().take(MAX_NAMED).map(usize::to_string).collect::<Vec<_>>().join(", ");
        let more = if MAX_NAMED < offending.len() { ", .." } else { "" };
        let places = offending.iter().take(MAX_POSITIONS).map(|&face| middle(face, mesh));
        let faces = if offending.len() == 1 { "face" } else { "faces" };
        let why = format!("has {} {faces} {what} ({faces} {names}{more}", offending.len());
        (why, Vec::from_iter(places))
    }
    let inward: Vec<_> =
        (0..behind.len()).filter(|&face| behind[face] == Backing::Outside).collect();
    if let Some(&first) = inward.first() {
        let (why, places) = describe(&inward, "with inward normals", mesh);
        let at = middle(first, mesh);
        let place = [at.x, at.y, at.z].map(six_digits).join(", ");
        return Some((format!("{why}; the first is at ({place}))"), places));
    }
    let thin = behind.iter().enumerate().filter_map(|(face, behind)| match behind {
        Backing::Wall(distance) if *distance < thickness * (1.0 - 1e-9) => Some((face, *distance)),
        _ => None,
    });
    let thin = Vec::from_iter(thin);
    let &(worst, distance) = thin.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let what = format!("with walls thinner than {} mm", six_digits(thickness));
    let (why, places) =
        describe(&thin.iter().map(|(face, _)| *face).collect::<Vec<_>>(), &what, mesh);
    let at = middle(worst, mesh);
    let place = [at.x, at.y, at.z].map(six_digits).join(", ");
    Some((
        format!("{why}; the thinnest is {worst} at ({place}), {} mm)", six_digits(distance)),
        places,
    ))
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::{Point3, Vector3};

    use super::*;

    /// Creates a box of this size, with a corner at the origin.
    fn cuboid(size: [f64; 3]) -> Mesh {
        let faces =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = Faces::uniform(4, faces.as_flattened().to_vec()).unwrap();
        Mesh::new(
            (0..8)
                .map(|k: usize| {
                    Point3::from([0, 1, 2].map(|axis| size[axis] * (k >> axis & 1) as f64))
                })
                .collect::<Vec<_>>(),
            faces,
        )
        .unwrap()
    }

    fn defect(mesh: &Mesh, thickness: f64) -> String {
        check_printable(mesh, thickness).map_or_else(String::new, |(why, _)| why)
    }

    #[test]
    fn wall_thickness_is_measured_inward_from_each_face() {
        let plate = cuboid([20.0, 10.0, 1.0]);
        assert_eq!(defect(&plate, 1.0), "");
        assert_eq!(
            defect(&plate, 1.2),
            "has 2 faces with walls thinner than 1.2 mm (faces 0, 1; the thinnest is 0 at (6.66667, 6.66667, 0), 1 mm)"
        );
        assert_eq!(check_printable(&plate, 1.2).unwrap().1.len(), 2);
    }

    #[test]
    fn faces_that_meet_at_an_edge_are_not_a_thin_wall() {
        // A roof (a prism with a triangular cross section) whose sides are inclined by 50 degrees to the floor.
        let height = 5.0 * libm::tan(50f64.to_radians());
        let roof = [
            [0., 0., 0.],
            [10., 0., 0.],
            [0., 90., 0.],
            [10., 90., 0.],
            [5., 0., height],
            [5., 90., height],
        ];
        let faces = [&[0, 2, 3, 1][..], &[0, 4, 5, 2], &[1, 3, 5, 4], &[0, 1, 4], &[2, 5, 3]];
        let sides = faces.map(<[u32]>::len);
        let faces = Faces::polygons(&sides, faces.concat()).unwrap();
        let roof = Mesh::new(roof.map(Point3::from).to_vec(), faces).unwrap();
        assert_eq!(defect(&roof, 4.0), "");
    }

    #[test]
    fn inverted_open_and_crossing_meshes_are_reported_with_positions() {
        let solid = cuboid([4.0; 3]);
        let inside_out = solid.with_positions(
            solid.positions().iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect(),
        );
        let text = defect(&inside_out.unwrap(), 1.0);
        assert!(
            text.starts_with(
                "has 6 faces with inward normals (faces 0, 1, 2, 3, 4, ..; the first is at ("
            ),
            "{text}"
        );
        let open = Mesh::new(
            solid.positions().clone(),
            Faces::uniform(4, solid.faces().corners()[..20].to_vec()).unwrap(),
        );
        let text = defect(&open.unwrap(), 1.0);
        assert!(text.starts_with("has 4 edges with one face (vertices "), "{text}");
        let both = solid
            .positions()
            .iter()
            .copied()
            .chain(solid.positions().iter().map(|p| p + Vector3::new(2., 1., 1.)));
        let corners = solid.faces().corners().iter();
        let corners = corners.clone().copied().chain(corners.map(|k| k + 8));
        let crossing = Mesh::new(
            both.collect::<Vec<_>>(),
            Faces::uniform(4, corners.collect::<Vec<_>>()).unwrap(),
        )
        .unwrap();
        let text = defect(&crossing, 0.0);
        assert!(text.contains("of intersecting faces"), "{text}");
        let nothing = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
        assert_eq!(defect(&nothing, 1.0), "has no faces");
    }

    #[test]
    fn a_flat_mesh_and_a_single_face_are_open() {
        let one = Mesh::new(
            vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)],
            Faces::triangles(vec![[0, 1, 2]]),
        );
        assert!(defect(&one.unwrap(), 0.0).starts_with("has 3 edges with one face"));
    }

    #[test]
    fn the_result_does_not_depend_on_the_number_of_threads() {
        let plate = cuboid([20.0, 10.0, 1.0]);
        fn defect_with_threads(threads: usize, plate: &Mesh) -> String {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| defect(plate, 1.2))
        }
        assert_eq!(defect_with_threads(1, &plate), defect_with_threads(3, &plate));
    }
}
