//! What a graph gives: files, each in a format that its value has, and what is expected of values.

use std::collections::HashMap;
use std::path::Path;

use super::check::{Check, Draft};
use super::file::Tree;
use super::paths::stays_inside;
use super::{GraphOutput, with_article};
use crate::error::{Span, code};
use crate::golden::Expectation;
use crate::node::ending;
use crate::value::ValueType;

impl Check<'_> {
    pub(super) fn outputs(
        &mut self,
        entries: &[(Tree, Tree)],
        drafts: &[Draft<'_>],
    ) -> Vec<GraphOutput> {
        let names: HashMap<String, usize> = drafts
            .iter()
            .enumerate()
            .map(|(index, draft)| (draft.name.text.clone(), index))
            .collect();
        let mut outputs: Vec<GraphOutput> = Vec::with_capacity(entries.len());
        for (key, value) in entries {
            let Some(name) = key.text() else {
                let message = format!("the name of an output is a text, not {}", key.in_words());
                self.find(code::BAD_NAME, key.span, message, "write \"name.ply\": \"node\"");
                continue;
            };
            if !stays_inside(name) {
                let message = format!("output `{name}` lies outside of the folder of outputs");
                self.find(
                    code::OUTSIDE,
                    key.span,
                    message,
                    "name a file, such as \"model.ply\"; --out chooses the folder",
                );
                continue;
            }
            if outputs.iter().any(|before| before.name == name) {
                self.find(
                    code::BAD_NAME,
                    key.span,
                    format!("there is already an output `{name}`"),
                    "",
                );
                continue;
            }
            let Some(link) = value.text() else {
                let message = format!("output `{name}` wants a link, not {}", value.in_words());
                self.find(
                    code::WRONG_VALUE,
                    value.span,
                    message,
                    "write \"node\" or \"node.output\"",
                );
                continue;
            };
            let Some((node, output)) = self.target(link, value.span, drafts, &names) else {
                continue;
            };
            let kind = drafts[node].types.get(output).copied().flatten();
            let ending = ending(Path::new(name));
            let format = kind.and_then(|kind| self.catalog.format(kind, &ending));
            if let Some(format) = format {
                let (name, format) = (name.to_owned(), *format);
                outputs.push(GraphOutput { name, node, output, format, span: key.span });
            } else if kind.is_some() || !self.catalog.endings(None).contains(&&ending[..]) {
                self.no_format(name, &ending, kind, key.span);
            }
        }
        outputs
    }

    /// What the graph expects of its values; each must be there.
    pub(super) fn expectations(
        &mut self,
        tree: Option<&Tree>,
        drafts: &[Draft<'_>],
    ) -> Vec<(Expectation, Span)> {
        let Some(tree) = tree else { return Vec::new() };
        let (expectations, findings) = Expectation::read_all(tree);
        self.findings.extend(findings);
        let names: HashMap<String, usize> =
            (0..drafts.len()).map(|index| (drafts[index].name.text.clone(), index)).collect();
        for (expectation, span) in &expectations {
            for value in expectation.values() {
                self.target(value, *span, drafts, &names);
            }
        }
        expectations
    }

    fn no_format(&mut self, name: &str, ending: &str, kind: Option<&ValueType>, span: Span) {
        let known = self.catalog.endings(kind);
        let what = kind.map_or_else(|| "a value".to_owned(), |kind| with_article(kind.name));
        let message = match ending {
            "" => format!("output `{name}` has no ending that says how to write {what}"),
            _ => format!("{what} cannot be written to a `.{ending}` file"),
        };
        let help = match (known.is_empty(), kind) {
            (true, _) => format!("{what} has no file format"),
            (false, _) => format!("{what} can be written to: {}", known.join(", ")),
        };
        self.find(code::OUTPUT_FORMAT, span, message, help);
    }
}
