//! A `ForEach` over data or over a number. The number of elements is unknown when the file is read, so one parsed node represents all
//! elements.
//!
//! The elements are checked as one node, which takes its data from a second parsed node. Later [`super::expand`] creates one node per
//! element or, if the number is still unknown, one example node.

use maquette_syntax::error::code;
use maquette_syntax::{Body, Field, Kind, Name, Tree, nearest_or_all};

use super::check::Check;
use super::definition::UsedGraph;
use super::for_each::{ForEachFields, ForEachSource, number_field};
use super::header::name_of;
use super::parameters::Parameters;
use super::parsed_node::link_of;
use crate::catalog::PortDescription;
use crate::definition::{ElementCount, Elements, NodeKind, ParsedNode, Pick, Repeat};

/// The maximum number of elements of a `ForEach` that does not set the field `most`.
pub(super) const DEFAULT_MAX_ELEMENTS: usize = 10_000;

impl Check<'_, '_> {
    /// Parses a `ForEach` whose number of elements is not yet known. Appends one parsed node for all elements, and one for the data that
    /// are split into elements.
    pub(super) fn parse_repeat(
        &mut self,
        name: Name,
        value: &Tree,
        repeated: ForEachFields,
        subgraphs: &[UsedGraph],
        defaults: &Parameters,
        parsed_nodes: &mut Vec<ParsedNode>,
    ) {
        let call = repeated.example(value.span);
        let what = self.node_kind(&call, &name, subgraphs);
        let mut parsed = ParsedNode::new(name, call, what);
        if matches!(parsed.what, NodeKind::Unknown(_)) {
            parsed_nodes.push(parsed);
            return;
        }
        let mut added: Vec<_> =
            repeated.number.as_ref().map(|name| number_field(name, 1)).into_iter().collect();
        let mut elements = None;
        let count = match &repeated.over {
            ForEachSource::Data(link, word) => {
                let Some(port) = self.data_input(&parsed, &repeated, link) else {
                    parsed.what = NodeKind::Unknown(None);
                    parsed_nodes.push(parsed);
                    return;
                };
                let each = parsed.name.text.clone();
                // The name of an input has hyphens where the corresponding field has underscores.
                let input = match parsed.what {
                    NodeKind::Use(..) => name_of(&port.text),
                    _ => port.text.clone(),
                };
                let text = format!("{each}/{input}");
                let tree = Tree::new(link.span, Kind::Text(text.clone()));
                added.push(Field { name: port.clone(), value: tree });
                let (word, most) = (word.clone(), repeated.max_elements.clone());
                let data = NodeKind::Elements(Elements { word, each, max_elements: most });
                let name = Name { text, span: parsed.name.span };
                let links = vec![link_of(link, "over", false)];
                elements = Some(ParsedNode::with_links(name, value.clone(), data, links));
                ElementCount::Data(parsed_nodes.len() + 1, port.text)
            }
            ForEachSource::Count(number) => ElementCount::Number(number.clone()),
            ForEachSource::List(_) => return,
        };
        if let Kind::Call { body: Body::Fields(fields), .. } = &mut parsed.tree.kind {
            fields.extend(added);
        }
        self.check_node_fields(&mut parsed, defaults);
        let carry = repeated.carried_outputs();
        let ForEachFields { number, max_elements: most, .. } = repeated;
        let repeat = Repeat { count, number, carry, max_elements: most };
        self.element_count(&repeat, defaults);
        parsed.repeat = Some(repeat);
        parsed_nodes.push(parsed);
        parsed_nodes.extend(elements);
    }

    /// Reports inputs in `carry` that do not exist in the repeated node type. Returns false if there are any.
    pub(super) fn check_carry(
        &mut self,
        name: &Name,
        value: &Tree,
        repeated: &ForEachFields,
        subgraphs: &[UsedGraph],
    ) -> bool {
        let known = self.diagnostics.len();
        let what = self.node_kind(&repeated.example(value.span), name, subgraphs);
        // Errors of the node type are reported when the elements are parsed, so drop them here.
        self.diagnostics.truncate(known);
        if matches!(what, NodeKind::Unknown(_)) {
            return true;
        }
        let ports: Vec<_> = what.ports().into_iter().map(|port| port.name).collect();
        fn is_input(field: &&Field, ports: &[String]) -> bool {
            ports.contains(&field.name.text)
        }
        for Field { name, .. } in repeated.carry.iter().filter(|field| !is_input(field, &ports)) {
            let message = format!("{} has no input `{}` to carry", what.kind(), name.text);
            let known: Vec<_> = ports.iter().map(String::as_str).collect();
            let help = self.guess(|| nearest_or_all(&name.text, "its inputs", &known));
            self.report(code::UNKNOWN_FIELD, name.span, message, help);
        }
        self.diagnostics.len() == known
    }

    /// Returns the input that receives one element of the data: the one that the file names, or else the only required input without a
    /// link.
    fn data_input(
        &mut self,
        parsed: &ParsedNode,
        repeated: &ForEachFields,
        link: &Tree,
    ) -> Option<Name> {
        let kind = parsed.what.kind();
        let fields = parsed.tree.fields().unwrap_or_default();
        fn is_given(port: &&PortDescription, fields: &[Field]) -> bool {
            fields.iter().any(|it| it.name.text == port.name)
        }
        let ports = parsed.what.ports();
        if let Some(each) = &repeated.each {
            if let Some(port) = ports.iter().find(|port| port.name == each.text) {
                if is_given(&port, fields) {
                    let message = format!("input `{}` takes the data, but has a link", each.text);
                    self.report(code::BAD_NAME, each.span, message, "keep one of them");
                    return None;
                }
                return Some(each.clone());
            }
            let message = format!("{kind} has no input `{}`", each.text);
            let known: Vec<_> = ports.iter().map(|port| &port.name[..]).collect();
            let help = self.guess(|| nearest_or_all(&each.text, "its inputs", &known));
            self.report(code::UNKNOWN_FIELD, each.span, message, help);
            return None;
        }
        let free: Vec<_> =
            ports.iter().filter(|port| !port.optional && !is_given(port, fields)).collect();
        match free[..] {
            [port] => Some(Name { text: port.name.clone(), span: link.span }),
            [] => {
                let message = format!("no input of {kind} is free for the data");
                let known: Vec<_> = ports.iter().filter(|port| !is_given(port, fields)).collect();
                let known: Vec<_> = known.iter().map(|port| &port.name[..]).collect();
                let help = match known[..] {
                    [] => "leave out the link of the one that takes them".to_owned(),
                    [first, ..] => format!("name the one that takes them: `each: \"{first}\"`"),
                };
                self.report(code::MISSING_FIELD, link.span, message, help);
                None
            }
            [first, ..] => {
                let names = free.iter().map(|port| format!("`{}`", port.name));
                let names = Vec::from_iter(names).join(" and ");
                let message = format!(
                    "{names} of {kind} have no link, so the input for the data is ambiguous"
                );
                let help = format!("name it, as in `each: \"{}\"`, and link the rest", first.name);
                self.report(code::MISSING_FIELD, link.span, message, help);
                None
            }
        }
    }

    /// Evaluates the number of elements. `None` if the number depends on data or has an error.
    pub(super) fn element_count(&mut self, repeat: &Repeat, values: &Parameters) -> Option<usize> {
        let most = self.max_elements(repeat.max_elements.as_ref(), values)?;
        let ElementCount::Number(tree) = &repeat.count else { return None };
        let count = values.substitute(tree, &mut self.diagnostics);
        let count = read_count(&count)
            .map_err(|found| self.report_no_number("over", &count, &found))
            .ok()?;
        if most < count {
            let message = format!("ForEach has {count} elements, but takes {most} at most");
            let help = format!("`most: {count}` allows them");
            self.report(code::OUT_OF_RANGE, tree.span, message, help);
            return None;
        }
        Some(count)
    }

    /// Evaluates the maximum number of elements of a `ForEach`.
    pub(super) fn max_elements(
        &mut self,
        most: Option<&Tree>,
        values: &Parameters,
    ) -> Option<usize> {
        let Some(most) = most else { return Some(DEFAULT_MAX_ELEMENTS) };
        let most = values.substitute(most, &mut self.diagnostics);
        read_count(&most).map_err(|found| self.report_no_number("most", &most, &found)).ok()
    }

    fn report_no_number(&mut self, field: &str, tree: &Tree, found: &str) {
        if !tree.is_broken() {
            let message =
                format!("field `{field}` of ForEach: expected a number of elements, found {found}");
            self.report(code::WRONG_VALUE, tree.span, message, "write 0, 1, 2, ..");
        }
    }

    /// Appends a parsed node for each link to a single element by its number, such as `spots/2`.
    pub(super) fn add_picks(&self, parsed_nodes: &mut Vec<ParsedNode>, texts: &[&Tree]) {
        if parsed_nodes.iter().all(|parsed| parsed.repeat.is_none()) {
            return;
        }
        let of_nodes = parsed_nodes.iter().flat_map(|parsed| &parsed.links);
        let of_nodes = of_nodes.map(|link| (link.text.clone(), link.span));
        let others = texts.iter().flat_map(|tree| texts_in(tree));
        let others = others.map(|tree| (tree.text().unwrap_or_default().to_owned(), tree.span));
        for (text, span) in of_nodes.chain(others).collect::<Vec<_>>() {
            let text = text.split('.').next().unwrap_or_default();
            let Some((each, number)) = text.split_once('/') else { continue };
            let Ok(number) = number.parse::<usize>() else { continue };
            let Some(of) = parsed_nodes
                .iter()
                .position(|parsed| parsed.name.text == each && parsed.repeat.is_some())
            else {
                continue;
            };
            if parsed_nodes.iter().any(|parsed| parsed.name.text == text) {
                continue;
            }
            let parsed = &parsed_nodes[of];
            let outputs = parsed.what.outputs().into_iter().map(str::to_owned).collect();
            let kind = parsed.what.kind().to_owned();
            let link = Tree::new(span, Kind::Text(each.to_owned()));
            let pick = NodeKind::Pick(Pick { of, number, kind, outputs });
            let name = Name { text: text.to_owned(), span };
            let links = vec![link_of(&link, "element", true)];
            parsed_nodes.push(ParsedNode::with_links(name, link, pick, links));
        }
    }
}

/// Returns the number of elements that a value states. If it is not a valid number, returns a description of the value as the error.
fn read_count(tree: &Tree) -> Result<usize, String> {
    // Integers above this limit are not represented exactly by `f64`.
    const MAX_COUNT: f64 = (1_u64 << 53) as f64;
    match tree.kind {
        Kind::Number { value, .. } if MAX_COUNT < value => Err(format!("as many as {value:e}")),
        Kind::Number { value, .. } if value >= 0.0 && value.fract() == 0.0 => Ok(value as usize),
        _ => Err(tree.describe()),
    }
}

fn texts_in(tree: &Tree) -> Vec<&Tree> {
    match &tree.kind {
        Kind::Text(_) => vec![tree],
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            items.iter().flat_map(texts_in).collect()
        }
        Kind::Map(entries) => entries.iter().flat_map(|(_, value)| texts_in(value)).collect(),
        Kind::Call { body: Body::Fields(fields), .. } => {
            fields.iter().flat_map(|field| texts_in(&field.value)).collect()
        }
        _ => Vec::new(),
    }
}
