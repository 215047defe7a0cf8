//! Pins: results of nodes that are stored next to the graph until they are unpinned. The pins of `doll.ron` are in `doll.pins.ron` and in
//! the folder `doll.pins/`.
//!
//! When a graph with pins is read, each pinned node is replaced by a node without dependencies that returns the stored values. The
//! evaluator needs no special case. The cache keys of dependent nodes contain the hashes of the stored values, as for any other values.
//!
//! The values are not stored in the cache of results, because the cache belongs to one build of one program, may be cleared at any time,
//! and is not copied with the project.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Severity, Source, Span};
use maquette_value::{AnyValue, Hash};

pub(crate) mod ancestry;
pub(crate) mod bytes;
mod sidecar;

pub use ancestry::Ancestry;
pub use bytes::write as bytes_of;

/// The extension of the file that lists the pinned nodes of a graph.
pub const EXTENSION: &str = "pins.ron";

/// The type name of nodes that replace pinned ones.
pub const PINNED: &str = "Pinned";

/// The pins of a graph, by the names of the nodes.
#[derive(Default)]
pub struct Pins {
    pub pins: BTreeMap<String, Pin>,
    /// The folder that contains the stored values of all pinned nodes.
    pub folder: PathBuf,
    /// The file that lists the pins, for diagnostics.
    source: Arc<Source>,
}

/// The stored result of a pinned node.
pub struct Pin {
    /// For each output of the node, the name of its value type and the hash of its value.
    pub outputs: Vec<(String, Hash)>,
    /// The nodes, parameters and files from which the result was computed.
    pub(crate) ancestry: Ancestry,
    /// The position of the pin in the file that lists the pins.
    pub span: Span,
}

impl Pin {
    pub fn new(values: &[AnyValue], ancestry: Ancestry) -> Self {
        let outputs = values.iter().map(|value| (value.kind().name.to_owned(), value.hash()));
        Self { outputs: outputs.collect(), ancestry, span: Span::default() }
    }

    /// Returns the path of the file with the stored values. `folder` is the folder of the graph's pins.
    pub fn file(&self, folder: &Path) -> PathBuf {
        let hashes: Vec<_> = self.outputs.iter().flat_map(|(_, hash)| hash.0).collect();
        folder.join(Hash::compute(&hashes).to_string())
    }
}

impl Pins {
    pub fn diagnostic(
        &self,
        span: Span,
        code: &'static str,
        message: String,
        help: String,
    ) -> Diagnostic {
        let place = (self.source.clone(), span);
        Diagnostic { help, ..Diagnostic::new(Severity::Error, code, place, message) }
    }
}
