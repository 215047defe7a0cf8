//! Migration of values that are put into a node from outside of the graph file: by `--set`, a test, a patch or an edit. A value for an
//! outdated field name is moved to the current field.
//!
//! [`migrate_field_value`] reads the value as if it were the only field of the node. Callers that store the value in a file write the
//! migrated path and value.

use maquette_syntax::error::Span;
use maquette_syntax::{Body, Field, Kind, LocalDiagnostic, MAX_DEPTH, Name, Tree, parse, quote};

use super::{Splice, apply, migrate_node, remove_parts, rewrite_value};
use crate::catalog::Catalog;
use crate::draft_value::is_side;
use crate::tree::entries;

/// An impossible span that marks the value, so that it can be found in the migrated node.
const MARK: Span = Span { start: usize::MAX, end: usize::MAX };

/// A migrated value, with the current name of its field.
pub struct MigratedValue {
    /// The path of the field within the node, such as `select.distance`.
    pub(crate) path: String,
    pub value: Tree,
    /// Warnings about the outdated parts of the value.
    pub(crate) diagnostics: Vec<LocalDiagnostic>,
}

/// Migrates a value that is to be set at a path within a node. Returns `None` if the path and the value are current.
pub fn migrate_field_value(
    node: &Tree,
    path: &str,
    value: &Tree,
    catalog: &Catalog,
) -> Option<MigratedValue> {
    if path.split('.').count() > MAX_DEPTH {
        return None;
    }
    let node = migrate_node(node, catalog).0;
    let kind = node.name()?;
    let (mut numbers, mut marked) = (Vec::new(), Tree { span: MARK, ..value.clone() });
    for step in path.rsplit('.') {
        let kind = match step.parse::<usize>() {
            Ok(number) => {
                numbers.insert(0, number);
                Kind::List(vec![marked])
            }
            _ => {
                let name = Name { text: step.to_owned(), span: value.span };
                let around = is_side(step).then(|| Name { text: "Draft".into(), span: value.span });
                let body = Body::Fields(vec![Field { name, value: marked }]);
                Kind::Call { name: around, body }
            }
        };
        marked = Tree::new(value.span, kind);
    }
    // Keep only the marked field and, for a `ForEach`, the field `graph`, which names the repeated type.
    let Kind::Call { name, body: Body::Fields(fields) } = &mut marked.kind else { return None };
    let graph = node.fields().unwrap_or_default().iter().filter(|it| it.name.text == "graph");
    fields.extend(graph.cloned());
    *name = Some(kind);
    let (marked, diagnostics) = migrate_node(&marked, catalog);
    if diagnostics.is_empty() {
        return None;
    }
    let (mut steps, mut numbers) = (Vec::new(), numbers.into_iter());
    let found = find_marked(&marked, &mut steps)?;
    let path = steps
        .into_iter()
        .filter_map(|step: Option<String>| step.or_else(|| Some(numbers.next()?.to_string())))
        .collect::<Vec<_>>()
        .join(".");
    Some(MigratedValue { path, value: Tree { span: value.span, ..found.clone() }, diagnostics })
}

/// Returns the marked value, and the names on the path to it. `None` in the path is an item of a list. If the value was moved into a group
/// of fields, the group is marked too.
fn find_marked<'t>(tree: &'t Tree, steps: &mut Vec<Option<String>>) -> Option<&'t Tree> {
    let mut inside = |step: Option<String>, tree: &'t Tree| {
        steps.push(step);
        let found = find_marked(tree, steps);
        if found.is_none() {
            steps.pop();
        }
        found
    };
    let found = match &tree.kind {
        Kind::List(items) => items.iter().find_map(|item| inside(None, item)),
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().find_map(|field| inside(Some(field.name.text.clone()), &field.value))
        }
        _ => None,
    };
    found.or((tree.span == MARK).then_some(tree))
}

/// Returns the text of a migrated value. Unchanged parts keep their old text.
pub fn migrated_text(old: &Tree, new: &Tree, text: &str) -> String {
    let Span { start, end } = old.span;
    let mut splices = Vec::new();
    rewrite_value(old, new, text, &mut splices);
    for (span, _) in &mut splices {
        *span = Span { start: span.start - start, end: span.end - start };
    }
    apply(&text[start..end], splices)
}

/// Returns the nodes of a graph whose types are defined by packs, not by used graphs.
pub(crate) fn nodes_of_packs(graph: &Tree) -> impl Iterator<Item = (&str, &Tree)> {
    let fields = graph.fields().unwrap_or_default();
    let own: Vec<_> = entries(fields, "use").map(|(name, _)| name).collect();
    entries(fields, "nodes").filter(move |(_, node)| {
        let kind = super::Call::read(node).map(|call| call.kind.text);
        kind.is_some_and(|kind| !own.contains(&&kind[..]))
    })
}

/// Splits the target of a value: returns the node, the name of the node, and the path within the node.
fn node_of<'t, 'n>(graph: &'t Tree, target: &'n str) -> Option<(&'t Tree, &'n str, &'n str)> {
    let (name, path) = target.split_once('.')?;
    // An element of a `ForEach`, such as `copies/1`, has the type that the `ForEach` repeats.
    let each = name.split_once('/').map_or(name, |(each, _)| each);
    let (_, node) = nodes_of_packs(graph).find(|(known, _)| *known == each)?;
    Some((node, name, path))
}

/// Migrates a target and its value in a graph. Returns `None` if both are current.
pub fn migrate_target(
    graph: &Tree,
    target: &str,
    value: &Tree,
    catalog: &Catalog,
) -> Option<(String, MigratedValue)> {
    let (node, name, path) = node_of(graph, target)?;
    let element = name.contains('/').then(|| super::Call::read(node)).flatten();
    let element = element.map(|call| Tree::new(node.span, Kind::Word(call.kind.text)));
    let renewed = migrate_field_value(element.as_ref().unwrap_or(node), path, value, catalog)?;
    Some((format!("{name}.{}", renewed.path), renewed))
}

/// Returns the edits that migrate the section `nodes` of a patch.
pub(super) fn patch_splices(
    patch: &Tree,
    graph: &Tree,
    text: &str,
    catalog: &Catalog,
) -> Vec<Splice> {
    let mut splices = Vec::new();
    for field in patch.fields().unwrap_or_default() {
        let ("nodes", Kind::Map(nodes)) = (&field.name.text[..], &field.value.kind) else {
            continue;
        };
        for (key, group) in nodes {
            let Some(owner) = key.text() else { continue };
            group_splices((key, owner, group), graph, text, catalog, &mut splices);
        }
    }
    splices
}

/// Collects the edits that migrate the fields of one node in a patch. A field that was moved into another group gets an entry of its own:
/// the other fields of that group must keep the values that they have in the patched graph.
fn group_splices(
    (key, owner, group): (&Tree, &str, &Tree),
    graph: &Tree,
    text: &str,
    catalog: &Catalog,
    splices: &mut Vec<Splice>,
) {
    let fields = group.fields().unwrap_or_default();
    let (mut moved, mut added) = (std::collections::BTreeSet::new(), String::new());
    for (at, field) in fields.iter().enumerate() {
        let target = format!("{owner}.{}", field.name.text);
        let Some((now, renewed)) = migrate_target(graph, &target, &field.value, catalog) else {
            continue;
        };
        let (place, name) = now.rsplit_once('.').unwrap_or(("", &now));
        if place != owner && fields.len() > 1 {
            moved.insert(at);
            let value = migrated_text(&field.value, &renewed.value, text);
            added += &format!(", {}: ({name}: {value})", quote(place));
            continue;
        }
        if place != owner {
            splices.push((key.span, quote(place)));
        }
        if name != field.name.text {
            splices.push((field.name.span, name.to_owned()));
        }
        rewrite_value(&field.value, &renewed.value, text, splices);
    }
    if !moved.is_empty() {
        let end = group.span.end;
        splices.extend(remove_parts(text, group, &moved));
        splices.push((Span { start: end, end }, added));
    }
}

/// Returns the edits of the next migration step for one node.
pub fn node_steps(text: &str, name: &str, catalog: &Catalog) -> Vec<Splice> {
    let (tree, _) = parse(text);
    let found = nodes_of_packs(&tree).find(|(known, _)| *known == name);
    found.map_or_else(Vec::new, |(_, node)| super::call_steps(node, text, catalog))
}

/// Returns warnings about the outdated names in one node.
pub fn outdated_parts(graph: &Tree, name: &str, catalog: &Catalog) -> Vec<LocalDiagnostic> {
    let found = nodes_of_packs(graph).find(|(known, _)| *known == name);
    found.map_or_else(Vec::new, |(_, node)| migrate_node(node, catalog).1)
}

/// Migrates the field to which a target refers in the text of a graph, so that a value can be set under the field's current name.
pub fn prepare_for(text: String, target: &str, catalog: &Catalog) -> String {
    let (tree, _) = parse(&text);
    let Some((node, name, path)) = node_of(&tree, target) else { return text };
    if !node.fields().unwrap_or_default().iter().any(|field| {
        let renewed = migrate_field_value(node, &field.name.text, &field.value, catalog);
        fn first_step(path: &str) -> Option<String> {
            path.split('.').next().map(str::to_owned)
        }
        renewed.is_some_and(|renewed| first_step(&renewed.path) == first_step(path))
    }) {
        return text;
    }
    let mut ready = text;
    for _ in 0..super::MAX_STEPS {
        let splices = node_steps(&ready, name, catalog);
        if splices.is_empty() {
            break;
        }
        ready = apply(&ready, splices);
    }
    ready
}

#[cfg(test)]
mod tests {
    use maquette_node::pack::{Migration, NewValue, Pack};

    use super::*;

    const MIGRATIONS: &[Migration] = &[
        Migration::Field { node: "A", old: "top", new: "edge.top", value: NewValue::Times(2.0) },
        Migration::Field { node: "A", old: "size", new: "sizes", value: NewValue::Times(2.0) },
    ];
    const PACK: Pack = Pack { name: "a", migrations: MIGRATIONS, ..Pack::EMPTY };

    #[test]
    fn a_field_of_a_patch_that_is_in_a_group_now_leaves_the_rest_of_the_group_alone() {
        let catalog = Catalog::new(&[&PACK]);
        let graph = parse("Graph(nodes: {\"a\": A(), \"b\": ForEach(graph: \"A\")})").0;
        fn migrate(nodes: &str, graph: &Tree, catalog: &Catalog) -> String {
            let text = format!("Patch(nodes: {{ {nodes} }})");
            let splices = patch_splices(&parse(&text).0, graph, &text, catalog);
            let text = apply(&text, splices);
            text.trim_start_matches("Patch(nodes: { ").trim_end_matches(" })").to_owned()
        }
        assert_eq!(migrate("\"a\": (top: 1)", &graph, &catalog), "\"a.edge\": (top: 2)");
        assert_eq!(
            migrate("\"a\": (size: 3, top: 1, other: 4)", &graph, &catalog),
            "\"a\": (sizes: 6, other: 4), \"a.edge\": (top: 2)"
        );
        assert_eq!(
            migrate("\"b\": (with: (size: 1))", &graph, &catalog),
            "\"b\": (with: (sizes: 2))"
        );
    }

    #[test]
    fn ways_through_lists_and_elements_are_kept() {
        let catalog = Catalog::new(&[&PACK]);
        let graph = parse("Graph(nodes: {\"a\": A(), \"b\": ForEach(graph: \"A\")})").0;
        let (one, _) = parse("1");
        let now = |target: &str| {
            let (target, migrated) = migrate_target(&graph, target, &one, &catalog)?;
            let Kind::Number { value, .. } = migrated.value.kind else {
                panic!("{:?}", migrated.value)
            };
            Some((target, value))
        };
        assert_eq!(now("a.size.3"), Some(("a.sizes.3".into(), 2.0)));
        assert_eq!(now("a.top"), Some(("a.edge.top".into(), 2.0)));
        assert_eq!(now("b/2.size"), Some(("b/2.sizes".into(), 2.0)));
        assert_eq!(now("b.over.1.size"), Some(("b.over.1.sizes".into(), 2.0)));
        assert_eq!(now("b.with.size"), Some(("b.with.sizes".into(), 2.0)));
        assert_eq!(now("a.other"), None);
        assert_eq!(now("c.size"), None);
    }
}
