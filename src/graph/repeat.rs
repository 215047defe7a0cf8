//! `ForEach` over data or a number: how many elements there are is known late, so one draft stands for all.
//!
//! It is checked as one node, whose data come from a draft of their own. [`super::expand`] makes as many nodes of it as are known,
//! or one example.

use maquette_syntax::error::code;
use maquette_syntax::{Body, Field, Kind, Name, Tree, nearest_or_all};

use super::check::Check;
use super::definition::Used;
use super::draft::link_of;
use super::each::{Over, Repeated, numbered};
use super::parameters::Parameters;
use super::top::name_of;
use crate::catalog::PortDescription;
use crate::definition::{Counted, Draft, Elements, Pick, Repeat, What};

/// A `ForEach` has no more elements than this, unless it says so.
pub(super) const MOST: usize = 10_000;

impl Check<'_, '_> {
    /// The draft of a `ForEach` whose number of elements is known late: one element stands for all. Before it comes that of the
    /// data.
    pub(super) fn repeat(
        &mut self,
        name: Name,
        value: &Tree,
        repeated: Repeated,
        subgraphs: &[Used],
        defaults: &Parameters,
        drafts: &mut Vec<Draft>,
    ) {
        let call = repeated.example(value.span);
        let what = self.what(&call, &name, subgraphs);
        let mut draft = Draft::new(name, call, what);
        if matches!(draft.what, What::Unknown(_)) {
            drafts.push(draft);
            return;
        }
        let mut added: Vec<_> =
            repeated.number.as_ref().map(|name| numbered(name, 1)).into_iter().collect();
        let mut elements = None;
        let count = match &repeated.over {
            Over::Data(link, word) => {
                let Some(port) = self.taker(&draft, &repeated, link) else {
                    draft.what = What::Unknown(None);
                    drafts.push(draft);
                    return;
                };
                let each = draft.name.text.clone();
                // An input has its own name, also in hyphens.
                let input = match draft.what {
                    What::Use(..) => name_of(&port.text),
                    _ => port.text.clone(),
                };
                let text = format!("{each}/{input}");
                let tree = Tree::new(link.span, Kind::Text(text.clone()));
                added.push(Field { name: port.clone(), value: tree });
                let (word, most) = (word.clone(), repeated.most.clone());
                let data = What::Elements(Elements { word, each, most });
                let name = Name { text, span: draft.name.span };
                let links = vec![link_of(link, "over", false)];
                elements = Some(Draft::linked(name, value.clone(), data, links));
                Counted::Data(drafts.len() + 1, port.text)
            }
            Over::Count(number) => Counted::Number(number.clone()),
            Over::List(_) => return,
        };
        if let Kind::Call { body: Body::Fields(fields), .. } = &mut draft.tree.kind {
            fields.extend(added);
        }
        self.look(&mut draft, defaults);
        let carry = repeated.carried();
        let Repeated { number, most, .. } = repeated;
        let repeat = Repeat { count, number, carry, most };
        self.how_many(&repeat, defaults);
        draft.repeat = Some(repeat);
        drafts.push(draft);
        drafts.extend(elements);
    }

    /// Whether the nodes of a `ForEach` have the inputs that are carried; else nothing more is said of them.
    pub(super) fn carries(
        &mut self,
        name: &Name,
        value: &Tree,
        repeated: &Repeated,
        subgraphs: &[Used],
    ) -> bool {
        let known = self.findings.len();
        let what = self.what(&repeated.example(value.span), name, subgraphs);
        // What is wrong with the type is said of the elements.
        self.findings.truncate(known);
        if matches!(what, What::Unknown(_)) {
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
            self.find(code::UNKNOWN_FIELD, name.span, message, help);
        }
        self.findings.len() == known
    }

    /// The input that takes an element of data: the one that is named, else the only one that must have a link and has none.
    fn taker(&mut self, draft: &Draft, repeated: &Repeated, link: &Tree) -> Option<Name> {
        let kind = draft.what.kind();
        let fields = draft.tree.fields().unwrap_or_default();
        fn is_given(port: &&PortDescription, fields: &[Field]) -> bool {
            fields.iter().any(|it| it.name.text == port.name)
        }
        let ports = draft.what.ports();
        if let Some(each) = &repeated.each {
            if let Some(port) = ports.iter().find(|port| port.name == each.text) {
                if is_given(&port, fields) {
                    let message = format!("input `{}` takes the data, but has a link", each.text);
                    self.find(code::BAD_NAME, each.span, message, "keep one of them");
                    return None;
                }
                return Some(each.clone());
            }
            let message = format!("{kind} has no input `{}`", each.text);
            let known: Vec<_> = ports.iter().map(|port| &port.name[..]).collect();
            let help = self.guess(|| nearest_or_all(&each.text, "its inputs", &known));
            self.find(code::UNKNOWN_FIELD, each.span, message, help);
            return None;
        }
        let free: Vec<_> =
            ports.iter().filter(|port| !port.optional && !is_given(port, fields)).collect();
        match free[..] {
            [port] => Some(Name { text: port.name.clone(), span: link.span }),
            [] => {
                let message = format!("no input of {kind} is left for the data");
                let known: Vec<_> = ports.iter().filter(|port| !is_given(port, fields)).collect();
                let known: Vec<_> = known.iter().map(|port| &port.name[..]).collect();
                let help = match known[..] {
                    [] => "leave out the link of the one that takes them".to_owned(),
                    [first, ..] => format!("name the one that takes them: `each: \"{first}\"`"),
                };
                self.find(code::MISSING_FIELD, link.span, message, help);
                None
            }
            [first, ..] => {
                let names = free.iter().map(|port| format!("`{}`", port.name));
                let names = Vec::from_iter(names).join(" and ");
                let message = format!("{names} of {kind} have no link: which takes the data?");
                let help = format!("name it, as in `each: \"{}\"`, and link the rest", first.name);
                self.find(code::MISSING_FIELD, link.span, message, help);
                None
            }
        }
    }

    /// How many elements there are with these values, if a number says it.
    pub(super) fn how_many(&mut self, repeat: &Repeat, values: &Parameters) -> Option<usize> {
        let most = self.most(repeat.most.as_ref(), values)?;
        let Counted::Number(tree) = &repeat.count else { return None };
        let count = values.substitute(tree, &mut self.findings);
        let count = whole(&count).map_err(|found| self.no_number("over", &count, &found)).ok()?;
        if most < count {
            let message = format!("ForEach has {count} elements, but takes {most} at most");
            let help = format!("`most: {count}` lets it have them");
            self.find(code::OUT_OF_RANGE, tree.span, message, help);
            return None;
        }
        Some(count)
    }

    /// The most elements that a `ForEach` may have.
    pub(super) fn most(&mut self, most: Option<&Tree>, values: &Parameters) -> Option<usize> {
        let Some(most) = most else { return Some(MOST) };
        let most = values.substitute(most, &mut self.findings);
        whole(&most).map_err(|found| self.no_number("most", &most, &found)).ok()
    }

    fn no_number(&mut self, field: &str, tree: &Tree, found: &str) {
        if !tree.is_broken() {
            let message =
                format!("field `{field}` of ForEach wants a number of elements, not {found}");
            self.find(code::WRONG_VALUE, tree.span, message, "write 0, 1, 2, ..");
        }
    }

    /// Drafts of the elements that links name by number: `spots/2`. That of a link comes behind all others.
    pub(super) fn picks(&self, drafts: &mut Vec<Draft>, texts: &[&Tree]) {
        if drafts.iter().all(|draft| draft.repeat.is_none()) {
            return;
        }
        let of_nodes = drafts.iter().flat_map(|draft| &draft.links);
        let of_nodes = of_nodes.map(|link| (link.text.clone(), link.span));
        let others = texts.iter().flat_map(|tree| texts_in(tree));
        let others = others.map(|tree| (tree.text().unwrap_or_default().to_owned(), tree.span));
        for (text, span) in of_nodes.chain(others).collect::<Vec<_>>() {
            let text = text.split('.').next().unwrap_or_default();
            let Some((each, number)) = text.split_once('/') else { continue };
            let Ok(number) = number.parse::<usize>() else { continue };
            let Some(of) =
                drafts.iter().position(|draft| draft.name.text == each && draft.repeat.is_some())
            else {
                continue;
            };
            if drafts.iter().any(|draft| draft.name.text == text) {
                continue;
            }
            let draft = &drafts[of];
            let outputs = draft.what.outputs().into_iter().map(str::to_owned).collect();
            let kind = draft.what.kind().to_owned();
            let link = Tree::new(span, Kind::Text(each.to_owned()));
            let pick = What::Pick(Pick { of, number, kind, outputs });
            let name = Name { text: text.to_owned(), span };
            let links = vec![link_of(&link, "element", true)];
            drafts.push(Draft::linked(name, link, pick, links));
        }
    }
}

/// A whole number of elements; in words what it is instead.
fn whole(tree: &Tree) -> Result<usize, String> {
    // Beyond, not every number can be told from its neighbors.
    const MOST: f64 = (1_u64 << 53) as f64;
    match tree.kind {
        Kind::Number { value, .. } if MOST < value => Err(format!("as many as {value:e}")),
        Kind::Number { value, .. } if value >= 0.0 && value.fract() == 0.0 => Ok(value as usize),
        _ => Err(tree.in_words()),
    }
}

/// All texts in a tree.
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
