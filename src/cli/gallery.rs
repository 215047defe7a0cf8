//! `maquette gallery`: a page of all graphs of a folder, each with its picture, its parameters and what it is for.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::Session;
use maquette_engine::writing::{Destination, Refused, Sources};
use maquette_format::png;
use maquette_golden::suite::FileKind;
use maquette_graph::catalog::{Catalog, Description, describe_default, describe_parameter};
use maquette_graph::{Graph, Options, Subgraph};
use maquette_render::{View, render};
use maquette_syntax::any_of;
use maquette_value::AnyValue;
use maquette_value::plain;
use serde_json::Value as Json;

use super::caching::CacheOptions;
use super::files::is_no_graph;
use super::{Exit, all_outputs, counted, eprint, print, report};

#[derive(Args)]
pub(crate) struct Gallery {
    /// The folder of graphs. The page is its README.md, the pictures lie in `pictures/`.
    #[arg(default_value = "graphs", value_name = "FOLDER")]
    graphs: PathBuf,
    /// Write nothing and compute nothing; fail if the page is not up to date or a picture is missing.
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    cache: CacheOptions,
}

/// Width and height of a picture in pixels: several fit side by side, and each takes some tens of kilobytes.
const SIZE: [usize; 2] = [320, 240];

/// From the right and a little above, so that depth is seen.
const VIEW: View = View { size: SIZE, yaw: 25.0, pitch: 10.0, ..FRONT };
const FRONT: View = View {
    size: SIZE,
    yaw: 0.0,
    pitch: 0.0,
    zoom: 1.0,
    projection: maquette_render::Projection::Perspective,
    aim: None,
};

const PAGE: &str = "README.md";
const PICTURES: &str = "pictures";

impl Gallery {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        match self.make(catalog) {
            Ok(exit) => exit,
            Err(why) => {
                eprint(&format!("error: {why}\n"));
                Exit::Failed
            }
        }
    }

    fn make(&self, catalog: &Arc<Catalog>) -> Result<Exit, String> {
        let (mut page, mut example) = (String::new(), None);
        let mut used: Vec<Subgraph> = Vec::new();
        let mut session = None;
        let mut complete = true;
        let (mut pictures, mut sources) = (Vec::new(), Sources::default());
        let graphs = graphs(&self.graphs)?;
        for path in &graphs {
            let checked = Graph::load(path, catalog, &Options::default()).as_far_as_known();
            report(&checked.problems);
            let graph = checked.graph.ok_or_else(|| format!("{} has problems", path.display()))?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let picture = Path::new(PICTURES).join(&name).with_extension("png");
            let (subgraphs, _) = Graph::subgraphs(path, catalog, &Options::default());
            self.entry(&mut page, &name, &picture, &graph, &subgraphs);
            example = example.or_else(|| Some((path, number_of(&graph)?)));
            let file = self.graphs.join(&picture);
            if self.check {
                complete &= file.is_file();
            } else {
                let session = match &mut session {
                    Some(session) => session,
                    none => none.insert(self.cache.told_session(0, catalog)?),
                };
                let bytes = picture_of(&graph, session)
                    .ok_or_else(|| format!("{} gives nothing to be seen", path.display()))?;
                pictures.push((file, bytes));
            }
            sources.extend(&Sources::of(&graph));
            for subgraph in subgraphs {
                if used.iter().all(|known| known.file != subgraph.file) {
                    used.push(subgraph);
                }
            }
        }
        self.library(&mut page, &mut used);
        let page = self.head(example) + &page;
        // What the authors of graphs wrote is text with emphasis, and no markup for a browser.
        let page = page.replace('<', "&lt;");
        let path = self.graphs.join(PAGE);
        if !self.check {
            self.put(&path, &page, &pictures, &sources)?;
            print(&format!("{}: {}\n", path.display(), counted(graphs.len(), "graph")));
            return Ok(Exit::Done);
        }
        if complete && plain::read_text(&path).is_ok_and(|known| known == page) {
            return Ok(Exit::Done);
        }
        Err(format!("{} is not up to date: `maquette gallery` makes it anew", path.display()))
    }

    /// Writes the page and its pictures, unless that would replace what is not ours: a page says that it is, and which pictures
    /// are. It is written first, so that the pictures of a gallery that was stopped are known, too.
    fn put(
        &self,
        path: &Path,
        page: &str,
        pictures: &[(PathBuf, Vec<u8>)],
        sources: &Sources,
    ) -> Result<(), String> {
        let known = plain::read_own_text(path).unwrap_or_default();
        fn foreign(path: &Path) -> Result<(), String> {
            let what =
                "no gallery made this file; move it away, or make the gallery of another folder";
            Err(format!("cannot write {}: {what}", path.display()))
        }
        if path.exists() && !known.starts_with(MARK) {
            return foreign(path);
        }
        for (path, bytes) in pictures {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_ours = known.contains(&format!("({PICTURES}/{name})"));
            if path.exists() && !is_ours && !holds(path, bytes) {
                return foreign(path);
            }
        }
        let destination = Destination::folder(&self.graphs, sources);
        let pictures = pictures.iter().map(|(path, bytes)| (&**path, &bytes[..]));
        let all = [(path, page.as_bytes())].into_iter().chain(pictures);
        let new: Vec<_> = all.filter(|(path, bytes)| !holds(path, bytes)).collect();
        fn failed(path: &Path, why: Refused) -> String {
            format!("cannot write {}: {why}", path.display())
        }
        new.iter()
            .try_for_each(|(path, _)| destination.judge(path).map_err(|why| failed(path, why)))?;
        new.iter()
            .try_for_each(|(path, it)| destination.put(path, it).map_err(|why| failed(path, why)))
    }

    /// How the page begins, with a graph of the folder that has a number to be set.
    fn head(&self, example: Option<(&PathBuf, (String, Json))>) -> String {
        let folder = self.graphs.display();
        let mut head = format!("{MARK} {folder}`. ");
        let Some((path, (name, value))) = example else { return head + "\n" };
        let graph = path.strip_prefix(".").unwrap_or(path).display();
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let _ = writeln!(
            head,
            "Run a graph as it stands, `maquette run {graph}`, with other values,\n`--set {name}={value}`, or as a file of its own \
             that says what differs: `Patch(of: \"{file}\", params: {{ \"{name}\": {value} }})`."
        );
        head
    }

    fn entry(
        &self,
        page: &mut String,
        name: &str,
        picture: &Path,
        graph: &Graph,
        used: &[Subgraph],
    ) {
        let (picture, doc) = (picture.display(), graph.doc());
        let _ = write!(page, "\n## [{name}]({name}.ron)\n\n![{name}]({picture})\n\n{doc}\n\n");
        let fields = graph.schema().get("properties").and_then(Json::as_object);
        for (name, field) in fields.into_iter().flatten() {
            parameter(page, name, field, graph.schema());
        }
        let outputs: Vec<_> = graph.output_names().map(|name| format!("`{name}`")).collect();
        let _ = writeln!(page, "- writes {}", outputs.join(", "));
        if !used.is_empty() {
            let link = |it: &Subgraph| format!("[{}]({})", it.name, self.relative(&it.file));
            let _ =
                writeln!(page, "- uses {}", used.iter().map(link).collect::<Vec<_>>().join(", "));
        }
    }

    /// What graphs in the folder are made of.
    fn library(&self, page: &mut String, used: &mut [Subgraph]) {
        if used.is_empty() {
            return;
        }
        used.sort_by(|a, b| a.file.cmp(&b.file));
        *page += LIBRARY;
        for subgraph in used {
            let Description { name, schema, outputs, .. } = subgraph.description();
            let doc = schema["description"].as_str().unwrap_or_default();
            let _ = write!(page, "\n### [{name}]({})\n\n{doc}\n\n", self.relative(&subgraph.file));
            let ports = subgraph.description().ports();
            for port in &ports {
                let types = any_of(port.types.iter().map(String::as_str));
                let _ = writeln!(page, "- takes `{}`, {types}: {}", port.name, port.doc);
            }
            let fields = schema.get("properties").and_then(Json::as_object);
            for (name, field) in fields.into_iter().flatten() {
                if ports.iter().all(|port| port.name != *name) {
                    parameter(page, name, field, schema);
                }
            }
            for (name, types) in outputs {
                let _ = writeln!(page, "- gives `{name}`, {}", any_of(types));
            }
        }
    }

    fn relative(&self, file: &str) -> String {
        let path = Path::new(file);
        path.strip_prefix(&self.graphs).unwrap_or(path).display().to_string().replace('\\', "/")
    }
}

/// How every page begins.
const MARK: &str = "# Graphs to start from\n\nThis page is made by `maquette gallery";

const LIBRARY: &str = "
## To be used in other graphs

Name the file under `use`, and it is a node like any other: `maquette nodes GRAPH` prints its reference.
";

/// One line for a parameter.
fn parameter(page: &mut String, name: &str, field: &Json, root: &Json) {
    let (kind, default) = (describe_parameter(field, root), describe_default(field, root));
    let doc = field["description"].as_str().unwrap_or_default();
    let _ = writeln!(page, "- `{name}`: {kind}{default}. {doc}");
}

/// The first number among the parameters of a graph, and the most that it may be.
fn number_of(graph: &Graph) -> Option<(String, Json)> {
    let fields = graph.schema().get("properties").and_then(Json::as_object)?;
    fn most(field: &Json) -> Option<Json> {
        field.get("maximum").filter(|_| field["type"] == "number").cloned()
    }
    fields.iter().find_map(|(name, field)| Some((name.clone(), most(field)?)))
}

/// The graphs of a folder, by name; tests, lock files, pins and handles are none.
fn graphs(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let unread = |error: std::io::Error| format!("cannot read {}: {error}", folder.display());
    let entries = std::fs::read_dir(folder).map_err(unread)?;
    let mut graphs = Vec::new();
    for entry in entries {
        let path = entry.map_err(unread)?.path();
        let is_ron = path.extension().is_some_and(|ending| ending == "ron");
        fn text(path: &Path) -> String {
            plain::read_text(path).unwrap_or_default()
        }
        fn is_graph(path: &Path) -> bool {
            FileKind::of(path, &text(path)) == FileKind::Graph
        }
        if path.is_file() && is_ron && !is_no_graph(&path) && is_graph(&path) {
            graphs.push(path);
        }
    }
    graphs.sort();
    Ok(graphs)
}

/// The first output that has faces, as it looks.
fn picture_of(graph: &Graph, session: &mut Session) -> Option<Vec<u8>> {
    let finished = all_outputs(session, graph)?;
    let mesh =
        graph.output_names().filter_map(|name| finished.value(name)).find_map(AnyValue::as_mesh)?;
    png::encode_rgb(&render(&mesh, &VIEW)).ok()
}

fn holds(path: &Path, bytes: &[u8]) -> bool {
    plain::read_own(path).is_ok_and(|known| known == bytes)
}
