//! Where an editor of nodes has put the nodes of a graph: `NAME.layout.ron` beside the graph. Nothing but the editor's view depends on it.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};

use maquette_engine::writing::{Destination, Refused, Sources, Turn, rewrite};
use maquette_syntax::error::Place;
use maquette_syntax::{parse, read_tree};
use maquette_value::plain;
use serde::{Deserialize, Serialize};

use crate::Shown;

pub(crate) const ENDING: &str = "layout.ron";

/// Column and row of a box, as [`Places`](maquette_diagram::Places) has them, but anywhere in between, too.
type Spot = (f64, f64);

/// The spots of the boxes that were put anywhere.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Layout {
    inputs: Option<Spot>,
    nodes: BTreeMap<String, Spot>,
    outputs: Option<Spot>,
}

impl Layout {
    /// The layout of a graph; None if nobody has kept one.
    pub(super) fn of(graph: &Path) -> Result<Option<Self>, String> {
        let path = beside(graph);
        let text = match plain::read_text(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("cannot read {}: {error}", path.shown())),
        };
        let (tree, mistakes) = parse(&text);
        let mistake = mistakes.into_iter().next().map(|it| (Some(it.span), it.message));
        let read = match mistake {
            Some(mistake) => Err(mistake),
            None if tree.name().is_none_or(|name| name.text != "Layout") => {
                Err((Some(tree.span), "it is no `Layout(..)`".to_owned()))
            }
            None => read_tree(&tree).map_err(|error| (error.span, error.message)),
        };
        read.map(Some).map_err(|(span, message)| {
            let Place { line, column } = Place::of(&text, span.unwrap_or_default().start);
            format!("{}:{line}:{column}: {message}; mend or delete the file", path.shown())
        })
    }

    /// Keeps it for a graph. A file that is no layout stays as it is.
    pub(super) fn keep(&self, graph: &Path) -> Result<(), String> {
        let spots = self.nodes.values().chain(&self.inputs).chain(&self.outputs);
        if let Some(spot) = spots.into_iter().find(|(x, y)| !(x.is_finite() && y.is_finite())) {
            return Err(format!("{spot:?} is no place"));
        }
        let (path, text) = (beside(graph), self.text(graph));
        let cannot = |error: Refused| format!("cannot write {}: {error}", path.shown());
        let _turn = Turn::beside(graph).map_err(|error| cannot(error.into()))?;
        let known = Self::of(graph)?;
        let done = match known {
            Some(known) if known == *self => Ok(()),
            Some(_) => rewrite(&path, &text).map_err(Refused::from),
            None => Destination::anywhere(&Sources::default()).put(&path, text.as_bytes()),
        };
        done.map_err(cannot)
    }

    fn text(&self, graph: &Path) -> String {
        let name = graph.file_name().unwrap_or_default().to_string_lossy();
        let mut text = format!(
            "// Where the nodes of {name} stand in an editor. Nothing else depends on it.\nLayout(\n"
        );
        fn line(text: &mut String, name: &str, spot: &Option<Spot>) {
            if let Some((x, y)) = spot {
                let _ = writeln!(text, "    {name}: ({x:.3}, {y:.3}),");
            }
        }
        line(&mut text, "inputs", &self.inputs);
        text.push_str("    nodes: {\n");
        for (name, (x, y)) in &self.nodes {
            let _ = writeln!(text, "        {name:?}: ({x:.3}, {y:.3}),");
        }
        text.push_str("    },\n");
        line(&mut text, "outputs", &self.outputs);
        text.push_str(")\n");
        text
    }
}

/// The file of a graph's layout.
fn beside(graph: &Path) -> PathBuf {
    graph.with_extension(ENDING)
}
