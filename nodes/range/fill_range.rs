//! Fills what a scanner did not see in the middle of what it saw.

use maquette_node::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress};
use maquette_value::{RangeImage, SizeError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::joins::{JUMP, longest_edge};
use super::holes::shadows::{LARGEST_SHADOW, fill_shadows, join_around};

/// Fills shadows and pits of a range image: cells without a point that the scan surrounds.
///
/// A shadow is filled like a skin between the edges around it, a small pit goes on as its surroundings bend. New cells are marked as
/// filled, and belong to the same surface as those around them, however steep it is. The background is never filled.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FillRange {
    /// The range image.
    pub range: In<RangeImage>,
    /// Cells of the largest shadow that is filled: what is larger is taken for a gap in the object.
    #[schemars(range(max = 100_000), extend("unit" = "cells"))]
    #[serde(default = "largest_shadow")]
    pub largest: u32,
    /// Longest edge of what is filled, in multiples of the grid's median spacing: a shadow that needs longer ones lies between an
    /// object and what is behind it, and stays open.
    #[schemars(range(min = 0.0))]
    #[serde(default = "jump")]
    pub jump: f64,
}

fn jump() -> f64 {
    JUMP
}

fn largest_shadow() -> u32 {
    LARGEST_SHADOW as u32
}

/// Why a range image is not filled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FillRangeError {
    /// Columns of different sizes.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for FillRange {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] =
        &[Carry::cells("range", "range", Fate::Kept).but(&["filled", "joined"])];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let largest = self.largest as usize;
        Ok((fill_range(cx.get(&self.range), largest, self.jump, cx.progress())?,))
    }
}

/// The range image with points in all shadows of up to `largest` cells, connected by sides: those of a thin plate under tension
/// through the two rows of points around them, unless that needs an edge longer than `jump` times the median distance of valid cells that
/// share a side. They are marked as filled, and the triangles at them as joined.
///
/// # Errors
/// If the evaluation is told to stop.
pub fn fill_range(
    range: &RangeImage,
    largest: usize,
    jump: f64,
    progress: &Progress<'_>,
) -> Result<RangeImage, FillRangeError> {
    let (width, longest) = (range.width(), longest_edge(range, jump));
    let mut points = range.points().to_vec();
    let cells =
        fill_shadows(width, &mut points, longest, |shadow| shadow.len() <= largest, progress)?;
    if cells.is_empty() {
        return Ok(range.clone());
    }
    let all = 0..points.len();
    let mut filled: Vec<_> = all.clone().map(|cell| u8::from(range.is_filled(cell))).collect();
    let mut joined: Vec<_> = all.map(|cell| range.joined(cell)).collect();
    cells.iter().for_each(|&cell| filled[cell as usize] = 1);
    join_around(width, &cells, &points, &mut joined);
    Ok(range.with_points(points)?.with_filled(filled)?.with_joined(joined)?)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::triangulate;

    /// A ball before a wall, seen from the left with a light from the right, so that a shadow lies at the ball's left.
    fn scan() -> RangeImage {
        fn point(cell: usize) -> Point3<f64> {
            let [x, y] = [(cell % 40) as f64 - 20.0, (cell / 40) as f64 - 15.0];
            let from = libm::hypot(x, y);
            let shadow = from > 8.0 && x < -3.0 && from < 11.0;
            let z = if shadow {
                f64::NAN
            } else if from <= 8.0 {
                490.0 - (64.0 - from * from).sqrt()
            } else {
                500.0
            };
            Point3::new(x, y, z)
        }
        RangeImage::new(40, 30, (0..1200).map(point).collect()).unwrap()
    }

    fn border_edges(range: &RangeImage) -> usize {
        let mesh = triangulate(range, 3.0, 80.0, 0).unwrap();
        let mut edges = Vec::new();
        for face in mesh.faces().as_triangles().unwrap() {
            edges.extend((0..3).map(|k| [face[k], face[(k + 1) % 3]]));
        }
        edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).count()
    }

    #[test]
    fn a_shadow_becomes_a_skin_from_one_edge_to_the_other() {
        let range = scan();
        let whole = fill_range(&range, 1000, 20.0, &Progress::none()).unwrap();
        assert!(range.n_valid() < 1150 && whole.n_valid() == 1200);
        for cell in (0..1200).filter(|cell| range.point(*cell).is_none()) {
            assert!(whole.is_filled(cell) && whole.joined(cell) != 0);
            assert!((481.0..502.0).contains(&whole.points()[cell].z), "{cell}");
        }
        assert_eq!(fill_range(&range, 20, 20.0, &Progress::none()).unwrap(), range);
        assert_eq!(fill_range(&range, 1000, 2.0, &Progress::none()).unwrap(), range);
        // On the shadow's side nothing is open; on the other the ball still stands before the wall.
        let [open, closed] = [&range, &whole].map(border_edges);
        assert!(closed + 39 < open, "{closed} {open}");
    }
}
