//! Fills shadows of scans: cells without a point that the scan surrounds.

use maquette_node::{Carry, Context, Error, Forecast, In, Node, Progress, Sizes, Transfer};
use maquette_value::RangeImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::joins::{JUMP, longest_edge};
use super::holes::shadows::{MAX_SHADOW_CELLS, fill_shadows, join_around};

/// Fills shadows and pits of a range image: cells without a point that the scan surrounds.
///
/// A large shadow is filled like a membrane between the edges around it; a small pit continues the curvature around it. New cells are
/// marked as filled, and belong to the same surface as those around them, for any slope. The background is never filled.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FillRange {
    /// Range image.
    pub range: In<RangeImage>,
    /// Maximum number of cells of a shadow that is filled. Larger ones count as gaps in the object.
    #[schemars(range(max = 100_000), extend("unit" = "cells"))]
    #[serde(default = "default_largest")]
    pub largest: u32,
    /// Maximum edge length of a filled shadow, in multiples of the grid's median spacing. A shadow with longer edges is between an object
    /// and the background, and stays open.
    #[schemars(range(min = 0.0))]
    #[serde(default = "default_jump")]
    pub jump: f64,
}

fn default_jump() -> f64 {
    JUMP
}

fn default_largest() -> u32 {
    MAX_SHADOW_CELLS as u32
}

impl Node for FillRange {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] =
        &[Carry::cells("range", "range", Transfer::Kept).excluding(&["filled", "joined"])];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::by_law(sizes.get(&self.range)?))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let largest = self.largest as usize;
        Ok((fill_range(cx.get(&self.range), largest, self.jump, cx.progress())?,))
    }
}

/// Fills all shadows (cells without a point, connected by sides) of up to `largest` cells with a thin plate under tension, which continues
/// the two rows of points around each shadow. A shadow stays open if filling it needs an edge longer than `jump` times the median distance
/// of valid cells that share a side. New cells are marked as filled, and their triangles as parts of one surface.
///
/// Returns an error if the evaluation is cancelled.
pub fn fill_range(
    range: &RangeImage,
    largest: usize,
    jump: f64,
    progress: &Progress<'_>,
) -> Result<RangeImage, Error> {
    let (width, longest) = (range.width(), longest_edge(range, jump));
    let mut points = range.points().to_vec();
    let cells =
        fill_shadows(width, &mut points, longest, |shadow| shadow.len() <= largest, progress)?;
    if cells.is_empty() {
        return Ok(range.clone());
    }
    let all = 0..points.len();
    let mut filled: Vec<_> = all.clone().map(|cell| u8::from(range.is_filled(cell))).collect();
    let mut joined: Vec<_> = all.map(|cell| range.forced_triangles(cell)).collect();
    cells.iter().for_each(|&cell| filled[cell as usize] = 1);
    join_around(width, &cells, &points, &mut joined);
    Ok(range.with_points(points)?.with_filled(filled)?.with_joined(joined)?)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::triangulate;

    /// Returns a scan of a ball in front of a wall. The sensor sees the scene from the left and the light comes from the right, so the
    /// shadow is on the left of the ball.
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
    fn a_shadow_becomes_a_surface_between_its_edges() {
        let range = scan();
        let filled_range = fill_range(&range, 1000, 20.0, &Progress::silent()).unwrap();
        assert!(range.n_valid() < 1150 && filled_range.n_valid() == 1200);
        for cell in (0..1200).filter(|cell| range.point(*cell).is_none()) {
            assert!(filled_range.is_filled(cell) && filled_range.forced_triangles(cell) != 0);
            assert!((481.0..502.0).contains(&filled_range.points()[cell].z), "{cell}");
        }
        assert_eq!(fill_range(&range, 20, 20.0, &Progress::silent()).unwrap(), range);
        assert_eq!(fill_range(&range, 1000, 2.0, &Progress::silent()).unwrap(), range);
        // On the left, the filled shadow connects ball and wall. On the right, they are still separate.
        let [open, closed] = [&range, &filled_range].map(border_edges);
        assert!(closed + 39 < open, "{closed} {open}");
    }
}
