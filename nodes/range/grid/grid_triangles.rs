//! The triangles between neighboring cells of a range grid, and where they look.
//!
//! Four cells that share a corner make a *quad*; `a` is its upper left cell:
//!
//! ```text
//!     a---b        Seen from the sensor (x right, y down, z away) the cells of a triangle follow each other in the order
//!     |   |        a, d, c, b: counter-clockwise, and (second - first) x (third - first) points towards the sensor.
//!     d---c
//! ```

use maquette_value::RangeImage;
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

/// One of the four triangles that a quad may have; two that share the diagonal fill it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Below the diagonal from a to c.
    Adc,
    /// Above the diagonal from a to c.
    Acb,
    /// Above the diagonal from b to d.
    Adb,
    /// Below the diagonal from b to d.
    Bdc,
}

/// A triangle between cells of a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridTriangle {
    /// The upper left cell of its quad.
    pub quad: u32,
    /// Which part of the quad it fills.
    pub half: Half,
}

impl Half {
    /// Its bit in [`RangeImage::joined`].
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
    /// Its three cells, counter-clockwise seen from the sensor, by index in a grid of this width.
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

    /// Which of the eight wedges around each of its cells it fills, in the order of [`cells`](Self::cells). Wedge 0 lies between
    /// the neighbors to the right and to the lower right; the others follow clockwise as one sees the grid.
    ///
    /// Two triangles at one cell share an edge if and only if wedges of theirs lie side by side: the two wedges of a cell in one
    /// quad belong to one triangle or to two that share the diagonal, and between wedges of two quads lies the quads' edge.
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

/// By how much the diagonal from b to d must be shorter (squared, relative) to be taken: rounding must not divide a plane's
/// quads at random. It is far below what a scan resolves.
const SHORTER: f64 = 1.0 - 1e-12;

/// The triangles of a `width` x `height` grid that `keep` takes, row by row from the top. A quad of four cells with points is
/// divided along its shorter diagonal, of two equal ones that from a to c, unless `joined`, which is asked for its upper left cell, says
/// that it was divided before; a quad of three has one triangle. `keep` is given the points in the order of [`GridTriangle::cells`]; a
/// cell without a point is NaN in x.
///
/// # Panics
/// If there are more or fewer points than cells.
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

/// The triangles of the quad whose upper left cell is `quad`, not in the last column or row; `joined` is as it was divided before.
pub(crate) fn quad_triangles(
    width: usize,
    points: &[Point3<f64>],
    quad: usize,
    joined: u8,
) -> impl Iterator<Item = GridTriangle> {
    let halves = halves([0, 1, width + 1, width].map(|step| points[quad + step]), joined);
    halves.into_iter().flatten().map(move |half| GridTriangle { quad: quad as u32, half })
}

/// How the cells a, b, c, d of a quad are joined.
fn halves([a, b, c, d]: [Point3<f64>; 4], joined: u8) -> [Option<Half>; 2] {
    let from_b = Half::Adb.bit() | Half::Bdc.bit();
    let is_shorter = || (d - b).norm_squared() < (c - a).norm_squared() * SHORTER;
    match [a, b, c, d].map(|point| !point.x.is_nan()) {
        [true, true, true, true] => {
            if joined & from_b != 0 || joined == 0 && is_shorter() {
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

/// Twice the area of a triangle as a vector; towards the sensor for a triangle of [`grid_triangles`] that it can see.
pub(crate) fn double_area([first, second, third]: [Point3<f64>; 3]) -> Vector3<f64> {
    (second - first).cross(&(third - first))
}

/// The rays along which a sensor sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rays {
    /// From the origin.
    FromOrigin,
    /// Along z: points at or behind the origin of a grid without a camera say that the sensor is not there.
    AlongZ,
}

impl Rays {
    /// Those of the sensor that took `range`.
    pub fn of(range: &RangeImage) -> Self {
        if range.camera().is_none() && range.points().iter().any(|point| point.z <= 0.0) {
            Self::AlongZ
        } else {
            Self::FromOrigin
        }
    }

    /// A vector along the ray that meets `point`, away from the sensor.
    pub fn at(self, point: Point3<f64>) -> Vector3<f64> {
        match self {
            Self::FromOrigin => point.coords,
            Self::AlongZ => Vector3::z(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells at whole x and y, with the depths given.
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
    fn triangles_of_a_frontal_plane_look_towards_the_sensor() {
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
    fn points_behind_the_origin_say_that_the_sensor_is_elsewhere() {
        fn rays(z: f64) -> Rays {
            Rays::of(&RangeImage::new(1, 1, vec![Point3::new(0.0, 0.0, z)]).unwrap())
        }
        assert_eq!(rays(5.0), Rays::FromOrigin);
        assert_eq!(rays(-5.0), Rays::AlongZ);
    }
}
