//! Tests the guarantees of the engine with a small pack of nodes. Each key is computed once, nodes run in parallel, panics are caught, and
//! evaluations can be cancelled.

use std::sync::Barrier;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use expect_test::expect;
use maquette::parallel::*;
use maquette::value::{Memo, Parts};
use maquette::{
    CancelToken, Catalog, Context, Encoder, Error, Evaluation, Evaluator, Graph, In, Node,
    Observer, Options, Pack, State, Summary, Value, node, value_type,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A number, as the value of an output.
#[derive(Clone, Debug, PartialEq)]
struct Number(f64);

impl Value for Number {
    const NAME: &'static str = "Number";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&self.0);
    }

    fn size(&self) -> usize {
        size_of::<Self>()
    }

    fn describe(&self) -> Summary {
        Summary::default().with_fact("number", self.0)
    }

    fn parts(&self) -> Parts<'_> {
        Parts::default()
    }
}

impl Memo for Number {
    const NAME: &'static str = "Number";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&self.0);
    }

    fn size(&self) -> usize {
        size_of::<Self>()
    }
}

/// The number whose computations are counted in `GIVEN`: how often a [`Give`] node has returned it. Only one test uses this number, because
/// tests run in parallel.
const COUNTED: f64 = 7.25;
static GIVEN: AtomicUsize = AtomicUsize::new(0);

/// Returns a number.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Give {
    /// The number.
    number: f64,
}

impl Node for Give {
    type Outputs = (Number,);
    const OUTPUTS: [&'static str; 1] = ["number"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        if self.number == COUNTED {
            GIVEN.fetch_add(1, Ordering::SeqCst);
        }
        Ok((Number(self.number),))
    }
}

/// Adds any number of numbers; returns their sum and their mean.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Sum {
    /// The numbers.
    #[serde(default)]
    numbers: Vec<In<Number>>,
    /// A constant that is added.
    more: Option<In<Number>>,
}

impl Node for Sum {
    type Outputs = (Number, Number);
    const OUTPUTS: [&'static str; 2] = ["sum", "mean"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let numbers = self.numbers.iter().chain(&self.more).map(|number| cx.get(number).0);
        let sum: f64 = numbers.clone().sum();
        let count = Number(numbers.count() as f64);
        let half = cx.memo(&count, halve)?;
        cx.warn(format!("half of {} is {}", count.0, half.0));
        Ok((Number(sum), Number(sum / count.0)))
    }
}

/// The number of times that `halve` was called with 3, the count of the numbers in a sum. Only one test computes the sum of three numbers.
static HALVED: AtomicUsize = AtomicUsize::new(0);

fn halve(number: &Number) -> Result<Number, Error> {
    if number.0 == 3.0 {
        HALVED.fetch_add(1, Ordering::SeqCst);
    }
    Ok(Number(number.0 / 2.0))
}

/// Waits for another node of its type to start. It finishes only if two such nodes run at the same time.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Meet {
    /// The name of this node, which distinguishes it from the other one.
    name: String,
}

static MEETING: Barrier = Barrier::new(2);

impl Node for Meet {
    type Outputs = (Number,);
    const OUTPUTS: [&'static str; 1] = ["number"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        MEETING.wait();
        Ok((Number(self.name.len() as f64),))
    }
}

/// Panics.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Panic {}

impl Node for Panic {
    type Outputs = (Number,);
    const OUTPUTS: [&'static str; 1] = ["number"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        panic!("nobody expected this");
    }
}

/// Runs for a long time, unless it is cancelled.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Work {
    /// True if it works in a parallel loop that does not look for cancellation.
    #[serde(default)]
    in_parallel: bool,
}

impl Node for Work {
    type Outputs = (Number,);
    const OUTPUTS: [&'static str; 1] = ["number"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        if self.in_parallel {
            cx.tick(0.1)?;
            let steps = (0..6000_usize).into_par_iter();
            steps.for_each(|_| std::thread::sleep(Duration::from_millis(10)));
            return Ok((Number(1.0),));
        }
        for step in 0..3000 {
            cx.tick(f64::from(step) / 3000.0)?;
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok((Number(0.0),))
    }
}

const PACK: Pack = Pack {
    name: "numbers",
    nodes: &[node::<Give>(), node::<Sum>(), node::<Meet>(), node::<Panic>(), node::<Work>()],
    values: &[value_type::<Number>()],
    ..Pack::EMPTY
};

fn load(nodes: &str) -> Graph {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("graph.ron");
    std::fs::write(&path, format!("Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{}})"))
        .unwrap();
    let checked = Graph::load(&path, &Catalog::new(&[&PACK]), &Options::default());
    checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
}

fn evaluate(graph: &Graph, threads: usize) -> Evaluation {
    Evaluator::new(threads, 1 << 20).unwrap().evaluate_all_nodes(
        graph,
        &(),
        &CancelToken::default(),
    )
}

fn number(evaluation: &Evaluation, graph: &Graph, node: &str, output: &str) -> f64 {
    evaluation.find(graph, node, output).unwrap().get::<Number>().unwrap().0
}

#[test]
fn equal_nodes_are_computed_once_and_their_results_shared() {
    let twins: String = (0..50).map(|k| format!("\"n{k}\": Give(number: 7.25),")).collect();
    let graph = load(&twins);
    let evaluation = evaluate(&graph, 8);
    assert_eq!(GIVEN.load(Ordering::SeqCst), 1);
    assert_eq!(evaluation.trace().count(State::Computed), 1);
    assert_eq!(evaluation.trace().count(State::Cached), 49);
    assert_eq!(number(&evaluation, &graph, "n33", ""), 7.25);
}

#[test]
fn a_port_takes_many_links_an_optional_one_and_nodes_have_several_outputs() {
    let graph = load(
        r#""a": Give(number: 1), "b": Give(number: 2), "all": Sum(numbers: ["a", "b", "a"], more: "b"),
           "none": Sum(), "again": Sum(numbers: ["all.mean", "all"])"#,
    );
    let evaluation = evaluate(&graph, 2);
    assert_eq!(number(&evaluation, &graph, "all", "sum"), 6.0);
    assert_eq!(number(&evaluation, &graph, "all", "mean"), 1.5);
    assert_eq!(number(&evaluation, &graph, "none", "sum"), 0.0);
    assert_eq!(number(&evaluation, &graph, "again", "sum"), 7.5);
    let warnings: Vec<_> =
        evaluation.diagnostics().into_iter().map(|problem| problem.message).collect();
    assert!(warnings.contains(&"`all`: half of 4 is 2".to_owned()), "{warnings:?}");
}

#[test]
fn a_memo_is_computed_once_for_equal_parts() {
    let graph = load(
        r#""a": Give(number: 1), "b": Give(number: 2), "c": Give(number: 3),
           "x": Sum(numbers: ["a", "b", "c"]), "y": Sum(numbers: ["b", "x", "c"]), "z": Sum(numbers: ["y", "x", "a"])"#,
    );
    let evaluation = evaluate(&graph, 1);
    assert_eq!(evaluation.trace().count(State::Computed), 6);
    assert_eq!(HALVED.load(Ordering::SeqCst), 1);
}

#[test]
fn independent_nodes_run_at_the_same_time() {
    let graph = load(r#""one": Meet(name: "one"), "other": Meet(name: "other")"#);
    let evaluation = evaluate(&graph, 2);
    assert_eq!(evaluation.trace().count(State::Computed), 2);
}

#[test]
fn a_panic_is_caught_at_its_node_and_reported_as_a_bug() {
    let graph = load(
        r#""bad": Panic(), "after": Sum(numbers: ["bad"]), "good": Give(number: 5), "fine": Sum(numbers: ["good"])"#,
    );
    let evaluation = evaluate(&graph, 2);
    expect![[r#"
        failed   bad    panicked: nobody expected this
        skipped  after  depends on `bad`
        computed good   not computed before
        computed fine   not computed before
    "#]]
    .assert_eq(&evaluation.trace().to_string());
    let bug = evaluation.diagnostics().into_iter().find(|problem| problem.code == "G018").unwrap();
    assert_eq!(bug.message, "`bad` cannot be computed: panicked: nobody expected this");
    assert!(bug.help.contains("bug"));
}

#[test]
fn a_cancelled_evaluation_stops_within_a_tenth_of_a_second() {
    struct Canceller(CancelToken);
    impl Observer for Canceller {
        fn on_progress(&self, _: &str, share: f64) {
            if share > 0.001 {
                self.0.cancel();
            }
        }
    }
    let mut evaluator = Evaluator::new(2, 1 << 20).unwrap();
    for node in ["Work()", "Work(in_parallel: true)"] {
        let graph = load(&format!("\"long\": {node}"));
        let observer = Canceller(CancelToken::default());
        let start = Instant::now();
        let evaluation = evaluator.evaluate_all_nodes(&graph, &observer, &observer.0);
        assert_eq!(evaluation.trace().to_string(), "failed   long  cancelled\n");
        assert!(start.elapsed() < Duration::from_secs(5), "the work takes 30 s");
    }
    // The cancelled evaluation must leave nothing in the cache.
    let again = evaluator.evaluate_all_nodes(
        &load(r#""n": Give(number: 1)"#),
        &(),
        &CancelToken::default(),
    );
    assert_eq!(again.trace().count(State::Computed), 1);
}

#[test]
fn a_long_chain_is_evaluated_without_a_deep_stack() {
    let chain: String =
        (1..20_000).map(|k| format!("\"n{k}\": Sum(numbers: [\"n{}\"]),", k - 1)).collect();
    let graph = load(&format!("\"n0\": Give(number: 3), {chain}"));
    let evaluation = evaluate(&graph, 2);
    assert_eq!(number(&evaluation, &graph, "n19999", "sum"), 3.0);
}

/// Regression test: a node that became ready while the first nodes were still being started was started twice.
#[test]
fn each_node_is_visited_once_however_early_it_becomes_ready() {
    struct Ends(AtomicUsize);
    impl Observer for Ends {
        fn on_finish(&self, _: &str, _: State, _: f64) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }
    const PAIRS: usize = 1000;
    let nodes = (0..PAIRS)
        .map(|k: usize| format!("\"a{k}\": Give(number: {k}), "))
        .chain((0..PAIRS).map(|k: usize| format!("\"b{k}\": Sum(numbers: [\"a{k}\"]), ")));
    let graph = load(&nodes.collect::<String>());
    for _ in 0..20 {
        let ends = Ends(AtomicUsize::new(0));
        let mut evaluator = Evaluator::new(2, 1 << 24).unwrap();
        evaluator.evaluate_all_nodes(&graph, &ends, &CancelToken::default());
        assert_eq!(ends.0.into_inner(), 2 * PAIRS);
    }
}
