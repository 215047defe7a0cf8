//! Takes a completed hole back towards its start where it runs through itself or through the data.

use maquette::{Cancelled, Progress};
use nalgebra::Point3;

use super::filling::Filling;
use super::intersections::intersecting;

/// Rounds in which vertices go half of their way back, and after them those in which they go all of it.
const HALVES: usize = 4;
const WHOLES: usize = 4;

/// Moves filled vertices of crossing faces, and those around them, towards `start`, until no faces cross any more; gives the faces that
/// still do, never more than at first. Each round takes in one more ring of vertices.
///
/// # Errors
/// If the evaluation is told to stop.
pub(super) fn settle(
    filling: &mut Filling,
    start: &[Point3<f64>],
    crossing: Vec<u32>,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Cancelled> {
    let data = filling.data;
    let completed = filling.points[data..].to_vec();
    let mut shares = vec![1.0; completed.len()];
    let mut left = crossing.clone();
    for round in 0..HALVES + WHOLES {
        if left.is_empty() {
            return Ok(left);
        }
        let mut near = vec![false; filling.points.len()];
        for &face in &left {
            filling.faces[face as usize].iter().for_each(|&vertex| near[vertex as usize] = true);
        }
        for _ in 0..=round {
            let inner: Vec<[u32; 3]> = filling.faces[filling.kept..]
                .iter()
                .filter(|face| face.iter().any(|&vertex| near[vertex as usize]))
                .copied()
                .collect();
            inner.as_flattened().iter().for_each(|&vertex| near[vertex as usize] = true);
        }
        let factor = if round < HALVES { 0.5 } else { 0.0 };
        for vertex in (0..completed.len()).filter(|vertex| near[data + vertex]) {
            shares[vertex] *= factor;
            let way = completed[vertex] - start[vertex];
            filling.points[data + vertex] = start[vertex] + way * shares[vertex];
        }
        left = intersecting(filling, progress)?;
    }
    if left.len() < crossing.len() {
        return Ok(left);
    }
    filling.points.truncate(data);
    filling.points.extend(completed);
    Ok(crossing)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fill::shapes::{grid, of};

    #[test]
    fn only_what_crosses_goes_back_and_no_farther_than_it_must() {
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
        let bulge = |p: &Point3<f64>| {
            let off = libm::hypot(p.x - 3.0, p.y - 3.0);
            p + nalgebra::Vector3::z() * if off < 0.5 { -1.6 } else { 0.3 }
        };
        let completed: Vec<_> = start.iter().map(bulge).collect();
        filling.points.truncate(data);
        filling.points.extend(&completed);
        let crossing = intersecting(&filling, &Progress::none()).unwrap();
        assert!(!crossing.is_empty());
        let left = settle(&mut filling, &start, crossing, &Progress::none()).unwrap();
        assert_eq!(left, [0; 0]);
        assert_eq!(intersecting(&filling, &Progress::none()).unwrap(), [0; 0]);
        for ((now, completed), start) in filling.points[data..].iter().zip(&completed).zip(&start) {
            let off = libm::hypot(start.x - 3.0, start.y - 3.0);
            assert!(off < 4.0 || now == completed, "{now}");
            assert!(0.0 < now.z && now.z <= 1.3, "{now}");
        }
    }
}
