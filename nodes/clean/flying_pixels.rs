//! Removes points between foreground and background.

use maquette_node::{Carry, Context, Error, In, Node, Transfer, bail};
use maquette_range::Rays;
use maquette_scan::Scan;
use maquette_value::RangeImage;
use maquette_value::parallel::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Removes flying pixels: cells of a range image, at silhouettes, whose points float between foreground and background.
///
/// A sensor that sees both foreground and background in one cell measures a depth between them. Such a cell is removed if the surface would
/// drop steeply towards it on one side and away from it on the other, along a row, a column or a diagonal. A cell connected to too few of
/// its eight neighbors is removed, too. Cells at the edges of foreground and background stay: their surface continues on one side. If there
/// is no background behind a silhouette, its flying pixels cannot be detected.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FlyingPixels {
    /// The range image.
    pub range: In<RangeImage>,
    /// Angle above which a step is steep, in degrees: between the line of sight and the normal of a surface through two neighboring points.
    /// Surfaces that are less slanted stay complete.
    #[schemars(range(min = 45.0, max = 90.0), extend("unit" = "deg"))]
    #[serde(default = "default_angle")]
    pub angle: f64,
    /// Minimum number of its eight neighbors to which a cell must be connected without a steep step; 0 keeps isolated cells.
    #[schemars(range(min = 0, max = 8))]
    #[serde(default = "default_neighbors")]
    pub neighbors: u32,
}

fn default_angle() -> f64 {
    80.0
}

fn default_neighbors() -> u32 {
    2
}

impl Node for FlyingPixels {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "range", Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let range = cx.get(&self.range);
        let flying = flying_pixels(range, self.angle, self.neighbors)?;
        let kept: Vec<_> = flying.iter().map(|flying| !flying).collect();
        match Scan::RangeImage(range.clone()).select(&kept) {
            Scan::RangeImage(range) => {
                if range.n_valid() == 0 && kept.iter().any(|kept| !kept) {
                    cx.warn("all cells were removed: use a larger `angle` or fewer `neighbors`");
                }
                Ok((range,))
            }
            _ => unreachable!("a range image stays one"),
        }
    }
}

/// The offsets (column, row) from a cell to four of its neighbors. The negated offsets lead to the four opposite neighbors.
const HALF: [[isize; 2]; 4] = [[1, 0], [1, 1], [0, 1], [-1, 1]];

/// The kind of depth step from a cell to a neighbor.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    /// The depths of both cells differ so little that their points may be on one surface.
    Even,
    /// The surface at the neighbor is much nearer to the sensor.
    Nearer,
    /// The surface at the neighbor is much farther from the sensor.
    Farther,
}

/// Returns, for each cell of a range image, true if it is a flying pixel. A flying pixel is a cell between two opposite neighbors, one
/// steeply in front and the other steeply behind, or a cell connected to fewer than `neighbors` neighbors. A step is steep if every surface
/// through both points has a normal more than `angle` degrees off the line of sight. A cell without a point is not a flying pixel.
///
/// The angle criterion is that of Tang, Huber and Akinci, "A comparative analysis of depth-discontinuity and mixed-pixel detection
/// algorithms" (2007), section 3. The signs of the two steps distinguish a cell between two surfaces from a cell at the edge of one
/// surface.
///
/// # Errors
/// Returns an error if a parameter is out of range.
pub fn flying_pixels(range: &RangeImage, angle: f64, neighbors: u32) -> Result<Vec<bool>, Error> {
    if !(45.0..=90.0).contains(&angle) {
        bail!("`angle` is {angle}, but must be from 45 to 90 degrees");
    }
    if neighbors > 8 {
        bail!("`neighbors` is {neighbors}, but a cell has no more than 8");
    }
    let (width, height, points) = (range.width(), range.height(), range.points());
    let (rays, slope) = (Rays::new(range), libm::tan(angle.to_radians()));
    let step = |cell: usize, [right, down]: [isize; 2]| {
        let column = (cell % width).checked_add_signed(right).filter(|it| *it < width)?;
        let row = (cell / width).checked_add_signed(down).filter(|it| *it < height)?;
        let (from, to) = (points[cell], points[row * width + column]);
        if to.x.is_nan() {
            return None;
        }
        let sight = rays.direction(nalgebra::center(&from, &to)).try_normalize(0.0)?;
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

    /// Returns the range image of a camera with 40 by 30 cells and a focal length of 1000 cells; `depth` gives the depths by column and
    /// row, in mm.
    fn range_image(depth: impl Fn(usize, usize) -> f64) -> RangeImage {
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
    fn cells_between_two_surfaces_are_removed_and_their_rims_stay() {
        // A post is in front of a wall. Two columns of flying pixels are to the left of the post, and one column is to its right.
        let image = range_image(|column, _| match column {
            14 => 900.0,
            15 => 700.0,
            16..=24 => 500.0,
            25 => 800.0,
            _ => 1000.0,
        });
        let expected =
            (0..30).flat_map(|row| [14, 15, 25].map(|column| [column, row])).collect::<Vec<_>>();
        assert_eq!(flying(&image, 2), expected);
        // If the depth jumps directly from the post to the wall, no cell is a flying pixel.
        let image =
            range_image(|column, _| if (16..25).contains(&column) { 500.0 } else { 1000.0 });
        assert!(flying(&image, 2).is_empty());
    }

    #[test]
    fn a_slanted_wall_stays_whole_up_to_the_angle() {
        for (angle, flies) in [(0.0, false), (60.0, false), (78.0, false), (82.0, true)] {
            let slope = libm::tan(f64::to_radians(angle));
            // The depth is that of the plane z = 1000 + slope * x on the ray x = z * t, where t is (column - 19.5) / 1000.
            let range =
                range_image(|column, _| 1000.0 / (1.0 - slope * (column as f64 - 19.5) / 1000.0));
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
        // The cells of a wire that is one row high have two neighbors on the wire; the two end cells have one.
        assert_eq!(flying(&range_image(depth), 2), [[10, 10], [20, 12], [29, 12]]);
        assert!(flying(&range_image(depth), 0).is_empty());
        let lonely =
            range_image(|column, row| if (column, row) == (3, 3) { 500.0 } else { f64::NAN });
        assert_eq!(flying(&lonely, 1), [[3, 3]]);
    }

    #[test]
    fn invalid_numbers_are_errors_and_an_empty_image_stays_empty() {
        let wall = range_image(|_, _| 1000.0);
        for angle in [44.0, 91.0, f64::NAN] {
            let error = flying_pixels(&wall, angle, 2).unwrap_err().to_string();
            assert_eq!(error, format!("`angle` is {angle}, but must be from 45 to 90 degrees"));
        }
        let error = flying_pixels(&wall, 80.0, 9).unwrap_err().to_string();
        assert_eq!(error, "`neighbors` is 9, but a cell has no more than 8");
        assert!(flying(&range_image(|_, _| f64::NAN), 2).is_empty());
        let empty = RangeImage::new(0, 0, Vec::new()).unwrap();
        assert!(flying_pixels(&empty, 80.0, 2).unwrap().is_empty());
    }
}
