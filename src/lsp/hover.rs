//! Hover: the documentation of the word under the pointer.

use maquette_syntax::error::Span;
use maquette_syntax::{Cursor, TypedKind, cursor, unit_names, variants};
use serde_json::Value as Json;

use super::expected_syntax::{BracketContent, ExpectedSyntax, SyntaxResolver, fields_of};
use super::last_run::LastRun;
use super::library::{Library, NodeKind};
use super::scope::{Declaration, Scope};

/// Returns the documentation of the word at the offset `at` as Markdown, and the span of the word.
pub(super) fn hover(
    library: &Library<'_>,
    text: &str,
    at: usize,
    last: &LastRun,
) -> Option<(Span, String)> {
    // Put the cursor at the end of the word, because only the text before a cursor counts as typed.
    let whole = cursor(text, at).typed;
    if matches!(whole.kind, TypedKind::Nothing | TypedKind::Comment)
        || whole.span.start == whole.span.end
    {
        return None;
    }
    let cursor = cursor(text, whole.span.end);
    let scope = Scope::parse(text);
    let (inside, slot) = SyntaxResolver { library, scope: &scope }.resolve(&cursor.frames);
    let word = &text[whole.span.start..whole.span.end];
    let hover =
        Hover { library, scope: &scope, cursor: &cursor, last, word, at: at - whole.span.start };
    let words = hover.describe(&inside, &slot)?;
    Some((whole.span, words))
}

struct Hover<'a> {
    library: &'a Library<'a>,
    scope: &'a Scope,
    cursor: &'a Cursor,
    last: &'a LastRun,
    word: &'a str,
    /// The byte offset of the pointer from the start of the word.
    at: usize,
}

impl Hover<'_> {
    fn describe(&self, inside: &BracketContent, slot: &ExpectedSyntax) -> Option<String> {
        let frame = self.cursor.frames.last();
        let is_name = frame.is_some_and(|frame| {
            frame.field.is_none()
                || frame.field.as_ref().is_some_and(|it| it.span == self.cursor.typed.span)
        });
        match inside {
            BracketContent::Fields(owner, fields) if is_name => {
                let field = fields.iter().find(|field| field.name == self.word)?;
                let head = match field.takes.is_empty() {
                    true => format!("**{}** of {owner}", field.name),
                    false => format!("**{}**: `{}`", field.name, field.takes),
                };
                Some(paragraphs([head, field.doc.clone()]))
            }
            BracketContent::Entries(_) if is_name => self.key(),
            _ => self.value(slot),
        }
    }

    /// Describes a name that the file declares, such as the name of a node or parameter. Returns `None` for any other word.
    fn key(&self) -> Option<String> {
        let section = self.cursor.frames.get(1).filter(|_| self.cursor.frames.len() == 2);
        section?;
        let section = self.cursor.frames[0].field.as_ref()?;
        match &section.text[..] {
            "nodes" | "inputs" => self.node(self.word),
            "params" => self.parameter(self.word),
            _ => None,
        }
    }

    fn value(&self, slot: &ExpectedSyntax) -> Option<String> {
        match (slot, self.cursor.typed.kind) {
            (ExpectedSyntax::Link(_) | ExpectedSyntax::Expected, TypedKind::Text) => {
                let output = self.scope.outputs.iter().find(|output| output.name.text == self.word);
                match (slot, output) {
                    (ExpectedSyntax::Expected, Some(output)) => {
                        Some(format!("output **{}**: `{}`", self.word, output.kind))
                    }
                    _ => self.link(self.word),
                }
            }
            (ExpectedSyntax::ParameterName, TypedKind::Text) => self.parameter(self.word),
            (ExpectedSyntax::Expression, TypedKind::Text) => {
                fn is_part(c: char) -> bool {
                    c.is_ascii_alphanumeric() || c == '-' || c == '_'
                }
                let start = self.word[..self.at].trim_end_matches(is_part).len();
                let rest = &self.word[start..];
                let name = &rest[..rest.find(|c| !is_part(c)).unwrap_or(rest.len())];
                self.parameter(name).or_else(|| of_language("Expr", name))
            }
            (ExpectedSyntax::NodeType, TypedKind::Text)
            | (ExpectedSyntax::Node, TypedKind::Word) => {
                self.kind(self.word).or_else(|| of_language("nodes", self.word))
            }
            (ExpectedSyntax::Use | ExpectedSyntax::Path(_), TypedKind::Text) => {
                let path = self.library.resolve(self.word);
                let found = std::fs::metadata(&path).ok();
                let size = found.map_or("the file does not exist".to_owned(), |it| {
                    format!("{} bytes", it.len())
                });
                Some(format!("`{}`: {size}", path.display()))
            }
            (ExpectedSyntax::Parameter | ExpectedSyntax::Input, TypedKind::Word) => of_language(
                if matches!(slot, ExpectedSyntax::Input) { "inputs" } else { "params" },
                self.word,
            ),
            (ExpectedSyntax::Value { schema, root }, TypedKind::Word) => self.choice(schema, root),
            (_, TypedKind::Word) => of_language("", self.word),
            _ => None,
        }
    }

    /// Describes an enum variant, a unit or a keyword.
    fn choice(&self, schema: &Json, root: &Json) -> Option<String> {
        if unit_names().any(|unit| unit == self.word) {
            return Some(format!(
                "**{}**: a number in this unit; `maquette help units` explains more",
                self.word
            ));
        }
        let place = variants(schema).iter().position(|(name, _)| *name == self.word);
        let Some(place) = place else { return of_language("", self.word) };
        let doc =
            schema["oneOf"].as_array().and_then(|all| all.get(place)?["description"].as_str());
        let takes =
            variants(schema)[place].1.map(|content| super::expected_syntax::takes(content, root));
        let head = match takes {
            Some(takes) => format!(
                "**{}**{}",
                self.word,
                if takes.is_empty() { String::new() } else { format!(": `{takes}`") }
            ),
            None => format!("**{}**", self.word),
        };
        Some(paragraphs([head, doc.unwrap_or_default().to_owned()]))
    }

    fn link(&self, link: &str) -> Option<String> {
        let (node, output) = link.split_once('.').unwrap_or((link, ""));
        let declared = self.scope.node(node.split('/').next()?)?;
        let kind = self.kind_of(declared);
        let outputs = kind.as_ref().map(|kind| &kind.outputs[..]).unwrap_or_default();
        let found = outputs.iter().find(|(name, _)| name == output || output.is_empty());
        let gives = found.map_or_else(|| declared.kind.clone(), |(_, types)| types.join(" or "));
        let promised = kind.iter().flat_map(|kind| &kind.promises);
        let promised = promised.filter(|(name, _)| found.is_some_and(|(found, _)| found == name));
        let promised = promised.map(|(_, words)| &words[..]).collect::<Vec<_>>().join(", ");
        let promised =
            if promised.is_empty() { String::new() } else { format!("promised: {promised}") };
        let head = format!("**{link}**: `{gives}` of {}", declared.kind);
        Some(paragraphs([head, promised, self.last.describe(link)]))
    }

    fn node(&self, name: &str) -> Option<String> {
        let declared = self.scope.node(name)?;
        let description = match self.kind_of(declared) {
            Some(kind) => first_paragraph(kind.schema["description"].as_str().unwrap_or_default()),
            None => String::new(),
        };
        let head = format!("**{name}**: {}", declared.kind);
        Some(paragraphs([head, description, self.last.describe(name)]))
    }

    fn kind_of(&self, declared: &Declaration) -> Option<std::rc::Rc<NodeKind>> {
        let name = if declared.kind == "ForEach" { &declared.of } else { &declared.kind };
        self.library.kind(self.scope, name)
    }

    /// Describes a node type: its purpose, ports, parameters, and outputs.
    fn kind(&self, name: &str) -> Option<String> {
        let kind = self.library.kind(self.scope, name)?;
        let fields = fields_of(&kind.schema, &kind.schema);
        let rows = fields
            .iter()
            .map(|field| {
                let mark = if field.required { "" } else { "?" };
                format!("    {}{mark}: {}\n", field.name, field.takes)
            })
            .collect::<String>();
        let gives =
            kind.outputs.iter().map(|(name, types)| format!("{name}: {}", types.join(" or ")));
        let gives = gives.collect::<Vec<_>>().join(", ");
        let from = match &kind.file {
            Some(_) => format!("graph `{}`", kind.from),
            None => format!("pack {}", kind.from),
        };
        let doc = kind.schema["description"].as_str().unwrap_or_default().to_owned();
        let head = format!("**{name}** ({from})");
        Some(paragraphs([head, doc, rows, format!("gives {gives}"), kind.exactness.clone()]))
    }

    fn parameter(&self, name: &str) -> Option<String> {
        let declared = self.scope.params.iter().find(|it| it.name.text == name)?;
        let described = self.last.parameter(name);
        let Some((takes, doc)) = described else {
            return Some(format!("parameter **{name}**: {} {}", declared.kind, declared.of));
        };
        Some(paragraphs([format!("parameter **{name}**: `{takes}`"), doc]))
    }
}

/// Returns the documentation of a keyword. `within` is the name of the call or field that contains it.
fn of_language(within: &str, word: &str) -> Option<String> {
    let doc = Library::word(within, word);
    (!doc.is_empty()).then(|| format!("**{word}**\n\n{doc}"))
}

fn first_paragraph(text: &str) -> String {
    text.split("\n\n").next().unwrap_or_default().to_owned()
}

fn paragraphs(parts: impl IntoIterator<Item = String>) -> String {
    let parts = parts.into_iter().filter(|part| !part.trim().is_empty());
    parts.map(|part| part.trim_end().to_owned()).collect::<Vec<_>>().join("\n\n")
}
