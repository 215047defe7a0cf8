//! Tests of local updates of a refined mesh.

use maquette_node::Progress;
use maquette_value::Attribute;
use maquette_value::hash_of;
use nalgebra::Point3;

use super::super::*;
use super::shapes::*;
use super::{flat_sheet, scheme_options};
use crate::Corners;
use crate::refine::local::LocalRefinement;

/// Meshes with irregular vertices, borders, permanent and semi-sharp creases, and attributes of vertices, corners and faces.
fn meshes(scheme: Scheme) -> Vec<Mesh> {
    let faces = match scheme {
        Scheme::Loop => vec![icosahedron(), bipyramid(7), rosette(5, 3), fan(3, 3)],
        _ => vec![cube_faces(), prism(5), sheet(12, 12, false), patchwork()],
    };
    fn add_attributes(mesh: Mesh) -> Mesh {
        let edges = mesh.edges().vertices;
        let creases = edges.into_iter().step_by(4).zip([10.0, 1.5, 0.5]);
        let [vertices, faces] = [mesh.positions().len(), mesh.faces().len()];
        let corners = mesh.faces().corners().len();
        fn numbers(count: usize) -> Attribute {
            Attribute::Number((0..count).map(|k| k as f64).collect())
        }
        let uv = Attribute::Pair((0..vertices).map(|k| [k as f64 * 0.1, 0.5]).collect());
        let mesh = mesh.with_creases(creases.collect::<Vec<_>>()).unwrap();
        let mesh = mesh.with_vertex("uv", uv).unwrap();
        let mesh = mesh.with_corner("weight", numbers(corners)).unwrap();
        mesh.with_face("part", numbers(faces)).unwrap()
    }
    let mut plain: Vec<_> = faces.into_iter().map(scattered_polygons).collect();
    let flat = if scheme == Scheme::Loop { flat_sheet(12) } else { lattice(12, |_, _| 0.0) };
    // Some faces have no area. Normals there are taken from the neighboring faces, or are undefined.
    let squashed: Vec<_> = flat
        .positions()
        .iter()
        .enumerate()
        .map(|(k, position)| Point3::new(position.x, position.y * (k / 40 % 2) as f64, 0.0))
        .collect();
    plain.extend([flat.with_positions(squashed).unwrap(), flat]);
    plain.iter().cloned().chain(plain.iter().cloned().map(add_attributes)).collect()
}

fn plan(mesh: &Mesh, options: Subdivision) -> Plan {
    Plan::new(mesh, options).unwrap()
}

/// Returns the vertices that have moved; `None` if something else differs, too.
fn moved_vertices(before: &Mesh, now: &Mesh) -> Option<Vec<u32>> {
    Some(now.moved_since(before)?.vertices.into_iter().flatten().collect())
}

#[test]
fn local_updates_equal_a_full_refinement_bit_for_bit() {
    for scheme in [Scheme::Loop, Scheme::CatmullClark] {
        for (mesh, levels) in
            meshes(scheme).iter().flat_map(|mesh| (1..4).map(move |it| (mesh, it)))
        {
            for (corners, limit) in
                [(Corners::Linear, false), (Corners::Smooth, false), (Corners::Linear, true)]
            {
                let how = scheme_options(scheme, levels, limit, Boundary::EdgeAndCorner);
                let plan = plan(mesh, Subdivision { corners, ..how });
                let refined = plan.apply(mesh).unwrap();
                for vertex in
                    (0..mesh.positions().len()).step_by(mesh.positions().len().div_ceil(6))
                {
                    let mut positions = mesh.positions().to_vec();
                    positions[vertex].x += 0.25;
                    positions[vertex / 2].z -= 0.125;
                    let now = mesh.with_positions(positions).unwrap();
                    let moved = moved_vertices(mesh, &now).unwrap();
                    let followed = plan.follow(&now, &moved, &refined, &Progress::silent());
                    let followed = followed.unwrap().unwrap();
                    let whole = plan.apply(&now).unwrap();
                    assert_eq!(
                        hash_of(&followed),
                        hash_of(&whole),
                        "{scheme:?} {levels} {limit} {vertex}"
                    );
                }
            }
        }
    }
}

#[test]
fn little_is_computed_where_little_has_moved() {
    for scheme in [Scheme::Loop, Scheme::CatmullClark] {
        let mesh = match scheme {
            Scheme::Loop => flat_sheet(40),
            _ => lattice(40, |x, y| x * y),
        };
        let plan = plan(&mesh, scheme_options(scheme, 3, false, Boundary::EdgeAndCorner));
        let steps = plan.primal_steps().unwrap();
        let all = plan.apply(&mesh).unwrap().positions().len();
        let mut front = LocalRefinement::new(mesh.faces(), mesh.positions(), &[840], 0);
        front.take(&steps, &Progress::silent()).unwrap();
        let reached: usize = front.core().iter().map(ExactSizeIterator::len).sum();
        assert!(0 < reached && reached < all / 50, "{reached} of {all}");
    }
}

#[test]
fn where_more_than_places_differs_all_is_computed() {
    let mesh = scattered_polygons(bipyramid(4));
    fn uv(k: f64, mesh: &Mesh) -> Attribute {
        Attribute::Pair(vec![[k, 0.0]; mesh.positions().len()].into())
    }
    fn with_uv(k: f64, mesh: &Mesh) -> Mesh {
        mesh.clone().with_vertex("uv", uv(k, mesh)).unwrap()
    }
    assert_eq!(moved_vertices(&with_uv(0.0, &mesh), &with_uv(0.0, &mesh)), Some(vec![]));
    // 0 and -0 are equal numbers with different bits.
    assert_eq!(moved_vertices(&with_uv(0.0, &mesh), &with_uv(-0.0, &mesh)), None);
    assert_eq!(moved_vertices(&mesh, &with_uv(0.0, &mesh)), None);
    let creased = mesh.clone().with_creases([([0, 1], 2.0)]).unwrap();
    assert_eq!(moved_vertices(&mesh, &creased), None);
    assert_eq!(moved_vertices(&mesh, &mesh.clone().with_frame(None)), Some(vec![]));
    assert_eq!(moved_vertices(&mesh, &scattered_polygons(icosahedron())), None);

    fn subdivision_options(scheme: Scheme, levels: u32, boundary: Boundary) -> Subdivision {
        scheme_options(scheme, levels, false, boundary)
    }
    for how in [
        subdivision_options(Scheme::Loop, 0, Boundary::EdgeAndCorner),
        subdivision_options(Scheme::Loop, 2, Boundary::None),
        subdivision_options(Scheme::DooSabin, 2, Boundary::EdgeAndCorner),
    ] {
        let plan = plan(&mesh, how);
        let refined = plan.apply(&mesh).unwrap();
        assert_eq!(
            plan.follow(&mesh, &[], &refined, &Progress::silent()).unwrap(),
            None,
            "{how:?}"
        );
    }
}
