//! The list of the pinned nodes of `doll.ron`, which is stored in `doll.pins.ron`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Source, Span, code};
use maquette_syntax::{Body, Kind, Tree, format_plain_data, parse, syntax_diagnostics};
use maquette_value::{Hash, fs};
use serde::Serialize;

use super::{Ancestry, EXTENSION, Pin, Pins};

impl Pins {
    /// Reads the pins of a graph. Returns an empty list if the graph has none.
    ///
    /// # Errors
    /// The file cannot be read, or is not a list of pins.
    pub fn read(graph: &Path) -> Result<Self, Box<Diagnostic>> {
        let (name, folder) = (graph.with_extension(EXTENSION), graph.with_extension("pins"));
        let read = fs::read_text(&name);
        let text = read.as_ref().map_or_else(|_| String::new(), Clone::clone);
        let source = Arc::new(Source { name: name.clone(), text });
        let none = Self { pins: BTreeMap::new(), folder, source };
        match read {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(none),
            Err(error) => {
                let message = format!("the file of pins cannot be read: {error}");
                return Err(none.error(Span::default(), message));
            }
            Ok(_) => {}
        }
        let (tree, errors) = parse(&none.source.text);
        let errors = syntax_diagnostics(&name, &none.source.text, errors);
        if let Some(error) = errors.into_iter().next() {
            let known = none.error(error.span, error.message);
            // Prefer the help of the syntax error, which says how to repair the list, for example after a merge conflict. The general help
            // is to delete the file, which loses all pins.
            let help = if error.help.is_empty() { known.help.clone() } else { error.help };
            return Err(Box::new(Diagnostic { help, ..*known }));
        }
        let pins = read_pins(&tree).map_err(|(span, message)| none.error(span, message))?;
        Ok(Self { pins, ..none })
    }

    fn error(&self, span: Span, message: String) -> Box<Diagnostic> {
        let help = "pins are written by `maquette pin`; delete the file to start over";
        Box::new(self.diagnostic(span, code::PIN, message, help.into()))
    }

    /// Returns the text of the file that lists the pins.
    pub fn to_text(&self) -> String {
        let pins = self.pins.iter().map(|(name, Pin { outputs, ancestry, .. })| {
            let from = serde_json::to_string(ancestry).unwrap_or_default();
            (name, PinEntry { outputs, from })
        });
        let comment =
            "Stored results of nodes; see `maquette help pins`. Written by `maquette pin`.";
        format_plain_data(comment, "Pins", 3, &PinsFile { format: 1, pins: pins.collect() })
    }
}

/// The content of the file, `Pins(format: 1, pins: {..})`.
#[derive(Serialize)]
struct PinsFile<'p> {
    format: u32,
    pins: BTreeMap<&'p String, PinEntry<'p>>,
}

#[derive(Serialize)]
struct PinEntry<'p> {
    /// For each output of the node, the name of its value type and the hash of its value.
    outputs: &'p [(String, Hash)],
    /// The ancestry of the result, as JSON.
    from: String,
}

/// Reads the file that lists the pins, `Pins(format: 1, pins: {..})`. Returns the pins by the names of their nodes.
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
            pin.ok_or_else(|| (key.span, format!("{} is no pin", key.describe())))
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
