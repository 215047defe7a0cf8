//! The thread that checks open documents and publishes diagnostics.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use gen_lsp_types::Uri;
use lsp_server::{Message, Notification};
use maquette_edit::resolve_path;
use maquette_golden::suite::FileKind;
use maquette_graph::catalog::Catalog;
use maquette_graph::{CheckedGraph, Graph, Options};
use maquette_syntax::error::{Diagnostic, Severity, Span, code};
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{TypedKind, WalkEvent, for_each_word};
use serde_json::{Value as Json, json};

use super::ClientCapabilities;
use super::library::Library;
use super::position::{Lines, uri_of};
use super::scope::Scope;
use super::watcher::{Event, Watcher};

/// An open document that is a graph, patch, test or sweep.
pub(super) struct OpenDocument {
    pub(super) path: PathBuf,
    pub(super) version: i32,
    pub(super) text: Arc<str>,
}

/// A job for the checker thread.
pub(super) enum Job {
    Check {
        open: Vec<OpenDocument>,
        /// The URIs of all open documents, by path, exactly as the editor writes them.
        uris: HashMap<PathBuf, Vec<Uri>>,
        options: Options,
    },
    /// The diagnostics that a run of the graph `path` has found, and the text that was run. These diagnostics are published until the text
    /// of the graph changes.
    Found { path: PathBuf, text: Arc<str>, diagnostics: FileDiagnostics },
}

/// Diagnostics in the format of the protocol, each with the path of its file.
pub(super) type FileDiagnostics = Vec<(PathBuf, Json)>;

pub(super) struct Checker {
    catalog: Arc<Catalog>,
    client: ClientCapabilities,
    sender: crossbeam_channel::Sender<Message>,
    /// The URIs for which the editor has received diagnostics.
    reported: BTreeSet<String>,
    /// The diagnostics found by runs, by the path of the graph, each with the text of the graph that was run.
    found: BTreeMap<PathBuf, (Arc<str>, FileDiagnostics)>,
    watcher: Watcher,
}

impl Checker {
    pub(super) fn start(
        catalog: Arc<Catalog>,
        client: ClientCapabilities,
        sender: crossbeam_channel::Sender<Message>,
        events: crossbeam_channel::Sender<Event>,
    ) -> (Sender<Job>, JoinHandle<()>) {
        let (jobs, received) = channel();
        let (reported, found) = (BTreeSet::new(), BTreeMap::new());
        let watcher = Watcher::start(events);
        let mut checker = Self { catalog, client, sender, reported, found, watcher };
        (jobs, std::thread::spawn(move || checker.work(&received)))
    }

    /// Processes jobs until the channel is closed. If several checks are waiting, only the newest is run.
    fn work(&mut self, jobs: &Receiver<Job>) {
        let mut last = None;
        while let Ok(job) = jobs.recv() {
            for job in std::iter::once(job).chain(std::iter::from_fn(|| jobs.try_recv().ok())) {
                match job {
                    Job::Check { .. } => last = Some(job),
                    Job::Found { path, text, diagnostics } => {
                        self.found.insert(path, (text, diagnostics));
                    }
                }
            }
            if let Some(Job::Check { open, uris, options }) = &last {
                self.check(open, uris, options);
            }
        }
    }

    fn check(
        &mut self,
        open: &[OpenDocument],
        uris: &HashMap<PathBuf, Vec<Uri>>,
        options: &Options,
    ) {
        let mut by_file: BTreeMap<PathBuf, Vec<Json>> = BTreeMap::new();
        let mut seen: BTreeSet<(PathBuf, Span, &str, String)> = BTreeSet::new();
        let mut files = BTreeSet::new();
        self.found
            .retain(|path, (text, _)| open.iter().any(|it| it.path == *path && it.text == *text));
        for document in open {
            by_file.entry(document.path.clone()).or_default();
            let (problems, read) = problems(document, &self.catalog, options);
            files.extend(read);
            for problem in problems {
                let file = resolve_path(&problem.source.name);
                let place = (file.clone(), problem.span, problem.code, problem.message.clone());
                if seen.insert(place) {
                    by_file.entry(file).or_default().push(diagnostic(&problem, self.client));
                }
            }
        }
        for (_, diagnostics) in self.found.values() {
            for (file, diagnostic) in diagnostics {
                let all = by_file.entry(file.clone()).or_default();
                if !all.contains(diagnostic) {
                    all.push(diagnostic.clone());
                }
            }
        }
        self.watcher.watch(files);
        fn uris_of(path: &Path, uris: &HashMap<PathBuf, Vec<Uri>>) -> Vec<Uri> {
            uris.get(path).cloned().unwrap_or_else(|| vec![uri_of(path)])
        }
        let mut reported = BTreeSet::new();
        let mut published = Vec::new();
        for (path, diagnostics) in by_file {
            let version = open.iter().find(|it| it.path == path).map(|it| it.version);
            for uri in uris_of(&path, uris) {
                if !diagnostics.is_empty() {
                    reported.insert(uri.0.clone());
                }
                let mut params = json!({ "uri": uri, "diagnostics": diagnostics });
                if let Some(version) = version {
                    params["version"] = version.into();
                }
                published.push(params);
            }
        }
        fn is_open(uri: &str, published: &[Json]) -> bool {
            published.iter().any(|params| params["uri"] == uri)
        }
        let gone = self.reported.iter().filter(|uri| !is_open(uri, &published));
        let cleared = gone.map(|uri| json!({ "uri": uri, "diagnostics": [] }));
        for params in Vec::from_iter(cleared).into_iter().chain(published) {
            let method = "textDocument/publishDiagnostics".to_owned();
            let _ = self.sender.send(Notification { method, params }.into());
        }
        self.reported = reported;
    }
}

/// Returns the diagnostics of a document, as `maquette check` reports them, and the files on which they depend.
fn problems(
    document: &OpenDocument,
    catalog: &Catalog,
    options: &Options,
) -> (Vec<Diagnostic>, BTreeSet<PathBuf>) {
    let OpenDocument { path, text, .. } = document;
    let kind = FileKind::detect(path, text);
    let find = || {
        // Do not call `kind.diagnostics`: it reports the same, but does not return the files that the graph reads.
        if kind == FileKind::Graph {
            let checked = Graph::load_text(path, text.to_string(), catalog, options);
            let unused = checked.graph.as_ref().map(Graph::unused_warnings).unwrap_or_default();
            let files = read_by(&checked);
            return (checked.diagnostics.iter().chain(unused).cloned().collect(), files);
        }
        let problems = kind.diagnostics(path, text.to_string(), catalog, options).0;
        let library = Library::new(catalog, path, options);
        let mut files = BTreeSet::new();
        if let Some(about) = Scope::parse(text).target {
            let graph = library.resolve(&about.text);
            files = read_by(&Graph::load(&graph, catalog, options));
            files.insert(graph);
        }
        files.extend(folders(&library, text));
        (problems, files)
    };
    // If the check panics, report no diagnostics, and continue with the next document.
    let (problems, mut files) = catch_unwind(AssertUnwindSafe(find)).unwrap_or_default();
    let marker = project_root(path.parent().unwrap_or(Path::new("/"))).join(MARKER);
    files.extend([marker, path.with_extension("pins.ron"), path.with_extension("lock.ron")]);
    (problems, files)
}

/// Returns the files that a graph reads, and the files of the graphs that it uses. Missing files are included.
fn read_by(checked: &CheckedGraph) -> BTreeSet<PathBuf> {
    let files = checked.files.iter().map(|file| file.path.clone());
    files.chain(checked.subgraphs.iter().cloned()).collect()
}

/// Returns the folders in which the file patterns of a text, such as `scans/*.obj`, search for files.
fn folders(library: &Library<'_>, text: &str) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    for_each_word(text, |_, passed| {
        if let WalkEvent::Word(word, TypedKind::Text) = passed
            && let Some((before, _)) = word.text.split_once(['*', '?'])
        {
            let folder = before.rsplit_once('/').map_or(".", |(folder, _)| folder);
            found.insert(library.resolve(folder));
        }
    });
    found
}

/// Converts a diagnostic to the format of the protocol. The help lines are appended to the message.
pub(super) fn diagnostic(problem: &Diagnostic, client: ClientCapabilities) -> Json {
    let lines = Lines::new(&problem.source.text, client.columns);
    let range = lines.range(problem.span);
    let uri = uri_of(&resolve_path(&problem.source.name));
    let mut related = Vec::new();
    if let Some((span, words)) = &problem.note {
        related.push(
            json!({ "location": { "uri": uri, "range": lines.range(*span) }, "message": words }),
        );
    }
    for used in &problem.uses {
        let lines = Lines::new(&used.source.text, client.columns);
        let place = json!({ "uri": uri_of(&resolve_path(&used.source.name)), "range": lines.range(used.span) });
        related.push(json!({ "location": place, "message": format!("used by `{}`", used.name) }));
    }
    let mut message = problem.message.clone();
    if !problem.help.is_empty() {
        match client.related {
            true => {
                let place = json!({ "uri": uri, "range": range });
                related.push(
                    json!({ "location": place, "message": format!("help: {}", problem.help) }),
                );
            }
            false => message += &format!("\nhelp: {}", problem.help),
        }
    }
    let mut json = json!({
        "range": range,
        "severity": if problem.severity == Severity::Error { 1 } else { 2 },
        "code": problem.code,
        "source": "maquette",
        "message": message,
    });
    // Set the tags 1 (unnecessary) and 2 (deprecated): editors fade an unused node, and strike through a former name.
    match problem.code {
        code::UNUSED => json["tags"] = json!([1]),
        code::OUTDATED => json["tags"] = json!([2]),
        _ => {}
    }
    if !related.is_empty() && client.related {
        json["relatedInformation"] = related.into();
    }
    json
}
