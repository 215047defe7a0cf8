//! Graphs that use other graphs: required versions, optional inputs, and lock files.

use std::path::PathBuf;

use maquette::value::Mesh;
use maquette::{Catalog, CheckedGraph, Graph, Options, Run, Session, Settings, Severity};

const BALL: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

/// Returns a graph `skirt` with this version. Other graphs use it.
fn skirt(version: &str, step: f64) -> String {
    format!(
        r#"// A skirt.
Graph(
    format: 1,
    {version}
    inputs: {{ "mesh": Mesh(doc: "A mesh."), "hem": Optional(Mesh(doc: "What hangs on it.")) }},
    nodes: {{
        "moved": Transform(mesh: "mesh", translate: ({step:?}, 0, 0)),
        "all": Merge(meshes: ["moved", "hem"]),
    }},
    outputs: {{ "mesh": "all" }},
)
"#
    )
}

/// Returns a graph that uses the graph `skirt`.
fn dress(of: &str, fields: &str) -> String {
    format!(
        r#"Graph(
    format: 1,
    use: {{ "Skirt": {of} }},
    nodes: {{
        "ball": ReadMesh(path: "ball.obj"),
        "skirt": Skirt(mesh: "ball"{fields}),
    }},
    outputs: {{ "skirt.ply": "skirt" }},
)
"#
    )
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new(files: &[(&str, &str)]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.put("ball.obj", BALL);
        files.iter().for_each(|(name, text)| folder.put(name, text));
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, text: &str) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        std::fs::write(self.path(name), text).unwrap();
    }

    fn load(&self, options: &Options) -> CheckedGraph {
        Graph::load(&self.path("dress.ron"), &catalog(), options)
    }

    fn messages(&self) -> Vec<String> {
        let problems = self.load(&Options::default()).diagnostics;
        problems.into_iter().map(|problem| problem.message).collect()
    }

    /// Runs a graph. Returns the number of vertices of its output.
    fn vertices(&self, name: &str, inputs: &[&str]) -> Result<usize, String> {
        let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory()).unwrap();
        let checked = session.load(&self.path(name), &Options::default());
        let graph = checked.graph.ok_or_else(|| format!("{:?}", checked.diagnostics))?;
        let files = inputs.iter().map(|name| ((*name).to_owned(), self.path("ball.obj")));
        let values = session.read_inputs(&graph, &Vec::from_iter(files)).unwrap().0;
        let done = session.run(&graph, &Run { inputs: values, ..Run::default() });
        let done = done.map_err(|problems| problems[0].message.clone())?;
        if let Some(problem) = done.diagnostics().first() {
            return Err(problem.message.clone());
        }
        let name = graph.output_names().next().unwrap_or("mesh").to_owned();
        Ok(done.get::<Mesh>(&name)?.positions().len())
    }
}

fn catalog() -> Catalog {
    Catalog::new(maquette_nodes::PACKS)
}

#[test]
fn a_version_that_is_wanted_is_the_least_of_its_major_number() {
    let folder = Folder::new(&[("skirt.ron", &skirt("version: \"2.1.0\",", 1.0))]);
    for (wanted, fits) in [
        ("2", true),
        ("2.1", true),
        ("2.1.0", true),
        ("2.0", true),
        ("2.2", false),
        ("2.1.1", false),
        ("1.9", false),
        ("3", false),
    ] {
        let of = format!("Graph(\"skirt.ron\", version: \"{wanted}\")");
        folder.put("dress.ron", &dress(&of, ""));
        let told = folder.messages();
        let expected = format!("`Skirt` wants version {wanted}, but skirt.ron is version 2.1.0");
        assert_eq!(told, if fits { vec![] } else { vec![expected] }, "{wanted}");
    }
}

#[test]
fn a_plain_path_and_a_graph_without_a_version_are_as_before() {
    for of in ["\"skirt.ron\"", "Graph(\"skirt.ron\")", "Graph(path: \"skirt.ron\")"] {
        for version in ["", "version: \"2.1.0\","] {
            let skirt = skirt(version, 1.0);
            let folder = Folder::new(&[("skirt.ron", &skirt), ("dress.ron", &dress(of, ""))]);
            assert_eq!(folder.vertices("dress.ron", &[]), Ok(4), "{of} {version}");
        }
    }
}

#[test]
fn an_optional_input_may_be_left_out_by_a_use_and_by_a_call() {
    let skirt = skirt("", 1.0);
    let folder = Folder::new(&[("skirt.ron", &skirt), ("dress.ron", &dress("\"skirt.ron\"", ""))]);
    assert_eq!(folder.vertices("dress.ron", &[]), Ok(4));
    folder.put("dress.ron", &dress("\"skirt.ron\"", ", hem: \"ball\""));
    assert_eq!(folder.vertices("dress.ron", &[]), Ok(8));
    // Run the used graph on its own, with values for its inputs.
    assert_eq!(folder.vertices("skirt.ron", &["mesh"]), Ok(4));
    assert_eq!(folder.vertices("skirt.ron", &["mesh", "hem"]), Ok(8));
    let why = folder.vertices("skirt.ron", &["hem"]).unwrap_err();
    assert!(why.contains("it is an input without a value"), "{why}");
}

#[test]
fn what_is_left_out_is_absent_at_an_optional_port_and_in_graphs_further_in() {
    let inner = r#"Graph(
    format: 1,
    inputs: { "picture": Image(doc: "A."), "within": Optional(Mask(doc: "B.")) },
    nodes: { "red": Threshold(image: "picture", within: "within", select: Otsu(channel: Luma)) },
    outputs: { "mask": "red" },
)"#;
    let outer = r#"Graph(
    format: 1,
    use: { "Inner": "inner.ron" },
    inputs: { "picture": Image(doc: "A."), "there": Optional(Mask(doc: "B.")) },
    nodes: { "it": Inner(picture: "picture", within: "there") },
    outputs: { "mask": "it" },
)"#;
    fn graph(fields: &str) -> String {
        format!(
            r#"Graph(
    format: 1,
    use: {{ "Outer": "outer.ron" }},
    nodes: {{
        "photo": ReadImage(path: "a.png"),
        "mask": Threshold(image: "photo", select: Otsu(channel: Luma)),
        "it": Outer(picture: "photo"{fields}),
    }},
    outputs: {{ "mask.png": "it" }},
)"#
        )
    }
    let folder = Folder::new(&[("inner.ron", inner), ("outer.ron", outer), ("a.png", "")]);
    fn hash_and_messages(fields: &str, folder: &Folder) -> (maquette::Hash, Vec<String>) {
        folder.put("dress.ron", &graph(fields));
        let checked = folder.load(&Options::default());
        let graph = checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics));
        (graph.identity(), graph.node_names().map(str::to_owned).collect::<Vec<_>>())
    }
    let (without, with) =
        (hash_and_messages("", &folder), hash_and_messages(", there: \"mask\"", &folder));
    assert_ne!(without.0, with.0);
    assert_eq!(without.1, with.1);
}

#[test]
fn an_optional_input_is_told_like_a_port_that_may_be_left_out() {
    let folder = Folder::new(&[("dress.ron", &skirt("version: \"1.0.0\",", 1.0))]);
    let graph = folder.load(&Options::default()).graph.unwrap();
    let told: Vec<_> = graph.inputs().iter().map(|it| (&it.name[..], it.optional)).collect();
    assert_eq!(told, [("mesh", false), ("hem", true)]);
    assert_eq!(graph.schema()["required"], serde_json::json!(["mesh"]));
}

/// Writes a lock file that contains the one used graph, as `maquette lock` does.
fn lock(folder: &Folder) {
    let text = std::fs::read_to_string(folder.path("skirt.ron")).unwrap();
    let hash = maquette::Hash::compute(text.as_bytes());
    folder.put(
        "dress.lock.ron",
        &format!(
            "Lock(format: 1, files: {{\"skirt.ron\": (version: \"1.0.0\", hash: \"{hash}\")}}, texts: {{\"{hash}\": r#\"{text}\"#}})"
        ),
    );
}

#[test]
fn a_lock_that_does_not_fit_is_a_warning_and_refused_where_it_must_fit() {
    let skirt_1 = skirt("version: \"1.0.0\",", 1.0);
    let folder =
        Folder::new(&[("skirt.ron", &skirt_1), ("dress.ron", &dress("\"skirt.ron\"", ""))]);
    let locked = Options { locked: true, ..Options::default() };
    let none = folder.load(&locked);
    assert!(none.graph.is_none());
    assert!(
        none.diagnostics[0].message.starts_with("there is no lock file"),
        "{:?}",
        none.diagnostics
    );
    lock(&folder);
    let fits = folder.load(&locked);
    assert!(fits.graph.is_some() && fits.diagnostics.is_empty(), "{:?}", fits.diagnostics);
    // A change of the line endings alone does not count as a change.
    folder.put("skirt.ron", &skirt_1.replace('\n', "\r\n"));
    assert_eq!(folder.load(&locked).diagnostics, []);
    for (text, how) in [
        (
            skirt("version: \"1.1.0\",", 2.0),
            "version: 1.0.0 -> 1.1.0; node moved: changed translate.0: 1 -> 2",
        ),
        (skirt_1.replace("A skirt.", "A long skirt."), "comments or spaces differ"),
    ] {
        folder.put("skirt.ron", &text);
        for (options, severity) in
            [(&Options::default(), Severity::Warning), (&locked, Severity::Error)]
        {
            let checked = folder.load(options);
            assert_eq!(checked.graph.is_some(), severity == Severity::Warning);
            let [problem] = &checked.diagnostics[..] else { panic!("{:?}", checked.diagnostics) };
            let expected = format!("`skirt.ron` differs from dress.lock.ron: {how}");
            assert_eq!((problem.severity, &problem.message), (severity, &expected));
            // The diagnostic must point at the path of the used graph, in the entry of `use`.
            let text = &problem.source.text;
            assert_eq!(&text[problem.span.start..problem.span.end], "\"skirt.ron\"");
        }
    }
}

#[test]
fn a_lock_has_all_that_is_used_and_nothing_else() {
    let skirt = skirt("version: \"1.0.0\",", 1.0);
    let other = dress("\"other.ron\"", "");
    let folder = Folder::new(&[
        ("skirt.ron", &skirt),
        ("other.ron", &skirt),
        ("dress.ron", &dress("\"skirt.ron\"", "")),
    ]);
    lock(&folder);
    folder.put("dress.ron", &other);
    assert_eq!(
        folder.messages(),
        [
            "`other.ron` is not in dress.lock.ron",
            "`skirt.ron` is in dress.lock.ron, but nothing uses it"
        ]
    );
    let damaged = std::fs::read_to_string(folder.path("dress.lock.ron")).unwrap();
    folder.put("dress.lock.ron", &damaged.replace("A skirt.", "No skirt."));
    assert_eq!(folder.messages(), ["the text of `skirt.ron` does not match its hash"]);
}

/// Compares two checkouts of a project that have different library graphs.
#[test]
fn a_difference_inside_of_a_used_graph_is_told_with_the_way_there() {
    let dress = dress("Graph(\"lib/skirt.ron\", version: \"1.0\")", "");
    fn files(step: f64, dress: &str) -> Folder {
        let skirt = skirt("version: \"1.0.0\",", step);
        Folder::new(&[("lib/skirt.ron", &skirt), ("dress.ron", dress)])
    }
    let (first, second) = (files(1.0, &dress), files(2.5, &dress));
    fn source(folder: &Folder) -> maquette::Source {
        let name = folder.path("dress.ron");
        maquette::Source { text: std::fs::read_to_string(&name).unwrap(), name }
    }
    let (old, new) = (source(&first), source(&second));
    assert_eq!(Graph::differences(&old, &new, &catalog()), Ok(vec![]));
    let told = Graph::differences_with_uses(&old, &new, &catalog()).unwrap();
    let told: Vec<_> = told.iter().map(ToString::to_string).collect();
    assert_eq!(told, ["in Skirt: node moved: changed translate.0: 1 -> 2.5"]);
    assert_eq!(Graph::differences_with_uses(&old, &old, &catalog()), Ok(vec![]));
}
