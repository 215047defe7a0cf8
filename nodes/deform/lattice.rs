//! The lines of a lattice in an object's bounding box. Deformed together with the object, they show how space is deformed.

use maquette_base::limits::POINTS;
use maquette_mesh::Movable;
use maquette_node::{Context, Error, In, Node, bail};
use maquette_value::Curve;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::free_form::object::bounds;
use super::gaussian::layout::Bounds;

/// Creates the lines of a lattice in an object's bounding box as one polyline. Deform it together with the object, by `Ffd` with the object
/// as `frame`, and make it visible with `Tube`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Lattice {
    /// Object whose bounding box the lattice fills.
    pub mesh: In<Movable>,
    /// Number of cells along x, y and z.
    #[schemars(inner(range(min = 1, max = 64)))]
    #[serde(default = "default_cells")]
    pub cells: [usize; 3],
    /// Number of points on each side of a cell.
    #[schemars(range(min = 1, max = 64))]
    #[serde(default = "default_samples")]
    pub samples: usize,
}

fn default_cells() -> [usize; 3] {
    [4; 3]
}

fn default_samples() -> usize {
    8
}

impl Node for Lattice {
    type Outputs = (Curve,);
    const OUTPUTS: [&'static str; 1] = ["curve"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let bounds = bounds(&cx.get(&self.mesh))
            .ok_or_else(|| Error::new("the object has no points and therefore no box"))?;
        Ok((lattice(bounds, self.cells, self.samples)?,))
    }
}

/// Returns all lines of a lattice in the box `bounds` as one polyline, which runs back and forth along x, then y, then z, along lattice
/// lines only. Each side of a cell has `samples` points. Positions are in mm.
///
/// # Errors
/// Returns an error if `samples` or an entry of `cells` is not from 1 to 64, if there would be too many points, or if the box is not
/// finite.
pub fn lattice(bounds: Bounds, cells: [usize; 3], samples: usize) -> Result<Curve, Error> {
    if cells.iter().chain([&samples]).any(|count| !(1..=64).contains(count)) {
        bail!("expected 1 to 64 cells along each axis, and 1 to 64 points per cell side");
    }
    let need: usize = (0..3)
        .map(|along| {
            let lines = (cells[(along + 1) % 3] + 1) * (cells[(along + 2) % 3] + 1);
            lines * cells[along] * samples
        })
        .sum();
    POINTS.check("the lattice", need as f64)?;
    let mut pen = Pen { position: [0; 3], cells, samples, line: vec![[0.0; 3]] };
    for along in 0..3 {
        let (inner, outer) = ((along + 1) % 3, (along + 2) % 3);
        let is_outer_forward = pen.is_at_low_side(outer);
        for row in 0..=cells[outer] {
            let is_inner_forward = pen.is_at_low_side(inner);
            for column in 0..=cells[inner] {
                pen.draw_line(along);
                if column < cells[inner] {
                    pen.step(inner, is_inner_forward);
                }
            }
            if row < cells[outer] {
                pen.step(outer, is_outer_forward);
            }
        }
    }
    let extent = bounds.1 - bounds.0;
    let points: Vec<Point3<f64>> = pen
        .line
        .iter()
        .map(|at| {
            let fraction = Vector3::from_fn(|axis, _| at[axis] / cells[axis] as f64);
            bounds.0 + fraction.component_mul(&extent)
        })
        .collect();
    Ok(Curve::polyline(points, false)?)
}

/// A pen that draws a polyline along the lattice.
struct Pen {
    position: [usize; 3],
    cells: [usize; 3],
    samples: usize,
    /// The drawn points, in units of cells.
    line: Vec<[f64; 3]>,
}

impl Pen {
    /// Returns true if the pen is at the minimum of the box along an axis. From there, lines are drawn in the positive direction.
    fn is_at_low_side(&self, axis: usize) -> bool {
        self.position[axis] == 0
    }

    /// Draws a line along an axis to the opposite side of the box.
    fn draw_line(&mut self, axis: usize) {
        let forward = self.is_at_low_side(axis);
        (0..self.cells[axis]).for_each(|_| self.step(axis, forward));
    }

    /// Draws one side of a lattice cell.
    fn step(&mut self, axis: usize, forward: bool) {
        let start = self.position.map(|count| count as f64);
        for sample in 1..=self.samples {
            let mut point = start;
            let fraction = sample as f64 / self.samples as f64;
            point[axis] += if forward { fraction } else { -fraction };
            self.line.push(point);
        }
        self.position[axis] =
            if forward { self.position[axis] + 1 } else { self.position[axis] - 1 };
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_side_of_every_cell_is_drawn_and_nothing_else() {
        for cells in [[1, 1, 1], [2, 3, 4], [5, 2, 1]] {
            let high = Point3::new(cells[0] as f64, cells[1] as f64, cells[2] as f64);
            let curve = lattice((Point3::origin(), high), cells, 1).unwrap();
            let mut drawn = BTreeSet::new();
            for pair in curve.points().windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|p| [p.x, p.y, p.z].map(|x| x.round() as i64));
                let length: i64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                assert_eq!(length, 1, "{a:?} to {b:?}");
                drawn.insert((a.min(b), a.max(b)));
            }
            let [x, y, z] = cells;
            let sides = x * (y + 1) * (z + 1) + (x + 1) * y * (z + 1) + (x + 1) * (y + 1) * z;
            assert_eq!(drawn.len(), sides, "{cells:?}");
        }
    }

    #[test]
    fn a_lattice_without_cells_is_rejected() {
        let bounds = (Point3::origin(), Point3::new(1.0, 1.0, 1.0));
        for (cells, samples) in [([0, 1, 1], 1), ([1; 3], 65)] {
            let error = lattice(bounds, cells, samples).unwrap_err().to_string();
            assert!(error.starts_with("expected 1 to 64 cells along each axis"), "{error}");
        }
        let error = lattice(bounds, [64; 3], 64).unwrap_err().to_string();
        assert!(error.contains("about 52 000 000 points"), "{error}");
    }
}
