//! The lines of an object's box, to see how space is deformed.

use maquette_base::limits::POINTS;
use maquette_mesh::Movable;
use maquette_node::{Context, Error, In, Node, TooMuch};
use maquette_value::{Curve, CurveError};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::free_form::object::bounds;
use super::gaussian::layout::Bounds;

/// Draws the lines of a lattice in an object's box as one polyline, to be deformed beside the object and seen: `Ffd` with
/// the object as its `frame`, then `Tube`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Lattice {
    /// The object.
    pub mesh: In<Movable>,
    /// Cells along x, y and z.
    #[schemars(inner(range(min = 1, max = 64)))]
    #[serde(default = "four")]
    pub cells: [usize; 3],
    /// Points on each side of a cell.
    #[schemars(range(min = 1, max = 64))]
    #[serde(default = "eight")]
    pub samples: usize,
}

fn four() -> [usize; 3] {
    [4; 3]
}

fn eight() -> usize {
    8
}

/// Why there is no lattice.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LatticeError {
    /// An object without points.
    #[error("an object without points has no box")]
    Nothing,
    /// No cells, or too many.
    #[error(
        "a lattice has from 1 to 64 cells along each axis, and as many points on the side of a cell"
    )]
    Size,
    /// Too many points.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// A box that is too large.
    #[error(transparent)]
    Curve(#[from] CurveError),
}

impl Node for Lattice {
    type Outputs = (Curve,);
    const OUTPUTS: [&'static str; 1] = ["curve"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let bounds = bounds(&cx.get(&self.mesh)).ok_or(LatticeError::Nothing)?;
        Ok((lattice(bounds, self.cells, self.samples)?,))
    }
}

/// All lines of a box's lattice, one after the other: back and forth along x, then y, then z, along lines of the lattice alone.
/// Each side of a cell has `samples` points; places in mm.
///
/// # Errors
/// If a number is not from 1 to 64, there would be too many points, or the box is not finite.
pub fn lattice(bounds: Bounds, cells: [usize; 3], samples: usize) -> Result<Curve, LatticeError> {
    if cells.iter().chain([&samples]).any(|count| !(1..=64).contains(count)) {
        return Err(LatticeError::Size);
    }
    fn lines(along: usize, cells: [usize; 3]) -> usize {
        (cells[(along + 1) % 3] + 1) * (cells[(along + 2) % 3] + 1)
    }
    let need: usize = (0..3).map(|along| lines(along, cells) * cells[along] * samples).sum();
    POINTS.check("the lattice", need as f64)?;
    let mut pen = Pen { at: [0; 3], cells, samples, line: vec![[0.0; 3]] };
    for along in 0..3 {
        let (inner, outer) = ((along + 1) % 3, (along + 2) % 3);
        let outwards = pen.forward(outer);
        for row in 0..=cells[outer] {
            let inwards = pen.forward(inner);
            for column in 0..=cells[inner] {
                pen.cross(along);
                if column < cells[inner] {
                    pen.step(inner, inwards);
                }
            }
            if row < cells[outer] {
                pen.step(outer, outwards);
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

/// What draws along the lattice, and where it is.
struct Pen {
    at: [usize; 3],
    cells: [usize; 3],
    samples: usize,
    /// In cells.
    line: Vec<[f64; 3]>,
}

impl Pen {
    /// Whether the far side along an axis is the highest.
    fn forward(&self, axis: usize) -> bool {
        self.at[axis] == 0
    }

    /// Draws to the other end.
    fn cross(&mut self, axis: usize) {
        let forward = self.forward(axis);
        (0..self.cells[axis]).for_each(|_| self.step(axis, forward));
    }

    /// Draws one side of a cell.
    fn step(&mut self, axis: usize, forward: bool) {
        let start = self.at.map(|count| count as f64);
        for sample in 1..=self.samples {
            let mut place = start;
            let share = sample as f64 / self.samples as f64;
            place[axis] += if forward { share } else { -share };
            self.line.push(place);
        }
        self.at[axis] = if forward { self.at[axis] + 1 } else { self.at[axis] - 1 };
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
    fn a_lattice_without_cells_is_refused() {
        let bounds = (Point3::origin(), Point3::new(1.0, 1.0, 1.0));
        assert_eq!(lattice(bounds, [0, 1, 1], 1), Err(LatticeError::Size));
        assert_eq!(lattice(bounds, [1; 3], 65), Err(LatticeError::Size));
        let error = lattice(bounds, [64; 3], 64).unwrap_err().to_string();
        assert!(error.contains("about 52 000 000 points"), "{error}");
    }
}
