//! Colors of the vertices: mixed from the points around a vertex, and as smooth as possible where there are none.

use maquette_base::light::{color_of, light_of};
use maquette_base::linear::membrane::Membrane;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Mesh, Rgb};
use nalgebra::Point3;

use super::cells::bell;
use super::pieces::Pieces;
use super::surfels::{Pyramid, place};

/// Returns the color of each vertex. `is_supported` tells which vertices have points nearby; the others get the colors of a membrane in
/// linear light that is fixed where points are.
pub(super) fn vertex_colors(
    mesh: &Mesh,
    is_supported: &[bool],
    pieces: &Pieces,
    colors: &[Rgb],
    progress: &Progress<'_>,
) -> Result<Vec<Rgb>, CancelledError> {
    let sums = ColorSums::new(pieces, colors);
    let vertices = mesh.positions().par_iter().zip(is_supported);
    let mut known: Vec<Option<Rgb>> = vertices
        .map(|(at, &is_supported): (&Point3<f64>, &bool)| sums.color_at(at, is_supported))
        .collect();
    progress.check()?;
    if known.iter().any(Option::is_none) {
        let membrane = Membrane::around(mesh, |vertex| known[vertex as usize].is_none());
        let mut lights: Vec<Option<[f64; 3]>> =
            known.iter().map(|color| color.map(light_of)).collect();
        membrane.fill(&mut lights, progress)?;
        for (color, light) in known.iter_mut().zip(lights).filter(|(color, _)| color.is_none()) {
            *color = light.map(color_of);
        }
    }
    // Only a part without any point has no color yet.
    let mean = sums.mean();
    Ok(known.into_iter().map(|color| color.unwrap_or(mean)).collect())
}

/// The sums of the points' colors in the cells of each depth, from coarse to fine.
struct ColorSums<'a> {
    pyramid: &'a Pyramid,
    /// The depth of the cells whose edges are as long as those of the result.
    skin_depth: u32,
    layers: Vec<Vec<[f64; 3]>>,
}

impl<'a> ColorSums<'a> {
    fn new(pieces: &'a Pieces, colors: &[Rgb]) -> Self {
        let pyramid = &pieces.pyramid;
        let finest: Vec<[f64; 3]> = pyramid
            .starts
            .par_windows(2)
            .map(|ends| {
                let points = pyramid.order[ends[0] as usize..ends[1] as usize].iter();
                points.fold([0.0; 3], |sum, &point| {
                    [0, 1, 2].map(|k| sum[k] + f64::from(colors[point as usize][k]))
                })
            })
            .collect();
        let mut layers = vec![finest];
        for pair in pyramid.layers.windows(2).rev() {
            let [coarse, fine] = [&pair[0].cells, &pair[1].cells];
            let mut sums = vec![[0.0; 3]; coarse.len()];
            for (cell, color) in layers[layers.len() - 1].iter().enumerate() {
                if let Some(parent) = coarse.find(fine.place(cell).map(|x| x / 2)) {
                    (0..3).for_each(|k| sums[parent][k] += color[k]);
                }
            }
            layers.push(sums);
        }
        layers.reverse();
        Self { pyramid, skin_depth: pieces.skin_depth, layers }
    }

    /// Returns the mean color of the points around a position: of those within about one edge of the result, or, if `is_supported`, of
    /// those in the smallest coarser cells that have some.
    fn color_at(&self, at: &Point3<f64>, is_supported: bool) -> Option<Rgb> {
        let cube = &self.pyramid.cube;
        let here = cube.in_cells(at, cube.depth);
        let coarsest = if is_supported { 0 } else { self.skin_depth };
        (coarsest..=self.skin_depth).rev().find_map(|depth| {
            let layer = &self.pyramid.layers[depth as usize];
            let scale = 1.0 / f64::from(1_u32 << (cube.depth - depth));
            let (mut sum, mut total) = ([0.0; 3], 0.0);
            for cell in layer.cells.neighbors(place(cube, at, depth)) {
                let moments = &layer.moments[cell];
                let mean = moments.mean();
                let weight: f64 =
                    (0..3).map(|axis| bell((mean[axis] - here[axis]) * scale)).product();
                total += weight * moments.count;
                (0..3).for_each(|k| sum[k] += weight * self.layers[depth as usize][cell][k]);
            }
            (total > 1e-6).then(|| sum.map(|x| (x / total).round() as u8))
        })
    }

    fn mean(&self) -> Rgb {
        let count = self.pyramid.order.len() as f64;
        self.layers[0]
            .iter()
            .fold([0.0; 3], |sum, of_cell| [0, 1, 2].map(|k| sum[k] + of_cell[k]))
            .map(|x| (x / count).round() as u8)
    }
}
