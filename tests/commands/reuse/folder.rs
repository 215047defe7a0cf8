//! A temporary folder with graphs.

use std::path::PathBuf;

use expect_test::Expect;
use maquette::{Catalog, CheckedGraph, Evaluator, Graph, Options, Position};

/// A folder of graph files with a mesh `doll.obj`.
pub(crate) struct Folder(tempfile::TempDir);

/// A tetrahedron.
pub(crate) const DOLL: &str =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

/// A graph that moves a mesh along x.
pub(crate) const MOVED: &str = r#"// Moves things.
Graph(
    format: 1,
    doc: "Moves a mesh to the right.",
    inputs: { "mesh": Mesh(doc: "What is moved.") },
    params: { "step": Number(default: 1.0, min: 0.0, max: 10.0, unit: "mm", doc: "How far.") },
    nodes: { "it": Transform(mesh: "mesh", translate: (Param("step"), 0, 0)) },
    outputs: { "mesh": "it" },
)"#;

impl Folder {
    pub(crate) fn new(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("doll.obj", DOLL), ("lib/moved.ron", MOVED)].iter().chain(files) {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        Self(folder)
    }

    /// Makes a folder with the graph of [`graph`] as `graph.ron`.
    pub(crate) fn with_nodes(nodes: &str) -> Self {
        Self::new(&[("graph.ron", &graph(nodes))])
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn load_with(&self, name: &str, set: &[(&str, &str)]) -> CheckedGraph {
        let catalog = Catalog::new(maquette_nodes::PACKS);
        let set = set.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        let options = Options { set: set.collect(), ..Options::default() };
        Graph::load(&self.path(name), &catalog, &options)
    }

    pub(crate) fn graph(&self) -> Graph {
        let checked = self.load_with("graph.ron", &[]);
        checked.graph.unwrap_or_else(|| panic!("{}", self.problems(&[])))
    }

    /// Returns the diagnostics of `graph.ron` as `file:line:columns code message (help) <- uses`.
    pub(crate) fn problems(&self, set: &[(&str, &str)]) -> String {
        let checked = self.load_with("graph.ron", set);
        assert_eq!(checked.graph.is_none(), !checked.diagnostics.is_empty());
        let root = std::fs::canonicalize(self.0.path()).unwrap();
        let lines = checked.diagnostics.iter().map(|problem| {
            let text = &problem.source.text;
            let start = Position::from_offset(text, problem.span.start);
            let end = Position::from_offset(text, problem.span.end);
            let help = match &problem.help[..] {
                "" => String::new(),
                help => format!(" ({help})"),
            };
            let uses =
                problem.uses.iter().map(|at| format!(" <- {} at {}", at.name, at.location()));
            let (code, message, uses) = (problem.code, &problem.message, String::from_iter(uses));
            let file = problem.source.name.display();
            let place = format!("{file}:{}:{}-{}", start.line, start.column, end.column);
            format!("{place} {code} {message}{help}{uses}\n")
        });
        let lines = String::from_iter(lines);
        let lines = lines.replace(&format!("{}/", self.0.path().display()), "");
        lines.replace(root.to_str().unwrap(), "ROOT")
    }

    pub(crate) fn check(&self, expected: Expect) {
        expected.assert_eq(&self.problems(&[]));
    }

    /// Evaluates a mesh and returns the x coordinate of its first vertex.
    pub(crate) fn x_of(&self, set: &[(&str, &str)], link: &str) -> f64 {
        let checked = self.load_with("graph.ron", set);
        let graph = checked.graph.unwrap_or_else(|| panic!("{}", self.problems(set)));
        let (node, output) = link.split_once('.').unwrap_or((link, ""));
        let evaluation = evaluator().evaluate_nodes(&graph, &[node]);
        let value = evaluation.find(&graph, node, output).unwrap();
        value.get::<maquette::value::Mesh>().unwrap().positions()[0].x
    }
}

/// Returns a graph with these nodes that uses `lib/moved.ron` as `Moved` and writes the node `out`.
pub(crate) fn graph(nodes: &str) -> String {
    format!(
        "Graph(format: 1, use: {{ \"Moved\": \"lib/moved.ron\" }}, params: {{ \"far\": Number(default: 3.0) }}, nodes: {{\n\
         \"doll\": ReadMesh(path: \"doll.obj\"),\n{nodes}\n}}, outputs: {{ \"out.ply\": \"out\" }})"
    )
}

pub(crate) fn evaluator() -> Evaluator {
    Evaluator::new(2, 1 << 30).unwrap()
}
