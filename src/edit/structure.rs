//! Edits of what a graph is made of: nodes, names, links and outputs.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use maquette_graph::expression::named_parameters;
use maquette_graph::meaning::named_node;
use maquette_graph::place::field;
use maquette_graph::splice::{
    Splice, added, apply, newline, parts, put_entry, reindented, without,
};
use maquette_graph::top::field_of;
use maquette_graph::tree::entries;
use maquette_graph::{Refusal, is_name};
use maquette_syntax::error::{Problem, Span, code};
use maquette_syntax::{Body, Kind, Tree, nearest_or_all, parse, quoted, with_article};

use super::format::entry_form;
use super::references::{Names, Reference, References};
use super::{Edit, Judge};

mod links;

/// The text of a graph, and what stands in it.
pub(super) struct Structure<'j> {
    judge: &'j Judge<'j>,
    text: &'j str,
    tree: Tree,
    references: References,
}

/// The sections whose entries have names that others use, and what each entry is.
const SECTIONS: [(&str, &str); 3] =
    [("nodes", "node"), ("inputs", "input"), ("params", "parameter")];

/// An entry of a section.
struct Declared<'t> {
    section: &'static str,
    /// The section.
    map: &'t Tree,
    /// Which of its entries.
    index: usize,
    key: &'t Tree,
    name: &'t str,
}

/// Parts of values that go, by the values' places.
type Gone<'t> = BTreeMap<Span, (&'t Tree, BTreeSet<usize>)>;

fn refusal(code: &'static str, span: Span, message: String, help: impl Into<String>) -> Refusal {
    Refusal { code, span, message, help: help.into() }
}

impl<'j> Structure<'j> {
    /// # Errors
    /// The problems of the text, if nothing can be said of what is in it.
    pub(super) fn read(judge: &'j Judge<'j>, text: &'j str) -> Result<Self, Vec<Problem>> {
        let (tree, _) = parse(text);
        if tree.name().is_some_and(|name| name.text == "Patch") {
            let span = tree.name().map_or(tree.span, |name| name.span);
            let message = "a patch has values of nodes, but no nodes of its own".to_owned();
            let help = "edit the graph that it is `of`; values of a patch can be set";
            let refused = refusal(code::SYNTAX, span, message, help);
            return Err(vec![judge.refused(text, refused)]);
        }
        let references = References::of(judge, text)?;
        Ok(Self { judge, text, tree, references })
    }

    /// The text after an edit that is no `Set`.
    ///
    /// # Errors
    /// Why it cannot be done.
    pub(super) fn edited(&self, edit: &Edit, values: &[&str]) -> Result<String, Vec<Refusal>> {
        let splices = match edit {
            Edit::Add { name, node, fields, after } => {
                let fields = fields.iter().map(|(name, _)| &name[..]).zip(values.iter().copied());
                self.add(name, node, &Vec::from_iter(fields), after.as_deref()).map_err(one)?
            }
            Edit::Remove { name, and_links } => self.remove(name, *and_links)?,
            Edit::Rename { from, to } => self.rename(from, to).map_err(one)?,
            Edit::Link { port, to } => return self.link(port, to).map_err(one),
            Edit::Unlink { port } => self.unlink(port)?,
            Edit::Output { name, to } => self.output(name, to.as_deref())?,
            Edit::Set { .. } => Vec::new(),
        };
        Ok(apply(self.text, splices))
    }

    fn section(&self, name: &str) -> Option<&Tree> {
        let value = &field(&self.tree, name)?.value;
        matches!(value.kind, Kind::Map(_)).then_some(value)
    }

    /// What `nose`, `nodes.nose` or `params.nose` names.
    fn declared(&self, given: &str) -> Result<Declared<'_>, Refusal> {
        let (wanted, name) = match given.split_once('.') {
            Some((section, name)) => (Some(section), name),
            None => (None, given),
        };
        let mut found = Vec::new();
        let mut known = Vec::new();
        for (section, _) in SECTIONS {
            if wanted.is_some_and(|wanted| wanted != section) {
                continue;
            }
            let Some(map) = self.section(section) else { continue };
            let Kind::Map(entries) = &map.kind else { continue };
            known.extend(entries.iter().filter_map(|(key, _)| key.text()));
            for (index, (key, _)) in entries.iter().enumerate() {
                if let Some(name) = key.text().filter(|known| *known == name) {
                    found.push(Declared { section, map, index, key, name });
                }
            }
        }
        if let [first, second, ..] = &found[..]
            && first.section == second.section
        {
            let message = format!("there is more than one `{name}` in `{}`", first.section);
            return Err(refusal(code::BAD_NAME, second.key.span, message, "keep one of them"));
        }
        if found.len() > 1 {
            let both = found.iter().map(|found| format!("`{}.{name}`", found.section));
            let help = format!("write {}", Vec::from_iter(both).join(" or "));
            let message = format!("both a node and a parameter have the name `{name}`");
            return Err(refusal(code::BAD_NAME, found[1].key.span, message, help));
        }
        found.pop().ok_or_else(|| {
            let what = SECTIONS.iter().find(|(section, _)| Some(*section) == wanted);
            let what = what.map_or("node, input or parameter", |(_, what)| what);
            let message = format!("the graph has no {what} `{name}`");
            let help = nearest_or_all(name, "its names", &known);
            refusal(code::UNKNOWN_LINK, Span::default(), message, help)
        })
    }

    /// The call of a node.
    fn node(&self, name: &str) -> Result<&Tree, Refusal> {
        call_of(&self.tree, name).ok_or_else(|| {
            let nodes = entries(self.tree.fields().unwrap_or_default(), "nodes");
            let known: Vec<_> = nodes.map(|(name, _)| name).collect();
            let message = format!("the graph has no node `{name}`");
            let help = nearest_or_all(name, "its nodes", &known);
            refusal(code::UNKNOWN_LINK, Span::default(), message, help)
        })
    }

    fn add(
        &self,
        name: &str,
        node: &str,
        fields: &[(&str, &str)],
        after: Option<&str>,
    ) -> Result<Vec<Splice>, Refusal> {
        may_name(name, "a node")?;
        let words = fields.iter().map(|(field, _)| (*field, code::UNKNOWN_FIELD, "field"));
        for (word, code, what) in words.chain([(node, code::UNKNOWN_NODE, "node type")]) {
            if !is_word(word) {
                let message = format!("`{word}` cannot be the name of a {what}");
                let written = field_of(word);
                let help = match is_word(&written) {
                    true => format!("a field has `_` where a name has `-`: `{written}`"),
                    false => "letters, digits and `_`, no digit first".to_owned(),
                };
                return Err(refusal(code, Span::default(), message, help));
            }
        }
        let fields = fields.iter().map(|(field, value)| format!("{field}: {value}"));
        let entry = format!("\"{name}\": {node}({})", Vec::from_iter(fields).join(", "));
        let after = after.map(|after| {
            // It must be there.
            self.node(after)?;
            let place = self.declared(&format!("nodes.{after}"))?;
            Ok::<_, Refusal>(place.index)
        });
        let after = after.transpose()?;
        Ok(match self.section("nodes") {
            Some(nodes) => put_entry(self.text, nodes, after, true, |indent| {
                self.written(&entry, indent, nodes.span.end)
            }),
            None => added(self.text, &self.tree, "nodes", &format!("{{ {entry} }}")),
        })
    }

    /// An entry in its canonical form, as it stands behind an indentation; its lines end as the one before a place.
    fn written(&self, entry: &str, indent: &str, at: usize) -> String {
        let columns = indent.chars().count();
        reindented(&entry_form(entry, columns), columns, indent, newline(self.text, at))
    }

    fn rename(&self, from: &str, to: &str) -> Result<Vec<Splice>, Refusal> {
        let Declared { section, key, name, .. } = self.declared(from)?;
        let (_, what) =
            SECTIONS.iter().find(|(known, _)| *known == section).unwrap_or(&SECTIONS[0]);
        may_name(to, &with_article(what))?;
        if name == to {
            return Ok(Vec::new());
        }
        let whole = 0..name.len();
        let mut splices = vec![self.replaced(key.span, name, std::slice::from_ref(&whole), to)];
        for found in &self.references.all {
            let Reference { span, text, .. } = found;
            let places = match found.kind {
                Names::Parameter if section == "params" && text == name => vec![whole.clone()],
                Names::Expression if section == "params" => self.in_expression(found, name, to)?,
                Names::Link if section != "params" && named_node(text) == name => {
                    vec![whole.clone()]
                }
                _ => continue,
            };
            if !places.is_empty() {
                splices.push(self.replaced(*span, text, &places, to));
            }
        }
        Ok(splices)
    }

    /// The names of the parameters.
    fn parameters(&self) -> BTreeSet<&str> {
        match self.section("params").map(|params| &params.kind) {
            Some(Kind::Map(entries)) => entries.iter().filter_map(|(key, _)| key.text()).collect(),
            _ => BTreeSet::new(),
        }
    }

    /// Where an expression names a parameter that gets another name.
    fn in_expression(
        &self,
        expression: &Reference,
        from: &str,
        to: &str,
    ) -> Result<Vec<Range<usize>>, Refusal> {
        let known = self.parameters();
        let text = &expression.text;
        let old = named_parameters(text, &|name| known.contains(name)).unwrap_or_default();
        let mut places = old.clone();
        places.retain(|place| &text[place.clone()] == from);
        let new_text = with_places(text, &places, to);
        let is_known = |name: &str| name == to || (name != from && known.contains(name));
        let new = named_parameters(&new_text, &is_known).unwrap_or_default();
        let in_old = old.iter().map(|place| match &text[place.clone()] {
            name if name == from => to,
            name => name,
        });
        // A hyphen belongs to the new name where it was a sign before.
        if !in_old.eq(new.iter().map(|place| &new_text[place.clone()])) {
            let message = format!("this expression would say something else with the name `{to}`");
            let help = "a hyphen with spaces around it is always a sign";
            return Err(refusal(code::EXPRESSION, expression.span, message, help));
        }
        Ok(places)
    }

    /// A literal that says `text`, with `new` in some places of that.
    fn replaced(&self, span: Span, text: &str, places: &[Range<usize>], new: &str) -> Splice {
        let literal = &self.text[span.start..span.end];
        let Some(start) = literal.find(text) else {
            // It is written with escapes.
            return (span, quoted(&with_places(text, places, new)));
        };
        let places = places.iter().map(|place| place.start + start..place.end + start);
        (span, with_places(literal, &Vec::from_iter(places), new))
    }

    fn remove(&self, given: &str, and_links: bool) -> Result<Vec<Splice>, Vec<Refusal>> {
        let Declared { section, map, index, name, .. } = self.declared(given).map_err(one)?;
        let own = parts(map)[index];
        let parameters = self.parameters();
        fn is_named(expression: &str, parameters: &BTreeSet<&str>, name: &str) -> bool {
            let places = named_parameters(expression, &|word| parameters.contains(word));
            places.into_iter().flatten().any(|place| &expression[place] == name)
        }
        let users: Vec<_> = self
            .references
            .all
            .iter()
            .filter(|found| {
                let is_inside = own.start <= found.span.start && found.span.end <= own.end;
                !is_inside
                    && match found.kind {
                        Names::Link => section != "params" && named_node(&found.text) == name,
                        Names::Parameter => section == "params" && found.text == name,
                        Names::Expression => {
                            section == "params" && is_named(&found.text, &parameters, name)
                        }
                        Names::Output => false,
                    }
            })
            .collect();
        if !users.is_empty() && (!and_links || section == "params") {
            let refused = |user: &&Reference| {
                let message = format!("`{name}` cannot be removed: {} needs it", user.by);
                match section {
                    "params" => {
                        let help = format!("put a value in place of what names `{name}`");
                        refusal(code::EXPRESSION, user.span, message, help)
                    }
                    _ => {
                        let help = "link it to something else, or let links go along that need not be (--and-links)";
                        refusal(code::UNKNOWN_LINK, user.span, message, help)
                    }
                }
            };
            return Err(users.iter().map(refused).collect());
        }
        let mut gone = Gone::from([(map.span, (map, BTreeSet::from([index])))]);
        let mut refusals = Vec::new();
        for user in users {
            if let Err(refused) = self.let_go(user, &mut gone) {
                refusals.push(refused);
            }
        }
        refusals.extend(self.let_lists_go(&mut gone));
        if refusals.is_empty() { Ok(self.spliced(&gone)) } else { Err(refusals) }
    }

    /// Lets what names something go along with it.
    fn let_go<'t>(&'t self, user: &Reference, gone: &mut Gone<'t>) -> Result<(), Refusal> {
        let holders = self.holders(user.span);
        match holders.get(..2) {
            // An expectation goes whole, and a promise.
            Some([(graph, field), (list, item)])
                if graph.fields().is_some_and(|fields| {
                    matches!(&fields[*field].name.text[..], "expect" | "promises")
                }) =>
            {
                take(gone, list, *item);
            }
            Some([(graph, field), (outputs, entry)])
                if graph.fields().is_some_and(|f| f[*field].name.text == "outputs") =>
            {
                take(gone, outputs, *entry);
                let Kind::Map(entries) = &outputs.kind else { return Ok(()) };
                let name = entries[*entry].0.text().unwrap_or_default();
                let named = self.references.all.iter().filter(|found| found.kind == Names::Output);
                for expectation in named.filter(|found| found.text == name) {
                    self.let_go(expectation, gone)?;
                }
            }
            _ => self.let_link_go(&holders, user.span, gone)?,
        }
        Ok(())
    }

    /// Lets a link of a node go, or all links of a port.
    fn let_link_go<'t>(
        &'t self,
        holders: &[(&'t Tree, usize)],
        span: Span,
        gone: &mut Gone<'t>,
    ) -> Result<(), Refusal> {
        let Some(&(holder, index)) = holders.last() else { return Ok(()) };
        if !matches!(holder.kind, Kind::List(_)) {
            self.may_be_empty(holders, span)?;
        }
        take(gone, holder, index);
        Ok(())
    }

    /// Lists of links of which nothing would be left go whole, where the port can do without.
    fn let_lists_go<'t>(&'t self, gone: &mut Gone<'t>) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        let emptied: Vec<_> = gone
            .values()
            .filter(|(list, gone)| match &list.kind {
                Kind::List(items) => items.len() == gone.len(),
                _ => false,
            })
            .map(|(list, _)| *list)
            .collect();
        for list in emptied {
            let holders = self.holders(list.span);
            let Some(&(holder, index)) = holders.last() else { continue };
            match self.may_be_empty(&holders, list.span) {
                Ok(()) => {
                    gone.remove(&list.span);
                    take(gone, holder, index);
                }
                Err(refused) => refusals.push(refused),
            }
        }
        refusals
    }

    /// Refuses to leave the port at the end of a way empty, if it must have a link.
    fn may_be_empty(&self, holders: &[(&Tree, usize)], span: Span) -> Result<(), Refusal> {
        fn needed(
            node: &str,
            port: &str,
            references_ports: &std::collections::HashMap<
                String,
                Vec<maquette_graph::catalog::PortDescription>,
            >,
        ) -> bool {
            let ports = references_ports.get(node).into_iter().flatten();
            ports.into_iter().any(|known| known.name == port && !known.optional)
        }
        let [_, (nodes, entry), (call, field), inner @ ..] = holders else { return Ok(()) };
        let Kind::Map(entries) = &nodes.kind else { return Ok(()) };
        let node = entries[*entry].0.text().unwrap_or_default();
        let kind = call.name().map_or_else(String::new, |kind| kind.text);
        fn name_of(tree: &Tree, index: usize) -> String {
            let field = tree.fields().and_then(|fields| fields.get(index));
            field.map_or_else(String::new, |field| field.name.text.clone())
        }
        let outer = name_of(call, *field);
        let (port, is_needed) = match (&kind[..], inner) {
            ("ForEach", [.., (group, field)]) => {
                let port = name_of(group, *field);
                // What is carried is what its links give.
                let is_needed = outer == "carry" || needed(node, &port, &self.references.ports);
                (port, is_needed)
            }
            ("Switch", [(cases, case)]) => match &cases.kind {
                Kind::Map(entries) => {
                    (entries[*case].0.text().unwrap_or_default().to_owned(), true)
                }
                _ => (outer, true),
            },
            (_, []) => {
                let is_needed = needed(node, &outer, &self.references.ports);
                (outer, is_needed)
            }
            _ => (outer, false),
        };
        if !is_needed {
            return Ok(());
        }
        let message = format!("port `{port}` of `{node}` cannot be left without a link");
        Err(refusal(code::MISSING_FIELD, span, message, "link it to something else"))
    }

    /// The values around a place, from the graph on, and which part of each it lies in; a `Some` around it does not count.
    fn holders(&self, span: Span) -> Vec<(&Tree, usize)> {
        let mut holders = Vec::new();
        let mut tree = &self.tree;
        while tree.span != span {
            let parts = parts(tree);
            let Some(index) =
                parts.iter().position(|part| part.start <= span.start && span.end <= part.end)
            else {
                break;
            };
            holders.push((tree, index));
            tree = part(tree, index);
        }
        fn is_some(tree: &Tree) -> bool {
            tree.call_of("Some").is_some()
        }
        while holders.pop_if(|(tree, _)| is_some(tree)).is_some() {}
        holders
    }

    fn spliced(&self, gone: &Gone<'_>) -> Vec<Splice> {
        gone.values().flat_map(|(tree, gone)| without(self.text, tree, gone)).collect()
    }

    fn output(&self, name: &str, to: Option<&str>) -> Result<Vec<Splice>, Vec<Refusal>> {
        let outputs = self.section("outputs");
        let entries = match outputs.map(|outputs| &outputs.kind) {
            Some(Kind::Map(entries)) => &entries[..],
            _ => &[],
        };
        let index = entries.iter().position(|(key, _)| key.text() == Some(name));
        let Some(to) = to else {
            let (Some(index), Some(outputs)) = (index, outputs) else {
                let known: Vec<_> = entries.iter().filter_map(|(key, _)| key.text()).collect();
                let message = format!("the graph has no output `{name}`");
                let help = nearest_or_all(name, "its outputs", &known);
                return Err(one(refusal(code::UNKNOWN_LINK, Span::default(), message, help)));
            };
            let users = self.references.all.iter().filter(|found| found.kind == Names::Output);
            let refused = users.filter(|found| found.text == name).map(|user| {
                let message = format!("output `{name}` cannot be removed: {} needs it", user.by);
                refusal(code::UNKNOWN_LINK, user.span, message, "let it name the node")
            });
            let refused = Vec::from_iter(refused);
            if !refused.is_empty() {
                return Err(refused);
            }
            return Ok(without(self.text, outputs, &BTreeSet::from([index])));
        };
        if let Some(index) = index {
            return Ok(vec![(entries[index].1.span, quoted(to))]);
        }
        let entry = format!("{}: {}", quoted(name), quoted(to));
        Ok(match outputs {
            Some(outputs) => put_entry(self.text, outputs, None, false, |_| entry.clone()),
            None => added(self.text, &self.tree, "outputs", &format!("{{ {entry} }}")),
        })
    }
}

fn one(refusal: Refusal) -> Vec<Refusal> {
    vec![refusal]
}

/// The call of a node.
fn call_of<'t>(tree: &'t Tree, node: &str) -> Option<&'t Tree> {
    let mut nodes = entries(tree.fields()?, "nodes");
    nodes.find(|(name, _)| *name == node).map(|(_, call)| call)
}

/// A part of a value, by its place among the parts.
fn part(tree: &Tree, index: usize) -> &Tree {
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => &items[index],
        Kind::Call { body: Body::Fields(fields), .. } => &fields[index].value,
        Kind::Map(entries) => &entries[index].1,
        _ => tree,
    }
}

fn take<'t>(gone: &mut Gone<'t>, tree: &'t Tree, index: usize) {
    gone.entry(tree.span).or_insert_with(|| (tree, BTreeSet::new())).1.insert(index);
}

/// A text with `new` in some places.
fn with_places(text: &str, places: &[Range<usize>], new: &str) -> String {
    let mut result = text.to_owned();
    for place in places.iter().rev() {
        result.replace_range(place.clone(), new);
    }
    result
}

/// Refuses what cannot name something.
pub(crate) fn may_name(name: &str, what: &str) -> Result<(), Refusal> {
    if is_name(name) {
        return Ok(());
    }
    let message = format!("`{name}` cannot name {what}");
    let help =
        "names begin with a lower-case letter; lower-case letters, digits and hyphens follow";
    Err(refusal(code::BAD_NAME, Span::default(), message, help))
}

/// Whether it can stand before a parenthesis or a colon.
fn is_word(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
