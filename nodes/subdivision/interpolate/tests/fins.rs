//! Surfaces with fins that cross.

use maquette_node::Progress;
use maquette_value::Faces;

use super::super::self_crossings;
use super::*;

/// A grid of triangles with edges of 1 mm. Each of the `spikes` moves a vertex.
fn grid(size: u32, spikes: &[(u32, [f64; 3])]) -> Mesh {
    let mut positions: Vec<Point3<f64>> = (0..size * size)
        .map(|k| Point3::new(f64::from(k % size), f64::from(k / size), 0.0))
        .collect();
    for (vertex, by) in spikes {
        positions[*vertex as usize] += Vector3::from(*by);
    }
    let cells = (0..size * (size - 1)).filter(|k| k % size + 1 < size);
    let faces = cells.flat_map(|a| [[a, a + 1, a + size + 1], [a, a + size + 1, a + size]]);
    Mesh::new(positions, Faces::triangles(faces.collect())).unwrap()
}

fn crossings(mesh: &Mesh) -> Option<SelfCrossings> {
    let how = InterpolateOptions::default();
    let control = interpolate_mesh(mesh, Scheme::Loop, &how).shape;
    self_crossings(mesh, &control, Scheme::Loop, &how, &Progress::silent()).unwrap()
}

#[test]
fn crossing_fins_are_named_with_their_vertex() {
    // Two fins lean towards each other. The mesh does not cross, but its surface bulges between its vertices.
    let spikes = [(44, [0.95, 0.0, 2.0]), (46, [-0.95, 0.0, 2.0])];
    assert_eq!(grid(10, &spikes).crossings(|| Ok::<_, ()>(())), Ok(vec![]));
    let found = crossings(&grid(10, &spikes)).expect("the fins cross");
    assert!([44, 45, 46].contains(&found.nearest), "{found:?}");
    let text = found.warning("vertex 44", "do something");
    assert!(text.starts_with("the surface crosses itself at ") && text.contains("near vertex 44:"));
    assert!(text.ends_with("; do something"), "{text}");
    // The way out that the node names.
    assert_eq!(crossings(&refine_mesh(&grid(10, &spikes), Scheme::Loop, 1, false)), None);
}

#[test]
fn surfaces_without_crossings_are_not_named() {
    assert_eq!(crossings(&grid(10, &[])), None);
    assert_eq!(crossings(&grid(10, &[(44, [0.0, 0.0, 4.0]), (47, [0.0, 0.0, -4.0])])), None);
}

/// The search draws only surfaces whose control points are far away. It must miss no crossing among random ones.
#[test]
fn no_crossing_of_a_rough_surface_is_missed() {
    let (mut crossing, mut plain) = (0, 0);
    for seed in 0..12 {
        let rough = add_noise(&add_bumps(&sphere(2)), 0.02 * f64::from(seed + 1));
        let how = InterpolateOptions::default();
        let control = interpolate_mesh(&rough, Scheme::Loop, &how).shape;
        let drawn = refine_mesh(&control, Scheme::Loop, 2, true);
        let truth = drawn.crossings(|| Ok::<_, ()>(())).unwrap();
        let found = self_crossings(&rough, &control, Scheme::Loop, &how, &Progress::silent());
        assert_eq!(found.unwrap().is_some(), !truth.is_empty(), "{seed}");
        crossing += usize::from(!truth.is_empty());
        plain += usize::from(truth.is_empty());
    }
    assert!(crossing > 2 && plain > 2, "{crossing} {plain}");
}
