//! Definitions of names, and their renaming.

use std::path::Path;

use serde_json::{Value as Json, json};

use super::editor::{Editor, apply_edits, place as place_of, position, uri};
use super::{FACE, NOSE, face};

#[test]
fn definitions_and_references_lead_through_files() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let nose = uri(&place.path("lib/nose.ron"));
    let mut check = |mark: &str, file: &str, at: &str, text: &str| {
        let found = editor.ask_at("textDocument/definition", &path, FACE, mark);
        assert_eq!(found[0]["uri"], file, "{mark}: {found}");
        let wanted = position(text, text.find(at).unwrap());
        assert_eq!(found[0]["range"]["start"], wanted, "{mark}: {found}");
    };
    check("mesh: \"ba|ll\", lift", &uri(&path), "ball\": Read", FACE);
    check("\"no|se.mesh\"", &uri(&path), "nose\": Nose", FACE);
    check("\"nose.me|sh\"", &nose, "mesh\": \"moved", NOSE);
    check(", li|ft: Expr", &nose, "lift\": Number", NOSE);
    check("(li|ft: 1.0)", &nose, "lift\": Number", NOSE);
    check("with: (me|sh: ", &nose, "mesh\": Mesh", NOSE);
    check("N|ose(mesh", &nose, "Graph(", NOSE);
    check("\"lib/no|se.ron\"", &nose, "Graph(", NOSE);
    check("\"gro|wth * 2\"", &uri(&path), "growth\": Number", FACE);
    check("Closed(\"smo|oth\")", &uri(&path), "smooth\": Sub", FACE);
    check("Closed(\"all|.ply\")", &uri(&path), "all.ply\": \"all", FACE);
    fn count(editor: &mut Editor, path: &Path, text: &str, mark: &str, declares: bool) -> String {
        let mut asked = place_of(path, text, mark);
        asked["context"] = json!({ "includeDeclaration": declares });
        let found = editor.ask("textDocument/references", asked);
        let mut files: Vec<_> = found
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it["uri"].as_str().unwrap().rsplit('/').next().unwrap().to_owned())
            .collect();
        files.sort();
        files.join(" ")
    }
    let e = &mut editor;
    assert_eq!(
        count(e, &path, FACE, "\"gro|wth\": Num", true),
        "big.ron face.ron face.ron face.test.ron"
    );
    assert_eq!(count(e, &path, FACE, "\"smo|oth\": Sub", false), "big.ron face.ron face.ron");
    let nose_path = place.path("lib/nose.ron");
    editor.open(&nose_path, NOSE);
    let e = &mut editor;
    assert_eq!(
        count(e, &nose_path, NOSE, "\"li|ft\": Num", false),
        "big.ron face.ron face.ron face.ron face.test.ron nose.ron"
    );
}

#[test]
fn a_new_name_changes_names_alone_in_all_files() {
    let place = face();
    let all = ["face.ron", "lib/nose.ron", "big.ron", "face.test.ron"];
    let mut editor = place.editor();
    fn read(name: &str, place: &crate::lsp::Place) -> String {
        std::fs::read_to_string(place.path(name)).unwrap()
    }
    fn keys(place: &crate::lsp::Place) -> Vec<String> {
        let told = ["face.ron", "big.ron"]
            .map(|name| place.run(&["run", "--json", "--no-provenance", name]))
            .concat();
        let hashes = told.lines().filter(|line| line.contains("hash"));
        hashes.map(str::to_owned).collect::<Vec<_>>()
    }
    let before = keys(&place);
    let mut check = |file: &str, mark: &str, to: &str, bytes: i64| {
        let (path, text) = (place.path(file), read(file, &place));
        editor.open(&path, &text);
        let mut asked = place_of(&path, &text, mark);
        asked["newName"] = to.into();
        let changes = editor.ask("textDocument/rename", asked)["changes"].clone();
        let (mut grown, mut files) = (0, 0);
        for name in all {
            let Some(edits) = changes.get(uri(&place.path(name))) else { continue };
            let old = read(name, &place);
            let new = apply_edits(&old, edits);
            grown += new.len() as i64 - old.len() as i64;
            files += 1;
            place.write(name, &new);
            editor.change(&place.path(name), &new);
        }
        assert!(files > 0 && files == changes.as_object().unwrap().len(), "{changes}");
        assert_eq!(grown, bytes, "{changes}");
        for name in all {
            let told = place.run(&["check", "--json", name]);
            let told: Json = serde_json::from_str(&told).unwrap();
            assert_eq!(told["problems"], json!([]), "{name} after {to}");
        }
    };
    check("face.ron", "\"gro|wth\": Num", "size", -2 * 4);
    check("face.ron", "\"smo|oth\": Sub", "smoother", 2 * 4);
    check("lib/nose.ron", "\"li|ft\": Num", "raise", 7);
    check("lib/nose.ron", "outputs: { \"me|sh\"", "moved-mesh", 6 * 3);
    check("lib/nose.ron", "inputs: { \"me|sh\"", "what", 0);
    check("face.ron", "\"No|se\": \"lib", "Snout", 3);
    check("face.ron", "\"ey|es\": For", "lids", 0);
    check("lib/nose.ron", "inputs: { \"wh|at\"", "the-mesh", 4 * 4);
    check("face.ron", "the_m|esh: \"ball\", raise", "some_mesh", 4);
    assert_eq!(keys(&place), before);
    // A rename that is impossible is refused with a reason.
    let text = read("face.ron", &place);
    let mut refused = |mark: &str, to: &str, wanted: &str| {
        let mut asked = place_of(&place.path("face.ron"), &text, mark);
        asked["newName"] = to.into();
        let why = editor.try_ask("textDocument/rename", asked).unwrap_err();
        assert!(why.contains(wanted), "{why}");
    };
    refused("\"smo|other\": Sub", "Big One", "cannot be a name");
    refused("\"smo|other\": Sub", "ball", "already");
    refused("\"face|.ply\":", "x.ply", "name of a file");
    refused("form|at: 1", "x", "no name");
    place.write("face.pins.ron", "Pins(pins: { \"ball\": () })");
    refused("\"ba|ll\": Read", "sphere", "pinned");
}

#[test]
fn names_in_the_groups_of_a_for_each_are_followed() {
    let each = r#"Graph(
    format: 1,
    use: { "Nose": "lib/nose.ron" },
    nodes: {
        "ball": ReadMesh(path: "ball.obj"),
        "same": ForEach(graph: "Nose", over: Parts("ball"), with: (lift: 1.0)),
        "eyes": ForEach(graph: "Nose", over: [(lift: 1.0), (lift: 2.0)], links: (mesh: "ball")),
        "all": Merge(meshes: ["same", "eyes"]),
    },
    outputs: { "all.ply": "all" },
)
"#;
    let set = ["same.with.lift", "eyes.over.1.lift", "eyes/2.lift"];
    for target in set {
        let place = face();
        place.write("each.ron", each);
        let test =
            format!("Test(graph: \"each.ron\", cases: {{ \"x\": (set: {{ \"{target}\": 3 }}) }})");
        place.write("each.test.ron", &test);
        let (node, field) = target.rsplit_once('.').unwrap();
        let patch =
            format!("Patch(format: 1, of: \"each.ron\", nodes: {{ \"{node}\": ({field}: 3) }})");
        place.write("patch.ron", &patch);
        let nose = place.path("lib/nose.ron");
        let mut editor = place.editor();
        editor.open(&nose, NOSE);
        let mut asked = place_of(&nose, NOSE, "\"li|ft\": Num");
        asked["newName"] = "the-lift".into();
        let changes = editor.ask("textDocument/rename", asked)["changes"].clone();
        for (name, old) in [("each.test.ron", test), ("patch.ron", patch)] {
            let new = apply_edits(&old, &changes[uri(&place.path(name))]);
            assert_eq!(new, old.replace("lift", "the_lift"), "{name}: {changes}");
        }
    }
}

#[test]
fn names_in_sweeps_are_followed() {
    let place = face();
    let sweep = r#"Sweep(
    graph: "face.ron",
    over: Product([
        Values("growth", [5, 6]),
        Zip([Values("smooth.levels", [0, 1]), Files(pattern: "*.obj", set: "ball.path", name: "growth-of-files")]),
    ]),
    set: { "ball.path": "ball.obj" },
    out: "{growth}/{smooth.levels}",
    picture: "face.ply",
)
"#;
    place.write("face.sweep.ron", sweep);
    let mut editor = place.editor();
    let text = std::fs::read_to_string(place.path("face.ron")).unwrap();
    editor.open(&place.path("face.ron"), &text);
    let mut renamed = |mark: &str, to: &str| {
        let mut asked = place_of(&place.path("face.ron"), &text, mark);
        asked["newName"] = to.into();
        let changes = editor.ask("textDocument/rename", asked)["changes"].clone();
        apply_edits(sweep, &changes[uri(&place.path("face.sweep.ron"))])
    };
    let new = renamed("\"gro|wth\": Num", "size");
    let expected =
        sweep.replace("Values(\"growth\"", "Values(\"size\"").replace("{growth}", "{size}");
    assert_eq!(new, expected);
    let new = renamed("\"smo|oth\": Sub", "smoother");
    assert_eq!(new, sweep.replace("smooth.levels", "smoother.levels"));
    let new = renamed("\"ba|ll\": Read", "sphere");
    assert_eq!(new, sweep.replace("ball.path", "sphere.path"));
}
