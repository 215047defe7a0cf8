//! The check refuses values that would be invalid for any inputs.

use expect_test::{Expect, expect};

use crate::graph_files;

#[track_caller]
fn check(node: &str, expected: Expect) {
    let text = format!(
        "Graph(format: 1, nodes: {{\n\"mesh\": ReadMesh(path: \"doll.obj\"), \"picture\": ReadImage(path: \"doll.png\"),\n\"a\": {node},\n}}, outputs: {{ \"a.json\": \"a\" }})"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, text).unwrap();
    for file in ["doll.obj", "doll.png"] {
        std::fs::write(folder.path().join(file), "").unwrap();
    }
    let told = graph_files::problems(&path);
    let told = told.lines().filter(|line| !line.contains("G015"));
    expected.assert_eq(&String::from_iter(told.map(|line| format!("{line}\n"))));
}

#[test]
fn shapes_have_no_negative_sizes() {
    check(
        "MaskShape(image: \"picture\", shape: Ellipse(center: (5, 5), radii: (-18, 18)))",
        expect![[r#"
            3:73-76 G010 field `radii` of MaskShape is -18, but must be at least 0
        "#]],
    );
    check(
        "MaskShape(image: \"picture\", shape: Rectangle(at: (5, 5), size: (3, -1)))",
        expect![[r#"
            3:73-75 G010 field `size` of MaskShape is -1, but must be at least 0
        "#]],
    );
    check(
        "MaskShape(image: \"picture\", shape: Ellipse(center: (-5, 5), radii: (0, 18)))",
        expect![[r#""#]],
    );
    check(
        "Primitive(shape: Sphere(radius: 2, sides: 30))",
        expect![[r#"
        3:48-50 G010 field `sides` of Primitive is 30, but must be a multiple of 4
    "#]],
    );
    check(
        "Lattice(mesh: \"mesh\", cells: (4, 0, 4))",
        expect![[r#"
        3:39-40 G010 field `cells` of Lattice is 0, but must be at least 1 and at most 64
    "#]],
    );
    check(
        "Texture(mesh: \"mesh\", image: \"picture\", mapping: Planar(scale: (-1, 1)))",
        expect![[r#"
            3:70-72 G010 field `scale` of Texture is -1, but must be at least 0
        "#]],
    );
}

#[test]
fn ranges_are_not_empty() {
    check(
        "Crop(mesh: \"mesh\", within: Box(min: (0, 5, 0), max: (1, 3, 1)))",
        expect![[r#"
        3:46-47 G010 `min` of Box is 5, but must be at most `max`, 3 (swap both numbers)
    "#]],
    );
    check(
        "Crop(mesh: \"mesh\", within: Depth(from: 5, to: cm(0.2)))",
        expect![[r#"
        3:45-46 G010 `from` of Depth is 5, but must be at most `to`, 2 (swap both numbers)
    "#]],
    );
    check("Crop(mesh: \"mesh\", within: Depth(from: 5))", expect![[r#""#]]);
    check(
        "Threshold(image: \"picture\", select: Box(space: Rgb, low: (9, 0, 0), high: (1, 9, 9)))",
        expect![[r#"
            3:64-65 G010 `low` of Box is 9, but must be at most `high`, 1 (swap both numbers)
        "#]],
    );
    check(
        "Threshold(image: \"picture\", select: Box(space: Hsv, low: (300, 0, 0), high: (20, 1, 1)))",
        expect![[r#""#]],
    );
    check(
        "Handles(mesh: \"mesh\", on: Region(within: Box(low: (0, 1, 0), high: (1, 0, 1))))",
        expect![[r#"
            3:60-61 G010 `low` of Box is 1, but must be at most `high`, 0 (swap both numbers)
        "#]],
    );
}

#[test]
fn directions_and_scales_are_not_zero() {
    check(
        "Crop(mesh: \"mesh\", within: Plane(through: (0, 0, 0), normal: (0, 0, 0)))",
        expect![[r#"
            3:67-76 G010 field `normal` of Crop is (0, 0, 0), which is not a direction (write one such as (0, 1, 0))
        "#]],
    );
    check(
        "Solid(mesh: \"mesh\", base: Flat(up: (0, 0, 0)))",
        expect![[r#"
        3:41-50 G010 field `up` of Solid is (0, 0, 0), which is not a direction (write one such as (0, 1, 0))
    "#]],
    );
    check(
        "Transform(mesh: \"mesh\", scale: (1, 0, 1))",
        expect![[r#"
        3:41-42 G010 field `scale` of Transform is 0, but must be nonzero
    "#]],
    );
    check(
        "AlignAll(scans: [\"mesh\"], by: Turntable(angle: 30, axis: (0, 0, 0), through: (0, 0, 0)))",
        expect![[r#"
            3:63-72 G010 field `axis` of AlignAll is (0, 0, 0), which is not a direction (write one such as (0, 1, 0))
        "#]],
    );
}

#[test]
fn lists_have_what_they_need() {
    check(
        "AlignAll(scans: [])",
        expect![[r#"
        3:22-24 G005 port `scans` of AlignAll needs at least one link (write `["node"]`)
    "#]],
    );
    check(
        "Reconstruct(points: [])",
        expect![[r#"
        3:26-28 G005 port `points` of Reconstruct needs at least one link (write `["node"]`)
    "#]],
    );
    check(
        "Align(mesh: \"mesh\", to: \"mesh\", by: Pairs(pairs: [((0, 0, 0), (0, 0, 1))]))",
        expect![[r#"
            3:55-79 G009 field `pairs` of Align: expected at least 3 values, found 1
        "#]],
    );
}

#[test]
fn a_field_with_the_name_of_a_type_leads_to_the_port_that_takes_it() {
    check(
        "Transform(points: \"mesh\")",
        expect![[r#"
        3:16-22 G004 Transform has no field `points` (rename it to `mesh`, the port that takes it)
    "#]],
    );
    check(
        "Transform(range_image: \"mesh\")",
        expect![[r#"
        3:16-27 G004 Transform has no field `range_image` (rename it to `mesh`, the port that takes it)
    "#]],
    );
    check(
        "Transform(curve: \"mesh\", scale: (1, 1, 1))",
        expect![[r#"
        3:16-21 G004 Transform has no field `curve` (rename it to `mesh`, the port that takes it)
    "#]],
    );
}
