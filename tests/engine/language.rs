//! The graph language: the check must report each error once, at its position.

mod merge_sample;
mod merged_comments;
mod merging;
mod migrations;
mod old_names;
mod versions;

use std::path::Path;

use expect_test::expect_file;

use crate::graph_files::problems;

mod both_ends;
mod chains;
mod derived;
mod differences;
mod documentation;
mod drafts;
mod each;
mod elements;
mod empty_lists;
mod hyphens;
mod library_expectations;
mod limits;
mod listed;
mod minimal;
mod patches;
mod promises;
mod recovery;
mod rules;
mod units;
mod vectors;
mod verdicts;
mod zeros;

/// Each graph in `tests/bad` contains two errors of one kind. The file `NAME.txt` next to it lists the expected diagnostics.
#[test]
fn each_mistake_is_told_once_at_its_place() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/bad");
    let files = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path());
    let graphs = files.filter(|path| {
        let name = path.to_string_lossy();
        name.ends_with(".ron") && !name.ends_with(".pins.ron")
    });
    let graphs = Vec::from_iter(graphs);
    for path in &graphs {
        let told = problems(path);
        assert!(told.lines().count() > 1, "{}: {told}", path.display());
        expect_file![path.with_extension("txt")].assert_eq(&told);
    }
    assert!(!graphs.is_empty(), "there is nothing to judge");
}
