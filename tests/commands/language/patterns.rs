//! The pattern `*.ron` matches not only graphs, but also tests and the files that programs write beside graphs.

use crate::project::Project;

const GRAPH: &str = r#"Graph(format: 1, nodes: { "net": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 1)]]),
    "s": Nurbs(net: "net"), "m": Tessellate(surface: "s") }, outputs: { "m.ply": "m" })"#;

const BESIDE: [(&str, &str); 4] = [
    ("doll.test.ron", "Test(graph: \"doll.ron\")"),
    ("doll.lock.ron", "Lock(format: 1, files: {}, texts: {})"),
    ("doll.pins.ron", "Pins(format: 1, pins: {})"),
    ("doll.layout.ron", "Layout(nodes: {})"),
];

/// Returns these arguments followed by the file names to which a shell expands `*.ron`.
fn with_all<'a>(words: &[&'a str]) -> Vec<&'a str> {
    let files = ["doll.layout.ron", "doll.lock.ron", "doll.pins.ron", "doll.ron", "doll.test.ron"];
    [words, &files].concat()
}

#[test]
fn what_lies_beside_graphs_is_passed_over_where_several_files_are_named() {
    let project = Project::new(GRAPH);
    for (name, text) in &BESIDE {
        std::fs::write(project.folder().join(name), text).unwrap();
    }
    fn run_text(words: &[&str], project: &Project) -> String {
        let done = project.maquette(words);
        let told = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success() && told.is_empty(), "{words:?}: {told}");
        String::from_utf8(done.stdout).unwrap()
    }
    assert_eq!(run_text(&with_all(&["check"]), &project), "checked 1 graph, 1 test: 0 errors\n");
    assert_eq!(run_text(&["check", "."], &project), "checked 1 graph, 1 test: 0 errors\n");
    assert_eq!(
        run_text(&with_all(&["render", "sheet", "--size", "30x20"]), &project),
        "./doll.png\n  row 1: the defaults\n"
    );
    let mut migrate = with_all(&["edit"]);
    migrate.insert(2, "migrate");
    assert_eq!(run_text(&migrate, &project), "0 files to be migrated\n");
    fn read_files(project: &Project) -> [Vec<u8>; 4] {
        BESIDE.map(|(name, _)| std::fs::read(project.folder().join(name)).unwrap())
    }
    let before = read_files(&project);
    run_text(&with_all(&["fmt"]), &project);
    assert_eq!(read_files(&project)[1..], before[1..], "fmt wrote what programs keep");
}

#[test]
fn a_file_that_is_no_graph_says_what_it_is() {
    let project = Project::new(GRAPH);
    let helps = [
        "run it with `maquette test`",
        "a lock file, which `maquette lock` writes",
        "pins, which `maquette pin` writes",
        "the layout of a graph in an editor",
    ];
    for ((name, text), help) in BESIDE.iter().zip(helps) {
        std::fs::write(project.folder().join(name), text).unwrap();
        for words in [
            &["run", name][..],
            &["draw", name],
            &["render", name, "m", "m.png"],
            &["render", "sheet", name],
        ] {
            let done = project.maquette(words);
            let told = String::from_utf8_lossy(&done.stderr);
            assert_eq!(done.status.code(), Some(1), "{words:?}: {told}");
            assert!(told.contains(help), "{words:?}: {told}");
        }
    }
}
