//! A drawing as data, for viewers that draw it themselves.

use maquette_graph::DraftField;
use maquette_syntax::error::{Lines, Place};
use serde_json::{Value as Json, json};

use super::svg::Picture;
use super::{Block, Drawing};

impl Drawing {
    /// Boxes with their places and ports, links as paths of SVG, and the packs with their colors. Places are in pixels from the upper left
    /// corner.
    pub fn to_json(&self) -> Json {
        let picture = self.placed();
        let columns = picture.columns();
        let mut lines = Lines::default();
        let block = |(index, block): (usize, &Block)| {
            let place = picture.place(index, &columns);
            let mut boxed = boxed(&picture, index, block, place);
            if let Some((source, at)) = &block.at {
                let Place { line, column } = lines.place(source, *at);
                boxed["file"] = source.name.display().to_string().into();
                boxed["line"] = line.into();
                boxed["column"] = column.into();
            }
            boxed
        };
        let link = |(from, path)| json!({ "from": from, "path": path });
        let pack = |(index, pack): (usize, &super::Pack)| json!({ "name": pack.name, "color": picture.color(Some(index)) });
        json!({
            "doc": self.doc,
            "size": picture.size(&columns),
            "packs": self.packs.iter().enumerate().map(pack).collect::<Vec<_>>(),
            "boxes": self.boxes.iter().enumerate().map(block).collect::<Vec<_>>(),
            "links": picture.paths(&columns).map(link).collect::<Vec<_>>(),
        })
    }
}

/// A box: a node, or an output file, which has no `node`.
fn boxed(picture: &Picture<'_>, index: usize, block: &Block, place: [f64; 4]) -> Json {
    fn below(port: usize, place: [f64; 4], index: usize, picture_drawing: &Drawing) -> f64 {
        place[1] + picture_drawing.port_below(index, port)
    }
    let inputs = block.inputs.iter().enumerate();
    let inputs = inputs.map(
        |(port, name)| json!({ "name": name, "y": below(port, place, index, picture.drawing) }),
    );
    let outputs = block.outputs.iter().enumerate().map(
        |(port, output)| json!({ "name": output.name, "type": output.kind, "y": below(port, place, index, picture.drawing) }),
    );
    let draft =
        |it: &DraftField| json!({ "field": it.field, "final": it.sides[0], "draft": it.sides[1] });
    let mut boxed = json!({
        "name": block.name,
        "node": block.node.as_ref().map(|node| &node.kind),
        "pack": block.node.as_ref().map(|node| node.pack),
        "place": place,
        "inputs": Vec::from_iter(inputs),
        "outputs": Vec::from_iter(outputs),
    });
    if !block.drafts.is_empty() {
        boxed["drafts"] = block.drafts.iter().map(draft).collect();
    }
    boxed
}
