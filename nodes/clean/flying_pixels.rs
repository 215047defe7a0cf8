//! Takes away what hangs between foreground and background.

use maquette_node::{Carry, Context, Error, Fate, In, Node};
use maquette_range::Rays;
use maquette_scan::Scan;
use maquette_value::RangeImage;
use maquette_value::parallel::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Takes away flying pixels: cells of a range image at silhouettes, whose points hang between foreground and background, on neither.
///
/// A sensor that sees both in one cell measures something between. Such a cell goes if the surface would fall off steeply towards it on one side
/// and from it on the other, along a row, a column or a diagonal; and one that hangs together with too few of its eight neighbors. The
/// cells at the rims of foreground and background stay: their surface goes on to one side. Where nothing lies behind, a silhouette has
/// no flying pixels that could be told.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FlyingPixels {
    /// The range image.
    pub range: In<RangeImage>,
    /// What is steep: the angle between the line of sight and the normal of a surface through two neighbors. Surfaces that slant less stay whole.
    #[schemars(range(min = 45.0, max = 90.0), extend("unit" = "deg"))]
    #[serde(default = "eighty")]
    pub angle: f64,
    /// With how many of its eight neighbors a cell must hang together, without a steep step; 0 lets single cells stay.
    #[schemars(range(min = 0, max = 8))]
    #[serde(default = "two")]
    pub neighbors: u32,
}

fn eighty() -> f64 {
    80.0
}

fn two() -> u32 {
    2
}

/// Why it cannot be told what flies.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FlyingPixelsError {
    /// An angle that is none.
    #[error("`angle` is {0}, but must be from 45 to 90 degrees")]
    Angle(f64),
    /// More neighbors than there are.
    #[error("`neighbors` is {0}, but a cell has no more than 8")]
    Neighbors(u32),
}

impl Node for FlyingPixels {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "range", Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let range = cx.get(&self.range);
        let flying = flying_pixels(range, self.angle, self.neighbors)?;
        let kept: Vec<_> = flying.iter().map(|flying| !flying).collect();
        match Scan::RangeImage(range.clone()).only(&kept) {
            Scan::RangeImage(range) => {
                if range.n_valid() == 0 && kept.iter().any(|kept| !kept) {
                    cx.warn("nothing is left: take a greater `angle` or fewer `neighbors`");
                }
                Ok((range,))
            }
            _ => unreachable!("a range image stays one"),
        }
    }
}

/// The neighbors to one side of a cell, by column and row; those to the other side are opposite.
const HALF: [[isize; 2]; 4] = [[1, 0], [1, 1], [0, 1], [-1, 1]];

/// A step from a cell to a neighbor.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Along a surface.
    Even,
    /// Steeply towards the sensor.
    Nearer,
    /// Steeply away from it.
    Farther,
}

/// Which cells of a range image fly: those between two neighbors on a line of which one lies steeply before and one steeply behind them, and
/// those that hang together with fewer than so many `neighbors`. A step is steep if the surface through both points has a normal that is
/// more than `angle` degrees off the line of sight, the least that it can be. A cell without a point does not fly.
///
/// The angle is that of Tang, Huber and Akinci, "A comparative analysis of depth-discontinuity and mixed-pixel detection algorithms" (2007), section
/// 3; that the signs of both steps count beside it tells a cell between two surfaces from the rim of one.
///
/// # Errors
/// If a parameter is out of range.
pub fn flying_pixels(
    range: &RangeImage,
    angle: f64,
    neighbors: u32,
) -> Result<Vec<bool>, FlyingPixelsError> {
    if !(45.0..=90.0).contains(&angle) {
        return Err(FlyingPixelsError::Angle(angle));
    }
    if neighbors > 8 {
        return Err(FlyingPixelsError::Neighbors(neighbors));
    }
    let (width, height, points) = (range.width(), range.height(), range.points());
    let (rays, slope) = (Rays::of(range), libm::tan(angle.to_radians()));
    let step = |cell: usize, [right, down]: [isize; 2]| {
        let column = (cell % width).checked_add_signed(right).filter(|it| *it < width)?;
        let row = (cell / width).checked_add_signed(down).filter(|it| *it < height)?;
        let (from, to) = (points[cell], points[row * width + column]);
        if to.x.is_nan() {
            return None;
        }
        let sight = rays.at(nalgebra::center(&from, &to)).try_normalize(0.0)?;
        let along = (to - from).dot(&sight);
        let across = (to - from - sight * along).norm();
        Some(match along.abs() <= slope * across {
            true => Step::Even,
            false if along < 0.0 => Step::Nearer,
            false => Step::Farther,
        })
    };
    Ok((0..width * height)
        .into_par_iter()
        .with_min_len(1024)
        .map(|cell: usize| {
            if points[cell].x.is_nan() {
                return false;
            }
            let lines = HALF.map(|way| [step(cell, way), step(cell, way.map(|x| -x))]);
            let even = lines.as_flattened().iter().filter(|it| **it == Some(Step::Even)).count();
            lines.iter().any(|line| {
                line.contains(&Some(Step::Nearer)) && line.contains(&Some(Step::Farther))
            }) || even < neighbors as usize
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// What a camera with 1000 cells for a unit of depth sees, of 40 by 30 cells; depths by column and row, in mm.
    fn seen(depth: impl Fn(usize, usize) -> f64) -> RangeImage {
        RangeImage::new(
            40,
            30,
            (0..1200)
                .map(|cell: usize| {
                    let (column, row) = (cell % 40, cell / 40);
                    let z = depth(column, row);
                    Point3::new(
                        (column as f64 - 19.5) / 1000.0 * z,
                        (row as f64 - 14.5) / 1000.0 * z,
                        z,
                    )
                })
                .collect(),
        )
        .unwrap()
    }

    fn flying(range: &RangeImage, neighbors: u32) -> Vec<[usize; 2]> {
        let flying = flying_pixels(range, 80.0, neighbors).unwrap();
        (0..1200).filter(|&cell| flying[cell]).map(|cell| [cell % 40, cell / 40]).collect()
    }

    #[test]
    fn what_hangs_between_two_surfaces_goes_and_their_rims_stay() {
        // A post before a wall, with two columns between them on its left and one on its right.
        let depth = |column, _| match column {
            14 => 900.0,
            15 => 700.0,
            16..=24 => 500.0,
            25 => 800.0,
            _ => 1000.0,
        };
        let expected =
            (0..30).flat_map(|row| [14, 15, 25].map(|column| [column, row])).collect::<Vec<_>>();
        assert_eq!(flying(&seen(depth), 2), expected);
        // Without anything between nothing goes.
        let depth = |column, _| if (16..25).contains(&column) { 500.0 } else { 1000.0 };
        assert!(flying(&seen(depth), 2).is_empty());
    }

    #[test]
    fn a_slanted_wall_stays_whole_up_to_the_angle() {
        for (angle, flies) in [(0.0, false), (60.0, false), (78.0, false), (82.0, true)] {
            let slope = libm::tan(f64::to_radians(angle));
            // z = 1000 + slope * x on the ray with x = z * t.
            let range = seen(|column, _| 1000.0 / (1.0 - slope * (column as f64 - 19.5) / 1000.0));
            assert_eq!(!flying(&range, 0).is_empty(), flies, "{angle}");
        }
    }

    #[test]
    fn single_cells_go_unless_they_may_stay() {
        fn depth(column: usize, row: usize) -> f64 {
            match (column, row) {
                (10, 10) => 600.0,
                (20..30, 12) => 600.0,
                _ => 1000.0,
            }
        }
        // A wire of one row has two neighbors of its own but at its ends.
        assert_eq!(flying(&seen(depth), 2), [[10, 10], [20, 12], [29, 12]]);
        assert!(flying(&seen(depth), 0).is_empty());
        let lonely = seen(|column, row| if (column, row) == (3, 3) { 500.0 } else { f64::NAN });
        assert_eq!(flying(&lonely, 1), [[3, 3]]);
    }

    #[test]
    fn wrong_numbers_are_told_and_nothing_stays_nothing() {
        let wall = seen(|_, _| 1000.0);
        for angle in [44.0, 91.0, f64::NAN] {
            assert!(matches!(flying_pixels(&wall, angle, 2), Err(FlyingPixelsError::Angle(_))));
        }
        assert_eq!(flying_pixels(&wall, 80.0, 9), Err(FlyingPixelsError::Neighbors(9)));
        assert!(flying(&seen(|_, _| f64::NAN), 2).is_empty());
        let empty = RangeImage::new(0, 0, Vec::new()).unwrap();
        assert!(flying_pixels(&empty, 80.0, 2).unwrap().is_empty());
    }
}
