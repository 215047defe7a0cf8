//! What all files of a graph share while they are checked.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Problem, Severity, Source, Span, Use, code};
use maquette_value::ValueType;

use crate::catalog::Catalog;
use crate::definition::Definition;
use crate::pins::Pins;
use crate::{Options, ReadFile};

/// What all files of a graph share while they are checked.
pub struct World<'a> {
    pub(crate) catalog: &'a Catalog,
    pub(crate) options: &'a Options,
    pub roots: Vec<PathBuf>,
    pub(crate) values: BTreeMap<&'static str, &'static ValueType>,
    /// The files that have been read, by their real path; none if nothing is known of their ports.
    pub known: HashMap<PathBuf, Option<Arc<Definition>>>,
    /// What uses make types of nodes: how deep the use is, the type's name, and the graph.
    pub listed: Vec<(usize, String, Arc<Definition>)>,
    /// The files that are being read, each used by the one before: real path and name.
    pub(crate) open: Vec<(PathBuf, PathBuf)>,
    pub problems: Vec<Problem>,
    /// All files of graphs beside the first one, those that are not there included.
    pub(crate) subgraphs: Vec<PathBuf>,
    /// Those of them that can be read, and where they are named.
    pub(crate) entered: Vec<Entered>,
    /// The inputs of the first graph that nobody gives a value, of those that may be left out.
    pub(crate) absent: BTreeSet<String>,
    /// What is reported of files that nodes need and that cannot be read, by their paths and where they are named.
    pub(crate) missing: HashMap<(PathBuf, PathBuf, Span), Arc<Problem>>,
    /// The files that the nodes read that have been looked at.
    pub(crate) files: Vec<ReadFile>,
    /// The results that stand in for nodes of the first graph.
    pub(crate) pins: Arc<Pins>,
}

/// So many levels fit into the stack of a thread, whose 2 MB are the least that systems give.
pub(crate) const LEVELS: usize = 32;

/// Does what goes one level deeper; every now and then with a stack of its own.
pub(crate) fn deeper<R: Send>(depth: usize, work: impl FnOnce() -> R + Send) -> R {
    if !depth.is_multiple_of(LEVELS) || depth == 0 {
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
            listed: Vec::new(),
            open: Vec::new(),
            problems: Vec::new(),
            subgraphs: Vec::new(),
            entered: Vec::new(),
            absent: BTreeSet::new(),
            missing: HashMap::new(),
            files: Vec::new(),
            pins: Arc::default(),
        }
    }

    /// Returns true if a problem keeps the whole graph from running, and not only what depends on a node.
    pub(crate) fn is_fatal(&self, problem: &Problem) -> bool {
        let is_of_node = match problem.code {
            code::UNKNOWN_NODE => true,
            code::MISSING_FILE => self.missing.values().any(|missing| **missing == *problem),
            _ => false,
        };
        problem.severity == Severity::Error && !is_of_node
    }

    /// The version that the graph in a file says it has.
    pub(crate) fn version_of(&self, real: &Path) -> Option<String> {
        Some(self.known.get(real)?.as_ref()?.version.as_ref()?.to_string())
    }
}

/// A place where a graph names the file of another one.
pub(crate) struct Entered {
    pub(crate) path: PathBuf,
    /// The same without links and dots.
    pub(crate) real: PathBuf,
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
    pub(crate) uses: Vec<Use>,
}
