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
