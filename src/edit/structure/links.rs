//! Adds, changes and removes the links of ports.

use maquette_graph::EditError;
use maquette_graph::header::field_of;
use maquette_graph::place::{PathEnd, field, find};
use maquette_graph::splice::{Splice, add_field, apply, insert_after, parts, put_entry};
use maquette_syntax::error::{Span, code};
use maquette_syntax::{Kind, Tree, nearest_or_all, parse, quote};

use super::{Removals, Structure, call_of, edit_error, to_errors};
use crate::references::References;

impl Structure<'_> {
    /// Splits `node.port` into the node's name, its call and the path of the port within the call.
    fn find_port<'p>(&self, given: &'p str) -> Result<(&'p str, &Tree, Vec<&'p str>), EditError> {
        let Some((node, port)) = given.split_once('.') else {
            let message = format!("`{given}` is not a port");
            return Err(edit_error(
                code::UNKNOWN_FIELD,
                Span::default(),
                message,
                "write NODE.PORT",
            ));
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

    pub(super) fn link(&self, port: &str, to: &str) -> Result<String, EditError> {
        let (node, call, steps) = self.find_port(port)?;
        let (splices, way) = self.link_splices(node, call, &steps, &quote(to))?;
        let text = apply(self.text, splices);
        // Only a check of the graph shows which texts are links.
        let (tree, _) = parse(&text);
        let references = References::read(self.editor, &text);
        let way: Vec<_> = way.iter().map(String::as_str).collect();
        let is_link = match call_of(&tree, node).map(|call| find(call, &way, None)) {
            Some(Ok(PathEnd::Value(link))) => references.is_ok_and(|all| all.is_link(link.span)),
            _ => false,
        };
        if is_link { Ok(text) } else { Err(self.unknown_port(node, call, port)) }
    }

    fn unknown_port(&self, node: &str, call: &Tree, given: &str) -> EditError {
        let ports = self.references.ports.get(node).into_iter().flatten();
        let ports: Vec<_> = ports.map(|port| &port.name[..]).collect();
        let port = given.split_once('.').map_or(given, |(_, port)| port);
        let message = format!("`{node}` has no port `{port}`");
        let help = nearest_or_all(port, "its ports", &ports);
        edit_error(code::UNKNOWN_FIELD, call.span, message, help)
    }

    /// Returns the edits that set a link at a port, and the path of the link in the new text.
    fn link_splices(
        &self,
        node: &str,
        call: &Tree,
        steps: &[&str],
        link: &str,
    ) -> Result<(Vec<Splice>, Vec<String>), EditError> {
        let (steps, index) = match steps.split_last() {
            Some((last, before)) if !before.is_empty() && before != ["cases"] => {
                let index = last.parse::<usize>().ok();
                (if index.is_some() { before } else { steps }, index)
            }
            _ => (steps, None),
        };
        fn link_path(index: Option<usize>, steps: &[&str]) -> Vec<String> {
            let index = index.map(|index| index.to_string());
            steps.iter().map(|&step| step.to_owned()).chain(index).collect::<Vec<_>>()
        }
        if let ["cases", case] = steps
            && let Some(Tree { kind: Kind::Map(entries), .. }) =
                field(call, "cases").map(|field| &field.value)
            && entries.iter().all(|(key, _)| key.text() != Some(case))
            && let Some(cases) = field(call, "cases")
        {
            let entry = format!("{}: {link}", quote(case));
            let splices = put_entry(self.text, &cases.value, None, false, |_| entry.clone());
            return Ok((splices, link_path(None, steps)));
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
            edit_error(code::UNKNOWN_FIELD, span, message, help)
        };
        fn insert(at: usize, text: String) -> (Span, String) {
            (Span { start: at, end: at }, text)
        }
        fn list_of(link: &str) -> String {
            format!("[{link}]")
        }
        match find(call, steps, None)? {
            PathEnd::Value(list @ Tree { kind: Kind::List(items), .. }) => {
                let index = index.unwrap_or(items.len());
                let places = parts(list);
                let splices = match places.get(index) {
                    Some(&place) => vec![(place, link.to_owned())],
                    None if index > items.len() => return Err(no_item(list.span, items.len())),
                    None => match &places[..] {
                        [] => vec![(list.span, list_of(link))],
                        [before @ .., last] => {
                            let before = before.last().map(|before| before.end);
                            insert_after(self.text, list.span, before, *last, link)
                        }
                    },
                };
                Ok((splices, link_path(Some(index), steps)))
            }
            PathEnd::Value(value) if many => {
                let one = matches!(value.kind, Kind::Text(_));
                match index {
                    Some(0) if one => {
                        Ok((vec![(value.span, link.to_owned())], link_path(None, steps)))
                    }
                    None | Some(1) if one => {
                        let open = insert(value.span.start, "[".into());
                        let close = insert(value.span.end, format!(", {link}]"));
                        Ok((vec![open, close], link_path(Some(1), steps)))
                    }
                    None | Some(0) => {
                        Ok((vec![(value.span, list_of(link))], link_path(Some(0), steps)))
                    }
                    Some(_) => Err(no_item(value.span, usize::from(one))),
                }
            }
            PathEnd::Value(value) => match index {
                None => Ok((vec![(value.span, link.to_owned())], link_path(None, steps))),
                Some(_) => Err(no_item(value.span, 1)),
            },
            PathEnd::Missing(owner, rest) => {
                if index.is_some_and(|index| index > 0 || !many) {
                    return Err(no_item(owner.span, 0));
                }
                let value = if many { list_of(link) } else { link.to_owned() };
                let value =
                    rest[1..].iter().rev().fold(value, |value, name| format!("({name}: {value})"));
                let splices = add_field(self.text, owner, &rest[0], &value);
                Ok((splices, link_path(many.then_some(0), steps)))
            }
        }
    }

    pub(super) fn unlink(&self, given: &str) -> Result<Vec<Splice>, Vec<EditError>> {
        let (node, call, steps) = self.find_port(given).map_err(to_errors)?;
        let found = find(call, &steps, None).map_err(to_errors)?;
        let value = match found {
            PathEnd::Value(value) => value.call_of("Some").unwrap_or(value),
            PathEnd::Missing(owner, _) => owner,
        };
        let has_links = match (&found, &value.kind) {
            (PathEnd::Missing(..), _) => false,
            (_, Kind::List(items)) => {
                !items.is_empty() && items.iter().all(|item| self.references.is_link(item.span))
            }
            _ => self.references.is_link(value.span),
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
            let error = edit_error(code::UNKNOWN_FIELD, value.span, message, help);
            return Err(to_errors(error));
        }
        let mut gone = Removals::new();
        self.remove_link(&self.ancestors(value.span), value.span, &mut gone).map_err(to_errors)?;
        let errors = self.remove_empty_lists(&mut gone);
        if errors.is_empty() { Ok(self.removal_splices(&gone)) } else { Err(errors) }
    }
}
