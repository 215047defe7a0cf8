//! The results of checking expectations are stored. A value that is known to meet its expectations is not computed again only to check it.
//! A failure is reported at every run.

use std::path::Path;

use maquette::{CacheFolder, Catalog, Graph, Options, OutputFolder, Session, Settings, State};
use maquette_nodes::PACKS;

/// A graph whose mesh `moved` takes so little time to compute that it is not stored on disk.
const TEXT: &str = r#"Graph(
    format: 1,
    params: { "far": Number(default: 1.0) },
    nodes: {
        "doll": ReadMesh(path: "doll/coarse.obj"),
        "fine": Subdivide(mesh: "doll", scheme: Loop, levels: 4),
        "moved": Transform(mesh: "fine", translate: (Param("far"), 0, 0)),
        "small": Transform(mesh: "doll", translate: (Param("far"), 0, 0)),
    },
    outputs: { "small.ply": "small" },
    expect: [
        Count(of: "moved", what: "vertices", min: 1),
        Bounds(of: "moved", low: (-70, -1, -70), high: (70, 120, 70)),
    ],
)"#;

struct Project(tempfile::TempDir);

impl Project {
    /// Runs the graph in a new session. Returns the state of the node `moved`, its forecast, and the errors.
    fn run(&self, text: &str, far: &str) -> (State, String, Vec<String>) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/verdicts.ron");
        let set = vec![("far".to_owned(), far.to_owned())];
        let options = Options { set, ..Options::default() }.with_text(&path, text);
        let checked = Graph::load(&path, &Catalog::new(PACKS), &options);
        let graph = checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics));
        let cache = CacheFolder::At(self.0.path().join("cache"));
        let settings = Settings { threads: 2, cache, ..Settings::default() };
        let mut session = Session::new(PACKS, &settings).unwrap();
        let why = session.explain(&graph, "moved").unwrap();
        let into = OutputFolder::new(Some(&self.0.path().join("out")), &path);
        session.recall(&into);
        let done = session.produce(&graph, &[], &into, &(), &Default::default()).unwrap();
        session.finish();
        let trace = done.trace().0.into_iter().find(|node| node.name == "moved");
        let problems = done.diagnostics.iter().map(|problem| problem.message.clone()).collect();
        (trace.unwrap().state, why, problems)
    }
}

#[test]
fn a_value_that_is_as_expected_is_not_made_again_to_be_judged() {
    let project = Project(tempfile::tempdir().unwrap());
    assert_eq!(project.run(TEXT, "1.0").0, State::Computed);
    let (state, why, problems) = project.run(TEXT, "1.0");
    assert_eq!((state, problems), (State::Cached, Vec::new()));
    assert!(why.starts_with("`moved` does not run"), "{why}");
    // A new value is checked against the known expectations, and a known value is checked against a new expectation.
    assert_eq!(project.run(TEXT, "2.0").0, State::Computed);
    let (_, _, problems) = project.run(&TEXT.replace("high: (70", "high: (7"), "2.0");
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert_eq!(project.run(TEXT, "2.0").0, State::Cached);
}

#[test]
fn what_is_not_as_expected_is_told_at_every_run() {
    let project = Project(tempfile::tempdir().unwrap());
    let first = project.run(TEXT, "99.0").2;
    assert!(first.len() == 1 && first[0].starts_with("expected Bounds, but `moved`"), "{first:?}");
    for _ in 0..2 {
        assert_eq!(project.run(TEXT, "99.0").2, first);
    }
}
