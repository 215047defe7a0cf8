//! The state that all files of a graph share while the graph is checked.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Severity, Source, Span, Use, code};
use maquette_value::ValueType;

use crate::catalog::Catalog;
use crate::definition::Definition;
use crate::pins::Pins;
use crate::{Options, ReadFile};

/// The state that all files of a graph share while the graph is checked.
pub struct World<'a> {
    pub(crate) catalog: &'a Catalog,
    pub(crate) options: &'a Options,
    pub roots: Vec<PathBuf>,
    pub(crate) values: BTreeMap<&'static str, &'static ValueType>,
    /// The graph files that have been read, by their resolved paths. `None` for a file that has no valid ports.
    pub known: HashMap<PathBuf, Option<Arc<Definition>>>,
    /// The node types that the sections `use` declare. Each has the nesting depth of the declaring graph, its name and its graph.
    pub node_types: Vec<(usize, String, Arc<Definition>)>,
    /// The chain of files that are currently being read, each as resolved path and name. Each file uses the next one.
    pub(crate) open_files: Vec<(PathBuf, PathBuf)>,
    pub diagnostics: Vec<Diagnostic>,
    /// The files of all used graphs, including missing files.
    pub(crate) subgraphs: Vec<PathBuf>,
    /// All references from a graph to the file of another graph, if that file is readable.
    pub(crate) references: Vec<GraphReference>,
    /// The optional inputs of the root graph that have no value.
    pub(crate) absent: BTreeSet<String>,
    /// The diagnostics of missing files. The key is the path of the missing file, and the file and span that contain this path.
    pub(crate) missing: HashMap<(PathBuf, PathBuf, Span), Arc<Diagnostic>>,
    /// The files that the checked nodes read.
    pub(crate) files: Vec<ReadFile>,
    /// The pinned results of the root graph.
    pub(crate) pins: Arc<Pins>,
}

/// Number of nesting levels that run on one thread. They fit into a stack of 2 MB, the smallest default of the supported systems.
pub(crate) const LEVELS_PER_STACK: usize = 32;

/// Runs `work` for the nesting level `depth`. Every [`LEVELS_PER_STACK`]th level runs on a new thread.
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

    /// Returns true if a diagnostic prevents the whole graph from running. Returns false if it affects only a node and its dependents.
    pub(crate) fn is_fatal(&self, diagnostic: &Diagnostic) -> bool {
        let is_of_node = match diagnostic.code {
            code::UNKNOWN_NODE => true,
            code::MISSING_FILE => self.missing.values().any(|missing| **missing == *diagnostic),
            _ => false,
        };
        diagnostic.severity == Severity::Error && !is_of_node
    }

    /// Returns the version in the graph file at this resolved path. `None` if it has no version.
    pub(crate) fn version_of(&self, real: &Path) -> Option<String> {
        Some(self.known.get(real)?.as_ref()?.version.as_ref()?.to_string())
    }
}

/// A reference from a graph to the file of another graph.
pub(crate) struct GraphReference {
    pub(crate) path: PathBuf,
    /// The path of the other graph's file, without symbolic links and without `.` and `..`.
    pub(crate) canonical_path: PathBuf,
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    pub(crate) uses: Vec<Use>,
}
