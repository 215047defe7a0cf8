//! Tests of `extract_region`.

use expect_test::{Expect, expect};
use maquette_value::{Mask, Registration};

use super::*;

const HOLE: Point3<f64> = Point3::new(f64::NAN, f64::NAN, f64::NAN);

/// Returns the labels of the connected parts that `#` draws.
fn spots(rows: &[&str]) -> Labels {
    label(&Mask::from_rows(rows), Connectivity::Eight)
}

/// Returns a range image whose valid cells are drawn as `#`; their points are on a tilted plane.
fn scan(rows: &[&str]) -> RangeImage {
    let mask = Mask::from_rows(rows);
    let points = mask
        .pixels()
        .iter()
        .enumerate()
        .map(|(index, &valid)| {
            let (x, y) = ((index % mask.width()) as f64, (index / mask.width()) as f64);
            if valid == 1 { Point3::new(x, y, 700.0 + 0.5 * x - 0.25 * y) } else { HOLE }
        })
        .collect();
    RangeImage::new(mask.width(), mask.height(), points).unwrap()
}

fn full(width: usize, height: usize) -> RangeImage {
    let row = "#".repeat(width);
    scan(&vec![row.as_str(); height])
}

fn draw(region: &Region) -> String {
    Mask::new(region.width(), region.height(), region.grid()).unwrap().draw()
}

fn options(fill: bool, close_radius: usize) -> RegionOptions {
    RegionOptions { fill, enclosed: false, close_radius }
}

fn check(labels: &[&str], range: &[&str], fill: bool, expected: Expect) {
    let region = extract_region(
        &spots(labels),
        &scan(range),
        Pick::Largest,
        options(fill, 0),
        &Progress::silent(),
    )
    .unwrap();
    expected.assert_eq(&draw(&region));
}

/// Draws the cells of a closed chain, and the cells that the chain separates from the border of the grid.
fn fill_contour(width: usize, height: usize, chain: &[u32]) -> String {
    let mut rest = vec![1; width * height];
    chain.iter().for_each(|&cell| rest[cell as usize] = 0);
    let parts = label(&Mask::new(width, height, rest).unwrap(), Connectivity::Four);
    let separated = parts
        .pixels()
        .iter()
        .map(|&part| u8::from(part == 0 || !parts.statistics()[part as usize - 1].touches_border));
    Mask::new(width, height, separated.collect()).unwrap().draw()
}

fn disk(size: usize, radius_sq: usize, hole_sq: usize) -> Mask {
    fn is_inside(index: usize, size: usize, hole_sq: usize, radius_sq: usize) -> bool {
        let distance_sq = [index % size, index / size]
            .map(|at| (2 * at).abs_diff(size - 1).pow(2))
            .iter()
            .sum::<usize>();
        (4 * hole_sq..4 * radius_sq).contains(&distance_sq)
    }
    let pixels = (0..size * size).map(|index| u8::from(is_inside(index, size, hole_sq, radius_sq)));
    Mask::new(size, size, pixels.collect()).unwrap()
}

#[test]
fn the_filled_contour_of_a_disk_is_the_disk() {
    for radius in 2..12 {
        let disk = disk(26, radius * radius, 0);
        let labels = label(&disk, Connectivity::Eight);
        let region = extract_region(
            &labels,
            &full(26, 26),
            Pick::Largest,
            options(true, 1),
            &Progress::silent(),
        )
        .unwrap();
        assert_eq!(draw(&region), disk.draw());
        assert_eq!(region.contours().len(), 1);
        assert_eq!(fill_contour(26, 26, &region.contours()[0].cells), disk.draw());
    }
}

#[test]
fn an_annulus_keeps_its_hole() {
    let annulus = disk(26, 120, 30);
    let labels = label(&annulus, Connectivity::Eight);
    let region = extract_region(
        &labels,
        &full(26, 26),
        Pick::Largest,
        options(true, 1),
        &Progress::silent(),
    )
    .unwrap();
    assert_eq!(draw(&region), annulus.draw());
    let holes: Vec<bool> = region.contours().iter().map(|contour| contour.hole).collect();
    assert_eq!(holes, [false, true]);
}

#[test]
fn a_rectangle_aligned_to_two_pixels_is_transferred_exactly() {
    let (width, height) = (20, 12);
    let map = Registration::corners([width, height], [2 * width, 2 * height]);
    let range = full(width, height).with_registration(map);
    for ([left, top], [right, bottom]) in
        [([0, 0], [20, 12]), ([0, 3], [1, 4]), ([5, 2], [19, 11]), ([7, 7], [8, 12])]
    {
        fn is_inside(
            column: usize,
            row: usize,
            left: usize,
            right: usize,
            top: usize,
            bottom: usize,
        ) -> bool {
            (left..right).contains(&column) && (top..bottom).contains(&row)
        }
        let pixels = (0..4 * width * height).map(|index| {
            u32::from(is_inside(
                index % (2 * width) / 2,
                index / (2 * width) / 2,
                left,
                right,
                top,
                bottom,
            ))
        });
        let labels = Labels::new(2 * width, 2 * height, pixels.collect()).unwrap();
        let region =
            extract_region(&labels, &range, Pick::Label(1), options(true, 1), &Progress::silent())
                .unwrap();
        let expected: Vec<u32> = (0..(width * height) as u32)
            .filter(|&cell| {
                is_inside(cell as usize % width, cell as usize / width, left, right, top, bottom)
            })
            .collect();
        assert_eq!(region.cells(), expected);
    }
}

#[test]
fn a_surrounded_hole_of_the_scan_is_filled() {
    let range = ["######", "##..##", "##.###", "######"];
    check(&["######"; 4], &range, true, expect![["######\n######\n######\n######\n"]]);
    check(&["######"; 4], &range, false, expect![["######\n##..##\n##.###\n######\n"]]);
    let region = extract_region(
        &spots(&["######"; 4]),
        &scan(&range),
        Pick::Largest,
        options(true, 0),
        &Progress::silent(),
    )
    .unwrap();
    let truth = full(6, 4);
    for (index, &cell) in region.cells().iter().enumerate() {
        let distance = (region.points()[index] - truth.points()[cell as usize]).norm();
        assert!(distance < 1e-8, "{cell} {distance}");
        assert_eq!(region.filled_cells()[index], u8::from([8, 9, 14].contains(&cell)));
    }
}

#[test]
fn a_shadow_that_reaches_beyond_the_region_is_filled_inside_and_background_is_left_out() {
    let region = [".......", ".#####.", ".#####.", ".#####.", "......."];
    let scan = ["#####..", "###.#..", "###.#..", "#####..", "#######"];
    check(&region, &scan, true, expect![[".......\n.####..\n.####..\n.####..\n.......\n"]]);
    check(&region, &scan, false, expect![[".......\n.##.#..\n.##.#..\n.####..\n.......\n"]]);
    check(&["###", "###"], &["#.#", "###"], true, expect![["#.#\n###\n"]]);
}

#[test]
fn areas_that_a_part_surrounds_belong_to_it() {
    let labels = ["#####.", "#...#.", "#.#.#.", "#...##", "###.##"];
    fn region(enclosed: bool, labels: &[&str; 5]) -> String {
        let region_options = RegionOptions { fill: true, enclosed, close_radius: 0 };
        let labels = label(&Mask::from_rows(labels), Connectivity::Four);
        draw(
            &extract_region(
                &labels,
                &full(6, 5),
                Pick::Largest,
                region_options,
                &Progress::silent(),
            )
            .unwrap(),
        )
    }
    assert_eq!(region(false, &labels), "#####.\n#...#.\n#...#.\n#...##\n###.##\n");
    // The labelled part is open at the bottom. So it surrounds no area, and `enclosed` has no effect.
    assert_eq!(region(true, &labels), region(false, &labels));
    let closed = ["#####.", "#...#.", "#.#.#.", "#...##", "######"];
    let labels = label(&Mask::from_rows(&closed), Connectivity::Four);
    let region_options = RegionOptions { fill: true, enclosed: true, close_radius: 0 };
    let whole =
        extract_region(&labels, &full(6, 5), Pick::Largest, region_options, &Progress::silent());
    assert_eq!(draw(&whole.unwrap()), "#####.\n#####.\n#####.\n######\n######\n");
}

#[test]
fn the_gap_of_a_handle_does_not_belong_to_it() {
    let labels = label(&Mask::from_rows(&["#####", "#...#", "#...#", "#####"]), Connectivity::Four);
    fn region_with_gap(depth: f64, labels: &Labels) -> String {
        let flat = full(5, 4);
        let points = flat.points().iter().enumerate().map(|(cell, point)| {
            let is_gap = (1..4).contains(&(cell % 5)) && (1..3).contains(&(cell / 5));
            Point3::new(point.x, point.y, point.z + if is_gap { depth } else { 0.0 })
        });
        let range = RangeImage::new(5, 4, points.collect()).unwrap();
        let region_options = RegionOptions { fill: true, enclosed: true, close_radius: 0 };
        draw(
            &extract_region(labels, &range, Pick::Largest, region_options, &Progress::silent())
                .unwrap(),
        )
    }
    assert_eq!(region_with_gap(2.0, &labels), "#####\n#####\n#####\n#####\n");
    assert_eq!(region_with_gap(90.0, &labels), "#####\n#...#\n#...#\n#####\n");
}

#[test]
fn the_largest_piece_of_an_unconnected_region_is_taken() {
    check(&["#####", "#####"], &["#.###", "#.###"], true, expect![["..###\n..###\n"]]);
}

#[test]
fn cells_filled_before_stay_flagged() {
    let range = full(2, 2).with_filled(vec![0, 1, 0, 0]).unwrap();
    let region = extract_region(
        &spots(&["##", "##"]),
        &range,
        Pick::Largest,
        options(true, 0),
        &Progress::silent(),
    )
    .unwrap();
    assert_eq!(region.filled_cells(), [0, 1, 0, 0]);
}

#[test]
fn a_gap_is_closed() {
    let labels = spots(&["......", ".##.#.", ".##.#.", ".###..", "......"]);
    fn region(radius: usize, labels: &Labels) -> String {
        draw(
            &extract_region(
                labels,
                &full(6, 5),
                Pick::Largest,
                options(true, radius),
                &Progress::silent(),
            )
            .unwrap(),
        )
    }
    assert_eq!(region(0, &labels), "......\n.##...\n.##...\n.###..\n......\n");
    assert_eq!(region(1, &labels), "......\n.####.\n.####.\n.###..\n......\n");
}

#[test]
fn parts_are_picked_by_size_label_and_position() {
    let labels = spots(&["##.#.", "##...", "...##"]);
    fn first(pick: Pick, labels: &Labels) -> u32 {
        extract_region(labels, &full(5, 3), pick, options(true, 0), &Progress::silent())
            .unwrap()
            .cells()[0]
    }
    assert_eq!(first(Pick::Largest, &labels), 0);
    assert_eq!(first(Pick::Smallest, &labels), 3);
    assert_eq!(first(Pick::Rank(1), &labels), 0);
    assert_eq!(first(Pick::Rank(2), &labels), 13);
    assert_eq!(first(Pick::Label(2), &labels), 3);
    assert_eq!(first(Pick::At(4, 2), &labels), 13);
}

#[test]
fn invalid_picks_give_errors() {
    let labels = spots(&["##.#.", "##...", "...##"]);
    fn message(labels: &Labels, pick: Pick) -> String {
        extract_region(labels, &full(5, 3), pick, options(true, 0), &Progress::silent())
            .unwrap_err()
            .to_string()
    }
    expect!["there is no rank 4: the labels have 3 parts, numbered from 1"]
        .assert_eq(&message(&labels, Pick::Rank(4)));
    expect!["there is no label 0: the labels have 3 parts, numbered from 1"]
        .assert_eq(&message(&labels, Pick::Label(0)));
    expect!["pixel (2, 1) is background: the closest part is label 1 at [1, 1]"]
        .assert_eq(&message(&labels, Pick::At(2, 1)));
    expect!["pixel (5, 1) is outside the picture, which has [5, 3] pixels"]
        .assert_eq(&message(&labels, Pick::At(5, 1)));
    expect!["the labels are empty: check the threshold or the mask from which they were made"]
        .assert_eq(&message(&spots(&["....."; 3]), Pick::Largest));
    expect![
        "the labels have [2, 1] pixels, but the range image is registered to a picture of [5, 3]"
    ]
    .assert_eq(&message(&spots(&["##"]), Pick::Largest));
}

#[test]
fn a_part_without_cells_or_points_is_an_error() {
    fn message(range: &RangeImage, rows: &[&str]) -> String {
        extract_region(&spots(rows), range, Pick::Largest, options(true, 1), &Progress::silent())
            .unwrap_err()
            .to_string()
    }
    let map = Registration::corners([2, 1], [4, 2]);
    expect!["label 1 has 1 pixels, but they do not cover half of any cell of the range grid; label a larger area"]
        .assert_eq(&message(&full(2, 1).with_registration(map), &["#...", "...."]));
    expect!["label 1 covers 2 cells of the range grid, but no usable one has a point"]
        .assert_eq(&message(&scan(&["..#"]), &["##."]));
}

#[test]
fn a_region_of_the_whole_range_image_differs_from_one_at_its_border() {
    fn covers_everything(rows: &[&str]) -> bool {
        let range = full(rows[0].len(), rows.len());
        let progress = Progress::silent();
        is_everything(
            &extract_region(&spots(rows), &range, Pick::Largest, options(true, 0), &progress)
                .unwrap(),
        )
    }
    assert!(covers_everything(&["####"; 4]));
    assert!(!covers_everything(&["....", "####", "####"]));
}

#[test]
fn a_depth_step_separates_the_surfaces_of_a_region() {
    // The columns at the left are nearer by `step` mm; the label covers one of four of them.
    fn check(step: &dyn Fn(f64) -> f64) -> (usize, String) {
        let cells = (0..200).map(|cell| [cell % 20, cell / 20].map(f64::from));
        let points = cells.map(|[x, y]| {
            let step = if x < 4.0 { step(y) } else { 0.0 };
            Point3::new(x, y, 700.0 + 0.1 * x - step)
        });
        let range = RangeImage::new(20, 10, points.collect()).unwrap();
        let labels = spots(&["...#########........"; 10]);
        let found =
            extract(&labels, &range, Pick::Largest, options(true, 0), &Progress::silent()).unwrap();
        (found.0.cells().len(), found.1.warning().unwrap_or_default())
    }
    let (cells, warning) = check(&|_| 40.0);
    assert_eq!(cells, 80);
    assert!(warning.contains("at cell (3, 9): 10 cells on other surfaces"), "{warning}");
    // A step that ends inside the region separates nothing.
    let (cells, warning) = check(&|y| 36.0 - 4.0 * y);
    assert_eq!(cells, 90);
    assert!(warning.contains("36.1 mm at cell (3, 0): the new surface stretches"), "{warning}");
    assert_eq!(check(&|_| 0.0), (90, String::new()));
}
