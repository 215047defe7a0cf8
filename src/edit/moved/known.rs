//! The text of a graph without problems, and what stands where in it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::check::Check;
use maquette_graph::definition::{Definition, Draft, What, Whole};
use maquette_graph::expression::named_parameters;
use maquette_graph::load::first;
use maquette_graph::meaning::named_node;
use maquette_graph::rebase::{files, rebased_at};
use maquette_graph::world::World;
use maquette_graph::{Options, Splice, field, link};
use maquette_syntax::error::{Problem, Span};
use maquette_syntax::{Kind, Tree};

use crate::{Names, References};

/// The text of a graph, understood.
pub(crate) struct Known {
    pub(crate) text: String,
    pub(crate) whole: Arc<Whole>,
    pub(crate) references: References,
    /// All links, in the order of their places.
    pub(crate) links: Vec<Linked>,
    /// The folders that it may read.
    pub(crate) roots: Vec<PathBuf>,
}

/// A link in the text of a graph.
pub(crate) struct Linked {
    pub(crate) span: Span,
    /// What it says.
    pub(crate) text: String,
    /// Whose it is, in words: port `mask` of `spots`.
    pub(crate) by: String,
    /// The drafts and outputs that it leads to.
    pub(crate) targets: Vec<(usize, usize)>,
}

impl Known {
    /// # Errors
    /// The problems of the text, if nothing can be said of what is in it.
    pub(crate) fn read(
        path: &Path,
        text: &str,
        catalog: &Catalog,
        options: &Options,
    ) -> Result<Self, Vec<Problem>> {
        let (mut world, whole) = first(path, text.to_owned(), catalog, options);
        match whole {
            Some(whole) => Ok(Self::of(&mut world, Arc::new(whole))),
            None => Err(world.problems),
        }
    }

    /// What a text says that is no patch's.
    pub(crate) fn of(world: &mut World<'_>, whole: Arc<Whole>) -> Self {
        let definition = &whole.definition;
        let references = References::within(definition);
        let mut check = Check::new(world, definition.sheet.clone(), Vec::new());
        let names = link::Names::new(&definition.drafts, &definition.eaches);
        let mut links = Vec::new();
        for found in references.all.iter().filter(|found| found.kind == Names::Link) {
            let (span, text, by) = (found.span, found.text.clone(), found.by.clone());
            let targets = check.target(&text, span, &definition.drafts, &names);
            links.push(Linked { span, text, by, targets: targets.unwrap_or_default() });
        }
        let (text, roots) = (definition.sheet.source.text.clone(), world.roots.clone());
        Self { text, whole, references, links, roots }
    }

    pub(crate) fn tree(&self) -> &Tree {
        &self.definition().tree
    }

    pub(crate) fn definition(&self) -> &Definition {
        &self.whole.definition
    }

    /// A section with names, if the graph has it.
    pub(crate) fn section(&self, name: &str) -> Option<&Tree> {
        let value = &field(self.tree(), name)?.value;
        matches!(value.kind, Kind::Map(_)).then_some(value)
    }

    /// The entries of a section.
    pub(crate) fn entries(&self, name: &str) -> &[(Tree, Tree)] {
        match self.section(name).map(|section| &section.kind) {
            Some(Kind::Map(entries)) => entries,
            _ => &[],
        }
    }

    /// The names in a section.
    pub(crate) fn names(&self, section: &str) -> impl Iterator<Item = &str> {
        self.entries(section).iter().filter_map(|(key, _)| key.text())
    }

    /// The place of a name among the entries of its section.
    pub(crate) fn position(&self, section: &str, name: &str) -> Option<usize> {
        self.entries(section).iter().position(|(key, _)| key.text() == Some(name))
    }

    pub(crate) fn slice(&self, span: Span) -> &str {
        &self.text[span.start..span.end]
    }

    /// The node in whose entry something stands.
    pub(crate) fn owner(&self, span: Span) -> Option<usize> {
        self.entries("nodes")
            .iter()
            .position(|(key, value)| key.span.start <= span.start && span.end <= value.span.end)
    }

    /// What stands for a node: one of them, where it is a `ForEach`.
    pub(crate) fn draft(&self, node: &str) -> Option<&Draft> {
        let mut drafts = self.definition().drafts.iter();
        drafts.find(|draft| {
            let is_type = matches!(draft.what, What::Node(_) | What::Use(..));
            is_type && named_node(&draft.name.text) == node
        })
    }

    /// Whether a link leads to one value, and not to a list.
    pub(crate) fn value(&self, link: &Linked) -> Option<(usize, usize)> {
        match link.targets[..] {
            [(draft, output)] if !self.definition().drafts[draft].is_list(output) => {
                Some((draft, output))
            }
            _ => None,
        }
    }

    /// The parameters that are named in these places, and those that their defaults name, in the order of their declarations.
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
                Names::Parameter => found.extend(known.get(&text[..])),
                Names::Expression => {
                    let places = named_parameters(text, &|name| known.contains_key(name));
                    let names = places.into_iter().flatten().filter_map(|at| known.get(&text[at]));
                    found.extend(names);
                }
                Names::Link | Names::Output => {}
            }
        }
        found
    }
}

impl Known {
    /// The places of all texts in nodes, and of defaults of parameters, that are paths of files.
    pub(crate) fn files(&self) -> BTreeSet<Span> {
        files(self.definition())
    }

    /// The edits of paths in these places that lead to the same files from another folder.
    pub(crate) fn rebased(
        &self,
        places: impl IntoIterator<Item = Span>,
        from: &Path,
        to: &Path,
    ) -> Vec<Splice> {
        let places = places.into_iter();
        places.filter_map(|span| rebased_at(&self.text, span, from, to)).collect()
    }
}
