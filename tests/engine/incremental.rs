//! Checks which nodes run again after a change, as the trace shows them.

use std::path::{Path, PathBuf};

use expect_test::{Expect, expect};
use maquette::{AnyValue, CancelToken, Catalog, Evaluation, Evaluator, Graph, Options, State};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs");

/// Evaluates the example graph `doll.ron` repeatedly with one evaluator.
struct Session {
    catalog: Catalog,
    evaluator: Evaluator,
    path: PathBuf,
}

impl Session {
    fn new(threads: usize) -> Self {
        Self {
            catalog: Catalog::new(maquette_nodes::PACKS),
            evaluator: Evaluator::new(threads, 1 << 30).unwrap(),
            path: Path::new(GRAPHS).join("doll.ron"),
        }
    }

    fn load(&self, set: &[(&str, &str)]) -> Graph {
        let set = set.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        let options =
            Options { set: set.collect(), roots: vec![GRAPHS.into()], ..Options::default() };
        let checked = Graph::load(&self.path, &self.catalog, &options);
        let messages: Vec<_> = checked.diagnostics.iter().map(|problem| &problem.message).collect();
        checked.graph.unwrap_or_else(|| panic!("{messages:?}"))
    }

    fn run(&mut self, set: &[(&str, &str)]) -> Evaluation {
        let graph = self.load(set);
        self.evaluator.evaluate_all(&graph)
    }

    fn check(&mut self, set: &[(&str, &str)], expected: Expect) {
        expected.assert_eq(&self.run(set).trace().to_string());
    }
}

#[test]
fn the_first_evaluation_computes_everything_and_the_second_nothing() {
    let mut session = Session::new(2);
    let first = session.run(&[]);
    assert_eq!(first.trace().count(State::Computed), first.trace().0.len());
    let second = session.run(&[]);
    assert_eq!(second.trace().count(State::Cached), second.trace().0.len());
}

#[test]
fn a_parameter_runs_what_depends_on_it() {
    let mut session = Session::new(2);
    session.run(&[]);
    session.check(
        &[("growth", "20.0")],
        expect![[r#"
            cached   scan     nothing that it depends on changed
            cached   whole    nothing that it depends on changed
            cached   red      nothing that it depends on changed
            cached   spots    nothing that it depends on changed
            cached   nose     nothing that it depends on changed
            cached   normal   nothing that it depends on changed
            cached   net      nothing that it depends on changed
            computed raised   parameter `distance` 12 -> 20
            computed knots-u  input `net` changed; came out the same
            computed knots-v  input `net` changed; came out the same
            computed surface  input `net` changed
            computed blended  input `surface` changed
            computed grid     input `range` changed
            computed skin     input `mesh` changed
            computed model    input `mesh` changed
        "#]],
    );
}

#[test]
fn a_node_that_comes_out_the_same_stops_the_wave() {
    let mut session = Session::new(2);
    session.run(&[]);
    session.check(
        &[("red.select.distance", "30.001")],
        expect![[r#"
            cached   scan     nothing that it depends on changed
            cached   whole    nothing that it depends on changed
            computed red      parameter `distance` 30 -> 30.001; came out the same
            equal    spots    its inputs came out the same
            equal    nose     its inputs came out the same
            equal    normal   its inputs came out the same
            equal    net      its inputs came out the same
            equal    raised   its inputs came out the same
            equal    knots-u  its inputs came out the same
            equal    knots-v  its inputs came out the same
            equal    surface  its inputs came out the same
            equal    blended  its inputs came out the same
            equal    grid     its inputs came out the same
            equal    skin     its inputs came out the same
            equal    model    its inputs came out the same
        "#]],
    );
}

#[test]
fn a_parameter_changed_and_changed_back_runs_nothing() {
    let mut session = Session::new(2);
    session.run(&[]);
    session.run(&[("growth", "20.0")]);
    let back = session.run(&[]);
    assert_eq!(back.trace().count(State::Cached), back.trace().0.len());
}

#[test]
fn what_is_made_of_the_values_before_has_the_same_bytes() {
    let mut session = Session::new(2);
    for growth in ["12.0", "13.0", "13.5"] {
        let graph = session.load(&[("growth", growth), ("levels", "2")]);
        fn hash(evaluator: &mut Evaluator, graph: &Graph) -> Option<maquette::Hash> {
            let evaluation = evaluator.evaluate_all(graph);
            evaluation.find(graph, "model", "").map(AnyValue::hash)
        }
        let followed = hash(&mut session.evaluator, &graph);
        assert!(
            followed.is_some() && followed == hash(&mut Session::new(2).evaluator, &graph),
            "{growth}"
        );
    }
}

#[test]
fn comments_names_and_order_do_not_matter() {
    let mut session = Session::new(2);
    session.run(&[]);
    let text = std::fs::read_to_string(&session.path).unwrap();
    let renamed =
        text.replace("\"red\"", "\"crimson\"").replace("format: 1,", "/* moved */ format: 1,");
    let folder = tempfile::tempdir_in(GRAPHS).unwrap();
    session.path = folder.path().join("renamed.ron");
    std::fs::write(&session.path, renamed.replace("\"doll/", "\"../doll/")).unwrap();
    let moved = session.run(&[]);
    assert_eq!(moved.trace().count(State::Cached), moved.trace().0.len(), "{}", moved.trace());
}

/// A copy of the example graph `doll.ron` and of its files. The test may change it.
struct Copy {
    session: Session,
    folder: tempfile::TempDir,
}

impl Copy {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("doll")).unwrap();
        for name in ["color.png", "range.pcd"] {
            let from = Path::new(GRAPHS).join("doll").join(name);
            std::fs::copy(from, folder.path().join("doll").join(name)).unwrap();
        }
        std::fs::copy(Path::new(GRAPHS).join("doll.ron"), folder.path().join("doll.ron")).unwrap();
        let mut session = Session::new(2);
        session.path = folder.path().join("doll.ron");
        session.run(&[]);
        Self { session, folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn edit(&self, from: &str, to: &str) {
        let text = std::fs::read_to_string(&self.session.path).unwrap();
        assert!(text.contains(from), "{from}");
        std::fs::write(&self.session.path, text.replace(from, to)).unwrap();
    }

    /// Lists the nodes that were not cached, with their states. For example, `scan computed the same` means that the node `scan` ran and
    /// gave the same result as before.
    fn states(&mut self) -> String {
        let trace = self.session.run(&[]).trace();
        let touched = trace.0.iter().filter(|node| node.state != State::Cached);
        let words = touched.map(|node| {
            let same = if node.unchanged { " the same" } else { "" };
            format!("{} {}{same}", node.name, node.state.word())
        });
        Vec::from_iter(words).join(", ")
    }
}

#[test]
fn white_space_comments_and_a_new_order_run_nothing() {
    let mut copy = Copy::new();
    copy.edit("nodes: {", "nodes: { // a comment\n\n\n");
    assert_eq!(copy.states(), "");
}

#[test]
fn a_touched_file_runs_nothing() {
    let mut copy = Copy::new();
    let file = std::fs::File::options().append(true).open(copy.path("doll/color.png")).unwrap();
    file.set_modified(std::time::SystemTime::now()).unwrap();
    assert_eq!(copy.states(), "");
}

#[test]
fn a_file_with_other_bytes_and_the_same_pixels_runs_its_reader_alone() {
    let mut copy = Copy::new();
    let path = copy.path("doll/range.pcd");
    let bytes = std::fs::read(&path).unwrap();
    let text = b"# a comment more\n";
    std::fs::write(&path, [&text[..], &bytes].concat()).unwrap();
    let equal = ["nose", "normal", "net", "raised", "knots-u", "knots-v", "surface", "blended"];
    let equal = equal.map(|name| format!("{name} equal")).join(", ");
    let states = copy.states();
    assert!(
        states.starts_with("scan computed the same, whole equal, red equal, spots equal"),
        "{states}"
    );
    assert!(states.contains(&equal), "{states}");
    assert!(!states.contains("red computed"), "{states}");
}

#[test]
fn another_file_says_so() {
    let mut copy = Copy::new();
    let path = copy.path("doll/range.pcd");
    let mut bytes = std::fs::read(&path).unwrap();
    // Change the x coordinate of the last point in the range file slightly.
    let place = bytes.len() - 13;
    bytes[place] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let evaluation = copy.session.run(&[]);
    let scan = evaluation.trace().0[0].clone();
    assert_eq!((scan.state, &scan.reason[..]), (State::Computed, "file doll/range.pcd changed"));
}

#[test]
fn a_camera_file_that_appears_runs_what_reads_it() {
    let mut copy = Copy::new();
    std::fs::write(copy.path("doll/camera.json"), "{}").unwrap();
    assert!(copy.states().starts_with("scan failed"), "an empty camera is an error");
    std::fs::remove_file(copy.path("doll/camera.json")).unwrap();
    assert_eq!(copy.states(), "", "what was known before the error is still known");
}

#[test]
fn a_link_to_another_node_runs_what_hangs_on_it() {
    let mut copy = Copy::new();
    copy.edit("Texture(mesh: \"skin\"", "Texture(mesh: \"grid\"");
    assert_eq!(copy.states(), "model computed");
}

#[test]
fn a_node_put_between_runs_itself_and_what_follows() {
    let mut copy = Copy::new();
    copy.edit("Label(mask: \"red\"", "Label(mask: \"all\"");
    copy.edit("nodes: {", "nodes: { \"all\": CombineMasks(a: \"red\", b: \"red\", mode: Or),");
    let states = copy.states();
    assert!(states.starts_with("all computed, spots equal, nose equal"), "{states}");
    assert_eq!(states.matches("computed").count(), 1, "it gives what the others had: {states}");
}

#[test]
fn a_node_that_no_output_needs_is_not_run() {
    let mut copy = Copy::new();
    copy.edit("\"spots\":", "\"unused\": Edges(image: \"scan.color\"), \"spots\":");
    assert_eq!(copy.states(), "");
}

#[test]
fn a_graph_that_was_broken_in_between_runs_nothing_after_it_is_mended() {
    let mut copy = Copy::new();
    let good = std::fs::read(&copy.session.path).unwrap();
    std::fs::write(&copy.session.path, "Graph(format: 1, nodes: {").unwrap();
    let options = Options { roots: vec![], ..Options::default() };
    assert!(Graph::load(&copy.session.path, &copy.session.catalog, &options).graph.is_none());
    std::fs::write(&copy.session.path, good).unwrap();
    assert_eq!(copy.states(), "");
}

#[test]
fn every_value_has_the_same_bytes_for_any_number_of_threads() {
    let hashes = [1, 2, 8].map(|threads| {
        let mut session = Session::new(threads);
        let graph = session.load(&[]);
        let cancel = CancelToken::default();
        let evaluation = session.evaluator.evaluate_all_nodes(&graph, &(), &cancel);
        let names: Vec<_> = graph.node_names().collect();
        names
            .iter()
            .map(|name| evaluation.find(&graph, name, "").unwrap().hash())
            .collect::<Vec<_>>()
    });
    assert_eq!(hashes[0], hashes[1]);
    assert_eq!(hashes[0], hashes[2]);
}

#[test]
fn an_error_stops_only_what_hangs_on_it() {
    let mut session = Session::new(2);
    session.check(
        &[("nose.pick", "Rank(99)")],
        expect![[r#"
            computed scan     not computed before
            computed whole    not computed before
            computed red      not computed before
            computed spots    not computed before
            failed   nose     there is no rank 99: the labels have 1 parts, numbered from 1
            skipped  normal   depends on `nose`
            skipped  net      depends on `nose`
            skipped  raised   depends on `net`
            skipped  knots-u  depends on `raised`
            skipped  knots-v  depends on `raised`
            skipped  surface  depends on `raised`
            skipped  blended  depends on `nose`
            skipped  grid     depends on `blended`
            skipped  skin     depends on `grid`
            skipped  model    depends on `skin`
        "#]],
    );
}
