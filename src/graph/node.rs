//! Checks the fields of a node, and builds the node.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use maquette_node::{AnyNode, FieldError};
use maquette_syntax::error::{Diagnostic, Span, code};
use maquette_syntax::paths::{PathError, may_read};
use maquette_syntax::{
    Body, Field, FoundFile, InputSlots, Kind, LocalDiagnostic, MAX_DEPTH, Name, Reader, Tree, Walk,
    nearest_or_all, unit_names,
};

use super::check::Check;
use super::definition::UsedGraph;
use super::draft_value::{has_draft, is_draft, is_side};
use super::migrate::{MigratedValue, kind_of, migrate_field_value};
use super::parameters::{Parameters, read_set};
use super::recipe::Recipe;
use super::{EditError, Files, ReadFile, unreachable_part};
use crate::catalog::Entry;
use crate::definition::{BuiltNode, CheckedFields, ForEachNode, NodeKind, ParsedNode};
use crate::files::NodeFile;

impl Check<'_, '_> {
    /// Checks the fields of a node for the given values of parameters. Both sides of each `Draft` must be valid.
    pub(super) fn check_fields(
        &mut self,
        what: &NodeKind,
        tree: &Tree,
        values: &Parameters,
    ) -> CheckedFields {
        let checked = self.check_fields_of_side(what, tree, values);
        if has_draft(tree) {
            let known = std::mem::take(&mut self.diagnostics);
            let other = self.check_fields_of_side(what, tree, &values.for_other_side());
            let found = std::mem::replace(&mut self.diagnostics, known);
            for diagnostic in found {
                if !self.diagnostics.iter().any(|known| {
                    (known.code, known.span, &known.message)
                        == (diagnostic.code, diagnostic.span, &diagnostic.message)
                }) {
                    self.diagnostics.push(diagnostic);
                }
            }
            if let Some(link) =
                checked.links.iter().find(|link| other.links.iter().all(|o| o.span != link.span))
            {
                let message = format!("port `{}` cannot take a Draft: it takes a link", link.port);
                let help = "use a Draft in a parameter of the source node, or a Switch";
                self.report(code::WRONG_VALUE, link.span, message, help);
            }
        }
        checked
    }

    fn check_fields_of_side(
        &mut self,
        what: &NodeKind,
        tree: &Tree,
        values: &Parameters,
    ) -> CheckedFields {
        let Some(schema) = what.schema() else {
            let tree = values.substitute(tree, &mut self.diagnostics);
            let (links, files) = (Vec::new(), Vec::new());
            return CheckedFields { tree, links, files, has_other_links: false };
        };
        let name = what.kind();
        let tree = values.resolve_call(tree, name, schema, &mut self.diagnostics);
        let mut walk = Walk {
            node: name,
            root: schema,
            source_map: Some(&self.source_map),
            diagnostics: std::mem::take(&mut self.diagnostics),
            links: Vec::new(),
            files: Vec::new(),
        };
        walk.node(&tree);
        let (links, files) = (walk.links, walk.files);
        self.diagnostics = walk.diagnostics;
        CheckedFields { tree, links, files, has_other_links: false }
    }

    /// Builds the node, and reports errors that only the node's own code can detect. `counts` has the number of values for each link.
    pub(super) fn build_node(
        &mut self,
        entry: &Entry,
        checked: CheckedFields,
        counts: impl Iterator<Item = usize>,
    ) -> Option<BuiltNode> {
        let mut first = 0;
        let mut slots = HashMap::with_capacity(checked.links.len());
        for (link, count) in checked.links.iter().zip(counts) {
            slots.entry(link.span).or_insert(InputSlots { first, count });
            first += count;
        }
        let reader = Reader { tree: &checked.tree, links: &slots, files: &checked.files };
        let node = match (entry.node.read)(&reader) {
            Ok(node) => node,
            Err(error) => {
                let message = format!("{} cannot be read: {}", entry.name, error.message);
                let span = error.span.unwrap_or(checked.tree.span);
                self.report(code::WRONG_VALUE, span, message, "");
                return None;
            }
        };
        if !checked.has_other_links
            && let Err(FieldError { field, message, help }) = node.check()
        {
            let fields = checked.tree.fields().unwrap_or_default();
            let found = fields.iter().find(|it| it.name.text == field);
            let span = found.map_or(checked.tree.span, |it| it.value.span);
            self.report(code::WRONG_VALUE, span, format!("{}: {message}", entry.name), help);
            return None;
        }
        let optional = node.files();
        if self.world.options.files != Files::Ignored {
            for file in &optional {
                let (given, resolved) = (file.name(), file.resolved_path());
                if let Err(PathError::Outside { message, help }) =
                    may_read(given, resolved, &self.world.roots)
                {
                    self.report(code::OUTSIDE, checked.tree.span, message, help);
                }
            }
        }
        let parameters = match node.parameters() {
            Ok(parameters) => parameters,
            Err(error) => {
                let message = format!("{} cannot be written: {error}", entry.name);
                let help = "this is a bug in the node";
                self.report(code::WRONG_VALUE, checked.tree.span, message, help);
                return None;
            }
        };
        let roots: Arc<[PathBuf]> = match checked.files.is_empty() && optional.is_empty() {
            true => Arc::default(),
            false => self.world.roots.as_slice().into(),
        };
        let named = checked.files.iter().map(|found| NodeFile {
            given: found.given.clone(),
            needed: true,
            missing: self.world.missing.get(&self.place_of(found)).cloned(),
            ..NodeFile::from_path(&found.resolved, roots.clone())
        });
        let optional = optional.iter().map(|found| NodeFile {
            given: found.name().to_owned(),
            needed: false,
            ..NodeFile::from_path(found.resolved_path(), roots.clone())
        });
        let files: Vec<_> = named.chain(optional).collect();
        let recipe = Arc::new(Recipe::new(&entry.name, parameters, &files));
        let (pack, tree) = (entry.pack, Arc::new(checked.tree));
        Some(BuiltNode { node: node.into(), pack, recipe, files, tree })
    }

    /// Returns true if no diagnostic from index `known` on prevents building the node. A missing file is allowed.
    pub(super) fn is_valid_since(&self, known: usize) -> bool {
        self.diagnostics[known..].iter().all(|diagnostic| diagnostic.code == code::MISSING_FILE)
    }

    /// Returns a key for a missing file: its path, and the file and span that contain the path.
    fn place_of(&self, file: &FoundFile) -> (PathBuf, PathBuf, Span) {
        (file.resolved.clone(), self.source_map.source.name.clone(), file.at)
    }

    /// Reports a file that the graph may not read, that has a wrong extension, or that does not exist.
    pub(super) fn check_file_access(&mut self, file: &FoundFile) {
        let found = match self.world.options.files {
            Files::Ignored => Ok(()),
            Files::Needed => may_read(&file.given, &file.resolved, &self.world.roots),
            Files::Inside => match may_read(&file.given, &file.resolved, &self.world.roots) {
                Err(PathError::Missing { .. }) => Ok(()),
                found => found,
            },
        };
        let extension_error = file.extension_error.clone();
        let (code, message, help) = match (found, extension_error) {
            (Err(PathError::Outside { message, help }), _) => (code::OUTSIDE, message, help),
            (_, Some((message, help))) => (code::WRONG_VALUE, message, help.into()),
            (Err(PathError::Missing { message, help }), _) => (code::MISSING_FILE, message, help),
            (Ok(()), None) => return,
        };
        let Some(from) = &file.from else {
            let diagnostic = LocalDiagnostic { code, span: file.at, message, help, note: None };
            self.note_missing(file, self.source_map.diagnostic(diagnostic.clone(), &self.uses));
            return self.diagnostics.push(diagnostic);
        };
        // Show the error in the file that contains the path, not in the graph that received the path as a parameter.
        let (source, _) = from.source_map.locate(from.span);
        let outer = self.uses.iter().position(|at| Arc::ptr_eq(&at.source, &source));
        let uses = &self.uses[..outer.unwrap_or(0)];
        let diagnostic = LocalDiagnostic { code, span: from.span, message, help, note: None };
        let diagnostic = from.source_map.diagnostic(diagnostic, uses);
        self.note_missing(file, diagnostic.clone());
        self.world.diagnostics.push(diagnostic);
    }

    /// Stores the diagnostic of a missing file.
    fn note_missing(&mut self, file: &FoundFile, diagnostic: Diagnostic) {
        if diagnostic.code == code::MISSING_FILE {
            self.world.missing.insert(self.place_of(file), diagnostic.into());
        }
    }

    /// Stores the files that a node reads. Optional files are known only if the node's fields are valid.
    pub(super) fn note_files(
        &mut self,
        node: &str,
        named: &[FoundFile],
        read: Option<&dyn AnyNode>,
    ) {
        let uses = self.uses.iter().map(|at| &at.name[..]);
        let name = uses.chain([node]).collect::<Vec<_>>().join("/");
        let named = named.iter().map(|found| (found.resolved.as_path(), false));
        let optional = read.map(AnyNode::files).unwrap_or_default();
        let optional = optional.iter().map(|found| (found.resolved_path(), true));
        let files = named.chain(optional).map(|(path, optional)| ReadFile {
            path: path.to_owned(),
            node: name.clone(),
            optional,
        });
        self.world.files.extend(files);
    }

    /// Applies the values of `--set node.field=value` to the call of the node.
    pub(super) fn with_sets(
        &mut self,
        node: &str,
        mut tree: Tree,
        subgraphs: &[UsedGraph],
    ) -> Tree {
        if !self.is_root() {
            return tree;
        }
        let options = self.world.options;
        let is_own = is_own_type(&tree, subgraphs);
        for (target, text) in &options.set {
            let Some(path) = target.strip_prefix(node).and_then(|rest| rest.strip_prefix('.'))
            else {
                continue;
            };
            if target.split('.').count() > MAX_DEPTH {
                continue;
            }
            let value = read_set(text, &format!("{target}={text}"), Span::default());
            let renewed = match is_own {
                true => None,
                false => migrate_field_value(&tree, path, &value, self.world.catalog),
            };
            let Some(MigratedValue { path, value, diagnostics }) = renewed else {
                self.set_value(&mut tree, (target, text), path, &value);
                continue;
            };
            let outdated = diagnostics.into_iter().map(|diagnostic| {
                let message = format!("--set {target}={text}: {}", diagnostic.message);
                let help = format!("set `{node}.{path}`, with the migrated value");
                LocalDiagnostic { span: Span::default(), message, help: help.into(), ..diagnostic }
            });
            self.diagnostics.extend(outdated);
            self.set_value(&mut tree, (target, text), &path, &value);
        }
        tree
    }

    /// Puts a value into a node call. Reports the reason if the path of the value cannot exist.
    fn set_value(
        &mut self,
        tree: &mut Tree,
        (target, text): (&str, &str),
        path: &str,
        value: &Tree,
    ) {
        let steps: Vec<_> = path.split('.').collect();
        if let Some(EditError { code, message, help, .. }) =
            unreachable_part(tree, &steps, self.world.options.draft)
        {
            let message = format!("--set {target}={text}: {message}");
            self.report(code, Span::default(), message, help);
        } else {
            set_field(tree, path, value);
        }
    }

    /// Reports `--set` options whose targets do not exist in the graph.
    pub(super) fn report_unknown_sets(
        &mut self,
        parameters: &Parameters,
        parsed_nodes: &[ParsedNode],
        for_each_nodes: &[ForEachNode],
    ) {
        let nodes = parsed_nodes.iter().map(|parsed| &parsed.name.text[..]);
        let nodes: Vec<_> = nodes.chain(for_each_nodes.iter().map(|each| &each.name[..])).collect();
        let options = self.world.options;
        for (target, text) in &options.set {
            if target.split('.').count() > MAX_DEPTH {
                let message = format!("--set ..={text}: the path has more than {MAX_DEPTH} steps");
                self.report(code::UNKNOWN_FIELD, Span::default(), message, "no node needs that");
                continue;
            }
            let (what, name, known) = match target.split_once('.') {
                Some((node, _)) => ("node", node, nodes.clone()),
                None => ("parameter", &target[..], parameters.names()),
            };
            if !known.contains(&name) {
                let message = format!("--set {target}={text}: the graph has no {what} `{name}`");
                let inside = name.split_once('/').map(|(outer, _)| outer);
                fn is_repeated(outer: &&str, parsed_nodes: &[ParsedNode]) -> bool {
                    parsed_nodes.iter().any(|it| it.name.text == **outer && it.repeat.is_some())
                }
                let help = match inside.filter(|outer| known.contains(outer)) {
                    Some(outer) if is_repeated(&outer, parsed_nodes) => format!(
                        "the number of elements of `{outer}` is not known; set all of them: --set {outer}.with.field=VALUE"
                    )
                    .into(),
                    Some(outer) => format!(
                        "set a parameter of `{outer}`: --set {outer}.name=VALUE"
                    )
                    .into(),
                    None if what == "node" && parameters.names().contains(&name) => format!(
                        "`{name}` is a parameter; set its whole value: --set {name}=VALUE"
                    )
                    .into(),
                    None => nearest_or_all(name, &format!("its {what}s"), &known),
                };
                self.report(code::UNKNOWN_LINK, Span::default(), message, help);
            }
        }
    }
}

/// Returns true if the type of a node is a used graph, not a built-in node. For a `ForEach`, the type that it repeats is tested.
pub(super) fn is_own_type(node: &Tree, subgraphs: &[UsedGraph]) -> bool {
    kind_of(node).is_some_and(|kind| subgraphs.iter().any(|own| own.name == kind.text))
}

/// Sets the value at a path in a node call, such as `field`, `field.field` or, for a list, `field.0`. Adds a missing field. Does nothing if
/// the path has an [`unreachable_part`].
fn set_field(tree: &mut Tree, path: &str, value: &Tree) {
    let (name, rest) = match path.split_once('.') {
        Some((name, rest)) => (name, Some(rest)),
        None => (path, None),
    };
    if is_draft(tree) && !is_side(name) {
        // The value is a `Draft`. Set both of its sides, so that the new value applies to drafts and final results.
        if let Kind::Call { body: Body::Fields(sides), .. } = &mut tree.kind {
            sides.iter_mut().for_each(|side| set_field(&mut side.value, path, value));
        }
        return;
    }
    let span = tree.span;
    let index = name.parse::<usize>().ok();
    if index.is_some() {
        spread_unit(tree);
    }
    if let Kind::Word(choice) = &mut tree.kind {
        let name = Some(Name { text: std::mem::take(choice), span });
        tree.kind = Kind::Call { name, body: Body::Empty };
    }
    let field = match &mut tree.kind {
        // A choice such as `Some(..)` is not a step of the path, which continues in the fields of its only value.
        Kind::Call { body: Body::Items(items), .. } if items.len() == 1 && index.is_none() => {
            return set_field(&mut items[0], path, value);
        }
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            match index.and_then(|index| items.get_mut(index)) {
                Some(item) => item,
                None => return,
            }
        }
        Kind::Map(entries) => match entries.iter_mut().find(|(key, _)| key.text() == Some(name)) {
            Some((_, value)) => value,
            None => return,
        },
        Kind::Call { body, .. } => {
            if *body == Body::Empty {
                *body = Body::Fields(Vec::new());
            }
            let Body::Fields(fields) = body else { return };
            let found = fields.iter().position(|field| field.name.text == name);
            let index = found.unwrap_or_else(|| {
                let name = Name { text: name.to_owned(), span };
                let value = Tree::new(span, Kind::Call { name: None, body: Body::Empty });
                fields.push(Field { name, value });
                fields.len() - 1
            });
            &mut fields[index].value
        }
        _ => return,
    };
    match rest {
        Some(rest) => set_field(field, rest, value),
        None => *field = Tree { span: field.span, ..value.clone() },
    }
}

/// Moves the unit of a vector to its numbers, so that each number can have its own unit: `cm(1, 0, 2)` becomes `(cm(1), cm(0), cm(2))`.
fn spread_unit(tree: &mut Tree) {
    let Kind::Call { name, body: Body::Items(items) } = &mut tree.kind else { return };
    fn is_unit(name: &Name) -> bool {
        unit_names().any(|unit| unit == name.text)
    }
    let Some(unit) = name.take_if(|name| is_unit(name) && items.len() > 1) else { return };
    for item in items {
        let number = std::mem::replace(item, Tree::new(item.span, Kind::Broken));
        let name = Some(unit.clone());
        item.kind = Kind::Call { name, body: Body::Items(vec![number]) };
    }
}
