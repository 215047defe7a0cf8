//! The positions of nodes in a node editor, in the file `NAME.layout.ron` next to the graph. They affect only the editor's view.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use maquette_engine::writing::{Destination, FolderLock, Sources, WriteError, rewrite};
use maquette_syntax::error::Position;
use maquette_syntax::{format_plain_data, parse_plain_data};
use maquette_value::fs;
use serde::{Deserialize, Serialize};

use crate::DisplayPath;

pub(crate) const ENDING: &str = "layout.ron";

/// The position of a node's box as (column, row). Like [`RowPositions`](maquette_diagram::RowPositions), but fractions are allowed.
type Spot = (f64, f64);

/// The positions of those boxes that a user has moved.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Layout {
    inputs: Option<Spot>,
    nodes: BTreeMap<String, Spot>,
    outputs: Option<Spot>,
}

impl Layout {
    /// Reads the layout file of a graph. Returns `None` if there is none.
    pub(super) fn read(graph: &Path) -> Result<Option<Self>, String> {
        let path = layout_path(graph);
        let text = match fs::read_text(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("cannot read {}: {error}", path.for_display())),
        };
        parse_plain_data(&text).map(Some).map_err(|(span, message)| {
            let Position { line, column } = Position::from_offset(&text, span.start);
            format!("{}:{line}:{column}: {message}; fix or delete the file", path.for_display())
        })
    }

    /// Writes the layout file of a graph. Fails if the existing file at this path is not a layout.
    pub(super) fn write(&self, graph: &Path) -> Result<(), String> {
        let spots = self.nodes.values().chain(&self.inputs).chain(&self.outputs);
        if let Some(spot) = spots.into_iter().find(|(x, y)| !(x.is_finite() && y.is_finite())) {
            return Err(format!("expected a finite position, found {spot:?}"));
        }
        let (path, text) = (layout_path(graph), self.round().text(graph));
        let cannot = |error: WriteError| format!("cannot write {}: {error}", path.for_display());
        let _turn = FolderLock::acquire(graph).map_err(|error| cannot(error.into()))?;
        let known = Self::read(graph)?;
        let done = match known {
            Some(known) if known == *self => Ok(()),
            Some(_) => rewrite(&path, &text).map_err(WriteError::from),
            None => Destination::anywhere(&Sources::default()).put(&path, text.as_bytes()),
        };
        done.map_err(cannot)
    }

    fn text(&self, graph: &Path) -> String {
        let name = graph.file_name().unwrap_or_default().to_string_lossy();
        let comment = format!(
            "Positions of the nodes of {name} in an editor. Nothing else depends on this file."
        );
        format_plain_data(&comment, "Layout", 2, self)
    }

    /// Rounds the positions to a thousandth of a row.
    fn round(&self) -> Self {
        fn round(&(x, y): &Spot) -> Spot {
            ((x * 1000.0).round() / 1000.0, (y * 1000.0).round() / 1000.0)
        }
        let nodes = self.nodes.iter().map(|(name, spot)| (name.clone(), round(spot)));
        Self {
            inputs: self.inputs.as_ref().map(round),
            nodes: nodes.collect(),
            outputs: self.outputs.as_ref().map(round),
        }
    }
}

/// Returns the path of the layout file of a graph.
fn layout_path(graph: &Path) -> PathBuf {
    graph.with_extension(ENDING)
}
