//! Tests of `harmonic`.

use maquette_node::Error;

use super::*;
use crate::control_net::tests::{range, region};
use crate::control_net::{NetMethod, control_net};

const HARMONIC: NetMethod = NetMethod::Harmonic { corners: None };

fn net(region: &Region, range: &RangeImage, rows: usize, columns: usize) -> value::ControlNet {
    control_net(region, range, HARMONIC, rows, columns, &Progress::silent()).unwrap()
}

// Tests the method `Harmonic`.
#[test]
fn a_planar_rectangle_is_its_own_net() {
    let range = range(20, 16, |x, y| 700.0 + 0.3 * x - 0.2 * y);
    for (width, height) in [(7, 5), (5, 7), (6, 6), (4, 11)] {
        let rectangle =
            region(&range, |x, y| (5..5 + width).contains(&x) && (3..3 + height).contains(&y));
        let net = net(&rectangle, &range, 0, 0);
        assert_eq!((net.rows(), net.columns()), (height, width));
        let coordinates = &net.chart().unwrap().coordinates;
        for (index, point) in net.points().iter().enumerate() {
            let (row, column) = (index / width, index % width);
            let border = row % (height - 1) == 0 || column % (width - 1) == 0;
            assert_eq!(net.fixed_points()[index] == 1, border);
            if border {
                assert_eq!(*point, rectangle.points()[index], "bitwise");
            }
            assert!((point - rectangle.points()[index]).norm() <= 1e-10);
            let [a, b] = coordinates[index];
            assert!((a - row as f64).abs() <= 1e-10 && (b - column as f64).abs() <= 1e-10);
        }
    }
}

/// Returns a pseudorandom number from 0 to 1.
fn noise(k: u32) -> f64 {
    f64::from((k.wrapping_mul(2_654_435_761) ^ (k << 7)).wrapping_mul(40_503) >> 8)
        / f64::from(1 << 24)
}

/// Returns the shape of a region: a disk whose contour has three to six bays of pseudorandom depth, or a horseshoe.
fn blob(kind: u32) -> impl Fn(usize, usize) -> bool {
    let bays = f64::from(3 + kind % 4);
    let (depth, turn) = (0.15 + 0.35 * noise(kind), 6.0 * noise(kind + 1000));
    move |x, y| {
        let (x, y) = (x as f64 - 24.0, y as f64 - 24.0);
        let (radius, angle) = (libm::hypot(x, y), libm::atan2(y, x));
        if kind % 5 == 4 {
            return (9.0..20.0).contains(&radius) && (angle + turn - 3.0).abs() > 0.5;
        }
        radius < 14.0 * (1.0 + depth * libm::sin(bays * angle + turn))
    }
}

#[test]
fn no_triangle_turns_over() {
    let range = range(48, 48, |_, _| 1.0);
    for kind in 0..40 {
        let blob = region(&range, blob(kind));
        let window = GridWindow::new(&blob, &range, 0, &Progress::silent()).unwrap();
        let disk = Disk::new(window.rows, window.columns, &window.inside).unwrap();
        let square = map_to_square(&disk, &Sides::new(&disk, chosen_corners(&disk))).unwrap();
        for triangle in &disk.triangles {
            let [a, b, c] = triangle.map(|vertex| square[vertex as usize]);
            assert!(cross(a, b, c) > 0.0, "blob {kind}: {}", cross(a, b, c));
        }
    }
}

#[test]
fn nets_of_regions_with_bays_and_holes_face_the_sensor() {
    let range = range(48, 48, |x, y| 700.0 - 0.01 * (x * x + y * y));
    for kind in 0..20 {
        let shape = blob(kind);
        let holed = region(&range, |x, y| shape(x, y) && !(22..25).contains(&x));
        let whole = region(&range, shape);
        let net = net(&whole, &range, 0, 0);
        fn point(row: usize, column: usize, net: &maquette_value::ControlNet) -> Point3<f64> {
            net.points()[row * net.columns() + column]
        }
        let (row, column) = (net.rows() / 2, net.columns() / 2);
        let (down, right) = (
            point(row + 1, column, &net) - point(row, column, &net),
            point(row, column + 1, &net) - point(row, column, &net),
        );
        assert!(down.cross(&right).z < 0.0);
        let chart = net.chart().unwrap();
        assert_eq!(&*chart.cells, whole.cells());
        // A region in two parts is an error, unless one of them has no triangle. Both results are correct, so check only that nothing
        // panics.
        let _ = control_net(&holed, &range, HARMONIC, 0, 0, &Progress::silent());
    }
}

#[test]
fn given_corners_are_the_corners_of_the_net() {
    let range = range(30, 24, |x, y| 700.0 + 0.3 * x - 0.2 * y);
    let rectangle = region(&range, |x, y| (5..21).contains(&x) && (3..15).contains(&y));
    fn net_with_corners(
        corners: [[usize; 2]; 4],
        rectangle: &Region,
        range: &RangeImage,
    ) -> Result<maquette_value::ControlNet, Error> {
        let method = NetMethod::Harmonic { corners: Some(corners) };
        control_net(rectangle, range, method, 7, 5, &Progress::silent())
    }
    // The list of corners starts one corner later than usual. The third corner is in the middle of a side of the region, and is given
    // slightly outside of the region.
    let net = net_with_corners([[5, 14], [20, 14], [22, 8], [5, 3]], &rectangle, &range).unwrap();
    fn horizontal_position(
        row: usize,
        column: usize,
        net: &maquette_value::ControlNet,
    ) -> [f64; 2] {
        let point = net.points()[row * 5 + column];
        [point.x, point.y]
    }
    assert_eq!(
        [horizontal_position(0, 0, &net), horizontal_position(6, 0, &net)],
        [[5.0, 14.0], [20.0, 14.0]]
    );
    assert_eq!(
        [horizontal_position(6, 4, &net), horizontal_position(0, 4, &net)],
        [[20.0, 8.0], [5.0, 3.0]]
    );
    let chart = net.chart().unwrap();
    assert_eq!(chart.coordinates[rectangle.find(8 * 30 + 20).unwrap()], [6.0, 4.0]);
    // Explicit corners equal to the automatic ones give the same net.
    let given = net_with_corners([[5, 3], [5, 14], [20, 14], [20, 3]], &rectangle, &range).unwrap();
    assert_eq!(
        given,
        control_net(&rectangle, &range, HARMONIC, 7, 5, &Progress::silent()).unwrap()
    );

    let off = "corner (12, 8) is not on the region's contour: the nearest cell there is (12, 3)";
    let order = "the corners do not follow each other counter-clockwise along the region's contour";
    for (corners, expected) in [
        ([[5, 3], [5, 14], [20, 14], [12, 8]], off),
        ([[usize::MAX; 2]; 4], "is not on the region's contour"),
        ([[5, 3], [20, 3], [20, 14], [5, 14]], order),
        ([[5, 3], [5, 3], [20, 14], [20, 3]], order),
    ] {
        let error = net_with_corners(corners, &rectangle, &range).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn spikes_get_the_position_of_their_base_cell_and_parts_are_refused() {
    let range = range(16, 12, |_, _| 1.0);
    let spiked = region(&range, |x, y| (x < 6 && y < 5) || (y == 2 && x < 10));
    let net = net(&spiked, &range, 5, 9);
    let chart = net.chart().unwrap();
    fn position(
        x: usize,
        spiked: &Region,
        chart_coordinates: &maquette_value::Column<[f64; 2]>,
    ) -> [f64; 2] {
        chart_coordinates[spiked.find(2 * 16 + x).unwrap()]
    }
    assert_eq!(position(9, &spiked, &chart.coordinates), position(7, &spiked, &chart.coordinates));
    fn error(region: &Region, range: &RangeImage) -> String {
        control_net(region, range, HARMONIC, 0, 0, &Progress::silent()).unwrap_err().to_string()
    }
    assert_eq!(error(&region(&range, |x, _| !(4..=9).contains(&x)), &range), PARTS);
    let line = "the region has 1 rows and 9 columns of cells, but a surface needs 2 of both; choose a larger region";
    assert_eq!(error(&region(&range, |x, y| y == 4 && x < 9), &range), line);
}
