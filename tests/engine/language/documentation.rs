//! Checks that each sample in the documentation is a complete file, which can be checked and run without changes.

use std::fs;
use std::path::Path;

use maquette::{Catalog, Diagnostic, Options, Run, Session, Settings, test_graphs};

/// A sample, with the name of its file relative to the folder of graphs.
struct Sample {
    name: String,
    text: String,
}

/// Returns the samples of each topic of the manual. If a sample begins with a comment that is a file name, it gets this name.
fn samples() -> Vec<(String, Vec<Sample>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../src/lsp/manual");
    let mut topics = Vec::new();
    for file in fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        if path.extension().is_none_or(|ending| ending != "md") {
            continue;
        }
        let topic = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let text = fs::read_to_string(&path).unwrap();
        // Leave out samples of sweeps, which are tested together with the command `maquette batch`.
        let samples = text.split("```ron\n").skip(1).filter(|rest| !rest.contains("Sweep(\n"));
        let samples = samples.enumerate().map(|(index, rest)| {
            let text = rest.split("```").next().unwrap().to_owned();
            let first = text.lines().next().unwrap_or_default().strip_prefix("// ");
            let is_test = text.lines().any(|line| line.starts_with("Test("));
            let ending = if is_test { "test.ron" } else { "ron" };
            let own = first.filter(|name| name.ends_with(".ron") && !name.contains(' '));
            let name = own.map_or_else(|| format!("{topic}-{index}.{ending}"), str::to_owned);
            Sample { name, text }
        });
        let samples = samples.collect();
        topics.push((topic, samples));
    }
    topics.sort_by(|(a, _), (b, _)| a.cmp(b));
    topics
}

/// Copies a folder of graphs, without its tests and the files that tests have written.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for file in fs::read_dir(from).unwrap() {
        let file = file.unwrap();
        let (path, name) = (file.path(), file.file_name());
        match path.is_dir() {
            true if name == "goldens" || name == "pictures" || name == "out" => {}
            true => copy(&path, &to.join(name)),
            false if name.to_string_lossy().ends_with(".test.ron") => {}
            false => drop(fs::copy(&path, to.join(name)).unwrap()),
        }
    }
}

fn diagnostics_text(problems: &[Diagnostic]) -> String {
    problems.iter().map(|problem| problem.to_text(false)).collect()
}

#[test]
fn every_sample_is_a_whole_file_that_runs() {
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    let temporary = tempfile::tempdir().unwrap();
    let (mut graph_count, mut case_count) = (0, 0);
    for (topic, samples) in samples() {
        let folder = temporary.path().join(&topic);
        copy(&graphs, &folder);
        for sample in &samples {
            let path = folder.join(&sample.name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, &sample.text).unwrap();
        }
        let tests = samples.iter().filter(|sample| sample.name.ends_with(".test.ron"));
        case_count += tests.map(|sample| run_sample(&folder, sample)).sum::<usize>();
        for sample in samples.iter().filter(|sample| !sample.name.ends_with(".test.ron")) {
            runs(&folder.join(&sample.name), &sample.text);
            graph_count += 1;
        }
    }
    assert!(graph_count > 10 && case_count > 4, "{graph_count} graphs, {case_count} cases");
}

/// Checks and runs a graph. A graph with inputs is only checked, because the sample that uses it runs it, too.
fn runs(path: &Path, text: &str) {
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory()).unwrap();
    let checked = session.load(path, &Options::default());
    let graph = checked
        .graph
        .unwrap_or_else(|| panic!("{}\n{text}", diagnostics_text(&checked.diagnostics)));
    assert_eq!(diagnostics_text(graph.unused_warnings()), "", "{text}");
    if graph.inputs().is_empty() {
        let run = session.run(&graph, &Run::default());
        let run = run.unwrap_or_else(|problems| panic!("{}\n{text}", diagnostics_text(&problems)));
        assert_eq!(diagnostics_text(&run.diagnostics()), "", "{text}");
    }
}

/// Runs a sample of a test file, and returns the number of its cases. Each case may fail only because its golden is missing.
fn run_sample(folder: &Path, sample: &Sample) -> usize {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let run = test_graphs(&folder.join(&sample.name), &catalog, 1).unwrap();
    let wrong = run.failures.iter().filter(|why| !why.contains("there is no golden"));
    assert_eq!(Vec::from_iter(wrong), [""; 0], "{}", sample.text);
    run.failures.len()
}
