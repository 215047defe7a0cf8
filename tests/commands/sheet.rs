//! `maquette render sheet` as its users see it.

use std::path::Path;
use std::process::Output;

use crate::program::command;

fn maquette(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

const GRAPH: &str = r#"Graph(
    format: 1,
    params: {
        "sides": Integer(default: 5, min: 3, max: 12, doc: "Sides."),
        "name": Text(default: "a", doc: "No number."),
        "wide": Number(default: 2.0, min: -1.0, max: 3.0, doc: "Width."),
    },
    nodes: {
        "quad": ReadMesh(path: "quad.obj"),
        "moved": Transform(mesh: "quad", rotate: (0.0, 0.0, Param("sides")), scale: (Param("wide"), 1.0, 1.0)),
    },
    outputs: { "moved.obj": "moved" },
)"#;

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

#[test]
fn a_sheet_has_a_row_for_the_defaults_and_each_end_of_each_number() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("g.ron"), GRAPH).unwrap();
    std::fs::write(folder.path().join("quad.obj"), QUAD).unwrap();
    let made =
        maquette(folder.path(), &["render", "sheet", "g.ron", "--size", "30x20", "--no-cache"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    expect_test::expect![[r#"
        ./g.png
          row 1: the defaults
          row 2: sides = 3
          row 3: sides = 12
          row 4: wide = -1.0
          row 5: wide = 3.0
    "#]]
    .assert_eq(&String::from_utf8(made.stdout).unwrap());
    let bytes = std::fs::read(folder.path().join("g.png")).unwrap();
    fn size(at: usize, bytes: &[u8]) -> u32 {
        u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap())
    }
    assert_eq!((size(16, &bytes), size(20, &bytes)), (5 * 30, 5 * 20));
    // An existing picture is replaced, but never a file that the graph reads.
    assert!(maquette(folder.path(), &["render", "sheet", "g.ron", "--no-cache"]).status.success());
    let graph = GRAPH.replace(
        "ReadMesh(path: \"quad.obj\")",
        "ReadMesh(path: \"quad.obj\"), \"g\": ReadImage(path: \"g.png\")",
    );
    std::fs::write(folder.path().join("g.ron"), graph).unwrap();
    let before = std::fs::read(folder.path().join("g.png")).unwrap();
    let refused =
        maquette(folder.path(), &["render", "sheet", "g.ron", "--size", "31x20", "--no-cache"]);
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(2) && told.contains("cannot write ./g.png"), "{told}");
    assert_eq!(std::fs::read(folder.path().join("g.png")).unwrap(), before);
}

#[test]
fn a_toggle_is_shown_off_and_on() {
    let folder = tempfile::tempdir().unwrap();
    let toggle = "\"on\": Toggle(default: false), \"sides\"";
    let switch = "\"which\": Switch(cases: { \"false\": \"quad\", \"true\": \"moved\" }, choose: Param(\"on\")), \"moved\"";
    let graph = GRAPH.replacen("\"sides\"", toggle, 1).replacen("\"moved\"", switch, 1);
    let graph = graph.replace("\"moved.obj\": \"moved\"", "\"moved.obj\": \"which\"");
    std::fs::write(folder.path().join("g.ron"), graph).unwrap();
    std::fs::write(folder.path().join("quad.obj"), QUAD).unwrap();
    let made =
        maquette(folder.path(), &["render", "sheet", "g.ron", "--size", "30x20", "--no-cache"]);
    let told = String::from_utf8_lossy(&made.stdout).into_owned();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert!(told.contains(": on = false\n") && told.contains(": on = true\n"), "{told}");
}

#[test]
fn a_row_that_cannot_be_computed_is_told_and_the_others_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("g.ron"), GRAPH.replace("min: -1.0", "min: 0.0")).unwrap();
    std::fs::write(folder.path().join("quad.obj"), QUAD).unwrap();
    let made =
        maquette(folder.path(), &["render", "sheet", "g.ron", "--size", "30x20", "--no-cache"]);
    assert_eq!(made.status.code(), Some(1));
    let told = String::from_utf8_lossy(&made.stderr).into_owned();
    assert!(told.contains("field `scale` of Transform is 0, but must be nonzero"), "{told}");
    assert!(folder.path().join("g.png").is_file());
}
