//! The language server: each test is named after a guarantee to editors.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value as Json, json};

use crate::project::GRAPHS;

mod additions;
mod completion;
mod editor;
mod edits;
mod law;
mod line_ends;
mod names;
mod odd_fields;
mod protocol;
mod refactor;

use editor::{Editor, apply_edits, position, uri};

const BAD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/bad");

/// A temporary project folder and a cache folder.
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

    /// Makes a project with one graph and the files of the example graph `doll.ron`.
    fn doll(name: &str, text: &str) -> Self {
        let place = Self::new(&[(name, text)]);
        copy_folder(&Path::new(GRAPHS).join("doll"), &place.path("doll"));
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

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        match entry.path().is_dir() {
            true => copy_folder(&entry.path(), &to.join(entry.file_name())),
            false => drop(std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap()),
        }
    }
}

/// Collects the graph and test files in a folder and its subfolders.
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

/// The diagnostics of `check` and those of the server in a common form: file, severity, code, start and end position, message.
type Diagnostics = BTreeSet<(String, u64, String, [u64; 4], String)>;

fn told_by_check(document: &Json) -> Diagnostics {
    fn number(problem: &Json, name: &str) -> u64 {
        problem[name].as_u64().unwrap() - 1
    }
    let problems = document["problems"].as_array().unwrap().iter().map(|problem| {
        let place = ["line", "column", "end_line", "end_column"].map(|name| number(problem, name));
        let severity = if problem["severity"] == "error" { 1 } else { 2 };
        fn text(name: &str, problem: &Json) -> String {
            problem[name].as_str().unwrap().to_owned()
        }
        (
            format!("file://{}", text("file", problem)),
            severity,
            text("code", problem),
            place,
            text("message", problem),
        )
    });
    problems.collect()
}

fn told_by_server(uri: &str, diagnostics: &[Json]) -> Diagnostics {
    let one = |it: &Json| {
        let place = [
            "/range/start/line",
            "/range/start/character",
            "/range/end/line",
            "/range/end/character",
        ];
        fn text(name: &str, it: &Json) -> String {
            it[name].as_str().unwrap().to_owned()
        }
        (
            uri.to_owned(),
            it["severity"].as_u64().unwrap(),
            text("code", it),
            place.map(|way| it.pointer(way).unwrap().as_u64().unwrap()),
            text("message", it),
        )
    };
    diagnostics.iter().map(one).collect()
}

#[test]
fn problems_are_those_of_check() {
    let place = Place::new(&[]);
    copy_folder(Path::new(BAD), &place.path("bad"));
    copy_folder(Path::new(GRAPHS), &place.path("good"));
    let mut all = Vec::new();
    files(&place.path("bad"), &mut all);
    files(&place.path("good"), &mut all);
    let all: Vec<_> = all
        .into_iter()
        .filter(|path| {
            let text = std::fs::read_to_string(path).unwrap_or_default();
            // Skips files with characters beyond the basic multilingual plane: an editor counts such a character as two UTF-16 units, but
            // `check` counts it as one character.
            let word = text
                .lines()
                .find(|line| !line.trim().is_empty() && !line.trim_start().starts_with("//"));
            word.is_some_and(|line| {
                ["Graph", "Patch", "Test"].iter().any(|word| line.starts_with(word))
            }) && text.chars().all(|c| c.len_utf16() == 1)
        })
        .collect();
    assert!(all.len() > 100, "{}", all.len());
    let mut errors = 0;
    for path in &all {
        let mut editor = place.editor();
        editor.open(path, &std::fs::read_to_string(path).unwrap());
        editor.diagnostics(path);
        let found = editor.told.iter().flat_map(|(uri, told)| told_by_server(uri, told));
        let found = Diagnostics::from_iter(found);
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
    let messages = editor.told[&uri(&face)]
        .iter()
        .map(|it| it["message"].as_str().unwrap())
        .collect::<Vec<_>>();
    assert!(messages.contains(&"Nose has no field `lift`"), "{messages:?}");
    // The edit of `nose.ron` was never saved. After the editor closes this file, the text on disk counts again.
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
fn hover_says_what_is_known() {
    let place = face();
    let path = place.path("face.ron");
    fn hover(editor: &mut Editor, text: &str, mark: &str, path: &Path) -> String {
        let found = editor.ask_at("textDocument/hover", path, text, mark);
        found["contents"]["value"].as_str().unwrap_or_default().to_owned()
    }
    let check = |editor: &mut Editor, mark: &str, wanted: &[&str]| {
        let found = hover(editor, FACE, mark, &path);
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
    let nothing = hover(e, FACE, "not |ASCII", &path);
    assert_eq!(nothing, "");
    // A hover shows the results of the last run, marked as outdated after an edit.
    assert!(!hover(e, FACE, "\"nose.m|esh\"", &path).contains("last"));
    drop(editor);
    place.run(&["run", "face.ron"]);
    let mut editor = place.editor();
    editor.open(&path, FACE);
    let found = hover(&mut editor, FACE, "\"smo|oth\": Sub", &path);
    assert!(found.contains("last: 10 vertices") && !found.contains("outdated"), "{found}");
    let other = FACE.replace("growth * 2", "growth * 3");
    editor.change(&path, &other);
    let found = hover(&mut editor, &other, "\"smo|oth\": Sub", &path);
    assert!(found.contains("outdated") && found.contains("10 vertices"), "{found}");
    let found = hover(&mut editor, &other, "\"ba|ll\": Read", &path);
    assert!(found.contains("last: 4 vertices") && !found.contains("outdated"), "{found}");
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
    let labels = hints
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["label"].as_str().unwrap())
        .collect::<Vec<_>>();
    assert_eq!(labels.len(), 5, "{labels:?}");
    assert!(labels[0].starts_with("4 vertices") && labels[0].ends_with('s'), "{labels:?}");
    assert!(!place.path("out").join("nothing").exists());
    // If the client turns inlay hints off, the server sends none.
    let options = json!({ "hints": false });
    let mut editor = Editor::that_can(&place.cache, json!({}), options);
    editor.open(&path, FACE);
    assert_eq!(editor.ask("textDocument/inlayHint", asked), json!([]));
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
    assert_eq!(actions[0]["title"], "Replace `Subdivde` by `Subdivide`", "{actions}");
    let mended = apply_edits(&text, &actions[0]["edit"]["changes"][uri(&path)]);
    assert_eq!(mended, FACE.replace("levels: 1", "levls: 1"));
    // `source.fixAll` applies all fixes, including that of an error which is only found after the first fix.
    let whole =
        json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 0, "character": 0 } });
    let context = json!({ "diagnostics": [], "only": ["source.fixAll"] });
    let asked =
        json!({ "textDocument": { "uri": uri(&path) }, "range": whole, "context": context });
    let actions = editor.ask("textDocument/codeAction", asked);
    assert_eq!(apply_edits(&text, &actions[0]["edit"]["changes"][uri(&path)]), FACE);
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
    let names = symbols
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["name"].as_str().unwrap())
        .collect::<Vec<_>>();
    assert!(names.contains(&"nodes") && names.contains(&"outputs"), "{names:?}");
    let nodes = symbols.as_array().unwrap().iter().find(|it| it["name"] == "nodes").unwrap();
    assert!(nodes["children"].as_array().unwrap().len() > 5);
    for symbol in symbols.as_array().unwrap() {
        for inner in symbol["children"].as_array().unwrap() {
            fn is_within(a: &Json, b: &Json) -> bool {
                let at =
                    |it: &Json| (it["line"].as_u64().unwrap(), it["character"].as_u64().unwrap());
                at(&b["start"]) <= at(&a["start"]) && at(&a["end"]) <= at(&b["end"])
            }
            assert!(is_within(&inner["range"], &symbol["range"]), "{inner} in {symbol}");
            assert!(is_within(&inner["selectionRange"], &inner["range"]), "{inner}");
        }
    }
    assert!(ask("foldingRange").as_array().unwrap().len() > 3);
    let words = ask("semanticTokens/full");
    let data = words["data"].as_array().unwrap();
    assert!(data.len() > 200 && data.len().is_multiple_of(5));
    // Picking a color replaces one literal and nothing else.
    let color = json!({ "red": 0.0, "green": 0.5, "blue": 1.0, "alpha": 1.0 });
    let asked =
        json!({ "textDocument": { "uri": uri(&path) }, "color": color, "range": first["range"] });
    let picked = editor.ask("textDocument/colorPresentation", asked);
    let new = apply_edits(&text, &json!([picked[0]["textEdit"]]));
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
    fn titles(lenses: &Json) -> Vec<String> {
        lenses
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it["command"]["title"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    }
    assert_eq!(titles(&lenses), ["run", "watch", "inspect", "why", "inspect", "why"]);
    fn command(lens: &Json) -> Json {
        lens["command"].clone()
    }
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
    // A run is refused while the editor has unsaved changes of the graph.
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
    assert!(editor.ask_at("textDocument/hover", &path, FACE, "Sub|divide(").is_object());
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
    assert_eq!(
        apply_edits(&text, &edits),
        std::fs::read_to_string(place.path("other.ron")).unwrap()
    );
}

#[test]
fn sweeps_are_checked_and_completed_and_said_nothing_of_what_graphs_have() {
    let text = "Sweep(\n    graph: \"face.ron\",\n    over: Values(\"growht\", [1]),\n    out: \"{growht}\",\n)\n";
    let place = face();
    let path = place.path("face.sweep.ron");
    place.write("face.sweep.ron", text);
    let mut editor = place.editor();
    editor.open(&path, text);
    let told = told_by_server(&uri(&path), &editor.diagnostics(&path));
    let json: Json =
        serde_json::from_str(&place.run(&["check", "--json", "face.sweep.ron"])).unwrap();
    let checked = told_by_check(&json)
        .into_iter()
        .map(|(_, severity, code, at, message)| (uri(&path), severity, code, at, message));
    assert_eq!(told, checked.collect());
    assert_eq!(told.len(), 1, "{told:?}");
    let cut = "Sweep(\n    graph: \"face.ron\",\n    over: \n)\n";
    editor.change(&path, cut);
    let proposed = editor.complete_at(&path, cut, "over: |");
    for choice in ["Product", "Zip", "Values", "Files"] {
        assert!(proposed.iter().any(|label| label == choice), "{proposed:?}");
    }
    let cut = "Sweep(\n    graph: \"face.ron\",\n    \n)\n";
    editor.change(&path, cut);
    let proposed = editor.complete_at(&path, cut, ",\n    |");
    assert!(
        ["over", "out", "picture", "set"].iter().all(|name| proposed.iter().any(|it| it == name)),
        "{proposed:?}"
    );
    for (cut, wanted) in [
        ("over: Values(|, [1])", "growth"),
        ("over: Values(\"|\", [1])", "smooth.levels"),
        ("over: Zip([Files(\"*.obj\", set: \"ba|\")])", "ball.path"),
        ("over: Files(\"*.obj\", beside: { \"ba|\" })", "ball.path"),
        ("set: { \"gr|\" }", "growth"),
        ("picture: (output: \"|\")", "face.ply"),
    ] {
        let cut = format!("Sweep(\n    graph: \"face.ron\",\n    {cut},\n)\n");
        let text = cut.replace('|', "");
        editor.change(&path, &text);
        let at = cut.find('|').unwrap();
        let place =
            json!({ "textDocument": { "uri": uri(&path) }, "position": position(&text, at) });
        let proposed = editor.ask("textDocument/completion", place);
        let items = proposed["items"].as_array().unwrap();
        assert!(items.iter().any(|item| item["label"] == wanted), "{cut}: {items:?}");
    }
    let actions = json!({ "textDocument": { "uri": uri(&path) }, "range": { "start": position(cut, 0), "end": position(cut, 0) }, "context": { "diagnostics": [] } });
    assert_eq!(editor.ask("textDocument/codeAction", actions), json!([]));
}

#[test]
fn a_folder_without_a_project_is_served_too() {
    let place = Place::new(&[]);
    std::fs::remove_file(place.path("maquette.toml")).unwrap();
    let mut editor = place.editor();
    let path = place.path("a.ron");
    let graph = "Graph(format: 1, nodes: { \"a\": ReadMsh(path: \"a.obj\") }, outputs: {})";
    editor.open(&path, graph);
    let told = editor.diagnostics(&path);
    assert!(told.iter().any(|it| it["code"] == "G003"), "{told:?}");
    // A RON file of another program may also begin with `Graph`. Such a file gets no diagnostics.
    let other = place.path("b.ron");
    editor.open(&other, "Graph(vertices: 3, edges: [(0, 1)])");
    editor.change(&path, graph);
    editor.diagnostics(&path);
    assert_eq!(editor.told.get(&uri(&other)), None);
}
