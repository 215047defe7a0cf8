//! `maquette test` distributed over several machines, and cases that are skipped.

use std::collections::BTreeSet;

use crate::output::text_of;
use crate::project::Project;

const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "k": Number(default: 1.0, doc: "It.") },
    nodes: { "net": PointNet(points: [[(0, 0, Param("k")), (1, 0, 1)], [(0, 1, 1), (1, 1, 2)]]) },
    outputs: { "net.ply": "net" },
)"#;

/// Makes a project with tests of two graphs with eleven cases, one of which is skipped.
fn tests() -> Project {
    let project = Project::empty();
    for (graph, count) in [("one", 7), ("two", 4)] {
        let cases = (0..count).map(|k| match (graph, k) {
            ("two", 3) => "\"c3\": (skip: \"takes <an hour>\")".to_owned(),
            _ => format!("\"c{k}\": (set: {{ \"k\": {k}.5 }})"),
        });
        let cases = Vec::from_iter(cases).join(", ");
        let test = format!("Test(graph: \"{graph}.ron\", cases: {{ {cases} }})");
        project.write(&format!("{graph}.ron"), GRAPH);
        project.write(&format!("{graph}.test.ron"), &test);
    }
    assert!(project.maquette(&["test", "--bless"]).status.success());
    project
}

/// Returns the test cases in a JUnit document, by graph and name.
fn cases(document: &str) -> BTreeSet<String> {
    let cases = document.lines().filter_map(|line| line.strip_prefix("<testcase "));
    cases.map(|case| case.split(" time=").next().unwrap().to_owned()).collect()
}

#[test]
fn shards_are_together_all_cases_and_none_twice() {
    let project = tests();
    fn run(more: &[&str], project: &Project) -> BTreeSet<String> {
        let tested = project.maquette(&[&["test", "--junit", "it.xml"], more].concat());
        assert!(tested.status.success(), "{}", text_of(&tested));
        cases(&project.read("it.xml"))
    }
    let all = run(&[], &project);
    assert_eq!(all.len(), 11);
    for count in [1, 3, 8, 20] {
        let mut seen = BTreeSet::new();
        for index in 1..=count {
            let own = run(&["--shard", &format!("{index}/{count}")], &project);
            assert!(own.len().abs_diff(11 / count) <= 1, "{index}/{count}: {own:?}");
            // The order in which test files are named on the command line does not matter.
            let shard = format!("{index}/{count}");
            assert_eq!(run(&["--shard", &shard, "two.test.ron", "one.test.ron"], &project), own);
            assert!(own.iter().all(|case| seen.insert(case.clone())), "{index}/{count}: {own:?}");
        }
        assert_eq!(seen, all);
    }
    // A failure that belongs to no case is reported by the first shard.
    let [golden, gone] =
        ["goldens/one/c0", "goldens/gone/c0"].map(|folder| project.folder().join(folder));
    std::fs::create_dir_all(&gone).unwrap();
    for file in std::fs::read_dir(golden).unwrap().map(Result::unwrap) {
        std::fs::copy(file.path(), gone.join(file.file_name())).unwrap();
    }
    let codes = ["1/2", "2/2"].map(|shard| project.maquette(&["test", "--shard", shard]).status);
    assert_eq!(codes.map(|status| status.code()), [Some(1), Some(0)]);
    for wrong in ["0/8", "9/8", "0/0", "2", "a/b", "1/8/2"] {
        let refused = project.maquette(&["test", "--shard", wrong]);
        let told = text_of(&refused);
        assert_eq!(refused.status.code(), Some(2), "{told}");
        assert!(told.contains("expected K/N with K from 1 to N"), "{told}");
    }
}

#[test]
fn a_case_is_skipped_with_a_reason_and_not_without() {
    let project = tests();
    let tested = project.maquette(&["test", "two.test.ron", "--junit", "it.xml"]);
    assert!(text_of(&tested).contains("c3: takes <an hour>"), "{}", text_of(&tested));
    let document = project.read("it.xml");
    assert!(document.contains("<skipped message=\"takes &lt;an hour&gt;\"/>"), "{document}");
    for empty in ["\"\"", "\"  \"", "\"\\n\"", "true", "Some(\"\")", "()"] {
        let test = format!("Test(graph: \"two.ron\", cases: {{ \"c3\": (skip: {empty}) }})");
        project.write("two.test.ron", &test);
        let refused = project.maquette(&["test", "two.test.ron"]);
        let told = text_of(&refused);
        assert_eq!(refused.status.code(), Some(2), "{empty}: {told}");
        assert!(told.contains("two.test.ron:1:"), "{empty}: {told}");
    }
}
