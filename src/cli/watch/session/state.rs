//! What a watch knows of its graph and of the run under way.

use std::path::Path;
use std::sync::Arc;

use maquette_graph::Graph;
use maquette_node::CancelToken;
use maquette_syntax::error::{Problem, code};

use crate::watch::worker::Purpose;

/// What is known of the graph's text.
pub(super) enum Check {
    /// It has to be read.
    Due,
    /// It can be evaluated; the problems are warnings.
    Good { graph: Arc<Graph>, problems: Vec<Problem> },
    /// It has errors, and whether they have been shown.
    Bad { problems: Vec<Problem>, shown: bool },
}

/// A run under way.
pub(super) struct Running {
    pub(super) graph: Arc<Graph>,
    pub(super) cancel: CancelToken,
    pub(super) purpose: Purpose,
    /// Whether it lacks nodes of unknown types.
    pub(super) is_part: bool,
}

impl Running {
    /// A look may be over in the moment in which it is given up.
    pub(super) fn is_left(&self) -> bool {
        self.cancel.is_cancelled() && self.purpose != Purpose::Outputs
    }
}

/// Whether there are nodes of unknown types in the graph.
pub(super) fn is_part(problems: &[Problem]) -> bool {
    problems.iter().any(|problem| problem.code == code::UNKNOWN_NODE)
}

/// Enters a folder again if another one has taken its place, as after a new checkout: relative paths lead to the current one.
#[cfg(unix)]
pub(super) fn return_to(folder: &Path) {
    use std::os::unix::fs::MetadataExt;
    fn place(path: &Path) -> Option<(u64, u64)> {
        let metadata = std::fs::metadata(path).ok()?;
        Some((metadata.dev(), metadata.ino()))
    }
    if place(folder) != place(Path::new(".")) {
        // If it is not there either, the graph cannot be read, which is reported.
        let _ = std::env::set_current_dir(folder);
    }
}

/// On other systems nobody can remove the current folder.
#[cfg(not(unix))]
pub(super) fn return_to(_: &Path) {}
