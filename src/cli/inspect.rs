//! `maquette inspect`: any value of a graph, and the eyedropper.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{Run, Wanted};
use maquette_engine::writing::{Destination, Sources};
use maquette_format::png;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Asked, Broken, Checked, ELEMENTS, Graph, GraphOutput};
use maquette_node::CancelToken;
use maquette_node::pack::NewFile;
use maquette_preview::probe;
use maquette_preview::probe::shown;
use maquette_render::{Kind, View, picture_of};
use maquette_syntax::error::{Error, Problem, code};
use maquette_syntax::with_article;
use maquette_value::plain::ending;
use maquette_value::{AnyValue, Layer, Summary};
use serde_json::{Value as Json, json};

use super::caching::CacheOptions;
use super::inputs::InputOptions;
use super::look::{At, Over, Request, Source, at};
use super::new::in_meters;
use super::progress::Progress;
use super::{Exit, GraphOptions, eprint, in_bytes, print, print_document, print_json, report};

mod broken;
mod columns;
mod elements;
mod rows;

use rows::{RowOptions, Rows};

use crate::Shown;

#[derive(Args)]
pub(crate) struct Inspect {
    /// The graph file, or a file with a value: a mesh, points, a curve, a range image, a picture.
    #[arg(value_name = "GRAPH|FILE")]
    file: PathBuf,
    /// The node of the graph, or one of its outputs: NODE.OUTPUT. A value's own file has none.
    #[arg(value_name = "NODE[.OUTPUT]")]
    node: Option<String>,
    /// Two numbers: what is under this pixel of the capture's picture: color, label, point. Three numbers, or a name: what is in the
    /// middle of the picture that is written, a place, in mm, in the value's own axes, or a value, such as a region, which then just
    /// fits into it.
    #[arg(
        long,
        value_name = "X,Y|X,Y,Z|NODE[.OUTPUT]",
        value_parser = at,
        allow_hyphen_values = true
    )]
    at: Option<At>,
    /// Print its columns of numbers: what they lie on, what they mean, how many there are, and the least, the greatest and the mean of
    /// each number of an element. Of a kind of elements, such as `faces`, print the elements.
    #[arg(long, value_name = "ELEMENTS", num_args = 0..=1, conflicts_with = "at")]
    table: Option<Option<String>>,
    #[command(flatten)]
    rows: RowOptions,
    /// Write the value to this file, too; its ending chooses the format. A `.png` is a picture to look at, of whatever can be seen: of
    /// labels, regions and range images, of points, curves, nets and handles, too.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// From where what lies in space is seen in a picture: how far to the right and above, in degrees, and how much nearer than
    /// what just fits.
    #[arg(long, value_name = "YAW,PITCH[,ZOOM]", value_parser = view, allow_hyphen_values = true, requires = "out")]
    view: Option<View>,
    #[command(flatten)]
    over: Over,
    #[command(flatten)]
    inputs: InputOptions,
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

pub(super) fn view(text: &str) -> Result<View, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[yaw, pitch]) => Ok(View { yaw, pitch, ..View::front() }),
        Ok(&[yaw, pitch, zoom]) => Ok(View { yaw, pitch, zoom, ..View::front() }),
        _ => Err("write YAW,PITCH or YAW,PITCH,ZOOM".into()),
    }
}

/// The node that stands for a file that is no graph.
const FILE: &str = "file";

/// The name of an output, and its node and place there.
type Found = (String, (usize, usize));

impl Inspect {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let (checked, inputs) = match self.checked(catalog) {
            Ok(checked) => checked,
            Err(why) => return Exit::Usage(why),
        };
        let checked = checked.as_far_as_known();
        // What is looked into says itself if it depends on a node of an unknown type or on a missing file.
        fn is_of_node(it: &Problem) -> bool {
            matches!(it.code, code::UNKNOWN_NODE | code::MISSING_FILE)
        }
        report(
            &checked
                .problems
                .iter()
                .filter(|it| checked.graph.is_none() || !is_of_node(it))
                .cloned()
                .collect::<Vec<_>>(),
        );
        let Some(graph) = checked.graph else { return Exit::Failed };
        if let Err(why) = self.check() {
            return Exit::Usage(why);
        }
        // What is only known when it has been computed is looked for then.
        let is_whole = graph.loops().is_empty();
        if is_whole && let Err(why) = self.find(&graph) {
            return Exit::Usage(why);
        }
        let mut session = match self.cache.told_session(self.threads, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let graph = match inputs.told(&session, &graph) {
            Ok(graph) => graph,
            Err(exit) => return exit,
        };
        let progress = Progress::new(graph.nodes().len());
        let request = self.request();
        let names = Vec::from_iter([self.node()].into_iter().chain(request.names()));
        let graph = session.resolved_for(&graph, &names, &progress, &CancelToken::default());
        let outputs = match self.find(&graph) {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        if let Err(why) = request.check(Some(&graph)) {
            return Exit::Usage(why);
        }
        let wanted = Wanted::Nodes(
            outputs.iter().map(|&(_, (node, _))| graph.nodes()[node].name.clone()).collect(),
        );
        let run = Run { wanted, observer: &progress, ..Run::default() };
        let finished = session.run(&graph, &run);
        progress.end();
        let finished = match finished {
            Ok(finished) => finished,
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        let problems = finished.problems();
        if !self.json {
            report(&problems);
        }
        let found = outputs
            .iter()
            .filter_map(|(name, target)| Some((&name[..], finished.value_at(*target)?)));
        let found = Vec::from_iter(found);
        let node = self.node().split_once('.').map_or(self.node(), |(node, _)| node);
        let node = self.file(&graph).map_or(node, |file| &graph.nodes()[file.node].name);
        if outputs.is_empty() && !self.json {
            if self.out.is_some() {
                return Exit::Usage(format!("`{node}` is a list of 0: there is no value to write"));
            }
            print(&format!("{node}: a list of 0\n"));
            return Exit::Done;
        }
        let found = match self.asked(node, found) {
            Ok(found) => found,
            Err(why) => return Exit::Usage(why),
        };
        let chosen = match &self.out {
            Some(path) if !found.is_empty() => match chosen(node, &found, &ending(path), catalog) {
                Ok(chosen) => Some(chosen),
                Err(why) => return Exit::Usage(why),
            },
            _ => None,
        };
        let elements = self.table.as_ref().and_then(|of| of.as_deref());
        if (elements.is_some() || self.rows.are_given()) && !found.is_empty() {
            return match self.rows.rows(elements, &found) {
                Ok((name, rows)) => self.print_rows(&format!("{node}.{name}"), &rows, &graph),
                Err(why) => Exit::Usage(why),
            };
        }
        fn of(name: &str, outputs: &[(String, (usize, usize))]) -> Option<(usize, usize)> {
            outputs.iter().find(|(output, _)| output == name).map(|it| it.1)
        }
        let broken: Vec<_> = found
            .iter()
            .map(|(name, value)| {
                let asked = of(name, &outputs).map_or(Vec::new(), |target| graph.asked_of(target));
                Asked::broken(&asked, value)
            })
            .collect();
        self.print(node, &found, &broken, &problems);
        let (Some(path), Some((name, value))) = (&self.out, chosen) else {
            return if found.is_empty() { Exit::Failed } else { Exit::Done };
        };
        if !self.json && found.len() > 1 {
            print(&format!("{node}.{name} goes to {}\n", path.shown()));
        }
        let mut sources = Sources::of(&graph);
        inputs.protect(&mut sources);
        let from = of(name, &outputs).map(|(node, _)| node);
        let source = from.map(|node| Source { graph: &graph, node, session: &mut session });
        let broken = found.iter().zip(&broken).find(|((output, _), _)| *output == name);
        let broken = broken.map_or(&[][..], |(_, broken)| broken);
        self.write((value, broken), path, catalog, &sources, source)
    }

    fn node(&self) -> &str {
        self.node.as_deref().unwrap_or(FILE)
    }

    /// The graph, and what comes into it: of a file that is none one that hands its value on.
    fn checked(&self, catalog: &Catalog) -> Result<(Checked, InputOptions), String> {
        let file = self.file.shown();
        if self.node.is_some() {
            return Ok((self.options.load(&self.file, catalog), self.inputs.clone()));
        }
        if ending(&self.file) == "ron" {
            let graph = self.options.load(&self.file, catalog).as_far_as_known().graph;
            let nodes = graph.iter().flat_map(|graph| graph.nodes().iter());
            let nodes: Vec<_> = nodes.map(|node| &node.name[..]).collect();
            return Err(format!("say which node of {file}: {}", nodes.join(", ")));
        }
        let (value, _) = catalog.readers().open(&self.file, None)?;
        if in_meters(&self.file) {
            eprint("note: by this format the numbers are meters: read it with `unit: M`\n");
        }
        let kind = value.kind().name;
        let text = format!(
            "Graph(format: 1, inputs: {{ \"{FILE}\": {kind}() }}, nodes: {{}}, outputs: {{ \"{FILE}\": \"{FILE}\" }})"
        );
        let checked = Graph::load_text(&self.file, text, catalog, &self.options.all());
        Ok((checked, InputOptions::of(FILE, &self.file)))
    }

    /// The pixel that is asked for.
    fn pixel(&self) -> Option<[usize; 2]> {
        match self.at {
            Some(At::Pixel(pixel)) => Some(pixel),
            Some(At::Place(_) | At::Value(_)) | None => None,
        }
    }

    /// What the options say of a picture.
    fn request(&self) -> Request<'_> {
        let at = self.at.as_ref().filter(|_| self.pixel().is_none());
        let is_aimed = self.view.is_some() || at.is_some();
        let kind = if is_aimed { Kind::Space } else { Kind::Own };
        let view = self.view.unwrap_or_else(View::front);
        Request { view, kind, at, over: &self.over, broken: &[] }
    }

    /// Whether there is a picture if the options say something of one.
    fn check(&self) -> Result<(), String> {
        let has_picture = self.out.as_ref().is_some_and(|path| ending(path) == "png");
        if has_picture || !self.request().is_special() {
            return Ok(());
        }
        Err("--at X,Y,Z, --at NODE and --over NODE are for a picture: add --out FILE.png".into())
    }

    /// The values that have something to say: of a pixel, if one is asked for.
    fn asked<'v>(
        &self,
        node: &str,
        found: Vec<(&'v str, &'v AnyValue)>,
    ) -> Result<Vec<(&'v str, &'v AnyValue)>, String> {
        let Some(at) = self.pixel().filter(|_| !found.is_empty()) else { return Ok(found) };
        let answering: Vec<_> =
            found.iter().filter(|(_, value)| probe::at(value, at).is_some()).copied().collect();
        if answering.is_empty() { Err(probe::no_answer(node, &found, at)) } else { Ok(answering) }
    }

    /// The output file that is meant, if its name means nothing else.
    fn file<'g>(&self, graph: &'g Graph) -> Option<&'g GraphOutput> {
        let (name, output) = self.node().split_once('.')?;
        let mut used = graph.uses().iter().filter(|given| given.name == name);
        let is_value =
            graph.find(name).is_some_and(|it| graph.nodes()[it].outputs.contains(&output))
                || used.any(|given| given.outputs.iter().any(|(known, _)| known == output));
        graph.outputs().iter().find(|file| file.name == self.node() && !is_value)
    }

    /// The outputs that are meant, by name, each with its node and place there.
    fn find(&self, graph: &Graph) -> Result<Vec<Found>, String> {
        if let Some(GraphOutput { node, output, .. }) = self.file(graph) {
            let name = graph.nodes()[*node].outputs[*output].to_owned();
            return Ok(vec![(name, (*node, *output))]);
        }
        let (name, output) = match self.node().split_once('.') {
            Some((name, output)) => (name, Some(output)),
            None => (self.node(), None),
        };
        let outputs: Vec<Found> = match graph.find(name) {
            Some(node) => {
                let names = graph.nodes()[node].outputs.iter().enumerate();
                // The elements of data have no names, but numbers.
                fn label(index: usize, name: &str, node: usize, graph: &Graph) -> String {
                    match graph.nodes()[node].kind() {
                        ELEMENTS => format!("{name} {}", index + 1),
                        _ => name.to_owned(),
                    }
                }
                names
                    .map(|(index, name)| (label(index, name, node, graph), (node, index)))
                    .collect()
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
                    let one = targets.len() == 1;
                    fn label(k: usize, name: &str, one: bool) -> String {
                        match one {
                            true => name.to_owned(),
                            false => format!("{name} {}", k + 1),
                        }
                    }
                    targets
                        .iter()
                        .enumerate()
                        .map(move |(k, &target)| (label(k, name, one), target))
                });
                all.collect()
            }
        };
        let Some(output) = output else { return Ok(outputs) };
        let names = outputs.iter().map(|(name, _)| &name[..]).collect::<Vec<_>>().join(", ");
        fn none(name: &str, output: &str, names: &str) -> String {
            format!("`{name}` has no output `{output}`; its outputs: {names}")
        }
        fn is_meant(name: &str, output: &str) -> bool {
            name.strip_prefix(output).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
        }
        let error = none(name, output, &names);
        let found: Vec<_> =
            outputs.into_iter().filter(|(name, _)| is_meant(name, output)).collect();
        if found.is_empty() { Err(error) } else { Ok(found) }
    }

    fn print(
        &self,
        node: &str,
        found: &[(&str, &AnyValue)],
        broken: &[Vec<Broken>],
        problems: &[Problem],
    ) {
        let summary = |value: &AnyValue| match self.pixel() {
            Some(at) => value.probe(at),
            None => value.describe(),
        };
        if self.json {
            let outputs = found.iter().zip(broken).map(|((name, value), broken)| {
                let facts = probe::facts(summary(value));
                let (kind, hash) = (value.kind().name, value.hash().to_string());
                let mut output = json!({ "name": name, "type": kind, "hash": hash, "bytes": value.size(), "facts": facts });
                if !broken.is_empty() {
                    let all = broken.iter().map(|broken| broken.to_json(usize::MAX));
                    output["broken"] = all.collect();
                }
                if self.table.is_some() {
                    output["parts"] = columns::json(&value.parts());
                }
                output
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
        for ((name, value), broken) in found.iter().zip(broken) {
            let (kind, size) = (value.kind().name, in_bytes(value.size()));
            let _ = match self.pixel() {
                Some([x, y]) => writeln!(text, "{node}.{name}: {kind} at ({x}, {y})"),
                None => writeln!(text, "{node}.{name}: {kind}, {size}, {}", value.hash().short()),
            };
            text += &if self.table.is_some() {
                columns::table(&value.parts())
            } else {
                table(&summary(value))
            };
            text += &broken::table(broken);
        }
        print(&text);
    }

    fn print_rows(&self, name: &str, rows: &Rows, graph: &Graph) -> Exit {
        match self.rows.csv.as_deref() {
            Some("-") => print_document(&rows.csv()),
            Some(path) => {
                let path = Path::new(path);
                let mut sources = Sources::of(graph);
                self.inputs.protect(&mut sources);
                let file = path.file_name().unwrap_or_default().to_string_lossy();
                let files = NewFile::only(&file, rows.csv().into_bytes());
                return write_files(Ok(files), path, &sources);
            }
            None if self.json => print_json(&rows.json()),
            None => print(&format!("{name}\n{}", rows.table())),
        }
        Exit::Done
    }

    fn write(
        &self,
        (value, broken): (&AnyValue, &[Broken]),
        path: &Path,
        catalog: &Arc<Catalog>,
        sources: &Sources,
        source: Option<Source<'_>>,
    ) -> Exit {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let own = catalog.format(value.kind(), &ending(path));
        let request = Request { broken, ..self.request() };
        let is_marked = broken.iter().any(|broken| 0 < broken.offence.count);
        let is_asked = self.view.is_some() || request.is_special() || is_marked;
        let is_seen = is_asked || own.is_none() || is_best_seen(value);
        if ending(path) == "png" && is_seen {
            return match request.picture(value, source) {
                Ok(picture) => {
                    let bytes = png::encode_rgb(&picture).map_err(Error::from);
                    write_files(bytes.map(|bytes| NewFile::only(&name, bytes)), path, sources)
                }
                Err(exit) => exit,
            };
        }
        let files = own.map_or_else(|| Ok(Vec::new()), |format| format.write(value, &name));
        write_files(files, path, sources)
    }
}

/// The first of some values that can be written to a file with this ending, or what can be written instead.
fn chosen<'v>(
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
        let mut known = catalog.endings(Some(value.kind()));
        known.extend((can_be_seen(value) && !known.contains(&"png")).then_some("png"));
        let what = with_article(value.kind().name);
        match known.is_empty() {
            true => format!("{node}.{name}, {what}, has no file format"),
            false => format!("{node}.{name}, {what}, can be written to: {}", known.join(", ")),
        }
    });
    Err(Vec::from_iter(can).join("; "))
}

/// Whether a value is best seen as the picture that it shows: in colors that are none of its own.
fn is_drawn(value: &AnyValue) -> bool {
    shown(value).is_some_and(|picture| picture.drawn)
}

/// Whether a picture shows what a picture file of the value's own format does not: made-up colors, or more than faces.
fn is_best_seen(value: &AnyValue) -> bool {
    match &value.show()[..] {
        [] | [Layer::Triangles(_)] => false,
        layers => picture_of(layers).is_none_or(|picture| picture.drawn),
    }
}

/// Writes all files, or none if one of them may not be written.
fn write_files(files: Result<Vec<NewFile>, Error>, path: &Path, sources: &Sources) -> Exit {
    fn failed(path: &Path, why: &dyn std::fmt::Display) -> Exit {
        Exit::Usage(format!("cannot write {}: {why}", path.shown()))
    }
    let files = match files {
        Ok(files) => files.into_iter().map(|file| (path.with_file_name(&file.name), file.bytes)),
        Err(error) => return failed(path, &error),
    };
    match Destination::anywhere(sources).put_all(&Vec::from_iter(files)) {
        Ok(()) => Exit::Done,
        Err((path, refused)) => failed(&path, &refused),
    }
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
    let bars: String =
        counts.iter().map(|count| HEIGHTS[(count * 8).div_ceil(most) as usize]).collect();
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
