//! Graphs in editors: each test is named after a statement that a language server must keep.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value as Json, json};

mod editor;

use editor::{Editor, edited, place, position, uri};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs");
const BAD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/bad");

/// A folder with a project, and one for results.
struct Place {
    folder: PathBuf,
    cache: PathBuf,
    _kept: tempfile::TempDir,
}

impl Place {
    fn new(files: &[(&str, &str)]) -> Self {
        let kept = tempfile::tempdir().unwrap();
        let root = std::fs::canonicalize(kept.path()).unwrap();
        let (folder, cache) = (root.join("project"), root.join("cache"));
        std::fs::create_dir_all(&folder).unwrap();
        let place = Self { folder, cache, _kept: kept };
        place.write("maquette.toml", "");
        files.iter().for_each(|(name, text)| place.write(name, text));
        place
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The doll's files, and a graph.
    fn doll(name: &str, text: &str) -> Self {
        let place = Self::new(&[(name, text)]);
        copied(&Path::new(GRAPHS).join("doll"), &place.path("doll"));
        place
    }

    fn editor(&self) -> Editor {
        Editor::new(&self.cache)
    }

    fn run(&self, words: &[&str]) -> String {
        let program = Command::new(env!("CARGO_BIN_EXE_maquette"))
            .args(words)
            .current_dir(&self.folder)
            .env("MAQUETTE_CACHE", &self.cache)
            .output()
            .unwrap();
        String::from_utf8(program.stdout).unwrap()
    }
}

fn copied(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        match entry.path().is_dir() {
            true => copied(&entry.path(), &to.join(entry.file_name())),
            false => drop(std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap()),
        }
    }
}

/// The files with graphs and tests in a folder.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.to_string_lossy().into_owned();
        if path.is_dir() && !name.ends_with("goldens") {
            files(&path, found);
        } else if name.ends_with(".ron")
            && !name.ends_with(".pins.ron")
            && !name.ends_with(".lock.ron")
        {
            found.push(path);
        }
    }
    found.sort();
}

/// Problems as both tell them: file, severity, code, place, words.
type Told = BTreeSet<(String, u64, String, [u64; 4], String)>;

fn told_by_check(document: &Json) -> Told {
    let number = |problem: &Json, name: &str| problem[name].as_u64().unwrap() - 1;
    let problems = document["problems"].as_array().unwrap().iter().map(|problem| {
        let place = ["line", "column", "end_line", "end_column"].map(|name| number(problem, name));
        let severity = if problem["severity"] == "error" { 1 } else { 2 };
        let text = |name: &str| problem[name].as_str().unwrap().to_owned();
        (format!("file://{}", text("file")), severity, text("code"), place, text("message"))
    });
    problems.collect()
}

fn told_by_server(uri: &str, diagnostics: &[Json]) -> Told {
    let one = |it: &Json| {
        let number = |way: &str| it.pointer(way).unwrap().as_u64().unwrap();
        let place = [
            "/range/start/line",
            "/range/start/character",
            "/range/end/line",
            "/range/end/character",
        ];
        let text = |name: &str| it[name].as_str().unwrap().to_owned();
        (
            uri.to_owned(),
            it["severity"].as_u64().unwrap(),
            text("code"),
            place.map(number),
            text("message"),
        )
    };
    diagnostics.iter().map(one).collect()
}

#[test]
fn problems_are_those_of_check() {
    let place = Place::new(&[]);
    copied(Path::new(BAD), &place.path("bad"));
    copied(Path::new(GRAPHS), &place.path("good"));
    let mut all = Vec::new();
    files(&place.path("bad"), &mut all);
    files(&place.path("good"), &mut all);
    let all = Vec::from_iter(all.into_iter().filter(|path| {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        // Letters beyond the first plane count twice in an editor.
        let word = text
            .lines()
            .find(|line| !line.trim().is_empty() && !line.trim_start().starts_with("//"));
        word.is_some_and(|line| {
            ["Graph", "Patch", "Test"].iter().any(|word| line.starts_with(word))
        }) && text.chars().all(|c| c.len_utf16() == 1)
    }));
    assert!(all.len() > 100, "{}", all.len());
    let mut errors = 0;
    for path in &all {
        let mut editor = place.editor();
        editor.open(path, &std::fs::read_to_string(path).unwrap());
        editor.diagnostics(path);
        let found = editor.told.iter().flat_map(|(uri, told)| told_by_server(uri, told));
        let found = Told::from_iter(found);
        let document = place.run(&["check", "--json", path.to_str().unwrap()]);
        let document: Json = serde_json::from_str(&document).unwrap();
        if document.get("more_problems").is_some() {
            continue;
        }
        assert_eq!(found, told_by_check(&document), "{}", path.display());
        errors += found.len();
    }
    assert!(errors > 60, "{errors}");
}

const NOSE: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "What is moved.") },
    params: { "lift": Number(default: 1.0, min: 0.0, max: 9.0, unit: "mm", doc: "How far.") },
    nodes: { "moved": Transform(mesh: "mesh", translate: (0, Param("lift"), 0)) },
    outputs: { "mesh": "moved" },
)
"#;

const FACE: &str = r#"// ä: not ASCII.
Graph(
    format: 1,
    use: { "Nose": "lib/nose.ron" },
    params: { "growth": Number(default: 2.0, unit: "mm", doc: "How much.") },
    nodes: {
        "ball": ReadMesh(path: "ball.obj"),
        "nose": Nose(mesh: "ball", lift: Expr("growth * 2")),
        "smooth": Subdivide(mesh: "nose.mesh", scheme: Loop, levels: 1),
        "eyes": ForEach(graph: "Nose", over: [(lift: 1.0), (lift: 2.0)], with: (mesh: "ball")),
        "all": Merge(meshes: "eyes.mesh"),
    },
    outputs: { "face.ply": "smooth", "all.ply": "all" },
    expect: [Closed("smooth"), Closed("all.ply")],
)
"#;

const BALL: &str = "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

fn face() -> Place {
    let test = "Test(graph: \"face.ron\", cases: { \"big\": (set: { \"growth\": 3.0, \"nose.lift\": 1.0 }) })\n";
    let patch = "Patch(format: 1, of: \"face.ron\", params: { \"growth\": 4.0 }, nodes: { \"smooth\": (levels: 2), \"nose\": (lift: 3.0) })\n";
    Place::new(&[
        ("lib/nose.ron", NOSE),
        ("face.ron", FACE),
        ("ball.obj", BALL),
        ("face.test.ron", test),
        ("big.ron", patch),
    ])
}

#[test]
fn a_used_file_counts_as_it_is_in_the_editor() {
    let place = face();
    let mut editor = place.editor();
    let (face, nose) = (place.path("face.ron"), place.path("lib/nose.ron"));
    editor.open(&face, FACE);
    assert_eq!(editor.diagnostics(&face), Vec::<Json>::new());
    let other = NOSE.replace("\"lift\"", "\"raise\"");
    editor.open(&nose, &other);
    editor.diagnostics(&nose);
    let messages =
        Vec::from_iter(editor.told[&uri(&face)].iter().map(|it| it["message"].as_str().unwrap()));
    assert!(messages.contains(&"Nose has no field `lift`"), "{messages:?}");
    // On disk nothing has changed; closed, it counts as it is there.
    editor.tell("textDocument/didClose", json!({ "textDocument": { "uri": uri(&nose) } }));
    editor.change(&face, &format!("{FACE} "));
    assert_eq!(editor.diagnostics(&face), Vec::<Json>::new());
}

#[test]
fn what_belongs_to_nobody_is_left_alone() {
    let place = Place::new(&[]);
    let mut editor = place.editor();
    let foreign = place.path("settings.ron");
    let text = "Settings(color: \"#ff0000\", nodes: 3)";
    editor.open(&foreign, text);
    let elsewhere = place.folder.parent().unwrap().join("elsewhere.ron");
    editor.open(&elsewhere, "Graph(format: 7)");
    for path in [&foreign, &elsewhere] {
        let document = json!({ "textDocument": { "uri": uri(path) } });
        for method in ["documentSymbol", "documentColor", "codeLens", "foldingRange"] {
            assert_eq!(
                editor.ask(&format!("textDocument/{method}"), document.clone()),
                Json::Null,
                "{method}"
            );
        }
    }
    assert_eq!(editor.told.len(), 0, "{:?}", editor.told);
}

#[test]
fn completion_proposes_what_fits() {
    let place = face();
    let path = place.path("new.ron");
    let mut editor = place.editor();
    // What has been written, where, what is among the first five, and what is not there.
    let check = |editor: &mut Editor, text: &str, wanted: &[&str], not: &[&str]| {
        editor.open(&path, text);
        let found = editor.proposed(&path, text, text);
        let first = Vec::from_iter(found.iter().take(5).map(String::as_str));
        for wanted in wanted {
            assert!(first.contains(wanted), "{wanted} in {found:?} behind {text}");
        }
        for not in not {
            assert!(!found.iter().any(|it| it == not), "{not} in {found:?} behind {text}");
        }
    };
    let e = &mut editor;
    check(e, "Gr", &["Graph"], &[]);
    check(e, "Graph(", &["format", "nodes", "outputs"], &[]);
    check(e, "Graph(format: ", &["1"], &[]);
    check(e, "Graph(format: 1, ", &["nodes", "outputs"], &["format"]);
    check(e, "Graph(use: { \"Nose\": \"", &["lib/", "face.ron"], &["ball.obj"]);
    check(e, "Graph(use: { \"Nose\": \"lib/", &["lib/nose.ron"], &[]);
    check(e, "Graph(inputs: { \"a\": Me", &["Mesh"], &[]);
    check(e, "Graph(inputs: { \"a\": Mesh(wants: [Clo", &["Closed"], &[]);
    check(e, "Graph(params: { \"a\": Nu", &["Number"], &[]);
    check(e, "Graph(params: { \"a\": Number(", &["default", "min", "max", "unit"], &["of"]);
    check(e, "Graph(params: { \"a\": Number(unit: \"", &["mm", "deg"], &[]);
    check(e, "Graph(nodes: { \"a\": Thre", &["Threshold"], &[]);
    let head = "Graph(use: { \"Nose\": \"lib/nose.ron\" }, params: { \"growth\": Number(default: 1.0, unit: \"mm\"), \"hue\": Color(default: \"#ffffff\") }, nodes: { \"scan\": ReadCapture(color: \"a.png\"), \"ball\": ReadMesh(path: \"ball.obj\"), ";
    let check = |editor: &mut Editor, rest: &str, wanted: &[&str], not: &[&str]| {
        check(editor, &format!("{head}{rest}"), wanted, not);
    };
    check(e, "\"a\": ", &["Nose", "Subdivide"], &[]);
    check(e, "\"a\": Nose(", &["mesh", "lift"], &[]);
    check(e, "\"a\": Nose(mesh: ", &["ball"], &["scan.color", "a"]);
    check(e, "\"a\": Nose(mesh: \"", &["ball"], &["scan.color", "a"]);
    check(e, "\"a\": Nose(lift: ", &["1.0", "Param(\"growth\")", "mm"], &["Param(\"hue\")", "deg"]);
    check(e, "\"a\": Nose(lift: Param(\"", &["growth"], &[]);
    check(e, "\"a\": Nose(lift: Expr(\"2 * gr", &["growth"], &[]);
    check(e, "\"a\": ReadMesh(path: \"", &["ball.obj"], &["face.ron"]);
    check(e, "\"a\": ReadMesh(", &["path", "unit"], &[]);
    check(
        e,
        "\"a\": Subdivide(mesh: \"ball\", scheme: ",
        &["Loop", "CatmullClark", "DooSabin"],
        &[],
    );
    check(e, "\"a\": Subdivide(mesh: \"ball\", limit: ", &["true", "false"], &[]);
    check(e, "\"a\": Threshold(image: \"", &["scan.color"], &["ball", "scan.range"]);
    check(e, "\"a\": Threshold(image: \"scan.color\", ", &["select"], &["image"]);
    check(e, "\"a\": Threshold(image: \"scan.color\", select: Near(", &["color", "distance"], &[]);
    check(
        e,
        "\"a\": Threshold(image: \"scan.color\", select: Near(color: ",
        &["Param(\"hue\")"],
        &["Param(\"growth\")"],
    );
    check(e, "\"a\": Merge(meshes: [\"", &["ball"], &["scan.color"]);
    check(e, "\"a\": ForEach(", &["graph", "over", "with"], &[]);
    check(e, "\"a\": ForEach(graph: \"", &["Nose"], &[]);
    check(e, "\"a\": ForEach(graph: \"Nose\", over: [(", &["lift"], &["path"]);
    check(e, "\"a\": ForEach(graph: \"Nose\", each: \"", &["mesh"], &["lift"]);
    check(e, "\"a\": Switch(cases: { \"one\": \"", &["ball", "scan.color"], &[]);
    check(e, "\"a\": Nose(mesh: \"ball\") }, outputs: { \"x.ply\": \"", &["a"], &[]);
    check(e, "}, outputs: { \"x.ply\": \"ball\" }, expect: [Clo", &["Closed"], &[]);
    check(e, "}, outputs: { \"x.ply\": \"ball\" }, expect: [Closed(\"", &["x.ply", "ball"], &[]);
    check(
        e,
        "}, outputs: { \"x.ply\": \"ball\" }, expect: [Count(of: \"ball\", ",
        &["what"],
        &["of"],
    );
    let check = |editor: &mut Editor, text: &str, wanted: &[&str]| {
        editor.open(&path, text);
        let found = editor.proposed(&path, text, text);
        wanted.iter().for_each(|wanted| {
            assert!(
                found.iter().take(5).any(|it| it == wanted),
                "{wanted} in {found:?} behind {text}"
            );
        });
    };
    check(e, "Patch(format: 1, of: \"face.ron\", params: { \"", &["growth"]);
    check(e, "Patch(format: 1, of: \"face.ron\", nodes: { \"sm", &["smooth"]);
    check(e, "Patch(format: 1, of: \"face.ron\", nodes: { \"smooth\": (", &["levels", "scheme"]);
    check(e, "Patch(format: 1, of: \"face.ron\", nodes: { \"nose\": (li", &["lift"]);
    check(e, "Test(graph: \"", &["face.ron"]);
    check(e, "Test(graph: \"face.ron\", cases: { \"a\": (set: { \"gr", &["growth"]);
    check(e, "Test(graph: \"face.ron\", cases: { \"a\": (set: { \"smooth.le", &["smooth.levels"]);
    check(e, "Test(graph: \"face.ron\", compare: { \"", &["face.ply"]);
    check(e, "Test(graph: \"face.ron\", compare: { \"face.ply\": Mesh(ma", &["max"]);
}

#[test]
fn completion_bears_every_cut() {
    let mut texts = Vec::new();
    files(&std::fs::canonicalize(GRAPHS).unwrap(), &mut texts);
    let place = face();
    let mut editor = place.editor();
    let (mut asked, mut met, mut named) = (0, 0, 0);
    for path in
        texts.iter().filter(|path| !path.to_string_lossy().contains("/nodes/")).step_by(7).take(20)
    {
        let text = std::fs::read_to_string(path).unwrap();
        for at in (0..text.len()).filter(|&at| text.is_char_boundary(at)).step_by(3) {
            let cut = &text[..at];
            editor.open(path, cut);
            let found = editor.proposed(path, cut, cut);
            asked += 1;
            // The word that is being written is among the first five once half of it is there.
            let typed =
                cut.chars().rev().take_while(|c| c.is_alphanumeric() || "-_.".contains(*c)).count();
            let rest = text[at..]
                .chars()
                .take_while(|c| c.is_alphanumeric() || "-_.".contains(*c))
                .count();
            let word = &text[at - typed.min(at)
                ..at + text[at..].chars().take(rest).map(char::len_utf8).sum::<usize>()];
            if typed < 2 || rest == 0 || rest > typed || found.is_empty() {
                continue;
            }
            named += 1;
            met += usize::from(
                found.iter().take(5).any(|it| it.starts_with(word) || it.contains(word)),
            );
        }
    }
    assert!(asked > 5_000, "{asked}");
    assert!(named > 500 && 100 * met >= 97 * named, "{met} of {named}");
}

#[test]
fn hover_says_what_is_known() {
    let place = face();
    let path = place.path("face.ron");
    let said = |editor: &mut Editor, text: &str, mark: &str| {
        let found = editor.at("textDocument/hover", &path, text, mark);
        found["contents"]["value"].as_str().unwrap_or_default().to_owned()
    };
    let check = |editor: &mut Editor, mark: &str, wanted: &[&str]| {
        let found = said(editor, FACE, mark);
        wanted
            .iter()
            .for_each(|wanted| assert!(found.contains(wanted), "{wanted} in {found} at {mark}"));
    };
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let e = &mut editor;
    check(e, "Sub|divide(", &["Subdivide", "pack", "levels", "gives mesh: Mesh"]);
    check(e, "N|ose(mesh", &["Nose", "lib/nose.ron", "lift", "mesh: Mesh"]);
    check(e, "lev|els: 1", &["levels", "integer", "1"]);
    check(e, ", li|ft: Expr", &["lift", "number 0 to 9 mm = 1", "How far."]);
    check(e, "scheme: Lo|op", &["Loop"]);
    check(e, "\"gro|wth * 2\"", &["growth", "mm = 2", "How much."]);
    check(e, "\"grow|th\": Number", &["growth", "mm = 2"]);
    check(e, "\"nose.m|esh\"", &["nose.mesh", "Mesh", "Nose"]);
    check(e, "For|Each", &["ForEach"]);
    check(e, "ex|pect", &["expect"]);
    check(e, "[Clo|sed(\"smooth\")", &["Closed", "no boundary"]);
    check(e, "\"ball.|obj\"", &["ball.obj", "bytes"]);
    let nothing = said(e, FACE, "not |ASCII");
    assert_eq!(nothing, "");
    // What the last evaluation found, and that it is old after an edit.
    assert!(!said(e, FACE, "\"nose.m|esh\"").contains("last"));
    drop(editor);
    place.run(&["run", "face.ron"]);
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let found = said(&mut editor, FACE, "\"smo|oth\": Sub");
    assert!(found.contains("last: 10 vertices") && !found.contains("stale"), "{found}");
    let other = FACE.replace("growth * 2", "growth * 3");
    editor.change(&path, &other);
    let found = said(&mut editor, &other, "\"smo|oth\": Sub");
    assert!(found.contains("stale") && found.contains("10 vertices"), "{found}");
    let found = said(&mut editor, &other, "\"ba|ll\": Read");
    assert!(found.contains("last: 4 vertices") && !found.contains("stale"), "{found}");
}

#[test]
fn hints_are_what_came_out_and_nothing_runs_for_them() {
    let place = face();
    let path = place.path("face.ron");
    let all =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 99, "character": 0 } });
    let asked = json!({ "textDocument": { "uri": uri(&path) }, "range": all });
    let mut editor = place.editor();
    editor.open(&path, FACE);
    assert_eq!(editor.ask("textDocument/inlayHint", asked.clone()), json!([]));
    place.run(&["run", "face.ron"]);
    drop(editor);
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let hints = editor.ask("textDocument/inlayHint", asked.clone());
    let labels =
        Vec::from_iter(hints.as_array().unwrap().iter().map(|it| it["label"].as_str().unwrap()));
    assert_eq!(labels.len(), 5, "{labels:?}");
    assert!(labels[0].starts_with("4 vertices") && labels[0].ends_with('s'), "{labels:?}");
    assert!(!place.path("out").join("nothing").exists());
    // Who does not want them has none.
    let options = json!({ "hints": false });
    let mut editor = Editor::that_can(&place.cache, json!({}), options);
    editor.open(&path, FACE);
    assert_eq!(editor.ask("textDocument/inlayHint", asked), json!([]));
}

#[test]
fn definitions_and_references_lead_through_files() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let nose = uri(&place.path("lib/nose.ron"));
    let mut check = |mark: &str, file: &str, at: &str, text: &str| {
        let found = editor.at("textDocument/definition", &path, FACE, mark);
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
    let count = |editor: &mut Editor, path: &Path, text: &str, mark: &str, declares: bool| {
        let mut asked = place_of(path, text, mark);
        asked["context"] = json!({ "includeDeclaration": declares });
        let found = editor.ask("textDocument/references", asked);
        let mut files = Vec::from_iter(
            found
                .as_array()
                .unwrap()
                .iter()
                .map(|it| it["uri"].as_str().unwrap().rsplit('/').next().unwrap().to_owned()),
        );
        files.sort();
        files.join(" ")
    };
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

fn place_of(path: &Path, text: &str, mark: &str) -> Json {
    place(path, text, mark)
}

#[test]
fn a_new_name_changes_names_alone_in_all_files() {
    let place = face();
    let all = ["face.ron", "lib/nose.ron", "big.ron", "face.test.ron"];
    let mut editor = place.editor();
    let read = |name: &str| std::fs::read_to_string(place.path(name)).unwrap();
    let keys = || {
        let told = ["face.ron", "big.ron"]
            .map(|name| place.run(&["run", "--json", "--no-provenance", name]))
            .concat();
        let hashes = told.lines().filter(|line| line.contains("hash"));
        hashes.map(str::to_owned).collect::<Vec<_>>()
    };
    let before = keys();
    let mut check = |file: &str, mark: &str, to: &str, bytes: i64| {
        let (path, text) = (place.path(file), read(file));
        editor.open(&path, &text);
        let mut asked = place_of(&path, &text, mark);
        asked["newName"] = to.into();
        let changes = editor.ask("textDocument/rename", asked)["changes"].clone();
        let (mut grown, mut files) = (0, 0);
        for name in all {
            let Some(edits) = changes.get(uri(&place.path(name))) else { continue };
            let old = read(name);
            let new = edited(&old, edits);
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
    assert_eq!(keys(), before);
    // What cannot be is said.
    let text = read("face.ron");
    let mut refused = |mark: &str, to: &str, wanted: &str| {
        let mut asked = place_of(&place.path("face.ron"), &text, mark);
        asked["newName"] = to.into();
        let why = editor.try_ask("textDocument/rename", asked).unwrap_err();
        assert!(why.contains(wanted), "{why}");
    };
    refused("\"smo|other\": Sub", "Big One", "cannot be a name");
    refused("\"smo|other\": Sub", "ball", "already");
    refused("wh|at: \"ball\", raise", "the-mesh", "without hyphens");
    refused("\"face|.ply\":", "x.ply", "name of a file");
    refused("form|at: 1", "x", "no name");
    place.write("face.pins.ron", "Pins(pins: { \"ball\": () })");
    refused("\"ba|ll\": Read", "sphere", "pinned");
}

#[test]
fn a_fix_is_applied_by_an_action() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = place.editor();
    let text = FACE.replace("Subdivide(", "Subdivde(").replace("levels: 1", "levls: 1");
    editor.open(&path, &text);
    let diagnostics = editor.diagnostics(&path);
    assert_eq!(diagnostics.len(), 1, "{diagnostics:?}");
    let range = diagnostics[0]["range"].clone();
    let asked = json!({ "textDocument": { "uri": uri(&path) }, "range": range, "context": { "diagnostics": diagnostics } });
    let actions = editor.ask("textDocument/codeAction", asked);
    assert_eq!(actions[0]["title"], "Write `Subdivide` in place of `Subdivde`", "{actions}");
    let mended = edited(&text, &actions[0]["edit"]["changes"][uri(&path)]);
    assert_eq!(mended, FACE.replace("levels: 1", "levls: 1"));
    // All at once, the one that the first has hidden as well.
    let whole =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 0, "character": 0 } });
    let context = json!({ "diagnostics": [], "only": ["source.fixAll"] });
    let asked =
        json!({ "textDocument": { "uri": uri(&path) }, "range": whole, "context": context });
    let actions = editor.ask("textDocument/codeAction", asked);
    assert_eq!(edited(&text, &actions[0]["edit"]["changes"][uri(&path)]), FACE);
}

#[test]
fn colors_links_symbols_folds_and_words() {
    let text = std::fs::read_to_string(Path::new(GRAPHS).join("doll.ron")).unwrap();
    let place = Place::doll("doll.ron", &text);
    let path = place.path("doll.ron");
    let mut editor = place.editor();
    editor.open(&path, &text);
    let document = json!({ "textDocument": { "uri": uri(&path) } });
    let mut ask = |method: &str| editor.ask(&format!("textDocument/{method}"), document.clone());
    let colors = ask("documentColor");
    let first = &colors[0];
    assert!(first["color"]["red"].as_f64().unwrap() > 0.5, "{colors}");
    let links = ask("documentLink");
    assert!(
        links
            .as_array()
            .unwrap()
            .iter()
            .any(|it| it["target"] == uri(&place.path("doll/color.png"))),
        "{links}"
    );
    let symbols = ask("documentSymbol");
    let names =
        Vec::from_iter(symbols.as_array().unwrap().iter().map(|it| it["name"].as_str().unwrap()));
    assert!(names.contains(&"nodes") && names.contains(&"outputs"), "{names:?}");
    let nodes = symbols.as_array().unwrap().iter().find(|it| it["name"] == "nodes").unwrap();
    assert!(nodes["children"].as_array().unwrap().len() > 5);
    for symbol in symbols.as_array().unwrap() {
        for inner in symbol["children"].as_array().unwrap() {
            let within = |a: &Json, b: &Json| {
                let at =
                    |it: &Json| (it["line"].as_u64().unwrap(), it["character"].as_u64().unwrap());
                at(&b["start"]) <= at(&a["start"]) && at(&a["end"]) <= at(&b["end"])
            };
            assert!(within(&inner["range"], &symbol["range"]), "{inner} in {symbol}");
            assert!(within(&inner["selectionRange"], &inner["range"]), "{inner}");
        }
    }
    assert!(ask("foldingRange").as_array().unwrap().len() > 3);
    let words = ask("semanticTokens/full");
    let data = words["data"].as_array().unwrap();
    assert!(data.len() > 200 && data.len().is_multiple_of(5));
    // A picked color changes one literal and nothing else.
    let color = json!({ "red": 0.0, "green": 0.5, "blue": 1.0, "alpha": 1.0 });
    let asked =
        json!({ "textDocument": { "uri": uri(&path) }, "color": color, "range": first["range"] });
    let picked = editor.ask("textDocument/colorPresentation", asked);
    let new = edited(&text, &json!([picked[0]["textEdit"]]));
    assert_eq!(new.len(), text.len());
    assert_eq!(
        new.bytes().zip(text.bytes()).filter(|(a, b)| a != b).count().clamp(1, 6),
        new.bytes().zip(text.bytes()).filter(|(a, b)| a != b).count()
    );
    assert!(new.contains("#0080ff"));
}

#[test]
fn lenses_run_watch_inspect_and_say_why() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let document = json!({ "textDocument": { "uri": uri(&path) } });
    let lenses = editor.ask("textDocument/codeLens", document.clone());
    let titles = |lenses: &Json| {
        Vec::from_iter(
            lenses
                .as_array()
                .unwrap()
                .iter()
                .map(|it| it["command"]["title"].as_str().unwrap().to_owned()),
        )
    };
    assert_eq!(titles(&lenses), ["run", "watch", "inspect", "why", "inspect", "why"]);
    let command = |lens: &Json| lens["command"].clone();
    let ran = editor.ask("workspace/executeCommand", command(&lenses[0]));
    assert!(ran["text"].as_str().unwrap().contains("nodes computed"), "{ran}");
    let whole =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 99, "character": 0 } });
    let asked = json!({ "textDocument": { "uri": uri(&path) }, "range": whole });
    assert_eq!(editor.ask("textDocument/inlayHint", asked).as_array().unwrap().len(), 5);
    let inspected = editor.ask("workspace/executeCommand", command(&lenses[2]));
    assert!(inspected["text"].as_str().unwrap().contains("vertices"), "{inspected}");
    let why = editor.ask("workspace/executeCommand", command(&lenses[3]));
    assert!(why["text"].as_str().unwrap().contains("does not run"), "{why}");
    let watched = editor.ask("workspace/executeCommand", command(&lenses[1]));
    let link = watched["url"].as_str().unwrap().to_owned();
    assert!(link.starts_with("http://127.0.0.1:"), "{link}");
    let lenses = editor.ask("textDocument/codeLens", document);
    assert_eq!(titles(&lenses)[1], "stop");
    editor.ask("workspace/executeCommand", command(&lenses[1]));
    // What is not saved is not run.
    editor.change(&path, &format!("{FACE}\n"));
    let refused = editor.try_ask("workspace/executeCommand", command(&lenses[0]));
    assert!(refused.unwrap_err().contains("save"));
}

#[test]
fn what_a_run_finds_is_shown_until_the_text_changes() {
    let place = face();
    let path = place.path("face.ron");
    let text =
        FACE.replace("expect: [", "expect: [Count(of: \"ball\", what: \"faces\", min: 99), ");
    place.write("face.ron", &text);
    let mut editor = place.editor();
    editor.open(&path, &text);
    assert_eq!(editor.diagnostics(&path), Vec::<Json>::new());
    let command = json!({ "command": "maquette.run", "arguments": [uri(&path)] });
    editor.ask("workspace/executeCommand", command);
    let found = editor.some_diagnostics(&path);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0]["source"], "maquette run");
    editor.change(&path, &format!("{text}\n"));
    assert_eq!(editor.diagnostics(&path), Vec::<Json>::new());
}

#[test]
fn a_broken_request_is_refused_and_the_server_goes_on() {
    let place = face();
    let path = place.path("face.ron");
    let mut editor = place.editor();
    editor.open(&path, FACE);
    for (method, params) in [
        ("textDocument/hover", json!({ "textDocument": 3 })),
        ("textDocument/rename", json!(null)),
        ("no/such", json!({})),
        ("workspace/executeCommand", json!({ "command": "rm", "arguments": [uri(&path)] })),
        ("workspace/executeCommand", json!({ "command": "maquette.run", "arguments": [] })),
    ] {
        assert!(editor.try_ask(method, params).is_err(), "{method}");
    }
    editor.tell("textDocument/didChange", json!({ "textDocument": "?" }));
    editor.tell("no/such", json!([]));
    let far = json!({ "textDocument": { "uri": uri(&path) }, "position": { "line": 9999, "character": 9999 } });
    editor.ask("textDocument/completion", far.clone());
    editor.ask("textDocument/hover", far);
    assert!(editor.at("textDocument/hover", &path, FACE, "Sub|divide(").is_object());
}

#[test]
fn formatting_is_fmt() {
    let place = face();
    let path = place.path("face.ron");
    let text = FACE.replace("    format: 1,\n", "format:1,\n");
    let mut editor = place.editor();
    editor.open(&path, &text);
    let options = json!({ "tabSize": 4, "insertSpaces": true });
    let asked = json!({ "textDocument": { "uri": uri(&path) }, "options": options });
    let edits = editor.ask("textDocument/formatting", asked);
    place.write("other.ron", &text);
    place.run(&["fmt", "other.ron"]);
    assert_eq!(edited(&text, &edits), std::fs::read_to_string(place.path("other.ron")).unwrap());
}
