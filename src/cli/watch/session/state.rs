//! The check result and the running evaluation of a watch.

use std::path::Path;
use std::sync::Arc;

use maquette_graph::Graph;
use maquette_node::CancelToken;
use maquette_syntax::error::{Diagnostic, code};

use crate::watch::worker::Purpose;

/// The state of checking the graph.
pub(super) enum Check {
    /// The graph must be read and checked again.
    Due,
    /// The graph can be evaluated. The diagnostics are only warnings.
    Good { graph: Arc<Graph>, diagnostics: Vec<Diagnostic> },
    /// The graph has errors. `shown` is true if the user has seen them.
    Bad { diagnostics: Vec<Diagnostic>, shown: bool },
}

/// A running evaluation.
pub(super) struct Running {
    pub(super) graph: Arc<Graph>,
    pub(super) cancel: CancelToken,
    pub(super) purpose: Purpose,
    /// True if nodes of unknown types are left out of the graph.
    pub(super) is_partial: bool,
}

impl Running {
    /// Returns true if the evaluation is only for live pages and was cancelled.
    pub(super) fn is_abandoned(&self) -> bool {
        self.cancel.is_cancelled() && self.purpose != Purpose::Outputs
    }
}

/// Returns true if one of the diagnostics is about a node of unknown type.
pub(super) fn is_partial(diagnostics: &[Diagnostic]) -> bool {
    diagnostics.iter().any(|diagnostic| diagnostic.code == code::UNKNOWN_NODE)
}

/// Makes `folder` the current folder again, in case it was replaced, for instance by a new checkout. Otherwise relative paths would be
/// resolved in the deleted folder.
#[cfg(unix)]
pub(super) fn return_to(folder: &Path) {
    use std::os::unix::fs::MetadataExt;
    fn file_id(path: &Path) -> Option<(u64, u64)> {
        let metadata = std::fs::metadata(path).ok()?;
        Some((metadata.dev(), metadata.ino()))
    }
    if file_id(folder) != file_id(Path::new(".")) {
        // Ignore an error: if the folder is missing, the graph cannot be read either, and that is reported.
        let _ = std::env::set_current_dir(folder);
    }
}

/// Does nothing, because on this system the current folder cannot be removed.
#[cfg(not(unix))]
pub(super) fn return_to(_: &Path) {}
