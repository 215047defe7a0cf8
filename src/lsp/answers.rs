//! Answers the requests of an editor.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use gen_lsp_types::Uri;
use maquette_edit::Symbol;
use maquette_graph::name_of;
use maquette_syntax::error::Span;
use maquette_syntax::first_word;
use serde_json::{Value as Json, json};

use super::completion::{Proposal, ProposalKind, proposals};
use super::outline::{self, MEANINGS, Meaning};
use super::params::{missing, position, range, uri};
use super::position::Lines;
use super::project::{Occurrence, Texts};
use super::selection::{formatted_lines, selection};
use super::signature::signature;
use super::symbols::{flat_symbols, has_letters, symbols};
use super::{RequestError, Server, Subject};

/// The maximum number of colors or code lenses in one answer. Most editors do not show more.
const MAX_ITEMS: usize = 2_000;

impl Server {
    pub(super) fn answer(&mut self, method: &str, params: &Json) -> Result<Json, RequestError> {
        match method {
            "textDocument/completion" => self.answer_position(params, Self::completion),
            "textDocument/hover" => self.answer_position(params, Self::hover),
            "textDocument/signatureHelp" => self.answer_position(params, |server, subject, at| {
                let library = server.library(&subject.path, &subject.options);
                Ok(signature(&library, subject.lines.text(), at))
            }),
            "textDocument/definition" => self.answer_position(params, Self::definition),
            "textDocument/references" => {
                let declares = params["context"]["includeDeclaration"] != false;
                self.answer_position(params, |server, subject, at| {
                    server.references(subject, at, declares)
                })
            }
            "textDocument/documentHighlight" => self.answer_position(params, Self::highlights),
            "textDocument/prepareRename" => self.answer_position(params, Self::prepare_rename),
            "textDocument/rename" => {
                let name = params["newName"].as_str().ok_or_else(|| missing("newName"))?;
                self.answer_position(params, |server, subject, at| server.rename(subject, at, name))
            }
            "textDocument/documentSymbol" => {
                let is_tree = self.client.has_symbol_trees;
                self.answer_document(&uri(params)?, |_, subject| match is_tree {
                    true => Ok(symbols(&subject.lines)),
                    false => Ok(flat_symbols(&subject.lines, &subject.uri, "").into()),
                })
            }
            "workspace/symbol" => {
                Ok(self.workspace_symbols(params["query"].as_str().unwrap_or_default()))
            }
            "textDocument/foldingRange" => {
                self.answer_document(&uri(params)?, |_, subject| Ok(folds(&subject.lines)))
            }
            "textDocument/selectionRange" => {
                let positions =
                    params["positions"].as_array().ok_or_else(|| missing("positions"))?;
                let positions = positions.iter().map(position).collect::<Result<Vec<_>, _>>()?;
                self.answer_document(&uri(params)?, |_, Subject { lines, .. }| {
                    Ok(positions
                        .into_iter()
                        .map(|position| selection(lines, lines.offset(position)))
                        .collect())
                })
            }
            "textDocument/documentColor" => {
                self.answer_document(&uri(params)?, |_, subject| Ok(colors(&subject.lines)))
            }
            "textDocument/colorPresentation" => {
                fn level(name: &str, params: &Json) -> Result<u8, RequestError> {
                    let level = params["color"][name].as_f64().ok_or_else(|| missing(name))?;
                    Ok::<_, RequestError>((level * 255.0).round().clamp(0.0, 255.0) as u8)
                }
                let [red, green, blue] =
                    [level("red", params)?, level("green", params)?, level("blue", params)?];
                let label = format!("#{red:02x}{green:02x}{blue:02x}");
                let edit = json!({ "range": range(&params["range"])?, "newText": label });
                Ok(json!([{ "label": label, "textEdit": edit }]))
            }
            "textDocument/documentLink" => self.answer_document(&uri(params)?, Self::links),
            "textDocument/semanticTokens/full" => self
                .answer_document(&uri(params)?, |_, subject| {
                    Ok(words(&subject.lines, 0, u32::MAX))
                }),
            "textDocument/semanticTokens/range" => {
                let lines = range(&params["range"])?;
                self.answer_document(&uri(params)?, |_, subject| {
                    Ok(words(&subject.lines, lines.start.line, lines.end.line))
                })
            }
            "textDocument/inlayHint" => {
                let lines = range(&params["range"])?;
                self.answer_document(&uri(params)?, |server, subject| {
                    Ok(server.hints(subject, lines.start.line, lines.end.line))
                })
            }
            "textDocument/codeLens" => self.answer_document(&uri(params)?, Self::lenses),
            "textDocument/codeAction" => self
                .answer_document(&uri(params)?, |server, subject| server.actions(subject, params)),
            "codeAction/resolve" => self.resolve(params.clone()),
            "textDocument/formatting" => self.answer_document(&uri(params)?, |_, subject| {
                let formatted = maquette_edit::format_text(&subject.path, subject.lines.text());
                // Ignore a syntax error: it is already published as a diagnostic.
                let edit = formatted.ok().and_then(|text| subject.lines.difference(&text));
                Ok(json!(Vec::from_iter(edit)))
            }),
            "textDocument/rangeFormatting" => {
                let range = range(&params["range"])?;
                self.answer_document(&uri(params)?, |_, Subject { path, lines, .. }| {
                    let (start, end) = (lines.offset(range.start), lines.offset(range.end));
                    let span = Span { start, end: end.max(start) };
                    let formatted = maquette_edit::format_text(path, lines.text()).ok();
                    let part = formatted.and_then(|new| formatted_lines(lines.text(), &new, span));
                    let edit =
                        part.filter(|(span, new)| lines.text()[span.start..span.end] != **new);
                    Ok(json!(
                        edit.map(|(span, new)| lines.edit(span, new))
                            .into_iter()
                            .collect::<Vec<_>>()
                    ))
                })
            }
            _ => Err(RequestError::Unknown(method.to_owned())),
        }
    }

    /// Answers a request about a document. The answer is `null` if the document is not a graph, patch, test or sweep.
    pub(super) fn answer_document(
        &mut self,
        uri: &Uri,
        answer: impl FnOnce(&mut Self, &Subject<'_>) -> Result<Json, RequestError>,
    ) -> Result<Json, RequestError> {
        let mut text = Arc::from("");
        match self.subject(uri, &mut text) {
            Some(subject) => answer(self, &subject),
            None => Ok(Json::Null),
        }
    }

    /// Answers a request about a position in a document.
    fn answer_position(
        &mut self,
        params: &Json,
        answer: impl FnOnce(&mut Self, &Subject<'_>, usize) -> Result<Json, RequestError>,
    ) -> Result<Json, RequestError> {
        let position = position(&params["position"])?;
        self.answer_document(&uri(params)?, |server, subject| {
            let at = subject.lines.offset(position);
            answer(server, subject, at)
        })
    }

    fn completion(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, RequestError> {
        let library = self.library(&subject.path, &subject.options);
        let text = subject.lines.text();
        let found = proposals(&library, text, at);
        let range = subject.lines.range(found.span);
        let typed = &text[found.span.start..at];
        let (snippets, markdown) = (self.client.snippets, self.client.completes_markdown);
        let item = |(index, proposal): (usize, Proposal)| {
            let kind = match proposal.kind {
                ProposalKind::Field => 5,
                ProposalKind::Node => 7,
                ProposalKind::Link => 6,
                ProposalKind::Parameter => 21,
                ProposalKind::Choice => 20,
                ProposalKind::Value => 12,
                ProposalKind::Unit => 11,
                ProposalKind::File => 17,
                ProposalKind::Keyword => 14,
            };
            let mut item = json!({
                "label": proposal.label,
                "kind": kind,
                "sortText": format!("{index:04}"),
                "textEdit": { "range": range, "newText": subject.lines.with_ends(&insert_text(&proposal.insert, snippets)) },
                "insertTextFormat": if snippets && proposal.insert.contains("$0") { 2 } else { 1 },
            });
            // Editors filter the proposals by comparing the typed text with the label. If they would drop this proposal, give them another
            // text to compare with.
            if !has_letters(&proposal.label, typed) {
                item["filterText"] = typed.into();
            }
            if !proposal.detail.is_empty() {
                item["detail"] = proposal.detail.into();
            }
            if !proposal.doc.is_empty() {
                item["documentation"] = markup(proposal.doc, markdown);
            }
            item
        };
        let items: Vec<_> = found.list.into_iter().enumerate().map(item).collect();
        // Mark the list as incomplete, so that editors request it again after each typed letter.
        Ok(json!({ "isIncomplete": true, "items": items }))
    }

    fn hover(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, RequestError> {
        let last = self.last_run(&subject.path);
        let library = self.library(&subject.path, &subject.options);
        let Some((span, words)) = super::hover::hover(&library, subject.lines.text(), at, &last)
        else {
            return Ok(Json::Null);
        };
        let contents = markup(words, self.client.hovers_markdown);
        Ok(json!({ "contents": contents, "range": subject.lines.range(span) }))
    }

    fn definition(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, RequestError> {
        let catalog = self.catalog.clone();
        let mut found = Vec::new();
        for named in self.project.symbol_at(&subject.path, at, &catalog, &subject.options) {
            found.extend(self.project.declaration(&named.symbol, &catalog, &subject.options));
        }
        if found.is_empty() {
            let library = self.library(&subject.path, &subject.options);
            let files = outline::files(&library, subject.lines.text()).into_iter();
            let file = files.filter(|(span, _)| span.start <= at && at <= span.end);
            found.extend(file.map(|(_, file)| Occurrence {
                file,
                span: Span::default(),
                declares: true,
                is_field: false,
            }));
        }
        Ok(self.locations(&found))
    }

    fn references(
        &mut self,
        subject: &Subject<'_>,
        at: usize,
        declares: bool,
    ) -> Result<Json, RequestError> {
        let catalog = self.catalog.clone();
        let mut found = Vec::new();
        for named in self.project.symbol_at(&subject.path, at, &catalog, &subject.options) {
            found.extend(self.project.places(&named.symbol, &catalog, &subject.options));
        }
        found.retain(|place| declares || !place.declares);
        Ok(self.locations(&found))
    }

    fn locations(&self, found: &[Occurrence]) -> Json {
        let mut texts: BTreeMap<&Path, Arc<str>> = BTreeMap::new();
        for place in found {
            texts.entry(&place.file).or_insert_with(|| self.text(&place.file));
        }
        let lines: BTreeMap<&Path, Lines<'_>> = texts
            .iter()
            .map(|(path, text)| (*path, Lines::new(text, self.client.columns)))
            .collect();
        found
            .iter()
            .map(|place| {
                let range = lines
                    .get(&*place.file)
                    .map(|lines| lines.range(place.span))
                    .unwrap_or_default();
                json!({ "uri": self.uri(&place.file), "range": range })
            })
            .collect()
    }

    fn highlights(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, RequestError> {
        let catalog = self.catalog.clone();
        let wanted = self.project.symbol_at(&subject.path, at, &catalog, &subject.options);
        let names = self.project.names(&subject.path, &catalog, &subject.options);
        fn is_wanted(symbol: &Symbol, wanted: &[maquette_edit::NameOccurrence]) -> bool {
            wanted.iter().any(|named| named.symbol == *symbol)
        }
        let same = names.all.iter().filter(|named| is_wanted(&named.symbol, &wanted));
        let shown = same.map(|named| {
            let kind = if named.is_declaration { 3 } else { 2 };
            json!({ "range": subject.lines.range(named.span), "kind": kind })
        });
        Ok(shown.collect())
    }

    fn prepare_rename(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, RequestError> {
        let catalog = self.catalog.clone();
        let named = self.project.symbol_at(&subject.path, at, &catalog, &subject.options);
        let Some(named) = named.first() else {
            return Err(RequestError::Failed(
                "there is no name of this project at this position".into(),
            ));
        };
        let range = subject.lines.range(named.span);
        Ok(json!({ "range": range, "placeholder": named.symbol.name }))
    }

    fn rename(&mut self, subject: &Subject<'_>, at: usize, to: &str) -> Result<Json, RequestError> {
        let catalog = self.catalog.clone();
        let named = self.project.symbol_at(&subject.path, at, &catalog, &subject.options);
        let Some(named) = named.first() else {
            return Err(RequestError::Failed(
                "there is no name of this project at this position".into(),
            ));
        };
        let to = if named.is_field { name_of(to) } else { to.to_owned() };
        let words = self.project.rename(&named.symbol, &to, &catalog, &subject.options)?;
        let mut changes = BTreeMap::new();
        for (file, words) in words {
            let text = self.text(&file);
            let lines = Lines::new(&text, self.client.columns);
            let edits = words.into_iter().map(|(span, word)| lines.edit(span, word));
            let edits = edits.collect::<Vec<_>>();
            changes.insert(self.uri(&file).0, json!(edits));
        }
        Ok(json!({ "changes": changes }))
    }

    /// Returns the edits that change files to the given new texts, in the form of the protocol. Files that do not exist are created.
    pub(super) fn edits(&self, texts: &Texts) -> Json {
        fn is_new(path: &Path, documents: &BTreeMap<std::path::PathBuf, crate::Document>) -> bool {
            !path.exists() && !documents.contains_key(path)
        }
        if !texts.keys().any(|path| is_new(path, &self.documents)) {
            let mut changes = BTreeMap::new();
            for (path, new) in texts {
                let text = self.text(path);
                let edit = Lines::new(&text, self.client.columns).difference(new);
                changes.insert(self.uri(path).0, json!(Vec::from_iter(edit)));
            }
            return json!({ "changes": changes });
        }
        let mut changes = Vec::new();
        for (path, new) in texts {
            let uri = self.uri(path);
            let version = self.documents.get(path).map(|document| document.version);
            if is_new(path, &self.documents) {
                changes.push(
                    json!({ "kind": "create", "uri": uri, "options": { "overwrite": false } }),
                );
            }
            let text = self.text(path);
            let edit = Lines::new(&text, self.client.columns).difference(new);
            let document = json!({ "uri": uri, "version": version });
            changes.push(json!({ "textDocument": document, "edits": Vec::from_iter(edit) }));
        }
        json!({ "documentChanges": changes })
    }

    fn links(&mut self, subject: &Subject<'_>) -> Result<Json, RequestError> {
        let library = self.library(&subject.path, &subject.options);
        let files = outline::files(&library, subject.lines.text());
        Ok(files.into_iter().map(|(span, path): (Span, std::path::PathBuf)| json!({ "range": subject.lines.range(span), "target": self.uri(&path) })).collect())
    }

    /// Returns inlay hints with the results of the last evaluation. Each hint is at the end of the first line of a node.
    fn hints(&mut self, subject: &Subject<'_>, first: u32, last_line: u32) -> Json {
        let text = subject.lines.text();
        if !self.choices.hints {
            return json!([]);
        }
        let last = self.last_run(&subject.path);
        let mut hints = Vec::new();
        for node in outline::sections(text)
            .iter()
            .filter(|it| it.name == "nodes")
            .flat_map(|it| &it.entries)
        {
            let line = subject.lines.position(node.at.start).line;
            let Some(told) =
                last.summary(&node.name).filter(|_| first <= line && line <= last_line)
            else {
                continue;
            };
            let rest = &text[node.at.start..];
            let end = node.at.start + rest.find(['\n', '\r']).unwrap_or(rest.len());
            hints.push(json!({
                "position": subject.lines.position(end),
                "label": told.format_short(),
                "paddingLeft": true,
                "tooltip": last.describe(&node.name),
            }));
        }
        hints.into()
    }

    /// Returns code lenses: one to run the graph, and one to inspect the node of each output.
    fn lenses(&mut self, subject: &Subject<'_>) -> Result<Json, RequestError> {
        let text = subject.lines.text();
        let lens = |span: Span, title: &str, command: &str, node: Option<&str>| {
            let arguments = [Some(&subject.uri.0[..]), node].into_iter().flatten();
            let arguments = arguments.collect::<Vec<_>>();
            let command = json!({ "title": title, "command": command, "arguments": arguments });
            json!({ "range": subject.lines.range(span), "command": command })
        };
        let start = text.find(first_word(text)).unwrap_or(0);
        let first = Span { start, end: start };
        // Only graphs and patches can be watched. A file of another kind, such as an unfinished one, gets no code lenses.
        let title = match first_word(text) {
            "Sweep" => "run all",
            "Test" => "test",
            "Graph" | "Patch" => "run",
            _ => return Ok(json!([])),
        };
        let mut lenses = vec![lens(first, title, "maquette.run", None)];
        if title != "run" {
            return Ok(lenses.into());
        }
        lenses.push(match self.commands.watches(&subject.path) {
            true => lens(first, "stop", "maquette.stop", None),
            false => lens(first, "watch", "maquette.watch", None),
        });
        let scope = super::scope::Scope::parse(text);
        for node in &scope.nodes {
            if scope
                .outputs
                .iter()
                .any(|output| output.kind.split(['.', '/']).next() == Some(&node.name.text))
                && lenses.len() < MAX_ITEMS
            {
                let name = Some(&node.name.text[..]);
                lenses.push(lens(node.name.span, "inspect", "maquette.inspect", name));
                lenses.push(lens(node.name.span, "why", "maquette.why", name));
            }
        }
        Ok(lenses.into())
    }
}

/// Returns the text that a proposal inserts. If the editor does not support snippets, removes the cursor mark `$0`.
fn insert_text(insert: &str, snippets: bool) -> String {
    match insert.contains("$0") {
        true if snippets => {
            let (before, behind) = insert.split_once("$0").unwrap_or((insert, ""));
            fn escape(text: &str) -> String {
                text.replace('\\', "\\\\").replace('$', "\\$").replace('}', "\\}")
            }
            format!("{}$0{}", escape(before), escape(behind))
        }
        _ => insert.replace("$0", ""),
    }
}

/// Returns a text as Markdown, or as plain text if the editor does not support Markdown.
fn markup(words: String, markdown: bool) -> Json {
    if markdown {
        return json!({ "kind": "markdown", "value": words });
    }
    let lines = words.lines().filter(|line| !line.starts_with("```"));
    let lines = lines.map(|line| line.trim_start_matches('#').replace("**", "").replace('`', ""));
    json!({ "kind": "plaintext", "value": lines.collect::<Vec<_>>().join("\n") })
}

fn folds(lines: &Lines<'_>) -> Json {
    let (brackets, comments) = outline::folds(lines.text());
    let fold = |span: Span, kind: Option<&str>| {
        let (first, last) = (lines.position(span.start).line, lines.position(span.end).line);
        // Do not fold the last line of a bracket, so that the closing bracket stays visible.
        let last = if kind.is_none() { last.saturating_sub(1) } else { last };
        let mut fold = json!({ "startLine": first, "endLine": last });
        if let Some(kind) = kind {
            fold["kind"] = kind.into();
        }
        (first < last).then_some(fold)
    };
    let brackets = brackets.into_iter().filter_map(|span| fold(span, None));
    let comments = comments.into_iter().filter_map(|span| fold(span, Some("comment")));
    brackets.chain(comments).collect()
}

fn colors(lines: &Lines<'_>) -> Json {
    outline::colors(lines.text())
        .into_iter()
        .take(MAX_ITEMS)
        .map(|(span, rgb): (Span, [u8; 3])| {
            let [red, green, blue] = rgb.map(|level| f64::from(level) / 255.0);
            let color = json!({ "red": red, "green": green, "blue": blue, "alpha": 1.0 });
            json!({ "range": lines.range(span), "color": color })
        })
        .collect()
}

/// Returns the semantic tokens (for highlighting) of some lines. The protocol requires that each position is relative to the previous
/// token.
fn words(lines: &Lines<'_>, first: u32, last: u32) -> Json {
    let mut data: Vec<u32> = Vec::new();
    let (mut line, mut column) = (0, 0);
    for (span, meaning) in outline::words(lines.text()) {
        let range = lines.range(span);
        if range.start.line < first || last < range.start.line {
            continue;
        }
        let place = MEANINGS.iter().position(|(known, _)| *known == meaning).unwrap_or(0);
        let delta = range.start.line - line;
        let start = if delta == 0 { range.start.character - column } else { range.start.character };
        let length = range.end.character.saturating_sub(range.start.character);
        let declares = u32::from(meaning == Meaning::Declaration);
        data.extend([delta, start, length, u32::try_from(place).unwrap_or(0), declares]);
        (line, column) = (range.start.line, range.start.character);
    }
    json!({ "data": data })
}
