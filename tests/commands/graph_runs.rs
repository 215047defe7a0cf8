//! Runs graphs as they stand: those in `../shared/graphs`, which the project's design declares valid (skipped if this folder does not
//! exist), and those in `tests/shapes`, which state by `expect` what is right for shapes on which other programs fail.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use crate::beside::shared_folder;
use crate::output::stderr_of;
use crate::project::Project;

/// Runs a graph; returns an error if it fails or does not write its outputs.
fn run(graph: &Path) -> Result<(), String> {
    let name = graph.file_name().unwrap().to_string_lossy();
    let project = Project::empty();
    let out = project.folder().join("out");
    let output = project.command(&["run", "--json", "--out", "out"]).arg(graph).output().unwrap();
    if !output.status.success() {
        return Err(format!("{name}: {}\n{}", output.status, stderr_of(&output)));
    }
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let outputs = report["outputs"].as_array().unwrap();
    fn is_written(name: &str, out: &Path) -> bool {
        out.join(name).metadata().is_ok_and(|file| file.len() > 0)
    }
    let missing = outputs.iter().map(|output| output["name"].as_str().unwrap());
    let missing: Vec<&str> = missing.filter(|name| !is_written(name, &out)).collect();
    if outputs.is_empty() || !missing.is_empty() {
        return Err(format!("{name}: {} outputs, without {missing:?}", outputs.len()));
    }
    Ok(())
}

/// Runs all graphs of a folder, which must be at least `least`.
fn run_all(folder: &Path, least: usize) {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut graphs: Vec<PathBuf> =
        files.filter(|path| path.extension().is_some_and(|extension| extension == "ron")).collect();
    graphs.sort();
    assert!(graphs.len() >= least, "only {} graphs were run", graphs.len());
    let next = AtomicUsize::new(0);
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let failures = thread::scope(|scope| {
        let workers = (0..workers)
            .map(|_| {
                scope.spawn(|| {
                    let graphs =
                        std::iter::from_fn(|| graphs.get(next.fetch_add(1, Ordering::Relaxed)));
                    graphs.filter_map(|graph| run(graph).err()).collect::<Vec<_>>()
                })
            })
            .collect::<Vec<_>>();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect::<Vec<_>>()
    });
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Graphs that must be refused are tested in `tests/engine/graph_files.rs`.
#[test]
fn the_graphs_of_the_design_run_as_they_stand() {
    if let Some(folder) = shared_folder("graphs") {
        run_all(&folder, 10);
    }
}

#[test]
fn shapes_of_bug_reports_come_out_right() {
    run_all(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/shapes"), 3);
}
