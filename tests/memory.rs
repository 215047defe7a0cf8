//! The memory that the engine counts for results is their real memory. Every allocation of the process is counted, so these tests run in a
//! process of their own.

#![allow(
    unsafe_code,
    reason = "an allocator is unsafe; this one hands everything on to the system's"
)]

#[path = "common/examples.rs"]
mod examples;

use std::alloc::{GlobalAlloc, Layout, System};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard};

use maquette::{CancelToken, Catalog, Evaluator, Graph, Observer, Options, State};

/// An allocator that counts the allocated bytes.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);

/// The maximum of `NOW` since `PEAK` was last reset. `NOW` is the number of allocated bytes.
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn add(bytes: usize) {
    let now = NOW.fetch_add(bytes, Relaxed) + bytes;
    PEAK.fetch_max(now, Relaxed);
}

// SAFETY: every call is forwarded to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: guaranteed by the caller.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: guaranteed by the caller.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: guaranteed by the caller.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Only one test runs at a time: the memory of another test would be counted, too.
fn lock_memory() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// Maximum memory of an evaluator besides results: its threads, its tables of nodes and files, and tables that are made once.
const BASE: usize = 2 << 20;

/// Computes all nodes of a graph with `memory` bytes for results, and drops their values. Returns the evaluator and the number of bytes
/// that stay allocated.
fn evaluate(path: &Path, memory: usize) -> (Evaluator, usize) {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let graph = Graph::load(path, &catalog, &Options::default()).graph.unwrap();
    let before = NOW.load(Relaxed);
    let mut evaluator = Evaluator::new(2, memory).unwrap();
    drop(evaluator.evaluate_all_nodes(&graph, &(), &CancelToken::default()));
    let held = NOW.load(Relaxed).saturating_sub(before);
    (evaluator, held)
}

fn graphs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs")
}

#[test]
fn results_hold_what_they_are_counted_as() {
    let _alone = lock_memory();
    for path in examples::examples() {
        let (evaluator, held) = evaluate(&path, 1 << 30);
        let counted = evaluator.memory();
        assert!(
            held <= counted + counted / 5 + BASE,
            "{}: {held} bytes are held, {counted} are counted",
            path.display()
        );
    }
}

#[test]
fn results_hold_no_more_than_they_may() {
    let _alone = lock_memory();
    let path = graphs().join("doll.ron");
    let (evaluator, _) = evaluate(&path, 1 << 30);
    let all = evaluator.memory();
    drop(evaluator);
    for part in [2, 5, 20] {
        let allowed = all / part;
        let (evaluator, held) = evaluate(&path, allowed);
        assert!(evaluator.memory() <= allowed);
        assert!(held <= allowed + allowed / 5 + BASE, "{held} bytes are held, {allowed} allowed");
    }
}

/// Records, for each node, the maximum number of bytes that were allocated in addition while the node ran.
#[derive(Default)]
struct Peaks {
    began: AtomicUsize,
    peaks: Mutex<Vec<(String, usize)>>,
}

impl Observer for Peaks {
    fn on_start(&self, _: &str) {
        let now = NOW.load(Relaxed);
        PEAK.store(now, Relaxed);
        self.began.store(now, Relaxed);
    }

    fn on_finish(&self, node: &str, _: State, _: f64) {
        let peak = PEAK.load(Relaxed) - self.began.load(Relaxed);
        self.peaks.lock().unwrap().push((node.to_owned(), peak));
    }
}

/// Returns, for each node with a memory estimate, its type, the estimate, and the memory that it really used. Only one node runs at a time.
fn measure(text: &str) -> Vec<(String, f64, f64)> {
    let path = graphs().join("measured.ron");
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let options = Options::default().with_text(&path, text);
    let checked = Graph::load(&path, &catalog, &options);
    let graph =
        checked.graph.unwrap_or_else(|| panic!("{text}: {}", checked.diagnostics[0].message));
    let peaks = Peaks::default();
    let mut evaluator = Evaluator::new(1, 1 << 32).unwrap();
    let evaluation = evaluator.evaluate_all_nodes(&graph, &peaks, &CancelToken::default());
    let peaks = peaks.peaks.into_inner().unwrap();
    let trace = evaluation.trace();
    let said = trace.0.iter().filter_map(|node| {
        assert_eq!(node.state, State::Computed, "{text}: {}", node.reason);
        let (_, peak) = peaks.iter().find(|(name, _)| *name == node.name)?;
        Some((node.node.clone(), node.estimate?, *peak as f64))
    });
    said.collect()
}

/// Returns a graph with these nodes, which may use the nodes `doll`, `mug`, `scan`, `ring`, `grid`, `net` and `vase`.
fn graph_of(nodes: &str) -> String {
    format!(
        r#"Graph(format: 1, nodes: {{
            "doll": ReadMesh(path: "doll/coarse.obj"),
            "mug": ReadMesh(path: "doll/mug.obj"),
            "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
            "ring": ReadCurve(path: "doll/ellipse.obj"),
            "grid": Triangulate(range: "scan.range"),
            "net": Revolve(profile: [(0, 0), (30, 0), (45, 40), (12, 70), (20, 90)]),
            "vase": Nurbs(net: "net"),
            {nodes}
        }}, outputs: {{}})"#
    )
}

/// Nodes with so much data that constant allocations do not matter.
const LARGE: [&str; 27] = [
    r#""a": Subdivide(mesh: "doll", scheme: Loop, levels: 5)"#,
    r#""a": Subdivide(mesh: "doll", scheme: Loop, levels: 5, limit: true)"#,
    r#""a": Subdivide(mesh: "doll", scheme: CatmullClark, levels: 5)"#,
    r#""a": Subdivide(mesh: "mug", scheme: CatmullClark, levels: 6, limit: true, corners: Smooth)"#,
    r#""a": Subdivide(mesh: "doll", scheme: DooSabin, levels: 5)"#,
    r#""a": Subdivide(mesh: "doll", scheme: DooSabin, levels: 5, limit: true)"#,
    r#""a": Subdivide(mesh: "grid", scheme: Loop, levels: 2, boundary: None)"#,
    r#""a": Subdivide(mesh: "grid", scheme: Loop, levels: 2, limit: true, split: true)"#,
    r#""a": SubdivideCurve(curve: "ring", scheme: Chaikin, levels: 16)"#,
    r#""a": SubdivideCurve(curve: "ring", scheme: Cubic, levels: 16)"#,
    r#""a": Tessellate(surface: "vase", u: 1000, v: 1000)"#,
    r#""a": Tessellate(surface: "vase", tolerance: 0.001)"#,
    r#""fine": SubdivideCurve(curve: "ring", scheme: Cubic, levels: 10), "a": Tube(curve: "fine", radius: 0.01, sides: 30)"#,
    r#""a": GaussianSurface(u: 600, v: 600, points: [(at: (0, 0), to: (0, 0, 0)), (at: (0, 1), to: (0, 9, 0)), (at: (1, 0), to: (9, 0, 0))])"#,
    r#""a": GaussianSurface(u: 600, v: 600, through: true, points: [(at: (0, 0), to: (0, 0, 0)), (at: (0, 1), to: (0, 9, 0)), (at: (1, 0), to: (9, 0, 0))])"#,
    r#""a": Reconstruct(points: ["grid"])"#,
    r#""a": Reconstruct(points: ["scan.range"], normals: Estimated, faces: Quads, skin: Open)"#,
    r#""fine": Subdivide(mesh: "doll", scheme: Loop, levels: 3), "a": Reconstruct(points: ["fine"], spacing: 0.7)"#,
    r#""a": FillHoles(mesh: "grid", holes: All, method: ThinPlate)"#,
    r#""a": FillHoles(mesh: "grid", holes: All, method: Membrane)"#,
    r#""a": FillHoles(mesh: "grid", holes: Largest)"#,
    r#""fine": Subdivide(mesh: "doll", scheme: Loop, levels: 3), "a": Interpolate(mesh: "fine", scheme: Loop)"#,
    r#""fine": Subdivide(mesh: "mug", scheme: CatmullClark, levels: 3), "a": Interpolate(mesh: "fine", scheme: CatmullClark, foot: Closest, solver: Plain)"#,
    r#""fine": Subdivide(mesh: "doll", scheme: Loop, levels: 2), "a": Interpolate(mesh: "fine", scheme: Loop, solver: Direct)"#,
    r#""many": Handles(mesh: "doll", on: Farthest(900)), "a": Ffd(mesh: "grid", layout: "many", mode: Displacement, space: World, handles: [(at: (0, 0, 500), to: (0, 0, 505), sigma: (5, 5, 5))])"#,
    r#""fine": Subdivide(mesh: "doll", scheme: Loop, levels: 5), "a": Merge(meshes: ["fine", "fine", "grid"])"#,
    r##""red": Threshold(image: "scan.color", select: Near(color: "#c33923", distance: 30.0)), "spots": Label(mask: "red"), "nose": ExtractRegion(labels: "spots", range: "scan.range"), "points": ControlNet(region: "nose", range: "scan.range"), "surface": Nurbs(net: "points"), "a": Blend(range: "scan.range", region: "nose", surface: "surface", resample: (8, 8))"##,
];

/// Checks that each node uses at most 1.1 times its memory estimate, and at least a quarter of the estimate.
#[test]
fn nodes_need_about_as_much_as_they_say() {
    let _alone = lock_memory();
    let texts: Vec<_> = LARGE.iter().map(|nodes| graph_of(nodes)).collect();
    let mut kinds = BTreeSet::new();
    for text in texts {
        for (kind, said, took) in measure(&text) {
            assert!(
                took <= 1.1 * said && said <= 4.0 * took,
                "{kind} said {said:.0} bytes and took {took:.0}: {text}"
            );
            kinds.insert(kind);
        }
    }
    assert!(kinds.len() > 10, "{kinds:?}");
}

/// Checks the estimates of the nodes in the example graphs. These nodes are small, so a constant amount of memory is allowed in addition.
#[test]
fn nodes_of_examples_need_no_more_than_they_say() {
    let _alone = lock_memory();
    for path in examples::examples() {
        let text = std::fs::read_to_string(&path).unwrap().replace("../doll/", "doll/");
        for (kind, said, took) in measure(&text) {
            assert!(took <= 1.1 * said + BASE as f64, "{kind} said {said} bytes and took {took}");
        }
    }
}

#[test]
fn twelve_levels_of_a_million_faces_are_refused_before_anything_is_allocated() {
    let _alone = lock_memory();
    let path = graphs().join("measured.ron");
    let text = graph_of(
        r#""million": Tessellate(surface: "vase", u: 1000, v: 1000),
        "fine": Subdivide(mesh: "million", scheme: CatmullClark, levels: 12),
        "other": Subdivide(mesh: "mug", scheme: CatmullClark, levels: 1)"#,
    );
    let options = Options::default().with_text(&path, text);
    let graph = Graph::load(&path, &Catalog::new(maquette_nodes::PACKS), &options).graph.unwrap();
    let mut evaluator = Evaluator::new(1, 1 << 31).unwrap().with_max_memory(4_000_000_000);
    drop(evaluator.evaluate_nodes(&graph, &["million"]));
    let before = NOW.load(Relaxed);
    PEAK.store(before, Relaxed);
    let evaluation = evaluator.evaluate_nodes(&graph, &["fine", "other"]);
    let peak = PEAK.load(Relaxed) - before;
    let problems = evaluation.diagnostics();
    assert_eq!(problems.len(), 1, "{problems:?}");
    let message = &problems[0].message;
    assert!(
        message.starts_with("`fine` cannot be computed: it would need ")
            && message.contains(" PB, ")
            && message.contains("4.0 GB are allowed in all: choose fewer `levels`, or allow more"),
        "{message}"
    );
    assert!(peak < 1 << 20, "{peak} bytes were allocated");
    let trace = evaluation.trace();
    assert!(trace.0.iter().any(|node| node.name == "other" && node.state == State::Computed));
}
