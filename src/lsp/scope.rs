//! The names that a text declares, as far as it is written: for what links, parameters and patches may name.

use maquette_syntax::error::Span;
use maquette_syntax::{Frame, Name, Passed, TypedKind, each_word};

/// What a text declares.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Scope {
    /// `Graph`, `Patch` or `Test`: the first word.
    pub(super) file: String,
    pub(super) uses: Vec<Declared>,
    pub(super) inputs: Vec<Declared>,
    pub(super) params: Vec<Declared>,
    pub(super) nodes: Vec<Declared>,
    pub(super) outputs: Vec<Declared>,
    /// The graph that a patch or a test is about.
    pub(super) about: Option<Name>,
}

/// An entry of a section.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Declared {
    pub(super) name: Name,
    /// Its type; of a used graph, its path; of an output, its link.
    pub(super) kind: String,
    /// Of a `ForEach`, the type of its nodes; of a parameter, its unit.
    pub(super) of: String,
    /// Where the word or text of `kind` stands.
    pub(super) at: Span,
}

impl Scope {
    pub(super) fn of(text: &str) -> Self {
        let mut scope = Self::default();
        each_word(text, |frames, passed| scope.see(frames, &passed));
        scope
    }

    fn see(&mut self, frames: &[Frame], passed: &Passed<'_>) {
        let field = |frame: &'_ Frame| frame.field.as_ref().map(|field| field.text.clone());
        match (frames, passed) {
            ([], Passed::Word(word, TypedKind::Word)) if self.file.is_empty() => {
                self.file.clone_from(&word.text);
            }
            ([file], Passed::Word(word, TypedKind::Text))
                if matches!(field(file).as_deref(), Some("of" | "graph")) =>
            {
                self.about = Some((*word).clone());
            }
            ([file, section], Passed::Name(name)) if section.bracket == '{' => {
                let of = String::new();
                let entry =
                    Declared { name: (*name).clone(), kind: String::new(), of, at: name.span };
                self.section(field(file).as_deref())
                    .into_iter()
                    .for_each(|all| all.push(entry.clone()));
            }
            ([file, section, rest @ ..], Passed::Word(word, _)) if section.bracket == '{' => {
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
                    // `Graph("lib/skirt.ron", version: "2.1")`.
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

    fn section(&mut self, name: Option<&str>) -> Option<&mut Vec<Declared>> {
        match name? {
            "use" => Some(&mut self.uses),
            "inputs" => Some(&mut self.inputs),
            "params" => Some(&mut self.params),
            "nodes" => Some(&mut self.nodes),
            "outputs" => Some(&mut self.outputs),
            _ => None,
        }
    }

    /// The node or input of this name.
    pub(super) fn node(&self, name: &str) -> Option<&Declared> {
        self.nodes.iter().chain(&self.inputs).find(|node| node.name.text == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broken_text_still_declares_what_it_has() {
        let scope = Scope::of(
            r#"Graph(format: 1, use: { "Nose": "lib/nose.ron", "Ear": Graph("lib/ear.ron", version: "1") },
            inputs: { "scan": Optional(RangeImage(doc: "x")) },
            params: { "growth": Number(default: 1.0, unit: "mm", "#,
        );
        fn told(all: &[Declared]) -> String {
            all.iter()
                .map(|it| format!("{}={}/{}", it.name.text, it.kind, it.of))
                .collect::<Vec<_>>()
                .join(" ")
        }
        assert_eq!(scope.file, "Graph");
        assert_eq!(told(&scope.uses), "Nose=lib/nose.ron/ Ear=lib/ear.ron/");
        assert_eq!(told(&scope.inputs), "scan=RangeImage/");
        assert_eq!(told(&scope.params), "growth=Number/mm");
        let nodes = Scope::of(r#"Graph(nodes: { "a": Read(path: "x", b: [C(graph: "no")]), "eyes": ForEach(graph: "Eye", over: [(x: 1)"#).nodes;
        assert_eq!(told(&nodes), "a=Read/ eyes=ForEach/Eye");
    }
}
