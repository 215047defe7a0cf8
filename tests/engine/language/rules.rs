//! Values that can work with no input, which the check refuses.

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
        expect![[r#""#]],
    );
    check(
        "MaskShape(image: \"picture\", shape: Rectangle(at: (5, 5), size: (3, -1)))",
        expect![[r#""#]],
    );
    check(
        "MaskShape(image: \"picture\", shape: Ellipse(center: (-5, 5), radii: (0, 18)))",
        expect![[r#""#]],
    );
    check("Primitive(shape: Sphere(radius: 2, sides: 30))", expect![[r#""#]]);
    check("Lattice(mesh: \"mesh\", cells: (4, 0, 4))", expect![[r#""#]]);
    check(
        "Texture(mesh: \"mesh\", image: \"picture\", mapping: Planar(scale: (-1, 1)))",
        expect![[r#""#]],
    );
}

#[test]
fn ranges_are_not_empty() {
    check("Crop(mesh: \"mesh\", within: Box(min: (0, 5, 0), max: (1, 3, 1)))", expect![[r#""#]]);
    check("Crop(mesh: \"mesh\", within: Depth(from: 5, to: cm(0.2)))", expect![[r#""#]]);
    check("Crop(mesh: \"mesh\", within: Depth(from: 5))", expect![[r#""#]]);
    check(
        "Threshold(image: \"picture\", select: Box(space: Rgb, low: (9, 0, 0), high: (1, 9, 9)))",
        expect![[r#""#]],
    );
    check(
        "Threshold(image: \"picture\", select: Box(space: Hsv, low: (300, 0, 0), high: (20, 1, 1)))",
        expect![[r#""#]],
    );
    check(
        "Handles(mesh: \"mesh\", on: Region(within: Box(low: (0, 1, 0), high: (1, 0, 1))))",
        expect![[r#""#]],
    );
}

#[test]
fn directions_and_scales_are_not_zero() {
    check(
        "Crop(mesh: \"mesh\", within: Plane(through: (0, 0, 0), normal: (0, 0, 0)))",
        expect![[r#""#]],
    );
    check("Solid(mesh: \"mesh\", base: Flat(up: (0, 0, 0)))", expect![[r#""#]]);
    check("Transform(mesh: \"mesh\", scale: (1, 0, 1))", expect![[r#""#]]);
    check(
        "AlignAll(scans: [\"mesh\"], by: Turntable(angle: 30, axis: (0, 0, 0), through: (0, 0, 0)))",
        expect![[r#""#]],
    );
}

#[test]
fn lists_have_what_they_need() {
    check("AlignAll(scans: [])", expect![[r#""#]]);
    check("Reconstruct(points: [])", expect![[r#""#]]);
    check("PointNet(points: [[(0, 0, 0), (1, 0, 0)]])", expect![[r#""#]]);
    check(
        "Align(mesh: \"mesh\", to: \"mesh\", by: Pairs(pairs: [((0, 0, 0), (0, 0, 1))]))",
        expect![[r#""#]],
    );
}

#[test]
fn a_field_with_the_name_of_a_type_leads_to_the_port_that_takes_it() {
    check("Transform(points: \"mesh\")", expect![[r#""#]]);
    check("Transform(range_image: \"mesh\")", expect![[r#""#]]);
    check("Transform(curve: \"mesh\", scale: (1, 1, 1))", expect![[r#""#]]);
}
