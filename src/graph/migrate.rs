//! Migration of nodes and fields from old names to new ones, as packs declare it with [`Migration`].
//!
//! A graph with old names is read as if it had the new names. `Graph::migrate` writes the new names into the text of the graph. Both
//! migrate one node call at a time, step by step, because a node may have been changed in several versions of its pack.

use std::path::Path;
use std::sync::Arc;

use maquette_node::pack::{Migration, NewValue};
use maquette_syntax::error::{Diagnostic, Source, Span, code};
use maquette_syntax::{
    Body, Field, Help, Kind, LocalDiagnostic, Name, Tree, edit_with_trailing_commas, parse, quote,
    syntax_diagnostics,
};

use super::draft_value::{is_draft, map_sides};
use super::patch::patched_tree;
use super::{Files, Graph, Options, Splice, add_field, apply, remove_parts};
use crate::catalog::Catalog;
use crate::tree::text_in_call;

mod migrated_values;
mod sets;

pub use migrated_values::{
    MigratedValue, migrate_field_value, migrate_target, migrated_text, node_steps, outdated_parts,
    prepare_for,
};
use migrated_values::{nodes_of_packs, patch_splices};

/// Maximum number of migration steps for one node call. The limit also stops migrations that form a cycle.
pub(super) const MAX_STEPS: usize = 100;

/// A node call in a graph file: its type and its groups of fields. A `ForEach` has several groups of fields for the type that it repeats.
struct Call<'t> {
    kind: Name,
    /// True if the type is written as a string in quotes, as in a `ForEach`.
    is_text: bool,
    groups: Vec<&'t Tree>,
}

impl<'t> Call<'t> {
    fn read(entry: &'t Tree) -> Option<Self> {
        let kind = entry.name()?;
        if kind.text != "ForEach" {
            return Some(Self { kind, is_text: false, groups: vec![entry] });
        }
        let (mut kind, mut groups) = (None, Vec::new());
        for field in entry.fields()? {
            match (&field.name.text[..], &field.value.kind) {
                ("graph", Kind::Text(text)) => {
                    kind = Some(Name { text: text.clone(), span: field.value.span });
                }
                ("over", Kind::List(items)) => groups.extend(items),
                ("with" | "links" | "carry", _) => groups.push(&field.value),
                _ => {}
            }
        }
        Some(Self { kind: kind?, is_text: true, groups })
    }
}

/// The migrations of the packs of a program.
#[derive(Clone, Copy)]
struct Migrations<'c> {
    catalog: &'c Catalog,
}

/// Returns the type of a node; for a `ForEach`, the type that it repeats.
pub fn kind_of(node: &Tree) -> Option<Name> {
    Call::read(node).map(|call| call.kind)
}

impl<'c> Migrations<'c> {
    /// Returns the name of a node type after one migration step. `None` if the name is current.
    fn new_name(self, old: &str) -> Option<&'static str> {
        // The name of a node type that exists is not outdated.
        fn is_old(name: &str, catalog: &Catalog) -> bool {
            !catalog.has(name)
        }
        self.catalog
            .migrations()
            .find_map(|migration| match *migration {
                Migration::Node { old: from, new } if from == old => Some(new),
                _ => None,
            })
            .filter(|_| is_old(old, self.catalog))
    }

    /// Returns the name of a node type after all migration steps.
    fn current_name(self, name: &str) -> String {
        let mut present = name.to_owned();
        for _ in 0..MAX_STEPS {
            let Some(new) = self.new_name(&present) else { break };
            new.clone_into(&mut present);
        }
        present
    }

    /// Returns the first outdated field in a group of fields of a node of this type, with the migration of that field.
    fn outdated_field(self, kind: &str, group: &Tree) -> Option<(usize, &'c Migration)> {
        let fields = group.fields().unwrap_or_default();
        let present = self.current_name(kind);
        self.catalog.migrations().find_map(|migration| {
            let Migration::Field { node, old, new, value } = migration else { return None };
            fn is_given(name: &str, fields: &[Field]) -> bool {
                fields.iter().any(|field| field.name.text == name)
            }
            let at = fields.iter().position(|field| field.name.text == *old)?;
            let is_old = match old == new {
                true => is_old(*value, &fields[at].value),
                false => !is_given(new, fields),
            };
            (is_old && self.current_name(node) == present).then_some((at, migration))
        })
    }
}

/// Returns true if a value contains outdated words.
fn is_old(value: NewValue, tree: &Tree) -> bool {
    if is_draft(tree) {
        let sides = tree.fields().unwrap_or_default();
        return sides.iter().any(|side| is_old(value, &side.value));
    }
    let word = tree.name().map(|name| name.text);
    match value {
        NewValue::Words(words) => words.iter().any(|(old, _)| word.as_deref() == Some(old)),
        NewValue::Same | NewValue::Times(_) => false,
    }
}

/// Returns the migrated value. Each part keeps the position of the old value in the file.
fn migrate_value(new: NewValue, tree: &Tree) -> Tree {
    if is_draft(tree) {
        return map_sides(tree, |side| migrate_value(new, side));
    }
    let kind = match (new, &tree.kind) {
        (NewValue::Times(factor), Kind::Number { value, .. }) => {
            let value = value * factor;
            Kind::Number { value, whole: value.fract() == 0.0 }
        }
        (NewValue::Times(_), Kind::List(items)) => {
            Kind::List(items.iter().map(|item| migrate_value(new, item)).collect())
        }
        (NewValue::Times(_), Kind::Call { name: None, body: Body::Items(items) }) => {
            let items = items.iter().map(|item| migrate_value(new, item)).collect();
            Kind::Call { name: None, body: Body::Items(items) }
        }
        (NewValue::Times(factor), Kind::Call { .. }) => {
            let expression = match (text_in_call(tree, "Param"), text_in_call(tree, "Expr")) {
                (Some(name), _) => format!("{name} * {factor}"),
                (_, Some(text)) => format!("({text}) * {factor}"),
                _ => return tree.clone(),
            };
            let inner = tree.call_of("Param").or_else(|| tree.call_of("Expr"));
            let argument = Tree::new(inner.map_or(tree.span, |it| it.span), Kind::Text(expression));
            let name = Some(Name { text: "Expr".into(), span: tree.span });
            Kind::Call { name, body: Body::Items(vec![argument]) }
        }
        (NewValue::Words(words), Kind::Word(word)) => match words.iter().find(|it| it.0 == word) {
            Some((_, new)) => Kind::Word((*new).to_owned()),
            None => return tree.clone(),
        },
        (NewValue::Words(words), Kind::Call { name: Some(name), body }) => {
            let new = words.iter().find(|it| it.0 == name.text);
            let text = new.map_or_else(|| name.text.clone(), |(_, new)| (*new).to_owned());
            Kind::Call { name: Some(Name { text, span: name.span }), body: body.clone() }
        }
        _ => return tree.clone(),
    };
    Tree { kind, ..tree.clone() }
}

/// Returns the edits for a migrated value. They replace only those parts of the old value that differ.
fn value_splices(value: NewValue, tree: &Tree, text: &str) -> Vec<Splice> {
    let new = migrate_value(value, tree);
    let mut splices = Vec::new();
    rewrite_value(tree, &new, text, &mut splices);
    splices
}

/// Collects the edits that turn one value in a text into another value of the same form.
fn rewrite_value(old: &Tree, new: &Tree, text: &str, splices: &mut Vec<Splice>) {
    if old == new {
        return;
    }
    fn items(tree: &Tree) -> Vec<Tree> {
        match &tree.kind {
            Kind::List(items) | Kind::Call { name: None, body: Body::Items(items) } => {
                items.clone()
            }
            Kind::Call { body: Body::Fields(sides), .. } if is_draft(tree) => {
                sides.iter().map(|side| side.value.clone()).collect()
            }
            _ => Vec::new(),
        }
    }
    if let Kind::Call { name: None, body: Body::Fields(fields) } = &new.kind {
        match (old.fields(), &fields[..]) {
            (Some(before), _) => {
                for (old, new) in before.iter().zip(fields) {
                    if old.name.text != new.name.text {
                        splices.push((old.name.span, new.name.text.clone()));
                    }
                    rewrite_value(&old.value, &new.value, text, splices);
                }
            }
            // Here the migration moved the field into a new group of fields.
            (None, [inner]) => {
                fn empty_span(at: usize) -> Span {
                    Span { start: at, end: at }
                }
                splices.push((empty_span(old.span.start), format!("({}: ", inner.name.text)));
                rewrite_value(old, &inner.value, text, splices);
                splices.push((empty_span(old.span.end), ")".to_owned()));
            }
            (None, _) => {}
        }
        return;
    }
    let expression = text_in_call(new, "Expr");
    match (&old.kind, &new.kind, expression) {
        (_, _, Some(expression)) => {
            splices.push((old.span, format!("Expr({})", quote(expression))));
        }
        (_, Kind::Number { value, .. }, _) => {
            let is_whole = !text[old.span.start..old.span.end].contains('.');
            let new = match is_whole && value.fract() == 0.0 {
                true => format!("{value}"),
                false => format!("{value:?}"),
            };
            splices.push((old.span, new));
        }
        (_, Kind::Word(word), _) => splices.push((old.span, word.clone())),
        (_, Kind::Call { name: Some(name), .. }, _) if !is_draft(new) => {
            splices.push((name.span, name.text.clone()));
        }
        _ => {
            for (old, new) in items(old).iter().zip(&items(new)) {
                rewrite_value(old, new, text, splices);
            }
        }
    }
}

/// Returns a node in which all names are current, and warnings about its outdated names.
pub(super) fn migrate_node(entry: &Tree, catalog: &Catalog) -> (Tree, Vec<LocalDiagnostic>) {
    let migrations = Migrations { catalog };
    let mut entry = entry.clone();
    let mut diagnostics = Vec::new();
    if catalog.migrations().next().is_none() {
        return (entry, diagnostics);
    }
    let Some(Call { kind, is_text, .. }) = Call::read(&entry) else { return (entry, diagnostics) };
    let present = migrations.current_name(&kind.text);
    if present != kind.text {
        let message = format!("the node type `{}` is called `{present}` now", kind.text);
        diagnostics.push(outdated_name(kind.span, message, Some((&kind.text, &present))));
        match &mut entry.kind {
            Kind::Call { body: Body::Fields(fields), .. } if is_text => {
                let graph = fields.iter_mut().find(|field| field.name.text == "graph");
                if let Some(graph) = graph {
                    graph.value.kind = Kind::Text(present.clone());
                }
            }
            Kind::Call { name: Some(name), .. } => name.text.clone_from(&present),
            Kind::Word(word) => word.clone_from(&present),
            _ => {}
        }
    }
    let mut migrate_group = |group: &mut Tree| {
        for _ in 0..MAX_STEPS {
            let Some((at, migration)) = migrations.outdated_field(&present, group) else { break };
            let Migration::Field { old, new, value, .. } = migration else { break };
            let Kind::Call { body: Body::Fields(fields), .. } = &mut group.kind else { break };
            let span = match old == new {
                true => fields[at].value.span,
                false => fields[at].name.span,
            };
            let message = match old == new {
                true => format!("field `{old}` of {present} is written differently now"),
                false => format!("field `{old}` of {present} is called `{new}` now"),
            };
            // If the value changes together with the name, the diagnostic offers no fix. `Graph::migrate` changes both.
            let is_renamed = old != new && matches!(value, NewValue::Same) && !new.contains('.');
            diagnostics.push(outdated_name(span, message, is_renamed.then_some((old, new))));
            migrate_field(fields, at, new, *value);
        }
    };
    match &mut entry.kind {
        Kind::Call { body: Body::Fields(fields), .. } if is_text => {
            for field in fields {
                match (&field.name.text[..], &mut field.value.kind) {
                    ("over", Kind::List(items)) => items.iter_mut().for_each(&mut migrate_group),
                    ("with" | "links" | "carry", _) => migrate_group(&mut field.value),
                    _ => {}
                }
            }
        }
        _ => migrate_group(&mut entry),
    }
    (entry, diagnostics)
}

/// Returns the diagnostic for an outdated name. It offers a fix if only the name has changed.
fn outdated_name(span: Span, message: String, renamed: Option<(&str, &str)>) -> LocalDiagnostic {
    let help = "run `maquette edit GRAPH migrate --write` to write the new name into the file";
    let help = match renamed {
        Some((old, new)) => Help::rename(help.into(), old, new),
        None => help.into(),
    };
    LocalDiagnostic::new(code::OUTDATED, span, message, help)
}

/// Moves the migrated value of a field to the field's new path, which is `name` or `group.name`.
fn migrate_field(fields: &mut Vec<Field>, at: usize, new: &str, value: NewValue) {
    let renewed = migrate_value(value, &fields[at].value);
    let Some((group, inner)) = new.split_once('.') else {
        new.clone_into(&mut fields[at].name.text);
        fields[at].value = renewed;
        return;
    };
    let name = Name { text: inner.to_owned(), span: fields[at].name.span };
    let inner = Field { name, value: renewed };
    let other = fields.iter_mut().find(|field| field.name.text == group);
    match other.map(|field| &mut field.value.kind) {
        Some(Kind::Call { body: Body::Fields(inside), .. }) => {
            inside.push(inner);
            fields.remove(at);
        }
        _ => {
            let span = fields[at].value.span;
            group.clone_into(&mut fields[at].name.text);
            let body = Body::Fields(vec![inner]);
            fields[at].value = Tree::new(span, Kind::Call { name: None, body });
        }
    }
}

/// Returns the tree of a graph in which all names are current.
pub(super) fn migrate_graph(tree: &Tree, catalog: &Catalog) -> Tree {
    let mut tree = tree.clone();
    if let Kind::Call { body: Body::Fields(fields), .. } = &mut tree.kind {
        for nodes in fields.iter_mut().filter(|field| field.name.text == "nodes") {
            if let Kind::Map(entries) = &mut nodes.value.kind {
                entries.iter_mut().for_each(|(_, entry)| *entry = migrate_node(entry, catalog).0);
            }
        }
    }
    tree
}

impl Graph {
    /// Migrates the text of a graph file or a patch to current names. The rest of the text is kept byte by byte.
    ///
    /// # Errors
    /// The text has syntax errors, or a migration would change the meaning of the graph.
    pub fn migrate(path: &Path, text: &str, catalog: &Catalog) -> Result<String, Vec<Diagnostic>> {
        let (_, errors) = parse(text);
        if !errors.is_empty() {
            return Err(syntax_diagnostics(path, text, errors));
        }
        let migrated = edit_with_trailing_commas(text, |text| {
            Ok::<_, Vec<Diagnostic>>(all_steps(path, text, catalog))
        })?;
        fn source(text: &str, path: &Path) -> Source {
            Source { name: path.to_owned(), text: text.to_owned() }
        }
        let differences =
            Self::differences(&source(text, path), &source(&migrated, path), catalog)?;
        let Some(difference) = differences.first() else { return Ok(migrated) };
        let message = format!("its migration would change the meaning of the graph: {difference}");
        let help =
            "this is a bug in a pack's migrations or in maquette; the file is unchanged".into();
        let source = Arc::new(source(text, path));
        let diagnostic =
            LocalDiagnostic { code: code::PANIC, span: Span::default(), message, help, note: None };
        Err(vec![diagnostic.into_diagnostic(&source)])
    }
}

/// Applies all migration steps to the text of a graph file.
fn all_steps(path: &Path, text: &str, catalog: &Catalog) -> String {
    let (tree, _) = parse(text);
    let mut migrated = text.to_owned();
    if tree.name().is_some_and(|name| name.text == "Patch") {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let graph = patched_tree(path, text.to_owned(), catalog, &options);
        migrated = apply(text, patch_splices(&tree, &graph, text, catalog));
    }
    for _ in 0..MAX_STEPS {
        let splices = next_steps(&migrated, catalog);
        if splices.is_empty() {
            break;
        }
        migrated = apply(&migrated, splices);
    }
    migrated
}

/// Returns the edits of the next migration step for each node call in a text.
fn next_steps(text: &str, catalog: &Catalog) -> Vec<Splice> {
    let (tree, _) = parse(text);
    nodes_of_packs(&tree).flat_map(|(_, node)| call_steps(node, text, catalog)).collect()
}

/// Returns the edits of the next migration step for one node call.
fn call_steps(node: &Tree, text: &str, catalog: &Catalog) -> Vec<Splice> {
    let migrations = Migrations { catalog };
    let Some(Call { kind, is_text, groups }) = Call::read(node) else { return Vec::new() };
    if let Some(new) = migrations.new_name(&kind.text) {
        return vec![(kind.span, if is_text { quote(new) } else { new.to_owned() })];
    }
    groups
        .into_iter()
        .flat_map(|group| match migrations.outdated_field(&kind.text, group) {
            Some((at, Migration::Field { new, value, .. })) => {
                field_splices(text, group, at, new, *value)
            }
            _ => Vec::new(),
        })
        .collect()
}

/// Returns the edits that move the value of a field to the field's new path.
fn field_splices(text: &str, call: &Tree, at: usize, new: &str, value: NewValue) -> Vec<Splice> {
    let fields = call.fields().unwrap_or_default();
    let field = &fields[at];
    let mut splices = value_splices(value, &field.value, text);
    let Some((group, inner)) = new.split_once('.') else {
        splices.push((field.name.span, new.to_owned()));
        return splices;
    };
    let other = fields.iter().find(|field| field.name.text == group);
    match other.filter(|other| other.value.fields().is_some()) {
        Some(other) => {
            let Span { start, end } = field.value.span;
            let moved = apply(
                &text[start..end],
                splices
                    .into_iter()
                    .map(|(span, new): Splice| {
                        (Span { start: span.start - start, end: span.end - start }, new)
                    })
                    .collect(),
            );
            let mut splices = remove_parts(text, call, &std::collections::BTreeSet::from([at]));
            splices.extend(add_field(text, &other.value, inner, &moved));
            splices
        }
        None => {
            fn empty_span(at: usize) -> Span {
                Span { start: at, end: at }
            }
            splices.push((field.name.span, group.to_owned()));
            splices.insert(0, (empty_span(field.value.span.start), format!("({inner}: ")));
            splices.push((empty_span(field.value.span.end), ")".to_owned()));
            splices
        }
    }
}
