//! Makes a rectangular control net for a region of a range grid.

use maquette_base::limits::POINTS;
use maquette_node::{Context, Error, FieldError, In, Node, Progress, bail};
use maquette_value as value;
use maquette_value::{RangeImage, Region};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::rim_distance::{Rectangle, rim_distances};
use super::grid::window::{GridWindow, place_region};
use super::net::parameterized::parameterize;
use super::net::{harmonic, polar, rows};

/// Makes a rectangular control net for a region of a range grid. Points on the region's border are fixed: an offset does not move them.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ControlNet {
    /// The cells to redesign. Where the range image has no point, the region's own point is used; if the range image has moved since, the
    /// point is moved with it.
    pub region: In<Region>,
    /// The range image of the region: its points make the net.
    pub range: In<RangeImage>,
    /// Placement of the net on the region.
    #[serde(default)]
    pub method: NetMethod,
    /// Number of rows, at least 2; 0 means as many as there are cells along them. Used by the methods `Rows`, `Polar` (rings, with the
    /// pole) and `Harmonic`.
    #[schemars(range(max = 4096))]
    #[serde(default)]
    pub rows: usize,
    /// Number of columns, at least 2; 0 means the median length of the region's rows, or half the length of its contour for `Polar`, at
    /// most 64. Used by the methods `Rows`, `Polar` (with the repeated columns) and `Harmonic`.
    #[schemars(range(max = 4096))]
    #[serde(default)]
    pub columns: usize,
}

/// Placement of a net on a region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum NetMethod {
    /// The method `Grid`.
    #[default]
    Auto,
    /// The range grid itself, in a rectangle around the region: keeps the sampling, and works for regions of any shape.
    Grid,
    /// The rows of the region, each divided evenly by arc length: for surfaces that replace the scan.
    Rows,
    /// Rings around the center of a star-shaped region. Needs knots of the kind `Periodic` along v.
    Polar {
        /// Order along v of the future surface: the last `order - 1` columns repeat the first ones.
        #[schemars(range(min = 2, max = 10))]
        #[serde(default = "default_order")]
        order: usize,
    },
    /// The region mapped to a square without overlap, its contour to the border: for regions of any shape. Holes are closed, and cells
    /// connected only by a corner or a line get the position of an adjacent cell.
    Harmonic {
        /// Cells (column, row) of the range grid for the first and the last point of the net's first column, then the last and the first
        /// point of its last column: counter-clockwise along the contour, on it or close to it. If omitted: the cells farthest along the
        /// diagonals, from the upper left one on.
        #[serde(default)]
        corners: Option<[[usize; 2]; 4]>,
    },
}

fn default_order() -> usize {
    3
}

impl Node for ControlNet {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn check(&self) -> Result<(), FieldError> {
        let (field, given) = match self.rows {
            0 => ("columns", self.columns),
            rows => ("rows", rows),
        };
        match self.method {
            _ if given == 0 => Ok(()),
            NetMethod::Auto | NetMethod::Grid => {
                let help = "choose a method that takes them, or leave them out";
                Err(FieldError::new(field, FIXED_SIZE, help))
            }
            _ if self.rows == 1 || self.columns == 1 => {
                let field = if self.rows == 1 { "rows" } else { "columns" };
                Err(FieldError::new(field, ONE_LINE, "write at least 2"))
            }
            _ => Ok(()),
        }
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (region, range) = (cx.get(&self.region), cx.get(&self.range));
        let net = control_net(region, range, self.method, self.rows, self.columns, cx.progress())?;
        if !net.fixed_points().contains(&0) {
            cx.warn(format!(
                "every one of the {} x {} points of the net is on the region's border: no offset will move it; choose a larger region, or more `rows` and `columns`",
                net.rows(),
                net.columns()
            ));
        }
        Ok((net,))
    }
}

/// The error message if `rows` or `columns` is given for a method that uses neither.
const FIXED_SIZE: &str = "`rows` and `columns` are for the methods `Rows`, `Polar` and `Harmonic`";

/// The error message for a net that would have only one row or column.
const ONE_LINE: &str = "a net has at least 2 rows and 2 columns";

/// Makes the control net of a region of `range`, with a net coordinate (position in the net) for each of the region's cells. Methods other
/// than `Auto` and [`NetMethod::Grid`] use `rows` and `columns`, where 0 means automatic.
///
/// # Errors
/// Returns an error if the region belongs to another grid or has only one cell, its shape is unsuitable for the method, or a size is given
/// that the method does not use.
pub fn control_net(
    region: &Region,
    range: &RangeImage,
    method: NetMethod,
    rows: usize,
    columns: usize,
    progress: &Progress<'_>,
) -> Result<value::ControlNet, Error> {
    let region_size = [region.width(), region.height()];
    let range_size = [range.width(), range.height()];
    if region_size != range_size {
        bail!(
            "the region is part of a grid of {region_size:?} cells, the range image has {range_size:?}"
        );
    }
    if region.cells().len() == 1 {
        return Err(harmonic::degenerate_region(1, 1));
    }
    if (rows, columns) != (0, 0) {
        let (low, high) = region.bounds();
        fn cells(axis: usize, high: [usize; 2], low: [usize; 2]) -> usize {
            high[axis] - low[axis] + 1
        }
        fn count_or(given: usize, cells: usize) -> f64 {
            (if given == 0 { cells } else { given }) as f64
        }
        POINTS.check(
            "the net",
            count_or(rows, cells(1, high, low)) * count_or(columns, cells(0, high, low)),
        )?;
    }
    let region = &*place_region(region, range, progress)?;
    let net = match method {
        NetMethod::Auto | NetMethod::Grid if (rows, columns) != (0, 0) => {
            bail!("{FIXED_SIZE}")
        }
        NetMethod::Auto | NetMethod::Grid => grid(region, range, progress),
        _ if rows == 1 || columns == 1 => bail!("{ONE_LINE}"),
        NetMethod::Rows => rows::net(region, range, rows, columns),
        NetMethod::Polar { order } => polar::net(region, range, order, [rows, columns], progress),
        NetMethod::Harmonic { corners } => {
            harmonic::net(region, range, corners, [rows, columns], progress)
        }
    }?;
    Ok(net.with_frame(range.capture_frame().ok()))
}

/// Padding on each side of the region's bounding rectangle, in cells. For surfaces up to this degree, moved points of the region have no
/// effect outside of the net. With less padding, the clamped ends of the knot vectors would reach into the region; more padding costs time.
const PADDING: usize = 3;

/// Makes a net of the range grid's points in the padded bounding rectangle of the region. A point is free if its cell and the four
/// neighbors of the cell are in the region. Each point has its distance from the rim of the region, if the region has a rim.
fn grid(
    region: &Region,
    range: &RangeImage,
    progress: &Progress<'_>,
) -> Result<value::ControlNet, Error> {
    let window = GridWindow::new(region, range, PADDING, progress)?;
    let (rows, columns) = (window.rows, window.columns);
    fn free(at: usize, columns: usize, rows: usize, window_inside: &[u8]) -> bool {
        let (row, column) = (at / columns, at % columns);
        let interior = 0 < row && row + 1 < rows && 0 < column && column + 1 < columns;
        let near = [at, at.wrapping_sub(columns), at.wrapping_sub(1), at + 1, at + columns];
        interior && near.iter().all(|&at| window_inside[at] == 1)
    }
    let coordinates = region.cells().iter().map(|&cell| window.place(cell).map(|at| at as f64));
    let (cells, coordinates) = (region.cells().to_vec(), coordinates.collect());
    let rectangle = Rectangle { low: [window.left, window.top], size: [columns, rows] };
    let net = parameterize(
        range,
        [rows, columns],
        window.points,
        |row: usize, column: usize| !free(row * columns + column, columns, rows, &window.inside),
        cells,
        coordinates,
    )?;
    let net = net.with_interpolated(window.interpolated)?;
    Ok(match rim_distances(region, rectangle) {
        Some(distances) => net.with_rim_distances(distances)?,
        None => net,
    })
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Returns a range image of points (column, row, depth), invalid where the depth is NaN.
    pub(crate) fn range(
        width: usize,
        height: usize,
        depth: impl Fn(f64, f64) -> f64,
    ) -> RangeImage {
        RangeImage::new(
            width,
            height,
            (0..width * height)
                .map(|cell: usize| {
                    let (x, y) = ((cell % width) as f64, (cell / width) as f64);
                    Point3::new(x, y, depth(x, y))
                })
                .collect(),
        )
        .unwrap()
    }

    /// Returns the region of the cells of `range` for which `inside` is true. Cells without a point get a point of depth 0 and are flagged
    /// as filled.
    pub(crate) fn region(range: &RangeImage, inside: impl Fn(usize, usize) -> bool) -> Region {
        let (width, height) = (range.width(), range.height());
        let cells: Vec<u32> = (0..width * height)
            .filter(|cell| inside(cell % width, cell / width))
            .map(|cell| cell as u32)
            .collect();
        let (points, flags) = (
            cells
                .iter()
                .map(|&cell| {
                    let (x, y) = (cell as usize % width, cell as usize / width);
                    range.point(cell as usize).unwrap_or(Point3::new(x as f64, y as f64, 0.0))
                })
                .collect(),
            cells.iter().map(|&cell| u8::from(range.point(cell as usize).is_none())).collect(),
        );
        Region::new(width, height, cells, points, flags, Vec::new()).unwrap()
    }

    fn net(region: &Region, range: &RangeImage) -> value::ControlNet {
        control_net(region, range, NetMethod::Auto, 0, 0, &Progress::silent()).unwrap()
    }

    #[test]
    fn a_rectangle_is_its_own_net_with_padding() {
        let range = range(20, 16, |x, y| 700.0 + 0.3 * x - 0.2 * y);
        let rectangle = region(&range, |x, y| (5..12).contains(&x) && (6..11).contains(&y));
        let net = net(&rectangle, &range);
        assert_eq!((net.rows(), net.columns()), (5 + 6, 7 + 6));
        for row in 0..11 {
            for column in 0..13 {
                let cell = (row + 3) * 20 + column + 2;
                assert_eq!(net.points()[row * 13 + column], range.points()[cell]);
                let free = (4..7).contains(&row) && (4..9).contains(&column);
                assert_eq!(net.fixed_points()[row * 13 + column] == 0, free, "({row}, {column})");
            }
        }
        let chart = net.chart().unwrap();
        assert_eq!(&*chart.cells, rectangle.cells());
        assert_eq!((chart.grid, chart.coordinates[0]), ([20, 16], [3.0, 3.0]));
    }

    #[test]
    fn the_net_ends_where_the_grid_ends() {
        let range = range(6, 5, |_, _| 1.0);
        let net = net(&region(&range, |x, y| x < 4 && y < 3), &range);
        assert_eq!((net.rows(), net.columns()), (5, 6));
        assert_eq!(net.chart().unwrap().coordinates[0], [0.0, 0.0]);
        // The points of cells on the border of the range grid are fixed, since these cells lack a neighbor.
        let free: Vec<usize> = (0..30).filter(|&at| net.fixed_points()[at] == 0).collect();
        assert_eq!(free, [7, 8]);
    }

    #[test]
    fn invalid_cells_around_the_region_are_filled_smoothly_and_its_own_points_are_kept() {
        fn hole(x: f64, y: f64) -> bool {
            (x, y) == (3.0, 3.0) || (x, y) == (1.0, 4.0)
        }
        let range = range(9, 9, |x, y| if hole(x, y) { f64::NAN } else { 2.0 * x });
        let region = region(&range, |x, y| (2..7).contains(&x) && (2..7).contains(&y));
        let net = net(&region, &range);
        assert_eq!(net.points()[3 * 9 + 3], Point3::new(3.0, 3.0, 0.0));
        assert!((net.points()[4 * 9 + 1] - Point3::new(1.0, 4.0, 2.0)).norm() <= 1e-11);
    }

    #[test]
    fn every_method_takes_its_points_from_the_range() {
        fn hole(x: f64, y: f64) -> bool {
            (x, y) == (5.0, 5.0)
        }
        let scan = range(12, 12, |x, y| if hole(x, y) { f64::NAN } else { 500.0 + x * y });
        let disk = region(&scan, |x, y| (2..9).contains(&x) && (2..9).contains(&y));
        let away = range(12, 12, |x, y| if hole(x, y) { f64::NAN } else { 1500.0 + x * y });
        for method in [
            NetMethod::Grid,
            NetMethod::Rows,
            NetMethod::Polar { order: 3 },
            NetMethod::Harmonic { corners: None },
        ] {
            fn net(
                range: &RangeImage,
                disk: &Region,
                method: &NetMethod,
            ) -> maquette_value::ControlNet {
                control_net(disk, range, *method, 0, 0, &Progress::silent()).unwrap()
            }
            let (near, far) = (net(&scan, &disk, &method), net(&away, &disk, &method));
            for (near, far) in near.points().iter().zip(far.points()) {
                let moved = far - near - nalgebra::Vector3::new(0.0, 0.0, 1000.0);
                assert!(moved.norm() < 1e-6, "{method:?}: {near} {far}");
            }
        }
    }

    #[test]
    fn regions_and_sizes_that_do_not_fit_are_refused() {
        let (range, turned) = (range(6, 5, |_, _| 1.0), range(5, 6, |_, _| 1.0));
        fn error(
            region: &Region,
            method: NetMethod,
            rows: usize,
            columns: usize,
            range: &RangeImage,
        ) -> String {
            control_net(region, range, method, rows, columns, &Progress::silent())
                .unwrap_err()
                .to_string()
        }
        let point = region(&range, |x, y| (x, y) == (2, 2));
        let all = region(&range, |_, _| true);
        let degenerate = "the region has 1 rows and 1 columns of cells, but a surface needs 2 of both; choose a larger region";
        assert_eq!(error(&point, NetMethod::Grid, 0, 0, &range), degenerate);
        assert_eq!(error(&point, NetMethod::Rows, 0, 0, &range), degenerate);
        assert_eq!(error(&all, NetMethod::Auto, 0, 9, &range), FIXED_SIZE);
        assert_eq!(error(&all, NetMethod::Rows, 1, 0, &range), ONE_LINE);
        for method in [NetMethod::Rows, NetMethod::Polar { order: 3 }] {
            let error = error(&all, method, 4096, 4096, &range);
            assert!(error.starts_with("the net would need about 17 000 000 points"), "{error}");
        }
        let other = region(&turned, |_, _| true);
        let size = "the region is part of a grid of [5, 6] cells, the range image has [6, 5]";
        assert_eq!(error(&other, NetMethod::Auto, 0, 0, &range), size);
    }
}
