//! Distances of cells from the rim of a region.

use maquette_value::Region;

/// Distances beyond this number of cells are not needed, and are cut off.
pub(crate) const MAX_DISTANCE: f64 = 3.0;

/// A rectangle of cells of a grid.
#[derive(Clone, Copy)]
pub(crate) struct Rectangle {
    /// The first column and row.
    pub(crate) low: [usize; 2],
    /// Number of columns and rows.
    pub(crate) size: [usize; 2],
}

impl Rectangle {
    /// Returns the cells of one axis (0 for columns, 1 for rows) that are at most [`MAX_DISTANCE`] away from the given range of positions,
    /// counted from the start of the rectangle.
    fn near(&self, axis: usize, low: f64, high: f64) -> std::ops::Range<usize> {
        let end = self.size[axis] as f64;
        let first = (low - MAX_DISTANCE - self.low[axis] as f64).ceil().clamp(0.0, end);
        let last = (high + MAX_DISTANCE - self.low[axis] as f64).floor() + 1.0;
        first as usize..last.clamp(first, end) as usize
    }
}

/// Returns the distance of each cell of a rectangle, row by row, from the nearest rim of the region, in cells: positive inside and negative
/// outside, between -3 and 3. `None` if the region has no rims.
pub(crate) fn rim_distances(region: &Region, cells: Rectangle) -> Option<Vec<f64>> {
    let rims = region.contours().iter().map(|contour| &contour.rim);
    if rims.clone().next().is_none() || rims.clone().any(Vec::is_empty) {
        return None;
    }
    let [columns, rows] = cells.size;
    let mut distances = vec![MAX_DISTANCE; columns * rows];
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); rows];
    for rim in rims {
        for (&a, &b) in rim.iter().zip(rim.iter().cycle().skip(1)) {
            measure(cells, a, b, &mut distances);
            cross_rows(cells, a, b, &mut crossings);
        }
    }
    for (row, crossings) in crossings.iter_mut().enumerate() {
        crossings.sort_by(f64::total_cmp);
        for column in 0..columns {
            let x = (cells.low[0] + column) as f64;
            if crossings.partition_point(|crossing| *crossing <= x).is_multiple_of(2) {
                distances[row * columns + column] *= -1.0;
            }
        }
    }
    Some(distances)
}

/// Lowers the distances of the cells near the side from `a` to `b` of a rim.
fn measure(cells: Rectangle, a: [f64; 2], b: [f64; 2], distances: &mut [f64]) {
    let [columns, rows] = [0, 1].map(|axis| {
        let (low, high) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
        cells.near(axis, low, high)
    });
    let side = [b[0] - a[0], b[1] - a[1]];
    let length_sq = side[0] * side[0] + side[1] * side[1];
    for row in rows {
        for column in columns.clone() {
            let at = [(cells.low[0] + column) as f64 - a[0], (cells.low[1] + row) as f64 - a[1]];
            let share = (at[0] * side[0] + at[1] * side[1]) / length_sq;
            let share = if length_sq > 0.0 { share.clamp(0.0, 1.0) } else { 0.0 };
            let distance = libm::hypot(at[0] - share * side[0], at[1] - share * side[1]);
            let nearest = &mut distances[row * cells.size[0] + column];
            *nearest = nearest.min(distance);
        }
    }
}

/// Adds the columns at which the side from `a` to `b` of a rim crosses the rows of cells.
fn cross_rows(cells: Rectangle, a: [f64; 2], b: [f64; 2], crossings: &mut [Vec<f64>]) {
    let (low, high) = (a[1].min(b[1]), a[1].max(b[1]));
    let rows = cells.near(1, low, high);
    for (row, crossings) in rows.clone().zip(&mut crossings[rows]) {
        let y = (cells.low[1] + row) as f64;
        if (low..high).contains(&y) {
            crossings.push(a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1])));
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Contour;
    use nalgebra::Point3;

    use super::*;

    /// Returns a region with the given rims; its only cell has no influence.
    fn region(rims: Vec<Vec<[f64; 2]>>) -> Region {
        let contours =
            rims.into_iter().map(|rim| Contour { hole: false, cells: vec![0], rim }).collect();
        Region::new(20, 20, vec![0], vec![Point3::origin()], vec![0], contours).unwrap()
    }

    #[test]
    fn distances_are_positive_inside_of_a_ring() {
        fn circle(radius: f64) -> Vec<[f64; 2]> {
            let angles = (0..200).map(|k| f64::from(k) * std::f64::consts::TAU / 200.0);
            angles
                .map(|angle| {
                    let (sin, cos) = libm::sincos(angle);
                    [9.5 + radius * cos, 9.3 + radius * sin]
                })
                .collect()
        }
        let cells = Rectangle { low: [1, 2], size: [17, 15] };
        let distances = rim_distances(&region(vec![circle(7.0), circle(4.0)]), cells).unwrap();
        for (at, distance) in distances.iter().enumerate() {
            let (x, y) = ((1 + at % 17) as f64 - 9.5, (2 + at / 17) as f64 - 9.3);
            let radius = (x * x + y * y).sqrt();
            let exact = (7.0 - radius).min(radius - 4.0).clamp(-3.0, 3.0);
            assert!((distance - exact).abs() < 0.01, "{at}: {distance} {exact}");
        }
    }

    #[test]
    fn a_region_without_rims_has_no_distances() {
        let cells = Rectangle { low: [0; 2], size: [3; 2] };
        assert_eq!(rim_distances(&region(vec![]), cells), None);
        assert_eq!(rim_distances(&region(vec![vec![]]), cells), None);
    }
}
