//! Names with hyphens. Where a graph is used, the corresponding fields have underscores instead.

use maquette::value::Mesh;
use maquette::{Catalog, Diagnostic, Edit, Graph, Options, Run, Session, Settings};

const UP: &str = r#"Graph(
    format: 1,
    inputs: { "the-mesh": Mesh(doc: ""), "other-one": Optional(Mesh(doc: "")) },
    params: { "eye-step": Number(default: 1.0, doc: ""), "side": Number(default: 0.0, doc: "") },
    nodes: {
        "moved": Transform(mesh: "the-mesh", translate: (Param("side"), Param("eye-step"), 0)),
        "both": Merge(meshes: ["moved", "other-one"]),
    },
    outputs: { "the-mesh": "both" },
)"#;

const USING: &str = r#"Graph(
    format: 1,
    use: { "Up": "up.ron" },
    params: { "eye-step": Number(default: 2.0, doc: "") },
    nodes: {
        "m": ReadMesh(path: "a.obj"),
        "up": Up(the_mesh: "m", other_one: "m", eye_step: Param("eye-step")),
        "listed": ForEach(graph: "Up", over: [(side: 1.0), (eye_step: 2.0)], carry: (the_mesh: "up")),
        "counted": ForEach(graph: "Up", over: 3, number: "eye-step", carry: (the_mesh: "listed.the-mesh")),
        "parts": ForEach(graph: "Up", over: Parts("m"), each: "the-mesh", with: (eye_step: 3.0)),
        "all": Merge(meshes: ["up", "listed", "counted.the-mesh", "parts"]),
    },
    outputs: { "a.ply": "all" },
)"#;

/// Removes the hyphens from names in a text, and the underscores from the fields that correspond to these names.
fn underscore_names(text: &str) -> String {
    let names = [("the-mesh", "the_mesh"), ("other-one", "other_one"), ("eye-step", "eye_step")];
    names.iter().fold(text.to_owned(), |text, (name, field)| {
        let plain = name.replace('-', "");
        text.replace(name, &plain).replace(field, &plain)
    })
}

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        std::fs::write(place.0.path().join("a.obj"), mesh).unwrap();
        place
    }

    /// Loads the graph `using`, which uses the graph `up` in the same folder.
    fn load(&self, up: &str, using: &str) -> Result<Graph, Vec<Diagnostic>> {
        fn path(name: &str, folder: &tempfile::TempDir) -> std::path::PathBuf {
            folder.path().join(name)
        }
        let catalog = Catalog::new(maquette_nodes::PACKS);
        let options = Options::default().with_text(path("up.ron", &self.0), up);
        let options = options.with_text(path("a.ron", &self.0), using);
        let checked = Graph::load(&path("a.ron", &self.0), &catalog, &options);
        checked.graph.filter(|graph| graph.unused_warnings().is_empty()).ok_or(checked.diagnostics)
    }
}

/// Returns the positions of the vertices of output `all`.
fn corners(graph: &Graph) -> Vec<[f64; 3]> {
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory()).unwrap();
    let run = session.run(graph, &Run::default()).unwrap();
    assert_eq!(run.diagnostics(), []);
    let mesh = run.get::<Mesh>("all").unwrap();
    mesh.positions().iter().map(|at| [at.x, at.y, at.z]).collect()
}

#[test]
fn a_use_gives_names_with_hyphens_what_it_gives_others() {
    let place = Place::new();
    let ours = place.load(UP, USING).unwrap();
    let plain = place.load(&underscore_names(UP), &underscore_names(USING)).unwrap();
    assert_eq!(corners(&ours), corners(&plain));
    assert!(ours.node_names().any(|name| name == "parts/the-mesh"));
    let set = place.load(UP, &USING.replace("Param(\"eye-step\")", "7.0")).unwrap();
    assert_ne!(corners(&ours), corners(&set));
}

#[test]
fn a_mistake_in_a_field_speaks_of_the_field() {
    let place = Place::new();
    let using = USING.replace(
        "the_mesh: \"m\", other_one: \"m\", eye_step: Param(\"eye-step\")",
        "eye_step: \"x\"",
    );
    let problems = place.load(UP, &using).err().unwrap();
    let said: Vec<_> = problems.iter().map(|it| (&it.message[..], &it.help[..])).collect();
    assert_eq!(
        said,
        [
            (
                "Up needs a link at its port `the_mesh`",
                "write `the_mesh: \"node\"` with a node that gives a Mesh"
            ),
            (
                "field `eye_step` of Up: expected a number, found the text \"x\"",
                "parameters take values; for a parameter of the graph write Param(\"x\")"
            ),
        ]
    );
}

#[test]
fn a_field_with_hyphens_is_one_mistake_that_can_be_mended() {
    let place = Place::new();
    let using = USING
        .replace("Up(the_mesh: \"m\"", "Up(the-mesh: \"m\"")
        .replace("(eye_step: 2.0)", "(eye-step : 2.0)");
    let problems = place.load(UP, &using).err().unwrap();
    let said = problems.iter().map(|it| (&using[it.span.start..it.span.end], &it.message[..]));
    assert_eq!(
        Vec::from_iter(said),
        [
            ("the-mesh", "`the-mesh` is not a field name: a field has `_` instead of hyphens"),
            ("eye-step", "`eye-step` is not a field name: a field has `_` instead of hyphens"),
        ]
    );
    let mut mended = using.clone();
    for (span, new) in problems.iter().rev().flat_map(|it| &it.fix) {
        mended.replace_range(span.start..span.end, new);
    }
    assert_eq!(mended, USING.replace("(eye_step: 2.0)", "(eye_step : 2.0)"));
}

#[test]
fn edits_write_fields_and_understand_them() {
    let place = Place::new();
    let path = place.0.path().join("a.ron");
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let options = Options::default().with_text(place.0.path().join("up.ron"), UP);
    let plain = USING.replace(", other_one: \"m\", eye_step: Param(\"eye-step\")", "");
    fn edit(
        text: &str,
        edits: &[Edit],
        path: &std::path::Path,
        catalog: &Catalog,
        options: &Options,
    ) -> String {
        maquette::edit::edit(path, text, edits, catalog, options).unwrap().text
    }
    let set = edit(
        &plain,
        &[Edit::Set { target: "up.eye_step".into(), value: "3.5".into() }],
        &path,
        &catalog,
        &options,
    );
    assert!(set.contains("Up(the_mesh: \"m\", eye_step: 3.5)"), "{set}");
    let link = Edit::Link { port: "up.other_one".into(), to: "m".into() };
    let linked = edit(&plain, &[link], &path, &catalog, &options);
    assert!(linked.contains("Up(the_mesh: \"m\", other_one: \"m\")"), "{linked}");
    std::fs::write(place.0.path().join("up.ron"), UP).unwrap();
    let inlined = maquette::edit::inline(&path, USING, "up", &catalog, &options).unwrap().text;
    assert!(
        inlined.contains("Transform(mesh: \"m\", translate: (0.0, Param(\"eye-step\"), 0))"),
        "{inlined}"
    );
    assert_eq!(
        corners(&place.load(UP, &inlined).unwrap()),
        corners(&place.load(UP, USING).unwrap())
    );
}
