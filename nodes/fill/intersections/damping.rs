//! Moves the vertices of a fill back towards their initial positions where the fill intersects itself or the input mesh.

use maquette_node::{Error, Progress};
use nalgebra::Point3;

use super::detect::Intersections;
use crate::triangles::filling::Filling;

/// Number of the first rounds, each of which halves the displacements from the initial fill (`HALVING_ROUNDS`). Number of the rounds after
/// them, each of which sets displacements to 0 (`ZERO_ROUNDS`).
const HALVING_ROUNDS: usize = 4;
const ZERO_ROUNDS: usize = 4;

/// Moves the vertices of intersecting faces of the fill, and the rings of vertices around them, back towards their positions `start` until
/// no faces intersect. Each round adds one ring of vertices, and the last round all connected vertices: if the initial fill has no
/// intersections, none remain. If the number of intersecting faces has not decreased in the end, the fill is left unchanged.
///
/// # Errors
/// Returns an error if there would be too many pairs of triangles to test, or if the evaluation is cancelled.
pub(crate) fn damp_displacements(
    filling: &mut Filling,
    start: &[Point3<f64>],
    intersections: &mut Intersections,
    progress: &Progress<'_>,
) -> Result<(), Error> {
    let data = filling.n_data_vertices;
    let completed = filling.points[data..].to_vec();
    let mut factors = vec![1.0; completed.len()];
    let first = intersections.faces(filling).len();
    for round in 0..=HALVING_ROUNDS + ZERO_ROUNDS {
        if intersections.is_empty() {
            return Ok(());
        }
        let mut near = vec![false; filling.points.len()];
        for &face in &intersections.faces(filling) {
            filling.faces[face as usize].iter().for_each(|&vertex| near[vertex as usize] = true);
        }
        let rings = if round < HALVING_ROUNDS + ZERO_ROUNDS { round + 1 } else { usize::MAX };
        grow(&mut near, &filling.faces[filling.n_data_faces..], rings);
        let factor = if round < HALVING_ROUNDS { 0.5 } else { 0.0 };
        for vertex in (0..completed.len()).filter(|vertex| near[data + vertex]) {
            factors[vertex] *= factor;
            let displacement = completed[vertex] - start[vertex];
            filling.points[data + vertex] = start[vertex] + displacement * factors[vertex];
        }
        near[..data].fill(false);
        intersections.update(
            filling,
            |face: u32| filling.faces[face as usize].iter().any(|&v| near[v as usize]),
            progress,
        )?;
    }
    if intersections.faces(filling).len() < first {
        return Ok(());
    }
    filling.points.truncate(data);
    filling.points.extend(completed);
    intersections.update(filling, |_| true, progress)
}

/// Sets `near` also for the vertices within `rings` edges of those for which it is true; stops early when no vertex is added.
fn grow(near: &mut [bool], faces: &[[u32; 3]], rings: usize) {
    for _ in 0..rings {
        let ring: Vec<[u32; 3]> = faces
            .iter()
            .filter(|face| {
                let count = face.iter().filter(|&&vertex| near[vertex as usize]).count();
                0 < count && count < 3
            })
            .copied()
            .collect();
        if ring.is_empty() {
            return;
        }
        ring.as_flattened().iter().for_each(|&vertex| near[vertex as usize] = true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{grid, triangle_mesh};

    #[test]
    fn damping_moves_only_intersecting_parts_as_far_as_needed() {
        // The surface consists of two parallel sheets. The upper one is a fill, and bulges through the lower one at one position.
        let (lower, upper) = (grid(13, 13, |_, _| 0.0), grid(13, 13, |_, _| 1.0));
        let data = lower.positions().len();
        let points: Vec<_> =
            lower.positions().iter().chain(upper.positions().iter()).copied().collect();
        let of_lower = lower.faces().as_triangles().unwrap();
        let of_upper = upper.faces().as_triangles().unwrap();
        let shifted = of_upper.iter().map(|face| face.map(|vertex| vertex + data as u32));
        let all = of_lower.iter().copied().chain(shifted);
        let mut filling = Filling::new(&triangle_mesh(points, all.collect()));
        (filling.n_data_vertices, filling.n_data_faces) = (data, of_lower.len());
        let start = filling.points[data..].to_vec();
        let completed: Vec<_> = start
            .iter()
            .map(|p| {
                let off = libm::hypot(p.x - 3.0, p.y - 3.0);
                p + nalgebra::Vector3::z() * if off < 0.5 { -1.6 } else { 0.3 }
            })
            .collect();
        filling.points.truncate(data);
        filling.points.extend(&completed);
        let progress = Progress::silent();
        let mut intersections = Intersections::new(&filling, &progress).unwrap();
        assert!(!intersections.is_empty());
        damp_displacements(&mut filling, &start, &mut intersections, &progress).unwrap();
        assert!(intersections.is_empty());
        assert!(Intersections::new(&filling, &progress).unwrap().is_empty());
        for ((now, completed), start) in filling.points[data..].iter().zip(&completed).zip(&start) {
            let off = libm::hypot(start.x - 3.0, start.y - 3.0);
            assert!(off < 4.0 || now == completed, "{now}");
            assert!(0.0 < now.z && now.z <= 1.3, "{now}");
        }
    }
}
