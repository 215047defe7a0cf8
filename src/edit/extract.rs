//! Extraction: moves some nodes of a graph to a new graph file, and replaces them by one node that uses the new graph.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maquette_graph::canonical::node_of_link;
use maquette_graph::catalog::Catalog;
use maquette_graph::definition::NodeKind;
use maquette_graph::dependencies::Dependencies;
use maquette_graph::header::field_of;
use maquette_graph::migrate::kind_of;
use maquette_graph::options::folder_of;
use maquette_graph::rebase::path_of_use;
use maquette_graph::{
    EditError, Options, Splice, add_field, apply, field, insert_after, newline, parts, put_entry,
    reindent,
};
use maquette_syntax::error::{Diagnostic, Span, code};
use maquette_syntax::paths::folder_of_new;
use maquette_syntax::{LineEnding, Tree, nearest_or_all, quote};

use super::format::{format_entry, format_text};
use super::relocate::{
    ParsedGraph, ResolvedLink, apply_within, edit_error, free_name, take_entries,
};
use super::{EditedText, Editor};

mod border;
mod new_graph;

use border::{Border, Crossing};
use new_graph::NewGraph;

/// A request to move nodes to a new graph file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Extraction {
    /// The names of the nodes to be moved, in any order.
    pub nodes: Vec<String>,
    /// The path of the new file, such as `lib/nose.ron`, relative to the folder to which the path of the graph is relative. If `None`, the
    /// file is in the folder of the graph and has the name of the node that uses the new graph. If a file of this name exists, a number is
    /// appended.
    pub to: Option<PathBuf>,
    /// The node type of the new graph, such as `Nose`. If `None`, it is derived from the name of the file.
    pub kind: Option<String>,
    /// The name of the node that uses the new graph, such as `nose`. If `None`, it is the name of the file without its extension.
    pub name: Option<String>,
}

/// The edited graph and the new graph file that an extraction creates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtractedGraph {
    /// The texts of the graph before and after the extraction.
    pub edited: EditedText,
    /// The path of the new file, which does not exist yet.
    pub path: PathBuf,
    /// The text of the new graph file.
    pub text: String,
    /// The node type of the new graph.
    pub kind: String,
    /// The name of the node that uses the new graph.
    pub name: String,
}

/// Moves nodes of the graph file at `path` to a new graph file. A node that uses the new graph takes their place.
///
/// A link from a remaining node to a moved node becomes a link to an output of the new graph. In the opposite direction, it becomes a link
/// to an input of the new graph. The parameters that the moved nodes use are passed on. Every value keeps its cache key.
///
/// Comments are moved if they are inside of the nodes, after them on their lines, or directly above them. Entries of `use` that no other
/// node needs are moved too. All other parts are kept byte by byte, except for links to the moved nodes. References in other files, such as
/// a `Patch`, a test or a pin, are not updated.
///
/// # Errors
/// The graph has errors, the new texts have errors, or the nodes cannot be moved. They cannot be moved if one of them does not exist, if
/// another node both depends on them and is needed by them, if an input or output would be a list, if a name is taken, or if the new file
/// exists. Positions refer to `text`.
pub fn extract(
    path: &Path,
    text: &str,
    extraction: &Extraction,
    catalog: &Catalog,
    options: &Options,
) -> Result<ExtractedGraph, Vec<Diagnostic>> {
    // Ignore the values of `--set`, because they are not in the text.
    let options = &Options { set: Vec::new(), ..options.clone() };
    let mut extracted = None;
    let edited = EditedText::with_commas_behind(text, |text| {
        let done = extract_from(&Editor { path, catalog, options }, text, extraction)?;
        Ok(extracted.insert(done).edited.clone())
    })?;
    extracted.map(|extracted| ExtractedGraph { edited, ..extracted }).ok_or_else(Vec::new)
}

fn extract_from(
    editor: &Editor<'_>,
    text: &str,
    extraction: &Extraction,
) -> Result<ExtractedGraph, Vec<Diagnostic>> {
    let &Editor { path, catalog, options } = editor;
    let (known, before) = editor.load_valid(text)?;
    let to_diagnostics = |error| editor.diagnostics(text, error);
    let set = positions_of(&known, &extraction.nodes).map_err(to_diagnostics)?;
    check_no_node_between(&known, &set).map_err(to_diagnostics)?;
    let border = Border::find(&known, &set).map_err(to_diagnostics)?;
    let names = NewGraph::new(editor, &known, &set, extraction).map_err(to_diagnostics)?;
    let work = Extractor { editor, known: &known, set: &set, border: &border, new: &names };
    let (new, file) = work.write().map_err(to_diagnostics)?;
    let file = format_text(&names.path, &file)?;
    let file = LineEnding::detect(text).unwrap_or(LineEnding::Unix).apply(file);
    let NewGraph { kind, name, path: to, given } = names;
    let inside = options.clone().with_text(folder_of(path).join(given), file.clone());
    if before != (Editor { path, catalog, options: &inside }).fingerprints(&new)? {
        let message = "the extraction would change the results of the graph";
        let help = "this is a bug in maquette; the graph is unchanged";
        return Err(to_diagnostics(edit_error(code::EXPRESSION, Span::default(), message, help)));
    }
    let edited = EditedText { text: new, before: text.to_owned(), changes: Vec::new() };
    Ok(ExtractedGraph { edited, path: to, text: file, kind, name })
}

/// Returns the indices of the nodes with the given names.
fn positions_of(known: &ParsedGraph, names: &[String]) -> Result<BTreeSet<usize>, EditError> {
    if names.is_empty() {
        let help = "name the nodes to extract";
        return Err(edit_error(code::UNKNOWN_LINK, Span::default(), "no nodes to extract", help));
    }
    names.iter().map(|given| position_of(known, given)).collect()
}

fn position_of(known: &ParsedGraph, given: &str) -> Result<usize, EditError> {
    let name = given.strip_prefix("nodes.").unwrap_or(given);
    known.position("nodes", name).ok_or_else(|| {
        let nodes = Vec::from_iter(known.names("nodes"));
        let (message, help) = match known.position("inputs", name) {
            Some(_) => (
                format!("`{name}` is an input, not a node"),
                "leave it out: inputs of the new graph are created from links".to_owned(),
            ),
            None => (
                format!("the graph has no node `{name}`"),
                String::from(nearest_or_all(name, "its nodes", &nodes)),
            ),
        };
        edit_error(code::UNKNOWN_LINK, Span::default(), message, help)
    })
}

/// Returns an error if a node outside of the set both depends on a node of the set and is needed by one.
fn check_no_node_between(known: &ParsedGraph, set: &BTreeSet<usize>) -> Result<(), EditError> {
    let nodes = known.entries("nodes");
    let links = known.links.iter().filter_map(|link| {
        let to = known.position("nodes", node_of_link(&link.text))?;
        Some((known.owner(link.span)?, to))
    });
    let links = BTreeSet::from_iter(links);
    let needs = Dependencies::new(nodes.len(), links.iter().copied());
    let back = Dependencies::new(nodes.len(), links.iter().map(|&(user, source)| (source, user)));
    let (below, above) =
        (needs.closure_of(set.iter().copied()), back.closure_of(set.iter().copied()));
    let Some(at) = (0..nodes.len()).find(|at| !set.contains(at) && below[*at] && above[*at]) else {
        return Ok(());
    };
    let [source, user] = [needs, back].map(|needs| {
        let reached = needs.closure_of([at]);
        set.iter().find(|&&it| reached[it]).and_then(|&it| nodes[it].0.text()).unwrap_or_default()
    });
    let it = nodes[at].0.text().unwrap_or_default();
    let message =
        format!("`{it}` is between the nodes: it needs `{source}`, and `{user}` needs it");
    let help = format!("extract `{it}`, too, or leave one of them where it is");
    Err(edit_error(code::CYCLE, nodes[at].0.span, message, help))
}

/// Appends a section to the text of the new graph.
fn section(name: &str, inside: &str, file: &mut String) {
    *file += &format!("    {name}: {{\n{inside}    }},\n");
}

/// Returns the entries of a section, one per line.
fn lines(entries: impl IntoIterator<Item = String>) -> String {
    entries.into_iter().map(|it| format!("{it},\n")).collect()
}

/// Writes two texts: that of the graph without the extracted nodes, and that of the new graph, which has them.
struct Extractor<'a> {
    editor: &'a Editor<'a>,
    known: &'a ParsedGraph,
    set: &'a BTreeSet<usize>,
    border: &'a Border,
    new: &'a NewGraph,
}

impl Extractor<'_> {
    /// Returns the text of the original graph after the extraction, and the text of the new graph before formatting.
    fn write(&self) -> Result<(String, String), EditError> {
        let Self { known, set, border, new, .. } = self;
        let text = &known.text;
        let Some(nodes) = known.section("nodes") else { return Ok(Default::default()) };
        let parameters = known.parameters(|span| self.is_inside(span));
        let inner = self.inner_splices();
        let mut splices = Vec::new();
        for output in &border.outputs {
            let link = quote(&format!("{}.{}", new.name, output.name));
            splices.extend(output.spans.iter().map(|span| (*span, link.clone())));
        }
        let links =
            border.inputs.iter().map(|it| format!("{}: {}", field_of(&it.name), quote(&it.link)));
        let all = Vec::from_iter(known.names("params"));
        let names = parameters.iter().map(|&at| all[at]);
        let params = names.map(|name| format!("{}: Param({})", field_of(name), quote(name)));
        let fields = links.chain(params).collect::<Vec<_>>().join(", ");
        let entry = format!("{}: {}({fields})", quote(&new.name), new.kind);
        let taken = take_entries(text, nodes, set, &inner, |indent| {
            let columns = indent.chars().count();
            let newline = newline(text, nodes.span.end - 1);
            reindent(&format_entry(&entry, columns), columns, indent, newline)
        });
        splices.extend(taken.splices);
        let mut file = String::from("Graph(\n    format: 1,\n");
        let of = self.editor.path.file_name().unwrap_or_default().to_string_lossy();
        file += &format!("    doc: {},\n", quote(&format!("A part of {of}.")));
        let packs = self.packs();
        if !packs.is_empty() {
            section("packs", &packs, &mut file);
        }
        let (uses, of_uses) = self.uses();
        splices.extend(of_uses);
        if !uses.is_empty() {
            section("use", &uses, &mut file);
        }
        let inputs = border.inputs.iter().map(|it| self.input_declaration(it));
        section("inputs", &lines(inputs), &mut file);
        if !parameters.is_empty() {
            section("params", &lines(self.parameter_declarations(&parameters)), &mut file);
        }
        section("nodes", &taken.text, &mut file);
        let outputs =
            border.outputs.iter().map(|it| format!("{}: {}", quote(&it.name), quote(&it.link)));
        section("outputs", &lines(outputs), &mut file);
        Ok((apply(text, splices), file + ")\n"))
    }

    fn is_inside(&self, span: Span) -> bool {
        self.known.owner(span).is_some_and(|at| self.set.contains(&at))
    }

    /// Returns the edits within the moved nodes: links to other nodes become links to inputs of the new graph, and paths are adapted to the
    /// folder of the new file.
    fn inner_splices(&self) -> Vec<Splice> {
        let Self { known, border, .. } = self;
        let mut splices = self.path_splices(known.files());
        for input in &border.inputs {
            splices.extend(input.spans.iter().map(|span| (*span, quote(&input.name))));
        }
        splices
    }

    /// Returns the edits that adapt paths to the folder of the new file.
    fn path_splices(&self, places: impl IntoIterator<Item = Span>) -> Vec<Splice> {
        let (from, to) = (folder_of_new(self.editor.path), folder_of_new(&self.new.path));
        self.known.rebase_paths(places, &from, &to)
    }

    /// Returns the entries of `packs` that the moved nodes need, as text for the new graph.
    fn packs(&self) -> String {
        let known = self.known;
        let nodes = known.entries("nodes");
        let packs =
            self.set.iter().filter_map(|&at| match &known.parsed_node(nodes[at].0.text()?)?.what {
                NodeKind::Node(entry) => Some(entry.pack),
                _ => None,
            });
        let packs = BTreeSet::from_iter(packs);
        let needed = known.entries("packs").iter();
        let needed = needed.filter(|(key, _)| key.text().is_some_and(|key| packs.contains(key)));
        needed.map(|entry| format!("{},\n", known.slice(entry_span(entry)))).collect()
    }

    /// Returns the entries of `use` that the moved nodes need, as text for the new graph. Also returns the edits of this section in the
    /// original graph: they add the new graph's node type, and remove entries that no remaining node needs.
    fn uses(&self) -> (String, Vec<Splice>) {
        let Self { known, set, new, .. } = self;
        let text = &known.text;
        let entry = format!("{}: {}", quote(&new.kind), quote(&new.given));
        let uses = known.entries("use");
        let [needed, needed_by_others] = [true, false].map(|is_inside| {
            let nodes = known.entries("nodes").iter().enumerate();
            let nodes = nodes.filter(|(at, _)| set.contains(at) == is_inside);
            let types: BTreeSet<_> =
                nodes.filter_map(|(_, (_, call))| Some(kind_of(call)?.text)).collect();
            let needed = (0..uses.len())
                .filter(|&at| uses[at].0.text().is_some_and(|name| types.contains(name)));
            needed.collect::<BTreeSet<_>>()
        });
        let gone = needed.difference(&needed_by_others).copied().collect();
        let paths = needed.iter().filter_map(|&at| path_of_use(&uses[at].1)).map(|it| it.span);
        let paths = self.path_splices(paths);
        let Some(map) = known.section("use") else {
            return (String::new(), self.add_use_section(&entry));
        };
        let copies = needed.difference(&gone).map(|&at| parts(map)[at]);
        let copies = copies.map(|part| apply_within(text, part, &paths) + ",\n");
        let copies = String::from_iter(copies);
        let taken = take_entries(text, map, &gone, &paths, |_| entry.clone());
        let splices = match gone.is_empty() {
            true => put_entry(text, map, None, false, |_| entry.clone()),
            false => taken.splices,
        };
        (copies + &taken.text, splices)
    }

    /// Returns the edits that add a section `use` to the original graph, after its first fields such as `doc`.
    fn add_use_section(&self, entry: &str) -> Vec<Splice> {
        let (text, tree) = (&self.known.text, self.known.tree());
        fn is_header_field(name: &str) -> bool {
            matches!(name, "format" | "version" | "doc" | "packs")
        }
        let fields = tree.fields().unwrap_or_default();
        let Some(head) = fields.iter().rposition(|field| is_header_field(&field.name.text)) else {
            return add_field(text, tree, "use", &format!("{{ {entry} }}"));
        };
        let places = parts(tree);
        let before = head.checked_sub(1).map(|before| places[before].end);
        insert_after(text, tree.span, before, places[head], &format!("use: {{ {entry} }}"))
    }

    /// Returns the declaration of an input of the new graph.
    fn input_declaration(&self, input: &Crossing) -> String {
        let known = self.known;
        let parsed = &known.definition().parsed_nodes[input.target.0];
        let own = match parsed.what {
            NodeKind::Input => field(&parsed.tree, "doc").and_then(|doc| doc.value.text()),
            _ => None,
        };
        let doc = own.map_or_else(|| format!("The value of `{}`.", input.link), str::to_owned);
        let declared = format!("{}(doc: {})", input.kind, quote(&doc));
        let declared = if parsed.is_optional { format!("Optional({declared})") } else { declared };
        format!("{}: {declared}", quote(&input.name))
    }

    /// Returns the declarations of the parameters at the given indices, for the new graph. They are copied from the original graph, with
    /// paths adapted to the new folder.
    fn parameter_declarations(&self, parameters: &BTreeSet<usize>) -> Vec<String> {
        let known = self.known;
        let paths = self.path_splices(known.files());
        let entries = known.entries("params");
        parameters
            .iter()
            .map(|&at| apply_within(&known.text, entry_span(&entries[at]), &paths))
            .collect()
    }
}

/// Returns the span of an entry, from the start of its key to the end of its value.
fn entry_span((key, value): &(Tree, Tree)) -> Span {
    Span { start: key.span.start, end: value.span.end }
}
