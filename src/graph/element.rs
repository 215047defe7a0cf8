//! Names of elements and of what lies in used graphs, `copies/1` and `nose/mask`: which of them have a place in the file.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Kind, Tree};

use super::place::{Refusal, field};
use crate::quality::{is_draft, side};

/// The target by the names that the file has: `copies.over.0.scale` for `copies/1.scale`, the item of the list from which a
/// `ForEach` makes its first element. What names no element stays as it is.
///
/// # Errors
/// It names a node that has no place in the file; the help says where its values are.
pub fn written(graph: &Tree, target: &str, draft: bool) -> Result<String, Refusal> {
    fn own(target: &str) -> Result<String, Refusal> {
        Ok(target.to_owned())
    }
    let (name, path) = target.split_once('.').unwrap_or((target, ""));
    let Some((outer, inner)) = name.split_once('/') else { return own(target) };
    let Some(node) = entry(graph, "nodes", outer) else { return own(target) };
    let kind = node.name().map_or(String::new(), |name| name.text);
    fn refuse(message: String, help: String) -> Result<String, Refusal> {
        let refusal = Refusal::new(Span::default(), message, help);
        Err(Refusal { code: code::UNKNOWN_LINK, ..refusal })
    }
    if kind != "ForEach" {
        let Some(used) = entry(graph, "use", &kind) else { return own(target) };
        let help = format!("{}, or set a parameter of it: {outer}.NAME=VALUE", in_file(used));
        return refuse(format!("`{name}` is inside of the graph that `{outer}` uses"), help);
    }
    let of = |name: &str| field(node, name).map(|field| chosen(&field.value, draft));
    let (number, inside) = inner.split_once('/').map_or((inner, None), |(n, it)| (n, Some(it)));
    let index = number.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
    let Some(Tree { kind: Kind::List(items), .. }) = of("over") else {
        let field = path.split('.').next().filter(|_| inside.is_none() && !path.is_empty());
        let all = field.map_or("NAME", |_| path);
        let help =
            format!("elements have no names in the file; all of them: {outer}.with.{all}=VALUE");
        return refuse(format!("the graph has no node `{name}`"), help);
    };
    let Some((index, item)) = index.and_then(|index| Some((index, items.get(index)?))) else {
        let help = match items.len() {
            0 => "its list `over` is empty".to_owned(),
            count => format!("the elements of `{outer}` are `{outer}/1` to `{outer}/{count}`"),
        };
        return refuse(format!("the graph has no node `{name}`"), help);
    };
    if inside.is_some() {
        let repeated = of("graph").and_then(Tree::text).unwrap_or_default();
        let change = entry(graph, "use", repeated).map_or("change it there".to_owned(), in_file);
        let help = format!("{change}, or set a parameter of it: {outer}/{number}.NAME=VALUE");
        return refuse(format!("`{name}` is inside of the graph that `{outer}` repeats"), help);
    }
    let (first, rest) = path.split_once('.').unwrap_or((path, ""));
    let has = |tree: &Tree| field(tree, first).is_some();
    if !rest.is_empty() && !has(chosen(item, draft)) && of("with").is_some_and(has) {
        let message = format!("`{name}` has no `{first}` of its own, but that of all elements");
        let help = format!(
            "give it a whole one: {name}.{first}=VALUE; or change that of all: {outer}.with.{path}=VALUE"
        );
        return Err(Refusal::new(item.span, message, help));
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

fn chosen(tree: &Tree, draft: bool) -> &Tree {
    if is_draft(tree) { side(tree, draft).unwrap_or(tree) } else { tree }
}
