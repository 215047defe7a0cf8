use maquette_value::Faces;

use super::*;

#[test]
fn the_trace_says_how_many_vertices_are_gone_and_how_far_they_moved() {
    let points =
        [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0.03, 0., 0.], [1., 1.04, 0.], [0., 1., 0.]];
    let points = points.map(Point3::from).to_vec();
    let mesh = Mesh::new(points, Faces::triangles(vec![[0, 1, 2], [3, 4, 5]])).unwrap();
    let welded = weld(&mesh, 0.05).unwrap();
    let trace = trace(&mesh, &welded).unwrap();
    let step = trace.steps()[0];
    assert_eq!((step.iteration, welded.mesh.positions().len()), (2, 4));
    assert!((step.max - 0.04).abs() < 1e-12 && (step.rms - 0.05 / 2f64.sqrt()).abs() < 1e-12);
    assert_eq!(weld(&mesh, 0.0).unwrap().mesh, mesh);
}
