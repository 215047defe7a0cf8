//! Pictures of any value, made by `maquette render` and `maquette inspect --out`.

use std::path::Path;
use std::process::{Command, Output};

use maquette::format::png;
use maquette::value::Image;

use crate::output::stderr_of;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

/// A temporary folder for the cache and for pictures.
struct Studio(tempfile::TempDir);

impl Studio {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn maquette(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
        command.args(arguments).current_dir(GRAPHS).env("NO_COLOR", "1");
        command.env("MAQUETTE_CACHE", self.0.path().join("cache")).output().unwrap()
    }

    /// Runs a command that writes a picture, and returns the picture. `PICTURE` in the arguments is replaced by the file's path.
    fn picture(&self, arguments: &[&str]) -> Image {
        let path = self.0.path().join("picture.png");
        let name = path.to_str().unwrap();
        let given = arguments.iter().map(|&it| if it == "PICTURE" { name } else { it });
        let output = self.maquette(&Vec::from_iter(given));
        assert!(output.status.success(), "{arguments:?}: {}", stderr_of(&output));
        png::read(&std::fs::read(path).unwrap()).unwrap()
    }

    /// Runs a command with wrong arguments and returns the error.
    fn run_refused(&self, arguments: &[&str]) -> String {
        let output = self.maquette(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr_of(&output));
        stderr_of(&output)
    }
}

fn size(image: &Image) -> [usize; 2] {
    [image.width(), image.height()]
}

/// Returns the number of pixels that differ from the pixel in the top left corner.
fn count_visible(image: &Image) -> usize {
    let pixels = image.pixels();
    pixels.iter().filter(|pixel| **pixel != pixels[0]).count()
}

#[test]
fn a_file_that_is_no_graph_is_looked_into_by_itself() {
    let studio = Studio::new();
    fn look(file: &str, studio: &Studio) -> String {
        let output = studio.maquette(&["inspect", file]);
        assert!(output.status.success(), "{file}: {}", stderr_of(&output));
        String::from_utf8(output.stdout).unwrap()
    }
    for (file, what) in [
        ("doll/mug.obj", "Mesh"),
        ("doll/ellipse.obj", "Curve"),
        ("doll/points.xyz", "Points"),
        ("doll/range.pcd", "RangeImage"),
        ("doll/color.png", "Image"),
    ] {
        let text = look(file, &studio);
        assert!(text.starts_with(&format!("file.value: {what}, ")), "{file}: {text}");
    }
    assert!(4 < count_visible(&studio.picture(&["inspect", "doll/mug.obj", "--out", "PICTURE"])));
    let at = studio.maquette(&["inspect", "doll/color.png", "--at", "200,196"]);
    assert!(String::from_utf8_lossy(&at.stdout).contains("#"), "{}", stderr_of(&at));
    let table = studio.maquette(&["inspect", "doll/mug.obj", "--table", "vertices"]);
    assert!(String::from_utf8(table.stdout).unwrap().lines().count() > 10);
    assert!(
        studio.run_refused(&["inspect", "doll.ron"]).contains("expected a node of doll.ron: scan")
    );
    assert!(studio.run_refused(&["inspect", "README.md"]).contains("`.md`"));
    assert!(studio.run_refused(&["inspect", "no.ply"]).contains("no.ply"));
}

#[test]
fn every_type_of_values_is_rendered() {
    let studio = Studio::new();
    let curve = "nodes/InterpolateCurve.ron";
    let values = [
        ("doll.ron", "model"),
        ("doll.ron", "surface"),
        ("doll.ron", "whole"),
        ("doll.ron", "raised"),
        ("doll.ron", "nose"),
        ("doll.ron", "scan.color"),
        ("doll.ron", "red"),
        ("doll.ron", "spots"),
        ("doll.ron", "knots-u"),
        ("doll.ron", "normal"),
        (curve, "control"),
        (curve, "control.trace"),
        ("nodes/ReadPoints.ron", "points"),
        ("nodes/Edges.ron", "edges.magnitude"),
        ("nodes/ReadHandles.ron", "handles"),
    ];
    for (graph, value) in values {
        let picture = studio.picture(&["render", graph, value, "PICTURE", "--size", "60x45"]);
        assert_eq!(size(&picture), [60, 45], "{value}");
        assert!(count_visible(&picture) > 0, "nothing of {value} is seen");
    }
    for file in ["doll/points.xyz", "doll/ellipse.obj", "doll/range.pcd", "doll/color.png"] {
        assert!(count_visible(&studio.picture(&["render", file, "PICTURE"])) > 0, "{file}");
    }
}

#[test]
fn a_region_and_labels_lie_on_the_picture_that_they_were_found_in() {
    let studio = Studio::new();
    let photo = png::read(&std::fs::read(Path::new(GRAPHS).join("doll/color.png")).unwrap());
    let photo = photo.unwrap();
    // In each picture, the nose looks as in the photo, and the forehead is darker.
    let (nose, forehead) = ([200, 196], [200, 140]);
    for command in [
        &["render", "doll.ron", "nose", "PICTURE"][..],
        &["inspect", "doll.ron", "nose", "--out", "PICTURE"],
        &["render", "doll.ron", "red", "PICTURE", "--over", "scan.color"],
        &["inspect", "doll.ron", "red", "--out", "PICTURE", "--over", "scan.color"],
    ] {
        let picture = studio.picture(command);
        assert_eq!(size(&picture), size(&photo), "{command:?}");
        assert_eq!(picture.pixel(nose), photo.pixel(nose), "{command:?}");
        let [before, after] = [&photo, &picture].map(|it| it.pixel(forehead).map(u32::from));
        assert!(2 * after.iter().sum::<u32>() < before.iter().sum(), "{command:?}");
    }
    let spots = studio.picture(&["render", "doll.ron", "spots", "PICTURE"]);
    assert!(size(&spots) == size(&photo) && spots.pixel(nose) != photo.pixel(nose));
    // Without `--over`, a mask is written as data, in black and white.
    let mask = studio.picture(&["inspect", "doll.ron", "red", "--out", "PICTURE"]);
    assert_eq!([mask.pixel(nose), mask.pixel(forehead)], [[255; 3], [0; 3]]);
}

#[test]
fn a_camera_aims_at_a_place_or_a_value() {
    let studio = Studio::new();
    fn red(more: &[&str], studio: &Studio) -> usize {
        let command = ["render", "doll.ron", "model", "PICTURE", "--size", "60x45"];
        let picture = studio.picture(&[&command, more].concat());
        picture.pixels().iter().filter(|&&[r, g, b]| r > 90 && g < r / 2 && b < r / 2).count()
    }
    let whole = red(&[], &studio);
    let near = red(&["--at", "nose"], &studio);
    assert!(near > 700 && 10 * whole < near, "{whole} {near}");
    assert!(4 * red(&["--at", "nose", "--camera", "0,0,0.4"], &studio) < near);
    assert!(red(&["--at", "-500,0,600", "--camera", "0,0,9"], &studio) == 0);
    let command = ["inspect", "doll.ron", "model", "--out", "PICTURE"];
    let inspected = studio.picture(&[&command[..], &["--at", "nose"]].concat());
    let rendered = studio.picture(&["render", "doll.ron", "model", "PICTURE", "--at", "nose"]);
    assert!(inspected == rendered);
}

#[test]
fn what_cannot_be_seen_is_refused_with_what_to_do() {
    let studio = Studio::new();
    let picture = studio.0.path().join("none.png");
    let render = |value: &str, more: &[&str]| {
        let command = ["render", "doll.ron", value, picture.to_str().unwrap()];
        studio.run_refused(&[&command, more].concat())
    };
    let cases = [
        (render("model", &["--at", "noose"]), "no output or node `noose`; did you mean `nose`?"),
        (render("model", &["--at", "red"]), "`red` is a Mask, which has no position in space"),
        (render("model", &["--at", "3,4"]), "expected X,Y,Z for a point, NODE"),
        (
            render("model", &["--size", "20000x20000"]),
            "expected 1 to 16384 pixels in each direction",
        ),
        (render("red", &["--camera", "3,4"]), "a Mask is a flat picture without a position"),
        (render("red", &["--over", "scan.colour"]), "no output `colour`; did you mean `color`?"),
        (render("red", &["--over", "nose"]), "`nose` has no Image output"),
        (render("model", &["--over", "scan.color"]), "a Mesh has a position in space"),
        (
            studio.run_refused(&["inspect", "doll.ron", "model", "--at", "nose"]),
            "need a picture; add --out FILE.png",
        ),
        (
            studio.run_refused(&["render", "doll/color.png", "x.png", "--at", "nose"]),
            "cannot use `nose`",
        ),
    ];
    for (told, expected) in cases {
        assert!(told.contains(expected), "{told}");
    }
    assert!(!picture.exists());
}
