//! The thread that checks what is open and publishes its problems.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use gen_lsp_types::Uri;
use lsp_server::{Message, Notification};
use maquette_edit::real;
use maquette_golden::suite::FileKind;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Checked, Graph, Options};
use maquette_syntax::error::{Problem, Severity, Span, code};
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{Passed, TypedKind, each_word};
use serde_json::{Value as Json, json};

use super::Client;
use super::library::Library;
use super::place::{Lines, uri_of};
use super::scope::Scope;
use super::watcher::{Event, Watcher};

/// A text that is open and one of ours.
pub(super) struct Open {
    pub(super) path: PathBuf,
    pub(super) version: i32,
    pub(super) text: Arc<str>,
}

/// What there is to do.
pub(super) enum Job {
    Check {
        open: Vec<Open>,
        /// The URIs of all open texts, as the editor writes them.
        uris: HashMap<PathBuf, Vec<Uri>>,
        options: Options,
    },
    /// What a run of a graph found, with its text; shown until that changes.
    Found { path: PathBuf, text: Arc<str>, diagnostics: OfFiles },
}

/// Diagnostics, each with its file.
pub(super) type OfFiles = Vec<(PathBuf, Json)>;

pub(super) struct Checker {
    catalog: Arc<Catalog>,
    client: Client,
    sender: crossbeam_channel::Sender<Message>,
    /// The URIs for which problems have been published.
    told: BTreeSet<String>,
    /// What runs found, by the graph that was run.
    found: BTreeMap<PathBuf, (Arc<str>, OfFiles)>,
    watcher: Watcher,
}

impl Checker {
    pub(super) fn start(
        catalog: Arc<Catalog>,
        client: Client,
        sender: crossbeam_channel::Sender<Message>,
        events: crossbeam_channel::Sender<Event>,
    ) -> (Sender<Job>, JoinHandle<()>) {
        let (jobs, received) = channel();
        let (told, found) = (BTreeSet::new(), BTreeMap::new());
        let watcher = Watcher::start(events);
        let mut checker = Self { catalog, client, sender, told, found, watcher };
        (jobs, std::thread::spawn(move || checker.work(&received)))
    }

    /// Checks the newest of what it is asked for, until nobody asks any more.
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

    fn check(&mut self, open: &[Open], uris: &HashMap<PathBuf, Vec<Uri>>, options: &Options) {
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
                let file = real(&problem.source.name);
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
        let mut told = BTreeSet::new();
        let mut published = Vec::new();
        for (path, diagnostics) in by_file {
            let version = open.iter().find(|it| it.path == path).map(|it| it.version);
            for uri in uris_of(&path, uris) {
                if !diagnostics.is_empty() {
                    told.insert(uri.0.clone());
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
        let gone = self.told.iter().filter(|uri| !is_open(uri, &published));
        let cleared = gone.map(|uri| json!({ "uri": uri, "diagnostics": [] }));
        for params in Vec::from_iter(cleared).into_iter().chain(published) {
            let method = "textDocument/publishDiagnostics".to_owned();
            let _ = self.sender.send(Notification { method, params }.into());
        }
        self.told = told;
    }
}

/// The problems of a text, as `maquette check` finds them, and the files that it depends on.
fn problems(
    document: &Open,
    catalog: &Catalog,
    options: &Options,
) -> (Vec<Problem>, BTreeSet<PathBuf>) {
    let Open { path, text, .. } = document;
    let kind = FileKind::of(path, text);
    let find = || {
        // The same as `kind.problems`, which does not say what the graph reads.
        if kind == FileKind::Graph {
            let checked = Graph::load_text(path, text.to_string(), catalog, options);
            let unused = checked.graph.as_ref().map(Graph::unused).unwrap_or_default();
            let files = read_by(&checked);
            return (checked.problems.iter().chain(unused).cloned().collect(), files);
        }
        let problems = kind.problems(path, text.to_string(), catalog, options).0;
        let library = Library::new(catalog, path, options);
        let mut files = BTreeSet::new();
        if let Some(about) = Scope::of(text).about {
            let graph = library.resolved(&about.text);
            files = read_by(&Graph::load(&graph, catalog, options));
            files.insert(graph);
        }
        files.extend(folders(&library, text));
        (problems, files)
    };
    // It goes on with the next text.
    let (problems, mut files) = catch_unwind(AssertUnwindSafe(find)).unwrap_or_default();
    let marker = project_root(path.parent().unwrap_or(Path::new("/"))).join(MARKER);
    files.extend([marker, path.with_extension("pins.ron"), path.with_extension("lock.ron")]);
    (problems, files)
}

/// The files that a graph is made of and reads, those that are not there included.
fn read_by(checked: &Checked) -> BTreeSet<PathBuf> {
    let files = checked.files.iter().map(|file| file.path.clone());
    files.chain(checked.subgraphs.iter().cloned()).collect()
}

/// The folders in which the patterns of a text, such as `scans/*.obj`, find files.
fn folders(library: &Library<'_>, text: &str) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    each_word(text, |_, passed| {
        if let Passed::Word(word, TypedKind::Text) = passed
            && let Some((before, _)) = word.text.split_once(['*', '?'])
        {
            let folder = before.rsplit_once('/').map_or(".", |(folder, _)| folder);
            found.insert(library.resolved(folder));
        }
    });
    found
}

/// A problem as the protocol has it: the same words as everywhere; what to do stands beside it.
pub(super) fn diagnostic(problem: &Problem, client: Client) -> Json {
    let lines = Lines::new(&problem.source.text, client.columns);
    let range = lines.range(problem.span);
    let uri = uri_of(&real(&problem.source.name));
    let mut related = Vec::new();
    if let Some((span, words)) = &problem.note {
        related.push(
            json!({ "location": { "uri": uri, "range": lines.range(*span) }, "message": words }),
        );
    }
    for used in &problem.uses {
        let lines = Lines::new(&used.source.text, client.columns);
        let place =
            json!({ "uri": uri_of(&real(&used.source.name)), "range": lines.range(used.span) });
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
    let mut told = json!({
        "range": range,
        "severity": if problem.severity == Severity::Error { 1 } else { 2 },
        "code": problem.code,
        "source": "maquette",
        "message": message,
    });
    // What nobody needs is shown faint, old names struck through.
    match problem.code {
        code::UNUSED => told["tags"] = json!([1]),
        code::OUTDATED => told["tags"] = json!([2]),
        _ => {}
    }
    if !related.is_empty() && client.related {
        told["relatedInformation"] = related.into();
    }
    told
}
