//! The graphs that show a node each.

use std::path::{Path, PathBuf};

/// All graphs of `graphs/nodes`, by name; not the tests that stand beside them.
pub(crate) fn examples() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/nodes");
    let files = std::fs::read_dir(folder).expect("the folder of examples").flatten();
    let is_graph = |path: &PathBuf| {
        let name = path.to_string_lossy();
        name.ends_with(".ron") && !name.ends_with(".test.ron")
    };
    let mut graphs = Vec::from_iter(files.map(|file| file.path()).filter(is_graph));
    graphs.sort();
    graphs
}
