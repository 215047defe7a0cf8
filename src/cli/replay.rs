//! `maquette replay`: makes an output again by what it tells of where it came from.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{OutputFolder, Run, Session, Wanted, sign};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, GraphOutput, Options};
use maquette_node::provenance::{Found, Provenance, Signature, find};
use maquette_syntax::paths::{folder_of_new, project_root};
use maquette_syntax::unknown;
use maquette_value::Hash;
use maquette_value::plain::{ending, read_own};
use serde_json::json;

use super::caching::{CacheOptions, ToldSession};
use super::inputs::InputOptions;
use super::progress::Progress;
use super::{Exit, assignment, eprint, print, print_json, report};
use crate::Shown;

/// Whether files tell where they came from.
#[derive(Args, Clone, Default)]
pub(super) struct ProvenanceOptions {
    /// Do not let outputs tell of the graph, the parameters and the files that they were made of.
    #[arg(long)]
    no_provenance: bool,
}

impl ProvenanceOptions {
    pub(super) fn applied(&self, folder: OutputFolder) -> OutputFolder {
        if self.no_provenance { folder.without_provenance() } else { folder }
    }

    pub(super) fn signs(&self) -> bool {
        !self.no_provenance
    }

    /// The words that say the same.
    pub(super) fn words(&self) -> Vec<String> {
        self.no_provenance.then(|| "--no-provenance".to_owned()).into_iter().collect()
    }
}

#[derive(Args)]
pub(crate) struct Replay {
    /// A file that a graph gave.
    file: PathBuf,
    /// The graph; if left out, that of the name that the file tells: in the project of the current folder, in that of the file, as the last run
    /// noted it, or in a project below the current folder.
    #[arg(long, value_name = "GRAPH")]
    graph: Option<PathBuf>,
    #[command(flatten)]
    inputs: InputOptions,
    /// The value of a parameter or field that the file does not tell whole: of a path out of the project it has the last name alone.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
    /// How many threads to use; 0 is all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// What the file tells, and all of its bytes.
struct Told {
    found: Found,
    /// What there is to read of it.
    provenance: Provenance,
    bytes: Vec<u8>,
}

impl Replay {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let found = self.told().and_then(|told| {
            let session = self.cache.told_session(self.threads, catalog)?;
            Ok((self.graph(&told.provenance, &session)?, told, session))
        });
        match found {
            Ok((graph, told, session)) => self.replay(&graph, &told, session, catalog),
            Err(why) => Exit::Usage(why),
        }
    }

    fn told(&self) -> Result<Told, String> {
        let path = self.file.shown();
        let bytes = read_own(&self.file).map_err(|why| format!("cannot read {path}: {why}"))?;
        let found = find(&ending(&self.file), &bytes);
        let found = found.ok_or_else(|| format!("{path} does not tell where it came from"))?;
        let provenance = match &found {
            Found::Words(words) => Provenance::read(words)
                .ok_or_else(|| format!("{path} does not tell where it came from as we do"))?,
            Found::Hash(_) => Provenance {
                output: self.file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                ..Provenance::default()
            },
        };
        Ok(Told { found, provenance, bytes })
    }

    /// The graph's file.
    fn graph(&self, told: &Provenance, session: &Session) -> Result<PathBuf, String> {
        if let Some(graph) = &self.graph {
            return Ok(graph.clone());
        }
        let name = match &told.graph[..] {
            "" => return Err("the file has room for a hash alone: --graph names its graph".into()),
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
                Err(format!("several graphs may have made it: {paths}: choose one with --graph"))
            }
        }
    }

    fn replay(
        &self,
        path: &Path,
        told: &Told,
        mut session: ToldSession,
        catalog: &Arc<Catalog>,
    ) -> Exit {
        let roots = self.roots.clone();
        let mut set = values(path, &told.provenance, catalog);
        set.retain(|(name, _)| self.set.iter().all(|(other, _)| other != name));
        set.extend(self.set.iter().cloned());
        let (draft, pins) = (told.provenance.draft, !told.provenance.pins.is_empty());
        let options = Options { roots, set, draft, pins, ..Options::default() };
        let checked = session.load(path, &options).as_far_as_known();
        report(&checked.problems);
        let Some(graph) = checked.graph else { return Exit::Failed };
        let graph = match self.inputs.told(&session, &graph) {
            Ok(graph) => graph,
            Err(exit) => return exit,
        };
        let Some(output) = output(&graph, &told.provenance.output) else {
            let name = &told.provenance.output;
            let known = Vec::from_iter(graph.output_names());
            return Exit::Usage(unknown(
                format!("the graph has no output `{name}` any more"),
                name,
                "its outputs",
                &known,
            ));
        };
        let progress = Progress::new(graph.nodes().len());
        let wanted = Wanted::Named(vec![output.name.clone()]);
        let run = session.run(&graph, &Run { wanted, observer: &progress, ..Run::default() });
        progress.end();
        let run = match run {
            Ok(run) => run,
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        report(&run.problems());
        // Only what was run has as many elements as the data have.
        let Some(output) = self::output(run.graph(), &output.name) else { return Exit::Failed };
        let now = run.provenance(output, catalog);
        let (before, changes) = match &told.found {
            Found::Words(_) => (sign(&told.provenance), told.provenance.changes(&now)),
            Found::Hash(hash) => {
                let signature = Signature { hash: hash.clone(), ..sign(&now) };
                let is_same = sign(&now).hash == *hash;
                let change = "something that it was made of, of which it has a hash alone, changed";
                (signature, if is_same { Vec::new() } else { vec![change.to_owned()] })
            }
        };
        // With the words that the file has: then the rest of the bytes tells whether the value is the same.
        let bytes = match run.signed_files(output, Some(&before)) {
            Some(Ok(files)) => files.into_iter().next().map(|file| file.bytes).unwrap_or_default(),
            Some(Err(why)) => {
                eprint(&format!("error: cannot make `{}` again: {why}\n", output.name));
                return Exit::Failed;
            }
            None => return Exit::Failed,
        };
        let same_value = bytes == told.bytes;
        let same = same_value && changes.is_empty();
        let [before, now] = [&told.bytes, &bytes].map(|bytes| Hash::of(bytes).to_string());
        if self.json {
            print_json(&json!({
                "same": same, "sameValue": same_value, "changes": changes, "hash": before, "now": now,
            }));
        } else {
            let file = self.file.shown();
            let mut text = match (same, same_value) {
                (true, _) => format!("{file} is made again with the same bytes: {before}\n"),
                (_, true) => format!("{file} has the same value, but is made of something else:\n"),
                _ => format!("{file} comes out different: {before} before, {now} now\n"),
            };
            if !same && changes.is_empty() {
                text += "  nothing that it tells of changed: another build of the program made it, or somebody edited it\n";
            }
            changes.iter().for_each(|change| text += &format!("  {change}\n"));
            print(&text);
        }
        if same { Exit::Done } else { Exit::Failed }
    }
}

/// Returns the graphs below a folder that are called `name` in their own project: `run` may have been started above the project.
fn graphs_below(folder: &Path, name: &str) -> Vec<PathBuf> {
    /// How far projects may be below the folder, and how many folders are looked at.
    const MAX_DEPTH: usize = 5;
    const MAX_FOLDERS: usize = 10_000;
    let (mut found, mut count) = (Vec::new(), 0);
    let mut open = vec![(folder.to_owned(), 0)];
    while let Some((folder, depth)) = open.pop() {
        let graph = folder.join(name);
        let is_root =
            || std::fs::canonicalize(&folder).ok() == Some(project_root(&folder_of_new(&graph)));
        if graph.is_file() && is_root() {
            found.push(graph);
        }
        count += 1;
        if depth == MAX_DEPTH || count > MAX_FOLDERS {
            continue;
        }
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            // Links may lead in a circle. What is built or installed has copies of graphs.
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

/// The values that the file was made with, as `--set` has them: of those parameters that the graph still declares. What the graph
/// says itself stays as it is: a path that it takes from another graph is relative to that one.
fn values(path: &Path, told: &Provenance, catalog: &Catalog) -> Vec<(String, String)> {
    let options = Options { files: Files::Ignored, draft: told.draft, ..Options::default() };
    let graph = Graph::load(path, catalog, &options).as_far_as_known().graph;
    let parameters =
        told.parameters.iter().filter_map(|(name, value): (&String, &serde_json::Value)| {
            let graph = graph.as_ref()?;
            let own =
                graph.schema()["properties"].get(name).and_then(|declared| declared.get("default"));
            let value = graph.as_ron(name, value)?;
            let is_own =
                own.and_then(|own| graph.as_ron(name, own)).is_some_and(|own| own == value);
            (!is_own).then(|| (name.clone(), value))
        });
    parameters
        .chain(told.set.iter().filter_map(|(name, value): (&String, &serde_json::Value)| {
            Some((name.clone(), value.as_str()?.to_owned()))
        }))
        .collect()
}

/// The output of this name.
fn output<'g>(graph: &'g Graph, name: &str) -> Option<&'g GraphOutput> {
    graph.outputs().iter().find(|output| output.name == name)
}
