//! Graphs that were written for an older version of a pack, or for a pack that is not installed. Nodes and fields that have been renamed
//! keep their meaning, and nodes of unknown types stay in the text.

use std::fmt::Write as _;
use std::path::Path;

use expect_test::{expect, expect_file};
use maquette::{
    Catalog, Edit, Files, Graph, Migration, NewValue, Options, OutputFolder, Pack, Session,
    Settings, Severity,
};

use crate::ron_files::ron_files;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

fn catalog() -> Catalog {
    Catalog::new(&[maquette_nodes::PACKS, &[&maquette_third_party::PACK]].concat())
}

fn ignoring_files() -> Options {
    Options { files: Files::Ignored, ..Options::default() }
}

fn load(text: &str, catalog: &Catalog) -> maquette::CheckedGraph {
    Graph::load_text("graph.ron".as_ref(), text.into(), catalog, &ignoring_files())
}

/// A graph that was written for the first version of the test pack.
const OLD: &str = r#"// A poster.
Graph(
    format: 1,
    params: { "most": Integer(default: 6, min: 1, max: 9, doc: "How many colors.") },
    nodes: {
        "photo": ReadImage(path: "color.png"),
        "palette": ExtractPalette(image: "photo", /* a few */ colors: Param("most")), // enough
        "poster":   PaintPalette(
            image: "photo",
            palette: "palette",
        ),
        "more": ForEach(graph: "PaintPalette", over: [(image: "photo")], with: (palette: "palette")),
        "less": ForEach(graph: "ExtractPalette", over: [(colors: 2), (colors: 3)], links: (image: "photo")),
    },
    outputs: { "poster.png": "poster", "two.gpl": "less/1" },
)
"#;

fn new_text() -> String {
    OLD.replace("colors: Param", "count: Param")
        .replace("PaintPalette", "Posterize")
        .replace("(colors: ", "(count: ")
}

#[test]
fn a_graph_with_old_names_means_the_same_and_is_warned_of() {
    let (old, new) = (load(OLD, &catalog()), load(&new_text(), &catalog()));
    assert_eq!(new.diagnostics, []);
    assert_eq!(old.graph.unwrap().identity(), new.graph.unwrap().identity());
    let told = old.diagnostics.iter().map(|problem| {
        assert_eq!((problem.severity, problem.code), (Severity::Warning, "G032"));
        let at = &problem.source.text[problem.span.start..problem.span.end];
        format!("{at}: {} ({})\n", problem.message, problem.help)
    });
    expect![[r#"
        colors: field `colors` of ExtractPalette is called `count` now (run `maquette edit GRAPH migrate --write` to write the new name into the file)
        PaintPalette: the node type `PaintPalette` is called `Posterize` now (run `maquette edit GRAPH migrate --write` to write the new name into the file)
        "PaintPalette": the node type `PaintPalette` is called `Posterize` now (run `maquette edit GRAPH migrate --write` to write the new name into the file)
        colors: field `colors` of ExtractPalette is called `count` now (run `maquette edit GRAPH migrate --write` to write the new name into the file)
        colors: field `colors` of ExtractPalette is called `count` now (run `maquette edit GRAPH migrate --write` to write the new name into the file)
    "#]]
    .assert_eq(&String::from_iter(told));
}

#[test]
fn a_migrated_text_has_every_other_byte_as_it_was() {
    let migrated = Graph::migrate("graph.ron".as_ref(), OLD, &catalog()).unwrap();
    assert_eq!(migrated, new_text());
    assert_eq!(Graph::migrate("graph.ron".as_ref(), &migrated, &catalog()).unwrap(), migrated);
}

/// A pack whose migrations rename built-in nodes and their fields. Some are renamed twice.
pub(super) const OLD_NAMES: Pack = Pack {
    name: "old",
    migrations: &[
        Migration::Node { old: "Grid", new: "Mesher" },
        Migration::Node { old: "Mesher", new: "Triangulate" },
        Migration::Field { node: "Grid", old: "gap", new: "step", value: NewValue::Times(10.0) },
        Migration::Field { node: "Mesher", old: "step", new: "jump", value: NewValue::Same },
        Migration::Node { old: "Find", new: "Threshold" },
        Migration::Field {
            node: "Find",
            old: "how",
            new: "select",
            value: NewValue::Words(&[("Close", "Near")]),
        },
        Migration::Field {
            node: "Subdivide",
            old: "scheme",
            new: "scheme",
            value: NewValue::Words(&[("Triangles", "Loop")]),
        },
    ],
    ..Pack::EMPTY
};

/// Each node of the old pack with its former names and its present name, for tests.
const NODES: [[&str; 2]; 9] = [
    [r#""scan": ReadCapture(color: "a.png", range: "a.pcd")"#; 2],
    [
        r#""one": Grid(range: "scan.range", gap: 0.6)"#,
        r#""one": Triangulate(range: "scan.range", jump: 6.0)"#,
    ],
    [
        r#""two": Mesher(range: "scan.range", step: 7.5)"#,
        r#""two": Triangulate(range: "scan.range", jump: 7.5)"#,
    ],
    [
        r#""three": Grid(range: "scan.range", gap: Param("cm"))"#,
        r#""three": Triangulate(range: "scan.range", jump: Expr("cm * 10"))"#,
    ],
    [
        r#""four": Grid(range: "scan.range", gap: Expr("cm / 2"))"#,
        r#""four": Triangulate(range: "scan.range", jump: Expr("(cm / 2) * 10"))"#,
    ],
    [
        r#""five": Grid(range: "scan.range", gap: Draft(final: 0.6, draft: 0.9))"#,
        r#""five": Triangulate(range: "scan.range", jump: Draft(final: 6.0, draft: 9.0))"#,
    ],
    [
        r##""red": Find(image: "scan.color", how: Close(color: "#c33923", distance: 3.0))"##,
        r##""red": Threshold(image: "scan.color", select: Near(color: "#c33923", distance: 3.0))"##,
    ],
    [
        r#""skin": Subdivide(mesh: "one", scheme: Triangles, levels: 1)"#,
        r#""skin": Subdivide(mesh: "one", scheme: Loop, levels: 1)"#,
    ],
    [r#""loop": Subdivide(mesh: "one", scheme: Loop, levels: 1)"#; 2],
];

/// Returns a graph that contains all nodes in `NODES`, with their present names if `now` is true, otherwise with their former names.
pub(super) fn graph_of_nodes(now: bool) -> String {
    let nodes = NODES.iter().map(|node| node[usize::from(now)]).collect::<Vec<_>>().join(",\n    ");
    format!(
        "Graph(format: 1, params: {{\"cm\": Number(default: 0.7, doc: \"A.\")}}, nodes: {{\n    {nodes},\n}}, outputs: {{}})"
    )
}

#[test]
fn names_units_words_and_places_change_over_several_versions() {
    let catalog = Catalog::new(&[maquette_nodes::PACKS, &[&OLD_NAMES]].concat());
    let (old, new) = (graph_of_nodes(false), graph_of_nodes(true));
    assert_eq!(Graph::migrate("graph.ron".as_ref(), &old, &catalog).unwrap(), new);
    fn identity(text: &str, catalog: &Catalog) -> maquette::Hash {
        let checked = load(text, catalog);
        checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics)).identity()
    }
    assert_eq!(identity(&old, &catalog), identity(&new, &catalog));
}

#[test]
fn names_that_go_in_a_circle_come_to_an_end() {
    const PACK: Pack = Pack {
        name: "circle",
        migrations: &[
            Migration::Node { old: "A", new: "B" },
            Migration::Node { old: "B", new: "A" },
            Migration::Field { node: "Label", old: "a", new: "b", value: NewValue::Same },
            Migration::Field { node: "Label", old: "b", new: "a", value: NewValue::Same },
        ],
        ..Pack::EMPTY
    };
    let catalog = Catalog::new(&[maquette_nodes::PACKS, &[&PACK]].concat());
    let text = "Graph(format: 1, nodes: {\"x\": A(), \"y\": Label(a: 1)}, outputs: {})";
    assert!(load(text, &catalog).graph.is_none());
    let _ = Graph::migrate("graph.ron".as_ref(), text, &catalog);
}

/// Checks that the graphs of each release still have the identity that was recorded for them.
#[test]
fn every_graph_of_every_release_is_read_and_means_what_it_meant() {
    let releases = std::fs::read_dir(Path::new(ROOT).join("tests/released")).unwrap();
    let mut count = 0;
    for release in releases.map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()) {
        let paths = ron_files(&release);
        let mut told = String::new();
        for path in &paths {
            let checked = Graph::load(path, &catalog(), &ignoring_files());
            let Some(graph) = checked.graph else {
                panic!("{}: {:?}", path.display(), checked.diagnostics)
            };
            let name = path.strip_prefix(&release).unwrap().to_string_lossy().replace('\\', "/");
            let _ = writeln!(told, "{} {name}", graph.identity());
            count += 1;
        }
        expect_file![release.join("identities.txt")].assert_eq(&told);
    }
    assert!(count >= 90, "only {count} graphs");
}

const FOREIGN: &str = r#"// Half of it needs a pack.
Graph(
    format: 1,
    packs: { "hair": "0.3" },
    nodes: {
        "ball": ReadMesh(path: "ball.obj"),
        "strands": HairStrands(on: "ball",  count: 9000), // many
        "combed": Transform(mesh: "strands.mesh", scale: (2.0, 2.0, 2.0)),
        "big": Transform(mesh: "ball", scale: (2.0, 2.0, 2.0)),
    },
    outputs: { "hair.obj": "combed", "raw.ply": "strands", "big.ply": "big" },
)
"#;

#[test]
fn the_rest_of_a_graph_with_an_unknown_node_is_made_and_the_pack_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, FOREIGN).unwrap();
    std::fs::copy(format!("{ROOT}/tests/bad/ball.obj"), folder.path().join("ball.obj")).unwrap();
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory()).unwrap();
    let checked = session.load(&path, &Options::default());
    assert!(checked.graph.is_none());
    let [problem] = &checked.diagnostics[..] else { panic!("{:?}", checked.diagnostics) };
    assert_eq!((problem.code, problem.severity), ("G003", Severity::Error));
    assert_eq!(problem.message, "there is no node type `HairStrands`");
    let help = "it may be of the pack `hair` 0.3, which this program does not have";
    assert_eq!(problem.help, help);
    let graph = checked.partial.unwrap();
    let out = folder.path().join("out");
    let into = OutputFolder::new(Some(&out), &path);
    let produced = session.produce(&graph, &[], &into, &(), &Default::default()).unwrap();
    // The run must not repeat the diagnostics that the check has reported.
    assert_eq!(produced.diagnostics, []);
    let written: Vec<_> = produced.written.iter().map(|file| &file.output[..]).collect();
    assert_eq!(written, ["big.ply"]);
    let states = produced.trace();
    fn state(name: &str, states_0: &[maquette::NodeTrace]) -> maquette::State {
        states_0.iter().find(|node| node.name == name).unwrap().state
    }
    assert_eq!(state("combed", &states.0), maquette::State::Skipped);
    assert_eq!(state("big", &states.0), maquette::State::Computed);
}

#[test]
fn an_unknown_node_loses_nothing_to_fmt_and_edits() {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let edits = [
        Edit::Set { target: "big.scale".into(), value: "(3.0, 3.0, 3.0)".into() },
        Edit::Set { target: "strands.count".into(), value: "10".into() },
        Edit::Rename { from: "ball".into(), to: "globe".into() },
    ];
    let edited =
        maquette::edit::edit("graph.ron".as_ref(), FOREIGN, &edits, &catalog, &ignoring_files())
            .unwrap();
    let expected = FOREIGN
        .replace(
            "\"big\": Transform(mesh: \"ball\", scale: (2.0, 2.0, 2.0)",
            "\"big\": Transform(mesh: \"ball\", scale: (3.0, 3.0, 3.0)",
        )
        .replace("9000", "10")
        .replace("\"ball\"", "\"globe\"");
    assert_eq!(edited.text, expected);
    let form = maquette::edit::format_text("graph.ron".as_ref(), FOREIGN).unwrap();
    assert!(form.contains("HairStrands(on: \"ball\", count: 9000), // many"), "{form}");
}
