//! What results are counted as is what they hold: everything that is allocated is counted, so these tests have a process of their own.

#![allow(
    unsafe_code,
    reason = "an allocator is unsafe; this one hands everything on to the system's"
)]

#[path = "common/examples.rs"]
mod examples;

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard};

use maquette::{CancelToken, Catalog, Evaluator, Graph, Options};

/// Counts what is allocated.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator, with what was given.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        NOW.fetch_add(layout.size(), Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        NOW.fetch_add(layout.size(), Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// One test at a time: the other's memory would count, too.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// What an evaluator holds beside results: its threads, what it knows of nodes and files, and tables that are made once.
const BASE: usize = 2 << 20;

/// The evaluator after all nodes of a graph were computed, whose values nobody holds, and how many bytes more than before are allocated;
/// with this many bytes for results.
fn evaluated(path: &Path, memory: usize) -> (Evaluator, usize) {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let graph = Graph::load(path, &catalog, &Options::default()).graph.unwrap();
    let before = NOW.load(Relaxed);
    let mut evaluator = Evaluator::new(2, memory).unwrap();
    drop(evaluator.evaluate_all_nodes(&graph, &(), &CancelToken::default()));
    let held = NOW.load(Relaxed).saturating_sub(before);
    (evaluator, held)
}

fn graphs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs")
}

#[test]
fn results_hold_what_they_are_counted_as() {
    let _alone = alone();
    for path in examples::examples() {
        let (evaluator, held) = evaluated(&path, 1 << 30);
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
    let _alone = alone();
    let path = graphs().join("doll.ron");
    let (evaluator, _) = evaluated(&path, 1 << 30);
    let all = evaluator.memory();
    drop(evaluator);
    for part in [2, 5, 20] {
        let allowed = all / part;
        let (evaluator, held) = evaluated(&path, allowed);
        assert!(evaluator.memory() <= allowed);
        assert!(held <= allowed + allowed / 5 + BASE, "{held} bytes are held, {allowed} allowed");
    }
}
