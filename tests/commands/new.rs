//! `maquette new` writes a graph that runs on the files of a folder.

use std::path::Path;

use crate::output::text_of;
use crate::program::maquette;

const DOLL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs/doll");

/// Makes a folder `scans` with some of the doll's files under other names.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (from, to) in files {
        let to = folder.path().join("scans").join(to);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(Path::new(DOLL).join(from), to).unwrap();
    }
    folder
}

/// Runs `new`, checks that its graph runs and has canonical form, and returns the output of `new`.
fn make_graph(folder: &Path, words: &[&str]) -> String {
    let new = maquette(folder, &[&["new", "scans"], words].concat());
    assert!(new.status.success(), "{}", text_of(&new));
    let format = maquette(folder, &["fmt", "--check", "scans/scans.ron"]);
    assert!(format.status.success(), "{}", text_of(&format));
    let run = maquette(folder, &["run", "scans/scans.ron", "--out", "out"]);
    assert!(run.status.success(), "{}", text_of(&run));
    text_of(&new)
}

const CAMERA: (&str, &str) = ("camera.json", "camera.json");

#[test]
fn a_capture_is_a_range_image_with_the_picture_that_belongs_to_it() {
    let files = [
        ("range.pcd", "scan 1.pcd"),
        ("color.png", "rgb.png"),
        ("painted.png", "mask.png"),
        ("mug.obj", "mug.obj"),
        CAMERA,
    ];
    let folder = folder(&files);
    let told = make_graph(folder.path(), &[]);
    let expected = r#"scans/scans.ron: One capture as a clean, textured mesh.
  scan.range: "scan 1.pcd"
  scan.color: "rgb.png"
  not used: scans/mug.obj, Mesh
  not used: scans/mask.png, Image
scans/maquette.toml: marks the root of the project
run `maquette watch scans/scans.ron --open` to see the result
"#;
    assert_eq!(told, expected);
    let text = std::fs::read_to_string(folder.path().join("scans/scans.ron")).unwrap();
    assert!(text.contains(r#"ReadCapture(color: "rgb.png", range: "scan 1.pcd")"#), "{text}");
    assert!(folder.path().join("out/model.glb").is_file());
    assert!(folder.path().join("scans/maquette.toml").is_file());
    // A second `new` does not overwrite the graph, which the user may have edited.
    let again = maquette(folder.path(), &["new", "scans"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(text_of(&again).contains("scans/scans.ron already exists"));
    let elsewhere = ["new", "scans", "--out", "graphs/a.ron"];
    let outside = maquette(folder.path(), &elsewhere);
    assert_eq!(outside.status.code(), Some(1));
    assert!(!folder.path().join("graphs").exists());
    std::fs::write(folder.path().join("maquette.toml"), "").unwrap();
    let other = maquette(folder.path(), &elsewhere);
    assert!(other.status.success(), "{}", text_of(&other));
    let text = std::fs::read_to_string(folder.path().join("graphs/a.ron")).unwrap();
    assert!(text.contains(r#"range: "../scans/scan 1.pcd""#), "{text}");
    assert!(!folder.path().join("graphs/maquette.toml").exists(), "it is in a project");
}

#[test]
fn each_kind_of_scan_has_its_recipe() {
    let range = folder(&[("range.pcd", "range.pcd"), CAMERA]);
    assert!(make_graph(range.path(), &[]).starts_with("scans/scans.ron: One range image"));
    let mesh = folder(&[("coarse.obj", "a.obj"), ("points.xyz", "b.xyz")]);
    assert!(make_graph(mesh.path(), &[]).starts_with("scans/scans.ron: A scanned mesh"));
    let points = folder(&[("points.xyz", "b.xyz")]);
    assert!(make_graph(points.path(), &[]).starts_with("scans/scans.ron: Points"));
    let one = folder(&[("coarse.obj", "a.obj"), ("mug.obj", "b.obj")]);
    let told = text_of(&maquette(one.path(), &["new", "scans/b.obj"]));
    assert!(told.contains("scan.path: \"b.obj\"") && told.contains("scans/b.ron"), "{told}");
}

#[test]
fn captures_whose_names_differ_by_numbers_are_of_one_thing() {
    let files = [("range.pcd", "a/1.pcd"), ("range.pcd", "a/2.pcd"), ("range.pcd", "a/10.pcd")];
    let folder = folder(&files);
    let new = maquette(folder.path(), &["new", "scans", "--out", "scans/all.ron"]);
    assert!(new.status.success(), "{}", text_of(&new));
    let text = std::fs::read_to_string(folder.path().join("scans/all.ron")).unwrap();
    let over = r#"over: [(path: "a/1.pcd"), (path: "a/2.pcd"), (path: "a/10.pcd")]"#;
    assert!(text.contains(over), "{text}");
    let one = maquette(folder.path(), &["new", "scans", "--recipe", "range"]);
    assert!(text_of(&one).contains("not used: scans/a/10.pcd, RangeImage"), "{}", text_of(&one));
}

#[test]
fn a_mesh_of_a_few_units_is_in_meters() {
    let folder = folder(&[("coarse.obj", "a.obj")]);
    let path = folder.path().join("scans/a.obj");
    let text = "v 0 0 0\nv 0.3 0 0\nv 0 0.2 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    std::fs::write(path, text).unwrap();
    assert!(make_graph(folder.path(), &[]).contains("  scan.unit: M\n"));
}

#[test]
fn what_is_not_there_is_told() {
    let pictures = folder(&[("color.png", "a.png")]);
    fn run_refused(words: &[&str], pictures: &tempfile::TempDir) -> String {
        let output = maquette(pictures.path(), words);
        assert_eq!(output.status.code(), Some(2), "{}", text_of(&output));
        text_of(&output)
    }
    assert!(
        run_refused(&["new", "scans"], &pictures)
            .contains("no scan found in scans besides 1 picture")
    );
    assert!(run_refused(&["new", "nowhere"], &pictures).contains("cannot read nowhere"));
    assert!(
        run_refused(&["new", "scans", "--recipe", "meshh"], &pictures)
            .contains("did you mean `mesh`?")
    );
    let wants = run_refused(&["new", "scans", "--recipe", "mesh"], &pictures);
    assert!(wants.contains("the recipe `mesh` needs mesh, but scans has no scan"), "{wants}");
    let list = text_of(&maquette(pictures.path(), &["new", "--list"]));
    assert!(
        list.contains("\ncapture    One capture") || list.starts_with("capture    One"),
        "{list}"
    );
}

#[test]
fn a_file_that_cannot_be_read_is_told_with_its_reason_and_in_the_graph() {
    let folder = folder(&[("coarse.obj", "a.obj")]);
    let cut = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 1 1\n";
    std::fs::write(folder.path().join("scans/b.ply"), cut).unwrap();
    let why = "cannot read scans/b.ply: line 10: the file ends too early";
    assert!(make_graph(folder.path(), &[]).contains(&format!("warning: {why}\n")));
    let text = std::fs::read_to_string(folder.path().join("scans/scans.ron")).unwrap();
    assert!(text.starts_with(&format!("// Not used: {why}\n")), "{text}");
    std::fs::remove_file(folder.path().join("scans/a.obj")).unwrap();
    let nothing = text_of(&maquette(folder.path(), &["new", "scans", "--out", "c.ron"]));
    assert!(nothing.contains(why), "{nothing}");
}

#[test]
fn points_of_a_list_and_of_a_survey_which_is_in_meters_by_its_format() {
    let folder = folder(&[("points.xyz", "b.xyz")]);
    let scans = folder.path().join("scans");
    std::fs::remove_file(scans.join("b.xyz")).unwrap();
    let points = (0..400).map(|k| {
        let (turn, rise) = (f64::from(k) * 2.4, f64::from(k) / 200.0 - 0.9975);
        let wide = (1.0 - rise * rise).sqrt();
        format!(
            "{} {} {}\n",
            50.0 * wide * libm::cos(turn),
            50.0 * wide * libm::sin(turn),
            50.0 * rise
        )
    });
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 400\nHEIGHT 1\nDATA ascii\n";
    std::fs::write(scans.join("a.pcd"), header.to_owned() + &String::from_iter(points)).unwrap();
    let new = text_of(&maquette(folder.path(), &["new", "scans"]));
    assert!(new.starts_with("scans/scans.ron: Points") && !new.contains("unit"), "{new}");
    let survey = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/formats/survey.las");
    std::fs::copy(survey, scans.join("b.las")).unwrap();
    let new = text_of(&maquette(folder.path(), &["new", "scans/b.las"]));
    assert!(new.contains("scan.unit: M"), "{new}");
    let seen = text_of(&maquette(folder.path(), &["inspect", "scans/b.las"]));
    assert!(seen.contains("numbers in this format are in meters"), "{seen}");
}
