//! A valid graph, and the positions of its parts in the text.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::canonical::node_of_link;
use maquette_graph::catalog::Catalog;
use maquette_graph::check::Check;
use maquette_graph::definition::{Definition, NodeKind, ParsedFile, ParsedNode};
use maquette_graph::expression::named_parameters;
use maquette_graph::load::check_file;
use maquette_graph::rebase::{files, rebase_edit};
use maquette_graph::world::World;
use maquette_graph::{Options, Splice, field, link};
use maquette_syntax::error::{Diagnostic, Span};
use maquette_syntax::{Kind, Tree};

use crate::{ReferenceKind, References};

/// A parsed graph file, with its links resolved.
pub(crate) struct ParsedGraph {
    pub(crate) text: String,
    pub(crate) file: Arc<ParsedFile>,
    pub(crate) references: References,
    /// All links, in the order of their positions.
    pub(crate) links: Vec<ResolvedLink>,
    /// The folders from which the graph may read files.
    pub(crate) roots: Vec<PathBuf>,
}

/// A link in the text of a graph, with the outputs to which it leads.
pub(crate) struct ResolvedLink {
    pub(crate) span: Span,
    /// The text of the link, `node` or `node.output`.
    pub(crate) text: String,
    /// A description of the part that has the link, such as port `mask` of `spots`.
    pub(crate) by: String,
    /// The pairs of node index and output index to which the link leads.
    pub(crate) targets: Vec<(usize, usize)>,
}

impl ParsedGraph {
    /// Parses the text of a graph file, and resolves its links.
    ///
    /// # Errors
    /// The text cannot be parsed.
    pub(crate) fn read(
        path: &Path,
        text: &str,
        catalog: &Catalog,
        options: &Options,
    ) -> Result<Self, Vec<Diagnostic>> {
        let (mut world, whole) = check_file(path, text.to_owned(), catalog, options);
        match whole {
            Some(whole) => Ok(Self::from_file(&mut world, Arc::new(whole))),
            None => Err(world.diagnostics),
        }
    }

    /// Resolves the links of a parsed file, which must not be a patch.
    pub(crate) fn from_file(world: &mut World<'_>, whole: Arc<ParsedFile>) -> Self {
        let definition = &whole.definition;
        let references = References::of_definition(definition);
        let mut check = Check::new(world, definition.source_map.clone(), Vec::new());
        let names = link::Names::new(&definition.parsed_nodes, &definition.for_each_nodes);
        let mut links = Vec::new();
        for found in references.all.iter().filter(|found| found.kind == ReferenceKind::Link) {
            let (span, text, by) = (found.span, found.text.clone(), found.by.clone());
            let targets = check.target(&text, span, &definition.parsed_nodes, &names);
            links.push(ResolvedLink { span, text, by, targets: targets.unwrap_or_default() });
        }
        let (text, roots) = (definition.source_map.source.text.clone(), world.roots.clone());
        Self { text, file: whole, references, links, roots }
    }

    pub(crate) fn tree(&self) -> &Tree {
        &self.definition().tree
    }

    pub(crate) fn definition(&self) -> &Definition {
        &self.file.definition
    }

    /// Returns the map of a section of the graph, such as `nodes`.
    pub(crate) fn section(&self, name: &str) -> Option<&Tree> {
        let value = &field(self.tree(), name)?.value;
        matches!(value.kind, Kind::Map(_)).then_some(value)
    }

    /// Returns the entries of a section of the graph, such as `nodes`.
    pub(crate) fn entries(&self, name: &str) -> &[(Tree, Tree)] {
        match self.section(name).map(|section| &section.kind) {
            Some(Kind::Map(entries)) => entries,
            _ => &[],
        }
    }

    pub(crate) fn names(&self, section: &str) -> impl Iterator<Item = &str> {
        self.entries(section).iter().filter_map(|(key, _)| key.text())
    }

    /// Returns the index of an entry in its section, by the name of the entry.
    pub(crate) fn position(&self, section: &str, name: &str) -> Option<usize> {
        self.entries(section).iter().position(|(key, _)| key.text() == Some(name))
    }

    pub(crate) fn slice(&self, span: Span) -> &str {
        &self.text[span.start..span.end]
    }

    /// Returns the index of the node whose entry in the text contains the span. `None` if no node does.
    pub(crate) fn owner(&self, span: Span) -> Option<usize> {
        self.entries("nodes")
            .iter()
            .position(|(key, value)| key.span.start <= span.start && span.end <= value.span.end)
    }

    /// Returns the parsed node of this name. For a `ForEach`, returns the parsed node of one of its elements.
    pub(crate) fn parsed_node(&self, node: &str) -> Option<&ParsedNode> {
        let mut parsed_nodes = self.definition().parsed_nodes.iter();
        parsed_nodes.find(|parsed| {
            let is_type = matches!(parsed.what, NodeKind::Node(_) | NodeKind::Use(..));
            is_type && node_of_link(&parsed.name.text) == node
        })
    }

    /// Returns the node and the output to which a link leads. `None` if the link leads to a list of values.
    pub(crate) fn single_target(&self, link: &ResolvedLink) -> Option<(usize, usize)> {
        match link.targets[..] {
            [(node, output)] if !self.definition().parsed_nodes[node].is_list(output) => {
                Some((node, output))
            }
            _ => None,
        }
    }

    /// Returns the indices of parameters, in the order of their declarations: those used at spans that `within` accepts, and those that the
    /// defaults of these parameters need.
    pub(crate) fn parameters(&self, within: impl Fn(Span) -> bool) -> BTreeSet<usize> {
        let entries = self.entries("params");
        let mut found = self.named_parameters(within);
        loop {
            let more = self.named_parameters(|span: Span| {
                found.iter().any(|&at| {
                    entries[at].0.span.start <= span.start && span.end <= entries[at].1.span.end
                })
            });
            if more.is_subset(&found) {
                return found;
            }
            found.extend(more);
        }
    }

    fn named_parameters(&self, within: impl Fn(Span) -> bool) -> BTreeSet<usize> {
        let known = BTreeMap::from_iter(self.names("params").zip(0..));
        let mut found = BTreeSet::new();
        for reference in self.references.all.iter().filter(|found| within(found.span)) {
            let text = &reference.text;
            match reference.kind {
                ReferenceKind::Parameter => found.extend(known.get(&text[..])),
                ReferenceKind::Expression => {
                    let places = named_parameters(text, &|name| known.contains_key(name));
                    let names = places.into_iter().flatten().filter_map(|at| known.get(&text[at]));
                    found.extend(names);
                }
                ReferenceKind::Link | ReferenceKind::Output => {}
            }
        }
        found
    }
}

impl ParsedGraph {
    /// Returns the positions of all paths of files, in fields of nodes and in defaults of parameters.
    pub(crate) fn files(&self) -> BTreeSet<Span> {
        files(self.definition())
    }

    /// Returns the edits that adapt the paths at the given positions to another folder. The edited paths lead to the same files.
    pub(crate) fn rebase_paths(
        &self,
        places: impl IntoIterator<Item = Span>,
        from: &Path,
        to: &Path,
    ) -> Vec<Splice> {
        let places = places.into_iter();
        places.filter_map(|span| rebase_edit(&self.text, span, from, to)).collect()
    }
}
