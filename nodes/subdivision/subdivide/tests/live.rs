//! Tests of refined meshes that are updated when control points move.

use super::super::*;
use super::scheme_options;
use super::shapes::*;
use crate::{Boundary, Scheme};

#[test]
fn updates_of_control_points_equal_a_full_refinement_bit_for_bit() {
    let triangles = [icosahedron(), bipyramid(7), rosette(5, 3), fan(3, 3)];
    let polygons = [cube_faces(), prism(5), sheet(4, 3, false), patchwork()];
    for (scheme, meshes) in [(Scheme::Loop, triangles), (Scheme::CatmullClark, polygons)] {
        for mesh in meshes.into_iter().map(scattered_polygons) {
            let edges = mesh.edges().vertices;
            let creases = edges.into_iter().step_by(4).zip([10.0, 1.5, 0.5]);
            for mesh in [mesh.clone(), mesh.with_creases(creases.collect::<Vec<_>>()).unwrap()] {
                let plan =
                    Plan::new(&mesh, scheme_options(scheme, 3, false, Boundary::EdgeAndCorner))
                        .unwrap();
                let mut live = plan.moving_vertices(&mesh).unwrap();
                assert_eq!(live.positions(), &plan.apply(&mesh).unwrap().positions()[..]);
                let mut positions = mesh.positions().to_vec();
                for vertex in (0..positions.len()).step_by(2) {
                    positions[vertex].x += 0.25;
                    positions[vertex / 2].z -= 0.125;
                    let before = live.positions().to_vec();
                    let changed = [vertex, vertex / 2].map(|k| (k as u32, positions[k]));
                    let reached = live.update(&changed);
                    let whole =
                        plan.apply(&mesh.with_positions(positions.clone()).unwrap()).unwrap();
                    assert_eq!(live.positions(), &whole.positions()[..], "{scheme:?} {vertex}");
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
    let how = |scheme| scheme_options(scheme, 2, false, Boundary::EdgeAndCorner);
    let plan = Plan::new(&mesh, how(Scheme::CatmullClark)).unwrap();
    let mut live = plan.moving_vertices(&mesh).unwrap();
    let reached = live.update(&[(200, mesh.positions()[200])]).len();
    assert!(0 < reached && reached < live.positions().len() / 10, "{reached}");
    let plan = Plan::new(&mesh, how(Scheme::DooSabin)).unwrap();
    let mut live = plan.moving_vertices(&mesh).unwrap();
    assert_eq!(live.update(&[(200, mesh.positions()[200])]).len(), live.positions().len());
    assert_eq!(live.positions(), &plan.apply(&mesh).unwrap().positions()[..]);
    let error = plan.moving_vertices(&scattered_polygons(cube_faces())).err().unwrap();
    assert_eq!(error.to_string(), "the plan was made for a mesh with another topology");
}
