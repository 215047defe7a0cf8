//! Whether a printer can make a mesh: a solid with walls that are thick enough.

use maquette_value::{AnyValue, Behind, Mesh, TriangleTree};

use super::expect::{closed, manifold, no_self_intersection};
use super::looks::Wrong;
use super::six::six;

/// How many places are reported.
const PLACES: usize = 1000;

/// How many offending faces are named.
const NAMED: usize = 5;

/// Checks that a mesh is the skin of a solid: closed, manifold, without faces that run through each other, its outside outside; and that
/// what lies behind each face, straight in from its middle, is at least so far away, in mm.
pub(super) fn printable(mesh: &Mesh, thickness: f64) -> Wrong {
    if mesh.faces().is_empty() {
        return Some(("has no faces".into(), Vec::new()));
    }
    fn pinched(mesh: &Mesh) -> Option<(String, Vec<nalgebra::Point3<f64>>)> {
        let offence = AnyValue::new(mesh.clone()).offence("Unpinched")?;
        let places = offence.elements.iter().map(|element| element.place());
        Some((offence.what, places.collect()))
    }
    let wrong = [closed(mesh), manifold(mesh), pinched(mesh), no_self_intersection(mesh)];
    let wrong = wrong.into_iter().flatten();
    let (what, places): (Vec<String>, Vec<Vec<_>>) = wrong.unzip();
    if !what.is_empty() {
        return Some((what.join(", "), places.concat()));
    }
    walls(mesh, thickness)
}

fn walls(mesh: &Mesh, thickness: f64) -> Wrong {
    let behind = mesh.behind(&TriangleTree::new(mesh));
    fn middle(face: usize, mesh: &Mesh) -> nalgebra::Point3<f64> {
        mesh.first_middle(mesh.faces().face(face))
    }
    fn told(offending: &[usize], what: &str, mesh: &Mesh) -> (String, Vec<nalgebra::Point3<f64>>) {
        let names =
            offending.iter().take(NAMED).map(usize::to_string).collect::<Vec<_>>().join(", ");
        let more = if NAMED < offending.len() { ", .." } else { "" };
        let places = offending.iter().take(PLACES).map(|&face| middle(face, mesh));
        let faces = if offending.len() == 1 { "face" } else { "faces" };
        let why = format!("has {} {faces} {what} ({faces} {names}{more}", offending.len());
        (why, Vec::from_iter(places))
    }
    let inward: Vec<_> =
        (0..behind.len()).filter(|&face| behind[face] == Behind::Outside).collect();
    if let Some(&first) = inward.first() {
        let (why, places) = told(&inward, "that look inward", mesh);
        let at = middle(first, mesh);
        let place = [at.x, at.y, at.z].map(six).join(", ");
        return Some((format!("{why}; the first is at ({place}))"), places));
    }
    let thin = behind.iter().enumerate().filter_map(|(face, behind)| match behind {
        Behind::Wall(distance) if *distance < thickness * (1.0 - 1e-9) => Some((face, *distance)),
        _ => None,
    });
    let thin = Vec::from_iter(thin);
    let &(worst, distance) = thin.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let what = format!("with a wall of less than {} mm behind them", six(thickness));
    let (why, places) = told(&thin.iter().map(|(face, _)| *face).collect::<Vec<_>>(), &what, mesh);
    let at = middle(worst, mesh);
    let place = [at.x, at.y, at.z].map(six).join(", ");
    Some((format!("{why}; the thinnest is {worst} at ({place}), {} mm)", six(distance)), places))
}

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::{Point3, Vector3};

    use super::*;

    /// A box from the origin.
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

    fn told(mesh: &Mesh, thickness: f64) -> String {
        printable(mesh, thickness).map_or_else(String::new, |(why, _)| why)
    }

    #[test]
    fn a_wall_is_as_thick_as_what_lies_behind_its_faces() {
        let plate = cuboid([20.0, 10.0, 1.0]);
        assert_eq!(told(&plate, 1.0), "");
        assert_eq!(
            told(&plate, 1.2),
            "has 2 faces with a wall of less than 1.2 mm behind them (faces 0, 1; the thinnest is 0 at (6.66667, 6.66667, 0), 1 mm)"
        );
        assert_eq!(printable(&plate, 1.2).unwrap().1.len(), 2);
    }

    #[test]
    fn where_faces_meet_at_an_edge_is_no_wall() {
        // A roof whose sides stand at 50 degrees on the floor.
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
        assert_eq!(told(&roof, 4.0), "");
    }

    #[test]
    fn what_is_inside_out_open_or_crossing_is_told_with_places() {
        let solid = cuboid([4.0; 3]);
        let inside_out = solid.with_positions(
            solid.positions().iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect(),
        );
        let text = told(&inside_out.unwrap(), 1.0);
        assert!(
            text.starts_with(
                "has 6 faces that look inward (faces 0, 1, 2, 3, 4, ..; the first is at ("
            ),
            "{text}"
        );
        let open = Mesh::new(
            solid.positions().clone(),
            Faces::uniform(4, solid.faces().corners()[..20].to_vec()).unwrap(),
        );
        let text = told(&open.unwrap(), 1.0);
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
        let text = told(&crossing, 0.0);
        assert!(text.contains("of faces that run through each other"), "{text}");
        let nothing = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
        assert_eq!(told(&nothing, 1.0), "has no faces");
    }

    #[test]
    fn a_flat_mesh_and_a_face_by_itself_are_open() {
        let one = Mesh::new(
            vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)],
            Faces::triangles(vec![[0, 1, 2]]),
        );
        assert!(told(&one.unwrap(), 0.0).starts_with("has 3 edges with one face"));
    }

    #[test]
    fn it_is_the_same_for_any_number_of_threads() {
        let plate = cuboid([20.0, 10.0, 1.0]);
        fn judged(threads: usize, plate: &Mesh) -> String {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| told(plate, 1.2))
        }
        assert_eq!(judged(1, &plate), judged(3, &plate));
    }
}
