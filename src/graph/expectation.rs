//! Expectations of a graph or test, in the form in which files contain them.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Help, Kind, LocalDiagnostic, Tree, Walk, read_tree};
use schemars::JsonSchema;
use serde::Deserialize;

use super::constants::calls_in_plain_numbers;

/// A condition on a value, which is named by its link, `node` or `node.output`, or by the name of an output file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
pub enum Expectation {
    /// The mesh has no boundary.
    Closed(String),
    /// No edge has more than two faces, and adjacent faces have the same orientation.
    Manifold(String),
    /// No two faces of the mesh intersect.
    NoSelfIntersection(String),
    /// The mesh can be printed: it is closed, manifold and free of self-intersections, its faces are oriented outward, and its walls are
    /// thick enough.
    Printable {
        /// The mesh to test.
        of: String,
        /// Minimum allowed wall thickness in mm, measured from the middle of each face inward to the next face. If omitted, any thickness
        /// is accepted.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        thickness: f64,
    },
    /// A count is in a range.
    Count {
        /// The value in which to count.
        of: String,
        /// Quantity to count: vertices, edges, faces, components, boundary edges, border loops, Euler characteristic, cells, pixels.
        what: String,
        /// Minimum allowed count.
        #[serde(default)]
        min: Option<f64>,
        /// Maximum allowed count.
        #[serde(default)]
        max: Option<f64>,
    },
    /// All points of the value are in a box.
    Bounds {
        /// The value to test.
        of: String,
        /// Lowest allowed coordinates, in mm.
        #[schemars(extend("unit" = "mm"))]
        low: (f64, f64, f64),
        /// Highest allowed coordinates, in mm.
        #[schemars(extend("unit" = "mm"))]
        high: (f64, f64, f64),
    },
    /// All vertices are near another mesh or surface.
    Near {
        /// The value to test.
        of: String,
        /// The mesh or surface to which distances are measured.
        to: String,
        /// Maximum allowed distance in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        max: f64,
        /// Maximum allowed root mean square of all distances in mm.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        rms: Option<f64>,
    },
    /// The mesh has no hole at a part of a capture: in the picture, no border of the mesh is near the part.
    Whole {
        /// The mesh to test, with its texture coordinates in the capture's picture.
        of: String,
        /// The part of the capture at which the mesh must have no hole.
        around: String,
        /// Width of the band around the part in which no border may be, in pixels of the picture.
        #[serde(default = "default_band")]
        #[schemars(range(min = 0.0), extend("unit" = "px"))]
        band: f64,
    },
    /// No edge of the mesh is sharp.
    Bend {
        /// The mesh to test.
        of: String,
        /// Maximum allowed angle between the normals of two faces that share an edge, in degrees.
        #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
        max: f64,
    },
    /// New parts, such as the faces of a filled hole or a region that `Blend` has redesigned, continue the adjacent old surface. Needs
    /// `max`, or `order` and `limit`.
    Continuity {
        /// The mesh to test, or the range image that `Blend` made.
        of: String,
        /// The new part of the mesh. If omitted, the vertex attribute `filled` marks the new part.
        #[serde(default)]
        around: Option<String>,
        /// Order of the continuity that `limit` is about.
        #[serde(default)]
        order: Option<ContinuityOrder>,
        /// Maximum allowed gap. With `order: G1` the angle between the normals on both sides, in degrees; with `order: G2` the jump of the
        /// curvature, in 1/mm, for a mesh as root mean square along the border.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "deg"))]
        limit: Option<f64>,
        /// Maximum allowed angle between the normals of a new face and an adjacent old face, in degrees.
        #[serde(default)]
        #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
        max: Option<f64>,
        /// Maximum allowed jump of the curvature across the border between new and old faces, as root mean square along the border, in
        /// 1/mm. If omitted, any jump is accepted.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "1/mm"))]
        curvature: Option<f64>,
    },
    /// A vertex attribute, such as a curvature, is in a range everywhere.
    Attribute {
        /// The mesh to test.
        of: String,
        /// The name of the attribute.
        name: String,
        /// Minimum allowed value of the attribute.
        #[serde(default)]
        min: Option<f64>,
        /// Maximum allowed value of the attribute.
        #[serde(default)]
        max: Option<f64>,
    },
    /// An output of a used graph has a property that the graph promises.
    #[serde(skip)]
    Promised {
        /// The output to test.
        of: String,
        /// The name of the promised property.
        property: String,
    },
}

/// An order of geometric continuity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
pub enum ContinuityOrder {
    /// The normals on both sides are equal.
    G1,
    /// The curvatures on both sides are equal.
    G2,
}

fn default_band() -> f64 {
    15.0
}

impl Expectation {
    /// Reads a list of expectations. Returns each expectation with its position, and all errors.
    pub(crate) fn read_all(tree: &Tree) -> (Vec<(Self, Span)>, Vec<LocalDiagnostic>) {
        let (tree, misfits) = &Self::in_plain_numbers(tree);
        let root = serde_json::to_value(schemars::schema_for!(Vec<Self>)).unwrap_or_default();
        let mut walk = Walk {
            node: "Graph",
            root: &root,
            source_map: None,
            diagnostics: misfits.clone(),
            links: Vec::new(),
            files: Vec::new(),
        };
        walk.value(tree, &root, "expect");
        let mut diagnostics = walk.diagnostics;
        let items = match &tree.kind {
            Kind::List(items) if diagnostics.is_empty() => &items[..],
            _ => &[],
        };
        let mut expectations = Vec::new();
        for item in items {
            match read_tree(item) {
                Ok(expectation) => expectations.push((expectation, item.span)),
                Err(error) => diagnostics.push(LocalDiagnostic {
                    code: code::WRONG_VALUE,
                    span: error.span.unwrap_or(item.span),
                    message: error.message,
                    help: Help::default(),
                    note: None,
                }),
            }
        }
        (expectations, diagnostics)
    }

    /// Converts the numbers with units in a list of expectations to plain numbers. Returns the converted list, and the errors.
    pub fn in_plain_numbers(list: &Tree) -> (Tree, Vec<LocalDiagnostic>) {
        let schema = serde_json::to_value(schemars::schema_for!(Self)).unwrap_or_default();
        let mut diagnostics = Vec::new();
        (calls_in_plain_numbers(list, &schema, &mut diagnostics), diagnostics)
    }

    /// Returns the names of the values to which the condition refers.
    pub fn values(&self) -> Vec<&str> {
        match self {
            Self::Closed(of) | Self::Manifold(of) | Self::NoSelfIntersection(of) => vec![of],
            Self::Printable { of, .. } | Self::Count { of, .. } | Self::Bounds { of, .. } => {
                vec![of]
            }
            Self::Bend { of, .. } | Self::Attribute { of, .. } | Self::Promised { of, .. } => {
                vec![of]
            }
            Self::Continuity { of, around, .. } => {
                [&of[..]].into_iter().chain(around.as_deref()).collect()
            }
            Self::Near { of, to, .. } => vec![of, to],
            Self::Whole { of, around, .. } => vec![of, around],
        }
    }

    /// Returns mutable references to the names of the values, for renaming.
    pub fn values_mut(&mut self) -> Vec<&mut String> {
        match self {
            Self::Closed(of) | Self::Manifold(of) | Self::NoSelfIntersection(of) => vec![of],
            Self::Printable { of, .. } | Self::Count { of, .. } | Self::Bounds { of, .. } => {
                vec![of]
            }
            Self::Bend { of, .. } | Self::Attribute { of, .. } | Self::Promised { of, .. } => {
                vec![of]
            }
            Self::Continuity { of, around, .. } => [of].into_iter().chain(around).collect(),
            Self::Near { of, to, .. } => vec![of, to],
            Self::Whole { of, around, .. } => vec![of, around],
        }
    }

    /// Returns those texts in a list of expectations that name values.
    pub fn value_texts(list: &Tree) -> Vec<&Tree> {
        let Kind::List(items) = &list.kind else { return Vec::new() };
        items.iter().flat_map(Self::value_texts_of).collect()
    }

    /// Returns those texts in an expectation that name values.
    pub fn value_texts_of(item: &Tree) -> Vec<&Tree> {
        let mut texts = Vec::new();
        match &item.kind {
            Kind::Call { body: Body::Items(items), .. } => texts.extend(items),
            Kind::Call { body: Body::Fields(fields), .. } => {
                let names = ["of", "to", "around"];
                let values = fields.iter().filter(|f| names.contains(&&f.name.text[..]));
                let values = values.map(|field| &field.value);
                texts.extend(values.map(|value| value.call_of("Some").unwrap_or(value)));
            }
            _ => {}
        }
        texts.retain(|text| text.text().is_some());
        texts
    }

    /// Returns the property, if the expectation is a promise. `None` for all other expectations.
    pub(super) fn promised_property(&self) -> Option<&str> {
        match self {
            Self::Promised { property, .. } => Some(property),
            _ => None,
        }
    }

    /// Returns the name of the condition as it is written in a file, such as `Closed`.
    pub fn name(&self) -> &str {
        match self {
            Self::Closed(_) => "Closed",
            Self::Manifold(_) => "Manifold",
            Self::NoSelfIntersection(_) => "NoSelfIntersection",
            Self::Printable { .. } => "Printable",
            Self::Count { .. } => "Count",
            Self::Bounds { .. } => "Bounds",
            Self::Near { .. } => "Near",
            Self::Whole { .. } => "Whole",
            Self::Bend { .. } => "Bend",
            Self::Continuity { .. } => "Continuity",
            Self::Attribute { .. } => "Attribute",
            Self::Promised { property, .. } => property,
        }
    }
}

pub(super) fn schema() -> serde_json::Value {
    schemars::schema_for!(Expectation).into()
}

#[cfg(test)]
mod tests {
    use maquette_syntax::parse;

    use super::*;

    #[test]
    fn the_texts_that_name_values_are_those_that_are_read() {
        let (list, _) = parse(
            r#"[Closed("a"), Manifold("b"), NoSelfIntersection("c"), Count(of: "d", what: "faces"),
            Bounds(of: "e", low: (0, 0, 0), high: (1, 1, 1)), Near(of: "f", to: "g", max: 1),
            Whole(of: "h", around: "i"), Bend(of: "j", max: 1), Continuity(of: "k", around: Some("l"), max: 1),
            Continuity(of: "k", order: G1, limit: deg(0.1)),
            Attribute(of: "m", name: "x"), Printable(of: "n", thickness: 1.2)]"#,
        );
        let (read, diagnostics) = Expectation::read_all(&list);
        assert_eq!(diagnostics, []);
        let values = read.iter().flat_map(|(expectation, _)| expectation.values());
        let texts = Expectation::value_texts(&list).into_iter().filter_map(Tree::text);
        assert_eq!(Vec::from_iter(texts), Vec::from_iter(values));
    }
}
