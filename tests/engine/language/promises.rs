//! Properties of values, such as `Closed`. Ports can require them (`wants`), and outputs can guarantee them (`promises`). A required
//! property that is not guaranteed is tested before the node runs.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use maquette::value::{Parts, Property, Violation};
use maquette::{
    Catalog, Context, DecodeError, Decoder, Diagnostic, Encoder, Error, Evaluator, Graph, In, Node,
    Options, Pack, Position, Promise, Session, Settings, Summary, Value, Want, node, value_type,
};
use maquette_nodes::PACKS;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A folder with meshes and graphs. Checking or running its graph returns the messages.
struct PromiseProject {
    folder: tempfile::TempDir,
}

impl PromiseProject {
    fn new(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        // The meshes are a square, a fan of three triangles around one edge, and a tetrahedron without its last face.
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
        let fan = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 2 1 4\nf 1 2 5\n";
        let open = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n";
        let meshes = [("square.obj", square), ("fan.obj", fan), ("open.obj", open)];
        for (name, text) in meshes.iter().chain(files) {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn load(&self) -> Graph {
        let catalog = Catalog::new(PACKS);
        let checked = Graph::load(&self.path("graph.ron"), &catalog, &Options::default());
        checked.graph.unwrap_or_else(|| panic!("{:#?}", checked.diagnostics))
    }

    fn line(&self, problem: &Diagnostic) -> String {
        let place = Position::from_offset(&problem.source.text, problem.span.start).line;
        let file = problem.source.name.file_name().unwrap().to_string_lossy();
        let help = problem.help.replace(&format!("{}/", self.folder.path().display()), "");
        format!("{file}:{place} {} {} ({help})", problem.code, problem.message)
    }

    fn check_messages(&self) -> Vec<String> {
        self.load().unused_warnings().iter().map(|problem| self.line(problem)).collect()
    }

    fn run(&self) -> Vec<String> {
        let settings = Settings { threads: 2, ..Settings::in_memory() };
        let mut session = Session::new(PACKS, &settings).unwrap();
        let finished = session.run(&self.load(), &Default::default()).unwrap();
        finished.diagnostics().iter().map(|problem| self.line(problem)).collect()
    }
}

/// Returns a graph with these nodes, which writes the output of the node `out`.
fn graph(nodes: &str) -> String {
    format!(
        "Graph(format: 1, use: {{ \"Lib\": \"lib.ron\" }}, nodes: {{\n{nodes}\n}}, outputs: {{ \"out.ply\": \"out\" }})"
    )
}

/// A graph that requires a property of its input and guarantees properties of its outputs.
const LIB: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "It.", wants: [Closed]) },
    nodes: { "it": Transform(mesh: "mesh", translate: (1, 0, 0)) },
    outputs: { "moved": "it" },
    promises: { "moved": [Closed, Triangles] },
)"#;

#[test]
fn a_node_is_not_run_on_what_it_does_not_want_and_the_elements_are_named() {
    let nodes = r#""fan": ReadMesh(path: "fan.obj"),
"out": Subdivide(mesh: "fan", scheme: CatmullClark)"#;
    let told = PromiseProject::new(&[("graph.ron", &graph(nodes)), ("lib.ron", LIB)]).run();
    let expected = "graph.ron:3 G016 `out` cannot be computed: port `mesh` wants Mesh[Manifold], but `fan` has 1 edges with more than two \
                    faces (edge 0-1; the first is at (0.5, 0, 0)) (`maquette inspect graph.ron fan --out look.png` lists and marks \
                    them)";
    assert_eq!(told, [expected]);
    let split = nodes.replace("CatmullClark", "CatmullClark, split: true");
    assert_eq!(
        PromiseProject::new(&[("graph.ron", &graph(&split)), ("lib.ron", LIB)]).run(),
        [""; 0]
    );
}

#[test]
fn an_input_says_what_it_wants_and_an_output_what_it_promises() {
    let nodes = r#""mesh": ReadMesh(path: "open.obj"), "out": Lib(mesh: "mesh")"#;
    let told = PromiseProject::new(&[("graph.ron", &graph(nodes)), ("lib.ron", LIB)]);
    let expected = "graph.ron:2 G016 input `mesh` of `out` wants Mesh[Closed], but `mesh` has 3 edges with one face (edge 0-2, \
                    edge 0-3, edge 2-3; the first is at (0, 0.5, 0)) (this is required at lib.ron:3:48; \
                    `maquette inspect graph.ron mesh --out look.png` lists and marks them)";
    assert_eq!(told.run(), [expected]);
    // Without the requirement of a closed input, the promise of a closed output does not follow from the nodes of the used graph. So the
    // output is tested wherever the graph is used.
    let careless = LIB.replace(", wants: [Closed]", "");
    std::fs::write(told.path("lib.ron"), careless).unwrap();
    let expected = "graph.ron:2 G020 expected Closed, but `out.moved` has 3 edges with one face (edge 0-2, edge 0-3, edge 2-3; the first \
                    is at (1, 0.5, 0)) (this is expected at lib.ron:6:27)";
    assert_eq!(told.run(), [expected]);
}

#[test]
fn an_input_that_several_nodes_take_is_told_once_at_the_use_that_gives_it() {
    let lib = LIB.replace("\"it\":", "\"other\": Transform(mesh: \"mesh\"), \"it\":");
    let lib = lib.replace("\"moved\": \"it\"", "\"moved\": \"it\", \"other\": \"other\"");
    let outer = r#"Graph(
    format: 1,
    use: { "Lib": "lib.ron" },
    inputs: { "mesh": Mesh(doc: "It.") },
    nodes: { "inner": Lib(mesh: "mesh"), "all": Merge(meshes: ["inner.moved", "inner.other"]) },
    outputs: { "all": "all" },
)"#;
    let nodes = r#""mesh": ReadMesh(path: "open.obj"), "out": Outer(mesh: "mesh")"#;
    let text = graph(nodes).replace("\"lib.ron\"", "\"lib.ron\", \"Outer\": \"outer.ron\"");
    let told =
        PromiseProject::new(&[("graph.ron", &text), ("lib.ron", &lib), ("outer.ron", outer)]);
    let settings = Settings { threads: 2, ..Settings::in_memory() };
    let mut session = Session::new(PACKS, &settings).unwrap();
    let finished = session.run(&told.load(), &Default::default()).unwrap();
    let [problem] = &finished.diagnostics()[..] else { panic!("{:#?}", finished.diagnostics()) };
    let line = told.line(problem);
    assert!(
        line.starts_with("outer.ron:5 G016 input `mesh` of `out/inner` wants Mesh[Closed]"),
        "{line}"
    );
    assert_eq!(problem.uses.iter().map(|it| &it.name[..]).collect::<Vec<_>>(), ["out"]);
    // The diagnostic also contains the violating elements (such as edges) as data.
    let expected = [
        ("edge 0-2".to_owned(), [0.0, 0.5, 0.0]),
        ("edge 0-3".to_owned(), [0.0, 0.0, 0.5]),
        ("edge 2-3".to_owned(), [0.0, 0.5, 0.5]),
    ];
    assert_eq!(problem.elements, expected);
    // No node of the used graph has run.
    let trace = finished.trace();
    let ran = trace.0.iter().filter(|node| node.seconds > 0.0 && node.name.contains('/'));
    assert_eq!(ran.map(|node| &node.name).collect::<Vec<_>>(), [""; 0]);
}

#[test]
fn what_is_wanted_and_never_given_is_warned_of_once_before_anything_runs() {
    let nodes = r#""mesh": ReadMesh(path: "square.obj"), "quads": Subdivide(mesh: "mesh", scheme: CatmullClark),
"moved": Transform(mesh: "quads"), "good": Subdivide(mesh: "mesh", scheme: CatmullClark),
"out": Subdivide(mesh: "quads", scheme: Loop), "unknown": Subdivide(mesh: "mesh", scheme: Loop)"#;
    let text = graph(nodes).replace(
        "\"out\" }",
        "\"out\", \"a.ply\": \"moved\", \"b.ply\": \"good\", \"c.ply\": \"unknown\" }",
    );
    let told = PromiseProject::new(&[("graph.ron", &text), ("lib.ron", LIB)]).check_messages();
    let help = "(the command `nodes Subdivide` shows what it promises for which parameters)";
    let expected = "graph.ron:4 G012 port `mesh` of `out` wants Mesh[Triangles], but `quads` never guarantees that";
    assert_eq!(told, [format!("{expected} {help}")]);
}

#[test]
fn a_promise_that_cannot_be_kept_is_warned_of() {
    let lib = LIB.replace(
        "Transform(mesh: \"mesh\", translate: (1, 0, 0))",
        "Subdivide(mesh: \"mesh\", scheme: CatmullClark)",
    );
    let nodes = r#""mesh": ReadMesh(path: "open.obj"), "out": Lib(mesh: "mesh")"#;
    let told =
        PromiseProject::new(&[("graph.ron", &graph(nodes)), ("lib.ron", &lib)]).check_messages();
    let expected = "graph.ron:2 G020 `out.moved` is promised to be Triangles, but the node that computes it never guarantees that (this is expected at lib.ron:6:35)";
    assert_eq!(told, [expected]);
}

#[test]
fn no_graph_that_is_shipped_gets_a_warning() {
    let catalog = Catalog::new(PACKS);
    for folder in ["graphs", "graphs/nodes", "graphs/checks", "graphs/lib"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
        for file in std::fs::read_dir(folder).unwrap() {
            let path = file.unwrap().path();
            if !path.to_string_lossy().ends_with(".ron")
                || path.to_string_lossy().ends_with(".test.ron")
            {
                continue;
            }
            let graph = Graph::load(&path, &catalog, &Options::default()).graph;
            let told = graph.iter().flat_map(|graph| graph.unused_warnings());
            let told =
                told.filter(|problem| problem.code != maquette::code::UNUSED).collect::<Vec<_>>();
            assert!(told.is_empty(), "{}: {told:#?}", path.display());
        }
    }
}

#[test]
fn nodes_say_what_they_want_and_promise() {
    let catalog = Catalog::new(PACKS).to_json();
    let nodes = catalog["nodes"].as_array().unwrap();
    let node = nodes.iter().find(|node| node["name"] == "Subdivide").unwrap();
    assert!(
        node["inputs"][0]["wants"].to_string().contains("Triangles, with the scheme `Loop`"),
        "{node}"
    );
    assert!(
        node["outputs"][0]["promises"].to_string().contains("Closed as `mesh`, unless `split`"),
        "{node}"
    );
    let values = catalog["values"].as_array().unwrap();
    let labels = values.iter().find(|value| value["name"] == "Labels").unwrap();
    assert_eq!(labels["properties"][0]["name"], "NonEmpty");
}

/// A third-party value type: beads, which may be on a string or not.
#[derive(Clone)]
struct Beads {
    count: u8,
    strung: bool,
}

/// The number of tests of the property `Strung`.
static TESTS: AtomicUsize = AtomicUsize::new(0);

impl Value for Beads {
    const NAME: &'static str = "Beads";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&[self.count, u8::from(self.strung)]);
    }

    fn decode(_: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Err(DecodeError)
    }

    fn size(&self) -> usize {
        2
    }

    fn describe(&self) -> Summary {
        Summary::default().with_fact("beads", self.count)
    }

    fn parts(&self) -> Parts<'_> {
        Parts::default()
    }

    fn properties() -> &'static [Property<Self>] {
        const PROPERTIES: &[Property<Beads>] =
            &[Property::new("Strung", "They are on a string.", |beads| {
                TESTS.fetch_add(1, Ordering::Relaxed);
                (!beads.strung).then(|| Violation::lack_of("string"))
            })];
        PROPERTIES
    }
}

/// Makes beads, which are strung if requested.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Bead {
    /// The number of beads.
    count: u8,
    /// True if the beads are strung.
    strung: bool,
    /// True if the output promises that the beads are strung.
    sure: bool,
}

impl Node for Bead {
    type Outputs = (Beads,);
    const OUTPUTS: [&'static str; 1] = ["beads"];
    const PROMISES: &'static [Promise<Self>] =
        &[Promise::always("beads", "Strung").only_if("if it is `sure`", |it| it.sure)];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((Beads { count: self.count, strung: self.strung },))
    }
}

/// Passes on beads that must be strung.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Wear {
    /// The beads.
    beads: In<Beads>,
    /// A number that gives each node its own key.
    who: u8,
}

impl Node for Wear {
    type Outputs = (Beads,);
    const OUTPUTS: [&'static str; 1] = ["beads"];
    const WANTS: &'static [Want<Self>] = &[Want::new("beads", "Strung")];
    const PROMISES: &'static [Promise<Self>] = &[Promise::from("beads", "Strung", "beads")];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((cx.get(&self.beads).clone(),))
    }
}

const BEADS: Pack = Pack {
    name: "beads",
    nodes: &[node::<Bead>(), node::<Wear>()],
    values: &[value_type::<Beads>()],
    ..Pack::EMPTY
};

#[test]
fn what_is_promised_is_not_tested_and_the_rest_once_per_value() {
    let catalog = Catalog::new(&[&BEADS]);
    let mut evaluator = Evaluator::new(2, 1 << 20).unwrap();
    fn run(nodes: &str, catalog: &Catalog, evaluator: &mut Evaluator) -> (usize, Vec<String>) {
        let text = format!("Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{}})");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("graph.ron");
        let checked = Graph::load_text(&path, text, catalog, &Options::default());
        let graph = checked.graph.unwrap_or_else(|| panic!("{:#?}", checked.diagnostics));
        TESTS.store(0, Ordering::Relaxed);
        let evaluation = evaluator.evaluate_all_nodes(&graph, &(), &Default::default());
        let told = evaluation.diagnostics().into_iter().map(|problem| problem.message);
        (TESTS.load(Ordering::Relaxed), Vec::from_iter(told))
    }
    fn bead(count: u8, sure: bool) -> String {
        format!("\"bead\": Bead(count: {count}, strung: true, sure: {sure}),")
    }
    let chain = r#""a": Wear(beads: "bead", who: 1), "b": Wear(beads: "a", who: 2)"#;
    assert_eq!(run(&format!("{}{chain}", bead(1, true)), &catalog, &mut evaluator), (0, vec![]));
    // The output of `a` is strung if its input is, and that has just been tested. So the input of `b` need not be tested.
    assert_eq!(run(&format!("{}{chain}", bead(2, false)), &catalog, &mut evaluator), (1, vec![]));
    assert_eq!(
        run(
            &format!("{}{chain}", bead(2, false)).replace("who: 1", "who: 3"),
            &catalog,
            &mut evaluator
        ),
        (0, vec![])
    );
    let loose = format!("{}{chain}", bead(3, false)).replace("strung: true", "strung: false");
    let (tests, told) = run(&loose, &catalog, &mut evaluator);
    assert_eq!(tests, 1);
    assert_eq!(
        told,
        ["`a` cannot be computed: port `beads` wants Beads[Strung], but `bead` has no string"]
    );
}

#[test]
fn a_promise_that_cannot_be_kept_is_told_once_for_each_use() {
    let fine = r#"Graph(format: 1, inputs: { "mesh": Mesh() },
        nodes: { "it": Subdivide(mesh: "mesh", scheme: CatmullClark) },
        outputs: { "fine": "it" }, promises: { "fine": [Triangles] })"#;
    // This graph uses the graph above and makes the same promise.
    let library = r#"Graph(format: 1, use: { "Fine": "fine.ron" }, inputs: { "mesh": Mesh() },
        nodes: { "in": Fine(mesh: "mesh") }, outputs: { "fine": "in" }, promises: { "fine": [Triangles] })"#;
    let nodes = r#""square": ReadMesh(path: "square.obj"),
        "one": Lib(mesh: "square"),
        "all": ForEach(graph: "Lib", over: [(mesh: "square"), (mesh: "one")]),
        "out": Merge(meshes: "all"),"#;
    let told = PromiseProject::new(&[
        ("fine.ron", fine),
        ("lib.ron", library),
        ("graph.ron", &graph(nodes)),
    ]);
    let found = told.check_messages();
    assert_eq!(
        found,
        [
            "graph.ron:3 G020 `one/in.fine` is promised to be Triangles, but the node that computes it never guarantees that (this is expected at fine.ron:3:57)",
            "graph.ron:4 G020 `all/1/in.fine` is promised to be Triangles, but the node that computes it never guarantees that (this is expected at fine.ron:3:57)",
        ]
    );
    let found = told.run();
    assert_eq!(found.len(), 3, "one for each value: {found:#?}");
}
