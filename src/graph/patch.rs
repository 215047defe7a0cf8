//! Patches. `Patch(of: "doll.ron", params: {..}, nodes: {..})` is a graph like `doll.ron` with some values changed.
//!
//! The values are put into the text of the patched graph, as by `maquette edit GRAPH set`. The result is checked and evaluated like any
//! graph. The [`SourceMap`] records from which file each part of the text comes. Errors are reported at their causes, and paths are
//! relative to the files that contain them.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Source, Span, code};
use maquette_syntax::{
    Body, Kind, LocalDiagnostic, ReadText, SourceMap, SyntaxError, TextPart, Tree,
    duplicate_fields, duplicate_keys, nearest_or_all,
};

use super::check::Check;
use super::migrate::{MAX_STEPS, migrate_target, migrated_text, node_steps, outdated_parts};
use super::{Options, Splice, place_value, target_in_file};
use crate::catalog::Catalog;
use crate::load::check_file;
use crate::options::folder_of;
use crate::tree::is_patch;

/// Returns the tree of the graph that results from a patch. If one of the files is missing or invalid, returns the tree of the patch
/// itself.
pub(super) fn patched_tree(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
) -> Tree {
    let (_, whole) = check_file(path, text.clone(), catalog, options);
    match whole {
        Some(whole) => Arc::unwrap_or_clone(whole.definition.tree),
        None => maquette_syntax::parse(&text).0,
    }
}

/// A value in a patch, and the target in the patched graph whose value it replaces.
struct PatchValue {
    /// The path of the value in the patched graph.
    target: String,
    /// The position of the value's key in the patch.
    key: Span,
    /// The position of the field's name in the patch.
    field: Span,
    value: Tree,
}

/// The names of the fields of a patch.
pub(super) const FIELDS: [&str; 5] = ["format", "doc", "of", "params", "nodes"];

impl Check<'_, '_> {
    /// Parses the file. If it is a patch, returns the tree of the resulting graph, and replaces the source map by that of the resulting
    /// graph.
    pub(super) fn tree(&mut self) -> Option<Tree> {
        let (tree, errors) = maquette_syntax::parse(&self.source_map.source.text);
        if self.is_other_format(&tree) {
            return None;
        }
        let tree = self.whole_tree(tree, errors)?;
        if !is_patch(&tree) {
            return Some(tree);
        }
        self.source_map = self.patched_source_map(&tree)?;
        let (tree, errors) = maquette_syntax::parse(&self.source_map.source.text);
        self.whole_tree(tree, errors)
    }

    /// Returns the tree of a graph or patch. If its text has syntax errors, returns the parts that can be read.
    fn whole_tree(&mut self, tree: Tree, mistakes: Vec<SyntaxError>) -> Option<Tree> {
        let ReadText { tree, errors: mistakes, uncertain_parts: doubts } =
            ReadText::new(&self.source_map, (tree, mistakes), &["Graph", "Patch"]);
        for mistake in mistakes {
            self.report(code::SYNTAX, mistake.span, mistake.message, mistake.help);
        }
        if let Some(doubts) = doubts {
            self.doubts.get_or_insert_default().extend(doubts);
        }
        tree
    }

    /// Removes diagnostics that may only be consequences of unreadable parts of the text.
    pub(super) fn leave_out_doubts(&mut self) {
        let Some(doubts) = &self.doubts else { return };
        let source_map = &self.source_map;
        self.diagnostics.retain(|LocalDiagnostic { code, span, message, .. }| {
            let (source, span) = source_map.locate(*span);
            !doubts.covers(code, (&source, span), message)
        });
    }

    /// Returns the text of the graph that results from a patch. `None` if the patch or the patched graph has errors.
    fn patched_source_map(&mut self, patch: &Tree) -> Option<Arc<SourceMap>> {
        let own = self.source_map.clone();
        self.diagnostics.extend(duplicates(patch));
        let mut of = None;
        let mut new_values = Vec::new();
        for field in patch.fields().unwrap_or_default() {
            match (&field.name.text[..], &field.value.kind) {
                ("format", Kind::Number { .. }) => {}
                ("doc", Kind::Text(_)) => {
                    let (key, value) = (field.name.span, field.value.clone());
                    new_values.push(PatchValue { target: "doc".into(), key, field: key, value });
                }
                ("of", Kind::Text(path)) => of = Some((path.clone(), field.value.span)),
                ("params", Kind::Map(entries)) => self.read_params(entries, &mut new_values),
                ("nodes", Kind::Map(entries)) => self.read_fields(entries, &mut new_values),
                (known, _) if FIELDS.contains(&known) => {
                    let wanted = match known {
                        "of" => "the path of a graph",
                        "format" => "the number 1",
                        "doc" => "a text",
                        _ => "a map: {\"name\": .., ..}",
                    };
                    let found = field.value.describe();
                    let message =
                        format!("field `{known}` of Patch: expected {wanted}, found {found}");
                    self.report(code::WRONG_VALUE, field.value.span, message, "");
                }
                (unknown, _) => {
                    let message = format!("Patch has no field `{unknown}`");
                    let help = nearest_or_all(unknown, "its fields", &FIELDS);
                    self.report(code::UNKNOWN_FIELD, field.name.span, message, help);
                }
            }
        }
        let Some((path, span)) = of else {
            if self.diagnostics.is_empty() {
                let message = "Patch needs a field `of`".to_owned();
                self.report(code::MISSING_FIELD, patch.span, message, "write `of: \"graph.ron\"`");
            }
            return None;
        };
        let mut source_map = self.base_source_map(&path, span)?;
        let (graph, _) = maquette_syntax::parse(&source_map.source.text);
        new_values.retain_mut(|PatchValue { target, key, .. }| {
            match target_in_file(&graph, target, self.world.options.draft) {
                Ok(now) => {
                    *target = now;
                    true
                }
                Err(error) => {
                    let message = format!("`{target}`: {}", error.message);
                    self.report(error.code, *key, message, error.help);
                    false
                }
            }
        });
        source_map = self.migrate_nodes(source_map, &new_values);
        let (graph, _) = maquette_syntax::parse(&source_map.source.text);
        for PatchValue { mut target, key, field, value } in new_values {
            let mut text = own.source.text[value.span.start..value.span.end].to_owned();
            if self.doubts.is_some() && !maquette_syntax::parse(&text).1.is_empty() {
                continue;
            }
            if let Some((now, migrated)) =
                migrate_target(&graph, &target, &value, self.world.catalog)
            {
                text = migrated_text(&value, &migrated.value, &own.source.text);
                target = now;
                let outdated = migrated.diagnostics.into_iter();
                self.diagnostics.extend(
                    outdated.map(|diagnostic| LocalDiagnostic { span: field, ..diagnostic }),
                );
            }
            match place_value(&source_map.source.text, &target, &text, true, false) {
                Ok((edits, _)) => {
                    let names = steps(&own.source.text, key, field);
                    source_map =
                        splice_source_map(&source_map, edits, (&text, &names), &own, value.span);
                }
                Err(error) => {
                    let message = format!("`{target}`: {}", error.message);
                    let is_unknown = error.code == code::UNKNOWN_LINK;
                    let span = if is_unknown { key } else { value.span };
                    self.report(error.code, span, message, error.help);
                }
            }
        }
        // Diagnostics up to this point have positions in the patch. Later ones have positions in the resulting graph.
        let uses = self.uses.clone();
        self.leave_out_doubts();
        self.diagnostics.sort_by_key(|diagnostic| diagnostic.span);
        let diagnostics =
            self.diagnostics.drain(..).map(|diagnostic| own.diagnostic(diagnostic, &uses));
        self.world.diagnostics.extend(diagnostics);
        Some(source_map)
    }

    /// Migrates to current names those nodes of the patched graph that the patch changes. The patch can then use both the old and the new
    /// name of a field.
    fn migrate_nodes(
        &mut self,
        mut source_map: Arc<SourceMap>,
        new_values: &[PatchValue],
    ) -> Arc<SourceMap> {
        let nodes = new_values.iter().filter_map(|new| Some(new.target.split_once('.')?.0));
        for name in BTreeSet::from_iter(nodes) {
            let (tree, _) = maquette_syntax::parse(&source_map.source.text);
            let outdated = outdated_parts(&tree, name, self.world.catalog);
            let outdated = outdated
                .into_iter()
                .map(|diagnostic| source_map.diagnostic(diagnostic, &self.uses));
            self.world.diagnostics.extend(outdated);
            for _ in 0..MAX_STEPS {
                let mut splices = node_steps(&source_map.source.text, name, self.world.catalog);
                if splices.is_empty() {
                    break;
                }
                splices.sort_by_key(|(span, _)| *span);
                for (span, new) in splices.into_iter().rev() {
                    let (source, at) = source_map.locate(span);
                    let from = SourceMap::new(source, source_map.folder_of(span).to_owned());
                    source_map = splice_source_map(
                        &source_map,
                        vec![(span, new.clone())],
                        (&new, &[]),
                        &from,
                        at,
                    );
                }
            }
        }
        source_map
    }

    fn read_params(&mut self, entries: &[(Tree, Tree)], new_values: &mut Vec<PatchValue>) {
        for (key, value) in entries {
            match key.text() {
                Some(name) => new_values.push(PatchValue {
                    target: name.to_owned(),
                    key: key.span,
                    field: key.span,
                    value: value.clone(),
                }),
                None => self.report_no_name(key),
            }
        }
    }

    /// Reads the fields of nodes: `"red": (select: ..)`, or `"red.select": (distance: 20.0)` for nested fields.
    fn read_fields(&mut self, entries: &[(Tree, Tree)], new_values: &mut Vec<PatchValue>) {
        for (key, value) in entries {
            let Some(node) = key.text() else {
                self.report_no_name(key);
                continue;
            };
            match &value.kind {
                Kind::Call { name: None, body: Body::Fields(fields) } => {
                    new_values.extend(fields.iter().map(|field| PatchValue {
                        target: format!("{node}.{}", field.name.text),
                        key: key.span,
                        field: field.name.span,
                        value: field.value.clone(),
                    }));
                }
                Kind::Call { name: None, body: Body::Empty } => {}
                _ => {
                    let message = format!(
                        "a patch of `{node}` is a group of fields, not {}",
                        value.describe()
                    );
                    self.report(
                        code::WRONG_VALUE,
                        value.span,
                        message,
                        "write `(field: value, ..)`",
                    );
                }
            }
        }
    }

    fn report_no_name(&mut self, key: &Tree) {
        let message = format!("a name is a text in double quotes, not {}", key.describe());
        self.report(code::BAD_NAME, key.span, message, "");
    }

    /// Returns the text of the patched graph. If the patched graph is a patch too, returns the text of the graph that results from it.
    fn base_source_map(&mut self, given: &str, span: Span) -> Option<Arc<SourceMap>> {
        let own = self.source_map.clone();
        let found = self.enter(given, span)?;
        let text = match self.world.options.text(&found.path) {
            Ok(text) => text,
            Err(error) => {
                self.report(
                    code::MISSING_FILE,
                    span,
                    format!("cannot read `{given}`: {error}"),
                    "",
                );
                return None;
            }
        };
        let source = Arc::new(Source { name: found.name.clone(), text });
        self.world.open_files.push((found.canonical_path, found.name));
        self.source_map = SourceMap::new(source, folder_of(&found.path));
        // Errors in the patched graph are reported in its own file, so collect them separately.
        let known = std::mem::take(&mut self.diagnostics);
        let tree = self.tree();
        let mut diagnostics = std::mem::replace(&mut self.diagnostics, known);
        self.world.open_files.pop();
        let source_map = std::mem::replace(&mut self.source_map, own.clone());
        diagnostics.sort_by_key(|diagnostic| diagnostic.span);
        let diagnostics =
            diagnostics.into_iter().map(|diagnostic| source_map.diagnostic(diagnostic, &self.uses));
        self.world.diagnostics.extend(diagnostics);
        tree?;
        let parts = text_parts(&source_map);
        let source = Source { name: own.source.name.clone(), text: source_map.source.text.clone() };
        let (folder, named_folder) = (source_map.folder.clone(), own.folder.clone());
        Some(Arc::new(SourceMap { source: Arc::new(source), folder, named_folder, parts }))
    }
}

/// Returns errors for duplicate names in a patch. Duplicates inside of a value are found later, by the check of the resulting graph.
pub fn duplicates(file: &Tree) -> Vec<LocalDiagnostic> {
    let fields = file.fields().filter(|_| is_patch(file)).unwrap_or_default();
    let mut found = duplicate_fields(fields);
    for field in fields {
        let Kind::Map(entries) = &field.value.kind else { continue };
        let what = if field.name.text == "nodes" { "node" } else { "parameter" };
        found.extend(duplicate_keys(entries, what));
        let groups = entries.iter().filter(|_| what == "node");
        found.extend(
            groups.flat_map(|(_, group)| duplicate_fields(group.fields().unwrap_or_default())),
        );
    }
    found
}

/// Returns the parts of the source map. If it has none, returns the whole text as a single part.
fn text_parts(source_map: &SourceMap) -> Vec<TextPart> {
    if !source_map.parts.is_empty() {
        return source_map.parts.clone();
    }
    let span = Span { start: 0, end: source_map.source.text.len() };
    vec![TextPart {
        span,
        source: source_map.source.clone(),
        start: 0,
        folder: source_map.folder.clone(),
    }]
}

/// Returns the field names on the path to a value of a patch, with their positions. The names in the key come first, such as `select` in
/// `"red.select"`, then the name of the field itself.
fn steps(text: &str, key: Span, field: Span) -> Vec<(&str, Span)> {
    let mut at = key.start;
    let mut steps = Vec::new();
    for step in text[key.start..key.end].split(['.', '"']) {
        steps.push((step, Span { start: at, end: at + step.len() }));
        at += step.len() + 1;
    }
    steps.push((&text[field.start..field.end], field));
    steps
}

/// Finds names in the text before a value, such as `select: (distance: `. For each name found, in order, returns its offset in that text
/// and its position in the patch.
fn name_positions(lead: &str, names: &[(&str, Span)]) -> Vec<(usize, Span)> {
    let (mut found, mut end) = (Vec::new(), lead.len());
    for (name, span) in names.iter().rev().filter(|(name, _)| !name.is_empty()) {
        let Some(at) = lead[..end].rfind(name).filter(|at| {
            let behind = lead[at + name.len()..].trim_start();
            behind.starts_with(':')
                && !lead[..*at].ends_with(|c: char| c.is_alphanumeric() || c == '_')
        }) else {
            break;
        };
        found.insert(0, (at, *span));
        end = at;
    }
    found
}

/// Applies edits that put `value`, from another file, into a text. `names` are the field names on the path to the value in that file.
fn splice_source_map(
    source_map: &SourceMap,
    mut edits: Vec<Splice>,
    (value, names): (&str, &[(&str, Span)]),
    from: &SourceMap,
    at: Span,
) -> Arc<SourceMap> {
    edits.sort_by_key(|(span, _)| *span);
    let old = &source_map.source.text;
    let (mut text, mut parts) = (String::with_capacity(old.len() + value.len()), Vec::new());
    let mut copied = 0;
    let copy = |text: &mut String, parts: &mut Vec<TextPart>, start: usize, end: usize| {
        for part in &source_map.parts {
            let (first, last) = (part.span.start.max(start), part.span.end.min(end));
            if first < last {
                let shift = text.len();
                text.push_str(&old[first..last]);
                let span = Span { start: shift, end: text.len() };
                let start = part.start + (first - part.span.start);
                parts.push(TextPart { span, start, ..part.clone() });
            }
        }
    };
    for (span, new) in edits {
        copy(&mut text, &mut parts, copied, span.start);
        // The new text around the value gets the position of the value.
        let lead = new.rfind(value).unwrap_or(0);
        let start = text.len();
        text.push_str(&new);
        let end = start + (lead + value.len()).min(new.len());
        let (mut own, mut behind) = (Vec::new(), start);
        for (name, Span { start: from_at, end }) in name_positions(&new[..lead], names) {
            let (first, last) = (start + name, start + name + (end - from_at));
            own.extend([(at.start, behind, first), (from_at, first, last)]);
            behind = last;
        }
        own.extend([
            (at.start, behind, start + lead),
            (at.start, start + lead, end),
            (at.end, end, text.len()),
        ]);
        for (from_at, first, last) in own {
            if first < last {
                let (source, folder) = (from.source.clone(), from.folder.clone());
                let span = Span { start: first, end: last };
                parts.push(TextPart { span, source, start: from_at, folder });
            }
        }
        copied = span.end;
    }
    copy(&mut text, &mut parts, copied, old.len());
    let source = Arc::new(Source { name: source_map.source.name.clone(), text });
    let (folder, named_folder) = (source_map.folder.clone(), source_map.named_folder.clone());
    Arc::new(SourceMap { source, folder, named_folder, parts })
}
