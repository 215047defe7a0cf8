//! Reads a graph file and those that it uses, and finds every problem in them.
//!
//! A mistake causes one problem: a node whose fields are wrong still has its output types, and what cannot be known because
//! of another problem is not reported. Each file is checked once, as a [`Definition`]; what uses of it make of it is the matter
//! of `expand`.

use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_syntax::error::{MOST_TOLD, Problem, Source, Span, Use, code};
use maquette_syntax::paths::{MARKER, project_root};
use maquette_syntax::{Finding, Help, Sheet, Tree, conflict_of};
use maquette_value::plain::NoText;
use serde_json::{Map, json};

use crate::catalog::Catalog;
use crate::check::Check;
use crate::definition::{Definition, Draft, Port, What, Whole};
use crate::describe::Subgraph;
use crate::expand::expand;
use crate::flat::{Counts, Lineage};
use crate::graph::{GraphText, Stage};
use crate::link::Names;
use crate::needs::Needs;
use crate::options::folder_of;
use crate::parameters::Parameters;
use crate::top::{TopLevel, field_of};
use crate::world::World;
use crate::{Checked, Graph, Options, ReadFile};

pub(crate) fn load(path: &Path, catalog: &Catalog, options: &Options) -> Checked {
    match options.text(path) {
        Ok(text) => load_text(path, text, catalog, options),
        Err(error) => {
            let source = Arc::new(Source { name: path.to_owned(), text: String::new() });
            let problem = unread("the graph", &error).at(&source);
            let (problems, files, subgraphs) = (vec![problem], Vec::new(), Vec::new());
            Checked { graph: None, partial: None, problems, files, subgraphs }
        }
    }
}

pub(crate) fn unread(what: &str, error: &std::io::Error) -> Finding {
    let no_text = error.get_ref().and_then(|error| error.downcast_ref::<NoText>());
    let help = no_text.map_or("", NoText::help);
    let error = error.to_string();
    let error = error.strip_suffix(&format!("; {help}")).unwrap_or(&error);
    let message = format!("cannot read {what}: {error}");
    let (code, span, help) = (code::MISSING_FILE, Span::default(), Help::from(help));
    Finding { code, span, message, help, note: None }
}

/// The same for a text that stands, or will stand, in the file.
pub fn load_text(path: &Path, text: String, catalog: &Catalog, options: &Options) -> Checked {
    load_whole(path, text, catalog, options, |_, _| ()).0
}

/// The same, and something else that is asked of what the text says; none if it cannot be said what stands in it.
pub fn load_whole<T>(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
    ask: impl FnOnce(&mut World<'_>, &Arc<Whole>) -> T,
) -> (Checked, Option<T>) {
    let (mut world, whole) = first(path, text.clone(), catalog, options);
    let whole = whole.map(Arc::new);
    let answer = whole.as_ref().map(|whole| ask(&mut world, whole));
    world.judge_lock(path, &text);
    let mut checked = judged(world, whole);
    for graph in [&mut checked.graph, &mut checked.partial].into_iter().flatten() {
        graph.remember(path, &text, options);
    }
    (checked, answer)
}

/// What is made of the text of a graph's own file, and of the files that it uses.
pub fn judged(mut world: World<'_>, whole: Option<Arc<Whole>>) -> Checked {
    let mut problems = std::mem::take(&mut world.problems);
    // What does not depend on a node of an unknown type, or on a missing file, is as good as ever.
    let is_broken = problems.iter().any(|problem| world.is_fatal(problem));
    let is_partial = problems.iter().any(|it| it.code == code::UNKNOWN_NODE);
    // What uses make of a graph adds nothing to more problems than are told.
    let whole = whole.filter(|_| problems.len() < MOST_TOLD);
    let graph = whole.and_then(|whole| {
        world.read_pins(&whole.definition.sheet.source.name);
        let graph = expand(&mut world, &whole, is_broken, is_partial, &Counts::new())?;
        let stage =
            (!graph.loops.is_empty()).then(|| Arc::new(Stage::new(whole, is_partial, &world)));
        Some(Graph { stage, ..graph })
    });
    problems.append(&mut world.problems);
    // What is wrong with a file shows again in every use of it.
    let mut seen = HashSet::new();
    problems.retain(|problem| {
        let place = (problem.source.name.clone(), problem.span.start, problem.span.end);
        seen.insert((place, problem.code, problem.message.clone()))
    });
    let is_partial = is_partial || !world.missing.is_empty();
    let (graph, partial) = if is_partial { (None, graph) } else { (graph, None) };
    let files = graph.as_ref().map_or(world.files, files_of);
    Checked { graph, partial, problems, files, subgraphs: world.subgraphs }
}

/// What the text of a graph's own file says, and the files that it uses; all of their problems are in the world.
pub fn first<'a>(
    path: &Path,
    text: String,
    catalog: &'a Catalog,
    options: &'a Options,
) -> (World<'a>, Option<Whole>) {
    let folder = folder_of(path);
    let root = project_root(&folder);
    let marker = root.join(MARKER);
    let conflict = options.text(&marker).ok().and_then(|text| conflict_of(&marker, &text));
    let mut world = World::new(catalog, options, root);
    world.problems.extend(conflict);
    let source = Arc::new(Source { name: path.to_owned(), text });
    let sheet = Sheet::new(source, folder);
    let real = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    world.open.push((real, path.to_owned()));
    let mut check = Check::new(&mut world, sheet, Vec::new());
    let whole = check.read();
    let (mut findings, sheet) = (check.findings, check.sheet);
    findings.sort_by_key(|finding| finding.span);
    let own = findings.into_iter().map(|finding| sheet.problem(finding, &[]));
    let mut problems = Vec::from_iter(own);
    problems.append(&mut world.problems);
    world.problems = problems;
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

/// What the graph in a file is that others use; its problems go to the world.
pub(crate) fn definition<'a>(
    world: &mut World<'a>,
    path: &Path,
    name: PathBuf,
    uses: Vec<Use>,
) -> Option<Arc<Definition>> {
    let (text, error) = match world.options.text(path) {
        Ok(text) => (text, None),
        Err(error) => (String::new(), Some(unread("the graph", &error))),
    };
    let sheet = Sheet::new(Arc::new(Source { name, text }), folder_of(path));
    let mut check = Check::new(world, sheet, uses);
    let whole = match error {
        None => check.read(),
        Some(error) => {
            check.findings.push(error);
            None
        }
    };
    let (mut findings, uses, sheet) = (check.findings, check.uses, check.sheet);
    findings.sort_by_key(|finding| finding.span);
    world.problems.extend(findings.into_iter().map(|finding| sheet.problem(finding, &uses)));
    whole.map(|whole| Arc::new(whole.definition))
}

/// The nodes that none of the `needed` ones hangs on, with the places of their names. The cases of a `Switch` are all needed.
fn unused(
    drafts: &[Draft],
    inputs: usize,
    needs: &Needs,
    needed: impl Iterator<Item = usize>,
) -> Vec<(String, Span)> {
    let is_needed = needs.of(needed);
    // The elements of a `ForEach` share one name in the file: it is needed if one of them is.
    fn is_named(draft: &Draft) -> bool {
        !matches!(draft.what, What::Elements(_) | What::Pick(_))
    }
    let names = || drafts.iter().zip(&is_needed).skip(inputs).filter(|(it, _)| is_named(it));
    let needed: HashSet<Span> =
        names().filter(|(_, needed)| **needed).map(|(draft, _)| draft.name.span).collect();
    let mut unused = Vec::new();
    for (draft, _) in names().filter(|(draft, _)| !needed.contains(&draft.name.span)) {
        let name = draft.name.text.split('/').next().unwrap_or_default();
        unused.push((name.to_owned(), draft.name.span));
    }
    unused.dedup();
    unused
}

impl Graph {
    /// Reads and checks a graph file and those that it uses. Runs no node and opens no other file.
    pub fn load(path: &Path, catalog: &Catalog, options: &Options) -> Checked {
        load(path, catalog, options)
    }

    /// The same for a text that stands, or will stand, in the file.
    pub fn load_text(path: &Path, text: String, catalog: &Catalog, options: &Options) -> Checked {
        load_text(path, text, catalog, options)
    }

    /// The graphs that a graph uses, and those that they use: outer ones first. Itself before them if it has inputs.
    pub fn subgraphs(
        path: &Path,
        catalog: &Catalog,
        options: &Options,
    ) -> (Vec<Subgraph>, Vec<Problem>) {
        match options.text(path) {
            Ok(text) => Self::subgraphs_of(path, text, catalog, options),
            Err(_) => (Vec::new(), load(path, catalog, options).problems),
        }
    }

    /// The same for a text that stands in the file, or will.
    pub fn subgraphs_of(
        path: &Path,
        text: String,
        catalog: &Catalog,
        options: &Options,
    ) -> (Vec<Subgraph>, Vec<Problem>) {
        let (mut world, whole) = first(path, text, catalog, options);
        let mut found = Vec::new();
        if let Some(Whole { definition, .. }) = whole.filter(|whole| whole.is_used) {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            found.push(Subgraph::new(&name, &definition));
        }
        world.listed.sort_by_key(|listed| listed.0);
        let World { listed, problems, .. } = world;
        for (_, name, definition) in listed {
            let subgraph = Subgraph::new(&name, &definition);
            let is_known =
                |known: &Subgraph| (&known.name, &known.file) == (&subgraph.name, &subgraph.file);
            if !found.iter().any(is_known) {
                found.push(subgraph);
            }
        }
        (found, problems)
    }
}

impl GraphText {
    /// The graph without these inputs.
    pub(crate) fn graph_without(
        &self,
        inputs: BTreeSet<String>,
        catalog: &Catalog,
    ) -> Result<Graph, Vec<Problem>> {
        let (mut world, whole) = first(&self.path, self.text.clone(), catalog, &self.options);
        world.absent = inputs;
        let checked = judged(world, whole.map(Arc::new));
        checked.graph.or(checked.partial).ok_or(checked.problems)
    }
}

impl Check<'_, '_> {
    /// None if the text has syntax errors: then the rest of it is checked, but nothing is made of it.
    fn read(&mut self) -> Option<Whole> {
        let whole = self.whole();
        self.leave_out_doubts();
        whole.filter(|_| self.doubts.is_none())
    }

    fn whole(&mut self) -> Option<Whole> {
        let tree = Arc::new(self.tree()?);
        let top = self.top_level(&tree)?;
        Some(self.graph(&top, &tree))
    }

    fn graph(&mut self, top: &TopLevel<'_>, tree: &Arc<Tree>) -> Whole {
        let version = top.version.and_then(|version| self.version(version));
        self.missing_packs = self.packs(top.packs);
        let subgraphs = self.subgraphs(top);
        let entries = top.inputs.unwrap_or_default();
        let (mut drafts, mut described, wants) = self.inputs(entries);
        let inputs = drafts.len();
        let required =
            drafts.iter().filter(|draft| !draft.is_optional).map(|draft| draft.name.text.clone());
        let required = Vec::from_iter(required);
        let parameters = self.named(top.params, "parameter", entries);
        let options = self.world.options;
        let set: &[_] = if self.is_first() { &options.set } else { &[] };
        let draft = options.draft;
        let (declared, defaults) =
            Parameters::read(&parameters, set, draft, &self.sheet, &mut self.findings);
        described
            .extend(declared.iter().map(|declared| (declared.name.clone(), declared.schema())));
        let nodes = self.named(top.nodes, "node", entries);
        let eaches = self.drafts(&nodes, &subgraphs, &defaults, &mut drafts);
        if self.is_first() {
            self.unknown_sets(&defaults, &drafts, &eaches);
        }
        let outputs = top.outputs.iter().map(|(_, value)| value);
        self.picks(&mut drafts, &outputs.chain(top.expect).collect::<Vec<_>>());
        let names = Names::new(&drafts, &eaches);
        self.link(&mut drafts, &names);
        self.optional_inputs(&drafts);
        let needs = Self::needs(&drafts);
        let order = self.order(&drafts, &needs);
        self.types(&mut drafts, &order, &eaches);
        self.link_lacking(&drafts, &needs);
        self.build(&mut drafts);
        let is_used = !self.is_first() || top.inputs.is_some();
        let (mut ports, mut outputs, mut undecided) = (Vec::new(), Vec::new(), Vec::new());
        match is_used {
            true => ports = self.ports_of(top, &drafts, &names),
            false => (outputs, undecided) = self.outputs(top.outputs, &drafts, &names),
        }
        if self.is_first() {
            let lineage = |draft| Arc::new(Lineage::of(draft, &drafts, &needs, &defaults, options));
            outputs.iter_mut().for_each(|output| output.lineage = lineage(output.node));
            for port in &mut ports {
                port.lineage = port.target.map(|(draft, _)| lineage(draft)).unwrap_or_default();
            }
        }
        let given_there = (&ports[..], &outputs[..]);
        let mut expect = self.expectations(top.expect, given_there, top.outputs, &drafts, &names);
        expect.extend(self.promises(top, &ports));
        let expected =
            expect.iter().flat_map(|it| it.targets.iter().flatten().map(|(node, _)| *node));
        let given = outputs.iter().map(|output| output.node);
        let ported = ports.iter().filter_map(|port| Some(port.target?.0));
        let unused = unused(&drafts, inputs, &needs, given.chain(ported).chain(expected));
        let schema =
            json!({ "description": top.doc, "properties": described, "required": required });
        let by_field = described.iter().map(|(name, it)| (field_of(name), it.clone()));
        let by_field = Map::from_iter(by_field);
        let required = required.iter().map(|name| field_of(name)).collect::<Vec<_>>();
        let fields =
            json!({ "description": top.doc, "properties": by_field, "required": required });
        let definition = Definition {
            sheet: self.sheet.clone(),
            tree: tree.clone(),
            doc: top.doc.clone(),
            version,
            declared,
            defaults,
            drafts,
            inputs,
            order,
            eaches,
            ports,
            wants,
            expect,
            schema,
            fields,
        };
        Whole { definition, outputs, undecided, is_used, unused }
    }
}

impl Check<'_, '_> {
    /// What the graph gives to who uses it. Names of files say that it is none to be used, which is one mistake.
    fn ports_of(&mut self, top: &TopLevel<'_>, drafts: &[Draft], names: &Names<'_>) -> Vec<Port> {
        let known = self.findings.len();
        let ports = self.ports(top.outputs, drafts, names);
        fn is_file(finding: &Finding) -> bool {
            finding.code == code::BAD_NAME
        }
        if top.inputs.is_none() && self.findings[known..].iter().any(is_file) {
            let mut found = self.findings.split_off(known);
            found.retain(|finding| !is_file(finding));
            self.findings.append(&mut found);
            let span = top.outputs.first().map_or(Span::default(), |(name, _)| name.span);
            let message = "this graph gives files and has no `inputs`: it is no node of another";
            let help = "declare `inputs: {..}`, and name its outputs as ports: lower-case letters, digits, hyphens";
            self.find(code::BAD_NAME, span, message.to_owned(), help);
        }
        ports
    }
}
