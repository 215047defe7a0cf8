//! What is made of the mesh refined before.

use maquette_node::Progress;
use maquette_value::Attribute;
use maquette_value::hash_of;
use nalgebra::Point3;

use super::super::*;
use super::shapes::*;
use super::{flat_sheet, with};
use crate::Corners;
use crate::refine::local::Front;

/// Meshes with irregular vertices, borders, creases that last and soften, and attributes at vertices, corners and faces.
fn meshes(scheme: Scheme) -> Vec<Mesh> {
    let faces = match scheme {
        Scheme::Loop => vec![icosahedron(), bipyramid(7), rosette(5, 3), fan(3, 3)],
        _ => vec![cube_faces(), prism(5), sheet(12, 12, false), patchwork()],
    };
    fn decorated(mesh: Mesh) -> Mesh {
        let edges = mesh.edges().vertices;
        let creases = edges.into_iter().step_by(4).zip([10.0, 1.5, 0.5]);
        let [vertices, faces] = [mesh.positions().len(), mesh.faces().len()];
        let corners = mesh.faces().corners().len();
        fn numbers(count: usize) -> Attribute {
            Attribute::Number((0..count).map(|k| k as f64).collect())
        }
        let uv = Attribute::Pair((0..vertices).map(|k| [k as f64 * 0.1, 0.5]).collect());
        let mesh = mesh.with_creases(Vec::from_iter(creases)).unwrap();
        let mesh = mesh.with_vertex("uv", uv).unwrap();
        let mesh = mesh.with_corner("weight", numbers(corners)).unwrap();
        mesh.with_face("part", numbers(faces)).unwrap()
    }
    let mut plain: Vec<_> = faces.into_iter().map(scattered).collect();
    let flat = if scheme == Scheme::Loop { flat_sheet(12) } else { lattice(12, |_, _| 0.0) };
    // Without an area here and there: normals are those of the faces around, or none.
    let squashed: Vec<_> = flat
        .positions()
        .iter()
        .enumerate()
        .map(|(k, place)| Point3::new(place.x, place.y * (k / 40 % 2) as f64, 0.0))
        .collect();
    plain.extend([flat.with_positions(squashed).unwrap(), flat]);
    plain.iter().cloned().chain(plain.iter().cloned().map(decorated)).collect()
}

fn plan(mesh: &Mesh, how: Subdivision) -> Plan {
    Plan::new(mesh, how).unwrap()
}

/// The vertices that have moved, if nothing else differs.
fn moved(before: &Mesh, now: &Mesh) -> Option<Vec<u32>> {
    Some(now.moved_since(before)?.vertices.into_iter().flatten().collect())
}

#[test]
fn what_follows_the_mesh_refined_before_has_the_bits_of_the_whole_product() {
    for scheme in [Scheme::Loop, Scheme::CatmullClark] {
        for (mesh, levels) in
            meshes(scheme).iter().flat_map(|mesh| (1..4).map(move |it| (mesh, it)))
        {
            for (corners, limit) in
                [(Corners::Linear, false), (Corners::Smooth, false), (Corners::Linear, true)]
            {
                let how = with(scheme, levels, limit, Boundary::EdgeAndCorner);
                let plan = plan(mesh, Subdivision { corners, ..how });
                let refined = plan.apply(mesh).unwrap();
                for vertex in
                    (0..mesh.positions().len()).step_by(mesh.positions().len().div_ceil(6))
                {
                    let mut places = mesh.positions().to_vec();
                    places[vertex].x += 0.25;
                    places[vertex / 2].z -= 0.125;
                    let now = mesh.with_positions(places).unwrap();
                    let moved = moved(mesh, &now).unwrap();
                    let followed = plan.follow(&now, &moved, &refined, &Progress::none());
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
        let plan = plan(&mesh, with(scheme, 3, false, Boundary::EdgeAndCorner));
        let steps = plan.primal_steps().unwrap();
        let all = plan.apply(&mesh).unwrap().positions().len();
        let mut front = Front::new(mesh.faces(), mesh.positions(), &[840], 0);
        front.take(&steps, &Progress::none()).unwrap();
        let reached: usize = front.core().iter().map(ExactSizeIterator::len).sum();
        assert!(0 < reached && reached < all / 50, "{reached} of {all}");
    }
}

#[test]
fn where_more_than_places_differs_all_is_computed() {
    let mesh = scattered(bipyramid(4));
    fn uv(k: f64, mesh: &Mesh) -> Attribute {
        Attribute::Pair(vec![[k, 0.0]; mesh.positions().len()].into())
    }
    fn with_uv(k: f64, mesh: &Mesh) -> Mesh {
        mesh.clone().with_vertex("uv", uv(k, mesh)).unwrap()
    }
    assert_eq!(moved(&with_uv(0.0, &mesh), &with_uv(0.0, &mesh)), Some(vec![]));
    // Equal numbers, other bytes.
    assert_eq!(moved(&with_uv(0.0, &mesh), &with_uv(-0.0, &mesh)), None);
    assert_eq!(moved(&mesh, &with_uv(0.0, &mesh)), None);
    let creased = mesh.clone().with_creases([([0, 1], 2.0)]).unwrap();
    assert_eq!(moved(&mesh, &creased), None);
    assert_eq!(moved(&mesh, &mesh.clone().with_frame(None)), Some(vec![]));
    assert_eq!(moved(&mesh, &scattered(icosahedron())), None);

    fn how(scheme: Scheme, levels: u32, boundary: Boundary) -> Subdivision {
        with(scheme, levels, false, boundary)
    }
    for how in [
        how(Scheme::Loop, 0, Boundary::EdgeAndCorner),
        how(Scheme::Loop, 2, Boundary::None),
        how(Scheme::DooSabin, 2, Boundary::EdgeAndCorner),
    ] {
        let plan = plan(&mesh, how);
        let refined = plan.apply(&mesh).unwrap();
        assert_eq!(plan.follow(&mesh, &[], &refined, &Progress::none()).unwrap(), None, "{how:?}");
    }
}
