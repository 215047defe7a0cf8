//! Sessions. Host programs and the command line run graphs only through a [`Session`].

use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::{CheckedGraph, Graph, GraphExpectation, GraphOutput, InputValues, Options};
use maquette_node::CancelToken;
use maquette_node::pack::Pack;
use maquette_remote::RequestCounts;
use maquette_syntax::error::{Diagnostic, Severity, code};
use maquette_syntax::unknown_name_message;

use crate::eval::{Disk, Evaluator, Observer, start_threads};
use crate::expect;

mod elements;
mod finished;
mod forecasts;
mod identity;
mod inputs;
mod outputs;
mod pins;
mod provenance;
mod save;
mod settings;
mod verdicts;

pub use finished::{OutputReport, RunResult};
pub use identity::ReadFiles;
pub use outputs::{OutputFile, OutputFolder, VerifiedStamp};
pub use pins::{PinError, matches_pin, pinnable, unpin};
pub use provenance::{ProvenanceBuilder, sign};
pub use save::{SaveError, save};
pub use settings::{CacheFolder, CacheServer, SessionError, Settings};
pub use settings::{default_folder, disk_size, size};

/// The state that a program keeps between runs of graphs: its packs, its threads, and results in memory and on disk.
///
/// ```
/// use maquette_engine::session::{Run, Session, Settings};
/// use maquette_graph::Options;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mut session = Session::new(&[], &Settings::in_memory())?;
/// let text = r#"Graph(format: 1, nodes: {}, outputs: {})"#;
/// let checked = session.load("empty.ron".as_ref(), &Options::default().with_text("empty.ron", text));
/// let graph = checked.graph.ok_or("the graph has diagnostics")?;
/// let done = session.run(&graph, &Run::default()).map_err(|diagnostics| diagnostics[0].message.clone())?;
/// assert!(done.diagnostics().is_empty());
/// # Ok(())
/// # }
/// ```
pub struct Session {
    catalog: Arc<Catalog>,
    evaluator: Evaluator,
    /// The maximum size of the results in memory, in bytes.
    memory: usize,
    /// The reason why results are not written to disk although the settings ask for it; `None` if nothing prevents writing.
    disk_warning: Option<String>,
    /// The last known number of elements of each `ForEach` loop over data, by graph file.
    known_counts: elements::KnownCounts,
}

/// The parameters of a run: the values to compute, and the inputs of the graph.
pub struct Run<'a> {
    /// The values that the run computes.
    pub targets: Targets,
    /// The values of the graph's inputs, by name.
    pub inputs: InputValues,
    /// The observer that receives the progress of the evaluation.
    pub observer: &'a dyn Observer,
    /// A token with which the caller can cancel the evaluation.
    pub cancel: CancelToken,
}

impl Default for Run<'_> {
    fn default() -> Self {
        let (wanted, inputs, cancel) = Default::default();
        Self { targets: wanted, inputs, observer: &(), cancel }
    }
}

/// Selects the values of a graph that a run computes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Targets {
    /// All outputs of the graph, and all values about which the graph has expectations.
    #[default]
    Outputs,
    /// The values of `Outputs`, and also the listed values: nodes (`node`) or outputs of nodes (`node.output`).
    OutputsAnd(Vec<String>),
    /// Only the listed values: outputs of the graph, nodes (`node`) or outputs of nodes (`node.output`).
    Named(Vec<String>),
    /// All outputs of the listed nodes. A node that uses another graph stands for the nodes inside of that graph that compute its outputs.
    /// If a node and an output of the graph have the same name, the node is meant.
    Nodes(Vec<String>),
    /// All outputs of every node.
    Everything,
}

impl Session {
    /// Creates a session with the given packs. The settings affect speed and memory but not the results.
    ///
    /// # Errors
    /// If the threads cannot be started, or if the folder that the settings name for results cannot be used.
    pub fn new(packs: &[&Pack], settings: &Settings) -> Result<Self, SessionError> {
        Self::with_catalog(Arc::new(Catalog::new(packs)), settings)
    }

    /// Creates a session with a catalog that other sessions may share.
    ///
    /// # Errors
    /// The same errors as [`new`](Self::new).
    pub fn with_catalog(catalog: Arc<Catalog>, settings: &Settings) -> Result<Self, SessionError> {
        let threads = start_threads(settings.threads);
        let threads = threads.map_err(|error| SessionError(error.to_string()))?;
        Self::with_threads(threads, catalog, settings)
    }

    /// Creates a session that runs on a pool of threads, which other sessions may share. [`Settings::threads`] is ignored.
    ///
    /// # Errors
    /// If the folder that the settings name for results cannot be used.
    pub fn with_threads(
        threads: Arc<rayon::ThreadPool>,
        catalog: Arc<Catalog>,
        settings: &Settings,
    ) -> Result<Self, SessionError> {
        let (evaluator, disk_warning) = settings.evaluator(&catalog, threads)?;
        let most = settings.max_memory.and_then(|most| usize::try_from(most).ok());
        let memory = settings.memory.min(most.unwrap_or(usize::MAX));
        Ok(Self {
            catalog,
            evaluator,
            memory,
            disk_warning,
            known_counts: elements::KnownCounts::new(),
        })
    }

    /// Returns the catalog of node types, value types and formats that the packs provide.
    pub fn catalog(&self) -> &Catalog {
        &self.catalog
    }

    /// Returns a shared reference to the catalog.
    pub fn shared_catalog(&self) -> Arc<Catalog> {
        self.catalog.clone()
    }

    /// Loads and checks a graph and all graphs that it uses. The text is taken from [`Options::texts`] if it contains this path, and
    /// otherwise read from the file. No node is run.
    pub fn load(&self, path: &Path, options: &Options) -> CheckedGraph {
        Graph::load(path, &self.catalog, options)
    }

    /// Reads the values of a graph's inputs from files. The reader is chosen by the type of the input and the extension of the file. Also
    /// returns the warnings of the readers.
    ///
    /// # Errors
    /// An error for each name that is not an input of the graph, and for each file that cannot be read.
    pub fn read_inputs(
        &self,
        graph: &Graph,
        files: &[(String, PathBuf)],
    ) -> Result<(InputValues, Vec<Diagnostic>), Vec<Diagnostic>> {
        inputs::read(self, graph, files)
    }

    /// Evaluates a graph. If a node fails, only the nodes that depend on it fail, too: see [`RunResult::diagnostics`].
    ///
    /// # Errors
    /// If the value of an input has a wrong type, or if a requested name does not exist. In both cases, the only nodes that may have run
    /// are those that determine how many elements each loop has.
    pub fn run(&mut self, graph: &Graph, run: &Run<'_>) -> Result<RunResult, Vec<Diagnostic>> {
        let graph = self.bind_inputs(graph, &run.inputs)?;
        let wanted = |graph: &Graph| elements::wanted_nodes(graph, &run.targets);
        let graph = self.resolve(&graph, &wanted, run.observer, &run.cancel);
        fn of_outputs(graph: &Graph) -> Vec<usize> {
            graph.outputs().iter().map(|output| output.node).collect::<Vec<_>>()
        }
        let find_nodes = |name: &str| match graph.find_value(name) {
            Some((node, _)) => vec![node],
            None => graph.nodes_of(name),
        };
        let mut nodes = match &run.targets {
            Targets::Outputs => of_outputs(&graph),
            Targets::OutputsAnd(names) => {
                [of_outputs(&graph), nodes_named(&graph, names, find_nodes)?].concat()
            }
            Targets::Everything => (0..graph.nodes().len()).collect(),
            Targets::Named(names) => nodes_named(&graph, names, find_nodes)?,
            Targets::Nodes(names) => nodes_named(&graph, names, |name| graph.nodes_of(name))?,
        };
        let expected = match &run.targets {
            Targets::Nodes(_) => Vec::new(),
            Targets::Named(_) => graph.expectations_of_uses(&nodes),
            Targets::Outputs | Targets::OutputsAnd(_) | Targets::Everything => {
                graph.expectations_for(&nodes)
            }
        };
        nodes.extend(expect::nodes_of(&expected));
        nodes.extend(graph.empty_loops());
        let evaluation = self.evaluator.evaluate(&graph, &nodes, &nodes, run.observer, &run.cancel);
        let violations = self
            .evaluator
            .install(|| expect::violations(&graph, evaluation.values_by_output(), &expected));
        Ok(RunResult { graph, evaluation, violations })
    }

    /// Evaluates the outputs `only` of a graph and writes them to a folder. An empty list stands for all outputs. A file that already has
    /// the right bytes is not written, and the value for it is not computed.
    ///
    /// # Errors
    /// A message if one of the names is not an output of the graph.
    pub fn produce(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Result<OutputReport, String> {
        self.produce_after(graph, only, folder, observer, cancel, |_| {})
    }

    /// Like [`produce`](Self::produce), but calls `before_writing` between the evaluation and the first write.
    pub fn produce_after(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
        observer: &dyn Observer,
        cancel: &CancelToken,
        before_writing: impl FnOnce(&mut Self),
    ) -> Result<OutputReport, String> {
        outputs_of(graph, only)?;
        let wanted = |graph: &Graph| {
            let outputs = outputs_of(graph, only).unwrap_or_default();
            let nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
            [expect::nodes_of(&expected_of(graph, &nodes, only)), nodes].concat()
        };
        let graph = &self.resolve(graph, &wanted, observer, cancel);
        let outputs = outputs_of(graph, only)?;
        let mut nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
        let expected = expected_of(graph, &nodes, only);
        nodes.extend(expect::nodes_of(&expected).into_iter().chain(graph.empty_loops()));
        let (mut verdicts, open) = self.open_expectations(graph, &expected);
        let evaluator = &mut self.evaluator;
        let mut values = match evaluator.is_verifying() {
            // Evaluate all outputs: if cached results are verified, even an output file that is known may turn out to be wrong.
            true => outputs.iter().map(|output| output.node).collect(),
            false => folder.nodes_to_write(&outputs, graph, &self.catalog, evaluator),
        };
        values.extend(expect::nodes_of(&open));
        let evaluation = evaluator.evaluate(graph, &nodes, &values, observer, cancel);
        before_writing(self);
        let evaluator = &self.evaluator;
        let result = folder.write(&outputs, &evaluation, graph, &self.catalog, evaluator, cancel);
        folder.keep(evaluator);
        if result.files.iter().any(|file| !file.unchanged) {
            self.keep_graph_of(folder.path(), &graph.source().name);
        }
        let mut diagnostics = evaluation.diagnostics();
        if !open.is_empty() {
            let violations =
                self.evaluator.install(|| verdicts.judge(graph, &evaluation, &open, cancel));
            diagnostics.extend(violations.into_iter().map(|violation| violation.diagnostic));
            self.keep_verdicts(graph, &verdicts);
        }
        let complete = result.diagnostics.iter().all(|it| it.severity != Severity::Error);
        diagnostics.extend(result.diagnostics);
        let may_succeed_later = result.is_refused || evaluation.may_succeed_later();
        let written = result.files;
        Ok(OutputReport { evaluation, written, complete, may_succeed_later, diagnostics })
    }

    /// Writes the outputs `only` of a run to a folder. An empty list stands for all outputs; unknown names are ignored. Each file is
    /// written whole or not at all. Returns the files, and an error for each output that could not be written.
    pub fn write(
        &self,
        finished: &RunResult,
        only: &[String],
        folder: &OutputFolder,
        cancel: &CancelToken,
    ) -> (Vec<OutputFile>, Vec<Diagnostic>) {
        let outputs = outputs_of(&finished.graph, only).unwrap_or_default();
        let RunResult { graph, evaluation, .. } = finished;
        let (catalog, evaluator) = (&self.catalog, &self.evaluator);
        let result = folder.write(&outputs, evaluation, graph, catalog, evaluator, cancel);
        (result.files, result.diagnostics)
    }

    /// Loads the record that an earlier process has stored about the files in an output folder.
    pub fn recall(&self, folder: &OutputFolder) {
        folder.recall(&self.evaluator);
    }

    /// Returns a copy of the graph with the given input values. A missing value is not an error, but the nodes that depend on it fail. The
    /// outputs are set to be written in the preferred file format of their type.
    ///
    /// # Errors
    /// If a value has another type than its input, or a name is not an input of the graph.
    pub fn bind_inputs(
        &self,
        graph: &Graph,
        inputs: &InputValues,
    ) -> Result<Graph, Vec<Diagnostic>> {
        if inputs.is_empty() && graph.inputs().is_empty() && !graph.is_function() {
            return Ok(graph.clone());
        }
        graph.with_inputs(inputs, &self.catalog)
    }

    /// Runs a closure on the session's threads and returns its result.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.evaluator.install(work)
    }

    /// Returns the note (some bytes) that this build of the program has stored about a file or folder; `None` if there is no note.
    pub fn note(&self, of: &Path) -> Option<Vec<u8>> {
        self.evaluator.disk()?.note(of)
    }

    /// Stores a note (some bytes) about a file or folder. Does nothing if the session has no disk cache.
    pub fn keep_note(&self, of: &Path, note: impl FnOnce() -> Vec<u8>) {
        if let Some(disk) = self.evaluator.disk() {
            disk.keep_note(of, note(), Vec::new());
        }
    }

    /// Returns the path of the graph whose outputs were last written to `folder`, or `None` if it is unknown.
    pub fn graph_of(&self, folder: &Path) -> Option<PathBuf> {
        let path = self.note(&graph_note(folder)?)?;
        Some(PathBuf::from(String::from_utf8(path).ok()?))
    }

    /// Stores a note that the outputs in `folder` are those of `graph`.
    fn keep_graph_of(&self, folder: &Path, graph: &Path) {
        let graph = std::fs::canonicalize(graph).ok();
        let graph = graph.as_deref().and_then(Path::to_str);
        if let (Some(note), Some(graph)) = (graph_note(folder), graph) {
            self.keep_note(&note, || graph.as_bytes().to_vec());
        }
    }

    /// Returns the maximum size of the results in memory, in bytes.
    pub fn memory(&self) -> usize {
        self.memory
    }

    /// Sets the maximum size of the results in memory, in bytes. If they are larger, the least recently used ones are dropped at once.
    pub fn set_memory(&mut self, bytes: usize) {
        self.evaluator.set_memory(bytes);
    }

    /// Sets whether new results are written to disk. Results that are already on disk are used in any case.
    pub fn set_keeping_on_disk(&mut self, keep: bool) {
        self.evaluator.set_keeping_on_disk(keep);
    }

    /// Drops all results in memory. Results on disk stay, but the next run ignores them.
    pub fn forget(&mut self) {
        self.known_counts.clear();
        self.evaluator.forget();
    }

    /// Returns the reason why results are not written to disk although the settings ask for it; `None` if nothing prevents writing.
    pub fn disk_warning(&self) -> Option<&str> {
        self.disk_warning.as_deref().or_else(|| self.write_error())
    }

    /// Returns the first error that occurred when a result was written to disk; `None` if there was no error.
    pub(crate) fn write_error(&self) -> Option<&str> {
        self.evaluator.disk().and_then(Disk::write_error)
    }

    /// Returns the first error of the server with which results are shared; `None` if there was no error. See [`Disk::with_server`].
    pub fn server_error(&self) -> Option<&str> {
        self.evaluator.disk().and_then(Disk::server_error)
    }

    /// Returns messages about errors in writing results to disk and in sharing them with a server.
    pub fn cache_warnings(&self) -> Vec<String> {
        let server = self.server_error().map(str::to_owned);
        self.write_error()
            .map(|why| format!("results are not kept for the next run: {why}"))
            .into_iter()
            .chain(server)
            .collect()
    }

    /// Returns the messages of [`cache_warnings`](Self::cache_warnings) as warnings about a graph.
    pub fn warnings(&self, graph: &Graph) -> Vec<Diagnostic> {
        self.cache_warnings()
            .into_iter()
            .map(|message| Diagnostic {
                severity: Severity::Warning,
                ..graph.diagnostic(code::WARNING, message)
            })
            .collect()
    }

    /// Returns the numbers of requests to the server with which results are shared, or `None` if no server is used.
    pub fn exchange(&self) -> Option<RequestCounts> {
        self.evaluator.disk().and_then(Disk::exchange)
    }

    /// Waits until all results are written to disk, and up to one second for uploads to a server. If the disk cache exceeds its size limit,
    /// drops the least recently used files.
    pub fn finish(&self) {
        if let Some(disk) = self.evaluator.disk() {
            disk.finish();
        }
    }
}

/// Returns the key of the note that stores which graph wrote to `folder`; `None` if the folder does not exist. The key contains an `@`, so
/// it differs from the path of any output.
fn graph_note(folder: &Path) -> Option<PathBuf> {
    Some(std::fs::canonicalize(folder).ok()?.join("@graph"))
}

/// Returns the expectations that are checked when `nodes` are computed. If `only` selects some outputs, expectations about other values are
/// left out.
fn expected_of<'g>(
    graph: &'g Graph,
    nodes: &[usize],
    only: &[String],
) -> Vec<&'g GraphExpectation> {
    if only.is_empty() { graph.expectations_for(nodes) } else { graph.expectations_for_only(nodes) }
}

/// Returns the outputs with the given names, or all outputs if `names` is empty.
pub(crate) fn outputs_of<'g>(
    graph: &'g Graph,
    only: &[String],
) -> Result<Vec<&'g GraphOutput>, String> {
    if only.is_empty() {
        return Ok(graph.outputs().iter().collect());
    }
    only.iter()
        .map(|name| {
            graph
                .outputs()
                .iter()
                .find(|output| {
                    let is_port = graph.ports().iter().any(|port| port.name == *name);
                    output.name == *name
                        || is_port && Path::new(&output.name).with_extension("") == **name
                })
                .ok_or_else(|| {
                    let known = Vec::from_iter(graph.output_names());
                    unknown_name_message(
                        format!("the graph has no output `{name}`"),
                        name,
                        "its outputs",
                        &known,
                    )
                })
        })
        .collect()
}

/// Calls `find` for each name and returns all node indices that it finds, in one list. A name for which `find` returns no index is an
/// error.
fn nodes_named(
    graph: &Graph,
    names: &[String],
    find: impl Fn(&str) -> Vec<usize>,
) -> Result<Vec<usize>, Vec<Diagnostic>> {
    let (mut nodes, mut diagnostics) = (Vec::new(), Vec::new());
    for name in names {
        let found = find(name);
        if found.is_empty() {
            let known: Vec<_> = graph.output_names().chain(graph.node_names()).collect();
            let message = graph.unknown("output or node", name, "it has", &known);
            diagnostics.push(graph.diagnostic(code::UNKNOWN_LINK, message));
        }
        nodes.extend(found);
    }
    if diagnostics.is_empty() { Ok(nodes) } else { Err(diagnostics) }
}
