//! Values that are put into a node from outside of its graph's text: by `--set`, a test, a patch, or an edit. One that names a field as it
//! was once called goes where that field is now.
//!
//! There is one way: the value is read as if it stood alone in the node ([`renewed_put`]); who keeps it in a text writes what comes of it.

use maquette_syntax::error::Span;
use maquette_syntax::{Body, DEEPEST, Field, Finding, Kind, Name, Tree, parse, quoted};

use super::{Splice, apply, renewed, without, written};
use crate::catalog::Catalog;
use crate::quality::is_side;
use crate::tree::entries;

/// By this place the value is found again among the fields around it.
const MARK: Span = Span { start: usize::MAX, end: usize::MAX };

/// A value under its present name.
pub struct Renewed {
    /// The way to it from the node on: `select.distance`.
    pub(crate) path: String,
    pub value: Tree,
    /// What was old about it.
    pub(crate) findings: Vec<Finding>,
}

/// What a value is that is put to this place of a node; none if nothing about it is old.
pub fn renewed_put(node: &Tree, path: &str, value: &Tree, catalog: &Catalog) -> Option<Renewed> {
    if path.split('.').count() > DEEPEST {
        return None;
    }
    let node = renewed(node, catalog).0;
    let kind = node.name()?;
    let (mut numbers, mut put) = (Vec::new(), Tree { span: MARK, ..value.clone() });
    for step in path.rsplit('.') {
        let kind = match step.parse::<usize>() {
            Ok(number) => {
                numbers.insert(0, number);
                Kind::List(vec![put])
            }
            _ => {
                let name = Name { text: step.to_owned(), span: value.span };
                let around = is_side(step).then(|| Name { text: "Draft".into(), span: value.span });
                let body = Body::Fields(vec![Field { name, value: put }]);
                Kind::Call { name: around, body }
            }
        };
        put = Tree::new(value.span, kind);
    }
    // As the only field of the node, beside what says which type a `ForEach` repeats.
    let Kind::Call { name, body: Body::Fields(fields) } = &mut put.kind else { return None };
    let graph = node.fields().unwrap_or_default().iter().filter(|it| it.name.text == "graph");
    fields.extend(graph.cloned());
    *name = Some(kind);
    let (put, findings) = renewed(&put, catalog);
    if findings.is_empty() {
        return None;
    }
    let (mut steps, mut numbers) = (Vec::new(), numbers.into_iter());
    let found = marked(&put, &mut steps)?;
    let path = steps
        .into_iter()
        .filter_map(|step: Option<String>| step.or_else(|| Some(numbers.next()?.to_string())))
        .collect::<Vec<_>>()
        .join(".");
    Some(Renewed { path, value: Tree { span: value.span, ..found.clone() }, findings })
}

/// The value that is marked, and the names that lead to it; none for an item of a list. A group that it was moved into is marked, too.
fn marked<'t>(tree: &'t Tree, steps: &mut Vec<Option<String>>) -> Option<&'t Tree> {
    let mut inside = |step: Option<String>, tree: &'t Tree| {
        steps.push(step);
        let found = marked(tree, steps);
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

/// A value's text as it is now: what it was in this text, and only what is said otherwise written anew.
pub fn renewed_text(old: &Tree, new: &Tree, text: &str) -> String {
    let Span { start, end } = old.span;
    let mut splices = Vec::new();
    written(old, new, text, &mut splices);
    for (span, _) in &mut splices {
        *span = Span { start: span.start - start, end: span.end - start };
    }
    apply(&text[start..end], splices)
}

/// The nodes of a graph's text whose types are the packs', not graphs that it uses.
pub(crate) fn nodes_of_packs(graph: &Tree) -> impl Iterator<Item = (&str, &Tree)> {
    let fields = graph.fields().unwrap_or_default();
    let own: Vec<_> = entries(fields, "use").map(|(name, _)| name).collect();
    entries(fields, "nodes").filter(move |(_, node)| {
        let kind = super::Call::of(node).map(|call| call.kind.text);
        kind.is_some_and(|kind| !own.contains(&&kind[..]))
    })
}

/// A node of the text of a graph, by the beginning of a target, with the rest of the way.
fn node_of<'t, 'n>(graph: &'t Tree, target: &'n str) -> Option<(&'t Tree, &'n str, &'n str)> {
    let (name, path) = target.split_once('.')?;
    // An element of a `ForEach` has the type that this one repeats.
    let each = name.split_once('/').map_or(name, |(each, _)| each);
    let (_, node) = nodes_of_packs(graph).find(|(known, _)| *known == each)?;
    Some((node, name, path))
}

/// A target and its value as they are now, of the graph with this text; none if nothing about them is old.
pub fn renewed_target(
    graph: &Tree,
    target: &str,
    value: &Tree,
    catalog: &Catalog,
) -> Option<(String, Renewed)> {
    let (node, name, path) = node_of(graph, target)?;
    let element = name.contains('/').then(|| super::Call::of(node)).flatten();
    let element = element.map(|call| Tree::new(node.span, Kind::Word(call.kind.text)));
    let renewed = renewed_put(element.as_ref().unwrap_or(node), path, value, catalog)?;
    Some((format!("{name}.{}", renewed.path), renewed))
}

/// The edits of the `nodes` of a patch of a graph.
pub(super) fn of_patch(patch: &Tree, graph: &Tree, text: &str, catalog: &Catalog) -> Vec<Splice> {
    let mut splices = Vec::new();
    for field in patch.fields().unwrap_or_default() {
        let ("nodes", Kind::Map(nodes)) = (&field.name.text[..], &field.value.kind) else {
            continue;
        };
        for (key, group) in nodes {
            let Some(owner) = key.text() else { continue };
            of_group((key, owner, group), graph, text, catalog, &mut splices);
        }
    }
    splices
}

/// The same of the fields of one node. A field that lies in another group now gets an entry of its own, so that the rest of that group stays
/// as the patched graph has it.
fn of_group(
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
        let Some((now, renewed)) = renewed_target(graph, &target, &field.value, catalog) else {
            continue;
        };
        let (place, name) = now.rsplit_once('.').unwrap_or(("", &now));
        if place != owner && fields.len() > 1 {
            moved.insert(at);
            let value = renewed_text(&field.value, &renewed.value, text);
            added += &format!(", {}: ({name}: {value})", quoted(place));
            continue;
        }
        if place != owner {
            splices.push((key.span, quoted(place)));
        }
        if name != field.name.text {
            splices.push((field.name.span, name.to_owned()));
        }
        written(&field.value, &renewed.value, text, splices);
    }
    if !moved.is_empty() {
        let end = group.span.end;
        splices.extend(without(text, group, &moved));
        splices.push((Span { start: end, end }, added));
    }
}

/// The edits that bring one node of a graph's text up to date, a step of them at a time.
pub fn node_steps(text: &str, name: &str, catalog: &Catalog) -> Vec<Splice> {
    let (tree, _) = parse(text);
    let found = nodes_of_packs(&tree).find(|(known, _)| *known == name);
    found.map_or_else(Vec::new, |(_, node)| super::call_steps(node, text, catalog))
}

/// What is old about one node of a graph.
pub fn renewed_node(graph: &Tree, name: &str, catalog: &Catalog) -> Vec<Finding> {
    let found = nodes_of_packs(graph).find(|(known, _)| *known == name);
    found.map_or_else(Vec::new, |(_, node)| renewed(node, catalog).1)
}

/// A graph's text that is ready for a value at this target: a field that stands there under its old name has the new one then.
pub fn ready_for(text: String, target: &str, catalog: &Catalog) -> String {
    let (tree, _) = parse(&text);
    let Some((node, name, path)) = node_of(&tree, target) else { return text };
    if !node.fields().unwrap_or_default().iter().any(|field| {
        let renewed = renewed_put(node, &field.name.text, &field.value, catalog);
        fn first(path: &str) -> Option<String> {
            path.split('.').next().map(str::to_owned)
        }
        renewed.is_some_and(|renewed| first(&renewed.path) == first(path))
    }) {
        return text;
    }
    let mut ready = text;
    for _ in 0..super::MOST_STEPS {
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
        fn migrated(nodes: &str, graph: &Tree, catalog: &Catalog) -> String {
            let text = format!("Patch(nodes: {{ {nodes} }})");
            let splices = of_patch(&parse(&text).0, graph, &text, catalog);
            let text = apply(&text, splices);
            text.trim_start_matches("Patch(nodes: { ").trim_end_matches(" })").to_owned()
        }
        assert_eq!(migrated("\"a\": (top: 1)", &graph, &catalog), "\"a.edge\": (top: 2)");
        assert_eq!(
            migrated("\"a\": (size: 3, top: 1, other: 4)", &graph, &catalog),
            "\"a\": (sizes: 6, other: 4), \"a.edge\": (top: 2)"
        );
        assert_eq!(
            migrated("\"b\": (with: (size: 1))", &graph, &catalog),
            "\"b\": (with: (sizes: 2))"
        );
    }

    #[test]
    fn ways_through_lists_and_elements_are_kept() {
        let catalog = Catalog::new(&[&PACK]);
        let graph = parse("Graph(nodes: {\"a\": A(), \"b\": ForEach(graph: \"A\")})").0;
        let (one, _) = parse("1");
        let now = |target: &str| {
            let (target, put) = renewed_target(&graph, target, &one, &catalog)?;
            let Kind::Number { value, .. } = put.value.kind else { panic!("{:?}", put.value) };
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
