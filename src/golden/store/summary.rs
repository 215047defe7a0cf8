//! The summary of a value: lines of text that people read in a diff.

use maquette_engine::digits::six_digits;
use maquette_value::{AnyValue, Mesh, Range};
use maquette_value::{Extent, Topology};

use super::WrittenFile;
use crate::compare::{Tolerance, allowed_difference, unordered_hash};
use crate::parts::{Class, GoldenParts};
use crate::sketch::Sketch;

/// A line of a summary: a label and a text.
pub(super) struct Line {
    pub(super) label: String,
    pub(super) text: String,
    /// The tolerance of the numbers in the text. If it is `None`, the text must be equal.
    pub(super) tolerance: Option<f64>,
}

/// The start of the label of the line that contains a column's sketch.
pub(super) const SKETCH: &str = "sketch of ";

/// Creates a line whose text must be equal in the golden and the new value.
pub(super) fn exact(label: &str, text: impl ToString) -> Line {
    Line { label: label.to_owned(), text: text.to_string(), tolerance: None }
}

/// Returns the lines of facts about a value and about the files to which it was written. The lines are not sorted.
pub(super) fn summary(
    value: &AnyValue,
    parts: Option<&GoldenParts>,
    outputs: &[WrittenFile],
    tolerance: &Tolerance,
) -> Vec<Line> {
    let mut lines = vec![exact("type", value.kind().name), exact("hash", value.hash())];
    lines.extend(
        unordered_hash(value).map(|mark| exact("hash without order", format!("{mark:032x}"))),
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
        let topology = Topology::from_mesh(mesh);
        for (name, fact) in topology.facts() {
            if parts.facts.iter().all(|(label, _)| label != name) {
                lines.push(exact(name, fact));
            }
        }
        let extent = Extent::from_mesh(mesh);
        let slack =
            parts.column("position").map_or(0.0, |part| allowed_difference(part, tolerance));
        fn number(label: &str, x: f64, slack: f64, lines: &mut Vec<Line>) {
            lines.push(Line { label: label.into(), text: six_digits(x), tolerance: Some(slack) });
        }
        // If a surface moves by the tolerance, its volume changes by the tolerance times its area. Its area changes by about the tolerance
        // times the length of its edges.
        number("area", extent.area, slack * (extent.area + slack).sqrt() * 100.0, &mut lines);
        number("volume", extent.volume, slack * extent.area, &mut lines);
        if topology.faces > 0 {
            number("edge, shortest", extent.shortest, 2.0 * slack, &mut lines);
            number("edge, longest", extent.longest, 2.0 * slack, &mut lines);
        }
    }
    for part in &parts.columns {
        let label = format!("{SKETCH}{}", part.name);
        lines.push(exact(&label, Sketch::compute(&part.numbers).to_text()));
        let slack = match part.class {
            Class::Exact => tolerance.differing,
            Class::Level => {
                let fraction = tolerance.differing.max(tolerance.relative);
                tolerance.level.max(255.0 * fraction)
            }
            Class::Normal => 0.05,
            _ => allowed_difference(part, tolerance),
        };
        for (component, range) in part.ranges().into_iter().enumerate() {
            let Some(Range { min: least, max: greatest, mean }) = range else { continue };
            let label = match part.width {
                1 => part.name.clone(),
                width if width <= 4 => format!("{} {}", part.name, ["x", "y", "z", "w"][component]),
                _ => format!("{} {component}", part.name),
            };
            let text = format!(
                "{} .. {}, mean {}",
                six_digits(least),
                six_digits(greatest),
                six_digits(mean)
            );
            lines.push(Line { label, text, tolerance: Some(slack) });
        }
    }
    lines
}
