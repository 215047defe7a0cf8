//! Reads a graph file and the files that it uses, and finds all errors in them.
//!
//! Each error is reported once. A node with invalid fields still has its output types, and errors that follow from another error are not
//! reported. Each file is checked once, as a [`Definition`]; `expand` checks each use of it.

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, MAX_REPORTED, Source, Span, Use, code};
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{Help, LocalDiagnostic, SourceMap, Tree, conflict_diagnostic};
use maquette_value::fs::NotUtf8;
use serde_json::{Map, json};

use crate::catalog::Catalog;
use crate::check::Check;
use crate::definition::{Definition, NodeKind, ParsedFile, ParsedNode, Port};
use crate::dependencies::Dependencies;
use crate::describe::Subgraph;
use crate::expand::expand;
use crate::flat::{Counts, Lineage};
use crate::graph::{GraphText, Stage};
use crate::header::{Header, field_of};
use crate::link::Names;
use crate::options::folder_of;
use crate::parameters::Parameters;
use crate::world::World;
use crate::{CheckedGraph, Graph, Options, ReadFile};

pub(crate) fn load(path: &Path, catalog: &Catalog, options: &Options) -> CheckedGraph {
    match options.text(path) {
        Ok(text) => load_text(path, text, catalog, options),
        Err(error) => {
            let source = Arc::new(Source { name: path.to_owned(), text: String::new() });
            let diagnostic = read_error("the graph", &error).into_diagnostic(&source);
            let (diagnostics, files, subgraphs) = (vec![diagnostic], Vec::new(), Vec::new());
            CheckedGraph { graph: None, partial: None, diagnostics, files, subgraphs }
        }
    }
}

pub(crate) fn read_error(what: &str, error: &std::io::Error) -> LocalDiagnostic {
    let no_text = error.get_ref().and_then(|error| error.downcast_ref::<NotUtf8>());
    let help = no_text.map_or("", NotUtf8::help);
    let error = error.to_string();
    let error = error.strip_suffix(&format!("; {help}")).unwrap_or(&error);
    let message = format!("cannot read {what}: {error}");
    let (code, span, help) = (code::MISSING_FILE, Span::default(), Help::from(help));
    LocalDiagnostic { code, span, message, help, note: None }
}

/// Checks a text as the content of a graph file at `path`. The file need not exist.
pub fn load_text(path: &Path, text: String, catalog: &Catalog, options: &Options) -> CheckedGraph {
    load_with(path, text, catalog, options, |_, _| ()).0
}

/// Checks the text of a graph file, and calls `ask` with the parsed file. If the text cannot be parsed, returns `None` instead of the
/// result of `ask`.
pub fn load_with<T>(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
    ask: impl FnOnce(&mut World<'_>, &Arc<ParsedFile>) -> T,
) -> (CheckedGraph, Option<T>) {
    let (mut world, whole) = check_file(path, text.clone(), catalog, options);
    let whole = whole.map(Arc::new);
    let answer = whole.as_ref().map(|whole| ask(&mut world, whole));
    world.report_lock_differences(path, &text);
    let mut checked = finish_check(world, whole);
    for graph in [&mut checked.graph, &mut checked.partial].into_iter().flatten() {
        graph.remember(path, &text, options);
    }
    (checked, answer)
}

/// Finishes a check: expands the parsed file of the graph and collects all diagnostics.
pub fn finish_check(mut world: World<'_>, whole: Option<Arc<ParsedFile>>) -> CheckedGraph {
    let mut diagnostics = std::mem::take(&mut world.diagnostics);
    // Unknown node types and missing files affect only the nodes that depend on them, not the whole graph.
    let is_broken = diagnostics.iter().any(|diagnostic| world.is_fatal(diagnostic));
    let is_partial = diagnostics.iter().any(|it| it.code == code::UNKNOWN_NODE);
    // Skip the search for errors in used graphs if there are already more errors than will be shown.
    let whole = whole.filter(|_| diagnostics.len() < MAX_REPORTED);
    let graph = whole.and_then(|whole| {
        world.read_pins(&whole.definition.source_map.source.name);
        let graph = expand(&mut world, &whole, is_broken, is_partial, &Counts::new())?;
        let stage =
            (!graph.loops.is_empty()).then(|| Arc::new(Stage::new(whole, is_partial, &world)));
        Some(Graph { stage, ..graph })
    });
    diagnostics.append(&mut world.diagnostics);
    // Remove duplicates: the errors of a used file were found again for each use of the file.
    let mut seen = HashSet::new();
    diagnostics.retain(|diagnostic| {
        let place = (diagnostic.source.name.clone(), diagnostic.span.start, diagnostic.span.end);
        seen.insert((place, diagnostic.code, diagnostic.message.clone()))
    });
    let is_partial = is_partial || !world.missing.is_empty();
    let (graph, partial) = if is_partial { (None, graph) } else { (graph, None) };
    let files = graph.as_ref().map_or(world.files, files_of);
    CheckedGraph { graph, partial, diagnostics, files, subgraphs: world.subgraphs }
}

/// Parses and checks the text of a root graph and the files of the graphs that it uses. The returned world contains all diagnostics.
pub fn check_file<'a>(
    path: &Path,
    text: String,
    catalog: &'a Catalog,
    options: &'a Options,
) -> (World<'a>, Option<ParsedFile>) {
    let folder = folder_of(path);
    let root = project_root(&folder);
    let marker = root.join(MARKER);
    let conflict = options.text(&marker).ok().and_then(|text| conflict_diagnostic(&marker, &text));
    let mut world = World::new(catalog, options, root);
    world.diagnostics.extend(conflict);
    let source = Arc::new(Source { name: path.to_owned(), text });
    let source_map = SourceMap::new(source, folder);
    let real = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    world.open_files.push((real, path.to_owned()));
    let mut check = Check::new(&mut world, source_map, Vec::new());
    let whole = check.read_unless_broken();
    let (mut diagnostics, source_map) = (check.diagnostics, check.source_map);
    diagnostics.sort_by_key(|diagnostic| diagnostic.span);
    let own = diagnostics.into_iter().map(|diagnostic| source_map.diagnostic(diagnostic, &[]));
    let mut diagnostics = Vec::from_iter(own);
    diagnostics.append(&mut world.diagnostics);
    world.diagnostics = diagnostics;
    (world, whole)
}

pub(crate) fn files_of(graph: &Graph) -> Vec<ReadFile> {
    graph
        .nodes
        .iter()
        .flat_map(|node| {
            node.files
                .iter()
                .map(|file| ReadFile {
                    path: file.path.clone(),
                    node: node.name.clone(),
                    optional: !file.needed,
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Reads the definition of a used graph, and adds its diagnostics to the world.
pub(crate) fn load_definition<'a>(
    world: &mut World<'a>,
    path: &Path,
    name: PathBuf,
    uses: Vec<Use>,
) -> Option<Arc<Definition>> {
    let (text, error) = match world.options.text(path) {
        Ok(text) => (text, None),
        Err(error) => (String::new(), Some(read_error("the graph", &error))),
    };
    let source_map = SourceMap::new(Arc::new(Source { name, text }), folder_of(path));
    let mut check = Check::new(world, source_map, uses);
    let whole = match error {
        None => check.read_unless_broken(),
        Some(error) => {
            check.diagnostics.push(error);
            None
        }
    };
    let (mut diagnostics, uses, source_map) = (check.diagnostics, check.uses, check.source_map);
    diagnostics.sort_by_key(|diagnostic| diagnostic.span);
    world
        .diagnostics
        .extend(diagnostics.into_iter().map(|diagnostic| source_map.diagnostic(diagnostic, &uses)));
    whole.map(|whole| Arc::new(whole.definition))
}

/// Returns the nodes that none of the `needed` nodes depends on, with the positions of their names. All cases of a `Switch` count as
/// dependencies of the `Switch`.
fn unused_nodes(
    parsed_nodes: &[ParsedNode],
    inputs: usize,
    needs: &Dependencies,
    needed: impl Iterator<Item = usize>,
) -> Vec<(String, Span)> {
    let is_needed = needs.closure_of(needed);
    // The elements of a `ForEach` share one name in the file. That name is needed if one of the elements is needed.
    fn is_named(parsed: &ParsedNode) -> bool {
        !matches!(parsed.what, NodeKind::Elements(_) | NodeKind::Pick(_))
    }
    let names = || parsed_nodes.iter().zip(&is_needed).skip(inputs).filter(|(it, _)| is_named(it));
    let needed: HashSet<Span> =
        names().filter(|(_, needed)| **needed).map(|(parsed, _)| parsed.name.span).collect();
    let mut unused = Vec::new();
    for (parsed, _) in names().filter(|(parsed, _)| !needed.contains(&parsed.name.span)) {
        let name = parsed.name.text.split('/').next().unwrap_or_default();
        unused.push((name.to_owned(), parsed.name.span));
    }
    unused.dedup();
    unused
}

impl Graph {
    /// Reads and checks a graph file and the files of the graphs that it uses. Does not open other files, and does not run nodes.
    pub fn load(path: &Path, catalog: &Catalog, options: &Options) -> CheckedGraph {
        load(path, catalog, options)
    }

    /// Checks a text as the content of a graph file at `path`. The file need not exist.
    pub fn load_text(
        path: &Path,
        text: String,
        catalog: &Catalog,
        options: &Options,
    ) -> CheckedGraph {
        load_text(path, text, catalog, options)
    }

    /// Returns the graphs that the graph at `path` uses, directly or indirectly. A graph comes before those that it uses. If the graph at
    /// `path` has inputs, it is included as the first item.
    pub fn subgraphs(
        path: &Path,
        catalog: &Catalog,
        options: &Options,
    ) -> (Vec<Subgraph>, Vec<Diagnostic>) {
        match options.text(path) {
            Ok(text) => Self::subgraphs_of(path, text, catalog, options),
            Err(_) => (Vec::new(), load(path, catalog, options).diagnostics),
        }
    }

    /// Returns the graphs that a text uses, as if it were the content of a graph file at `path`. The file need not exist.
    pub fn subgraphs_of(
        path: &Path,
        text: String,
        catalog: &Catalog,
        options: &Options,
    ) -> (Vec<Subgraph>, Vec<Diagnostic>) {
        let (mut world, whole) = check_file(path, text, catalog, options);
        let mut found = Vec::new();
        if let Some(ParsedFile { definition, .. }) = whole.filter(|whole| whole.is_used) {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            found.push(Subgraph::new(&name, &definition));
        }
        world.node_types.sort_by_key(|listed| listed.0);
        let World { node_types: listed, diagnostics, .. } = world;
        for (_, name, definition) in listed {
            let subgraph = Subgraph::new(&name, &definition);
            if found
                .iter()
                .all(|known| (&known.name, &known.file) != (&subgraph.name, &subgraph.file))
            {
                found.push(subgraph);
            }
        }
        (found, diagnostics)
    }
}

impl GraphText {
    /// Expands the graph again, without the given optional inputs.
    pub(crate) fn graph_without(
        &self,
        inputs: BTreeSet<String>,
        catalog: &Catalog,
    ) -> Result<Graph, Vec<Diagnostic>> {
        let (mut world, whole) = check_file(&self.path, self.text.clone(), catalog, &self.options);
        world.absent = inputs;
        let checked = finish_check(world, whole.map(Arc::new));
        checked.graph.or(checked.partial).ok_or(checked.diagnostics)
    }
}

impl Check<'_, '_> {
    /// Checks the file. If its text has syntax errors, checks the readable rest and returns `None`.
    fn read_unless_broken(&mut self) -> Option<ParsedFile> {
        let whole = self.read_file();
        self.leave_out_doubts();
        whole.filter(|_| self.doubts.is_none())
    }

    fn read_file(&mut self) -> Option<ParsedFile> {
        let tree = Arc::new(self.tree()?);
        let header = self.read_header(&tree)?;
        Some(self.graph(&header, &tree))
    }

    fn graph(&mut self, header: &Header<'_>, tree: &Arc<Tree>) -> ParsedFile {
        let version = header.version.and_then(|version| self.read_version(version));
        self.missing_packs = self.missing_of_packs(header.packs);
        let subgraphs = self.subgraphs(header);
        let entries = header.inputs.unwrap_or_default();
        let (mut parsed_nodes, mut described, wants) = self.inputs(entries);
        let inputs = parsed_nodes.len();
        let required = parsed_nodes
            .iter()
            .filter(|parsed| !parsed.is_optional)
            .map(|parsed| parsed.name.text.clone());
        let required = Vec::from_iter(required);
        let parameters = self.named_entries(header.params, "parameter", entries);
        let options = self.world.options;
        let set: &[_] = if self.is_root() { &options.set } else { &[] };
        let draft = options.draft;
        let (declared, defaults) =
            Parameters::read(&parameters, set, draft, &self.source_map, &mut self.diagnostics);
        described
            .extend(declared.iter().map(|declared| (declared.name.clone(), declared.schema())));
        let nodes = self.named_entries(header.nodes, "node", entries);
        let for_each_nodes = self.parse_nodes(&nodes, &subgraphs, &defaults, &mut parsed_nodes);
        if self.is_root() {
            self.report_unknown_sets(&defaults, &parsed_nodes, &for_each_nodes);
        }
        let outputs = header.outputs.iter().map(|(_, value)| value);
        self.add_picks(&mut parsed_nodes, &outputs.chain(header.expect).collect::<Vec<_>>());
        let names = Names::new(&parsed_nodes, &for_each_nodes);
        self.resolve_links(&mut parsed_nodes, &names);
        self.check_optional_inputs(&parsed_nodes);
        let needs = Self::dependencies(&parsed_nodes);
        let order = self.order(&parsed_nodes, &needs);
        self.types(&mut parsed_nodes, &order, &for_each_nodes);
        self.suggest_missing_links(&parsed_nodes, &needs);
        self.build_nodes(&mut parsed_nodes);
        let is_used = !self.is_root() || header.inputs.is_some();
        let (mut ports, mut outputs, mut undecided) = (Vec::new(), Vec::new(), Vec::new());
        match is_used {
            true => ports = self.output_ports(header, &parsed_nodes, &names),
            false => (outputs, undecided) = self.outputs(header.outputs, &parsed_nodes, &names),
        }
        if self.is_root() {
            let lineage =
                |index| Arc::new(Lineage::new(index, &parsed_nodes, &needs, &defaults, options));
            outputs.iter_mut().for_each(|output| output.lineage = lineage(output.node));
            for port in &mut ports {
                port.lineage = port.target.map(|(index, _)| lineage(index)).unwrap_or_default();
            }
        }
        let given_outputs = (&ports[..], &outputs[..]);
        let mut expect =
            self.expectations(header.expect, given_outputs, header.outputs, &parsed_nodes, &names);
        expect.extend(self.promises(header, &ports));
        let expected =
            expect.iter().flat_map(|it| it.targets.iter().flatten().map(|(node, _)| *node));
        let given = outputs.iter().map(|output| output.node);
        let ported = ports.iter().filter_map(|port| Some(port.target?.0));
        let unused =
            unused_nodes(&parsed_nodes, inputs, &needs, given.chain(ported).chain(expected));
        let schema =
            json!({ "description": header.doc, "properties": described, "required": required });
        let by_field = described.iter().map(|(name, it)| (field_of(name), it.clone()));
        let by_field = Map::from_iter(by_field);
        let required = required.iter().map(|name| field_of(name)).collect::<Vec<_>>();
        let fields =
            json!({ "description": header.doc, "properties": by_field, "required": required });
        let definition = Definition {
            source_map: self.source_map.clone(),
            tree: tree.clone(),
            doc: header.doc.clone(),
            version,
            declared,
            defaults,
            parsed_nodes,
            inputs,
            order,
            for_each_nodes,
            ports,
            wants,
            expect,
            schema,
            fields,
        };
        ParsedFile { definition, outputs, undecided, is_used, unused }
    }
}

impl Check<'_, '_> {
    /// Returns the output ports. Reports once if the graph has output files instead, because other graphs cannot use it.
    fn output_ports(
        &mut self,
        header: &Header<'_>,
        parsed_nodes: &[ParsedNode],
        names: &Names<'_>,
    ) -> Vec<Port> {
        let known = self.diagnostics.len();
        let ports = self.ports(header.outputs, parsed_nodes, names);
        fn is_file(diagnostic: &LocalDiagnostic) -> bool {
            diagnostic.code == code::BAD_NAME
        }
        if header.inputs.is_none() && self.diagnostics[known..].iter().any(is_file) {
            let mut found = self.diagnostics.split_off(known);
            found.retain(|diagnostic| !is_file(diagnostic));
            self.diagnostics.append(&mut found);
            let span = header.outputs.first().map_or(Span::default(), |(name, _)| name.span);
            let message =
                "this graph has output files and no `inputs`, so it cannot be used as a node";
            let help = "declare `inputs: {..}`, and name its outputs as ports: lower-case letters, digits, hyphens";
            self.report(code::BAD_NAME, span, message.to_owned(), help);
        }
        ports
    }
}
