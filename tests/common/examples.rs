//! The example graphs, at least one for each node type.

use std::path::{Path, PathBuf};

/// Returns all graphs of `graphs/nodes` sorted by name, without the test files (`.test.ron`).
pub(crate) fn examples() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/nodes");
    let files = std::fs::read_dir(folder).expect("the folder of examples").flatten();
    let mut graphs: Vec<_> = files
        .map(|file| file.path())
        .filter(|path| {
            let name = path.to_string_lossy();
            name.ends_with(".ron") && !name.ends_with(".test.ron")
        })
        .collect();
    graphs.sort();
    graphs
}
