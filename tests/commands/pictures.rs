//! Pictures of any value, made by `maquette render` and `maquette inspect --out`.

use std::path::Path;
use std::process::Output;

use maquette::format::png;
use maquette::value::Image;

use crate::output::stderr_of;
use crate::project::{GRAPHS, Project};

/// A folder for pictures. The commands run in the folder of the example graphs.
struct Studio(Project);

impl Studio {
    fn new() -> Self {
        Self(Project::empty())
    }

    fn maquette(&self, arguments: &[&str]) -> Output {
        self.0.command(arguments).current_dir(GRAPHS).output().unwrap()
    }

    /// Runs a command that writes a picture, and returns the picture. `PICTURE` in the arguments is replaced by the file's path.
    fn picture(&self, arguments: &[&str]) -> Image {
        let path = self.0.folder().join("picture.png");
        let name = path.to_str().unwrap();
        let given = arguments.iter().map(|&it| if it == "PICTURE" { name } else { it });
        let output = self.maquette(&Vec::from_iter(given));
        assert!(output.status.success(), "{arguments:?}: {}", stderr_of(&output));
        png::read(&std::fs::read(path).unwrap()).unwrap()
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
    assert!(4 < count_visible(&studio.picture(&["inspect", "doll/mug.obj", "--out", "PICTURE"])));
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
    // Without `--over`, the mask is written as a black and white picture, not drawn over a photo.
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
fn a_model_comes_with_the_picture_that_its_material_names() {
    let project = Project::with_files(&[
        (
            "quad.obj",
            "mtllib quad.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
             usemtl paint\nf 1/1 2/2 3/3 4/4\n",
        ),
        ("quad.mtl", "newmtl paint\nmap_Kd red paint.png\n"),
        (
            "a.ron",
            r#"Graph(format: 1, nodes: { "m": ReadMesh(path: "quad.obj") }, outputs: { "b.obj": "m" })"#,
        ),
    ]);
    let red = Image::new(2, 2, vec![[220, 10, 10]; 4]).unwrap();
    let paint = project.folder().join("red paint.png");
    std::fs::write(&paint, png::encode_rgb(&red).unwrap()).unwrap();
    fn read_picture(project: &Project, name: &str) -> Image {
        png::read(&std::fs::read(project.folder().join(name)).unwrap()).unwrap()
    }
    let output = project.maquette(&["render", "quad.obj", "front.png", "--size", "40x40"]);
    assert_eq!(stderr_of(&output), "");
    let [r, g, b] = read_picture(&project, "front.png").pixel([20, 20]);
    assert!(g.max(b) < 100 && 100 < r, "{r} {g} {b}");

    let output = project.maquette(&["run", "a.ron", "--out", "out"]);
    assert_eq!((output.status.success(), stderr_of(&output)), (true, String::new()));
    assert_eq!(read_picture(&project, "out/b.png"), red);
    std::fs::remove_file(paint).unwrap();
    let text = "there is no file `red paint.png`: the mesh comes without its picture";
    let output = project.maquette(&["run", "a.ron", "--out", "out"]);
    assert!(output.status.success() && stderr_of(&output).contains(text), "part of what was read");
    let output = project.maquette(&["render", "quad.obj", "front.png"]);
    assert_eq!(stderr_of(&output), format!("warning: {text}\n"));
}
