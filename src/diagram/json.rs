//! Exports a drawing as JSON, for programs that draw it themselves.

use maquette_graph::DraftField;
use maquette_syntax::error::{LineIndex, Position};
use serde_json::{Value as Json, json};

use super::svg::Picture;
use super::{Block, Drawing};

impl Drawing {
    /// Returns the drawing as JSON: boxes with positions and ports, links as SVG paths, and packs with colors. Positions are in px from the
    /// upper left corner of the diagram.
    pub fn to_json(&self) -> Json {
        let picture = self.arrange();
        let columns = picture.columns();
        let mut lines = LineIndex::default();
        let mut boxes = Vec::new();
        for (index, block) in self.boxes.iter().enumerate() {
            let mut json = box_to_json(&picture, index, block, picture.place(index, &columns));
            if let Some((source, at)) = &block.at {
                let Position { line, column } = lines.position(source, *at);
                json["file"] = source.name.display().to_string().into();
                json["line"] = line.into();
                json["column"] = column.into();
            }
            boxes.push(json);
        }
        let packs = self.packs.iter().enumerate();
        let packs = packs
            .map(|(index, pack)| json!({ "name": pack.name, "color": picture.color(Some(index)) }));
        let links =
            picture.paths(&columns).map(|(from, path)| json!({ "from": from, "path": path }));
        json!({
            "doc": self.doc,
            "size": picture.size(&columns),
            "packs": packs.collect::<Vec<_>>(),
            "boxes": boxes,
            "links": links.collect::<Vec<_>>(),
        })
    }
}

/// Returns a box as JSON. The field `node` is omitted for an output file.
fn box_to_json(picture: &Picture<'_>, index: usize, block: &Block, place: [f64; 4]) -> Json {
    fn port_y(port: usize, place: [f64; 4], index: usize, picture_drawing: &Drawing) -> f64 {
        place[1] + picture_drawing.port_below(index, port)
    }
    let inputs = block.inputs.iter().enumerate();
    let inputs = inputs.map(
        |(port, name)| json!({ "name": name, "y": port_y(port, place, index, picture.drawing) }),
    );
    let outputs = block.outputs.iter().enumerate().map(
        |(port, output)| json!({ "name": output.name, "type": output.kind, "y": port_y(port, place, index, picture.drawing) }),
    );
    fn draft_to_json(it: &DraftField) -> Json {
        json!({ "field": it.field, "final": it.sides[0], "draft": it.sides[1] })
    }
    let mut boxed = json!({
        "name": block.name,
        "node": block.node.as_ref().map(|node| &node.kind),
        "pack": block.node.as_ref().map(|node| node.pack),
        "place": place,
        "inputs": inputs.collect::<Vec<_>>(),
        "outputs": outputs.collect::<Vec<_>>(),
    });
    if !block.drafts.is_empty() {
        boxed["drafts"] = block.drafts.iter().map(draft_to_json).collect();
    }
    boxed
}
