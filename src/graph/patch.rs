//! `Patch(of: "doll.ron", params: {..}, nodes: {..})`: a graph that is another one with other values.
//!
//! The values are put into the other graph's text, as `maquette set` would; what comes of it is checked and evaluated like any
//! graph. The [`Sheet`] knows which part of the text stands in which file, so that problems are reported where their cause
//! stands, and paths are relative to the file that has them.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Source, Span, code};
use maquette_syntax::{
    Body, Field, Finding, Kind, Mistake, ReadText, Sheet, TextPart, Tree, fields_twice,
    nearest_or_all, twice,
};

use super::check::Check;
use super::migrate::{MOST_STEPS, node_steps, renewed_node, renewed_target, renewed_text};
use super::{Options, Splice, place, written};
use crate::catalog::Catalog;
use crate::load::first;
use crate::options::folder_of;
use crate::tree::is_patch;

/// The tree of the graph that a patch makes; the patch's own if the other graph is not there, or one of them is wrong.
pub(super) fn patched_tree(
    path: &Path,
    text: String,
    catalog: &Catalog,
    options: &Options,
) -> Tree {
    let (_, whole) = first(path, text.clone(), catalog, options);
    match whole {
        Some(whole) => Arc::unwrap_or_clone(whole.definition.tree),
        None => maquette_syntax::parse(&text).0,
    }
}

/// A value, what it is for, where the patch names that, and where its field.
type Wanted = (String, Span, Span, Tree);

/// The fields of a patch.
pub(super) const FIELDS: [&str; 5] = ["format", "doc", "of", "params", "nodes"];

impl Check<'_, '_> {
    /// The tree of the file's text. If it is a patch, of the graph that it makes of another one; the sheet is that graph's, then.
    pub(super) fn tree(&mut self) -> Option<Tree> {
        let (tree, mistakes) = maquette_syntax::parse(&self.sheet.source.text);
        if self.is_newer(&tree) {
            return None;
        }
        let tree = self.whole_tree(tree, mistakes)?;
        if !is_patch(&tree) {
            return Some(tree);
        }
        self.sheet = self.patched(&tree)?;
        let (tree, mistakes) = maquette_syntax::parse(&self.sheet.source.text);
        self.whole_tree(tree, mistakes)
    }

    /// The tree; if there are mistakes in the text of a graph or patch, what can be read of it all the same.
    fn whole_tree(&mut self, tree: Tree, mistakes: Vec<Mistake>) -> Option<Tree> {
        let ReadText { tree, mistakes, doubts } =
            ReadText::new(&self.sheet, (tree, mistakes), &["Graph", "Patch"]);
        for mistake in mistakes {
            self.find(code::SYNTAX, mistake.span, mistake.message, mistake.help);
        }
        if let Some(doubts) = doubts {
            self.doubts.get_or_insert_default().extend(doubts);
        }
        tree
    }

    /// Leaves out what is reported only because a part of a text cannot be read.
    pub(super) fn leave_out_doubts(&mut self) {
        let Some(doubts) = &self.doubts else { return };
        let sheet = &self.sheet;
        self.findings.retain(|Finding { code, span, message, .. }| {
            let (source, span) = sheet.place(*span);
            !doubts.cover(code, (&source, span), message)
        });
    }

    /// The text of the graph that a patch makes; none if something in the patch or in the other graph's text is wrong.
    fn patched(&mut self, patch: &Tree) -> Option<Arc<Sheet>> {
        let own = self.sheet.clone();
        self.findings.extend(duplicates(patch));
        let mut of = None;
        let mut puts = Vec::new();
        for field in patch.fields().unwrap_or_default() {
            match (&field.name.text[..], &field.value.kind) {
                ("format", Kind::Number { .. }) => {}
                ("doc", Kind::Text(_)) => {
                    let span = field.name.span;
                    puts.push(("doc".into(), span, span, field.value.clone()));
                }
                ("of", Kind::Text(path)) => of = Some((path.clone(), field.value.span)),
                ("params", Kind::Map(entries)) => self.params(entries, &mut puts),
                ("nodes", Kind::Map(entries)) => self.fields(entries, &mut puts),
                (known, _) if FIELDS.contains(&known) => {
                    let wanted = match known {
                        "of" => "the path of a graph",
                        "format" => "the number 1",
                        "doc" => "a text",
                        _ => "a map: {\"name\": .., ..}",
                    };
                    let found = field.value.in_words();
                    let message = format!("field `{known}` of Patch wants {wanted}, not {found}");
                    self.find(code::WRONG_VALUE, field.value.span, message, "");
                }
                (unknown, _) => {
                    let message = format!("Patch has no field `{unknown}`");
                    let help = nearest_or_all(unknown, "its fields", &FIELDS);
                    self.find(code::UNKNOWN_FIELD, field.name.span, message, help);
                }
            }
        }
        let Some((path, span)) = of else {
            if self.findings.is_empty() {
                let message = "Patch needs a field `of`".to_owned();
                self.find(code::MISSING_FIELD, patch.span, message, "write `of: \"graph.ron\"`");
            }
            return None;
        };
        let mut sheet = self.base(&path, span)?;
        let (graph, _) = maquette_syntax::parse(&sheet.source.text);
        puts.retain_mut(|(target, named, ..)| {
            match written(&graph, target, self.world.options.draft) {
                Ok(now) => {
                    *target = now;
                    true
                }
                Err(refusal) => {
                    let message = format!("`{target}`: {}", refusal.message);
                    self.find(refusal.code, *named, message, refusal.help);
                    false
                }
            }
        });
        sheet = self.up_to_date(sheet, &puts);
        let (graph, _) = maquette_syntax::parse(&sheet.source.text);
        for (mut target, named, field, value) in puts {
            let mut text = own.source.text[value.span.start..value.span.end].to_owned();
            if self.doubts.is_some() && !maquette_syntax::parse(&text).1.is_empty() {
                continue;
            }
            if let Some((now, put)) = renewed_target(&graph, &target, &value, self.world.catalog) {
                text = renewed_text(&value, &put.value, &own.source.text);
                target = now;
                let told = put.findings.into_iter();
                self.findings.extend(told.map(|finding| Finding { span: field, ..finding }));
            }
            match place(&sheet.source.text, &target, &text, true, false) {
                Ok((edits, _)) => {
                    let names = steps(&own.source.text, named, field);
                    sheet = spliced(&sheet, edits, (&text, &names), &own, value.span);
                }
                Err(refusal) => {
                    let message = format!("`{target}`: {}", refusal.message);
                    let is_unknown = refusal.code == code::UNKNOWN_LINK;
                    let span = if is_unknown { named } else { value.span };
                    self.find(refusal.code, span, message, refusal.help);
                }
            }
        }
        // They are about the patch, and what is found from here on is about the graph that it makes.
        let uses = self.uses.clone();
        self.leave_out_doubts();
        self.findings.sort_by_key(|finding| finding.span);
        let problems = self.findings.drain(..).map(|finding| own.problem(finding, &uses));
        self.world.problems.extend(problems);
        Some(sheet)
    }

    /// The graph that is patched with the present names of all fields of the nodes that are: then a value goes to its field, whatever the
    /// graph and the patch call it.
    fn up_to_date(&mut self, mut sheet: Arc<Sheet>, puts: &[Wanted]) -> Arc<Sheet> {
        let nodes = puts.iter().filter_map(|(target, ..)| Some(target.split_once('.')?.0));
        for name in BTreeSet::from_iter(nodes) {
            let (tree, _) = maquette_syntax::parse(&sheet.source.text);
            let told = renewed_node(&tree, name, self.world.catalog);
            let told = told.into_iter().map(|finding| sheet.problem(finding, &self.uses));
            self.world.problems.extend(told);
            for _ in 0..MOST_STEPS {
                let mut splices = node_steps(&sheet.source.text, name, self.world.catalog);
                if splices.is_empty() {
                    break;
                }
                splices.sort_by_key(|(span, _)| *span);
                for (span, new) in splices.into_iter().rev() {
                    let (source, at) = sheet.place(span);
                    let from = Sheet::new(source, sheet.folder_of(span).to_owned());
                    sheet = spliced(&sheet, vec![(span, new.clone())], (&new, &[]), &from, at);
                }
            }
        }
        sheet
    }

    fn params(&mut self, entries: &[(Tree, Tree)], puts: &mut Vec<Wanted>) {
        for (key, value) in entries {
            match key.text() {
                Some(name) => puts.push((name.to_owned(), key.span, key.span, value.clone())),
                None => self.no_name(key),
            }
        }
    }

    /// The fields of nodes: `"red": (select: ..)`, or `"red.select": (distance: 20.0)` for what lies further in.
    fn fields(&mut self, entries: &[(Tree, Tree)], puts: &mut Vec<Wanted>) {
        for (key, value) in entries {
            let Some(node) = key.text() else {
                self.no_name(key);
                continue;
            };
            match &value.kind {
                Kind::Call { name: None, body: Body::Fields(fields) } => {
                    fn target(field: &Field, node: &str) -> String {
                        format!("{node}.{}", field.name.text)
                    }
                    puts.extend(fields.iter().map(|field| {
                        (target(field, node), key.span, field.name.span, field.value.clone())
                    }));
                }
                Kind::Call { name: None, body: Body::Empty } => {}
                _ => {
                    let message = format!(
                        "a patch of `{node}` is a group of fields, not {}",
                        value.in_words()
                    );
                    self.find(code::WRONG_VALUE, value.span, message, "write `(field: value, ..)`");
                }
            }
        }
    }

    fn no_name(&mut self, key: &Tree) {
        let message = format!("a name is a text in double quotes, not {}", key.in_words());
        self.find(code::BAD_NAME, key.span, message, "");
    }

    /// The text of the graph that is patched, which may be a patch itself.
    fn base(&mut self, given: &str, span: Span) -> Option<Arc<Sheet>> {
        let own = self.sheet.clone();
        let found = self.enter(given, span)?;
        let text = match self.world.options.text(&found.path) {
            Ok(text) => text,
            Err(error) => {
                self.find(code::MISSING_FILE, span, format!("cannot read `{given}`: {error}"), "");
                return None;
            }
        };
        let source = Arc::new(Source { name: found.name.clone(), text });
        self.world.open.push((found.real, found.name));
        self.sheet = Sheet::new(source, folder_of(&found.path));
        // What is wrong with its text is a problem of its file.
        let known = std::mem::take(&mut self.findings);
        let tree = self.tree();
        let mut findings = std::mem::replace(&mut self.findings, known);
        self.world.open.pop();
        let sheet = std::mem::replace(&mut self.sheet, own.clone());
        findings.sort_by_key(|finding| finding.span);
        let problems = findings.into_iter().map(|finding| sheet.problem(finding, &self.uses));
        self.world.problems.extend(problems);
        tree?;
        let parts = whole(&sheet);
        let source = Source { name: own.source.name.clone(), text: sheet.source.text.clone() };
        let (folder, named_folder) = (sheet.folder.clone(), own.folder.clone());
        Some(Arc::new(Sheet { source: Arc::new(source), folder, named_folder, parts }))
    }
}

/// What stands twice in a patch, where each name stands once. In a value the check of the patched graph finds it.
pub fn duplicates(file: &Tree) -> Vec<Finding> {
    let fields = file.fields().filter(|_| is_patch(file)).unwrap_or_default();
    let mut found = fields_twice(fields);
    for field in fields {
        let Kind::Map(entries) = &field.value.kind else { continue };
        let what = if field.name.text == "nodes" { "node" } else { "parameter" };
        found.extend(twice(entries, what));
        let groups = entries.iter().filter(|_| what == "node");
        found
            .extend(groups.flat_map(|(_, group)| fields_twice(group.fields().unwrap_or_default())));
    }
    found
}

/// The parts of a text; the text itself if it has none.
fn whole(sheet: &Sheet) -> Vec<TextPart> {
    if !sheet.parts.is_empty() {
        return sheet.parts.clone();
    }
    let span = Span { start: 0, end: sheet.source.text.len() };
    vec![TextPart { span, source: sheet.source.clone(), start: 0, folder: sheet.folder.clone() }]
}

/// The names of fields that lead to a value of a patch, and where they stand: `select` of the key `"red.select"`, and then its field.
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

/// Where names stand in what leads to a value, `select: (distance: `, each with its place in the file that has it; in order.
fn led_by(lead: &str, names: &[(&str, Span)]) -> Vec<(usize, Span)> {
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

/// The text with edits that put a value of another file into it, to which some names of that file lead.
fn spliced(
    sheet: &Sheet,
    mut edits: Vec<Splice>,
    (value, names): (&str, &[(&str, Span)]),
    from: &Sheet,
    at: Span,
) -> Arc<Sheet> {
    edits.sort_by_key(|(span, _)| *span);
    let old = &sheet.source.text;
    let (mut text, mut parts) = (String::with_capacity(old.len() + value.len()), Vec::new());
    let mut copied = 0;
    let copy = |text: &mut String, parts: &mut Vec<TextPart>, start: usize, end: usize| {
        for part in &sheet.parts {
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
        // What stands around the value is of the place where the value stands.
        let lead = new.rfind(value).unwrap_or(0);
        let start = text.len();
        text.push_str(&new);
        let end = start + (lead + value.len()).min(new.len());
        let (mut own, mut behind) = (Vec::new(), start);
        for (name, Span { start: from_at, end }) in led_by(&new[..lead], names) {
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
    let source = Arc::new(Source { name: sheet.source.name.clone(), text });
    let (folder, named_folder) = (sheet.folder.clone(), sheet.named_folder.clone());
    Arc::new(Sheet { source, folder, named_folder, parts })
}
