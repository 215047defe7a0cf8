//! `maquette compare` as its users see it, and the tolerances of pictures in tests.

use std::fmt::Write as _;
use std::path::Path;

use maquette::format::png;
use maquette::value::Image;

use crate::output::text_of;
use crate::program::maquette;

/// Returns an OBJ file of a flat sheet of 20 x 20 quads, without the faces for which `is_gone` is true.
fn sheet(is_gone: impl Fn(usize) -> bool) -> String {
    let mut text = String::new();
    for k in 0..21 * 21 {
        let _ = writeln!(text, "v {} {} 0", k % 21, k / 21);
    }
    for face in (0..400).filter(|face| !is_gone(*face)) {
        let first = face / 20 * 21 + face % 20 + 1;
        let _ = writeln!(text, "f {} {} {} {}", first, first + 1, first + 22, first + 21);
    }
    text
}

#[test]
fn a_mesh_without_thirty_of_its_faces_is_not_the_same_surface() {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: String, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write("whole.obj", sheet(|_| false), &folder);
    write("holed.obj", sheet(|face| face % 13 == 4 && face < 390), &folder);
    for (old, new, told, other) in [
        ("whole.obj", "holed.obj", "old to new", "new to old"),
        ("holed.obj", "whole.obj", "new to old", "old to new"),
    ] {
        for more in [&[][..], &["--remeshed", "--max", "0.01"]] {
            let compared = maquette(folder.path(), &[&["compare", old, new], more].concat());
            let text = text_of(&compared);
            assert_eq!(compared.status.code(), Some(1), "{text}");
            // For meshes with different faces, the midpoints of border edges are compared, too. Here they are farther away than the centers
            // of faces, so the maximum is at a midpoint.
            let (max, place) = if more.is_empty() { ("0.333333", "face ") } else { ("0.5", "(") };
            assert!(text.contains(&format!("surface, {told}: max {max} mm")), "{text}");
            assert!(text.contains(&format!("worst at {place}")), "{text}");
            assert!(text.contains(&format!("surface, {other}: max 0 mm")), "{text}");
        }
    }
}

/// Writes two gray pictures of 100 x 100 pixels that differ in one pixel, by 93 levels.
fn pictures(folder: &Path) {
    for (name, level) in [("a.png", 100), ("b.png", 193)] {
        let mut pixels = vec![[100; 3]; 10_000];
        pixels[4321] = [100, 100, level];
        let picture = Image::new(100, 100, pixels).unwrap();
        std::fs::write(folder.join(name), png::encode_rgb(&picture).unwrap()).unwrap();
    }
}

#[test]
fn pictures_are_compared_with_a_share_a_hard_bound_and_a_relative_one() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path());
    fn compare(more: &[&str], folder: &tempfile::TempDir) -> (Option<i32>, String) {
        let compared = maquette(folder.path(), &[&["compare", "a.png", "b.png"], more].concat());
        (compared.status.code(), text_of(&compared))
    }
    assert_eq!(compare(&["--differing", "0.1"], &folder).0, Some(0));
    let (code, text) = compare(&["--differing", "0.1", "--hard", "20"], &folder);
    let reason = "`color` differs by 93 levels, allowed is 20 (hard); worst at column 21, row 43";
    assert!(code == Some(1) && text.contains(reason), "{text}");
    assert!(text.contains("0.01 % differ"), "{text}");
    assert_eq!(compare(&["--differing", "0.1", "--hard", "93"], &folder).0, Some(0));
    // The relative difference is 93 divided by the mean of 100 and 193, which is 63 %.
    assert_eq!(compare(&["--relative", "0.64"], &folder).0, Some(0));
    assert_eq!(compare(&["--relative", "0.62"], &folder).0, Some(1));
    for (arguments, told) in [
        (&["--differing", "5"][..], "expected a number from 0 to 1"),
        (&["--differing", "NaN"], "expected a number from 0 to 1"),
        (&["--level", "300"], "expected a number from 0 to 255"),
        (&["--hard", "-1"], "expected a number from 0 to 255"),
        (&["--relative", "2"], "expected a number from 0 to 1"),
        (&["--max", "-1"], "expected a number that is not negative"),
        (&["--normals", "200"], "expected a number from 0 to 180"),
        (&["--attribute", "uv=-1"], "expected a number that is not negative"),
        (&["--hard", "3", "--level", "5"], "expected `hard` to be at least `level`, 5, found 3"),
    ] {
        // A value that begins with a hyphen must be written as `--name=value`.
        let joined = match arguments {
            [name, value] => vec![format!("{name}={value}")],
            _ => arguments.iter().map(|&it| it.to_owned()).collect::<Vec<_>>(),
        };
        let (code, text) = compare(&joined.iter().map(String::as_str).collect::<Vec<_>>(), &folder);
        assert!(code == Some(2) && text.contains(told), "{arguments:?}: {text}");
    }
}

#[test]
fn a_test_of_a_picture_has_the_same_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let (path, name) = (folder.path(), "picture.test.ron");
    pictures(path);
    fn graph(file: &str, path: &Path) {
        let text = format!(
            "Graph(format: 1, nodes: {{ \"it\": ReadImage(path: \"{file}\") }}, outputs: {{ \"it.png\": \"it\" }})"
        );
        std::fs::write(path.join("picture.ron"), text).unwrap();
    }
    let test = |bounds: &str, more: &[&str]| {
        let text =
            format!("Test(graph: \"picture.ron\", compare: {{ \"it.png\": Image({bounds}) }})");
        std::fs::write(path.join(name), text).unwrap();
        let tested = maquette(path, &[&["test", name], more].concat());
        (tested.status.code(), text_of(&tested))
    };
    graph("a.png", path);
    assert_eq!(test("differing: 0.1", &["--bless"]).0, Some(0));
    graph("b.png", path);
    assert_eq!(test("differing: 0.1", &[]).0, Some(0));
    let (code, text) = test("differing: 0.1, hard: 20.0", &[]);
    assert!(code == Some(1) && text.contains("allowed is 20 (hard)"), "{text}");
    assert_eq!(test("relative: 0.64", &[]).0, Some(0));
    for wrong in ["hard: 300.0", "relative: 1.5", "hard: -1.0", "hard: 3.0, level: 5.0"] {
        assert_eq!(test(wrong, &[]).0, Some(2), "{wrong}");
    }
}
