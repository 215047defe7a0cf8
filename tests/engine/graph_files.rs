//! Invalid graph files. The check must report every error at once, each at its position and with a helpful message.

use std::path::Path;

use expect_test::{Expect, expect};
use maquette::{Catalog, Diagnostic, Graph, Options, Position, Severity};

use crate::beside::shared_folder;

pub(crate) fn problems(path: &Path) -> String {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let checked = Graph::load(path, &catalog, &Options { pins: true, ..Options::default() });
    let is_error = |problem: &Diagnostic| problem.severity == Severity::Error;
    assert_eq!(checked.graph.is_none(), checked.diagnostics.iter().any(is_error));
    let lines = checked.diagnostics.iter().map(|problem| {
        let start = Position::from_offset(&problem.source.text, problem.span.start);
        let end = Position::from_offset(&problem.source.text, problem.span.end);
        let help =
            if problem.help.is_empty() { String::new() } else { format!(" ({})", problem.help) };
        let (code, message) = (problem.code, &problem.message);
        format!("{}:{}-{} {code} {message}{help}\n", start.line, start.column, end.column)
    });
    lines.collect()
}

fn check(text: &str, expected: Expect) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, text).unwrap();
    std::fs::write(folder.path().join("doll.obj"), "").unwrap();
    let root = std::fs::canonicalize(folder.path()).unwrap();
    expected.assert_eq(&problems(&path).replace(root.to_str().unwrap(), "ROOT"));
}

/// Checks a graph with the given nodes and outputs, and compares its diagnostics with the expected ones.
fn check_nodes(nodes: &str, outputs: &str, expected: Expect) {
    check(
        &format!("Graph(format: 1, nodes: {{\n{nodes}\n}}, outputs: {{\n{outputs}\n}})"),
        expected,
    );
}

#[test]
fn a_sound_graph_has_no_problem() {
    check_nodes(r#""doll": ReadMesh(path: "doll.obj"),"#, r#""doll.ply": "doll""#, expect![[""]]);
}

#[test]
fn misspelled_words_are_guessed() {
    check_nodes(
        r#""doll": ReadMsh(path: "doll.obj"), "soft": Subdivide(mesh: "dol", scheme: Lop, levls: 2),"#,
        r#""doll.ply": "doll", "soft.ply": "soft.mseh""#,
        expect![[r#"
            2:9-16 G003 there is no node type `ReadMsh` (did you mean `ReadMesh`?)
            2:60-65 G007 there is no node `dol` (did you mean `doll`?)
            2:75-78 G009 field `scheme` of Subdivide has no choice `Lop` (did you mean `Loop`?)
            2:80-85 G004 Subdivide has no field `levls` (did you mean `levels`?)
            4:33-44 G007 `soft` is a Subdivide, which has no output `mseh` (did you mean `mesh`?)
        "#]],
    );
}

#[test]
fn a_set_that_leads_nowhere_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    let text = r#"Graph(format: 1, params: { "v": Vector(default: (0, 0, 1), doc: "") }, nodes: {
        "doll": ReadMesh(path: "doll.obj"),
        "turned": Transform(mesh: "doll", translate: (1, 2, 3)),
        "lifted": Transform(mesh: "turned", translate: Param("v")),
    }, outputs: { "lifted.ply": "lifted" })"#;
    std::fs::write(&path, text).unwrap();
    std::fs::write(folder.path().join("doll.obj"), "").unwrap();
    let told = |target: &str| {
        let set = vec![(target.to_owned(), "4".to_owned())];
        let options = Options { set, ..Options::default() };
        let checked = Graph::load(&path, &Catalog::new(maquette_nodes::PACKS), &options);
        let told = checked.diagnostics.iter().map(|it| format!("{} ({})\n", it.message, it.help));
        String::from_iter(told)
    };
    assert_eq!(told("turned.translate.2"), "");
    let wrong = ["turned.translate.3", "turned.translate.x", "doll.path.0", "lifted.translate.0"];
    expect![[r#"
        --set turned.translate.3=4: there is no item `3` (its items are numbered from 0 to 2)
        --set turned.translate.x=4: there is no item `x` (its items are numbered from 0 to 2)
        --set doll.path.0=4: there is no `0` in the text "doll.obj" ()
        --set lifted.translate.0=4: its value is Param("v"), a parameter of the graph (set the parameter: v=VALUE)
    "#]].assert_eq(&wrong.map(told).concat());
}

#[test]
fn values_of_the_wrong_kind_or_out_of_range_are_explained() {
    check_nodes(
        r#""doll": ReadMesh(path: "doll.obj"),
"soft": Subdivide(mesh: doll, scheme: Loop, levels: 40),
"half": Subdivide(mesh: "doll", scheme: Loop, levels: 1.5, limit: "yes"),
"turned": Transform(mesh: "doll", rotate: (1, 2), scale: [1, true, 1]),
"plate": Primitive(shape: Box(size: (4, 0, 4))),"#,
        r#""soft.ply": "soft", "half.ply": "half", "turned.ply": "turned", "plate.ply": "plate""#,
        expect![[r#"
            3:25-29 G009 port `mesh` of Subdivide: expected a link, found `doll` (write the name of a node that gives a Mesh: "node")
            3:53-55 G010 field `levels` of Subdivide is 40, but must be at least 0 and at most 12 (8 levels make 65536 faces of one already)
            4:55-58 G009 field `levels` of Subdivide: expected a number without fraction, found the number 1.5
            4:67-72 G009 field `limit` of Subdivide: expected true or false, found the text "yes"
            5:43-49 G009 field `rotate` of Transform: expected 3 values, found 2
            5:62-66 G009 field `scale` of Transform: expected a number, found true
            6:41-42 G010 field `size` of Primitive is 0, but must be more than 0
        "#]],
    );
}

#[test]
fn links_must_lead_somewhere_and_fit() {
    check_nodes(
        r#""doll": ReadMesh(path: "doll.obj"),
"spots": Label(mask: "doll"),
"loose": Subdivide(scheme: Loop),
"a": Subdivide(mesh: "b", scheme: Loop),
"b": Subdivide(mesh: "a", scheme: Loop),"#,
        r#""spots.png": "spots", "loose.ply": "loose", "b.ply": "b""#,
        expect![[r#"
            3:22-28 G012 port `mask` of Label wants a Mask, but `doll` is a Mesh
            4:10-33 G005 Subdivide needs a link at its port `mesh` (write `mesh: "node"` with a node that gives a Mesh)
            5:1-4 G008 cycle: a <- b <- a (a node cannot need its own result: break one of these links)
        "#]],
    );
}

#[test]
fn files_stay_in_the_project_and_outputs_in_their_folder() {
    check_nodes(
        r#""a": ReadMesh(path: "../../etc/passwd"), "b": ReadMesh(path: "dol.obj"),
"c": ReadMesh(path: "/etc/passwd"), "d": ReadMesh(path: ""), "e": ReadMesh(path: "."),"#,
        r#""../a.ply": "a", "b.docx": "b", "c": "c", "d.ply": "d", "e.ply": "e""#,
        expect![[r#"
            2:21-39 G014 `../../etc/passwd` lies outside of the project (move the file into ROOT, put a maquette.toml into a folder above both, or allow its folder with --root)
            2:62-71 G013 there is no file `dol.obj` (did you mean `doll.obj`?)
            3:21-34 G014 `/etc/passwd` is an absolute path, which leads outside of the project (write the path relative to the graph's file)
            3:57-59 G013 field `path` of ReadMesh names no file (write the path of a file)
            3:82-85 G013 `.` is not a file
            5:1-11 G014 output `../a.ply` is outside the output folder (name a file, such as "model.ply"; --out chooses the folder)
            5:18-26 G015 a Mesh cannot be written to a `.docx` file (a Mesh can be written to: 3mf, glb, obj, ply, png, stl)
            5:33-36 G015 output `c` has no extension that determines how to write a Mesh (a Mesh can be written to: 3mf, glb, obj, ply, png, stl)
        "#]],
    );
}

#[test]
fn two_outputs_are_no_one_file() {
    check_nodes(
        r#""a": ReadMesh(path: "doll.obj"),"#,
        r#""m/a.ply": "a", "m/./a.ply": "a", "m//a.ply": "a""#,
        expect![[r#"
            4:17-28 G006 there is already an output `m/./a.ply`
            4:35-45 G006 there is already an output `m//a.ply`
        "#]],
    );
}

#[test]
fn parameters_and_expressions_are_checked() {
    check(
        r#"Graph(
    format: 1,
    params: {
        "growth": Number(default: 12.0, min: 0.0, max: 10.0),
        "steps": Integer(default: 1.5),
        "hue": Color(default: "red"),
        "side": Choice(default: Up, of: [Left, Right]),
        "size": Numbr(default: 1.0),
        "none": Toggle(),
        "levels": Integer(default: 13),
    },
    nodes: {
        "doll": ReadMesh(path: "doll.obj"),
        "soft": Subdivide(mesh: "doll", scheme: Loop, levels: Param("levels")),
        "moved": Transform(mesh: "doll", translate: (Expr("levels * "), Expr("lvels"), Param("level"))),
        "half": Subdivide(mesh: "doll", scheme: Loop, levels: Expr("levels / 2")),
    },
    outputs: { "soft.ply": "soft", "moved.ply": "moved", "half.ply": "half" },
)"#,
        expect![[r##"
            4:35-39 G010 parameter `growth` is 12, but must be at least 0 and at most 10
            5:35-38 G009 parameter `steps`: expected a number without fraction, found the number 1.5
            6:31-36 G009 parameter `hue`: expected a color as in "#c33923", found the text "red"
            7:33-35 G009 parameter `side`: expected one of Left, Right, found `Up`
            8:17-22 G009 unknown parameter type `Numbr` (did you mean `Number`?)
            9:17-25 G005 parameter `none` has no default (write `default: ..`)
            14:63-78 G010 field `levels` of Subdivide is 13, but must be at least 0 and at most 12 (8 levels make 65536 faces of one already)
            15:59-70 G011 the expression ends where a number or a name should be
            15:78-85 G011 the graph has no parameter `lvels` (did you mean `levels`?)
            15:94-101 G011 the graph has no parameter `level` (did you mean `levels`?)
            16:63-81 G009 field `levels` of Subdivide: expected a number without fraction, found the number 6.5
        "##]],
    );
}

#[test]
fn a_parameter_out_of_its_range_is_one_problem_wherever_it_is_used() {
    check(
        r#"Graph(
    format: 1,
    params: { "step": Number(default: 99.0, max: 40.0) },
    nodes: {
        "doll": ReadMesh(path: "doll.obj"),
        "moved": Transform(mesh: "doll", translate: (Param("step"), 0, 0)),
    },
    outputs: { "moved.ply": "moved" },
)"#,
        expect![[r#"
            3:39-43 G010 parameter `step` is 99, but must be at most 40
        "#]],
    );
}

#[test]
fn a_file_of_a_newer_format_is_not_judged() {
    check(
        "Graph(format: 99, meshes: {)",
        expect![[r#"
        1:15-17 G002 format 99 is unknown: this program reads format 1 (use a newer program, or an older version of the graph)
    "#]],
    );
}

#[test]
fn a_broken_text_says_where() {
    check(
        "Graph(format: 1, nodes: { \"a\": ReadMesh(path: \"x\" }, outputs: {})",
        expect![[r#"
            1:40-41 G001 this `(` is not closed before the `}` at 1:51 (add the missing `)`)
        "#]],
    );
    check(
        "Graph(format: 1, nodes: {}, outputs: {})\nGraph()",
        expect![[r#"
        2:1-8 G001 unexpected text after the end of the graph (a file contains a single `Graph(..)`)
    "#]],
    );
    check(
        "",
        expect![[r#"
        1:1-1 G001 the file is empty (a graph begins with `Graph(format: 1, ..)`)
    "#]],
    );
    check(
        "42",
        expect![[r#"
        1:1-3 G001 expected Graph(..), found the number 42 (begin with `Graph(format: 1, nodes: {..}, outputs: {..})`)
    "#]],
    );
    check(
        "Graph(format: 1, nodes: {\"a\": 5, b: ReadMesh(path: \"doll.obj\"), \"a\": {}}, outputs: [], extra: 1)",
        expect![[r#"
            1:31-32 G009 node `a` is the number 5, not a node (write `Type(field: value, ..)`)
            1:34-35 G006 the name of a node is a text in double quotes, not `b`
            1:65-68 G006 there is already a node `a` (give one of them another name)
            1:84-86 G009 field `outputs` of Graph: expected a map: {"name": .., ..}, found a list
            1:88-93 G004 Graph has no field `extra` (its fields: format, version, doc, packs, use, inputs, params, nodes, outputs, promises, expect)
        "#]],
    );
}

#[test]
fn what_is_wrong_in_a_circle_is_told_of_each_node_in_it() {
    check_nodes(
        r#""x": Triangulate(range: "y"),
"y": Triangulate(range: "x"),"#,
        r#""x.ply": "x""#,
        expect![[r#"
            2:1-4 G008 cycle: x <- y <- x (a node cannot need its own result: break one of these links)
            2:25-28 G012 port `range` of Triangulate wants a RangeImage, but `y` is a Mesh
            3:25-28 G012 port `range` of Triangulate wants a RangeImage, but `x` is a Mesh
        "#]],
    );
}

#[test]
fn choices_are_words_and_ranges_hold_something() {
    check(
        r#"Graph(format: 1, params: {
"a": Choice(default: "a", of: ["a", "b"]),
"b": Choice(default: "b", of: [a, b]),
"c": Choice(default: a),
"d": Choice(default: a, of: []),
"e": Number(default: 1, min: 40, max: 0),
}, nodes: {}, outputs: {})"#,
        expect![[r#"
            2:32-35 G009 a choice is a bare word, not the text "a" (write a without quotes)
            2:37-40 G009 a choice is a bare word, not the text "b" (write b without quotes)
            3:22-25 G009 parameter `b`: expected one of a, b, found the text "b" (write b without quotes)
            4:6-24 G005 parameter `c` has no choices (write `of: [Left, Right]`)
            5:29-31 G009 there is nothing to choose from
            6:6-41 G009 parameter `e` has a `min`, 40, above its `max`, 0 (swap them)
        "#]],
    );
}

#[test]
fn a_missing_comma_and_a_missing_choice_are_named() {
    check(
        "Graph(format: 1, nodes: {\"a\": ReadMesh(path: \"doll.obj\") \"b\": 1}, outputs: {})",
        expect![[r#"
            1:58-61 G001 missing comma before `"b"` (add a comma before it)
            1:63-64 G009 node `b` is the number 1, not a node (write `Type(field: value, ..)`)
        "#]],
    );
    // An unsupported space character between fields must not hide other errors. Errors that are only consequences of a missing comma must
    // not be reported.
    check(
        "Graph(format: 1, nodes: {\"b\"},\u{2003}outputs: {})",
        expect![[r#"
            1:26-29 G001 this key of a map has no value (write `key: value`)
            1:31-32 G001 unsupported space character (use a plain space instead)
        "#]],
    );
    check_nodes(
        r#""doll": ReadMesh(path: "doll.obj"), "soft": Subdivide(mesh: "doll"),"#,
        r#""soft.ply": "soft""#,
        expect![[r#"
            2:45-68 G005 Subdivide needs a field `scheme` (write `scheme: ..` with one of Loop, CatmullClark, DooSabin, Butterfly)
        "#]],
    );
}

#[test]
fn files_that_no_reader_takes_are_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["doll.fbx", "doll", "doll.OBJ", "doll.xyz"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    let path = folder.path().join("graph.ron");
    let text = r#"Graph(format: 1, nodes: {
"a": ReadMesh(path: "doll.fbx"),
"b": ReadMesh(path: "doll"),
"c": ReadMesh(path: "doll.OBJ"),
"d": ReadCapture(color: "doll", range: "doll.xyz"),
"e": ReadMesh(path: "no.fbx"),
}, outputs: {})"#;
    std::fs::write(&path, text).unwrap();
    expect![[r#"
        2:21-31 G009 ReadMesh cannot read `.fbx` files (supported extensions: obj, ply, stl, glb, gltf, 3mf)
        3:21-27 G009 `doll` has no extension that tells ReadMesh how to read it (supported extensions: obj, ply, stl, glb, gltf, 3mf)
        5:40-50 G009 ReadCapture cannot read `.xyz` files (supported extensions: pcd, ply, ptx, abs, png, tiff, tif, exr)
        6:21-29 G009 ReadMesh cannot read `.fbx` files (supported extensions: obj, ply, stl, glb, gltf, 3mf)
    "#]]
    .assert_eq(&problems(&path));
}

/// A third-party node that reads files with the extension `cloud`.
#[derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
struct ReadCloud {
    /// The file.
    #[schemars(extend("endings" = ["cloud"]))]
    path: maquette::FilePath,
}

impl maquette::Node for ReadCloud {
    type Outputs = (maquette::value::Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, _: &maquette::Context<'_>) -> Result<Self::Outputs, maquette::Error> {
        Ok((maquette::value::Mask::from_rows(&["#"]),))
    }
}

#[test]
fn the_node_of_a_strangers_pack_says_which_files_it_reads() {
    const PACK: maquette::Pack = maquette::Pack {
        name: "clouds",
        nodes: &[maquette::node::<ReadCloud>()],
        ..maquette::Pack::EMPTY
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    fn text(file: &str) -> String {
        format!("Graph(format: 1, nodes: {{\"a\": ReadCloud(path: \"{file}\")}}, outputs: {{}})")
    }
    for (file, expected) in [("a.cloud", 0), ("a.ply", 1)] {
        std::fs::write(folder.path().join(file), "").unwrap();
        std::fs::write(&path, text(file)).unwrap();
        let checked = Graph::load(&path, &Catalog::new(&[&PACK]), &Options::default());
        assert_eq!(checked.diagnostics.len(), expected, "{:?}", checked.diagnostics);
    }
}

/// Checking a file must take time proportional to its length. Each of these long files once took from 30 to 90 seconds.
#[test]
fn long_files_are_checked_in_seconds() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("doll.obj"), "").unwrap();
    let path = folder.path().join("graph.ron");
    fn graph(nodes: &str, outputs: &str) -> String {
        format!(
            "Graph(format: 1, nodes: {{\"m\": ReadMesh(path: \"doll.obj\"), {nodes}}}, outputs: {{{outputs}}})"
        )
    }
    fn repeat(count: usize, one: fn(usize) -> String) -> String {
        String::from_iter((0..count).map(one))
    }
    let links = repeat(10_000, |k| format!("\"n{k}\": Transform(mesh: \"n{k}x\"),"));
    let outputs = repeat(100_000, |k| format!("\"f{k}.ply\": \"m\","));
    let cases = repeat(100_000, |k| format!("\"c{k}\": \"m\","));
    let switch = format!("\"s\": Switch(cases: {{{cases}}}, choose: c99999),");
    let words = graph("", "") + &"stray ".repeat(200_000);
    let inside = graph(&format!("\"s\": [{}]", "stray ".repeat(200_000)), "");
    for (text, expected) in [
        (graph(&links, ""), 10_000),
        (graph("", &outputs), 0),
        (graph(&switch, "\"s.ply\": \"s\""), 0),
        (words, 1),
        (inside, 100_000),
    ] {
        std::fs::write(&path, text).unwrap();
        let start = std::time::Instant::now();
        let checked = Graph::load(&path, &Catalog::new(maquette_nodes::PACKS), &Options::default());
        assert_eq!(checked.diagnostics.len(), expected);
        let seconds = start.elapsed().as_secs_f64();
        assert!(seconds < 60.0, "{expected} problems took {seconds:.1} s");
    }
}

/// Checks that the graphs in `../shared/graphs/bad` cause the errors that the project's design lists for them. The test is skipped if that
/// folder does not exist.
#[test]
fn the_graphs_of_the_design_are_refused_as_it_says() {
    let Some(folder) = shared_folder("graphs/bad") else { return };
    let expected = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let expected: serde_json::Map<String, serde_json::Value> =
        serde_json::from_str(&expected).unwrap();
    let catalog = Catalog::new(maquette_nodes::PACKS);
    for (name, entries) in &expected {
        let path = folder.join(name);
        let checked = Graph::load(&path, &catalog, &Options::default());
        let entries = entries.as_array().unwrap();
        fn fits(entry: &serde_json::Value, problem: &Diagnostic) -> bool {
            let place = Position::from_offset(&problem.source.text, problem.span.start);
            let lines: Vec<u64> = match &entry["line"] {
                serde_json::Value::Array(lines) => {
                    lines.iter().filter_map(|line| line.as_u64()).collect()
                }
                line => vec![line.as_u64().unwrap()],
            };
            fn column(k: usize, entry: &serde_json::Value) -> usize {
                entry["column"][k].as_u64().unwrap() as usize
            }
            let words = entry["words"].as_array().unwrap();
            lines.contains(&(place.line as u64))
                && (column(0, entry)..column(1, entry)).contains(&place.column)
                && words.iter().all(|word| {
                    let word = word.as_str().unwrap();
                    problem.message.contains(word) || problem.help.contains(word)
                })
        }
        for entry in entries {
            let found = checked.diagnostics.iter().any(|problem| fits(entry, problem));
            assert!(found, "{name}: nothing fits {entry}\n{}", problems(&path));
        }
        if name != "syntax.ron" {
            assert_eq!(checked.diagnostics.len(), entries.len(), "{name}:\n{}", problems(&path));
        }
    }
    assert!(expected.len() >= 10, "only {} graphs were judged", expected.len());
}
