//! Tests of `blend`.

use maquette_node::Progress;
use maquette_range::triangulate;
use maquette_value as value;
use maquette_value::Pinhole;
use maquette_value::hash_of;
use nalgebra::Unit;

use super::super::control_net::tests::{range, region};
use super::super::control_net::{NetMethod, control_net};
use super::super::nurbs::nurbs;
use super::super::offset_net::{OffsetStep, offset_net};
use super::*;
use crate::grid::distance::from_border;
use crate::net::profile::Profile;

const ALL_MODES: [BlendMode; 3] =
    [BlendMode::Displacement, BlendMode::Replace, BlendMode::Feather { band: 3.0 }];

/// Returns a rough scan with a hole.
fn bumpy() -> RangeImage {
    range(30, 26, |x, y| match (x, y) {
        (13.0, 12.0) => f64::NAN,
        _ => 700.0 + 0.3 * libm::sin(7.0 * x) * libm::cos(5.0 * y) - 0.02 * x * y,
    })
}

fn disk(range: &RangeImage) -> Region {
    region(range, |x, y| x.abs_diff(14).pow(2) + y.abs_diff(13).pow(2) < 64)
}

fn surface(
    range: &RangeImage,
    region: &Region,
    method: NetMethod,
    order: usize,
    growth: f64,
) -> Surface {
    let net = control_net(region, range, method, 0, 0, &Progress::silent()).unwrap();
    let sensor = Unit::new_unchecked(-Vector3::z());
    let steps = [OffsetStep { distance: growth, angle: 0.0, axis: [0.0; 3] }];
    let net =
        offset_net(&net, Some(sensor), None, None, &steps, Profile::Cosine, &Progress::silent())
            .unwrap();
    nurbs(&net, None, None, Some([order; 2])).unwrap()
}

fn bits(point: Option<Point3<f64>>) -> Option<[u64; 3]> {
    point.map(|point| [0, 1, 2].map(|k| point[k].to_bits()))
}

#[test]
fn a_displacement_by_nothing_keeps_every_bit() {
    let range = bumpy();
    let region = disk(&range);
    for order in 2..=5 {
        let surface = surface(&range, &region, NetMethod::Grid, order, 0.0);
        let same =
            blend(&range, &region, &surface, BlendMode::Displacement, [1, 1], &Progress::silent())
                .unwrap();
        for cell in 0..range.points().len() {
            let before = match region.find(cell) {
                Some(index) => Some(region.points()[index]),
                None => range.point(cell),
            };
            assert_eq!(bits(same.range.point(cell)), bits(before));
            assert_eq!(same.range.is_filled(cell), range.point(cell).is_none());
        }
        assert_eq!(same.folded, 0);
    }
}

#[test]
fn a_plane_replaced_by_its_surface_is_the_same_plane() {
    let range = range(22, 19, |x, y| 700.0 + 0.3 * x - 0.2 * y);
    let rectangle = region(&range, |x, y| (4..17).contains(&x) && (5..15).contains(&y));
    for (region, method) in [
        (&rectangle, NetMethod::Grid),
        (&rectangle, NetMethod::Rows),
        (&rectangle, NetMethod::Harmonic { corners: None }),
        (&disk(&range), NetMethod::Grid),
    ] {
        for order in 2..=5 {
            let surface = surface(&range, region, method, order, 0.0);
            let same =
                blend(&range, region, &surface, BlendMode::Replace, [1, 1], &Progress::silent())
                    .unwrap();
            for (before, after) in range.points().iter().zip(same.range.points()) {
                assert!((before - after).norm() <= 1e-12, "{method:?} {order} {before}");
            }
        }
    }
}

#[test]
fn cells_outside_of_the_region_keep_every_bit() {
    let range = bumpy();
    let region = disk(&range);
    let surface = surface(&range, &region, NetMethod::Grid, 3, 9.0);
    for mode in ALL_MODES {
        let after =
            blend(&range, &region, &surface, mode, [1, 1], &Progress::silent()).unwrap().range;
        let mut changed = 0;
        for cell in 0..range.points().len() {
            let same = bits(range.point(cell)) == bits(after.point(cell));
            assert!(same || region.find(cell).is_some());
            changed += usize::from(!same);
        }
        assert!(changed > 100, "{mode:?}");
    }
}

#[test]
fn another_surface_is_written_to_the_range_image_that_was_made() {
    let (range, nose) = face();
    let mut points = range.points().to_vec();
    let beside = (20 * 49 + 24..).find(|cell| !nose.cells().contains(cell)).unwrap();
    for cell in [beside as usize, beside as usize + 1, 22 * 49 + 24] {
        points[cell] = Point3::new(f64::NAN, f64::NAN, f64::NAN);
    }
    let range = range.with_points(points).unwrap();
    let [before, now] = [3.0, 30.0].map(|by| surface(&range, &nose, NetMethod::Grid, 3, by));
    for mode in ALL_MODES {
        let [made, expected] = [&before, &now].map(|surface| {
            blend(&range, &nose, surface, mode, [1, 1], &Progress::silent()).unwrap()
        });
        let followed = follow(&range, &nose, &now, mode, &made.range).unwrap();
        assert_eq!(hash_of(&followed.range), hash_of(&expected.range), "{mode:?}");
        assert_eq!((followed.folded, followed.seam), (expected.folded, expected.seam), "{mode:?}");
        assert!(followed.range.is_filled(beside as usize));
    }
}

#[test]
fn replacing_leaves_a_known_part_of_a_spike() {
    let range = range(22, 20, |x: f64, y: f64| if (x, y) == (11.0, 10.0) { 1.0 } else { 0.0 });
    let region = region(&range, |x, y| (4..18).contains(&x) && (4..17).contains(&y));
    for (order, left) in [(4, 16.0 / 36.0), (3, 36.0 / 64.0)] {
        let surface = surface(&range, &region, NetMethod::Grid, order, 0.0);
        let after =
            blend(&range, &region, &surface, BlendMode::Replace, [1, 1], &Progress::silent())
                .unwrap();
        let height = after.range.points()[10 * 22 + 11].z;
        assert!((height - left).abs() <= 1e-12, "{height}");
    }
}

/// Returns a synthetic scan of a face, and its nose as a region. The nose is a half sphere with a radius of 13 cells; cells are 1 mm apart.
fn face() -> (RangeImage, Region) {
    fn height_sq(x: f64, y: f64) -> f64 {
        169.0 - (x - 24.0) * (x - 24.0) - (y - 22.0) * (y - 22.0)
    }
    fn noise(x: f64, y: f64) -> f64 {
        0.05 * libm::sin(12.9898 * x + 78.233 * y)
    }
    let range = range(49, 45, |x, y| 700.0 - height_sq(x, y).max(0.0).sqrt() + noise(x, y));
    let region = region(&range, |x, y| height_sq(x as f64, y as f64) > 0.0);
    (range, region)
}

#[test]
fn the_summit_moves_by_the_growth_and_the_contour_stays() {
    let (range, nose) = face();
    let growth = 12.0;
    for order in [3, 4] {
        let surface = surface(&range, &nose, NetMethod::Grid, order, growth);
        let after =
            blend(&range, &nose, &surface, BlendMode::Displacement, [1, 1], &Progress::silent())
                .unwrap();
        fn displacement(cell: usize, range: &RangeImage, after_range: &RangeImage) -> f64 {
            (after_range.points()[cell] - range.points()[cell]).norm()
        }
        let summit = displacement(22 * 49 + 24, &range, &after.range);
        assert!((summit - growth).abs() <= 0.1 * growth, "{summit}");
        let depths = from_border(&nose, 1.0);
        let contour = nose.cells().iter().zip(depths).filter(|(_, depth)| *depth <= 1.0);
        let most = contour
            .map(|(&cell, _)| displacement(cell as usize, &range, &after.range))
            .fold(0.0, f64::max);
        assert!(0.0 < most && most <= 0.015 * growth, "order {order}: {most}");
        assert_eq!(after.folded, 0);
    }
}

#[test]
fn the_methods_rows_and_feather_grow_the_nose_too() {
    let (range, nose) = face();
    for (method, mode) in [
        (NetMethod::Rows, BlendMode::Replace),
        (NetMethod::Rows, BlendMode::Displacement),
        (NetMethod::Harmonic { corners: None }, BlendMode::Replace),
        (NetMethod::Harmonic { corners: None }, BlendMode::Displacement),
        (NetMethod::Polar { order: 3 }, BlendMode::Displacement),
        (NetMethod::Grid, BlendMode::Feather { band: 4.0 }),
    ] {
        let surface = surface(&range, &nose, method, 3, 12.0);
        let after = blend(&range, &nose, &surface, mode, [1, 1], &Progress::silent()).unwrap();
        let summit = after.range.points()[22 * 49 + 24] - range.points()[22 * 49 + 24];
        assert!((summit.norm() - 12.0).abs() <= 1.5, "{method:?} {mode:?} {summit}");
    }
}

#[test]
fn a_surface_that_misses_the_border_leaves_a_seam() {
    let (range, nose) = face();
    let steps = |mode| {
        let surface = surface(&range, &nose, NetMethod::Grid, 3, 0.0);
        let raised: Vec<_> =
            surface.net().points().iter().map(|p| p - 9.0 * Vector3::z()).collect();
        let net = surface.net().clone().with_points(raised).unwrap();
        let surface = nurbs(&net, None, None, None).unwrap();
        blend(&range, &nose, &surface, mode, [1, 1], &Progress::silent()).unwrap().seam
    };
    let seam = steps(BlendMode::Replace).unwrap();
    assert!(seam.is_visible() && (seam.step - 9.0).abs() < 2.0, "{seam:?}");
    let faded = steps(BlendMode::Feather { band: 6.0 }).unwrap();
    assert!(!faded.is_visible(), "{faded:?}");
    assert_eq!(steps(BlendMode::Displacement), None);
}

#[test]
fn a_finer_grid_shows_the_same_nose() {
    let (range, nose) = face();
    let surface = surface(&range, &nose, NetMethod::Grid, 3, 12.0);
    for mode in ALL_MODES {
        let coarse =
            blend(&range, &nose, &surface, mode, [1, 1], &Progress::silent()).unwrap().range;
        let fine = blend(&range, &nose, &surface, mode, [3, 1], &Progress::silent()).unwrap().range;
        assert_eq!((fine.width(), fine.height()), (49, 135));
        // Each old row is divided into three, and the middle new row coincides with the old row.
        for cell in 0..coarse.points().len() {
            let there = (cell / 49 * 3 + 1) * 49 + cell % 49;
            let difference = fine.points()[there] - coarse.points()[cell];
            assert!(difference.norm() <= 1e-9, "{mode:?}, cell {cell}: {difference}");
        }
    }
}

#[test]
fn a_point_pulled_aside_folds() {
    let (range, nose) = face();
    let net = control_net(&nose, &range, NetMethod::Grid, 0, 0, &Progress::silent()).unwrap();
    let aside = Some(Unit::new_unchecked(Vector3::x()));
    let steps = [OffsetStep { distance: 30.0, angle: 0.0, axis: [0.0; 3] }];
    let net =
        offset_net(&net, aside, None, None, &steps, Profile::Cosine, &Progress::silent()).unwrap();
    let surface = nurbs(&net, None, None, None).unwrap();
    let camera = Pinhole { focal: [700.0; 2], center: [0.0; 2] };
    for camera in [None, Some(camera)] {
        let range = range.clone().with_camera(camera);
        let after =
            blend(&range, &nose, &surface, BlendMode::Displacement, [1, 1], &Progress::silent())
                .unwrap();
        assert!(after.folded > 20, "{}", after.folded);
    }
}

#[test]
fn surfaces_that_do_not_belong_to_the_range_are_refused() {
    let range = bumpy();
    let disk = disk(&range);
    let fitting = surface(&range, &disk, NetMethod::Grid, 3, 1.0);
    fn error(
        range: &RangeImage,
        region: &Region,
        surface: &Surface,
        resample: [usize; 2],
    ) -> String {
        blend(range, region, surface, BlendMode::Replace, resample, &Progress::silent())
            .unwrap_err()
            .to_string()
    }
    let free = value::ControlNet::new(3, 3, vec![Point3::origin(); 9]).unwrap();
    let free = nurbs(&free, None, None, None).unwrap();
    let no_chart =
        "the surface was not made from a region: the positions of cells on it are unknown";
    assert_eq!(error(&range, &disk, &free, [1, 1]), no_chart);
    let all = region(&range, |_, _| true);
    let not_there =
        "cell (0, 0) of the region is not on the surface, which was made from another region";
    assert_eq!(error(&range, &all, &fitting, [1, 1]), not_there);
    let other = self::range(5, 5, |_, _| 0.0);
    let grid = error(&other, &disk, &fitting, [1, 1]);
    assert!(grid.ends_with("cells, the range image has [5, 5]"), "{grid}");
    for factors in [[0, 1], [1, 0]] {
        let resample = format!("cells cannot be divided by {factors:?}: the factors are 1 or more");
        assert_eq!(error(&range, &disk, &fitting, factors), resample);
    }
    for factors in [[1 << 15, 1 << 15], [usize::MAX, 2]] {
        let error = error(&range, &disk, &fitting, factors);
        assert!(error.contains("would need about"), "{error}");
    }
}

/// Returns the numbers of faces of the triangulated scan before and after the redesign of the nose.
fn faces_before_and_after(
    range: &RangeImage,
    nose: &Region,
    growth: f64,
    profile: Profile,
) -> [usize; 2] {
    let net = control_net(nose, range, NetMethod::Grid, 0, 0, &Progress::silent()).unwrap();
    let sensor = Some(Unit::new_unchecked(-Vector3::z()));
    let steps = [OffsetStep { distance: growth, angle: 0.0, axis: [0.0; 3] }];
    let net = offset_net(&net, sensor, None, None, &steps, profile, &Progress::silent()).unwrap();
    let surface = nurbs(&net, None, None, Some([3; 2])).unwrap();
    let after = blend(range, nose, &surface, BlendMode::Displacement, [1, 1], &Progress::silent());
    [range, &after.unwrap().range]
        .map(|range| triangulate(range, 6.0, 85.0, 0).unwrap().faces().len())
}

#[test]
fn the_region_is_connected_to_its_surroundings_and_not_to_a_distant_background() {
    let (range, nose) = face();
    for growth in [5.0, 40.0, 400.0] {
        for profile in [Profile::Round, Profile::Plateau] {
            let [before, after] = faces_before_and_after(&range, &nose, growth, profile);
            assert_eq!(before, after, "{growth} {profile:?}");
        }
    }
    // Moves everything except the nose away from the sensor by the distance `depth` in mm. Cells are 1 mm apart.
    fn push_background(depth: f64, range: &RangeImage, nose: &Region) -> RangeImage {
        fn is_nose(cell: usize, nose: &Region) -> bool {
            nose.cells().contains(&(cell as u32))
        }
        range
            .with_points(
                range
                    .points()
                    .iter()
                    .enumerate()
                    .map(|(cell, point)| {
                        point + Vector3::z() * if is_nose(cell, nose) { 0.0 } else { depth }
                    })
                    .collect(),
            )
            .unwrap()
    }
    // If the background is far behind the nose, the silhouette of the nose is a border of the mesh, before and after the redesign.
    let [before, after] =
        faces_before_and_after(&push_background(300.0, &range, &nose), &nose, 40.0, Profile::Round);
    assert!(before < 48 * 44 * 2 - 80 && after == before, "{before} {after}");
    // If the nose hides only a part of the cheek behind it, the redesign connects the cheek to the nose.
    let [before, after] =
        faces_before_and_after(&push_background(8.0, &range, &nose), &nose, 40.0, Profile::Round);
    assert!(before < 48 * 44 * 2 - 80 && after == 48 * 44 * 2, "{before} {after}");
}

#[test]
fn a_shadow_beside_the_region_is_filled_and_one_elsewhere_is_not() {
    let (range, nose) = face();
    let mut points = range.points().to_vec();
    let beside =
        (20 * 49 + 24..20 * 49 + 49).find(|cell| !nose.cells().contains(&(*cell as u32))).unwrap();
    let elsewhere = 2 * 49 + 2;
    for cell in [beside, beside + 1, elsewhere] {
        points[cell] = Point3::new(f64::NAN, f64::NAN, f64::NAN);
    }
    let range = range.with_points(points).unwrap();
    let surface = surface(&range, &nose, NetMethod::Grid, 3, 12.0);
    for resample in [[1, 1], [2, 3]] {
        let after =
            blend(&range, &nose, &surface, BlendMode::Displacement, resample, &Progress::silent());
        let after = after.unwrap().range;
        fn refined_cell(cell: usize, resample: [usize; 2], after: &RangeImage) -> usize {
            let [down, right] = resample;
            (cell / 49 * down) * after.width() + cell % 49 * right
        }
        assert!(
            after.is_filled(refined_cell(beside, resample, &after))
                && after.forced_triangles(refined_cell(beside, resample, &after)) != 0
                && after.point(refined_cell(beside, resample, &after)).is_some()
        );
        assert!(
            after.point(refined_cell(elsewhere, resample, &after)).is_none()
                && after.forced_triangles(refined_cell(elsewhere, resample, &after)) == 0
        );
    }
}

/// Returns a region of the cells in a disk, with a circle as its rim.
fn disk_with_rim(range: &RangeImage, middle: [f64; 2], radius: f64) -> Region {
    let cells =
        region(range, |x, y| libm::hypot(x as f64 - middle[0], y as f64 - middle[1]) <= radius);
    let angles = (0..120).map(|k| f64::from(k) * std::f64::consts::TAU / 120.0);
    let rim = angles.map(|angle| {
        let (sin, cos) = libm::sincos(angle);
        [middle[0] + radius * cos, middle[1] - radius * sin]
    });
    let contour = value::Contour { hole: false, cells: vec![cells.cells()[0]], rim: rim.collect() };
    let (points, flags) = (cells.points().to_vec(), cells.filled_cells().to_vec());
    Region::new(range.width(), range.height(), cells.cells().to_vec(), points, flags, vec![contour])
        .unwrap()
}

/// Returns a bump of the given radius and height on a plane, as a sensor sees it.
fn bump(middle: [f64; 2], radius: f64, height: f64) -> RangeImage {
    range(44, 44, |x, y| {
        let r = libm::hypot(x - middle[0], y - middle[1]) / radius;
        700.0 - height * (1.0 - r * r).max(0.0).sqrt()
    })
}

#[test]
fn a_bump_that_sinks_leaves_no_crest() {
    // Bumps at twelve positions between the cells, with several radii and heights.
    for k in 0..12 {
        let fraction = |step: f64| (f64::from(k) * step).fract();
        let middle = [21.0 + fraction(0.618), 21.0 + fraction(0.414)];
        let (radius, height) = (8.0 + 6.0 * fraction(0.3), 4.0 + 5.0 * fraction(0.7));
        let range = bump(middle, radius, height);
        let region = disk_with_rim(&range, middle, radius);
        let net = control_net(&region, &range, NetMethod::Grid, 0, 0, &Progress::silent()).unwrap();
        let sensor = Unit::new_unchecked(-Vector3::z());
        let steps = [OffsetStep { distance: -1.5 * height, angle: 0.0, axis: [0.0; 3] }];
        let progress = Progress::silent();
        let net = offset_net(&net, Some(sensor), None, None, &steps, Profile::Round, &progress);
        let surface = nurbs(&net.unwrap(), None, None, None).unwrap();
        let sunk = blend(&range, &region, &surface, BlendMode::Displacement, [1, 1], &progress)
            .unwrap()
            .range;
        let heights = sunk.points().iter().map(|point| 700.0 - point.z);
        let crest = heights.clone().fold(0.0, f64::max);
        let lowest = heights.fold(0.0, f64::min);
        assert!(crest <= 0.3 * height, "{k}: a crest of {crest} on a bump of {height}");
        assert!((lowest + 0.5 * height).abs() <= 0.15 * height, "{k}: {lowest} of {height}");
    }
}
