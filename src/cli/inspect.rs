//! `maquette inspect`: prints facts about a value of a graph or in a file, or about one of its pixels.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{Run, Targets};
use maquette_engine::writing::{Destination, Sources};
use maquette_format::png;
use maquette_graph::catalog::Catalog;
use maquette_graph::{CheckedGraph, ELEMENTS, Graph, GraphOutput, Requirement, UnmetRequirement};
use maquette_node::CancelToken;
use maquette_node::pack::NewFile;
use maquette_preview::pixel_probe;
use maquette_preview::pixel_probe::first_picture;
use maquette_render::{Representation, View, picture_layer};
use maquette_syntax::error::{Diagnostic, Error, code};
use maquette_syntax::with_article;
use maquette_value::fs::extension;
use maquette_value::{AnyValue, Layer, Summary};
use serde_json::{Value as Json, json};

use super::inputs::InputOptions;
use super::new::in_meters;
use super::progress::Progress;
use super::viewpoint::{
    CameraTarget, OverOptions, PictureRequest, ValueSource, parse_camera_target,
};
use super::{EvaluationOptions, Exit, eprint, in_bytes, print, print_document, print_json, report};

mod columns;
mod elements;
mod rows;
mod unmet;

use rows::{RowOptions, Rows};

use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Inspect {
    /// The graph file, or a file with a value: a mesh, points, a curve, a range image, a picture.
    #[arg(value_name = "GRAPH|FILE")]
    file: PathBuf,
    /// The node of the graph, or one of its outputs: NODE.OUTPUT. Omitted for a file with a value.
    #[arg(value_name = "NODE[.OUTPUT]")]
    node: Option<String>,
    /// X,Y: print the color, label and point at this pixel. X,Y,Z or NODE: center the written picture on this point (in mm, in the axes of
    /// the value) or on this value, such as a region, which fills the picture.
    #[arg(
        long,
        value_name = "X,Y|X,Y,Z|NODE[.OUTPUT]",
        value_parser = parse_camera_target,
        allow_hyphen_values = true
    )]
    at: Option<CameraTarget>,
    /// List the data columns: element kind, meaning, count, minimum, maximum and mean. With a kind of elements, such as `faces`, list the
    /// elements.
    #[arg(long, value_name = "ELEMENTS", num_args = 0..=1, conflicts_with = "at")]
    table: Option<Option<String>>,
    #[command(flatten)]
    rows: RowOptions,
    /// Also write the value to this file; the extension selects the format. A `.png` shows any visible value: also labels, regions, range
    /// images, points, curves, nets and handles.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The camera of the picture: degrees to the right and above, and the zoom relative to a value that fills the picture.
    #[arg(long, value_name = "YAW,PITCH[,ZOOM]", value_parser = parse_view, allow_hyphen_values = true, requires = "out")]
    view: Option<View>,
    #[command(flatten)]
    over: OverOptions,
    #[command(flatten)]
    evaluation: EvaluationOptions,
    /// The number of threads; 0 for all.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

pub(super) fn parse_view(text: &str) -> Result<View, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[yaw, pitch]) => Ok(View { yaw, pitch, ..View::front() }),
        Ok(&[yaw, pitch, zoom]) => Ok(View { yaw, pitch, zoom, ..View::front() }),
        _ => Err("expected YAW,PITCH or YAW,PITCH,ZOOM".into()),
    }
}

/// The name of the node in a generated graph that reads a file with a value. It is the only node of that graph.
const FILE: &str = "file";

/// The name of an output for display, the index of its node, and its index among the outputs of that node.
type NamedTarget = (String, (usize, usize));

impl Inspect {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let (checked, inputs) = match self.load_graph(catalog) {
            Ok(checked) => checked,
            Err(why) => return Exit::Usage(why),
        };
        let checked = checked.without_unknown_nodes();
        // Do not report unknown nodes and missing files here. If the inspected value depends on them, the evaluation reports them.
        fn is_of_node(it: &Diagnostic) -> bool {
            matches!(it.code, code::UNKNOWN_NODE | code::MISSING_FILE)
        }
        report(
            &checked
                .diagnostics
                .iter()
                .filter(|it| checked.graph.is_none() || !is_of_node(it))
                .cloned()
                .collect::<Vec<_>>(),
        );
        let Some(graph) = checked.graph else { return Exit::Failed };
        if let Err(why) = self.check() {
            return Exit::Usage(why);
        }
        // Check the names before the evaluation, unless the graph has a `ForEach` over data, whose elements are known only afterwards.
        let is_whole = graph.loops().is_empty();
        if is_whole && let Err(why) = self.find(&graph) {
            return Exit::Usage(why);
        }
        let mut session = match self.evaluation.cache.reporting_session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let graph = match inputs.feed_and_report(&session, &graph) {
            Ok(graph) => graph,
            Err(exit) => return exit,
        };
        let progress = Progress::new(graph.nodes().len());
        let request = self.request();
        let names = Vec::from_iter([self.node()].into_iter().chain(request.names()));
        let graph = session.resolve_for(&graph, &names, &progress, &CancelToken::default());
        let outputs = match self.find(&graph) {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        if let Err(why) = request.check(Some(&graph)) {
            return Exit::Usage(why);
        }
        let wanted = Targets::Nodes(
            outputs.iter().map(|&(_, (node, _))| graph.nodes()[node].name.clone()).collect(),
        );
        let run = Run { targets: wanted, observer: &progress, ..Run::default() };
        let finished = session.run(&graph, &run);
        progress.end();
        let finished = match finished {
            Ok(finished) => finished,
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Failed;
            }
        };
        let diagnostics = finished.diagnostics();
        if !self.json {
            report(&diagnostics);
        }
        let found = outputs
            .iter()
            .filter_map(|(name, target)| Some((&name[..], finished.value_at(*target)?)));
        let found = Vec::from_iter(found);
        let node = self.node().split_once('.').map_or(self.node(), |(node, _)| node);
        let node = self.file(&graph).map_or(node, |file| &graph.nodes()[file.node].name);
        if outputs.is_empty() && !self.json {
            if self.out.is_some() {
                return Exit::Usage(format!(
                    "`{node}` is an empty list; there is no value to write"
                ));
            }
            print(&format!("{node}: empty list\n"));
            return Exit::Done;
        }
        let found = match self.select_values(node, found) {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        let chosen = match &self.out {
            Some(path) if !found.is_empty() => {
                match choose_written(node, &found, &extension(path), catalog) {
                    Ok(chosen) => Some(chosen),
                    Err(why) => return Exit::Usage(why),
                }
            }
            _ => None,
        };
        let elements = self.table.as_ref().and_then(|of| of.as_deref());
        if (elements.is_some() || self.rows.are_given()) && !found.is_empty() {
            return match self.rows.rows(elements, &found) {
                Ok((name, rows)) => self.print_rows(&format!("{node}.{name}"), &rows, &graph),
                Err(why) => Exit::Usage(why),
            };
        }
        fn find_target(name: &str, outputs: &[(String, (usize, usize))]) -> Option<(usize, usize)> {
            outputs.iter().find(|(output, _)| output == name).map(|it| it.1)
        }
        let broken: Vec<_> = found
            .iter()
            .map(|(name, value)| {
                let asked = find_target(name, &outputs)
                    .map_or(Vec::new(), |target| graph.requirements_of(target));
                Requirement::find_unmet(&asked, value)
            })
            .collect();
        self.print(node, &found, &broken, &diagnostics);
        let (Some(path), Some((name, value))) = (&self.out, chosen) else {
            return if found.is_empty() { Exit::Failed } else { Exit::Done };
        };
        if !self.json && found.len() > 1 {
            print(&format!("{node}.{name} is written to {}\n", path.for_display()));
        }
        let mut sources = Sources::of_graph(&graph);
        inputs.protect(&mut sources);
        let from = find_target(name, &outputs).map(|(node, _)| node);
        let source = from.map(|node| ValueSource { graph: &graph, node, session: &mut session });
        let broken = found.iter().zip(&broken).find(|((output, _), _)| *output == name);
        let broken = broken.map_or(&[][..], |(_, broken)| broken);
        self.write((value, broken), path, catalog, &sources, source)
    }

    fn node(&self) -> &str {
        self.node.as_deref().unwrap_or(FILE)
    }

    /// Loads the graph and its inputs. If the file contains a value instead of a graph, creates a graph that reads the value.
    fn load_graph(&self, catalog: &Catalog) -> Result<(CheckedGraph, InputOptions), String> {
        let file = self.file.for_display();
        if self.node.is_some() {
            return Ok((
                self.evaluation.graph.load(&self.file, catalog),
                self.evaluation.inputs.clone(),
            ));
        }
        if extension(&self.file) == "ron" {
            let graph =
                self.evaluation.graph.load(&self.file, catalog).without_unknown_nodes().graph;
            let nodes = graph.iter().flat_map(|graph| graph.nodes().iter());
            let nodes: Vec<_> = nodes.map(|node| &node.name[..]).collect();
            return Err(format!("expected a node of {file}: {}", nodes.join(", ")));
        }
        let (value, _) = catalog.readers().open(&self.file, None)?;
        if in_meters(&self.file) {
            eprint("note: numbers in this format are in meters; use `unit: M` to read them\n");
        }
        let kind = value.kind().name;
        let text = format!(
            "Graph(format: 1, inputs: {{ \"{FILE}\": {kind}() }}, nodes: {{}}, outputs: {{ \"{FILE}\": \"{FILE}\" }})"
        );
        let checked =
            Graph::load_text(&self.file, text, catalog, &self.evaluation.graph.to_options());
        Ok((checked, InputOptions::single(FILE, &self.file)))
    }

    /// Returns the pixel of the option `--at X,Y`. Returns `None` if the option is missing or has another form.
    fn pixel(&self) -> Option<[usize; 2]> {
        match self.at {
            Some(CameraTarget::Pixel(pixel)) => Some(pixel),
            Some(CameraTarget::Point(_) | CameraTarget::Value(_)) | None => None,
        }
    }

    /// Returns a request for the picture that the options describe.
    fn request(&self) -> PictureRequest<'_> {
        let at = self.at.as_ref().filter(|_| self.pixel().is_none());
        let is_aimed = self.view.is_some() || at.is_some();
        let kind = if is_aimed { Representation::Space } else { Representation::Native };
        let view = self.view.unwrap_or_else(View::front);
        PictureRequest { view, kind, target: at, over: &self.over, broken: &[] }
    }

    /// Checks that options for pictures are given only if a picture is written.
    fn check(&self) -> Result<(), String> {
        let has_picture = self.out.as_ref().is_some_and(|path| extension(path) == "png");
        if has_picture || !self.request().has_target() {
            return Ok(());
        }
        Err("--at X,Y,Z, --at NODE and --over NODE need a picture; add --out FILE.png".into())
    }

    /// Returns the values to print. With `--at X,Y`, these are the values that have facts about that pixel.
    fn select_values<'v>(
        &self,
        node: &str,
        found: Vec<(&'v str, &'v AnyValue)>,
    ) -> Result<Vec<(&'v str, &'v AnyValue)>, String> {
        let Some(at) = self.pixel().filter(|_| !found.is_empty()) else { return Ok(found) };
        let answering: Vec<_> = found
            .iter()
            .filter(|(_, value)| pixel_probe::probe(value, at).is_some())
            .copied()
            .collect();
        if answering.is_empty() {
            Err(pixel_probe::no_answer(node, &found, at))
        } else {
            Ok(answering)
        }
    }

    /// Returns the output of the graph that the argument `node` names. Returns `None` if the graph has no output of this name, or if an
    /// output of a node has the same name and takes precedence.
    fn file<'g>(&self, graph: &'g Graph) -> Option<&'g GraphOutput> {
        let (name, output) = self.node().split_once('.')?;
        let mut used = graph.uses().iter().filter(|given| given.name == name);
        let is_value =
            graph.find(name).is_some_and(|it| graph.nodes()[it].outputs.contains(&output))
                || used.any(|given| given.outputs.iter().any(|(known, _)| known == output));
        graph.outputs().iter().find(|file| file.name == self.node() && !is_value)
    }

    /// Returns the outputs of nodes that the argument `node` names, each with its name for display.
    fn find(&self, graph: &Graph) -> Result<Vec<NamedTarget>, String> {
        if let Some(GraphOutput { node, output, .. }) = self.file(graph) {
            let name = graph.nodes()[*node].outputs[*output].to_owned();
            return Ok(vec![(name, (*node, *output))]);
        }
        let (name, output) = match self.node().split_once('.') {
            Some((name, output)) => (name, Some(output)),
            None => (self.node(), None),
        };
        let outputs: Vec<NamedTarget> = match graph.find(name) {
            Some(node) => {
                // Number the outputs of a `ForEach` over data in messages, because each output is one element.
                let is_numbered = graph.nodes()[node].kind() == ELEMENTS;
                let names = graph.nodes()[node].outputs.iter().enumerate();
                names.map(|(k, name)| (output_label(name, k, is_numbered), (node, k))).collect()
            }
            None if graph.element(name).is_some() => {
                graph.element(name).map(|target| ("value".to_owned(), target)).into_iter().collect()
            }
            None => {
                let given = graph.uses().iter().find(|given| given.name == name);
                let given = given.ok_or_else(|| {
                    let known = Vec::from_iter(graph.names());
                    graph.unknown("node", name, "its nodes", &known)
                })?;
                let all = given.outputs.iter().flat_map(|(name, targets)| {
                    let is_numbered = targets.len() != 1;
                    let targets = targets.iter().enumerate();
                    targets.map(move |(k, &target)| (output_label(name, k, is_numbered), target))
                });
                all.collect()
            }
        };
        let Some(output) = output else { return Ok(outputs) };
        let names = outputs.iter().map(|(name, _)| &name[..]).collect::<Vec<_>>().join(", ");
        fn is_meant(name: &str, output: &str) -> bool {
            name.strip_prefix(output).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
        }
        let error = format!("`{name}` has no output `{output}`; its outputs: {names}");
        let found: Vec<_> =
            outputs.into_iter().filter(|(name, _)| is_meant(name, output)).collect();
        if found.is_empty() { Err(error) } else { Ok(found) }
    }

    /// Returns the facts about a value. With `--at X,Y`, returns the facts about that pixel.
    fn summary(&self, value: &AnyValue) -> Summary {
        match self.pixel() {
            Some(pixel) => value.probe(pixel),
            None => value.describe(),
        }
    }

    fn print(
        &self,
        node: &str,
        found: &[(&str, &AnyValue)],
        broken: &[Vec<UnmetRequirement>],
        diagnostics: &[Diagnostic],
    ) {
        if self.json {
            let outputs = found.iter().zip(broken).map(|((name, value), broken)| {
                let facts = pixel_probe::facts(self.summary(value));
                let (kind, hash) = (value.kind().name, value.hash().to_string());
                let mut output = json!({ "name": name, "type": kind, "hash": hash, "bytes": value.size(), "facts": facts });
                if !broken.is_empty() {
                    let all = broken.iter().map(|broken| broken.to_json(usize::MAX));
                    output["broken"] = all.collect();
                }
                if self.table.is_some() {
                    output["parts"] = columns::columns_json(&value.parts());
                }
                output
            });
            let diagnostics: Vec<_> = diagnostics.iter().map(Diagnostic::to_json).collect();
            print_json(&json!({
                "node": node,
                "outputs": outputs.collect::<Vec<_>>(),
                "problems": diagnostics,
            }));
            return;
        }
        let mut text = String::new();
        for ((name, value), broken) in found.iter().zip(broken) {
            let (kind, size) = (value.kind().name, in_bytes(value.size()));
            let _ = match self.pixel() {
                Some([x, y]) => writeln!(text, "{node}.{name}: {kind} at ({x}, {y})"),
                None => writeln!(text, "{node}.{name}: {kind}, {size}, {}", value.hash().short()),
            };
            text += &if self.table.is_some() {
                columns::column_table(&value.parts())
            } else {
                fact_table(&self.summary(value))
            };
            text += &unmet::format_unmet(broken);
        }
        print(&text);
    }

    fn print_rows(&self, name: &str, rows: &Rows, graph: &Graph) -> Exit {
        match self.rows.csv.as_deref() {
            Some("-") => print_document(&rows.csv()),
            Some(path) => {
                let path = Path::new(path);
                let mut sources = Sources::of_graph(graph);
                self.evaluation.inputs.protect(&mut sources);
                let file = path.file_name().unwrap_or_default().to_string_lossy();
                let files = NewFile::single(&file, rows.csv().into_bytes());
                return write_files(Ok(files), path, &sources);
            }
            None if self.json => print_json(&rows.json()),
            None => print(&format!("{name}\n{}", rows.table())),
        }
        Exit::Done
    }

    fn write(
        &self,
        (value, broken): (&AnyValue, &[UnmetRequirement]),
        path: &Path,
        catalog: &Arc<Catalog>,
        sources: &Sources,
        source: Option<ValueSource<'_>>,
    ) -> Exit {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let own = catalog.format(value.kind(), &extension(path));
        let request = PictureRequest { broken, ..self.request() };
        let is_marked = broken.iter().any(|broken| 0 < broken.violation.count);
        let is_asked = self.view.is_some() || request.has_target() || is_marked;
        let is_seen = is_asked || own.is_none() || is_best_seen(value);
        if extension(path) == "png" && is_seen {
            return match request.picture(value, source) {
                Ok(picture) => {
                    let bytes = png::encode_rgb(&picture);
                    write_files(bytes.map(|bytes| NewFile::single(&name, bytes)), path, sources)
                }
                Err(exit) => exit,
            };
        }
        let files = own.map_or_else(|| Ok(Vec::new()), |format| format.write(value, &name));
        write_files(files, path, sources)
    }
}

/// Returns the name of an output for display. If `is_numbered` is true, appends the number of the element, counted from 1.
fn output_label(name: &str, index: usize, is_numbered: bool) -> String {
    if is_numbered { format!("{name} {}", index + 1) } else { name.to_owned() }
}

/// Returns the first value that can be written to a file with this extension. If no value can, the error is a message with the extensions
/// to which the values can be written.
fn choose_written<'v>(
    node: &str,
    found: &[(&'v str, &'v AnyValue)],
    ending: &str,
    catalog: &Arc<Catalog>,
) -> Result<(&'v str, &'v AnyValue), String> {
    fn fits(value: &AnyValue, ending: &str, catalog: &Arc<Catalog>) -> bool {
        catalog.format(value.kind(), ending).is_some() || ending == "png" && is_drawn(value)
    }
    if let Some(found) = found.iter().find(|(_, value)| fits(value, ending, catalog)) {
        return Ok(*found);
    }
    fn can_be_seen(value: &AnyValue) -> bool {
        !value.show().is_empty()
    }
    let seen = found.iter().find(|(_, value)| ending == "png" && can_be_seen(value));
    if let Some(found) = seen {
        return Ok(*found);
    }
    let can = found.iter().map(|(name, value)| {
        let mut known = catalog.extensions(Some(value.kind()));
        known.extend((can_be_seen(value) && !known.contains(&"png")).then_some("png"));
        let what = with_article(value.kind().name);
        match known.is_empty() {
            true => format!("{node}.{name}, {what}, has no file format"),
            false => format!("{node}.{name}, {what}, can be written to: {}", known.join(", ")),
        }
    });
    Err(Vec::from_iter(can).join("; "))
}

/// Returns true if a picture displays the value in false colors, because the value itself has no colors.
fn is_drawn(value: &AnyValue) -> bool {
    first_picture(value).is_some_and(|picture| picture.has_false_colors)
}

/// Returns true if a rendered picture shows more of the value than a file in its own format. This is so if the value is displayed in false
/// colors, or has visible parts other than faces, such as points.
fn is_best_seen(value: &AnyValue) -> bool {
    match &value.show()[..] {
        [] | [Layer::Triangles(_)] => false,
        layers => picture_layer(layers).is_none_or(|picture| picture.has_false_colors),
    }
}

/// Writes all files, or none if one of them must not be written, for instance because it would overwrite an input.
fn write_files(files: Result<Vec<NewFile>, Error>, path: &Path, sources: &Sources) -> Exit {
    fn write_error(path: &Path, why: &dyn std::fmt::Display) -> Exit {
        Exit::Usage(format!("cannot write {}: {why}", path.for_display()))
    }
    let files = match files {
        Ok(files) => files.into_iter().map(|file| (path.with_file_name(&file.name), file.bytes)),
        Err(error) => return write_error(path, &error),
    };
    match Destination::anywhere(sources).put_all(&Vec::from_iter(files)) {
        Ok(()) => Exit::Done,
        Err((path, refused)) => write_error(&path, &refused),
    }
}

/// Formats facts as a table with two columns, for the name and the value.
fn fact_table(summary: &Summary) -> String {
    let longest = summary.0.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let mut text = String::new();
    for (label, fact) in &summary.0 {
        let _ = writeln!(text, "  {label:<longest$}  {}", format_fact(fact));
    }
    text
}

/// Formats a histogram, for example `0 ▁▂█▄ 1`.
fn histogram(fact: &Json) -> String {
    const HEIGHTS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let counts = fact["counts"].as_array().into_iter().flatten().filter_map(Json::as_u64);
    let counts: Vec<u64> = counts.collect();
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    // Round up, so that a bin with a single number is visible.
    let bars: String =
        counts.iter().map(|count| HEIGHTS[(count * 8).div_ceil(most) as usize]).collect();
    format!("{} {bars} {}", format_fact(&fact["from"]), format_fact(&fact["to"]))
}

fn format_fact(fact: &Json) -> String {
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
            format!("({})", items.iter().map(format_fact).collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}
