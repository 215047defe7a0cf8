//! Checks that every graph of the project still produces its golden results, like the command `maquette test graphs`.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use maquette::{Catalog, TestRun, test_graphs};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs");

fn run(folder: &Path, threads: usize) -> TestRun {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    test_graphs(folder, &catalog, threads).unwrap()
}

/// The results of the golden tests of all graphs.
struct Results {
    passed: usize,
    graphs: Vec<PathBuf>,
    failures: Vec<String>,
}

/// Runs the golden tests of all graphs once and writes their reports to `target/tmp`.
fn all_results() -> &'static Results {
    static ALL: OnceLock<Results> = OnceLock::new();
    ALL.get_or_init(|| {
        let run = run(Path::new(GRAPHS), 2);
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
        std::fs::write(folder.join("graph-tests.html"), run.html()).unwrap();
        std::fs::write(folder.join("graph-tests.xml"), run.junit()).unwrap();
        let TestRun { passed, graphs, failures, .. } = run;
        Results { passed, graphs, failures }
    })
}

#[test]
fn every_graph_gives_what_it_gave() {
    let run = all_results();
    let page = concat!(env!("CARGO_TARGET_TMPDIR"), "/graph-tests.html");
    assert!(run.failures.is_empty(), "{}\nsee {page}", run.failures.join("\n"));
    assert!(run.passed >= 50, "{} cases", run.passed);
}

#[test]
fn every_graph_has_a_test() {
    fn names(folder: &Path) -> Vec<PathBuf> {
        let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
        files.filter(|path| path.extension().is_some_and(|ending| ending == "ron")).collect()
    }
    let run = all_results();
    for folder in ["", "/nodes", "/checks"].map(|room| format!("{GRAPHS}{room}")) {
        let graphs = names(Path::new(&folder)).into_iter();
        for graph in graphs.filter(|path| !path.to_string_lossy().ends_with(".test.ron")) {
            assert!(run.graphs.contains(&graph), "{} has no test", graph.display());
        }
    }
}

/// Copies the example graph `doll.ron`, its test and its goldens to a folder where they can be changed.
fn copy() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fn copy(from: &Path, to: &Path) {
        std::fs::create_dir_all(to).unwrap();
        for file in std::fs::read_dir(from).unwrap().map(|file| file.unwrap().path()) {
            if file.is_file() {
                std::fs::copy(&file, to.join(file.file_name().unwrap())).unwrap();
            }
        }
    }
    let graphs = Path::new(GRAPHS);
    let cases =
        ["default", "none", "longest", "long", "coarse"].map(|case| format!("goldens/doll/{case}"));
    for name in cases.iter().map(String::as_str).chain(["doll"]) {
        copy(&graphs.join(name), &folder.path().join(name));
    }
    for name in ["doll.ron", "doll.test.ron"] {
        std::fs::copy(graphs.join(name), folder.path().join(name)).unwrap();
    }
    folder
}

/// Changes a copy of the files of the example graph `doll.ron`. Returns the failures of its test.
fn failures(change: impl Fn(&Path)) -> String {
    let folder = copy();
    change(folder.path());
    run(folder.path(), 2).failures.join("\n")
}

fn replace(path: &Path, old: &str, new: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(old));
    std::fs::write(path, text.replacen(old, new, 1)).unwrap();
}

#[test]
fn another_folder_and_one_thread_are_no_difference() {
    let folder = copy();
    assert_eq!(run(folder.path(), 1).failures, [""; 0]);
}

#[test]
fn a_longer_nose_is_found_with_its_place() {
    let found =
        failures(|folder| replace(&folder.join("doll.ron"), "default: 12.0", "default: 12.1"));
    assert!(found.contains("doll.ron default"), "{found}");
    assert!(found.contains("model: `position` differs by 0.10"), "{found}");
    assert!(!found.contains("doll.ron long"), "{found}");
}

/// Copies a golden to another name, which no test uses.
fn copy_golden(folder: &Path, to: &str) {
    std::fs::copy(folder.join("goldens/doll/long/red.txt"), folder.join(to)).unwrap();
}

#[test]
fn a_missing_golden_and_an_orphan_are_failures() {
    let found =
        failures(|folder| std::fs::remove_file(folder.join("goldens/doll/long/red.txt")).unwrap());
    assert!(found.contains("doll.ron long: red: there is no golden"), "{found}");
    let found = failures(|folder| copy_golden(folder, "goldens/doll/long/blue.txt"));
    assert!(found.contains("blue.txt belongs to no output"), "{found}");
    let found = failures(|folder| {
        std::fs::create_dir_all(folder.join("goldens/doll/short")).unwrap();
        copy_golden(folder, "goldens/doll/short/red.txt");
    });
    assert!(found.contains("red.txt belongs to no test"), "{found}");
}

#[test]
fn a_budget_of_memory_is_kept() {
    let found = failures(|folder| {
        replace(&folder.join("doll.test.ron"), "(seconds: 20.0)", "(seconds: 20.0, memory: 0.5)");
    });
    assert!(found.contains("the nodes' results take") && found.contains("is 0.5 MB"), "{found}");
}

#[test]
fn a_damaged_golden_is_a_failure() {
    let found = failures(|folder| {
        std::fs::write(folder.join("goldens/doll/long/blended.bin"), "golden3\nxyz").unwrap();
    });
    assert!(found.contains("blended.bin is not what blended.txt says of it"), "{found}");
    let found = failures(|folder| {
        std::fs::remove_file(folder.join("goldens/doll/long/blended.bin")).unwrap();
    });
    assert!(found.contains("blended.bin is gone"), "{found}");
}

#[test]
fn an_expectation_that_does_not_hold_names_what_offends() {
    let found = failures(|folder| {
        replace(
            &folder.join("doll.ron"),
            "    outputs: {",
            "    expect: [Closed(\"skin\")],\n    outputs: {",
        );
    });
    assert!(found.contains("expected Closed, but `skin` has 2398 edges with one face"), "{found}");
}
