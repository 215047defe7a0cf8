//! What a value is, in lines that people read in a diff.

use maquette_engine::six::six;
use maquette_value::{AnyValue, Mesh, Range};
use maquette_value::{Extent, Topology};

use super::Written;
use crate::compare::{Tolerance, allowed, without_order};
use crate::parts::{Class, GoldenParts};
use crate::sketch::Sketch;

/// What a value is in a golden: the texts of its summary, and how much those with numbers may differ.
pub(super) struct Line {
    pub(super) label: String,
    pub(super) text: String,
    /// The slack of the numbers in the text; none for what must be equal.
    pub(super) slack: Option<f64>,
}

/// Begins the label of a column's sketch.
pub(super) const SKETCH: &str = "sketch of ";

/// A fact that must be equal.
pub(super) fn exact(label: &str, text: impl ToString) -> Line {
    Line { label: label.to_owned(), text: text.to_string(), slack: None }
}

/// The facts of a value, and of the files that it is written to, in no order.
pub(super) fn summary(
    value: &AnyValue,
    parts: Option<&GoldenParts>,
    outputs: &[Written],
    tolerance: &Tolerance,
) -> Vec<Line> {
    let mut lines = vec![exact("type", value.kind().name), exact("hash", value.hash())];
    lines.extend(
        without_order(value).map(|mark| exact("hash without order", format!("{mark:032x}"))),
    );
    for file in outputs {
        lines.push(exact(&format!("file {}", file.name), &file.content));
    }
    let Some(parts) = parts else {
        let facts = value.describe().0.into_iter();
        lines.extend(facts.map(|(label, fact)| exact(&label, fact)));
        return lines;
    };
    lines.extend(parts.facts.iter().map(|(label, fact)| exact(label, fact)));
    if let Some(mesh) = value.get::<Mesh>() {
        let topology = Topology::of(mesh);
        fn known(name: &str, parts_facts: &[(String, String)]) -> bool {
            parts_facts.iter().any(|(label, _)| label == name)
        }
        let facts = topology.facts().into_iter().filter(|(name, _)| !known(name, &parts.facts));
        lines.extend(facts.map(|(name, fact)| exact(name, fact)));
        let extent = Extent::of(mesh);
        let slack = parts.column("position").map_or(0.0, |part| allowed(part, tolerance));
        fn number(label: &str, x: f64, slack: f64, lines: &mut Vec<Line>) {
            lines.push(Line { label: label.into(), text: six(x), slack: Some(slack) });
        }
        // A surface that moves by the slack changes its area by some of its edges, and its volume by its area.
        number("area", extent.area, slack * (extent.area + slack).sqrt() * 100.0, &mut lines);
        number("volume", extent.volume, slack * extent.area, &mut lines);
        if topology.faces > 0 {
            number("edge, shortest", extent.shortest, 2.0 * slack, &mut lines);
            number("edge, longest", extent.longest, 2.0 * slack, &mut lines);
        }
    }
    for part in &parts.columns {
        let label = format!("{SKETCH}{}", part.name);
        lines.push(exact(&label, Sketch::of(&part.numbers).to_text()));
        let slack = match part.class {
            Class::Exact => tolerance.differing,
            Class::Level => {
                let fraction = tolerance.differing.max(tolerance.relative);
                tolerance.level.max(255.0 * fraction)
            }
            Class::Normal => 0.05,
            _ => allowed(part, tolerance),
        };
        for (component, range) in part.ranges().into_iter().enumerate() {
            let Some(Range { least, greatest, mean }) = range else { continue };
            let label = match part.width {
                1 => part.name.clone(),
                width if width <= 4 => format!("{} {}", part.name, ["x", "y", "z", "w"][component]),
                _ => format!("{} {component}", part.name),
            };
            let text = format!("{} .. {}, mean {}", six(least), six(greatest), six(mean));
            lines.push(Line { label, text, slack: Some(slack) });
        }
    }
    lines
}
