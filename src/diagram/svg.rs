//! Exports a drawing as a self-contained SVG without scripts.
//!
//! Boxes have a background, and links have a medium lightness, so the diagram is readable on white and on black pages.

use std::fmt::Write;

use maquette_syntax::diagnostics::escape_xml;

use super::layout::{Layout, Link, LinkEnd, Node, layout};
use super::{Block, Drawing};

/// Assumed width of a character as a multiple of the font size. The actual width is at most 0.602 in all fonts of the diagram.
const ADVANCE: f64 = 0.61;
const NAME: f64 = 13.0;
const SMALL: f64 = 10.5;

const FONTS: &str = "ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace";

/// In px: `HEADER` is the distance from the top of a node to its first port, and `ROW` is the distance between two ports.
const HEADER: f64 = 38.0;
const ROW: f64 = 18.0;
const PADDING: f64 = 10.0;
const FILE_HEIGHT: f64 = 28.0;
const LEGEND: f64 = 34.0;

/// In px: `GUTTER` is the space between two columns, and `MARGIN` is the space around the diagram.
const GUTTER: f64 = 64.0;
const MARGIN: f64 = 16.0;

/// The colors of packs: dark enough to be readable under white text, and light enough to be visible as lines on black.
const COLORS: [&str; 10] = [
    "#2f6fb0", "#2b7f62", "#9a5b1e", "#7a55b3", "#b04a5a", "#3d7680", "#71752a", "#a04a97",
    "#5566b5", "#8a6150",
];

/// Returns the color of the pack with this index among all packs of the program.
pub(super) fn color(place: usize) -> &'static str {
    COLORS[place % COLORS.len()]
}

/// The dimensions of a box, in px.
struct BoxSize {
    width: f64,
    height: f64,
    /// The width of the longest type label at a linked output of the box.
    label: f64,
}

impl Drawing {
    /// Returns the diagram as SVG.
    pub fn to_svg(&self) -> String {
        self.arrange().draw()
    }

    /// Computes the positions of boxes and links.
    pub(super) fn arrange(&self) -> Picture<'_> {
        let measures: Vec<BoxSize> = (0..self.boxes.len()).map(|k| self.measure(k)).collect();
        let nodes: Vec<Node> = self
            .boxes
            .iter()
            .zip(&measures)
            .map(|(block, measure): (&Block, &BoxSize)| Node {
                height: measure.height,
                is_last: block.node.is_none(),
            })
            .collect();
        let links = self.wires.iter().map(|wire| {
            let [from, to] = [wire.from, wire.to].map(|[node, port]| LinkEnd {
                node,
                port,
                below: self.port_below(node, port),
            });
            Link { from, to }
        });
        let links: Vec<Link> = links.collect();
        Picture { drawing: self, layout: layout(&nodes, &links), measures }
    }

    fn measure(&self, index: usize) -> BoxSize {
        let block = &self.boxes[index];
        let Some(node) = &block.node else {
            let width = text_width(&block.name, SMALL) + 2.0 * PADDING;
            return BoxSize { width, height: FILE_HEIGHT, label: 0.0 };
        };
        let rows = block.inputs.len().max(block.outputs.len());
        let header = text_width(&block.name, NAME).max(text_width(&node.kind, SMALL));
        let width = (0..rows)
            .map(|row: usize| {
                let input = block.inputs.get(row).map_or(0.0, |name| text_width(name, SMALL));
                let output =
                    block.outputs.get(row).map_or(0.0, |port| text_width(&port.name, SMALL));
                input + output + PADDING
            })
            .fold(header, f64::max)
            + 2.0 * PADDING;
        let linked = (0..block.outputs.len()).filter(|&output| self.is_linked([index, output]));
        let label = linked.map(|output| label_width(&block.outputs[output].kind));
        BoxSize {
            width: width.ceil(),
            height: HEADER + ROW * rows as f64 + 4.0,
            label: label.fold(0.0, f64::max).ceil(),
        }
    }

    /// Returns the distance from the top of a box down to a port, in px.
    pub(super) fn port_below(&self, node: usize, port: usize) -> f64 {
        match self.boxes[node].node {
            Some(_) => HEADER + ROW * (port as f64 + 0.5),
            None => FILE_HEIGHT / 2.0,
        }
    }
}

/// Estimates the width of a text in px. Characters from U+1100 on, which come after Latin, Greek, Cyrillic and others, count as square.
fn text_width(text: &str, size: f64) -> f64 {
    text.chars().map(|letter: char| if letter < '\u{1100}' { ADVANCE } else { 1.05 }).sum::<f64>()
        * size
}

/// Returns the width of the type label of a link, including the space around it.
fn label_width(kind: &str) -> f64 {
    if kind.is_empty() { 0.0 } else { text_width(kind, SMALL) + 12.0 }
}

/// The style of a text: its position, size and color.
struct Style<'a> {
    at: [f64; 2],
    size: f64,
    fill: &'a str,
    more: &'a str,
}

/// A drawing with the computed positions of its boxes and links.
pub(super) struct Picture<'a> {
    pub(super) drawing: &'a Drawing,
    layout: Layout,
    measures: Vec<BoxSize>,
}

impl Picture<'_> {
    fn draw(&self) -> String {
        let columns = self.columns();
        let [right, bottom] = self.size(&columns);
        let legend = self.drawing.packs.iter().map(|pack| label_width(&pack.name) + 14.0);
        let (width, height) =
            (right.max(2.0 * MARGIN + legend.sum::<f64>()).ceil(), (bottom + LEGEND).ceil());
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" role=\"img\" font-family=\"{FONTS}\">\n"
        );
        let _ = writeln!(svg, "<title>{}</title>", escape(&self.drawing.doc));
        self.links(&columns, &mut svg);
        for index in 0..self.drawing.boxes.len() {
            self.block(index, self.place(index, &columns), &mut svg);
        }
        self.legend(bottom, &mut svg);
        svg + "</svg>\n"
    }

    /// Returns the left and right end of each column, in px. A column includes the type labels of the links that start in it.
    pub(super) fn columns(&self) -> Vec<[f64; 2]> {
        let mut widths = vec![0f64; self.layout.columns];
        for (slot, measure) in self.layout.slots.iter().zip(&self.measures) {
            widths[slot.column] = widths[slot.column].max(measure.width + measure.label);
        }
        let mut left = MARGIN;
        widths
            .into_iter()
            .map(|width| {
                let column = [left, left + width];
                left += width + GUTTER;
                column
            })
            .collect()
    }

    /// Returns the links, each as the index of its source box and an SVG path. The path is curved between columns, and straight in passages
    /// and from the right side of a narrow box to the right end of its column.
    pub(super) fn paths(&self, columns: &[[f64; 2]]) -> impl Iterator<Item = (usize, String)> {
        self.layout.segments.iter().map(|segment| {
            let [from, to] = [segment.from, segment.to].map(|slot| &self.layout.slots[slot]);
            let [y, end] = self.layout.ends(segment).map(|y| y + MARGIN);
            let [left, right] = columns[from.column];
            let begin = from.node.map_or(left, |node| left + self.measures[node].width);
            let next = columns[to.column][0];
            let middle = (right + next) / 2.0;
            let path = format!(
                "M{begin:.1} {y:.1}H{right:.1}C{middle:.1} {y:.1} {middle:.1} {end:.1} {next:.1} {end:.1}"
            );
            (segment.source[0], path)
        })
    }

    fn links(&self, columns: &[[f64; 2]], svg: &mut String) {
        for (from, path) in self.paths(columns) {
            let pack = self.drawing.boxes[from].node.as_ref().map(|node| node.pack);
            let _ = writeln!(
                svg,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\"/>",
                self.color(pack)
            );
        }
    }

    /// Returns the position and size of a box in px, as [left, top, width, height].
    pub(super) fn place(&self, index: usize, columns: &[[f64; 2]]) -> [f64; 4] {
        let (slot, measure) = (&self.layout.slots[index], &self.measures[index]);
        [columns[slot.column][0], slot.top + MARGIN, measure.width, measure.height]
    }

    /// Returns the width and height of the diagram in px.
    pub(super) fn size(&self, columns: &[[f64; 2]]) -> [f64; 2] {
        let right = columns.last().map_or(0.0, |[_, right]| *right);
        [right + MARGIN, self.layout.height + 2.0 * MARGIN]
    }

    pub(super) fn color(&self, pack: Option<usize>) -> &'static str {
        let pack = pack.and_then(|pack| self.drawing.packs.get(pack));
        pack.map_or("#767676", |pack| color(pack.place))
    }

    fn block(&self, index: usize, place: [f64; 4], svg: &mut String) {
        let (block, [x, y, width, height]) = (&self.drawing.boxes[index], place);
        let Some(node) = &block.node else {
            rectangle([x, y, width, height], 12.0, "fill=\"#f3f3f3\" stroke=\"#767676\"", svg);
            let at = [x + PADDING, y + height / 2.0 + 3.6];
            return text(&block.name, &Style { at, size: SMALL, fill: "#1c1c1c", more: "" }, svg);
        };
        let color = self.color(Some(node.pack));
        rectangle([x, y, width, height], 5.0, &format!("fill=\"{color}\""), svg);
        let body = [x + 1.2, y + HEADER, width - 2.4, height - HEADER - 1.2];
        rectangle(body, 4.0, "fill=\"#fbfbfb\"", svg);
        let bold = "font-weight=\"bold\"";
        let at = [x + PADDING, y + 16.0];
        text(&block.name, &Style { at, size: NAME, fill: "#ffffff", more: bold }, svg);
        let at = [x + PADDING, y + 30.0];
        text(&node.kind, &Style { at, size: SMALL, fill: "#ffffff", more: "" }, svg);
        for (port, name) in block.inputs.iter().enumerate() {
            let at = [x, y + self.drawing.port_below(index, port)];
            dot(at, color, svg);
            let at = [at[0] + PADDING, at[1] + 3.6];
            text(name, &Style { at, size: SMALL, fill: "#1c1c1c", more: "" }, svg);
        }
        for (output, port) in block.outputs.iter().enumerate() {
            let at = [x + width, y + self.drawing.port_below(index, output)];
            if self.drawing.is_linked([index, output]) {
                self.label(&port.kind, color, at, svg);
            }
            dot(at, color, svg);
            let at = [at[0] - PADDING - text_width(&port.name, SMALL), at[1] + 3.6];
            text(&port.name, &Style { at, size: SMALL, fill: "#1c1c1c", more: "" }, svg);
        }
    }

    /// Draws the type label of a link at the start of the link.
    fn label(&self, kind: &str, color: &str, [x, y]: [f64; 2], svg: &mut String) {
        if kind.is_empty() {
            return;
        }
        let width = label_width(kind) - 4.0;
        let look = format!("fill=\"#ffffff\" stroke=\"{color}\" stroke-width=\"0.8\"");
        rectangle([x + 4.0, y - 7.5, width, 15.0], 7.5, &look, svg);
        let style = Style { at: [x + 8.0, y + 3.6], size: SMALL, fill: color, more: "" };
        text(kind, &style, svg);
    }

    fn legend(&self, y: f64, svg: &mut String) {
        let mut x = MARGIN;
        for pack in &self.drawing.packs {
            let width = label_width(&pack.name) + 4.0;
            let look = format!("fill=\"{}\"", color(pack.place));
            rectangle([x, y, width, 18.0], 5.0, &look, svg);
            let style = Style { at: [x + 8.0, y + 12.8], size: SMALL, fill: "#ffffff", more: "" };
            text(&pack.name, &style, svg);
            x += width + 10.0;
        }
    }
}

fn rectangle([x, y, width, height]: [f64; 4], radius: f64, look: &str, svg: &mut String) {
    let _ = writeln!(
        svg,
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"{radius}\" {look}/>"
    );
}

fn dot([x, y]: [f64; 2], color: &str, svg: &mut String) {
    let _ = writeln!(
        svg,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.4\" fill=\"{color}\" stroke=\"#ffffff\"/>"
    );
}

fn text(text: &str, style: &Style<'_>, svg: &mut String) {
    let Style { at: [x, y], size, fill, more } = style;
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{fill}\" {more}>{}</text>",
        escape(text)
    );
}

/// Escapes a text for XML. Control characters, which XML does not allow, become spaces.
fn escape(text: &str) -> String {
    let text = text.replace(char::is_control, " ");
    escape_xml(text.replace(['\u{fffe}', '\u{ffff}'], "\u{fffd}"))
}

#[cfg(test)]
mod tests {
    use crate::Drawing;
    use crate::drawing::tests::scan;

    /// Returns the values of a numeric attribute from all elements of an SVG that have it.
    fn numbers(svg: &str, attribute: &str) -> Vec<f64> {
        let name = format!(" {attribute}=\"");
        let parts = svg.split(&name).skip(1);
        parts.map(|part| part.split('"').next().unwrap().parse().unwrap()).collect()
    }

    #[test]
    fn the_picture_names_nodes_types_ports_and_files() {
        let svg = scan().to_svg();
        for word in ["scan", "ReadCapture", "RangeImage", "within", "grid.ply", "image", "mask"] {
            assert!(svg.contains(&format!(">{word}</text>")), "{word}");
        }
        assert_eq!(svg.matches("<path").count(), 7, "5 links, two of which have a passage");
    }

    #[test]
    fn texts_are_escaped() {
        let svg = scan().to_svg();
        assert!(svg.contains("<title>Finds &quot;red&quot; &amp; more .</title>"));
        assert!(svg.contains(">a&lt;b&gt;&quot;c\\d.png</text>"));
    }

    #[test]
    fn everything_is_inside_of_the_picture() {
        let svg = scan().to_svg();
        let [width, height] = ["width", "height"].map(|size| numbers(&svg, size));
        let [x, y] = ["x", "y"].map(|place| numbers(&svg, place));
        let rectangles = svg.matches("<rect").count();
        assert_eq!((width.len(), height.len()), (rectangles + 1, rectangles + 1));
        assert!(x.iter().all(|&x| 0.0 < x && x < width[0]));
        assert!(y.iter().all(|&y| 0.0 < y && y < height[0]));
    }

    #[test]
    fn an_empty_graph_has_a_diagram() {
        assert!(Drawing::default().to_svg().ends_with("</svg>\n"));
    }
}
