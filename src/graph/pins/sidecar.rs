//! `doll.pins.ron`: which nodes of `doll.ron` are pinned.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Problem, Source, Span, code};
use maquette_syntax::{Body, Kind, Tree, parse, syntax_problems};
use maquette_value::{Hash, plain};

use super::{Ancestry, ENDING, Pin, Pins};

impl Pins {
    /// The pins of a graph; none if there is no file of them.
    ///
    /// # Errors
    /// If the file cannot be read, or holds something else.
    pub fn of(graph: &Path) -> Result<Self, Box<Problem>> {
        let (name, folder) = (graph.with_extension(ENDING), graph.with_extension("pins"));
        let read = plain::read_text(&name);
        let text = read.as_ref().map_or_else(|_| String::new(), Clone::clone);
        let source = Arc::new(Source { name: name.clone(), text });
        let none = Self { pins: BTreeMap::new(), folder, source };
        fn wrong(span: Span, message: String, none: &Pins) -> Box<Problem> {
            let help = "pins are written by `maquette pin`; take the file away to begin anew";
            Box::new(none.problem(span, code::PIN, message, help.into()))
        }
        match read {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(none),
            Err(error) => {
                let message = format!("the file of pins cannot be read: {error}");
                return Err(wrong(Span::default(), message, &none));
            }
            Ok(_) => {}
        }
        let (tree, mistakes) = parse(&none.source.text);
        let mistakes = syntax_problems(&name, &none.source.text, mistakes);
        if let Some(mistake) = mistakes.into_iter().next() {
            let known = wrong(mistake.span, mistake.message, &none);
            // What a merge left, say, is put right without losing all pins.
            let help = if mistake.help.is_empty() { known.help.clone() } else { mistake.help };
            return Err(Box::new(Problem { help, ..*known }));
        }
        let pins = read_pins(&tree).map_err(|(span, message)| wrong(span, message, &none))?;
        Ok(Self { pins, ..none })
    }

    /// As it stands in the file.
    pub fn to_text(&self) -> String {
        let mut text = String::from(
            "// Results that are kept: see `maquette help pins`. Written by `maquette pin` and `maquette unpin`.\nPins(\n    format: 1,\n    pins: {\n",
        );
        for (name, Pin { outputs, ancestry, .. }) in &self.pins {
            let outputs = outputs.iter().map(|(kind, hash)| format!("({kind:?}, \"{hash}\")"));
            let outputs = Vec::from_iter(outputs).join(", ");
            let from = serde_json::to_string(ancestry).unwrap_or_default();
            let marks = raw_marks(&from);
            let _ = writeln!(
                text,
                "        {}: (\n            outputs: [{outputs}],\n            from: r{marks}\"{from}\"{marks},\n        ),",
                serde_json::Value::from(&name[..])
            );
        }
        text + "    },\n)\n"
    }
}

/// So many marks that the text can stand between them.
fn raw_marks(text: &str) -> String {
    let runs = text.split('"').skip(1).map(|rest| rest.len() - rest.trim_start_matches('#').len());
    "#".repeat(runs.max().unwrap_or(0) + 1)
}

/// Reads `Pins(format: 1, pins: {..})`.
fn read_pins(tree: &Tree) -> Result<BTreeMap<String, Pin>, (Span, String)> {
    let is_ours = tree.name().is_some_and(|name| name.text == "Pins");
    let format = field(tree, "format").map(|format| &format.kind);
    if !is_ours || !matches!(format, Some(Kind::Number { value: 1.0, .. })) {
        return Err((tree.span, "a file of pins begins with `Pins(format: 1, ..)`".into()));
    }
    let Some(Kind::Map(entries)) = field(tree, "pins").map(|pins| &pins.kind) else {
        return Err((tree.span, "a file of pins needs a map `pins`".into()));
    };
    entries
        .iter()
        .map(|(key, value)| {
            let pin = key.text().map(str::to_owned).zip(read_pin(value, key.span));
            pin.ok_or_else(|| (key.span, format!("{} is no pin", key.in_words())))
        })
        .collect()
}

fn field<'t>(tree: &'t Tree, name: &str) -> Option<&'t Tree> {
    tree.fields()?.iter().find(|field| field.name.text == name).map(|field| &field.value)
}

fn read_pin(tree: &Tree, span: Span) -> Option<Pin> {
    let Kind::List(outputs) = &field(tree, "outputs")?.kind else { return None };
    let outputs = outputs
        .iter()
        .map(|tree| match &tree.kind {
            Kind::Call { name: None, body: Body::Items(items) } => match &items[..] {
                [kind, hash] => Some((kind.text()?.to_owned(), Hash::parse(hash.text()?)?)),
                _ => None,
            },
            _ => None,
        })
        .collect::<Option<_>>()?;
    let ancestry: Ancestry = serde_json::from_str(field(tree, "from")?.text()?).ok()?;
    Some(Pin { outputs, ancestry, span })
}
