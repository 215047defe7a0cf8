//! The names that a text declares, and to which links, parameters and patches may refer. The text may be unfinished.

use maquette_syntax::error::Span;
use maquette_syntax::{Frame, Name, TypedKind, WalkEvent, for_each_word};

/// The names that a text declares.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Scope {
    /// The first word of the file, such as `Graph`, `Patch` or `Test`.
    pub(super) file: String,
    pub(super) uses: Vec<Declaration>,
    pub(super) inputs: Vec<Declaration>,
    pub(super) params: Vec<Declaration>,
    pub(super) nodes: Vec<Declaration>,
    pub(super) outputs: Vec<Declaration>,
    /// The path of the graph that a patch or test is about, as the file writes it.
    pub(super) target: Option<Name>,
}

/// A name that is declared by an entry of a section, such as a node.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Declaration {
    pub(super) name: Name,
    /// The type of a node, input or parameter; the path of a used graph; or the link of an output.
    pub(super) kind: String,
    /// The node type that a `ForEach` repeats, or the unit of a parameter.
    pub(super) of: String,
    /// The span of the text in `kind`.
    pub(super) at: Span,
}

impl Scope {
    pub(super) fn parse(text: &str) -> Self {
        let mut scope = Self::default();
        for_each_word(text, |frames, passed| scope.visit(frames, &passed));
        scope
    }

    fn visit(&mut self, frames: &[Frame], passed: &WalkEvent<'_>) {
        fn field(frame: &Frame) -> Option<String> {
            frame.field.as_ref().map(|field| field.text.clone())
        }
        match (frames, passed) {
            ([], WalkEvent::Word(word, TypedKind::Word)) if self.file.is_empty() => {
                self.file.clone_from(&word.text);
            }
            ([file], WalkEvent::Word(word, TypedKind::Text))
                if matches!(field(file).as_deref(), Some("of" | "graph")) =>
            {
                self.target = Some((*word).clone());
            }
            ([file, section], WalkEvent::Name(name)) if section.bracket == '{' => {
                let of = String::new();
                let entry =
                    Declaration { name: (*name).clone(), kind: String::new(), of, at: name.span };
                self.section(field(file).as_deref())
                    .into_iter()
                    .for_each(|all| all.push(entry.clone()));
            }
            ([file, section, rest @ ..], WalkEvent::Word(word, _)) if section.bracket == '{' => {
                let Some(key) = &section.field else { return };
                let inner = rest.last().and_then(|frame| frame.field.as_ref());
                let Some(all) = self.section(field(file).as_deref()) else { return };
                let Some(entry) = all.last_mut().filter(|entry| entry.name.span == key.span) else {
                    return;
                };
                let is_optional = rest.len() == 1 && entry.kind == "Optional";
                if rest.is_empty() && entry.kind.is_empty() || is_optional {
                    (entry.kind, entry.at) = (word.text.clone(), word.span);
                } else if rest.len() == 1 && entry.kind == "Graph" {
                    // The path of a used graph may be an argument: `Graph("lib/skirt.ron", version: "2.1")`.
                    if inner.is_none() {
                        (entry.kind, entry.at) = (word.text.clone(), word.span);
                    }
                } else if rest.len() == 1
                    && inner.is_some_and(|it| it.text == "graph" || it.text == "unit")
                {
                    entry.of.clone_from(&word.text);
                }
            }
            _ => {}
        }
    }

    fn section(&mut self, name: Option<&str>) -> Option<&mut Vec<Declaration>> {
        match name? {
            "use" => Some(&mut self.uses),
            "inputs" => Some(&mut self.inputs),
            "params" => Some(&mut self.params),
            "nodes" => Some(&mut self.nodes),
            "outputs" => Some(&mut self.outputs),
            _ => None,
        }
    }

    /// Returns the node or input with this name.
    pub(super) fn node(&self, name: &str) -> Option<&Declaration> {
        self.nodes.iter().chain(&self.inputs).find(|node| node.name.text == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_invalid_text_has_declarations() {
        let scope = Scope::parse(
            r#"Graph(format: 1, use: { "Nose": "lib/nose.ron", "Ear": Graph("lib/ear.ron", version: "1") },
            inputs: { "scan": Optional(RangeImage(doc: "x")) },
            params: { "growth": Number(default: 1.0, unit: "mm", "#,
        );
        fn format_declarations(all: &[Declaration]) -> String {
            all.iter()
                .map(|it| format!("{}={}/{}", it.name.text, it.kind, it.of))
                .collect::<Vec<_>>()
                .join(" ")
        }
        assert_eq!(scope.file, "Graph");
        assert_eq!(format_declarations(&scope.uses), "Nose=lib/nose.ron/ Ear=lib/ear.ron/");
        assert_eq!(format_declarations(&scope.inputs), "scan=RangeImage/");
        assert_eq!(format_declarations(&scope.params), "growth=Number/mm");
        let nodes = Scope::parse(r#"Graph(nodes: { "a": Read(path: "x", b: [C(graph: "no")]), "eyes": ForEach(graph: "Eye", over: [(x: 1)"#).nodes;
        assert_eq!(format_declarations(&nodes), "a=Read/ eyes=ForEach/Eye");
    }
}
