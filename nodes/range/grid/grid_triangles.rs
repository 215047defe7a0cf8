//! The triangles between neighboring cells of a range grid, and their orientation.
//!
//! Four cells that share a corner form a *quad*. `a` is the upper left cell of a quad:
//!
//! ```text
//!     a---b        Seen from the sensor (x right, y down, z away) the cells of a triangle follow each other in the order
//!     |   |        a, d, c, b: counter-clockwise, and (second - first) x (third - first) points towards the sensor.
//!     d---c
//! ```

use maquette_value::RangeImage;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

/// One of the four possible triangles of a quad (four cells that share a corner). Two triangles that share a diagonal fill the quad.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Below the diagonal from a to c.
    Adc,
    /// Above the diagonal from a to c.
    Acb,
    /// Above the diagonal from b to d.
    Adb,
    /// Below the diagonal from b to d, with the corners b, d and c.
    Bdc,
}

/// A triangle between neighboring cells of a range grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridTriangle {
    /// The quad (four cells that share a corner), given by the index of its upper left cell.
    pub quad: u32,
    /// The part of the quad that the triangle fills.
    pub half: Half,
}

impl Half {
    /// Returns the bit that stands for the triangle in [`RangeImage::forced_triangles`].
    pub fn bit(self) -> u8 {
        match self {
            Self::Adc => 1 << 0,
            Self::Acb => 1 << 1,
            Self::Adb => 1 << 2,
            Self::Bdc => 1 << 3,
        }
    }
}

impl GridTriangle {
    /// Returns the indices of the three cells of the triangle in a grid of the given width, counter-clockwise as seen from the sensor.
    pub fn cells(self, width: usize) -> [usize; 3] {
        let a = self.quad as usize;
        let (b, c, d) = (a + 1, a + width + 1, a + width);
        match self.half {
            Half::Adc => [a, d, c],
            Half::Acb => [a, c, b],
            Half::Adb => [a, d, b],
            Half::Bdc => [b, d, c],
        }
    }

    /// Returns the wedges that the triangle fills at each of its cells, in the order of [`cells`](Self::cells). A wedge is one of eight
    /// sectors around a cell. Wedge 0 is between the neighbors to the right and to the lower right; the others follow clockwise as seen on
    /// the grid.
    ///
    /// Two triangles at one cell share an edge if and only if they have adjacent wedges at the cell. The two wedges of a cell in one quad
    /// belong to one triangle, or to two triangles that share the diagonal. Wedges of different quads are separated by the edge between the
    /// quads.
    pub fn wedges(self) -> [u8; 3] {
        const A: [u8; 2] = [1 << 0, 1 << 1];
        const B: [u8; 2] = [1 << 2, 1 << 3];
        const C: [u8; 2] = [1 << 4, 1 << 5];
        const D: [u8; 2] = [1 << 6, 1 << 7];
        match self.half {
            Half::Adc => [A[1], D[0] | D[1], C[0]],
            Half::Acb => [A[0], C[1], B[0] | B[1]],
            Half::Adb => [A[0] | A[1], D[0], B[1]],
            Half::Bdc => [B[0], D[1], C[0] | C[1]],
        }
    }
}

/// The maximum ratio of the squared diagonals b-d and a-c for which b-d counts as shorter. Without this margin, rounding errors would
/// choose the diagonals of the quads on a plane at random. The margin is far below the resolution of a scan.
const SHORTER: f64 = 1.0 - 1e-12;

/// Returns the triangles of a `width` x `height` grid that `keep` accepts, row by row from the top. A quad of four cells with points is
/// divided along its shorter diagonal, or from a to c if both are equally long. An exception is a quad that already has marked triangles:
/// `joined`, called with the quad's upper left cell, returns their bits, and their diagonal is used. A quad with three points has one
/// triangle. `keep` receives the points in the order of [`GridTriangle::cells`]. A cell without a point has NaN as x.
///
/// # Panics
/// Panics if the number of points is not the number of cells.
pub fn grid_triangles(
    width: usize,
    height: usize,
    points: &[Point3<f64>],
    joined: impl Fn(usize) -> u8 + Sync,
    keep: impl Fn(GridTriangle, [Point3<f64>; 3]) -> bool + Sync,
) -> Vec<GridTriangle> {
    assert_eq!(points.len(), width * height, "one point per cell");
    if width < 2 || height < 2 {
        return Vec::new();
    }
    (0..height - 1)
        .into_par_iter()
        .with_min_len(32)
        .flat_map_iter(|row: usize| {
            (row * width..(row + 1) * width - 1)
                .flat_map(|quad| quad_triangles(width, points, quad, joined(quad)))
                .filter(|triangle| keep(*triangle, triangle.cells(width).map(|cell| points[cell])))
        })
        .collect()
}

/// Returns the triangles of the quad whose upper left cell is `quad`; this cell must not be in the last column or row. `joined` has the
/// bits of the quad's marked triangles, whose diagonal is used; 0 if there are none.
pub(crate) fn quad_triangles(
    width: usize,
    points: &[Point3<f64>],
    quad: usize,
    joined: u8,
) -> impl Iterator<Item = GridTriangle> {
    let halves = halves([0, 1, width + 1, width].map(|step| points[quad + step]), joined);
    halves.into_iter().flatten().map(move |half| GridTriangle { quad: quad as u32, half })
}

/// Returns the triangles between those of the cells a, b, c, d of a quad that have points.
fn halves([a, b, c, d]: [Point3<f64>; 4], joined: u8) -> [Option<Half>; 2] {
    let from_b = Half::Adb.bit() | Half::Bdc.bit();
    match [a, b, c, d].map(|point| !point.x.is_nan()) {
        [true, true, true, true] => {
            if joined & from_b != 0
                || joined == 0 && (d - b).norm_squared() < (c - a).norm_squared() * SHORTER
            {
                [Some(Half::Adb), Some(Half::Bdc)]
            } else {
                [Some(Half::Adc), Some(Half::Acb)]
            }
        }
        [false, true, true, true] => [Some(Half::Bdc), None],
        [true, false, true, true] => [Some(Half::Adc), None],
        [true, true, false, true] => [Some(Half::Adb), None],
        [true, true, true, false] => [Some(Half::Acb), None],
        _ => [None, None],
    }
}

/// Returns the vector area of a triangle times two. For a triangle of [`grid_triangles`] that the sensor sees from the front, the vector
/// points towards the sensor.
pub(crate) fn double_area([first, second, third]: [Point3<f64>; 3]) -> Vector3<f64> {
    (second - first).cross(&(third - first))
}

/// The lines of sight of a range sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rays {
    /// Lines of sight start at the origin, where the sensor is.
    FromOrigin,
    /// Lines of sight are parallel to z. Used for a grid without a camera that has points at or behind the origin, so that the sensor
    /// cannot be at the origin.
    AlongZ,
}

impl Rays {
    /// Returns the lines of sight of the sensor that took `range`.
    pub fn new(range: &RangeImage) -> Self {
        if range.camera().is_none() && range.points().iter().any(|point| point.z <= 0.0) {
            Self::AlongZ
        } else {
            Self::FromOrigin
        }
    }

    /// Returns a vector along the line of sight through `point`, away from the sensor.
    pub fn direction(self, point: Point3<f64>) -> Vector3<f64> {
        match self {
            Self::FromOrigin => point.coords,
            Self::AlongZ => Vector3::z(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the points of a 2 x 2 grid at integer x and y, with the given depths.
    fn grid(depths: [[f64; 2]; 2]) -> Vec<Point3<f64>> {
        depths
            .into_iter()
            .flatten()
            .enumerate()
            .map(|(index, z): (usize, f64)| match z.is_nan() {
                true => Point3::new(f64::NAN, f64::NAN, f64::NAN),
                false => Point3::new((index % 2) as f64, (index / 2) as f64, z),
            })
            .collect()
    }

    fn halves_of(depths: [[f64; 2]; 2]) -> Vec<Half> {
        grid_triangles(2, 2, &grid(depths), |_| 0, |_, _| true)
            .into_iter()
            .map(|t| t.half)
            .collect()
    }

    #[test]
    fn triangles_of_a_frontal_plane_face_the_sensor() {
        let hole = f64::NAN;
        for depths in [
            [[9.0, 9.0], [9.0, 9.0]],
            [[9.0, 8.9], [8.9, 9.0]],
            [[9.1, 9.0], [9.0, 9.1]],
            [[hole, 9.0], [9.0, 9.0]],
            [[9.0, hole], [9.0, 9.0]],
            [[9.0, 9.0], [hole, 9.0]],
            [[9.0, 9.0], [9.0, hole]],
        ] {
            let points = grid(depths);
            let triangles = grid_triangles(2, 2, &points, |_| 0, |_, _| true);
            assert!(!triangles.is_empty());
            for triangle in triangles {
                let normal = double_area(triangle.cells(2).map(|cell| points[cell]));
                assert!(normal.z < -0.9, "{triangle:?} {normal}");
            }
        }
    }

    #[test]
    fn a_quad_is_divided_along_its_shorter_diagonal_and_of_equal_ones_that_from_a() {
        assert_eq!(halves_of([[5.0, 5.0], [5.0, 5.0]]), [Half::Adc, Half::Acb]);
        assert_eq!(halves_of([[5.0, 5.0], [5.0, 6.0]]), [Half::Adb, Half::Bdc]);
        assert_eq!(halves_of([[5.0, 6.0], [5.0, 5.0]]), [Half::Adc, Half::Acb]);
    }

    #[test]
    fn a_quad_of_three_cells_has_one_triangle_and_one_of_two_has_none() {
        let hole = f64::NAN;
        assert_eq!(halves_of([[hole, 5.0], [5.0, 5.0]]), [Half::Bdc]);
        assert_eq!(halves_of([[5.0, 5.0], [5.0, hole]]), [Half::Adb]);
        assert_eq!(halves_of([[5.0, hole], [hole, 5.0]]), []);
    }

    #[test]
    fn grids_without_quads_have_no_triangles() {
        for (width, height) in [(0, 0), (0, 3), (1, 3), (3, 1)] {
            let points = vec![Point3::origin(); width * height];
            assert_eq!(grid_triangles(width, height, &points, |_| 0, |_, _| true), []);
        }
    }

    #[test]
    fn points_behind_the_origin_give_parallel_rays() {
        fn rays(z: f64) -> Rays {
            Rays::new(&RangeImage::new(1, 1, vec![Point3::new(0.0, 0.0, z)]).unwrap())
        }
        assert_eq!(rays(5.0), Rays::FromOrigin);
        assert_eq!(rays(-5.0), Rays::AlongZ);
    }
}
