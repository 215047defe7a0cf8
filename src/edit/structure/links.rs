//! Links of ports: made, changed and taken away.

use maquette_graph::Refusal;
use maquette_graph::place::{Found, field, find};
use maquette_graph::splice::{Splice, added, apply, behind, parts, put_entry};
use maquette_graph::top::field_of;
use maquette_syntax::error::{Span, code};
use maquette_syntax::{Kind, Tree, nearest_or_all, parse, quoted};

use super::{Gone, Structure, call_of, one, refusal};
use crate::references::References;

impl Structure<'_> {
    /// A node, and the way to a port in its call, as the text has it.
    fn port<'p>(&self, given: &'p str) -> Result<(&'p str, &Tree, Vec<&'p str>), Refusal> {
        let Some((node, port)) = given.split_once('.') else {
            let message = format!("`{given}` is no port");
            return Err(refusal(code::UNKNOWN_FIELD, Span::default(), message, "write NODE.PORT"));
        };
        let call = self.node(node)?;
        let mut steps: Vec<_> = port.split('.').collect();
        let kind = call.name().map_or_else(String::new, |kind| kind.text);
        match &kind[..] {
            "Switch" if steps[0] != "cases" => steps.insert(0, "cases"),
            "ForEach" if !["links", "carry", "with", "over"].contains(&steps[0]) => {
                let group = ["carry", "with"]
                    .into_iter()
                    .find(|group| {
                        field(call, group)
                            .is_some_and(|group| field(&group.value, steps[0]).is_some())
                    })
                    .unwrap_or("links");
                steps.insert(0, group);
            }
            _ => {}
        }
        Ok((node, call, steps))
    }

    pub(super) fn link(&self, port: &str, to: &str) -> Result<String, Refusal> {
        let (node, call, steps) = self.port(port)?;
        let (splices, way) = self.linked(node, call, &steps, &quoted(to))?;
        let text = apply(self.text, splices);
        // Only the check knows which texts are links.
        let (tree, _) = parse(&text);
        let references = References::of(self.judge, &text);
        let way: Vec<_> = way.iter().map(String::as_str).collect();
        let is_link = match call_of(&tree, node).map(|call| find(call, &way, None)) {
            Some(Ok(Found::Value(link))) => references.is_ok_and(|all| all.is_link(link.span)),
            _ => false,
        };
        if is_link { Ok(text) } else { Err(self.no_port(node, call, port)) }
    }

    fn no_port(&self, node: &str, call: &Tree, given: &str) -> Refusal {
        let ports = self.references.ports.get(node).into_iter().flatten();
        let ports: Vec<_> = ports.map(|port| &port.name[..]).collect();
        let port = given.split_once('.').map_or(given, |(_, port)| port);
        let message = format!("`{node}` has no port `{port}`");
        let help = nearest_or_all(port, "its ports", &ports);
        refusal(code::UNKNOWN_FIELD, call.span, message, help)
    }

    /// The edits that put a link to a port, and the way to it in the new text.
    fn linked(
        &self,
        node: &str,
        call: &Tree,
        steps: &[&str],
        link: &str,
    ) -> Result<(Vec<Splice>, Vec<String>), Refusal> {
        let (steps, index) = match steps.split_last() {
            Some((last, before)) if !before.is_empty() && before != ["cases"] => {
                let index = last.parse::<usize>().ok();
                (if index.is_some() { before } else { steps }, index)
            }
            _ => (steps, None),
        };
        fn way(index: Option<usize>, steps: &[&str]) -> Vec<String> {
            let index = index.map(|index| index.to_string());
            steps.iter().map(|&step| step.to_owned()).chain(index).collect::<Vec<_>>()
        }
        if let ["cases", case] = steps
            && let Some(Tree { kind: Kind::Map(entries), .. }) =
                field(call, "cases").map(|field| &field.value)
            && entries.iter().all(|(key, _)| key.text() != Some(case))
            && let Some(cases) = field(call, "cases")
        {
            let entry = format!("{}: {link}", quoted(case));
            let splices = put_entry(self.text, &cases.value, None, false, |_| entry.clone());
            return Ok((splices, way(None, steps)));
        }
        let port = steps.last().copied().unwrap_or_default();
        let known = self.references.ports.get(node).into_iter().flatten();
        let many = known.into_iter().any(|known| known.name == port && known.many);
        let no_item = |span: Span, count: usize| {
            let message = format!("port `{port}` of `{node}` has no link {}", index.unwrap_or(0));
            let help = match (many, count) {
                (false, _) => "it takes one link".to_owned(),
                (true, 0) => "it has none: the first one has the number 0".to_owned(),
                (true, count) => format!("the next one has the number {count}"),
            };
            refusal(code::UNKNOWN_FIELD, span, message, help)
        };
        fn insert(at: usize, text: String) -> (Span, String) {
            (Span { start: at, end: at }, text)
        }
        fn listed(link: &str) -> String {
            format!("[{link}]")
        }
        match find(call, steps, None)? {
            Found::Value(list @ Tree { kind: Kind::List(items), .. }) => {
                let index = index.unwrap_or(items.len());
                let places = parts(list);
                let splices = match places.get(index) {
                    Some(&place) => vec![(place, link.to_owned())],
                    None if index > items.len() => return Err(no_item(list.span, items.len())),
                    None => match &places[..] {
                        [] => vec![(list.span, listed(link))],
                        [before @ .., last] => {
                            let before = before.last().map(|before| before.end);
                            behind(self.text, list.span, before, *last, link)
                        }
                    },
                };
                Ok((splices, way(Some(index), steps)))
            }
            Found::Value(value) if many => {
                let one = matches!(value.kind, Kind::Text(_));
                match index {
                    Some(0) if one => Ok((vec![(value.span, link.to_owned())], way(None, steps))),
                    None | Some(1) if one => {
                        let open = insert(value.span.start, "[".into());
                        let close = insert(value.span.end, format!(", {link}]"));
                        Ok((vec![open, close], way(Some(1), steps)))
                    }
                    None | Some(0) => Ok((vec![(value.span, listed(link))], way(Some(0), steps))),
                    Some(_) => Err(no_item(value.span, usize::from(one))),
                }
            }
            Found::Value(value) => match index {
                None => Ok((vec![(value.span, link.to_owned())], way(None, steps))),
                Some(_) => Err(no_item(value.span, 1)),
            },
            Found::Missing(owner, rest) => {
                if index.is_some_and(|index| index > 0 || !many) {
                    return Err(no_item(owner.span, 0));
                }
                let value = if many { listed(link) } else { link.to_owned() };
                let value =
                    rest[1..].iter().rev().fold(value, |value, name| format!("({name}: {value})"));
                let splices = added(self.text, owner, &rest[0], &value);
                Ok((splices, way(many.then_some(0), steps)))
            }
        }
    }

    pub(super) fn unlink(&self, given: &str) -> Result<Vec<Splice>, Vec<Refusal>> {
        let (node, call, steps) = self.port(given).map_err(one)?;
        let is_link = |tree: &Tree| self.references.is_link(tree.span);
        let found = find(call, &steps, None).map_err(one)?;
        let value = match found {
            Found::Value(value) => value.call_of("Some").unwrap_or(value),
            Found::Missing(owner, _) => owner,
        };
        let has_links = match (&found, &value.kind) {
            (Found::Missing(..), _) => false,
            (_, Kind::List(items)) => !items.is_empty() && items.iter().all(is_link),
            _ => is_link(value),
        };
        if !has_links {
            let port = given.split_once('.').map_or(given, |(_, port)| port);
            let message = format!("port `{port}` of `{node}` has no link");
            let help = match port.contains('-') {
                true => {
                    format!("a field has `_` where a name has `-`: `{node}.{}`", field_of(port))
                }
                false => String::new(),
            };
            let refused = refusal(code::UNKNOWN_FIELD, value.span, message, help);
            return Err(one(refused));
        }
        let mut gone = Gone::new();
        self.let_link_go(&self.holders(value.span), value.span, &mut gone).map_err(one)?;
        let refusals = self.let_lists_go(&mut gone);
        if refusals.is_empty() { Ok(self.spliced(&gone)) } else { Err(refusals) }
    }
}
