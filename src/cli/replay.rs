//! `maquette replay`: computes an output again from the provenance in its file, and compares the new file with the old one.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{OutputFolder, Run, Session, Targets, sign};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, GraphOutput, Options};
use maquette_node::provenance::{EmbeddedProvenance, Provenance, Signature, find};
use maquette_syntax::paths::{folder_of_new, project_root};
use maquette_syntax::unknown_name_message;
use maquette_value::Hash;
use maquette_value::fs::{extension, read_no_follow};
use serde_json::json;

use super::cache_options::{CacheOptions, ReportingSession};
use super::inputs::InputOptions;
use super::progress::Progress;
use super::{Exit, eprint, parse_assignment, print, print_json, report};
use crate::DisplayPath;

/// Option for the provenance in written files.
#[derive(Args, Clone, Default)]
pub(super) struct ProvenanceOptions {
    /// Do not write provenance (graph, parameters, input files) into outputs.
    #[arg(long)]
    no_provenance: bool,
}

impl ProvenanceOptions {
    pub(super) fn apply_to(&self, folder: OutputFolder) -> OutputFolder {
        if self.no_provenance { folder.without_provenance() } else { folder }
    }

    pub(super) fn signs(&self) -> bool {
        !self.no_provenance
    }

    /// Returns the arguments that give another process the same options.
    pub(super) fn arguments(&self) -> Vec<String> {
        self.no_provenance.then(|| "--no-provenance".to_owned()).into_iter().collect()
    }
}

#[derive(Args)]
pub(crate) struct Replay {
    /// An output file with provenance.
    file: PathBuf,
    /// The graph [default: the graph named in the file, searched in the project of the current folder, in that of the file, in the notes of
    /// the last run, and in projects below the current folder].
    #[arg(long, value_name = "GRAPH")]
    graph: Option<PathBuf>,
    #[command(flatten)]
    inputs: InputOptions,
    /// Set a parameter or field that the file does not record completely: of a path outside of the project it has only the file name.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = parse_assignment)]
    set: Vec<(String, String)>,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
    /// The number of threads; 0 for all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// An output file with the provenance that was found in it.
struct SignedFile {
    found: EmbeddedProvenance,
    /// The readable part of the provenance: graph, parameters and input files.
    provenance: Provenance,
    bytes: Vec<u8>,
}

impl Replay {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let found = self.read_file().and_then(|signed| {
            let session = self.cache.reporting_session(self.threads, catalog)?;
            Ok((self.graph(&signed.provenance, &session)?, signed, session))
        });
        match found {
            Ok((graph, signed, session)) => self.replay(&graph, &signed, session, catalog),
            Err(why) => Exit::Usage(why),
        }
    }

    fn read_file(&self) -> Result<SignedFile, String> {
        let path = self.file.for_display();
        let bytes =
            read_no_follow(&self.file).map_err(|why| format!("cannot read {path}: {why}"))?;
        let found = find(&extension(&self.file), &bytes);
        let found = found.ok_or_else(|| format!("{path} contains no provenance"))?;
        let provenance = match &found {
            EmbeddedProvenance::Words(words) => Provenance::read(words)
                .ok_or_else(|| format!("{path} contains no provenance of this program"))?,
            EmbeddedProvenance::Hash(_) => Provenance {
                output: self.file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                ..Provenance::default()
            },
        };
        Ok(SignedFile { found, provenance, bytes })
    }

    /// Returns the path of the graph that wrote the file.
    fn graph(&self, signed: &Provenance, session: &Session) -> Result<PathBuf, String> {
        if let Some(graph) = &self.graph {
            return Ok(graph.clone());
        }
        let name = match &signed.graph[..] {
            "" => {
                return Err("the file contains only a hash; specify its graph with --graph".into());
            }
            name => name,
        };
        let folders = [PathBuf::from("."), folder_of_new(&self.file)];
        let graphs = folders.map(|folder| project_root(&folder).join(name));
        let known = graphs
            .into_iter()
            .find(|graph| graph.is_file())
            .or_else(|| folder_of_new(&self.file).ancestors().find_map(|it| session.graph_of(it)))
            .filter(|graph| graph.ends_with(name) && graph.is_file());
        if let Some(graph) = known {
            return Ok(graph);
        }
        match &graphs_below(Path::new("."), name)[..] {
            [graph] => Ok(graph.clone()),
            [] => Err(format!(
                "cannot find the graph `{name}` in the project of the current folder, in that of the file, or below the current folder: \
                 name it with --graph"
            )),
            several => {
                let paths = several.iter().take(5).map(|path| format!("`{}`", path.display()));
                let paths = Vec::from_iter(paths).join(", ");
                Err(format!("several graphs match: {paths}; choose one with --graph"))
            }
        }
    }

    fn replay(
        &self,
        path: &Path,
        signed: &SignedFile,
        mut session: ReportingSession,
        catalog: &Arc<Catalog>,
    ) -> Exit {
        let roots = self.roots.clone();
        let mut set = parameter_values(path, &signed.provenance, catalog);
        set.retain(|(name, _)| self.set.iter().all(|(other, _)| other != name));
        set.extend(self.set.iter().cloned());
        let (draft, pins) = (signed.provenance.draft, !signed.provenance.pins.is_empty());
        let options = Options { roots, set, draft, pins, ..Options::default() };
        let checked = session.load(path, &options).without_unknown_nodes();
        report(&checked.diagnostics);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let graph = match self.inputs.feed_and_report(&session, &graph) {
            Ok(graph) => graph,
            Err(exit) => return exit,
        };
        let Some(output) = find_output(&graph, &signed.provenance.output) else {
            let name = &signed.provenance.output;
            let known = Vec::from_iter(graph.output_names());
            return Exit::Usage(unknown_name_message(
                format!("the graph no longer has an output `{name}`"),
                name,
                "its outputs",
                &known,
            ));
        };
        let progress = Progress::new(graph.nodes().len());
        let wanted = Targets::Named(vec![output.name.clone()]);
        let run =
            session.run(&graph, &Run { targets: wanted, observer: &progress, ..Run::default() });
        progress.end();
        let run = match run {
            Ok(run) => run,
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Failed;
            }
        };
        report(&run.diagnostics());
        // Use the graph of the run. Unlike the loaded graph, it contains the elements of each `ForEach` over data.
        let Some(output) = find_output(run.graph(), &output.name) else { return Exit::Failed };
        let now = run.provenance(output, catalog);
        let (before, changes) = match &signed.found {
            EmbeddedProvenance::Words(_) => {
                (sign(&signed.provenance), signed.provenance.changes(&now))
            }
            EmbeddedProvenance::Hash(hash) => {
                let signature = Signature { hash: hash.clone(), ..sign(&now) };
                let is_same = sign(&now).hash == *hash;
                let change = "an input changed; the file contains only a hash of all inputs";
                (signature, if is_same { Vec::new() } else { vec![change.to_owned()] })
            }
        };
        // Write the new output with the old provenance, so that a difference in bytes can only come from the value.
        let bytes = match run.signed_files(output, Some(&before)) {
            Some(Ok(files)) => files.into_iter().next().map(|file| file.bytes).unwrap_or_default(),
            Some(Err(why)) => {
                eprint(&format!("error: cannot reproduce `{}`: {why}\n", output.name));
                return Exit::Failed;
            }
            None => return Exit::Failed,
        };
        let same_value = bytes == signed.bytes;
        let same = same_value && changes.is_empty();
        let [before, now] = [&signed.bytes, &bytes].map(|bytes| Hash::compute(bytes).to_string());
        if self.json {
            print_json(&json!({
                "same": same, "sameValue": same_value, "changes": changes, "hash": before, "now": now,
            }));
        } else {
            let file = self.file.for_display();
            let mut text = match (same, same_value) {
                (true, _) => format!("{file} is reproduced with the same bytes: {before}\n"),
                (_, true) => format!("{file} has the same value, but its inputs changed:\n"),
                _ => format!("{file} differs: {before} before, {now} now\n"),
            };
            if !same && changes.is_empty() {
                text += "  no recorded input changed: another build of the program wrote the file, or the file was edited\n";
            }
            changes.iter().for_each(|change| text += &format!("  {change}\n"));
            print(&text);
        }
        if same { Exit::Done } else { Exit::Failed }
    }
}

/// Returns the graphs below a folder whose path in their own project is `name`. The command `run` may have been started above the project.
fn graphs_below(folder: &Path, name: &str) -> Vec<PathBuf> {
    /// `MAX_DEPTH` is the maximum depth of a project below the folder. `MAX_FOLDERS` is the maximum number of folders that are searched.
    const MAX_DEPTH: usize = 5;
    const MAX_FOLDERS: usize = 10_000;
    let (mut found, mut count) = (Vec::new(), 0);
    let mut open = vec![(folder.to_owned(), 0)];
    while let Some((folder, depth)) = open.pop() {
        let graph = folder.join(name);
        if graph.is_file()
            && std::fs::canonicalize(&folder).ok() == Some(project_root(&folder_of_new(&graph)))
        {
            found.push(graph);
        }
        count += 1;
        if depth == MAX_DEPTH || count > MAX_FOLDERS {
            continue;
        }
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            // Skip symbolic links, which may form a cycle, and folders of builds and packages, which may contain copies of graphs.
            let is_own = entry.file_type().is_ok_and(|kind| kind.is_dir())
                && !name.to_string_lossy().starts_with('.')
                && name != "target"
                && name != "node_modules";
            if is_own {
                open.push((entry.path(), depth + 1));
            }
        }
    }
    found.sort();
    found
}

/// Returns the recorded values of those parameters that the graph still has, as arguments of `--set`. Values that equal the default are
/// left out, because a path in a default is relative to the graph that declares the parameter.
fn parameter_values(path: &Path, signed: &Provenance, catalog: &Catalog) -> Vec<(String, String)> {
    let options = Options { files: Files::Ignored, draft: signed.draft, ..Options::default() };
    let graph = Graph::load(path, catalog, &options).without_unknown_nodes().graph;
    let parameters =
        signed.parameters.iter().filter_map(|(name, value): (&String, &serde_json::Value)| {
            let graph = graph.as_ref()?;
            let own =
                graph.schema()["properties"].get(name).and_then(|declared| declared.get("default"));
            let value = graph.as_ron(name, value)?;
            let is_own =
                own.and_then(|own| graph.as_ron(name, own)).is_some_and(|own| own == value);
            (!is_own).then(|| (name.clone(), value))
        });
    parameters
        .chain(signed.set.iter().filter_map(|(name, value): (&String, &serde_json::Value)| {
            Some((name.clone(), value.as_str()?.to_owned()))
        }))
        .collect()
}

/// Returns the output with this name.
fn find_output<'g>(graph: &'g Graph, name: &str) -> Option<&'g GraphOutput> {
    graph.outputs().iter().find(|output| output.name == name)
}
