//! Edits of the structure of a graph: nodes, names, links and outputs.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use maquette_graph::canonical::node_of_link;
use maquette_graph::expression::named_parameters;
use maquette_graph::header::field_of;
use maquette_graph::place::field;
use maquette_graph::splice::{
    Splice, add_field, apply, newline, parts, put_entry, reindent, remove_parts,
};
use maquette_graph::tree::entries;
use maquette_graph::{EditError, is_name};
use maquette_syntax::error::{Diagnostic, Span, code};
use maquette_syntax::{Body, Kind, Tree, nearest_or_all, parse, quote, with_article};

use super::format::format_entry;
use super::references::{Reference, ReferenceKind, References};
use super::{Edit, Editor};

mod links;

/// The text of a graph, parsed for edits of its structure.
pub(super) struct Structure<'j> {
    editor: &'j Editor<'j>,
    text: &'j str,
    tree: Tree,
    references: References,
}

/// The sections of a graph file whose entries have names to which other parts can refer. Each section is paired with the word for one of
/// its entries.
const SECTIONS: [(&str, &str); 3] =
    [("nodes", "node"), ("inputs", "input"), ("params", "parameter")];

/// An entry of a section of a graph file.
struct NamedEntry<'t> {
    section: &'static str,
    /// The value of the section, which is a map.
    map: &'t Tree,
    /// The index of the entry in the section.
    index: usize,
    key: &'t Tree,
    name: &'t str,
}

/// Parts to be removed: for each value, by its span, the value and the indices of its parts.
type Removals<'t> = BTreeMap<Span, (&'t Tree, BTreeSet<usize>)>;

fn edit_error(
    code: &'static str,
    span: Span,
    message: String,
    help: impl Into<String>,
) -> EditError {
    EditError { code, span, message, help: help.into() }
}

impl<'j> Structure<'j> {
    /// Parses the text of a graph for editing.
    ///
    /// # Errors
    /// The text is a patch or cannot be parsed.
    pub(super) fn read(editor: &'j Editor<'j>, text: &'j str) -> Result<Self, Vec<Diagnostic>> {
        let (tree, _) = parse(text);
        if tree.name().is_some_and(|name| name.text == "Patch") {
            let span = tree.name().map_or(tree.span, |name| name.span);
            let message = "a patch has values of nodes, but no nodes of its own".to_owned();
            let help = "edit the graph that it is `of`; values of a patch can be set";
            let error = edit_error(code::SYNTAX, span, message, help);
            return Err(vec![editor.diagnostic(text, error)]);
        }
        let references = References::read(editor, text)?;
        Ok(Self { editor, text, tree, references })
    }

    /// Returns the text after an edit of any kind except `Set`.
    ///
    /// # Errors
    /// The edit is not possible.
    pub(super) fn apply(&self, edit: &Edit, values: &[&str]) -> Result<String, Vec<EditError>> {
        let splices = match edit {
            Edit::Add { name, node, fields, after } => {
                let fields = fields.iter().map(|(name, _)| &name[..]).zip(values.iter().copied());
                self.add(name, node, &Vec::from_iter(fields), after.as_deref())
                    .map_err(to_errors)?
            }
            Edit::Remove { name, and_links } => self.remove(name, *and_links)?,
            Edit::Rename { from, to } => self.rename(from, to).map_err(to_errors)?,
            Edit::Link { port, to } => return self.link(port, to).map_err(to_errors),
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

    /// Finds an entry by its name, such as `nose`, which may begin with its section: `nodes.nose` or `params.nose`.
    fn find_entry(&self, given: &str) -> Result<NamedEntry<'_>, EditError> {
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
                    found.push(NamedEntry { section, map, index, key, name });
                }
            }
        }
        if let [first, second, ..] = &found[..]
            && first.section == second.section
        {
            let message = format!("there is more than one `{name}` in `{}`", first.section);
            return Err(edit_error(code::BAD_NAME, second.key.span, message, "keep one of them"));
        }
        if found.len() > 1 {
            let both = found.iter().map(|found| format!("`{}.{name}`", found.section));
            let help = format!("write {}", Vec::from_iter(both).join(" or "));
            let message = format!("both a node and a parameter have the name `{name}`");
            return Err(edit_error(code::BAD_NAME, found[1].key.span, message, help));
        }
        found.pop().ok_or_else(|| {
            let what = SECTIONS.iter().find(|(section, _)| Some(*section) == wanted);
            let what = what.map_or("node, input or parameter", |(_, what)| what);
            let message = format!("the graph has no {what} `{name}`");
            let help = nearest_or_all(name, "its names", &known);
            edit_error(code::UNKNOWN_LINK, Span::default(), message, help)
        })
    }

    /// Returns the call of the node `name`, or an error if there is no such node.
    fn node(&self, name: &str) -> Result<&Tree, EditError> {
        call_of(&self.tree, name).ok_or_else(|| {
            let nodes = entries(self.tree.fields().unwrap_or_default(), "nodes");
            let known: Vec<_> = nodes.map(|(name, _)| name).collect();
            let message = format!("the graph has no node `{name}`");
            let help = nearest_or_all(name, "its nodes", &known);
            edit_error(code::UNKNOWN_LINK, Span::default(), message, help)
        })
    }

    fn add(
        &self,
        name: &str,
        node: &str,
        fields: &[(&str, &str)],
        after: Option<&str>,
    ) -> Result<Vec<Splice>, EditError> {
        check_name(name, "a node")?;
        let words = fields.iter().map(|(field, _)| (*field, code::UNKNOWN_FIELD, "field"));
        for (word, code, what) in words.chain([(node, code::UNKNOWN_NODE, "node type")]) {
            if !is_field_name(word) {
                let message = format!("`{word}` cannot be the name of a {what}");
                let written = field_of(word);
                let help = match is_field_name(&written) {
                    true => format!("a field has `_` where a name has `-`: `{written}`"),
                    false => "letters, digits and `_`, no digit first".to_owned(),
                };
                return Err(edit_error(code, Span::default(), message, help));
            }
        }
        let fields = fields.iter().map(|(field, value)| format!("{field}: {value}"));
        let entry = format!("\"{name}\": {node}({})", Vec::from_iter(fields).join(", "));
        let after = after.map(|after| {
            // Report an error if the node of this name does not exist.
            self.node(after)?;
            let place = self.find_entry(&format!("nodes.{after}"))?;
            Ok::<_, EditError>(place.index)
        });
        let after = after.transpose()?;
        Ok(match self.section("nodes") {
            Some(nodes) => put_entry(self.text, nodes, after, true, |indent| {
                self.entry_text(&entry, indent, nodes.span.end)
            }),
            None => add_field(self.text, &self.tree, "nodes", &format!("{{ {entry} }}")),
        })
    }

    /// Formats an entry at a given indentation. Uses the line ending before the byte offset `at`.
    fn entry_text(&self, entry: &str, indent: &str, at: usize) -> String {
        let columns = indent.chars().count();
        reindent(&format_entry(entry, columns), columns, indent, newline(self.text, at))
    }

    fn rename(&self, from: &str, to: &str) -> Result<Vec<Splice>, EditError> {
        let NamedEntry { section, key, name, .. } = self.find_entry(from)?;
        let (_, what) =
            SECTIONS.iter().find(|(known, _)| *known == section).unwrap_or(&SECTIONS[0]);
        check_name(to, &with_article(what))?;
        if name == to {
            return Ok(Vec::new());
        }
        let whole = 0..name.len();
        let mut splices =
            vec![self.literal_splice(key.span, name, std::slice::from_ref(&whole), to)];
        for found in &self.references.all {
            let Reference { span, text, .. } = found;
            let places = match found.kind {
                ReferenceKind::Parameter if section == "params" && text == name => {
                    vec![whole.clone()]
                }
                ReferenceKind::Expression if section == "params" => {
                    self.renamed_ranges(found, name, to)?
                }
                ReferenceKind::Link if section != "params" && node_of_link(text) == name => {
                    vec![whole.clone()]
                }
                _ => continue,
            };
            if !places.is_empty() {
                splices.push(self.literal_splice(*span, text, &places, to));
            }
        }
        Ok(splices)
    }

    /// Returns the names of the graph's parameters.
    fn parameters(&self) -> BTreeSet<&str> {
        match self.section("params").map(|params| &params.kind) {
            Some(Kind::Map(entries)) => entries.iter().filter_map(|(key, _)| key.text()).collect(),
            _ => BTreeSet::new(),
        }
    }

    /// Returns the byte ranges at which an expression contains the parameter to be renamed.
    ///
    /// # Errors
    /// With the new name, the expression would change its meaning.
    fn renamed_ranges(
        &self,
        expression: &Reference,
        from: &str,
        to: &str,
    ) -> Result<Vec<Range<usize>>, EditError> {
        let known = self.parameters();
        let text = &expression.text;
        let old = named_parameters(text, &|name| known.contains(name)).unwrap_or_default();
        let mut places = old.clone();
        places.retain(|place| &text[place.clone()] == from);
        let new_text = replace_ranges(text, &places, to);
        let new = named_parameters(&new_text, &|name| {
            name == to || (name != from && known.contains(name))
        });
        let new = new.unwrap_or_default();
        let in_old = old.iter().map(|place| match &text[place.clone()] {
            name if name == from => to,
            name => name,
        });
        // Next to a minus sign, the new name could be read as part of a longer name with a hyphen.
        if !in_old.eq(new.iter().map(|place| &new_text[place.clone()])) {
            let message = format!("this expression would change its meaning with the name `{to}`");
            let help = "put spaces around a minus sign";
            return Err(edit_error(code::EXPRESSION, expression.span, message, help));
        }
        Ok(places)
    }

    /// Returns the edit that replaces byte ranges in the text of a literal by `new`.
    fn literal_splice(&self, span: Span, text: &str, places: &[Range<usize>], new: &str) -> Splice {
        let literal = &self.text[span.start..span.end];
        let Some(start) = literal.find(text) else {
            // The literal contains escapes, so the ranges do not fit the file. Replace the whole literal.
            return (span, quote(&replace_ranges(text, places, new)));
        };
        let places = places.iter().map(|place| place.start + start..place.end + start);
        (span, replace_ranges(literal, &Vec::from_iter(places), new))
    }

    fn remove(&self, given: &str, and_links: bool) -> Result<Vec<Splice>, Vec<EditError>> {
        let NamedEntry { section, map, index, name, .. } =
            self.find_entry(given).map_err(to_errors)?;
        let own = parts(map)[index];
        let parameters = self.parameters();
        let users: Vec<_> = self
            .references
            .all
            .iter()
            .filter(|found| {
                let is_inside = own.start <= found.span.start && found.span.end <= own.end;
                !is_inside
                    && match found.kind {
                        ReferenceKind::Link => {
                            section != "params" && node_of_link(&found.text) == name
                        }
                        ReferenceKind::Parameter => section == "params" && found.text == name,
                        ReferenceKind::Expression => {
                            section == "params" && is_named(&found.text, &parameters, name)
                        }
                        ReferenceKind::Output => false,
                    }
            })
            .collect();
        if !users.is_empty() && (!and_links || section == "params") {
            return Err(users.iter().map(|user| still_needed(section, name, user)).collect());
        }
        let mut gone = Removals::from([(map.span, (map, BTreeSet::from([index])))]);
        let mut errors = Vec::new();
        for user in users {
            if let Err(error) = self.remove_reference(user, &mut gone) {
                errors.push(error);
            }
        }
        errors.extend(self.remove_empty_lists(&mut gone));
        if errors.is_empty() { Ok(self.removal_splices(&gone)) } else { Err(errors) }
    }

    /// Marks a reference to a removed part for removal.
    fn remove_reference<'t>(
        &'t self,
        user: &Reference,
        gone: &mut Removals<'t>,
    ) -> Result<(), EditError> {
        let holders = self.ancestors(user.span);
        match holders.get(..2) {
            // Expectations and promises can only be removed as a whole.
            Some([(graph, field), (list, item)])
                if graph.fields().is_some_and(|fields| {
                    matches!(&fields[*field].name.text[..], "expect" | "promises")
                }) =>
            {
                mark_removed(gone, list, *item);
            }
            Some([(graph, field), (outputs, entry)])
                if graph.fields().is_some_and(|f| f[*field].name.text == "outputs") =>
            {
                mark_removed(gone, outputs, *entry);
                let Kind::Map(entries) = &outputs.kind else { return Ok(()) };
                let name = entries[*entry].0.text().unwrap_or_default();
                let named =
                    self.references.all.iter().filter(|found| found.kind == ReferenceKind::Output);
                for expectation in named.filter(|found| found.text == name) {
                    self.remove_reference(expectation, gone)?;
                }
            }
            _ => self.remove_link(&holders, user.span, gone)?,
        }
        Ok(())
    }

    /// Marks a link of a node for removal: an item of a list of links, or the whole field of a port.
    fn remove_link<'t>(
        &'t self,
        holders: &[(&'t Tree, usize)],
        span: Span,
        gone: &mut Removals<'t>,
    ) -> Result<(), EditError> {
        let Some(&(holder, index)) = holders.last() else { return Ok(()) };
        if !matches!(holder.kind, Kind::List(_)) {
            self.check_not_required(holders, span)?;
        }
        mark_removed(gone, holder, index);
        Ok(())
    }

    /// If all links of a list are marked for removal, marks the field that contains the list instead. Returns an error for each of these
    /// lists whose port requires at least one link.
    fn remove_empty_lists<'t>(&'t self, gone: &mut Removals<'t>) -> Vec<EditError> {
        let mut errors = Vec::new();
        let empty_lists: Vec<_> = gone
            .values()
            .filter(|(list, gone)| match &list.kind {
                Kind::List(items) => items.len() == gone.len(),
                _ => false,
            })
            .map(|(list, _)| *list)
            .collect();
        for list in empty_lists {
            let holders = self.ancestors(list.span);
            let Some(&(holder, index)) = holders.last() else { continue };
            match self.check_not_required(&holders, list.span) {
                Ok(()) => {
                    gone.remove(&list.span);
                    mark_removed(gone, holder, index);
                }
                Err(error) => errors.push(error),
            }
        }
        errors
    }

    /// Returns an error if the port at the end of a path requires a link.
    fn check_not_required(&self, holders: &[(&Tree, usize)], span: Span) -> Result<(), EditError> {
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
                // The links in `carry` determine which outputs are passed from one element to the next, so they cannot be removed.
                let is_needed = outer == "carry" || self.references.is_required(node, &port);
                (port, is_needed)
            }
            ("Switch", [(cases, case)]) => match &cases.kind {
                Kind::Map(entries) => {
                    (entries[*case].0.text().unwrap_or_default().to_owned(), true)
                }
                _ => (outer, true),
            },
            (_, []) => {
                let is_needed = self.references.is_required(node, &outer);
                (outer, is_needed)
            }
            _ => (outer, false),
        };
        if !is_needed {
            return Ok(());
        }
        let message = format!("port `{port}` of `{node}` cannot be left without a link");
        Err(edit_error(code::MISSING_FIELD, span, message, "link it to something else"))
    }

    /// Returns the values around a span, outermost first, each with the index of its part that contains the span. A `Some(..)` directly
    /// around the span is skipped.
    fn ancestors(&self, span: Span) -> Vec<(&Tree, usize)> {
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
            tree = child(tree, index);
        }
        fn is_some(tree: &Tree) -> bool {
            tree.call_of("Some").is_some()
        }
        while holders.pop_if(|(tree, _)| is_some(tree)).is_some() {}
        holders
    }

    fn removal_splices(&self, gone: &Removals<'_>) -> Vec<Splice> {
        gone.values().flat_map(|(tree, gone)| remove_parts(self.text, tree, gone)).collect()
    }

    fn output(&self, name: &str, to: Option<&str>) -> Result<Vec<Splice>, Vec<EditError>> {
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
                return Err(to_errors(edit_error(
                    code::UNKNOWN_LINK,
                    Span::default(),
                    message,
                    help,
                )));
            };
            let users =
                self.references.all.iter().filter(|found| found.kind == ReferenceKind::Output);
            let error = users.filter(|found| found.text == name).map(|user| {
                let message = format!("output `{name}` cannot be removed: {} needs it", user.by);
                edit_error(code::UNKNOWN_LINK, user.span, message, "name the node there instead")
            });
            let error = Vec::from_iter(error);
            if !error.is_empty() {
                return Err(error);
            }
            return Ok(remove_parts(self.text, outputs, &BTreeSet::from([index])));
        };
        if let Some(index) = index {
            return Ok(vec![(entries[index].1.span, quote(to))]);
        }
        let entry = format!("{}: {}", quote(name), quote(to));
        Ok(match outputs {
            Some(outputs) => put_entry(self.text, outputs, None, false, |_| entry.clone()),
            None => add_field(self.text, &self.tree, "outputs", &format!("{{ {entry} }}")),
        })
    }
}

/// Returns true if an expression refers to a parameter.
fn is_named(expression: &str, parameters: &BTreeSet<&str>, name: &str) -> bool {
    let places = named_parameters(expression, &|word| parameters.contains(word));
    places.into_iter().flatten().any(|place| &expression[place] == name)
}

/// Returns the error for an entry that cannot be removed, because another part refers to it.
fn still_needed(section: &str, name: &str, user: &Reference) -> EditError {
    let message = format!("`{name}` cannot be removed: {} needs it", user.by);
    match section {
        "params" => {
            let help = format!("replace the references to `{name}` by values");
            edit_error(code::EXPRESSION, user.span, message, help)
        }
        _ => {
            let help = "link it to something else, or remove optional links, too (--and-links)";
            edit_error(code::UNKNOWN_LINK, user.span, message, help)
        }
    }
}

fn to_errors(error: EditError) -> Vec<EditError> {
    vec![error]
}

/// Returns the call of the node `node` in the graph `tree`. `None` if there is no such node.
fn call_of<'t>(tree: &'t Tree, node: &str) -> Option<&'t Tree> {
    let mut nodes = entries(tree.fields()?, "nodes");
    nodes.find(|(name, _)| *name == node).map(|(_, call)| call)
}

/// Returns the part of a value at an index: an item, an entry's value or a field's value.
fn child(tree: &Tree, index: usize) -> &Tree {
    match &tree.kind {
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => &items[index],
        Kind::Call { body: Body::Fields(fields), .. } => &fields[index].value,
        Kind::Map(entries) => &entries[index].1,
        _ => tree,
    }
}

fn mark_removed<'t>(gone: &mut Removals<'t>, tree: &'t Tree, index: usize) {
    gone.entry(tree.span).or_insert_with(|| (tree, BTreeSet::new())).1.insert(index);
}

/// Replaces byte ranges in a text by `new`. The ranges must be in order.
fn replace_ranges(text: &str, places: &[Range<usize>], new: &str) -> String {
    let mut result = text.to_owned();
    for place in places.iter().rev() {
        result.replace_range(place.clone(), new);
    }
    result
}

/// Returns an error if a text is not a valid name for a node, an input or a parameter.
pub(crate) fn check_name(name: &str, what: &str) -> Result<(), EditError> {
    if is_name(name) {
        return Ok(());
    }
    let message = format!("`{name}` cannot name {what}");
    let help = "use a lower-case letter followed by lower-case letters, digits and hyphens";
    Err(edit_error(code::BAD_NAME, Span::default(), message, help))
}

/// Returns true if a word can be the name of a type or of a field.
fn is_field_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
