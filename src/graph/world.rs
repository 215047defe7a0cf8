//! The state shared by all files of a graph while they are checked.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Severity, Source, Span, Use, code};
use maquette_value::ValueType;

use crate::catalog::Catalog;
use crate::definition::Definition;
use crate::pins::Pins;
use crate::{Options, ReadFile};

/// The state shared by all files of a graph while they are checked.
pub struct World<'a> {
    pub(crate) catalog: &'a Catalog,
    pub(crate) options: &'a Options,
    pub roots: Vec<PathBuf>,
    pub(crate) values: BTreeMap<&'static str, &'static ValueType>,
    /// The files that have been read, by their resolved paths. `None` for a file whose ports are unknown.
    pub known: HashMap<PathBuf, Option<Arc<Definition>>>,
    /// The node types that `use` declares: the nesting depth of the use, the name of the type, and the graph.
    pub node_types: Vec<(usize, String, Arc<Definition>)>,
    /// The files that are being read, as resolved path and name. Each file uses the next one.
    pub(crate) open_files: Vec<(PathBuf, PathBuf)>,
    pub diagnostics: Vec<Diagnostic>,
    /// The files of all used graphs, including missing files.
    pub(crate) subgraphs: Vec<PathBuf>,
    /// The references from graphs to readable files of other graphs.
    pub(crate) references: Vec<GraphReference>,
    /// The optional inputs of the first graph that have no value.
    pub(crate) absent: BTreeSet<String>,
    /// The diagnostics of missing files, by the paths of the files and the positions of their names.
    pub(crate) missing: HashMap<(PathBuf, PathBuf, Span), Arc<Diagnostic>>,
    /// The files that the checked nodes read.
    pub(crate) files: Vec<ReadFile>,
    /// The pinned results of the first graph.
    pub(crate) pins: Arc<Pins>,
}

/// The number of nesting levels that run on one thread. They fit into a stack of 2 MB, the smallest default of the supported systems.
pub(crate) const LEVELS_PER_STACK: usize = 32;

/// Runs `work` one nesting level deeper. Every [`LEVELS_PER_STACK`]th level gets a new thread.
pub(crate) fn with_enough_stack<R: Send>(depth: usize, work: impl FnOnce() -> R + Send) -> R {
    if !depth.is_multiple_of(LEVELS_PER_STACK) || depth == 0 {
        return work();
    }
    let done = std::thread::scope(|scope| scope.spawn(work).join());
    done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

impl<'a> World<'a> {
    pub(crate) fn new(catalog: &'a Catalog, options: &'a Options, root: PathBuf) -> Self {
        let allowed = options.roots.iter().filter_map(|root| std::fs::canonicalize(root).ok());
        Self {
            catalog,
            options,
            roots: std::iter::once(root).chain(allowed).collect(),
            values: catalog.value_types().into_iter().collect(),
            known: HashMap::new(),
            node_types: Vec::new(),
            open_files: Vec::new(),
            diagnostics: Vec::new(),
            subgraphs: Vec::new(),
            references: Vec::new(),
            absent: BTreeSet::new(),
            missing: HashMap::new(),
            files: Vec::new(),
            pins: Arc::default(),
        }
    }

    /// Returns true if a diagnostic prevents the whole graph from running, and not only a node and its dependents.
    pub(crate) fn is_fatal(&self, diagnostic: &Diagnostic) -> bool {
        let is_of_node = match diagnostic.code {
            code::UNKNOWN_NODE => true,
            code::MISSING_FILE => self.missing.values().any(|missing| **missing == *diagnostic),
            _ => false,
        };
        diagnostic.severity == Severity::Error && !is_of_node
    }

    /// Returns the version that the graph in a file states.
    pub(crate) fn version_of(&self, real: &Path) -> Option<String> {
        Some(self.known.get(real)?.as_ref()?.version.as_ref()?.to_string())
    }
}

/// A reference from a graph to the file of another graph.
pub(crate) struct GraphReference {
    pub(crate) path: PathBuf,
    /// The path of that file, without symbolic links and dots.
    pub(crate) canonical_path: PathBuf,
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    pub(crate) uses: Vec<Use>,
}
