//! Nodes and fields under their old names, brought up to date as their packs say ([`Migration`]).
//!
//! A graph with old names is read as if it had the new ones; `Graph::migrated` puts these into its text. Both go through the same
//! steps, one of a call at a time, so that a node may have been renamed and changed over several versions.

use std::path::Path;
use std::sync::Arc;

use maquette_node::pack::{Migration, NewValue};
use maquette_syntax::error::{Problem, Source, Span, code};
use maquette_syntax::{
    Body, Field, Finding, Help, Kind, Name, Tree, parse, quoted, syntax_problems,
    with_commas_behind,
};

use super::patch::patched_tree;
use super::quality::{each_side, is_draft};
use super::{Files, Graph, Options, Splice, added, apply, without};
use crate::catalog::Catalog;

mod puts;
mod sets;

pub use puts::{
    Renewed, node_steps, ready_for, renewed_node, renewed_put, renewed_target, renewed_text,
};
use puts::{nodes_of_packs, of_patch};

/// No call needs as many steps: packs that send each other in a circle come to an end here.
pub(super) const MOST_STEPS: usize = 100;

/// The type of a node's call, and the groups that hold its fields: the call itself, or those of a `ForEach`.
struct Call<'t> {
    kind: Name,
    /// Whether the type is a text, as in a `ForEach`.
    is_text: bool,
    groups: Vec<&'t Tree>,
}

impl<'t> Call<'t> {
    fn of(entry: &'t Tree) -> Option<Self> {
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

/// What the packs of a program say of old names.
#[derive(Clone, Copy)]
struct Migrations<'c> {
    catalog: &'c Catalog,
}

/// The type of a node, or the one that a `ForEach` repeats.
pub fn kind_of(node: &Tree) -> Option<Name> {
    Call::of(node).map(|call| call.kind)
}

impl<'c> Migrations<'c> {
    /// The name that a type of nodes has now.
    fn kind(self, old: &str) -> Option<&'static str> {
        // What is there is not old.
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

    /// The name that a type of nodes has now, after all that became of it.
    fn present(self, name: &str) -> String {
        let mut present = name.to_owned();
        for _ in 0..MOST_STEPS {
            let Some(new) = self.kind(&present) else { break };
            new.clone_into(&mut present);
        }
        present
    }

    /// Which of some fields of a node of this type is old, and what became of it.
    fn field(self, kind: &str, group: &Tree) -> Option<(usize, &'c Migration)> {
        let fields = group.fields().unwrap_or_default();
        let present = self.present(kind);
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
            (is_old && self.present(node) == present).then_some((at, migration))
        })
    }
}

/// Whether a value is one of those that are said otherwise now.
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

/// The value as it is said now, with the places that it had.
fn renewed_value(new: NewValue, tree: &Tree) -> Tree {
    if is_draft(tree) {
        return each_side(tree, |side| renewed_value(new, side));
    }
    let kind = match (new, &tree.kind) {
        (NewValue::Times(factor), Kind::Number { value, .. }) => {
            let value = value * factor;
            Kind::Number { value, whole: value.fract() == 0.0 }
        }
        (NewValue::Times(_), Kind::List(items)) => {
            Kind::List(items.iter().map(|item| renewed_value(new, item)).collect())
        }
        (NewValue::Times(_), Kind::Call { name: None, body: Body::Items(items) }) => {
            let items = items.iter().map(|item| renewed_value(new, item)).collect();
            Kind::Call { name: None, body: Body::Items(items) }
        }
        (NewValue::Times(factor), Kind::Call { .. }) => {
            let argument = |call| tree.call_of(call).and_then(|inner| inner.text());
            let expression = match (argument("Param"), argument("Expr")) {
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

/// The same in the text: only what is said otherwise is written anew.
fn value_splices(value: NewValue, tree: &Tree, text: &str) -> Vec<Splice> {
    let new = renewed_value(value, tree);
    let mut splices = Vec::new();
    written(tree, &new, text, &mut splices);
    splices
}

/// The edits that make a text say another value of the same form.
fn written(old: &Tree, new: &Tree, text: &str, splices: &mut Vec<Splice>) {
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
                    written(&old.value, &new.value, text, splices);
                }
            }
            // It lies in a group now.
            (None, [inner]) => {
                fn at(at: usize) -> Span {
                    Span { start: at, end: at }
                }
                splices.push((at(old.span.start), format!("({}: ", inner.name.text)));
                written(old, &inner.value, text, splices);
                splices.push((at(old.span.end), ")".to_owned()));
            }
            (None, _) => {}
        }
        return;
    }
    let expression = new.call_of("Expr").and_then(Tree::text);
    match (&old.kind, &new.kind, expression) {
        (_, _, Some(expression)) => {
            splices.push((old.span, format!("Expr({})", quoted(expression))));
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
                written(old, new, text, splices);
            }
        }
    }
}

/// A node as it is understood, and what is old about it.
pub(super) fn renewed(entry: &Tree, catalog: &Catalog) -> (Tree, Vec<Finding>) {
    let migrations = Migrations { catalog };
    let mut entry = entry.clone();
    let mut findings = Vec::new();
    if catalog.migrations().next().is_none() {
        return (entry, findings);
    }
    let Some(Call { kind, is_text, .. }) = Call::of(&entry) else { return (entry, findings) };
    let present = migrations.present(&kind.text);
    fn find(
        span: Span,
        message: String,
        renamed: Option<(&str, &str)>,
        findings: &mut Vec<Finding>,
    ) {
        let help = "`maquette migrate --write` puts the new name into the file";
        let help = match renamed {
            Some((old, new)) => Help::rename(help.into(), old, new),
            None => help.into(),
        };
        findings.push(Finding { code: code::OUTDATED, span, message, help, note: None });
    }
    if present != kind.text {
        let message = format!("the node type `{}` is called `{present}` now", kind.text);
        find(kind.span, message, Some((&kind.text, &present)), &mut findings);
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
    let mut told = |group: &mut Tree| {
        for _ in 0..MOST_STEPS {
            let Some((at, migration)) = migrations.field(&present, group) else { break };
            let Migration::Field { old, new, value, .. } = migration else { break };
            let Kind::Call { body: Body::Fields(fields), .. } = &mut group.kind else { break };
            let span = match old == new {
                true => fields[at].value.span,
                false => fields[at].name.span,
            };
            find(
                span,
                match old == new {
                    true => format!("field `{old}` of {present} is said otherwise now"),
                    false => format!("field `{old}` of {present} is called `{new}` now"),
                },
                // Other values than names are for `migrate`.
                (old != new && matches!(value, NewValue::Same) && !new.contains('.'))
                    .then_some((old, new)),
                &mut findings,
            );
            renew_field(fields, at, new, *value);
        }
    };
    match &mut entry.kind {
        Kind::Call { body: Body::Fields(fields), .. } if is_text => {
            for field in fields {
                match (&field.name.text[..], &mut field.value.kind) {
                    ("over", Kind::List(items)) => items.iter_mut().for_each(&mut told),
                    ("with" | "links" | "carry", _) => told(&mut field.value),
                    _ => {}
                }
            }
        }
        _ => told(&mut entry),
    }
    (entry, findings)
}

/// Puts a field's value, as it is said now, to the place that it has now: `name`, or `group.name`.
fn renew_field(fields: &mut Vec<Field>, at: usize, new: &str, value: NewValue) {
    let renewed = renewed_value(value, &fields[at].value);
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

/// The tree of a graph with the new names of all that is old in it.
pub(super) fn renewed_graph(tree: &Tree, catalog: &Catalog) -> Tree {
    let mut tree = tree.clone();
    if let Kind::Call { body: Body::Fields(fields), .. } = &mut tree.kind {
        for nodes in fields.iter_mut().filter(|field| field.name.text == "nodes") {
            if let Kind::Map(entries) = &mut nodes.value.kind {
                entries.iter_mut().for_each(|(_, entry)| *entry = renewed(entry, catalog).0);
            }
        }
    }
    tree
}

impl Graph {
    /// The text of a graph file, or of a patch of one, with the new names of all nodes and fields that it has under old ones: the same text if
    /// there are none. Every other byte is as it was.
    ///
    /// # Errors
    /// The mistakes in the text, if it is no RON.
    pub fn migrated(path: &Path, text: &str, catalog: &Catalog) -> Result<String, Vec<Problem>> {
        let (_, mistakes) = parse(text);
        if !mistakes.is_empty() {
            return Err(syntax_problems(path, text, mistakes));
        }
        let migrated =
            with_commas_behind(text, |text| Ok::<_, Vec<Problem>>(all_steps(path, text, catalog)))?;
        fn source(text: &str, path: &Path) -> Source {
            Source { name: path.to_owned(), text: text.to_owned() }
        }
        let differences =
            Self::differences(&source(text, path), &source(&migrated, path), catalog)?;
        let Some(difference) = differences.first() else { return Ok(migrated) };
        let message = format!("its migration would change what the graph says: {difference}");
        let help = "this is a fault of a pack's migrations, or of maquette: the file stays".into();
        let source = Arc::new(source(text, path));
        let finding =
            Finding { code: code::PANIC, span: Span::default(), message, help, note: None };
        Err(vec![finding.at(&source)])
    }
}

/// The text after all steps.
fn all_steps(path: &Path, text: &str, catalog: &Catalog) -> String {
    let (tree, _) = parse(text);
    let mut migrated = text.to_owned();
    if tree.name().is_some_and(|name| name.text == "Patch") {
        let options = Options { files: Files::Ignored, ..Options::default() };
        let graph = patched_tree(path, text.to_owned(), catalog, &options);
        migrated = apply(text, of_patch(&tree, &graph, text, catalog));
    }
    for _ in 0..MOST_STEPS {
        let splices = next_steps(&migrated, catalog);
        if splices.is_empty() {
            break;
        }
        migrated = apply(&migrated, splices);
    }
    migrated
}

/// The edits of the next step of each call in a text.
fn next_steps(text: &str, catalog: &Catalog) -> Vec<Splice> {
    let (tree, _) = parse(text);
    nodes_of_packs(&tree).flat_map(|(_, node)| call_steps(node, text, catalog)).collect()
}

/// Those of one of them.
fn call_steps(node: &Tree, text: &str, catalog: &Catalog) -> Vec<Splice> {
    let migrations = Migrations { catalog };
    let Some(Call { kind, is_text, groups }) = Call::of(node) else { return Vec::new() };
    if let Some(new) = migrations.kind(&kind.text) {
        return vec![(kind.span, if is_text { quoted(new) } else { new.to_owned() })];
    }
    groups
        .into_iter()
        .flat_map(|group| match migrations.field(&kind.text, group) {
            Some((at, Migration::Field { new, value, .. })) => {
                field_splices(text, group, at, new, *value)
            }
            _ => Vec::new(),
        })
        .collect()
}

/// The edits that put a field's value to the place that it has now.
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
            let mut splices = without(text, call, &std::collections::BTreeSet::from([at]));
            splices.extend(added(text, &other.value, inner, &moved));
            splices
        }
        None => {
            fn at(at: usize) -> Span {
                Span { start: at, end: at }
            }
            splices.push((field.name.span, group.to_owned()));
            splices.insert(0, (at(field.value.span.start), format!("({inner}: ")));
            splices.push((at(field.value.span.end), ")".to_owned()));
            splices
        }
    }
}
