//! Comparison of the published iteration (`foot: Closest`) with `foot: Vertex`.

use super::*;

/// Returns the numbers of iterations after which the largest distance of a vertex from the surface is below 1e-3, 1e-4, 1e-5 and 1e-6 of
/// the diagonal of the mesh's bounding box.
fn counts(mesh: &Mesh, foot: Foot) -> [u64; 4] {
    let mut options = options(Solver::Plain, 1e-6);
    options.how.foot = foot;
    let found = interpolate_mesh(mesh, Scheme::Loop, &options);
    assert!(found.settled);
    let diagonal = crate::solve::extent::diagonal(mesh.positions());
    [1e-3, 1e-4, 1e-5, 1e-6].map(|share| {
        let steps = found.trace.steps();
        steps.iter().find(|step| step.max <= share * diagonal).map_or(0, |step| step.iteration)
    })
}

// The reference numbers of iterations were measured on a mesh that approximates the surface, and with other noise.
#[test]
fn both_feet_need_the_reference_numbers_of_iterations() {
    let (sphere, torus) = (add_bumps(&sphere(2)), torus(24, 12, true));
    for (name, mesh, by_vertex, closest) in [
        ("bumpy sphere", sphere.clone(), [4, 11, 18, 25], [3, 8, 14, 20]),
        ("bumpy sphere with noise", add_noise(&sphere, 0.02), [6, 14, 21, 28], [6, 12, 19, 26]),
        ("torus", torus.clone(), [1, 2, 3, 4], [1, 2, 3, 6]),
        ("torus with noise", add_noise(&torus, 0.02), [5, 11, 18, 26], [4, 9, 16, 23]),
    ] {
        for (foot, expected) in [(Foot::Vertex, by_vertex), (Foot::Closest, closest)] {
            let counts = counts(&mesh, foot);
            for (count, expected) in counts.into_iter().zip(expected) {
                let allowed = (expected * 15 / 100).max(2);
                assert!(
                    count <= expected + allowed,
                    "{name} {foot:?} {counts:?}, reference {expected}"
                );
            }
        }
    }
}
