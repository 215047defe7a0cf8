//! `*.ron` names more than graphs: tests, and what programs keep beside graphs.

use crate::project::Project;

const GRAPH: &str = r#"Graph(format: 1, nodes: { "net": PointNet(points: [[(0, 0, 0), (1, 0, 1), (2, 0, 0)], [(0, 1, 1), (1, 1, 2), (2, 1, 1)], [(0, 2, 0), (1, 2, 1), (2, 2, 1)]]),
    "s": Nurbs(net: "net"), "m": Tessellate(surface: "s") }, outputs: { "m.ply": "m" })"#;

const BESIDE: [(&str, &str); 4] = [
    ("doll.test.ron", "Test(graph: \"doll.ron\")"),
    ("doll.lock.ron", "Lock(format: 1, files: {}, texts: {})"),
    ("doll.pins.ron", "Pins(format: 1, pins: {})"),
    ("doll.layout.ron", "Layout(nodes: {})"),
];

/// The names that a shell makes of `*.ron`, behind these words.
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
    fn said(words: &[&str], project: &Project) -> String {
        let done = project.maquette(words);
        let told = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success() && told.is_empty(), "{words:?}: {told}");
        String::from_utf8(done.stdout).unwrap()
    }
    assert_eq!(said(&with_all(&["check"]), &project), "checked 1 graph, 1 test: 0 errors\n");
    assert_eq!(said(&["check", "."], &project), "checked 1 graph, 1 test: 0 errors\n");
    assert_eq!(
        said(&with_all(&["sheet", "--size", "30x20"]), &project),
        "./doll.png\n  row 1: the defaults\n"
    );
    assert_eq!(said(&with_all(&["migrate"]), &project), "0 files to be migrated\n");
    fn kept(project: &Project) -> [Vec<u8>; 4] {
        BESIDE.map(|(name, _)| std::fs::read(project.folder().join(name)).unwrap())
    }
    let before = kept(&project);
    said(&with_all(&["fmt"]), &project);
    assert_eq!(kept(&project)[1..], before[1..], "fmt wrote what programs keep");
}

#[test]
fn a_file_that_is_no_graph_says_what_it_is() {
    let project = Project::new(GRAPH);
    let helps = [
        "`maquette test` runs it",
        "a lock file, which `maquette lock` writes",
        "pins, which `maquette pin` writes",
        "where an editor puts the nodes",
    ];
    for ((name, text), help) in BESIDE.iter().zip(helps) {
        std::fs::write(project.folder().join(name), text).unwrap();
        for words in
            [&["run", name][..], &["draw", name], &["render", name, "m", "m.png"], &["sheet", name]]
        {
            let done = project.maquette(words);
            let told = String::from_utf8_lossy(&done.stderr);
            assert_eq!(done.status.code(), Some(1), "{words:?}: {told}");
            assert!(told.contains(help), "{words:?}: {told}");
        }
    }
}
