//! The one way to run a graph: every host, and the command line with them, asks a session.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::{Checked, Expected, Graph, GraphOutput, InputValues, Options};
use maquette_node::CancelToken;
use maquette_node::pack::Pack;
use maquette_remote::Exchange;
use maquette_syntax::error::{Problem, Severity, code};
use maquette_syntax::unknown;

use crate::eval::{Disk, Evaluator, Observer, start_threads};
use crate::expect;

mod elements;
mod finished;
mod forecasts;
mod inputs;
mod made;
mod outputs;
mod pins;
mod provenance;
mod settings;
mod verdicts;

pub use finished::{Finished, Produced};
pub use made::ReadFiles;
pub use outputs::Left;
pub use outputs::{OutputFolder, SaveError, Written, save};
pub use pins::{PinError, means, pinnable, unpin};
pub use provenance::{Teller, sign};
pub use settings::{CacheFolder, CacheServer, SessionError, Settings};
pub use settings::{default_folder, disk_size, size};

/// What a program knows from one run of a graph to the next: its packs, its threads, and results in memory and on disk.
///
/// ```
/// use maquette_engine::session::{Run, Session, Settings};
/// use maquette_graph::Options;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mut session = Session::new(&[], &Settings::in_memory())?;
/// let text = r#"Graph(format: 1, nodes: {}, outputs: {})"#;
/// let checked = session.load("empty.ron".as_ref(), &Options::default().with_text("empty.ron", text));
/// let graph = checked.graph.ok_or("the graph has problems")?;
/// let done = session.run(&graph, &Run::default()).map_err(|problems| problems[0].message.clone())?;
/// assert!(done.problems().is_empty());
/// # Ok(())
/// # }
/// ```
pub struct Session {
    catalog: Arc<Catalog>,
    evaluator: Evaluator,
    /// How many bytes results may hold.
    memory: usize,
    /// Why nothing is kept on disk, though it should be.
    disk_warning: Option<String>,
    /// How many elements there were last.
    known: elements::Known,
}

/// What is to be evaluated of a graph, and with what.
pub struct Run<'a> {
    /// Which values are wanted.
    pub wanted: Wanted,
    /// The values of the graph's inputs, if it has some, by name.
    pub inputs: InputValues,
    /// Is told what happens, as it happens.
    pub observer: &'a dyn Observer,
    /// Stops the evaluation.
    pub cancel: CancelToken,
}

impl Default for Run<'_> {
    fn default() -> Self {
        let (wanted, inputs, cancel) = Default::default();
        Self { wanted, inputs, observer: &(), cancel }
    }
}

/// Which values of a graph are wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Wanted {
    /// Those of all outputs, and all of which the graph expects something.
    #[default]
    Outputs,
    /// The same, and those of these nodes (`node`) or outputs of nodes (`node.output`).
    OutputsAnd(Vec<String>),
    /// Those of these outputs, nodes (`node`) or outputs of nodes (`node.output`).
    Named(Vec<String>),
    /// Those of all outputs of these nodes, or of all nodes that make what a use of a graph gives, whatever outputs of the graph are
    /// called the same.
    Nodes(Vec<String>),
    /// Those of every node.
    Everything,
}

impl Session {
    /// A session with these packs. Results are the same for any settings.
    ///
    /// # Errors
    /// If the threads cannot be started, or the folder that was named for results cannot be used.
    pub fn new(packs: &[&Pack], settings: &Settings) -> Result<Self, SessionError> {
        Self::with_catalog(Arc::new(Catalog::new(packs)), settings)
    }

    /// The same with a catalog that others use, too.
    ///
    /// # Errors
    /// Those of [`new`](Self::new).
    pub fn with_catalog(catalog: Arc<Catalog>, settings: &Settings) -> Result<Self, SessionError> {
        Self::on(start_threads(settings.threads)?, catalog, settings)
    }

    /// The same on threads that others use, too: [`Settings::threads`] does not count.
    ///
    /// # Errors
    /// If the folder that was named for results cannot be used.
    pub fn on(
        threads: Arc<rayon::ThreadPool>,
        catalog: Arc<Catalog>,
        settings: &Settings,
    ) -> Result<Self, SessionError> {
        let (evaluator, disk_warning) = settings.evaluator(&catalog, threads)?;
        let most = settings.max_memory.and_then(|most| usize::try_from(most).ok());
        let memory = settings.memory.min(most.unwrap_or(usize::MAX));
        Ok(Self { catalog, evaluator, memory, disk_warning, known: elements::Known::new() })
    }

    /// What its packs offer.
    pub fn catalog(&self) -> &Catalog {
        &self.catalog
    }

    /// The same for who keeps it.
    pub fn shared_catalog(&self) -> Arc<Catalog> {
        self.catalog.clone()
    }

    /// Reads and checks the graph at this path, or in [`Options::texts`], and those that it uses. Runs no node.
    pub fn load(&self, path: &Path, options: &Options) -> Checked {
        Graph::load(path, &self.catalog, options)
    }

    /// The values in some files for inputs of a graph, by the inputs' types and the files' endings, and the
    /// warnings of their readers.
    ///
    /// # Errors
    /// For each name that is no input's, and each file that cannot be read.
    pub fn read_inputs(
        &self,
        graph: &Graph,
        files: &[(String, PathBuf)],
    ) -> Result<(InputValues, Vec<Problem>), Vec<Problem>> {
        inputs::read(self, graph, files)
    }

    /// Evaluates a graph. What fails takes only what hangs on it with it: see [`Finished::problems`].
    ///
    /// # Errors
    /// If an input gets a value of another type, or something is named that the graph does not have; nothing has been run then but what
    /// says how many elements there are.
    pub fn run(&mut self, graph: &Graph, run: &Run<'_>) -> Result<Finished, Vec<Problem>> {
        let graph = self.fed(graph, &run.inputs)?;
        let wanted = |graph: &Graph| elements::wanted_nodes(graph, &run.wanted);
        let graph = self.resolved(&graph, &wanted, run.observer, &run.cancel);
        fn of_outputs(graph: &Graph) -> Vec<usize> {
            graph.outputs().iter().map(|output| output.node).collect::<Vec<_>>()
        }
        let named = |name: &str| match graph.value_named(name) {
            Some((node, _)) => vec![node],
            None => graph.nodes_of(name),
        };
        let mut nodes = match &run.wanted {
            Wanted::Outputs => of_outputs(&graph),
            Wanted::OutputsAnd(names) => {
                [of_outputs(&graph), places(&graph, names, named)?].concat()
            }
            Wanted::Everything => (0..graph.nodes().len()).collect(),
            Wanted::Named(names) => places(&graph, names, named)?,
            Wanted::Nodes(names) => places(&graph, names, |name| graph.nodes_of(name))?,
        };
        let expected = match &run.wanted {
            Wanted::Nodes(_) => Vec::new(),
            Wanted::Named(_) => graph.expected_of_uses(&nodes),
            Wanted::Outputs | Wanted::OutputsAnd(_) | Wanted::Everything => graph.expected(&nodes),
        };
        nodes.extend(expect::nodes_of(&expected));
        nodes.extend(graph.empty());
        let evaluation = self.evaluator.evaluate(&graph, &nodes, &nodes, run.observer, &run.cancel);
        let violations =
            self.evaluator.install(|| expect::violations(&graph, evaluation.by_place(), &expected));
        Ok(Finished { graph, evaluation, violations })
    }

    /// Evaluates outputs of a graph, all if none is named, and writes them to a folder. Only values that must be written are made: a
    /// file that holds the right bytes already is left alone.
    ///
    /// # Errors
    /// In words, if the graph has no output of such a name.
    pub fn produce(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Result<Produced, String> {
        self.produce_after(graph, only, folder, observer, cancel, |_| {})
    }

    /// The same, which writes after something else has been done with what was evaluated.
    pub fn produce_after(
        &mut self,
        graph: &Graph,
        only: &[String],
        folder: &OutputFolder,
        observer: &dyn Observer,
        cancel: &CancelToken,
        first: impl FnOnce(&mut Self),
    ) -> Result<Produced, String> {
        outputs_of(graph, only)?;
        let wanted = |graph: &Graph| {
            let outputs = outputs_of(graph, only).unwrap_or_default();
            let nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
            [expect::nodes_of(&expected_of(graph, &nodes, only)), nodes].concat()
        };
        let graph = &self.resolved(graph, &wanted, observer, cancel);
        let outputs = outputs_of(graph, only)?;
        let mut nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
        let expected = expected_of(graph, &nodes, only);
        nodes.extend(expect::nodes_of(&expected).into_iter().chain(graph.empty()));
        let (mut verdicts, open) = self.unjudged(graph, &expected);
        let evaluator = &mut self.evaluator;
        let mut values = match evaluator.is_verifying() {
            // What is known of a file may turn out to be wrong.
            true => outputs.iter().map(|output| output.node).collect(),
            false => folder.nodes_to_write(&outputs, graph, &self.catalog, evaluator),
        };
        values.extend(expect::nodes_of(&open));
        let evaluation = evaluator.evaluate(graph, &nodes, &values, observer, cancel);
        first(self);
        let evaluator = &self.evaluator;
        let (written, unwritten, is_refused) =
            folder.write(&outputs, &evaluation, graph, &self.catalog, evaluator, cancel);
        folder.keep(evaluator);
        if written.iter().any(|file| !file.unchanged) {
            self.keep_graph_of(folder.path(), &graph.source().name);
        }
        let mut problems = evaluation.problems();
        if !open.is_empty() {
            let violations =
                self.evaluator.install(|| verdicts.judge(graph, &evaluation, &open, cancel));
            problems.extend(violations.into_iter().map(|violation| violation.problem));
            self.keep_verdicts(graph, &verdicts);
        }
        let complete = !unwritten.iter().any(|problem| problem.severity == Severity::Error);
        problems.extend(unwritten);
        let may_pass = is_refused || evaluation.may_pass();
        Ok(Produced { evaluation, written, complete, may_pass, problems })
    }

    /// Writes outputs of a run, all if none is named, to a folder: each file whole or not at all. Gives the files, and what could not be
    /// written. Names that the graph does not have count for nothing.
    pub fn write(
        &self,
        finished: &Finished,
        only: &[String],
        folder: &OutputFolder,
        cancel: &CancelToken,
    ) -> (Vec<Written>, Vec<Problem>) {
        let outputs = outputs_of(&finished.graph, only).unwrap_or_default();
        let Finished { graph, evaluation, .. } = finished;
        let (catalog, evaluator) = (&self.catalog, &self.evaluator);
        let (written, unwritten, _) =
            folder.write(&outputs, evaluation, graph, catalog, evaluator, cancel);
        (written, unwritten)
    }

    /// Finds out what the last process knew of the files in a folder of outputs.
    pub fn recall(&self, folder: &OutputFolder) {
        folder.recall(&self.evaluator);
    }

    /// The graph with values at its inputs, to be run any number of times: inputs without one are no error, but what hangs on them
    /// fails. Its outputs become files in the preferred formats of their types.
    ///
    /// # Errors
    /// If an input gets a value of another type, or a value is for no input.
    pub fn fed(&self, graph: &Graph, inputs: &InputValues) -> Result<Graph, Vec<Problem>> {
        if inputs.is_empty() && graph.inputs().is_empty() && !graph.is_function() {
            return Ok(graph.clone());
        }
        graph.with_inputs(inputs, &self.catalog)
    }

    /// Runs something on the session's threads.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.evaluator.install(work)
    }

    /// What was last noted on disk of a file or folder, by this build of the program.
    pub fn note(&self, of: &Path) -> Option<Vec<u8>> {
        self.evaluator.disk()?.note(of)
    }

    /// Notes something of a file or folder on disk, if results are kept there.
    pub fn keep_note(&self, of: &Path, note: impl FnOnce() -> Vec<u8>) {
        if let Some(disk) = self.evaluator.disk() {
            disk.keep_note(of, note(), Vec::new());
        }
    }

    /// Returns the graph whose outputs were last written to a folder, if that was noted on disk.
    pub fn graph_of(&self, folder: &Path) -> Option<PathBuf> {
        let path = self.note(&graph_note(folder)?)?;
        Some(PathBuf::from(String::from_utf8(path).ok()?))
    }

    /// Notes the graph whose outputs are in a folder.
    fn keep_graph_of(&self, folder: &Path, graph: &Path) {
        let graph = std::fs::canonicalize(graph).ok();
        let graph = graph.as_deref().and_then(Path::to_str);
        if let (Some(note), Some(graph)) = (graph_note(folder), graph) {
            self.keep_note(&note, || graph.as_bytes().to_vec());
        }
    }

    /// How many bytes results may hold.
    pub fn memory(&self) -> usize {
        self.memory
    }

    /// From now on results may hold this many bytes; those used longest ago are dropped at once if they hold more.
    pub fn use_memory(&mut self, bytes: usize) {
        self.evaluator.set_memory(bytes);
    }

    /// Whether what is found from now on is put on disk, too.
    pub fn keep_on_disk(&mut self, keep: bool) {
        self.evaluator.keep_on_disk(keep);
    }

    /// Drops every result in memory; what is on disk stays, but the next run does not use it.
    pub fn forget(&mut self) {
        self.known.clear();
        self.evaluator.forget();
    }

    /// Why results are not kept on disk, though they should be.
    pub fn trouble(&self) -> Option<&str> {
        self.disk_warning.as_deref().or_else(|| self.write_trouble())
    }

    /// Why results that were made could not be kept on disk.
    pub(crate) fn write_trouble(&self) -> Option<&str> {
        self.evaluator.disk().and_then(Disk::trouble)
    }

    /// The trouble with the server of results, if there was any: see [`Disk::sharing`].
    pub fn server_trouble(&self) -> Option<&str> {
        self.evaluator.disk().and_then(Disk::server_trouble)
    }

    /// What went wrong with keeping and sharing results, in words.
    pub fn troubles(&self) -> Vec<String> {
        let server = self.server_trouble().map(str::to_owned);
        self.write_trouble()
            .map(|why| format!("results are not kept for the next run: {why}"))
            .into_iter()
            .chain(server)
            .collect()
    }

    /// The same, as warnings of a graph.
    pub fn warnings(&self, graph: &Graph) -> Vec<Problem> {
        fn problem(trouble: String, graph: &Graph) -> Problem {
            graph.problem(code::WARNING, trouble)
        }
        self.troubles()
            .into_iter()
            .map(|it| Problem { severity: Severity::Warning, ..problem(it, graph) })
            .collect()
    }

    /// What the server of results was asked for so far, if there is one.
    pub fn exchange(&self) -> Option<Exchange> {
        self.evaluator.disk().and_then(Disk::exchange)
    }

    /// Waits until all results that are worth it are on disk, and drops old ones if there are too many. What a server of results has
    /// not been sent a second later it does not get.
    pub fn finish(&self) {
        if let Some(disk) = self.evaluator.disk() {
            disk.finish();
        }
    }
}

/// The name under which the graph of a folder of outputs is noted. No output has a name with an `@`.
fn graph_note(folder: &Path) -> Option<PathBuf> {
    Some(std::fs::canonicalize(folder).ok()?.join("@graph"))
}

/// What must hold where these nodes of some outputs are wanted. Who names outputs, `only` them, does not ask about other values.
fn expected_of<'g>(graph: &'g Graph, nodes: &[usize], only: &[String]) -> Vec<&'g Expected> {
    if only.is_empty() { graph.expected(nodes) } else { graph.expected_of_only(nodes) }
}

/// The outputs of these names; all if there are none.
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
                    unknown(
                        format!("the graph has no output `{name}`"),
                        name,
                        "its outputs",
                        &known,
                    )
                })
        })
        .collect()
}

/// The nodes that give what these names mean, each of which `find` looks up.
fn places(
    graph: &Graph,
    names: &[String],
    find: impl Fn(&str) -> Vec<usize>,
) -> Result<Vec<usize>, Vec<Problem>> {
    let (mut nodes, mut problems) = (Vec::new(), Vec::new());
    for name in names {
        let found = find(name);
        if found.is_empty() {
            let known: Vec<_> = graph.output_names().chain(graph.node_names()).collect();
            let message = graph.unknown("output or node", name, "it has", &known);
            problems.push(graph.problem(code::UNKNOWN_LINK, message));
        }
        nodes.extend(found);
    }
    if problems.is_empty() { Ok(nodes) } else { Err(problems) }
}
