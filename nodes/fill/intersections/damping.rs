//! Damps the displacements of a completion where the completed surface intersects itself or the data.

use maquette_node::Progress;
use nalgebra::Point3;

use super::detect::Intersections;
use crate::fill_error::FillError;
use crate::triangles::filling::Filling;

/// Rounds that halve displacements, and the rounds after them, which set them to 0.
const HALVES: usize = 4;
const WHOLES: usize = 4;

/// Moves the filled vertices of intersecting faces, and those in rings around them, back towards `start` until no faces intersect. Each
/// round takes in one more ring, and the last one all vertices that are connected with them, so that no intersection is left if the start
/// has none. If there are as many in the end as before, the completion stays as it was.
///
/// # Errors
/// If there would be too many pairs of triangles to test, or the evaluation is told to stop.
pub(crate) fn damp_displacements(
    filling: &mut Filling,
    start: &[Point3<f64>],
    intersections: &mut Intersections,
    progress: &Progress<'_>,
) -> Result<(), FillError> {
    let data = filling.data;
    let completed = filling.points[data..].to_vec();
    let mut shares = vec![1.0; completed.len()];
    let first = intersections.faces(filling).len();
    for round in 0..=HALVES + WHOLES {
        if intersections.is_empty() {
            return Ok(());
        }
        let mut near = vec![false; filling.points.len()];
        for &face in &intersections.faces(filling) {
            filling.faces[face as usize].iter().for_each(|&vertex| near[vertex as usize] = true);
        }
        let rings = if round < HALVES + WHOLES { round + 1 } else { usize::MAX };
        grow(&mut near, &filling.faces[filling.kept..], rings);
        let factor = if round < HALVES { 0.5 } else { 0.0 };
        for vertex in (0..completed.len()).filter(|vertex| near[data + vertex]) {
            shares[vertex] *= factor;
            let displacement = completed[vertex] - start[vertex];
            filling.points[data + vertex] = start[vertex] + displacement * shares[vertex];
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

/// Takes in so many rings of neighbors, or as many as there are.
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
    use crate::shapes::{grid, of};

    #[test]
    fn only_what_intersects_goes_back_and_no_farther_than_it_must() {
        // A sheet above another one; all of the upper one is filled, and bulges, in one place through the lower one.
        let (lower, upper) = (grid(13, 13, |_, _| 0.0), grid(13, 13, |_, _| 1.0));
        let data = lower.positions().len();
        let points: Vec<_> =
            lower.positions().iter().chain(upper.positions().iter()).copied().collect();
        let faces = |at: u32| move |face: &[u32; 3]| face.map(|vertex| vertex + at);
        let of_lower = lower.faces().as_triangles().unwrap();
        let of_upper = upper.faces().as_triangles().unwrap();
        let all = of_lower.iter().map(faces(0)).chain(of_upper.iter().map(faces(data as u32)));
        let mut filling = Filling::new(&of(points, all.collect()));
        (filling.data, filling.kept) = (data, of_lower.len());
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
        let progress = Progress::none();
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
