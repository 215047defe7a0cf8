//! `maquette inspect`: any value of a graph, and the eyedropper.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value as Json, json};

use super::caching::CacheOptions;
use super::progress::Progress;
use super::{Exit, GraphOptions, in_bytes, print, print_json, report};
use crate::catalog::Catalog;
use crate::error::{Error, Problem};
use crate::format::png;
use crate::graph::{Graph, nearest};
use crate::node::{CancelToken, ending};
use crate::pack::NewFile;
use crate::render::{View, render};
use crate::value::{AnyValue, Mesh, Summary, Surface};
use crate::writing::{Place, Sources};

#[derive(Args)]
pub(super) struct Inspect {
    /// The graph file.
    graph: PathBuf,
    /// The node, or one of its outputs: NODE.OUTPUT.
    #[arg(value_name = "NODE[.OUTPUT]")]
    node: String,
    /// What is under this pixel of the capture's picture: color, label, point.
    #[arg(long, value_name = "X,Y", value_parser = pixel)]
    at: Option<[usize; 2]>,
    /// Write the value to this file, too; its ending chooses the format.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// From where a mesh or surface is seen in a picture: how far to the right and above, in degrees, and how much nearer than
    /// what just fits.
    #[arg(long, value_name = "YAW,PITCH[,ZOOM]", value_parser = view, allow_hyphen_values = true, requires = "out")]
    view: Option<View>,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
    /// How many threads to use; 0 is all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

fn pixel(text: &str) -> Result<[usize; 2], String> {
    let parse = |part: &str| part.trim().parse::<usize>().ok();
    let (x, y) = text.split_once(',').ok_or("write COLUMN,ROW")?;
    parse(x).zip(parse(y)).map(|(x, y)| [x, y]).ok_or_else(|| "write COLUMN,ROW".into())
}

pub(super) fn view(text: &str) -> Result<View, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[yaw, pitch]) => Ok(View { yaw, pitch, ..View::front() }),
        Ok(&[yaw, pitch, zoom]) => Ok(View { yaw, pitch, zoom, ..View::front() }),
        _ => Err("write YAW,PITCH or YAW,PITCH,ZOOM".into()),
    }
}

/// The name of an output, and its node and place there.
type Found = (String, (usize, usize));

impl Inspect {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let checked = self.options.load(&self.graph, catalog);
        let Some(graph) = checked.graph else {
            report(&checked.problems);
            return Exit::Failed;
        };
        let outputs = match self.find(&graph) {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        let mut evaluator = match self.cache.evaluator(self.threads, catalog) {
            Ok(evaluator) => evaluator,
            Err(why) => return Exit::Usage(why),
        };
        let progress = Progress::new(graph.nodes.len());
        let mut nodes = Vec::from_iter(outputs.iter().map(|(_, (node, _))| *node));
        nodes.sort_unstable();
        nodes.dedup();
        let cancel = CancelToken::default();
        let evaluation = evaluator.evaluate(&graph, &nodes, &nodes, &progress, &cancel);
        progress.end();
        if !self.json {
            report(&evaluation.problems());
        }
        let found = outputs.iter().filter_map(|(name, (node, output))| {
            Some((&name[..], evaluation.value(*node, *output)?))
        });
        let found = Vec::from_iter(found);
        let node = self.node.split_once('.').map_or(&self.node[..], |(node, _)| node);
        self.print(node, &found, &evaluation.problems());
        let Some((_, value)) = found.first() else { return Exit::Failed };
        match &self.out {
            Some(path) => self.write(value, path, catalog, &Sources::of(&graph)),
            None => Exit::Done,
        }
    }

    /// The outputs that are meant, by name, each with its node and place there.
    fn find(&self, graph: &Graph) -> Result<Vec<Found>, String> {
        let (name, output) = match self.node.split_once('.') {
            Some((name, output)) => (name, Some(output)),
            None => (&self.node[..], None),
        };
        let outputs: Vec<Found> = match graph.find(name) {
            Some(node) => {
                let names = graph.nodes[node].outputs.iter().enumerate();
                names.map(|(index, name)| ((*name).to_owned(), (node, index))).collect()
            }
            None => {
                let given = graph.uses.iter().find(|given| given.name == name);
                let given = given.ok_or_else(|| {
                    let help = nearest(name, graph.names());
                    format!("the graph has no node `{name}`; {help}")
                })?;
                let all = given.outputs.iter().flat_map(|(name, targets)| {
                    let one = targets.len() == 1;
                    let label = move |k: usize| match one {
                        true => name.clone(),
                        false => format!("{name} {}", k + 1),
                    };
                    targets.iter().enumerate().map(move |(k, &target)| (label(k), target))
                });
                all.collect()
            }
        };
        let Some(output) = output else { return Ok(outputs) };
        let names = Vec::from_iter(outputs.iter().map(|(name, _)| &name[..])).join(", ");
        let none = || format!("`{name}` has no output `{output}`; its outputs: {names}");
        let is_meant = |name: &str| {
            name.strip_prefix(output).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
        };
        let error = none();
        let found = Vec::from_iter(outputs.into_iter().filter(|(name, _)| is_meant(name)));
        if found.is_empty() { Err(error) } else { Ok(found) }
    }

    fn print(&self, node: &str, found: &[(&str, &AnyValue)], problems: &[Problem]) {
        let summary = |value: &AnyValue| match self.at {
            Some(at) => value.probe(at),
            None => value.describe(),
        };
        if self.json {
            let outputs = found.iter().map(|(name, value)| {
                let facts: serde_json::Map<String, Json> = summary(value).0.into_iter().collect();
                let (kind, hash) = (value.kind().name, value.hash().to_string());
                json!({ "name": name, "type": kind, "hash": hash, "bytes": value.size(), "facts": facts })
            });
            let problems: Vec<_> = problems.iter().map(Problem::to_json).collect();
            print_json(&json!({
                "node": node,
                "outputs": outputs.collect::<Vec<_>>(),
                "problems": problems,
            }));
            return;
        }
        let mut text = String::new();
        for (name, value) in found {
            let (kind, size) = (value.kind().name, in_bytes(value.size()));
            let _ = match self.at {
                Some([x, y]) => writeln!(text, "{node}.{name}: {kind} at ({x}, {y})"),
                None => writeln!(text, "{node}.{name}: {kind}, {size}, {}", value.hash().short()),
            };
            text += &table(&summary(value));
        }
        print(&text);
    }

    fn write(&self, value: &AnyValue, path: &Path, catalog: &Catalog, sources: &Sources) -> Exit {
        let Some(format) = catalog.format(value.kind(), &ending(path)) else {
            let kind = value.kind();
            let known = catalog.endings(Some(kind)).join(", ");
            return Exit::Usage(format!("a {} can be written to: {known}", kind.name));
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let files = match &self.view {
            None => format.write(value, &name),
            Some(view) => picture(value, view, &name),
        };
        write_files(files, path, sources)
    }
}

/// A mesh or surface, seen from somewhere.
fn picture(value: &AnyValue, view: &View, name: &str) -> Result<Vec<NewFile>, Error> {
    let mesh = match (value.get::<Mesh>(), value.get::<Surface>()) {
        (Some(mesh), _) => mesh.clone(),
        (_, Some(surface)) => surface.tessellate(0, 0)?,
        _ => return Err(NoShape.into()),
    };
    Ok(NewFile::only(name, png::encode_rgb(&render(&mesh, view))?))
}

/// A view was asked for of something flat.
#[derive(Debug, thiserror::Error)]
#[error("--view is for meshes and surfaces")]
struct NoShape;

/// Writes all files, or none if one of them may not be written.
fn write_files(files: Result<Vec<NewFile>, Error>, path: &Path, sources: &Sources) -> Exit {
    let place = Place::anywhere(sources);
    let failed = |path: &Path, why: &dyn std::fmt::Display| {
        Exit::Usage(format!("cannot write {}: {why}", path.display()))
    };
    let files = match files {
        Ok(files) => files.into_iter().map(|file| (path.with_file_name(&file.name), file.bytes)),
        Err(error) => return failed(path, &error),
    };
    let files = Vec::from_iter(files);
    for (path, _) in &files {
        if let Err(refused) = place.judge(path) {
            return failed(path, &refused);
        }
    }
    for (path, bytes) in &files {
        if let Err(refused) = place.put(path, bytes) {
            return failed(path, &refused);
        }
    }
    Exit::Done
}

/// Facts in two columns.
fn table(summary: &Summary) -> String {
    let longest = summary.0.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let mut text = String::new();
    for (label, fact) in &summary.0 {
        let _ = writeln!(text, "  {label:<longest$}  {}", in_words(fact));
    }
    text
}

/// `0 ▁▂█▄ 1`: how often numbers fall into parts of their range, each part as high as it is frequent.
fn histogram(fact: &Json) -> String {
    const HEIGHTS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let counts = fact["counts"].as_array().into_iter().flatten().filter_map(Json::as_u64);
    let counts: Vec<u64> = counts.collect();
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    // Rounded up: a part with a single number is seen.
    let bar = |count: &u64| HEIGHTS[(count * 8).div_ceil(most) as usize];
    let bars: String = counts.iter().map(bar).collect();
    format!("{} {bars} {}", in_words(&fact["from"]), in_words(&fact["to"]))
}

fn in_words(fact: &Json) -> String {
    match fact {
        Json::String(text) => text.clone(),
        Json::Number(number) if number.is_f64() => {
            format!("{:.6}", number.as_f64().unwrap_or_default())
                .trim_end_matches('0')
                .trim_end_matches('.')
                .to_owned()
        }
        Json::Object(entries) if entries.contains_key("counts") => histogram(fact),
        Json::Array(items) => {
            format!("({})", items.iter().map(in_words).collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}
