//! `maquette render gallery`: writes a page about all graphs in a folder, each with a picture, a description and its parameters.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::writing::{Destination, Sources, WriteError};
use maquette_format::png;
use maquette_golden::suite::FileKind;
use maquette_graph::catalog::{Catalog, Description, describe_default, describe_parameter};
use maquette_graph::{Graph, Options, Subgraph};
use maquette_syntax::any_of;
use maquette_value::fs;
use serde_json::Value as Json;

use crate::cache_options::CacheOptions;
use crate::files::is_no_graph;
use crate::{Exit, eprint, format_count, print, report};

mod tile;

#[derive(Args)]
pub(crate) struct Gallery {
    /// The folder of graphs. The page is README.md in this folder; the pictures are in `pictures/`.
    #[arg(default_value = "graphs", value_name = "FOLDER")]
    graphs: PathBuf,
    /// Write and compute nothing. Fail if the page is out of date or a picture is missing.
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    cache: CacheOptions,
}

const PAGE: &str = "README.md";
const PICTURES: &str = "pictures";

impl Gallery {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        match self.make_page(catalog) {
            Ok(exit) => exit,
            Err(why) => {
                eprint(&format!("error: {why}\n"));
                Exit::Failed
            }
        }
    }

    fn make_page(&self, catalog: &Arc<Catalog>) -> Result<Exit, String> {
        let (mut page, mut example) = (String::new(), None);
        let mut used: Vec<Subgraph> = Vec::new();
        let mut session = None;
        let mut complete = true;
        let (mut pictures, mut sources) = (Vec::new(), Sources::default());
        let graphs = graphs(&self.graphs)?;
        for path in &graphs {
            let checked = Graph::load(path, catalog, &Options::default()).without_unknown_nodes();
            report(&checked.diagnostics);
            let graph = checked.graph.ok_or_else(|| format!("{} has errors", path.display()))?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let picture = Path::new(PICTURES).join(&name).with_extension("png");
            let (subgraphs, _) = Graph::subgraphs(path, catalog, &Options::default());
            self.push_entry(&mut page, &name, &picture, &graph, &subgraphs);
            example = example.or_else(|| Some((path, numeric_parameter(&graph)?)));
            let file = self.graphs.join(&picture);
            if self.check {
                complete &= file.is_file();
            } else {
                let session = match &mut session {
                    Some(session) => session,
                    none => none.insert(self.cache.reporting_session(0, catalog)?),
                };
                let bytes = tile::draw(&graph, session)
                    .and_then(|picture| png::encode_rgb(&picture).ok())
                    .ok_or_else(|| format!("{} has no visible output", path.display()))?;
                pictures.push((file, bytes));
            }
            sources.extend(&Sources::of_graph(&graph));
            for subgraph in subgraphs {
                if used.iter().all(|known| known.file != subgraph.file) {
                    used.push(subgraph);
                }
            }
        }
        self.push_library(&mut page, &mut used);
        let page = self.page_head(example) + &page;
        // Escape `<`, so that the page contains no HTML. The descriptions of graphs are Markdown, which may contain HTML.
        let page = page.replace('<', "&lt;");
        let path = self.graphs.join(PAGE);
        if !self.check {
            self.write_files(&path, &page, &pictures, &sources)?;
            print(&format!("{}: {}\n", path.display(), format_count(graphs.len(), "graph")));
            return Ok(Exit::Done);
        }
        if complete && fs::read_text(&path).is_ok_and(|known| known == page) {
            return Ok(Exit::Done);
        }
        Err(format!("{} is out of date: run `maquette render gallery`", path.display()))
    }

    /// Writes the page and its pictures, unless this would replace files that were not written by a gallery. A page of a gallery is
    /// recognized by its first words, and it lists its pictures. The page is written first, so that it also lists the pictures of an
    /// interrupted run.
    fn write_files(
        &self,
        path: &Path,
        page: &str,
        pictures: &[(PathBuf, Vec<u8>)],
        sources: &Sources,
    ) -> Result<(), String> {
        let known = fs::read_text_no_follow(path).unwrap_or_default();
        fn foreign_file_error(path: &Path) -> Result<(), String> {
            let what = "a gallery did not write this file; move it, or choose another folder";
            Err(format!("cannot write {}: {what}", path.display()))
        }
        if path.exists() && !is_gallery(&known) {
            return foreign_file_error(path);
        }
        for (path, bytes) in pictures {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let is_ours = known.contains(&format!("({PICTURES}/{name})"));
            if path.exists() && !is_ours && !has_content(path, bytes) {
                return foreign_file_error(path);
            }
        }
        let destination = Destination::folder(&self.graphs, sources);
        let pictures = pictures.iter().map(|(path, bytes)| (&**path, &bytes[..]));
        let all = [(path, page.as_bytes())].into_iter().chain(pictures);
        let new: Vec<_> = all.filter(|(path, bytes)| !has_content(path, bytes)).collect();
        fn write_error(path: &Path, why: WriteError) -> String {
            format!("cannot write {}: {why}", path.display())
        }
        new.iter().try_for_each(|(path, _)| {
            destination.check(path).map_err(|why| write_error(path, why))
        })?;
        new.iter().try_for_each(|(path, it)| {
            destination.put(path, it).map_err(|why| write_error(path, why))
        })
    }

    /// Returns the beginning of the page. `example` is a graph in the folder with a numeric parameter, which the text mentions as an
    /// example.
    fn page_head(&self, example: Option<(&PathBuf, (String, Json))>) -> String {
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

    fn push_entry(
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
            push_parameter(page, name, field, graph.schema());
        }
        let outputs: Vec<_> = graph.output_names().map(|name| format!("`{name}`")).collect();
        let _ = writeln!(page, "- writes {}", outputs.join(", "));
        if !used.is_empty() {
            let links = used.iter().map(|it| format!("[{}]({})", it.name, self.relative(&it.file)));
            let _ = writeln!(page, "- uses {}", links.collect::<Vec<_>>().join(", "));
        }
    }

    /// Appends the section about graphs that other graphs use.
    fn push_library(&self, page: &mut String, used: &mut [Subgraph]) {
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
                    push_parameter(page, name, field, schema);
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

/// The text with which every page of a gallery begins.
const MARK: &str = "# Graphs to start from\n\nThis page is made by `maquette render gallery";

/// The text with which pages of older versions begin, in which the command was named `maquette gallery`.
const FORMER_MARK: &str = "# Graphs to start from\n\nThis page is made by `maquette gallery";

/// Returns true if `text` is a page that a gallery has written.
fn is_gallery(text: &str) -> bool {
    [MARK, FORMER_MARK].iter().any(|mark| text.starts_with(mark))
}

const LIBRARY: &str = "
## To be used in other graphs

Name the file under `use`, and it is a node like any other: `maquette nodes GRAPH` prints its reference.
";

/// Appends a line about a parameter to the page.
fn push_parameter(page: &mut String, name: &str, field: &Json, root: &Json) {
    let (kind, default) = (describe_parameter(field, root), describe_default(field, root));
    let doc = field["description"].as_str().unwrap_or_default();
    let _ = writeln!(page, "- `{name}`: {kind}{default}. {doc}");
}

/// Returns the first parameter of a graph that is a number with a maximum allowed value, together with this value.
fn numeric_parameter(graph: &Graph) -> Option<(String, Json)> {
    let fields = graph.schema().get("properties").and_then(Json::as_object)?;
    fn maximum(field: &Json) -> Option<Json> {
        field.get("maximum").filter(|_| field["type"] == "number").cloned()
    }
    fields.iter().find_map(|(name, field)| Some((name.clone(), maximum(field)?)))
}

/// Returns the graphs in a folder, sorted by name. Tests, lock files, pins and handle files are left out.
fn graphs(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let unread = |error: std::io::Error| format!("cannot read {}: {error}", folder.display());
    let entries = std::fs::read_dir(folder).map_err(unread)?;
    let mut graphs = Vec::new();
    for entry in entries {
        let path = entry.map_err(unread)?.path();
        let is_ron = path.extension().is_some_and(|ending| ending == "ron");
        fn is_graph(path: &Path) -> bool {
            let text = fs::read_text(path).unwrap_or_default();
            FileKind::detect(path, &text) == FileKind::Graph
        }
        if path.is_file() && is_ron && !is_no_graph(&path) && is_graph(&path) {
            graphs.push(path);
        }
    }
    graphs.sort();
    Ok(graphs)
}

fn has_content(path: &Path, bytes: &[u8]) -> bool {
    fs::read_no_follow(path).is_ok_and(|known| known == bytes)
}
