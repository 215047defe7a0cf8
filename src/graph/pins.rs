//! Pins: results of nodes that are kept beside the graph, `doll.pins.ron` and `doll.pins/` beside `doll.ron`, until they are unpinned.
//!
//! In a graph with pins other nodes stand in the place of the pinned ones: each gives the values that were kept and hangs on nothing. So the
//! evaluator knows nothing of pins, and what hangs on a pinned node has its key by the hashes of the values, as always.
//!
//! The bytes lie beside the graph and not in the cache of results: the cache is of one build of one program, may be cleared at any time,
//! and does not go along when the project is copied.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Problem, Severity, Source, Span};
use maquette_value::{AnyValue, Hash};

pub(crate) mod ancestry;
pub(crate) mod bytes;
mod sidecar;

pub use ancestry::Ancestry;
pub use bytes::write as bytes_of;

/// The ending of the file beside a graph that says which nodes are pinned.
pub const ENDING: &str = "pins.ron";

/// What stands for a node whose result is pinned.
pub const PINNED: &str = "Pinned";

/// The pins of a graph, by the names of nodes.
#[derive(Default)]
pub struct Pins {
    pub pins: BTreeMap<String, Pin>,
    /// The folder of the kept values.
    pub folder: PathBuf,
    /// The file that says all this.
    source: Arc<Source>,
}

/// A kept result.
pub struct Pin {
    /// The type and the hash of each output.
    pub outputs: Vec<(String, Hash)>,
    /// What it was computed from.
    pub(crate) ancestry: Ancestry,
    /// Where the file says it.
    pub span: Span,
}

impl Pin {
    pub fn new(values: &[AnyValue], ancestry: Ancestry) -> Self {
        let outputs = values.iter().map(|value| (value.kind().name.to_owned(), value.hash()));
        Self { outputs: outputs.collect(), ancestry, span: Span::default() }
    }

    /// The file of its values in the folder of a graph's pins.
    pub fn file(&self, folder: &Path) -> PathBuf {
        let hashes: Vec<_> = self.outputs.iter().flat_map(|(_, hash)| hash.0).collect();
        folder.join(Hash::of(&hashes).to_string())
    }
}

impl Pins {
    pub fn problem(
        &self,
        span: Span,
        code: &'static str,
        message: String,
        help: String,
    ) -> Problem {
        let place = (self.source.clone(), span);
        Problem { help, ..Problem::new(Severity::Error, code, place, message) }
    }
}
