//! Exports a drawing as DOT for Graphviz.

use std::fmt::Write;

use super::{Block, Drawing};

impl Drawing {
    /// Returns the graph as DOT. Each pack is a cluster, each node is a record with its ports as fields, and links are labeled with types.
    pub fn to_dot(&self) -> String {
        let mut text = String::from("digraph {\n");
        let _ = writeln!(text, "  graph [rankdir=LR, tooltip={}];", plain(&self.doc));
        text += "  node [shape=record, style=rounded, fontname=\"Helvetica\", fontsize=11];\n";
        text += "  edge [fontname=\"Helvetica\", fontsize=9, color=\"#767676\", fontcolor=\"#767676\"];\n";
        for (index, pack) in self.packs.iter().enumerate() {
            let _ = writeln!(text, "  subgraph {} {{", quote(&format!("cluster_{}", pack.name)));
            let color = super::svg::color(pack.place);
            let _ = writeln!(text, "    label={}; color=\"{color}\";", quote(&pack.name));
            for (place, block) in self.boxes.iter().enumerate() {
                if block.node.as_ref().is_some_and(|node| node.pack == index) {
                    let _ = writeln!(text, "    n{place} [label={}];", quote(&record(block)));
                }
            }
            text += "  }\n";
        }
        for (place, block) in
            self.boxes.iter().enumerate().filter(|(_, block)| block.node.is_none())
        {
            let name = plain(&block.name);
            let _ = writeln!(text, "  n{place} [shape=note, style=solid, label={name}];");
        }
        for wire in &self.wires {
            let ([from, output], [to, input]) = (wire.from, wire.to);
            let kind = quote(&self.boxes[from].outputs[output].kind);
            let port =
                if self.boxes[to].node.is_some() { format!(":i{input}") } else { String::new() };
            let _ = writeln!(text, "  n{from}:o{output} -> n{to}{port} [label={kind}];");
        }
        text + "}\n"
    }
}

/// Returns the record label of a node: input ports at the left, outputs at the right, and the name and type of the node between them.
fn record(block: &Block) -> String {
    fn field((index, name): (usize, &str), letter: char) -> String {
        format!("<{letter}{index}> {}", escape_record(name))
    }
    let inputs = block.inputs.iter().map(String::as_str).enumerate().map(|port| field(port, 'i'));
    let outputs = block.outputs.iter().map(|port| &port.name[..]);
    let outputs = outputs.enumerate().map(|port| field(port, 'o'));
    let kind = block.node.as_ref().map_or("", |node| &node.kind);
    let inputs = match &block.inputs[..] {
        [] => String::new(),
        _ => format!("{{{}}} | ", inputs.collect::<Vec<_>>().join(" | ")),
    };
    let outputs = outputs.collect::<Vec<_>>().join(" | ");
    format!("{{{inputs}{}\\n{} | {{{outputs}}}}}", escape_record(&block.name), escape_record(kind))
}

/// Escapes the special characters of a text for a record label.
fn escape_record(text: &str) -> String {
    let mut escaped = String::new();
    for letter in text.chars() {
        if matches!(letter, '{' | '}' | '|' | '<' | '>' | '\\' | ' ') {
            escaped.push('\\');
        }
        escaped.push(letter);
    }
    escaped
}

/// Converts a plain text to a string in DOT: escapes it and adds quotes.
fn plain(text: &str) -> String {
    quote(&text.replace('\\', "\\\\"))
}

/// Adds quotes to a label. Backslashes are not escaped, because the label already contains escapes of Graphviz.
fn quote(label: &str) -> String {
    let label = label.replace(char::is_control, " ");
    format!("\"{}\"", label.replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use expect_test::expect;

    use crate::drawing::tests::scan;

    #[test]
    fn packs_are_clusters_and_links_carry_their_types() {
        expect![[r##"
            digraph {
              graph [rankdir=LR, tooltip="Finds \"red\" & more ."];
              node [shape=record, style=rounded, fontname="Helvetica", fontsize=11];
              edge [fontname="Helvetica", fontsize=9, color="#767676", fontcolor="#767676"];
              subgraph "cluster_image" {
                label="image"; color="#2f6fb0";
                n1 [label="{{<i0> image} | red\nThreshold | {<o0> mask}}"];
              }
              subgraph "cluster_range" {
                label="range"; color="#2b7f62";
                n0 [label="{scan\nReadCapture | {<o0> color | <o1> range}}"];
                n2 [label="{{<i0> range | <i1> within} | grid\nTriangulate | {<o0> mesh}}"];
              }
              n3 [shape=note, style=solid, label="a<b>\"c\\d.png"];
              n4 [shape=note, style=solid, label="grid.ply"];
              n0:o0 -> n1:i0 [label="Image"];
              n0:o1 -> n2:i0 [label="RangeImage"];
              n1:o0 -> n2:i1 [label="Mask"];
              n1:o0 -> n3 [label="Mask"];
              n2:o0 -> n4 [label="Mesh"];
            }
        "##]]
        .assert_eq(&scan().to_dot());
    }
}
