use super::*;
use crate::shapes::torus;
use crate::sharp_edges::crease;
use crate::{Corners, Subdivision, subdivide};

/// The sharp edges of a refined mesh are in no particular order, so each must be found again in the next step.
#[test]
fn the_composed_surface_is_the_subdivided_one_with_its_creases() {
    // Edges whose faces meet at a larger angle are sharp: with these angles, some edges, all edges, and no edges.
    for angle in [60.0, 0.0, 180.0] {
        let mesh = crease(&torus(6, 5, true), angle, 10.0);
        for levels in 0..4 {
            let how = Subdivision {
                scheme: Scheme::Loop,
                levels,
                limit: true,
                boundary: Boundary::default(),
                creases: Creases::default(),
                corners: Corners::default(),
            };
            let expected = subdivide(&mesh, how).unwrap();
            let surface =
                ComposedLimit::new(&mesh, levels).unwrap().surface(mesh.positions()).unwrap();
            let pairs = surface.positions().iter().zip(expected.positions().iter());
            let farthest = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(farthest < 1e-12, "{levels} levels, {angle} degrees: {farthest}");
        }
    }
}
