//! Tests of crease rules, corner data, and non-manifold meshes.

use maquette_value::Attribute;
use nalgebra::Point3;

use super::super::*;
use super::scheme_options;
use super::shapes::*;
use crate::refine::manifold::manifold;
use crate::{Boundary, Corners, Creases, Scheme};

fn triangulate_fans(faces: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
    faces
        .into_iter()
        .flat_map(|face: Vec<u32>| {
            (2..face.len()).map(move |k| vec![face[0], face[k - 1], face[k]])
        })
        .collect()
}

#[test]
fn by_hoppe_an_irregular_crease_vertex_has_weights_1_3_1() {
    // The crease runs through the middle of a fan of 3 + 5 triangles on both sides of the vertex 0.
    let faces = rosette(8, 3);
    let mesh = scattered_polygons(faces).with_creases([([0, 1], 10.0), ([0, 4], 10.0)]).unwrap();
    fn subdivision_options(levels: u32) -> Subdivision {
        Subdivision {
            creases: Creases::Hoppe94,
            ..scheme_options(Scheme::Loop, levels, true, Boundary::EdgeOnly)
        }
    }
    let [c, left, right] = [0, 1, 4].map(|k| mesh.positions()[k].coords);
    let direct = subdivide(&mesh, subdivision_options(0)).unwrap().positions()[0].coords;
    // In the first step, the new vertices on the edges of the crease are the midpoints of these edges, because the ends of the crease are
    // irregular: they are on the border and have three edges.
    let once = [0.75 * c + 0.125 * (left + right), (c + left) / 2.0, (c + right) / 2.0];
    assert!((direct - (3.0 * once[0] + once[1] + once[2]) / 5.0).norm() < 1e-15);
    for levels in 1..4 {
        let later = subdivide(&mesh, subdivision_options(levels)).unwrap().positions()[0].coords;
        assert!((direct - later).norm() < 1e-14, "{levels}");
    }
}

#[test]
fn by_hoppe_the_limit_is_the_same_from_every_level() {
    for faces in [triangulate_fans(sheet(4, 4, false)), icosahedron(), rosette(5, 3), fan(7, 3)] {
        let mesh = scattered_polygons(faces);
        let edges = mesh.edges().vertices;
        let creases: Vec<_> = edges.into_iter().filter(|[a, b]| (a + b) % 3 == 0).collect();
        // Meshes in which a vertex is a dart (the end of a single crease) are avoided, because the rules give no limit at a dart.
        fn count(v: u32, creases: &[[u32; 2]]) -> usize {
            creases.iter().filter(|ends| ends.contains(&v)).count()
        }
        let lasting =
            creases.iter().filter(|ends| ends.iter().all(|&end| count(end, &creases) != 1));
        let mesh =
            mesh.with_creases(lasting.map(|&ends| (ends, 10.0)).collect::<Vec<_>>()).unwrap();
        let darts: Vec<u32> = (0..mesh.positions().len() as u32)
            .filter(|v| mesh.creases().filter(|(ends, _)| ends.contains(v)).count() == 1)
            .collect();
        fn subdivision_options(levels: u32) -> Subdivision {
            Subdivision {
                creases: Creases::Hoppe94,
                ..scheme_options(Scheme::Loop, levels, true, Boundary::EdgeAndCorner)
            }
        }
        let direct = subdivide(&mesh, subdivision_options(0)).unwrap();
        for levels in 1..4 {
            let later = subdivide(&mesh, subdivision_options(levels)).unwrap();
            for (vertex, (a, b)) in
                (0..).zip(direct.positions().iter().zip(later.positions().iter()))
            {
                let near = |dart: &u32| {
                    *dart == vertex
                        || mesh
                            .edges()
                            .vertices
                            .iter()
                            .any(|e| e.contains(dart) && e.contains(&vertex))
                };
                assert!(darts.iter().any(near) || (a - b).norm() < 1e-14, "{vertex} {levels}");
            }
        }
    }
}

#[test]
fn by_chaikin_the_sharpness_of_neighboring_edges_flows_together() {
    fn refined_sharpness(creases: Creases) -> Vec<f64> {
        let mesh = scattered_polygons(sheet(4, 4, false))
            .with_creases([([11, 12], 4.0), ([12, 13], 2.0)])
            .unwrap();
        let how = Subdivision {
            creases,
            ..scheme_options(Scheme::CatmullClark, 1, false, Boundary::EdgeOnly)
        };
        let refined = subdivide(&mesh, how).unwrap();
        let sharpness: Vec<f64> = refined.creases().map(|(_, sharpness)| sharpness).collect();
        sharpness
    }
    fn sort_sharpness(mut sharpness: Vec<f64>) -> Vec<f64> {
        sharpness.sort_by(f64::total_cmp);
        sharpness
    }
    assert_eq!(sort_sharpness(refined_sharpness(Creases::OpenSubdiv)), [1.0, 1.0, 3.0, 3.0]);
    // By Chaikin's rule, the halves at the common vertex get 3/4 4 + 1/4 2 - 1 and 3/4 2 + 1/4 4 - 1. At the ends there is no neighboring
    // crease edge.
    assert_eq!(sort_sharpness(refined_sharpness(Creases::Chaikin)), [1.0, 1.5, 2.5, 3.0]);
}

/// A sheet of two quads with a seam between them.
fn seam() -> Mesh {
    let uv =
        vec![[0.1, 0.], [0.4, 0.], [0.4, 1.], [0., 1.], [0.6, 0.], [1., 0.], [0.9, 1.], [0.6, 1.]];
    let mesh = scattered_polygons(vec![vec![0, 1, 4, 3], vec![1, 2, 5, 4]]);
    mesh.with_corner("uv", Attribute::Pair(uv.into())).unwrap()
}

/// Returns the values that each of the two old faces has at a vertex of the mesh.
fn at_vertex(mesh: &Mesh, vertex: u32) -> [Vec<[f64; 2]>; 2] {
    let (uv, corners) = (mesh.corner().pairs("uv").unwrap(), mesh.faces().corners());
    let mut sides = [vec![], vec![]];
    for position in (0..corners.len()).filter(|&position| corners[position] == vertex) {
        sides[usize::from(position >= corners.len() / 2)].push(uv[position]);
    }
    sides
}

#[test]
fn a_seam_keeps_both_texture_coordinates_with_linear_and_smooth_corners() {
    for corners in [Corners::Linear, Corners::Smooth] {
        let how = Subdivision {
            corners,
            ..scheme_options(Scheme::CatmullClark, 3, false, Boundary::EdgeAndCorner)
        };
        let refined = subdivide(&seam(), how).unwrap();
        let [left, right] = at_vertex(&refined, 4);
        assert!(!left.is_empty() && left.iter().all(|&uv| uv == [0.4, 1.]), "{left:?}");
        assert!(!right.is_empty() && right.iter().all(|&uv| uv == [0.6, 1.]), "{right:?}");
    }
}

#[test]
fn smooth_corner_data_are_as_smooth_as_places() {
    let mesh = scattered_polygons(sheet(3, 4, false));
    let positions: Vec<[f64; 3]> =
        mesh.faces().corners().iter().map(|&v| mesh.positions()[v as usize].into()).collect();
    let mesh = mesh.with_corner("place", Attribute::Vector(positions.into())).unwrap();
    for scheme in [Scheme::CatmullClark, Scheme::Loop] {
        let mesh = match scheme {
            Scheme::Loop => {
                let faces = triangulate_fans(mesh.faces().iter().map(<[u32]>::to_vec).collect());
                let positions =
                    faces.iter().flatten().map(|&v| mesh.positions()[v as usize].into());
                let positions = Attribute::Vector(positions.collect());
                scattered_polygons(faces.clone()).with_corner("place", positions).unwrap()
            }
            _ => mesh.clone(),
        };
        let how = Subdivision {
            corners: Corners::Smooth,
            ..scheme_options(scheme, 2, false, Boundary::EdgeOnly)
        };
        let refined = subdivide(&mesh, how).unwrap();
        let positions = refined.corner().vectors("place").unwrap();
        for (&corner, &position) in refined.faces().corners().iter().zip(positions.iter()) {
            assert!((refined.positions()[corner as usize] - Point3::from(position)).norm() < 1e-15);
        }
    }
}

#[test]
fn smooth_data_of_vertices_are_as_smooth_as_places_without_creases() {
    let mesh = scattered_polygons(sheet(3, 4, false));
    let positions = mesh.positions().iter().map(|&point| point.into()).collect();
    let mesh = mesh.with_vertex("place", Attribute::Vector(positions)).unwrap();
    let creased = mesh.clone().with_creases([([0, 1], 3.0), ([1, 2], 1.5)]).unwrap();
    for boundary in [Boundary::EdgeOnly, Boundary::EdgeAndCorner, Boundary::None] {
        for levels in 0..3 {
            let corners = Corners::Smooth;
            let how = Subdivision {
                corners,
                ..scheme_options(Scheme::CatmullClark, levels, false, boundary)
            };
            let plain = subdivide(&mesh, how).unwrap();
            let places = plain.vertex().vectors("place").unwrap();
            for (position, &place) in plain.positions().iter().zip(places.iter()) {
                assert!((position - Point3::from(place)).norm() < 1e-15, "{boundary:?}");
            }
            let creased = subdivide(&creased, how).unwrap();
            assert_eq!(creased.vertex().vectors("place"), Some(places), "{boundary:?} {levels}");
        }
    }
}

#[test]
fn by_doo_and_sabin_a_seam_is_not_blurred() {
    let refined =
        subdivide(&seam(), scheme_options(Scheme::DooSabin, 2, false, Boundary::EdgeOnly)).unwrap();
    let uv = refined.corner().pairs("uv").unwrap();
    assert!(uv.iter().all(|[u, _]| *u <= 0.4 || 0.6 <= *u), "{uv:?}");
}

#[test]
fn attributes_are_carried_through_polygons() {
    let mesh = scattered_polygons(vec![vec![0, 1, 2, 3]])
        .with_vertex("heat", Attribute::Number(vec![0., 4., 8., 4.].into()))
        .and_then(|m| m.with_corner("label", Attribute::Index(vec![7, 8, 9, 10].into())))
        .and_then(|m| m.with_face("part", Attribute::Index(vec![5].into())))
        .unwrap();
    let refined =
        subdivide(&mesh, scheme_options(Scheme::CatmullClark, 1, false, Boundary::EdgeOnly))
            .unwrap();
    let heat = vec![0., 4., 8., 4., 2., 6., 6., 2., 4.];
    assert_eq!(refined.vertex().get("heat"), Some(&Attribute::Number(heat.into())));
    let label = vec![7, 7, 7, 10, 8, 8, 7, 7, 9, 9, 7, 8, 10, 10, 7, 9];
    assert_eq!(refined.corner().get("label"), Some(&Attribute::Index(label.into())));
    assert_eq!(refined.face().get("part"), Some(&Attribute::Index(vec![5; 4].into())));
    let dual =
        subdivide(&mesh, scheme_options(Scheme::DooSabin, 1, false, Boundary::EdgeOnly)).unwrap();
    let heat = vec![2., 4., 6., 4., 1., 3., 5., 7., 7., 5., 3., 1.];
    assert_eq!(dual.vertex().get("heat"), Some(&Attribute::Number(heat.into())));
    assert_eq!(dual.face().get("part"), Some(&Attribute::Index(vec![5; 9].into())));
}

#[test]
fn a_non_manifold_mesh_can_be_refined_with_split() {
    let books =
        [vec![vec![0, 1, 2], vec![1, 0, 3], vec![0, 1, 4]], vec![vec![0, 1, 2], vec![0, 3, 4]]];
    for faces in books {
        for scheme in [Scheme::Loop, Scheme::CatmullClark, Scheme::DooSabin] {
            let (mesh, how) = (
                scattered_polygons(faces.clone()),
                scheme_options(scheme, 2, true, Boundary::EdgeOnly),
            );
            let error = subdivide(&mesh, how).unwrap_err().to_string();
            assert!(error.starts_with("the mesh is not a surface"), "{error}");
            assert!(subdivide(&manifold(&mesh).unwrap(), how).is_ok());
        }
    }
}

#[test]
fn a_plan_for_another_topology_is_an_error() {
    let how = scheme_options(Scheme::CatmullClark, 1, false, Boundary::EdgeOnly);
    let plan = Plan::new(&cube(), how).unwrap();
    assert!(plan.apply(&cube()).is_ok());
    let creased = cube().with_creases([([0, 1], 2.0)]).unwrap();
    for other in [creased, scattered_polygons(tetrahedron())] {
        let error = plan.apply(&other).unwrap_err();
        assert_eq!(error.to_string(), "the plan was made for a mesh with another topology");
    }
}

#[test]
fn a_face_that_is_too_large_for_a_limit_is_an_error() {
    let count = 20_000;
    let mesh = scattered_polygons(vec![(0..count).collect()]);
    fn how(limit: bool) -> Subdivision {
        scheme_options(Scheme::CatmullClark, u32::from(!limit), limit, Boundary::EdgeOnly)
    }
    let error = subdivide(&mesh, how(true)).unwrap_err().to_string();
    assert!(error.contains("about 400 000 000 numbers"), "{error}");
    assert_eq!(subdivide(&mesh, how(false)).unwrap().faces().len(), 20_000);
    let dual = scheme_options(Scheme::DooSabin, 1, false, Boundary::EdgeOnly);
    assert_eq!(subdivide(&mesh, dual).unwrap().faces().len(), 1 + 2 * 20_000);
}
