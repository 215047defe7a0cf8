//! Cached results on disk, which outlive a process. They are never stale, they are not used when damaged, and they never delay or fail an
//! evaluation.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex};
use std::time::Duration;

use maquette::{
    CancelToken, Catalog, Disk, Evaluation, Evaluator, Graph, Observer, Options, State,
};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs");
const LIMIT: u64 = 1 << 30;

/// Simulates a series of processes. Each evaluation has its own evaluator, and all of them share the cache folder.
struct Processes {
    catalog: Catalog,
    folder: tempfile::TempDir,
}

impl Processes {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { catalog: Catalog::new(maquette_nodes::PACKS), folder }
    }

    fn cache(&self) -> &Path {
        self.folder.path()
    }

    fn graph(&self, set: &[(&str, &str)]) -> Graph {
        let set = set.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        let options = Options { set: set.collect(), ..Options::default() };
        let checked = Graph::load(&Path::new(GRAPHS).join("doll.ron"), &self.catalog, &options);
        checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
    }

    fn evaluator(&self) -> Evaluator {
        let disk = Disk::open(self.cache(), LIMIT, &self.catalog).unwrap();
        Evaluator::new(2, 1 << 30).unwrap().with_disk(disk)
    }

    fn run(&self, set: &[(&str, &str)]) -> Evaluation {
        let mut evaluator = self.evaluator();
        let evaluation = evaluator.evaluate_all(&self.graph(set));
        evaluator.disk().unwrap().finish();
        evaluation
    }

    /// Returns all files in the cache folder.
    fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        let mut folders = vec![self.cache().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() { folders.push(path) } else { files.push(path) }
            }
        }
        files.sort();
        files
    }
}

fn hash(evaluation: &Evaluation, graph: &Graph) -> String {
    evaluation.find(graph, "model", "").unwrap().hash().to_string()
}

#[test]
fn the_next_process_computes_nothing_and_has_the_same_values() {
    let processes = Processes::new();
    let graph = processes.graph(&[]);
    let first = processes.run(&[]);
    let second = processes.run(&[]);
    assert_eq!(second.trace().count(State::Cached), 15, "{}", second.trace());
    assert_eq!(hash(&first, &graph), hash(&second, &graph));
}

#[test]
fn the_next_process_computes_what_changed_alone() {
    let processes = Processes::new();
    processes.run(&[]);
    let trace = processes.run(&[("growth", "25")]).trace();
    assert_eq!(trace.count(State::Cached), 7, "{trace}");
    assert!(
        trace.to_string().contains("computed raised   parameter `distance` 12 -> 25"),
        "{trace}"
    );
    // Remove the record that the last evaluation wrote about the graph. Cached results are still found by their keys.
    for file in processes.files() {
        if file.parent().unwrap().ends_with("graphs") {
            fs::remove_file(file).unwrap();
        }
    }
    let trace = processes.run(&[("growth", "25")]).trace();
    assert_eq!(trace.count(State::Computed), 0, "{trace}");
}

/// Flips random bits in random cache files, often enough to damage every file repeatedly. Each result must stay right, both if it is read
/// from the cache and if it is computed again.
#[test]
fn a_thousand_flipped_bytes_change_no_result() {
    let processes = Processes::new();
    let graph = processes.graph(&[]);
    let expected = hash(&processes.run(&[]), &graph);
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    fn next(below: usize, random: &mut u64) -> usize {
        *random ^= *random << 13;
        *random ^= *random >> 7;
        *random ^= *random << 17;
        (*random % below as u64) as usize
    }
    for _ in 0..20 {
        let files = processes.files();
        for _ in 0..50 {
            let file = &files[next(files.len(), &mut random)];
            let mut bytes = fs::read(file).unwrap();
            if !bytes.is_empty() {
                let place = next(bytes.len(), &mut random);
                bytes[place] ^= 1 << next(8, &mut random);
                fs::write(file, bytes).unwrap();
            }
        }
        let evaluation = processes.run(&[]);
        assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
        assert_eq!(hash(&evaluation, &graph), expected);
    }
    // The cache is repaired: the next evaluation computes the missing results, and the evaluation after it finds all results in the cache.
    processes.run(&[]);
    let trace = processes.run(&[]).trace();
    assert_eq!(trace.count(State::Computed), 0, "{trace}");
}

#[test]
fn files_cut_off_at_any_length_are_computed_again() {
    let processes = Processes::new();
    let graph = processes.graph(&[]);
    let expected = hash(&processes.run(&[]), &graph);
    for (index, file) in processes.files().iter().enumerate() {
        let length = fs::metadata(file).unwrap().len();
        let file = fs::File::options().write(true).open(file).unwrap();
        file.set_len(length * (index as u64 % 8) / 8).unwrap();
    }
    assert_eq!(hash(&processes.run(&[]), &graph), expected);
}

#[test]
fn an_entry_under_another_name_is_not_believed() {
    let processes = Processes::new();
    let graph = processes.graph(&[]);
    let expected = hash(&processes.run(&[]), &graph);
    let entries: Vec<_> = processes
        .files()
        .into_iter()
        .filter(|file| {
            file.parent().unwrap().ends_with("entries")
                || file.parent().unwrap().ends_with("columns")
        })
        .collect();
    let contents: Vec<_> = entries.iter().map(|file| fs::read(file).unwrap()).collect();
    for (file, content) in entries.iter().zip(contents.iter().cycle().skip(1)) {
        fs::write(file, content).unwrap();
    }
    assert_eq!(hash(&processes.run(&[]), &graph), expected);
}

#[test]
fn four_evaluators_share_a_folder() {
    let processes = Processes::new();
    let graph = processes.graph(&[("growth", "20")]);
    let expected = hash(&processes.run(&[("growth", "20")]), &graph);
    fs::remove_dir_all(processes.cache()).unwrap();
    std::thread::scope(|scope| {
        let work = |worker: usize| {
            let processes = &processes;
            let (graph, expected) = (&graph, &expected);
            move || {
                for round in 0..6 {
                    if round == 3 && worker == 0 {
                        Disk::gc(processes.cache(), 0).unwrap();
                    }
                    let growth = ["20", "21"][(worker + round) % 2];
                    let evaluation = processes.run(&[("growth", growth)]);
                    assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
                    if growth == "20" {
                        assert_eq!(hash(&evaluation, graph), *expected);
                    }
                }
            }
        };
        for worker in 0..4 {
            scope.spawn(work(worker));
        }
    });
}

/// An observer that clears the cache as soon as an evaluation is planned. It also makes the nodes `first` and `last` wait for each other:
/// `last` until `first` has started, and then `first` until `last` has finished.
struct Clearing<'a> {
    cache: &'a Path,
    /// The names of the nodes that have started. For the node `last`, `last begins` means that it has started, and `last` that it has
    /// finished.
    seen: Mutex<BTreeSet<String>>,
    more: Condvar,
}

impl Clearing<'_> {
    /// Records that `node` has been reached, and waits until `other` is recorded. The wait has a timeout, so that a bug fails the test
    /// instead of blocking it.
    fn meet(&self, node: &str, other: &str) {
        let mut seen = self.seen.lock().unwrap();
        let is_first = seen.insert(node.to_owned());
        self.more.notify_all();
        if is_first {
            let patience = Duration::from_secs(20);
            let (mut seen, waited) = self
                .more
                .wait_timeout_while(seen, patience, |seen: &mut BTreeSet<String>| {
                    !seen.contains(other)
                })
                .unwrap();
            if waited.timed_out() {
                seen.insert("nobody came".to_owned());
            }
        }
    }
}

impl Observer for Clearing<'_> {
    fn on_unchanged(&self, _: usize) {
        Disk::gc(self.cache, 0).unwrap();
    }

    fn on_start(&self, node: &str) {
        match node {
            "first" => self.meet(node, "last"),
            "last" => self.meet("last begins", "first"),
            _ => drop(self.seen.lock().unwrap().insert(node.to_owned())),
        }
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        if node == "last" {
            self.meet(node, node);
        }
    }
}

/// Tests a chain of three nodes. `first` is missing on disk and is restored. `middle` is on disk when the evaluation begins, but is deleted
/// before the changed node `last` needs it. Then `middle` must be computed again from the result of `first`, which does not exist yet at
/// that time.
#[test]
fn values_that_go_while_their_sources_are_restored_are_computed_again() {
    let processes = Processes::new();
    let project = tempfile::tempdir().unwrap();
    let path = project.path().join("three.ron");
    fs::write(project.path().join("tip.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    // Wait until the mesh file is old enough. A file that was just written would be read again, and all nodes that depend on it would be
    // visited.
    std::thread::sleep(Duration::from_millis(300));
    let text = "Graph(format: 1, params: {\"far\": Number(default: 1.0)}, nodes: {
        \"first\": ReadMesh(path: \"tip.obj\"),
        \"middle\": Transform(mesh: \"first\", scale: (2, 2, 2)),
        \"last\": Transform(mesh: \"middle\", translate: (Param(\"far\"), 0, 0)),
    }, outputs: {\"last.ply\": \"last\"})";
    fs::write(&path, text).unwrap();
    fn graph(far: &str, path: &Path, processes_catalog: &Catalog) -> Graph {
        let set = vec![("far".to_owned(), far.to_owned())];
        let options = Options { set, ..Options::default() };
        let checked = Graph::load(path, processes_catalog, &options);
        checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
    }
    let mut evaluator = processes.evaluator();
    evaluator.evaluate_nodes(&graph("1", &path, &processes.catalog), &["first"]);
    evaluator.disk().unwrap().finish();
    let first: Vec<_> = processes
        .files()
        .into_iter()
        .filter(|file| file.parent().unwrap().ends_with("entries"))
        .collect();
    assert_eq!(first.len(), 1);
    evaluator.evaluate_nodes(&graph("1", &path, &processes.catalog), &["last"]);
    evaluator.disk().unwrap().finish();
    fs::remove_file(&first[0]).unwrap();

    let (seen, more) = (Mutex::default(), Condvar::new());
    let clearing = Clearing { cache: processes.cache(), seen, more };
    let graph = graph("2", &path, &processes.catalog);
    let mut evaluator = processes.evaluator();
    let evaluation = evaluator.evaluate_all_nodes(&graph, &clearing, &CancelToken::default());
    assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
    let seen = Vec::from_iter(clearing.seen.into_inner().unwrap());
    assert_eq!(seen, ["first", "last", "last begins", "middle"]);
    let mut alone = Evaluator::new(1, 1 << 30).unwrap();
    let expected = alone.evaluate_nodes(&graph, &["last"]);
    let [found, expected] = [&evaluation, &expected]
        .map(|evaluation| evaluation.find(&graph, "last", "").map(|value| value.hash()));
    assert!(found.is_some() && found == expected);
}

#[test]
fn what_was_not_used_for_longest_goes_first() {
    let processes = Processes::new();
    processes.run(&[("growth", "20")]);
    let old = std::time::SystemTime::now() - Duration::from_secs(3600);
    let old_files = processes.files();
    for file in &old_files {
        fs::File::options().append(true).open(file).unwrap().set_modified(old).unwrap();
    }
    processes.run(&[("growth", "30")]);
    let before = Disk::usage(processes.cache()).unwrap().bytes;
    let dropped = Disk::gc(processes.cache(), before - 1_000_000).unwrap();
    assert!((1_000_000..before / 2).contains(&dropped), "{dropped} of {before}");
    // The cleanup has removed only results that the last run did not use.
    let trace = processes.run(&[("growth", "30")]).trace();
    assert_eq!(trace.count(State::Computed), 0, "{trace}");
}

#[test]
fn memory_for_a_part_of_the_results_still_gives_all_of_them() {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let processes = Processes::new();
    let graph = processes.graph(&[]);
    let expected = hash(&processes.run(&[]), &graph);
    for disk in [false, true] {
        let mut evaluator = Evaluator::new(2, 2_000_000).unwrap();
        if disk {
            let folder = tempfile::tempdir().unwrap();
            evaluator = evaluator.with_disk(Disk::open(folder.path(), LIMIT, &catalog).unwrap());
        }
        for _ in 0..2 {
            let evaluation = evaluator.evaluate_all(&graph);
            assert_eq!(hash(&evaluation, &graph), expected, "with disk: {disk}");
        }
    }
}

/// An observer that counts the nodes that start.
#[derive(Default)]
struct StartCounter(AtomicUsize);

impl Observer for StartCounter {
    fn on_start(&self, _: &str) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn what_is_wanted_is_computed_once_even_if_there_is_no_memory_for_it() {
    let graph = Processes::new().graph(&[]);
    let mut evaluator = Evaluator::new(2, 1).unwrap();
    let begun = StartCounter::default();
    let done = evaluator.evaluate_all_nodes(&graph, &begun, &CancelToken::default());
    assert_eq!(begun.0.into_inner(), done.trace().count(State::Computed));
}

#[test]
fn verifying_computes_and_finds_no_difference() {
    let processes = Processes::new();
    processes.run(&[]);
    let mut evaluator = processes.evaluator().with_verification(1.0);
    let evaluation = evaluator.evaluate_all(&processes.graph(&[]));
    assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
    assert_eq!(evaluation.trace().count(State::Computed), 15, "{}", evaluation.trace());
}

#[test]
fn every_value_of_the_examples_is_read_back_as_it_was() {
    let processes = Processes::new();
    for path in crate::examples::examples() {
        fn load(path: &Path, processes_catalog: &Catalog) -> Graph {
            Graph::load(path, processes_catalog, &Options::default()).graph.unwrap()
        }
        fn evaluate(graph: &Graph, processes: &Processes) -> Evaluation {
            let mut evaluator = processes.evaluator();
            let evaluation = evaluator.evaluate_all_nodes(graph, &(), &CancelToken::default());
            evaluator.disk().unwrap().finish();
            evaluation
        }
        let (first_graph, second_graph) =
            (load(&path, &processes.catalog), load(&path, &processes.catalog));
        let (first, second) =
            (evaluate(&first_graph, &processes), evaluate(&second_graph, &processes));
        assert_eq!(
            second.trace().count(State::Computed),
            0,
            "{}:\n{}",
            path.display(),
            second.trace()
        );
        for name in first_graph.node_names() {
            fn value(
                evaluation: &Evaluation,
                first_graph: &Graph,
                name: &str,
            ) -> Option<maquette::Hash> {
                evaluation.find(first_graph, name, "").map(|value| value.hash())
            }
            assert_eq!(
                value(&first, &first_graph, name),
                value(&second, &first_graph, name),
                "{}: {name}",
                path.display()
            );
        }
    }
}
