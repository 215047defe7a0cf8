//! Refined meshes that follow their control points.

use super::super::*;
use super::shapes::*;
use super::with;
use crate::{Boundary, Scheme};

#[test]
fn what_follows_some_control_points_has_the_bits_of_the_whole_product() {
    let triangles = [icosahedron(), bipyramid(7), rosette(5, 3), fan(3, 3)];
    let polygons = [cube_faces(), prism(5), sheet(4, 3, false), patchwork()];
    for (scheme, meshes) in [(Scheme::Loop, triangles), (Scheme::CatmullClark, polygons)] {
        for mesh in meshes.into_iter().map(scattered) {
            let edges = mesh.edges().vertices;
            let creases = edges.into_iter().step_by(4).zip([10.0, 1.5, 0.5]);
            for mesh in [mesh.clone(), mesh.with_creases(Vec::from_iter(creases)).unwrap()] {
                let plan =
                    Plan::new(&mesh, with(scheme, 3, false, Boundary::EdgeAndCorner)).unwrap();
                let mut live = plan.live(&mesh).unwrap();
                assert_eq!(live.places(), &plan.apply(&mesh).unwrap().positions()[..]);
                let mut places = mesh.positions().to_vec();
                for vertex in (0..places.len()).step_by(2) {
                    places[vertex].x += 0.25;
                    places[vertex / 2].z -= 0.125;
                    let before = live.places().to_vec();
                    let changed = [vertex, vertex / 2].map(|k| (k as u32, places[k]));
                    let reached = live.update(&changed);
                    let whole = plan.apply(&mesh.with_positions(places.clone()).unwrap()).unwrap();
                    assert_eq!(live.places(), &whole.positions()[..], "{scheme:?} {vertex}");
                    fn is_reached(k: usize, reached: &[u32]) -> bool {
                        reached.binary_search(&(k as u32)).is_ok()
                    }
                    assert!(
                        (0..before.len())
                            .all(|k| is_reached(k, &reached) || before[k] == whole.positions()[k])
                    );
                }
            }
        }
    }
}

#[test]
fn one_control_point_reaches_little_and_with_doo_and_sabin_all_is_computed() {
    let mesh = lattice(20, |x, y| x * y);
    let how = |scheme| with(scheme, 2, false, Boundary::EdgeAndCorner);
    let plan = Plan::new(&mesh, how(Scheme::CatmullClark)).unwrap();
    let mut live = plan.live(&mesh).unwrap();
    let reached = live.update(&[(200, mesh.positions()[200])]).len();
    assert!(0 < reached && reached < live.places().len() / 10, "{reached}");
    let plan = Plan::new(&mesh, how(Scheme::DooSabin)).unwrap();
    let mut live = plan.live(&mesh).unwrap();
    assert_eq!(live.update(&[(200, mesh.positions()[200])]).len(), live.places().len());
    assert_eq!(live.places(), &plan.apply(&mesh).unwrap().positions()[..]);
    assert!(matches!(plan.live(&scattered(cube_faces())), Err(SubdivideError::OtherTopology)));
}
