//! Translates the names of generated nodes to positions in the file. Such names are `copies/1` for an element of a `ForEach`, and
//! `nose/mask` for a node in a used graph.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Kind, Tree};

use super::place::{EditError, field};
use crate::draft_value::{is_draft, side};

/// Translates the target of an edit, a node or field, to the names that the file contains. `copies/1.scale` becomes `copies.over.0.scale`:
/// the first item of the list from which the `ForEach` makes its elements. Other targets are returned unchanged.
///
/// # Errors
/// The target is a node that the file does not contain. The help states where its values are written.
pub fn target_in_file(graph: &Tree, target: &str, draft: bool) -> Result<String, EditError> {
    let (name, path) = target.split_once('.').unwrap_or((target, ""));
    let Some((outer, inner)) = name.split_once('/') else { return Ok(target.to_owned()) };
    let Some(node) = entry(graph, "nodes", outer) else { return Ok(target.to_owned()) };
    let kind = node.name().map_or(String::new(), |name| name.text);
    fn unknown_target(message: String, help: String) -> Result<String, EditError> {
        let error = EditError::new(Span::default(), message, help);
        Err(EditError { code: code::UNKNOWN_LINK, ..error })
    }
    if kind != "ForEach" {
        let Some(used) = entry(graph, "use", &kind) else { return Ok(target.to_owned()) };
        let help = format!("{}, or set a parameter of it: {outer}.NAME=VALUE", in_file(used));
        return unknown_target(format!("`{name}` is inside the graph that `{outer}` uses"), help);
    }
    let of = |name: &str| field(node, name).map(|field| resolve_side(&field.value, draft));
    let (number, inside) = inner.split_once('/').map_or((inner, None), |(n, it)| (n, Some(it)));
    let index = number.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
    let Some(Tree { kind: Kind::List(items), .. }) = of("over") else {
        let field = path.split('.').next().filter(|_| inside.is_none() && !path.is_empty());
        let all = field.map_or("NAME", |_| path);
        let help = format!(
            "elements have no names in the file; set all of them: {outer}.with.{all}=VALUE"
        );
        return unknown_target(format!("the graph has no node `{name}`"), help);
    };
    let Some((index, item)) = index.and_then(|index| Some((index, items.get(index)?))) else {
        let help = match items.len() {
            0 => "its list `over` is empty".to_owned(),
            count => format!("the elements of `{outer}` are `{outer}/1` to `{outer}/{count}`"),
        };
        return unknown_target(format!("the graph has no node `{name}`"), help);
    };
    if inside.is_some() {
        let repeated = of("graph").and_then(Tree::text).unwrap_or_default();
        let change = entry(graph, "use", repeated).map_or("change it there".to_owned(), in_file);
        let help = format!("{change}, or set a parameter of it: {outer}/{number}.NAME=VALUE");
        return unknown_target(
            format!("`{name}` is inside the graph that `{outer}` repeats"),
            help,
        );
    }
    let (first, rest) = path.split_once('.').unwrap_or((path, ""));
    if !rest.is_empty()
        && field(resolve_side(item, draft), first).is_none()
        && of("with").is_some_and(|with| field(with, first).is_some())
    {
        let message = format!("`{name}` has no `{first}` of its own, but that of all elements");
        let help = format!(
            "set the whole field: {name}.{first}=VALUE; or set that of all elements: {outer}.with.{path}=VALUE"
        );
        return Err(EditError::new(item.span, message, help));
    }
    Ok(format!("{outer}.over.{index}{}", &target[name.len()..]))
}

fn in_file(used: &Tree) -> String {
    let file = used.text().or_else(|| used.call_of("Graph")?.text());
    file.map_or("change it there".to_owned(), |file| format!("change it in {file}"))
}

fn entry<'t>(graph: &'t Tree, section: &str, name: &str) -> Option<&'t Tree> {
    let Kind::Map(entries) = &field(graph, section)?.value.kind else { return None };
    entries.iter().find(|(key, _)| key.text() == Some(name)).map(|(_, value)| value)
}

fn resolve_side(tree: &Tree, draft: bool) -> &Tree {
    if is_draft(tree) { side(tree, draft).unwrap_or(tree) } else { tree }
}
