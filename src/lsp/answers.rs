//! The answers to an editor's requests.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use gen_lsp_types::{
    CodeActionParams, CodeLensParams, ColorPresentationParams, CompletionParams, DefinitionParams,
    DocumentColorParams, DocumentFormattingParams, DocumentHighlightParams, DocumentLinkParams,
    DocumentSymbolParams, FoldingRangeParams, HoverParams, InlayHintParams, PrepareRenameParams,
    ReferenceParams, RenameParams, SemanticTokensParams, TextDocumentPositionParams, Uri,
};
use maquette_edit::Symbol;
use maquette_graph::name_of;
use maquette_syntax::error::Span;
use maquette_syntax::first_word;
use serde_json::{Value as Json, json};

use super::completion::{Proposal, Sort, proposals};
use super::outline::{self, MEANINGS, Meaning};
use super::place::Lines;
use super::project::{Found, Texts};
use super::{Refused, Server, Subject, read};

/// Most clients show no more colors or lenses of one text.
const MOST: usize = 2_000;

impl Server {
    pub(super) fn answer(&mut self, method: &str, params: Json) -> Result<Json, Refused> {
        match method {
            "textDocument/completion" => {
                let asked: CompletionParams = read(params)?;
                self.at(&asked.text_document_position_params, Self::completion)
            }
            "textDocument/hover" => {
                let asked: HoverParams = read(params)?;
                self.at(&asked.text_document_position_params, Self::hover)
            }
            "textDocument/definition" => {
                let asked: DefinitionParams = read(params)?;
                self.at(&asked.text_document_position_params, Self::definition)
            }
            "textDocument/references" => {
                let asked: ReferenceParams = read(params)?;
                let declares = asked.context.include_declaration;
                self.at(&asked.text_document_position_params, |server, subject, at| {
                    server.references(subject, at, declares)
                })
            }
            "textDocument/documentHighlight" => {
                let asked: DocumentHighlightParams = read(params)?;
                self.at(&asked.text_document_position_params, Self::highlights)
            }
            "textDocument/prepareRename" => {
                let asked: PrepareRenameParams = read(params)?;
                self.at(&asked.text_document_position_params, Self::prepare_rename)
            }
            "textDocument/rename" => {
                let asked: RenameParams = read(params)?;
                self.at(&asked.text_document_position_params, |server, subject, at| {
                    server.rename(subject, at, &asked.new_name)
                })
            }
            "textDocument/documentSymbol" => {
                let asked: DocumentSymbolParams = read(params)?;
                self.of(&asked.text_document.uri, |_, subject| Ok(symbols(&subject.lines)))
            }
            "textDocument/foldingRange" => {
                let asked: FoldingRangeParams = read(params)?;
                self.of(&asked.text_document.uri, |_, subject| Ok(folds(&subject.lines)))
            }
            "textDocument/documentColor" => {
                let asked: DocumentColorParams = read(params)?;
                self.of(&asked.text_document.uri, |_, subject| Ok(colors(&subject.lines)))
            }
            "textDocument/colorPresentation" => {
                let asked: ColorPresentationParams = read(params)?;
                let level = |share: f32| (f64::from(share) * 255.0).round().clamp(0.0, 255.0) as u8;
                let [red, green, blue] =
                    [asked.color.red, asked.color.green, asked.color.blue].map(level);
                let label = format!("#{red:02x}{green:02x}{blue:02x}");
                let edit = json!({ "range": asked.range, "newText": label });
                Ok(json!([{ "label": label, "textEdit": edit }]))
            }
            "textDocument/documentLink" => {
                let asked: DocumentLinkParams = read(params)?;
                self.of(&asked.text_document.uri, Self::links)
            }
            "textDocument/semanticTokens/full" => {
                let asked: SemanticTokensParams = read(params)?;
                self.of(&asked.text_document.uri, |server, subject| {
                    let is_large = server.is_large(subject.lines.text());
                    Ok(if is_large { json!({ "data": [] }) } else { words(&subject.lines) })
                })
            }
            "textDocument/inlayHint" => {
                let asked: InlayHintParams = read(params)?;
                self.of(&asked.text_document.uri, |server, subject| {
                    Ok(server.hints(subject, asked.range.start.line, asked.range.end.line))
                })
            }
            "textDocument/codeLens" => {
                let asked: CodeLensParams = read(params)?;
                self.of(&asked.text_document.uri, Self::lenses)
            }
            "textDocument/codeAction" => {
                let asked: CodeActionParams = read(params)?;
                self.of(&asked.text_document.uri, |server, subject| server.actions(subject, &asked))
            }
            "codeAction/resolve" => self.resolved(params),
            "textDocument/formatting" => {
                let asked: DocumentFormattingParams = read(params)?;
                self.of(&asked.text_document.uri, |_, subject| {
                    let formatted = maquette_edit::formatted(&subject.path, subject.lines.text());
                    // What is wrong is told anyway.
                    let edit = formatted.ok().and_then(|text| subject.lines.difference(&text));
                    Ok(json!(Vec::from_iter(edit)))
                })
            }
            _ => Err(Refused::Invalid(format!("there is no method `{method}` here"))),
        }
    }

    /// An answer about a text; nothing if it is none of ours.
    pub(super) fn of(
        &mut self,
        uri: &Uri,
        answer: impl FnOnce(&mut Self, &Subject<'_>) -> Result<Json, Refused>,
    ) -> Result<Json, Refused> {
        let mut text = Arc::from("");
        match self.subject(uri, &mut text) {
            Some(subject) => answer(self, &subject),
            None => Ok(Json::Null),
        }
    }

    /// The same about a place in it.
    fn at(
        &mut self,
        asked: &TextDocumentPositionParams,
        answer: impl FnOnce(&mut Self, &Subject<'_>, usize) -> Result<Json, Refused>,
    ) -> Result<Json, Refused> {
        self.of(&asked.text_document.uri, |server, subject| {
            let at = subject.lines.offset(asked.position);
            answer(server, subject, at)
        })
    }

    fn completion(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, Refused> {
        let library = self.library(&subject.path, &subject.options);
        let text = subject.lines.text();
        let found = proposals(&library, text, at);
        let range = subject.lines.range(found.span);
        let snippets = self.client.snippets;
        let item = |(index, proposal): (usize, Proposal)| {
            let kind = match proposal.sort {
                Sort::Field => 5,
                Sort::Node => 7,
                Sort::Link => 6,
                Sort::Parameter => 21,
                Sort::Choice => 20,
                Sort::Value => 12,
                Sort::Unit => 11,
                Sort::File => 17,
                Sort::Keyword => 14,
            };
            let mut item = json!({
                "label": proposal.label,
                "kind": kind,
                "sortText": format!("{index:04}"),
                "textEdit": { "range": range, "newText": inserted(&proposal.insert, snippets) },
                "insertTextFormat": if snippets && proposal.insert.contains("$0") { 2 } else { 1 },
            });
            if !proposal.detail.is_empty() {
                item["detail"] = proposal.detail.into();
            }
            if !proposal.doc.is_empty() {
                item["documentation"] = json!({ "kind": "markdown", "value": proposal.doc });
            }
            item
        };
        let items = Vec::from_iter(found.list.into_iter().enumerate().map(item));
        // What fits is searched anew with each letter.
        Ok(json!({ "isIncomplete": true, "items": items }))
    }

    fn hover(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, Refused> {
        let last = self.last(&subject.path);
        let library = self.library(&subject.path, &subject.options);
        let Some((span, words)) = super::hover::hover(&library, subject.lines.text(), at, &last)
        else {
            return Ok(Json::Null);
        };
        let contents = json!({ "kind": "markdown", "value": words });
        Ok(json!({ "contents": contents, "range": subject.lines.range(span) }))
    }

    fn definition(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, Refused> {
        let catalog = self.catalog.clone();
        let mut found = Vec::new();
        for named in self.project.at(&subject.path, at, &catalog, &subject.options) {
            found.extend(self.project.declaration(&named.symbol, &catalog, &subject.options));
        }
        if found.is_empty() {
            let library = self.library(&subject.path, &subject.options);
            let files = outline::files(&library, subject.lines.text()).into_iter();
            let file = files.filter(|(span, _)| span.start <= at && at <= span.end);
            let at_start =
                |(_, file)| Found { file, span: Span::default(), declares: true, is_field: false };
            found.extend(file.map(at_start));
        }
        Ok(self.locations(&found))
    }

    fn references(
        &mut self,
        subject: &Subject<'_>,
        at: usize,
        declares: bool,
    ) -> Result<Json, Refused> {
        let catalog = self.catalog.clone();
        let mut found = Vec::new();
        for named in self.project.at(&subject.path, at, &catalog, &subject.options) {
            found.extend(self.project.places(&named.symbol, &catalog, &subject.options));
        }
        found.retain(|place| declares || !place.declares);
        Ok(self.locations(&found))
    }

    fn locations(&self, found: &[Found]) -> Json {
        let mut texts: BTreeMap<&Path, Arc<str>> = BTreeMap::new();
        for place in found {
            texts.entry(&place.file).or_insert_with(|| self.text(&place.file));
        }
        let lines: BTreeMap<&Path, Lines<'_>> = texts
            .iter()
            .map(|(path, text)| (*path, Lines::new(text, self.client.columns)))
            .collect();
        let location = |place: &Found| {
            let range =
                lines.get(&*place.file).map(|lines| lines.range(place.span)).unwrap_or_default();
            json!({ "uri": self.uri(&place.file), "range": range })
        };
        found.iter().map(location).collect()
    }

    fn highlights(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, Refused> {
        let catalog = self.catalog.clone();
        let wanted = self.project.at(&subject.path, at, &catalog, &subject.options);
        let names = self.project.names(&subject.path, &catalog, &subject.options);
        let is_wanted = |symbol: &Symbol| wanted.iter().any(|named| named.symbol == *symbol);
        let same = names.all.iter().filter(|named| is_wanted(&named.symbol));
        let shown = same.map(|named| {
            let kind = if named.declares { 3 } else { 2 };
            json!({ "range": subject.lines.range(named.span), "kind": kind })
        });
        Ok(shown.collect())
    }

    fn prepare_rename(&mut self, subject: &Subject<'_>, at: usize) -> Result<Json, Refused> {
        let catalog = self.catalog.clone();
        let named = self.project.at(&subject.path, at, &catalog, &subject.options);
        let Some(named) = named.first() else {
            return Err(Refused::Failed("there is no name of this project's here".into()));
        };
        let range = subject.lines.range(named.span);
        Ok(json!({ "range": range, "placeholder": named.symbol.name }))
    }

    fn rename(&mut self, subject: &Subject<'_>, at: usize, to: &str) -> Result<Json, Refused> {
        let catalog = self.catalog.clone();
        let named = self.project.at(&subject.path, at, &catalog, &subject.options);
        let Some(named) = named.first() else {
            return Err(Refused::Failed("there is no name of this project's here".into()));
        };
        let to = if named.is_field { name_of(to) } else { to.to_owned() };
        let words = self.project.renamed(&named.symbol, &to, &catalog, &subject.options)?;
        let mut changes = BTreeMap::new();
        for (file, words) in words {
            let text = self.text(&file);
            let lines = Lines::new(&text, self.client.columns);
            let edits = words.into_iter().map(|(span, word)| lines.edit(span, word));
            let edits = Vec::from_iter(edits);
            changes.insert(self.uri(&file).0, json!(edits));
        }
        Ok(json!({ "changes": changes }))
    }

    /// The edits that make these texts of some files; a file that is not there is made, if the editor can do that.
    pub(super) fn edits(&self, texts: &Texts) -> Json {
        let is_new = |path: &Path| !path.exists() && !self.documents.contains_key(path);
        if !texts.keys().any(|path| is_new(path)) {
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
            if is_new(path) {
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

    fn links(&mut self, subject: &Subject<'_>) -> Result<Json, Refused> {
        let library = self.library(&subject.path, &subject.options);
        let files = outline::files(&library, subject.lines.text());
        let link = |(span, path): (Span, std::path::PathBuf)| json!({ "range": subject.lines.range(span), "target": self.uri(&path) });
        Ok(files.into_iter().map(link).collect())
    }

    /// What came out last, behind the line on which each node begins.
    fn hints(&mut self, subject: &Subject<'_>, first: u32, last_line: u32) -> Json {
        let text = subject.lines.text();
        if !self.choices.hints || self.is_large(text) {
            return json!([]);
        }
        let last = self.last(&subject.path);
        let mut hints = Vec::new();
        for node in outline::sections(text)
            .iter()
            .filter(|it| it.name == "nodes")
            .flat_map(|it| &it.entries)
        {
            let line = subject.lines.position(node.at.start).line;
            let Some(told) = last.told(&node.name).filter(|_| first <= line && line <= last_line)
            else {
                continue;
            };
            let rest = &text[node.at.start..];
            let end = node.at.start + rest.find(['\n', '\r']).unwrap_or(rest.len());
            hints.push(json!({
                "position": subject.lines.position(end),
                "label": told.in_short(),
                "paddingLeft": true,
                "tooltip": last.in_words(&node.name),
            }));
        }
        hints.into()
    }

    /// What can be run: the graph, at its beginning, and what makes its outputs.
    fn lenses(&mut self, subject: &Subject<'_>) -> Result<Json, Refused> {
        let text = subject.lines.text();
        if self.is_large(text) || first_word(text) == "Test" {
            return Ok(json!([]));
        }
        let lens = |span: Span, title: &str, command: &str, node: Option<&str>| {
            let arguments = [Some(&subject.uri.0[..]), node].into_iter().flatten();
            let arguments = Vec::from_iter(arguments);
            let command = json!({ "title": title, "command": command, "arguments": arguments });
            json!({ "range": subject.lines.range(span), "command": command })
        };
        let start = text.find(first_word(text)).unwrap_or(0);
        let first = Span { start, end: start };
        let mut lenses = vec![lens(first, "run", "maquette.run", None)];
        lenses.push(match self.commands.watches(&subject.path) {
            true => lens(first, "stop", "maquette.stop", None),
            false => lens(first, "watch", "maquette.watch", None),
        });
        let scope = super::scope::Scope::of(text);
        for node in &scope.nodes {
            let makes = |output: &super::scope::Declared| {
                output.kind.split(['.', '/']).next() == Some(&node.name.text)
            };
            if scope.outputs.iter().any(makes) && lenses.len() < MOST {
                let name = Some(&node.name.text[..]);
                lenses.push(lens(node.name.span, "inspect", "maquette.inspect", name));
                lenses.push(lens(node.name.span, "why", "maquette.why", name));
            }
        }
        Ok(lenses.into())
    }
}

/// What is written for a proposal. What clients without snippets would show as a sign of one is left out.
fn inserted(insert: &str, snippets: bool) -> String {
    match insert.contains("$0") {
        true if snippets => {
            let (before, behind) = insert.split_once("$0").unwrap_or((insert, ""));
            let plain =
                |text: &str| text.replace('\\', "\\\\").replace('$', "\\$").replace('}', "\\}");
            format!("{}$0{}", plain(before), plain(behind))
        }
        _ => insert.replace("$0", ""),
    }
}

fn symbols(lines: &Lines<'_>) -> Json {
    let section = |section: &outline::Section| {
        let kind = match &section.name[..] {
            "nodes" => 12,
            "params" => 14,
            "inputs" => 13,
            "outputs" => 17,
            _ => 5,
        };
        let entry = |entry: &outline::Symbol| {
            json!({
                "name": if entry.name.is_empty() { "\"\"" } else { &entry.name },
                "detail": entry.kind,
                "kind": kind,
                "range": lines.range(entry.span),
                "selectionRange": lines.range(entry.at),
            })
        };
        let children = section.entries.iter().map(entry).collect::<Json>();
        json!({
            "name": section.name,
            "kind": if section.entries.is_empty() { 8 } else { 3 },
            "range": lines.range(section.span),
            "selectionRange": lines.range(section.at),
            "children": children,
        })
    };
    outline::sections(lines.text()).iter().map(section).collect()
}

fn folds(lines: &Lines<'_>) -> Json {
    let (brackets, comments) = outline::folds(lines.text());
    let fold = |span: Span, kind: Option<&str>| {
        let (first, last) = (lines.position(span.start).line, lines.position(span.end).line);
        // The line that closes a bracket stays.
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
    let color = |(span, rgb): (Span, [u8; 3])| {
        let [red, green, blue] = rgb.map(|level| f64::from(level) / 255.0);
        let color = json!({ "red": red, "green": green, "blue": blue, "alpha": 1.0 });
        json!({ "range": lines.range(span), "color": color })
    };
    outline::colors(lines.text()).into_iter().take(MOST).map(color).collect()
}

/// Words by what they are, each relative to the one before.
fn words(lines: &Lines<'_>) -> Json {
    let mut data: Vec<u32> = Vec::new();
    let (mut line, mut column) = (0, 0);
    for (span, meaning) in outline::words(lines.text()) {
        let range = lines.range(span);
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
