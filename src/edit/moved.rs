//! What it takes to move nodes from one graph file into another: entries with their comments, paths, values in place of parameters.

mod entries;
mod known;
mod same;
mod values;

pub(super) use entries::{gap_behind, indented_entries, moved, part_with, put_in_place};
pub(super) use known::{Known, Linked};
use maquette_graph::load::load_whole;
use maquette_graph::tree::is_patch;
use maquette_graph::world::World;
use maquette_graph::{Files, Options, Refusal};
use maquette_syntax::error::{Problem, Span, code};
use maquette_syntax::{parse, syntax_problems};
pub(super) use same::Sides;
pub(super) use values::{Given, expression, put_values};

use super::Judge;

impl Judge<'_> {
    /// What a graph says and computes whose nodes are to be moved.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub(super) fn sound(&self, text: &str) -> Result<(Known, Sides), Vec<Problem>> {
        let options = Options { files: Files::Inside, draft: false, ..self.options.clone() };
        let (checked, known) = load_whole(
            self.path,
            text.to_owned(),
            self.catalog,
            &options,
            |world: &mut World<'_>, whole| {
                let is_patched = whole.definition.is_patched();
                (!is_patched).then(|| Known::of(world, whole.clone()))
            },
        );
        let sides = self.sides(text, &checked).ok();
        known.flatten().zip(sides).ok_or_else(|| self.unsound(text))
    }

    /// What is wrong with a graph whose nodes cannot be moved.
    fn unsound(&self, text: &str) -> Vec<Problem> {
        let (tree, mistakes) = parse(text);
        if !mistakes.is_empty() {
            return syntax_problems(self.path, text, mistakes);
        }
        if is_patch(&tree) {
            let message = "a patch has values of nodes, but no nodes of its own".to_owned();
            let help = "do it in the graph that it is `of`".to_owned();
            let span = tree.name().map_or(tree.span, |name| name.span);
            return self.refuse(text, Refusal { code: code::SYNTAX, span, message, help });
        }
        self.computed(text).err().unwrap_or_default()
    }

    /// The options by which a text is understood: no file that its nodes read is looked at.
    pub(super) fn reading(&self) -> Options {
        let Options { roots, texts, .. } = self.options.clone();
        Options { roots, texts, files: Files::Ignored, ..Options::default() }
    }

    pub(super) fn refuse(&self, text: &str, refusal: Refusal) -> Vec<Problem> {
        vec![self.refused(text, refusal)]
    }
}

pub(super) fn refusal(
    code: &'static str,
    span: Span,
    message: impl Into<String>,
    help: impl Into<String>,
) -> Refusal {
    Refusal { code, span, message: message.into(), help: help.into() }
}

/// A name that is free: the first of these, or else the last one with a number behind it.
pub(super) fn free_name(
    wanted: impl IntoIterator<Item = String>,
    number: impl Fn(&str, usize) -> String,
    is_free: impl Fn(&str) -> bool,
) -> String {
    let mut last = String::new();
    for name in wanted {
        if is_free(&name) {
            return name;
        }
        last = name;
    }
    let mut numbered = (2..).map(|count| number(&last, count));
    numbered.find(|name| is_free(name)).unwrap_or(last)
}
