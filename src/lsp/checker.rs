//! The thread that checks what is open and publishes its problems.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use gen_lsp_types::Uri;
use lsp_server::{Message, Notification};
use maquette_edit::real;
use maquette_golden::suite::FileKind;
use maquette_graph::Options;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Problem, Severity, Span, code};
use serde_json::{Value as Json, json};

use super::Client;
use super::place::{Lines, uri_of};

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
        uris: HashMap<PathBuf, Uri>,
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
    /// The files of which something has been published.
    told: BTreeMap<PathBuf, Uri>,
    /// What runs found, by the graph that was run.
    found: BTreeMap<PathBuf, (Arc<str>, OfFiles)>,
}

impl Checker {
    pub(super) fn start(
        catalog: Arc<Catalog>,
        client: Client,
        sender: crossbeam_channel::Sender<Message>,
    ) -> (Sender<Job>, JoinHandle<()>) {
        let (jobs, received) = channel();
        let (told, found) = (BTreeMap::new(), BTreeMap::new());
        let mut checker = Self { catalog, client, sender, told, found };
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

    fn check(&mut self, open: &[Open], uris: &HashMap<PathBuf, Uri>, options: &Options) {
        let mut by_file: BTreeMap<PathBuf, Vec<Json>> = BTreeMap::new();
        let mut seen: BTreeSet<(PathBuf, Span, &str, String)> = BTreeSet::new();
        self.found
            .retain(|path, (text, _)| open.iter().any(|it| it.path == *path && it.text == *text));
        for document in open {
            by_file.entry(document.path.clone()).or_default();
            for problem in problems(document, &self.catalog, options) {
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
        let gone =
            Vec::from_iter(self.told.keys().filter(|path| !by_file.contains_key(*path)).cloned());
        by_file.extend(gone.into_iter().map(|path| (path, Vec::new())));
        for (path, diagnostics) in by_file {
            let uri = uris.get(&path).cloned().unwrap_or_else(|| uri_of(&path));
            let version = open.iter().find(|it| it.path == path).map(|it| it.version);
            let is_clear = diagnostics.is_empty();
            let mut params = json!({ "uri": uri, "diagnostics": diagnostics });
            if let Some(version) = version {
                params["version"] = version.into();
            }
            let method = "textDocument/publishDiagnostics".to_owned();
            let _ = self.sender.send(Notification { method, params }.into());
            match is_clear {
                true => drop(self.told.remove(&path)),
                false => drop(self.told.insert(path, uri)),
            }
        }
    }
}

/// The problems of a text, as `maquette check` finds them.
fn problems(document: &Open, catalog: &Catalog, options: &Options) -> Vec<Problem> {
    let Open { path, text, .. } = document;
    let kind = FileKind::of(path, text);
    let find = AssertUnwindSafe(|| kind.problems(path, text.to_string(), catalog, options).0);
    // It goes on with the next text.
    catch_unwind(find).unwrap_or_default()
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
