//! The bending energy of fills, a measure of fairness.

use maquette_base::topology::lists::Lists;
use nalgebra::Vector3;

use super::plain::hole_fill::HoleFill;
use super::triangles::filling::Filling;

/// Returns the bending energy of each fill: the sum of A (2 H)^2 over its vertices, those at the rim included. A is a third of the area of
/// the faces around a vertex, and 2 H the length of its mean curvature vector, which is the sum of (cot a + cot b) / 2 times the spokes to
/// its neighbors, divided by A: Meyer, Desbrun, Schröder and Barr, "Discrete differential-geometry operators for triangulated 2-manifolds"
/// (2003), equation 8, with barycentric areas. Faces without area do not count.
pub(crate) fn bending_energies(filling: &Filling, fills: &[HoleFill]) -> Vec<f64> {
    let mut end = filling.n_data_faces;
    let ranges: Vec<_> = (fills.iter())
        .map(|fill| {
            let start = end;
            end += fill.triangulation.compact().0.len();
            start..end
        })
        .collect();
    let mut is_filled = vec![false; filling.points.len()];
    filling.faces[filling.n_data_faces..]
        .iter()
        .flatten()
        .for_each(|&v| is_filled[v as usize] = true);
    let around = Lists::group(filling.points.len(), || {
        let corners = filling.faces.iter().flat_map(|face| {
            (0..3).map(move |k| (face[k], [face[(k + 1) % 3], face[(k + 2) % 3]]))
        });
        corners.filter(|(vertex, _)| is_filled[*vertex as usize])
    });
    let energy = |vertex: u32| {
        let own = filling.point(vertex);
        let (mut sum, mut area) = (Vector3::zeros(), 0.0);
        for ends in around.list(vertex as usize) {
            let [u, v] = ends.map(|end| filling.point(end) - own);
            let double = u.cross(&v).norm();
            if double > 0.0 {
                // The cotangent at each end weighs the spoke to the other end.
                sum += (u * (u - v).dot(&-v) + v * (v - u).dot(&-u)) / (2.0 * double);
                area += double / 6.0;
            }
        }
        if area > 0.0 { sum.norm_squared() / area } else { 0.0 }
    };
    ranges
        .into_iter()
        .map(|faces| {
            let mut vertices: Vec<u32> = filling.faces[faces].iter().flatten().copied().collect();
            vertices.sort_unstable();
            vertices.dedup();
            let sum: f64 = vertices.into_iter().map(energy).sum();
            if sum >= 0.0 { sum } else { f64::INFINITY }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use maquette_node::Progress;
    use maquette_value::Mesh;

    use crate::border::holes::HoleChoice;
    use crate::fill_holes::fill_holes;
    use crate::method::FillMethod;
    use crate::shapes::{grid, remove_vertices, sphere};

    fn bending(mesh: &Mesh, method: FillMethod) -> Vec<f64> {
        let filled = fill_holes(mesh, &HoleChoice::Edges { max: 60 }, &method, &Progress::silent());
        filled.unwrap().trace.bending().to_vec()
    }

    #[test]
    fn a_filled_plane_does_not_bend() {
        let plane = grid(20, 20, |x, y| 0.2 * x - 0.1 * y);
        let mesh = remove_vertices(&plane, |p| libm::hypot(p.x - 9.0, p.y - 9.0) < 4.0);
        assert!(bending(&mesh, FillMethod::ThinPlate)[0] < 1e-20);
    }

    #[test]
    fn a_fill_of_a_ball_bends_as_much_as_its_solid_angle() {
        let height = 0.85;
        let mesh = remove_vertices(&sphere(5), |p| p.z > height || p.x < -height);
        let [plate, membrane] =
            [FillMethod::ThinPlate, FillMethod::Membrane].map(|method| bending(&mesh, method));
        let cap = 4.0 * std::f64::consts::TAU * (1.0 - height);
        for (plate, membrane) in plate.iter().zip(&membrane) {
            // The vertices at the rim count, too.
            assert!(
                cap < *plate && *plate < 1.4 * cap && plate < membrane,
                "{plate} {cap} {membrane}"
            );
        }
        assert_eq!(plate.len(), 2);
    }

    #[test]
    fn bending_does_not_depend_on_the_size() {
        let mesh = remove_vertices(&sphere(4), |p| p.z > 0.8);
        let large: Vec<_> = mesh.positions().iter().map(|p| p * 1024.0).collect();
        let large = mesh.clone().with_positions(large).unwrap();
        let [small, large] = [mesh, large].map(|mesh| bending(&mesh, FillMethod::Membrane)[0]);
        assert!((small / large - 1.0).abs() < 1e-9, "{small} {large}");
    }
}
