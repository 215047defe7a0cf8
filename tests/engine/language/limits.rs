//! Limits of nodes. A node that needs too much memory is refused before it starts, a node that fits later waits, and a node that does not
//! stop is reported.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use maquette::value::Mask;
use maquette::{
    CancelToken, Catalog, Context, Error, Estimate, Evaluator, Graph, In, Node, Observer, Options,
    Pack, RunTrace, Severity, State, node,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Makes a mask of the given number of kilobytes and estimates as much memory.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Hold {
    /// The size in kilobytes.
    kb: u32,
    /// A value that changes the key.
    #[serde(default)]
    seed: u8,
    /// A node that must run before.
    after: Option<In<Mask>>,
}

/// The sum of the memory estimates of all running nodes (`UNDER_WAY`), and the largest value that this sum has had (`MOST`), in kilobytes.
static UNDER_WAY: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

impl Node for Hold {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn estimate(&self, _: &Context<'_>) -> Option<Estimate> {
        Some(Estimate { bytes: f64::from(self.kb) * 1e3, help: "hold less" })
    }

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        let kb = self.kb as usize;
        let now = UNDER_WAY.fetch_add(kb, Ordering::SeqCst) + kb;
        MOST.fetch_max(now, Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(30));
        UNDER_WAY.fetch_sub(kb, Ordering::SeqCst);
        // Make the mask slightly smaller than the estimate.
        let pixels = vec![self.seed % 2; kb * 1000 - 500];
        Ok((Mask::new(kb * 1000 - 500, 1, pixels)?,))
    }
}

/// Runs for a number of seconds, even if cancelled.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Deaf {
    /// The duration in seconds.
    seconds: f64,
}

impl Node for Deaf {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        std::thread::sleep(Duration::from_secs_f64(self.seconds));
        Ok((Mask::new(1, 1, vec![0])?,))
    }
}

const PACK: Pack = Pack { name: "greedy", nodes: &[node::<Hold>(), node::<Deaf>()], ..Pack::EMPTY };

/// A lock that lets only one test run at a time, because the tests share the counters.
static ALONE: Mutex<()> = Mutex::new(());

fn graph(nodes: &str) -> Graph {
    let path = Path::new("limits.ron");
    let text = format!("Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{}})");
    let options = Options::default().with_text(path, text);
    let checked = Graph::load(path, &Catalog::new(&[&PACK]), &options);
    checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
}

/// Creates an evaluator with four threads and a limit of one megabyte for results and running nodes together.
fn megabyte() -> Evaluator {
    Evaluator::new(4, 1 << 30).unwrap().with_max_memory(1_000_000)
}

fn states(trace: &RunTrace) -> Vec<(&str, State)> {
    trace.0.iter().map(|node| (&node.name[..], node.state)).collect()
}

#[test]
fn a_node_that_needs_too_much_is_refused_with_numbers_and_the_rest_goes_on() {
    let _alone = ALONE.lock();
    let graph = graph(
        r#""large": Hold(kb: 4200), "small": Hold(kb: 10), "next": Hold(kb: 20, after: "small"), "behind": Hold(kb: 1, after: "large")"#,
    );
    let mut evaluator = megabyte();
    let evaluation = evaluator.evaluate_all_nodes(&graph, &(), &CancelToken::default());
    let problems = evaluation.diagnostics();
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert_eq!(problems[0].severity, Severity::Error);
    let message = &problems[0].message;
    let need = "`large` cannot be computed: it would need 4.2 MB, ";
    let rest =
        " are held already and 1.0 MB are allowed in all: hold less, or allow more (--max-memory)";
    assert!(message.starts_with(need) && message.ends_with(rest), "{message}");
    let trace = evaluation.trace();
    let mut states = states(&trace);
    states.sort_unstable_by_key(|(name, _)| *name);
    let expected = [
        ("behind", State::Skipped),
        ("large", State::Failed),
        ("next", State::Computed),
        ("small", State::Computed),
    ];
    assert_eq!(states, expected);
}

#[test]
fn nodes_that_fit_one_after_the_other_wait_for_each_other() {
    let _alone = ALONE.lock();
    MOST.store(0, Ordering::SeqCst);
    // The results of earlier evaluations are not needed anymore, so they must be dropped to make room for new ones.
    let nodes = (0..8).map(|seed| format!("\"n{seed}\": Hold(kb: 400, seed: {seed}), "));
    let graph = graph(&nodes.collect::<String>());
    let mut evaluator = megabyte();
    let names: Vec<_> = (0..8).map(|seed| format!("n{seed}")).collect();
    for name in &names {
        let evaluation = evaluator.evaluate_nodes(&graph, &[name]);
        assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
    }
    assert!(evaluator.memory() <= 1_000_000, "{}", evaluator.memory());

    // Two of the four needed results fit into memory together, but not all four.
    let pairs = r#""a": Hold(kb: 300, seed: 9), "b": Hold(kb: 300, seed: 10), "c": Hold(kb: 300, seed: 11), "d": Hold(kb: 300, seed: 12),
        "x": Hold(kb: 1, after: "a"), "y": Hold(kb: 1, seed: 1, after: "b"), "z": Hold(kb: 1, seed: 2, after: "c"), "w": Hold(kb: 1, seed: 3, after: "d")"#;
    let graph = self::graph(pairs);
    MOST.store(0, Ordering::SeqCst);
    let evaluation = evaluator.evaluate_nodes(&graph, &["x", "y", "z", "w"]);
    assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
    let most = MOST.load(Ordering::SeqCst);
    assert!((300..=1000).contains(&most), "{most} kB were under way at a time");
}

#[test]
fn what_nobody_needs_makes_way_before_anything_is_refused() {
    let _alone = ALONE.lock();
    let mut evaluator = megabyte();
    for seed in 0..4 {
        let graph = graph(&format!("\"a\": Hold(kb: 700, seed: {seed})"));
        let evaluation = evaluator.evaluate_nodes(&graph, &["a"]);
        assert!(evaluation.diagnostics().is_empty(), "{:?}", evaluation.diagnostics());
        assert!(evaluator.memory() <= 1_000_000);
    }
}

#[test]
fn values_that_nodes_still_need_count() {
    let _alone = ALONE.lock();
    // The result of `first` must stay in memory until the nodes that use it have ended. So there is never enough memory for `second`.
    let graph = graph(
        r#""first": Hold(kb: 700), "second": Hold(kb: 700, seed: 1, after: "first"), "last": Hold(kb: 1, after: "second")"#,
    );
    let evaluation = megabyte().evaluate_nodes(&graph, &["last"]);
    let trace = evaluation.trace();
    let expected =
        [("first", State::Computed), ("second", State::Failed), ("last", State::Skipped)];
    assert_eq!(states(&trace), expected);
    let message = &evaluation.diagnostics()[0].message;
    assert!(message.contains("would need 700 kB, 700 kB are held already"), "{message}");
}

/// An observer that records which nodes are reported because they do not stop, and when.
struct Listening {
    cancel: CancelToken,
    began: Mutex<Option<Instant>>,
    told: Mutex<Vec<(String, f64)>>,
    cancels: AtomicBool,
}

impl Observer for Listening {
    fn on_start(&self, _: &str) {
        *self.began.lock().unwrap() = Some(Instant::now());
        if self.cancels.load(Ordering::SeqCst) {
            let cancel = self.cancel.clone();
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_millis(50));
                cancel.cancel();
            });
        }
    }

    fn on_unresponsive(&self, node: &str, kind: &str, pack: &str) {
        let seconds = self.began.lock().unwrap().unwrap().elapsed().as_secs_f64();
        self.told.lock().unwrap().push((format!("{node} {kind} {pack}"), seconds));
    }
}

#[test]
fn a_node_that_takes_no_notice_of_cancel_is_told_of_after_two_seconds() {
    let graph = graph(r#""deaf": Deaf(seconds: 3.0)"#);
    fn listening(cancels: bool) -> Listening {
        Listening {
            cancel: CancelToken::default(),
            began: Mutex::default(),
            told: Mutex::default(),
            cancels: AtomicBool::new(cancels),
        }
    }
    let mut evaluator = Evaluator::new(1, 1 << 20).unwrap();
    for (cancels, expected) in [(true, 1), (false, 0)] {
        let listening = listening(cancels);
        evaluator.forget();
        drop(evaluator.evaluate_all_nodes(&graph, &listening, &listening.cancel));
        let told = listening.told.into_inner().unwrap();
        assert_eq!(told.len(), expected, "{told:?}");
        for (words, seconds) in told {
            assert_eq!(words, "deaf Deaf greedy");
            assert!((1.9..2.9).contains(&seconds), "after {seconds} s");
        }
    }
}
