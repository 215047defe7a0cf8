//! What a graph or test expects of a value: its words, not yet the judgement.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Finding, Help, Kind, Tree, Walk, read_tree};
use schemars::JsonSchema;
use serde::Deserialize;

use super::fitting::calls_in_plain_numbers;

/// What must hold of a value, which is named by its link, `node` or `node.output`, or by the name of an output file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
pub enum Expectation {
    /// The mesh has no boundary.
    Closed(String),
    /// No edge has more than two faces, and all faces that meet look to the same side.
    Manifold(String),
    /// No two faces of the mesh run through each other.
    NoSelfIntersection(String),
    /// A printer can make it: it is closed, manifold, nowhere runs through itself, its outside is outside, and its walls are thick enough.
    Printable {
        /// The mesh.
        of: String,
        /// How thick each wall must be, in mm: how far it is from the middle of each face, straight in, to the next one. If left out, any.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        thickness: f64,
    },
    /// A number is in a range.
    Count {
        /// The value.
        of: String,
        /// What is counted: vertices, edges, faces, components, boundary edges, border loops, Euler characteristic, cells, pixels.
        what: String,
        /// At least so many.
        #[serde(default)]
        min: Option<f64>,
        /// At most so many.
        #[serde(default)]
        max: Option<f64>,
    },
    /// All of it lies in a box.
    Bounds {
        /// The value.
        of: String,
        /// Lowest coordinates, in mm.
        #[schemars(extend("unit" = "mm"))]
        low: (f64, f64, f64),
        /// Highest coordinates, in mm.
        #[schemars(extend("unit" = "mm"))]
        high: (f64, f64, f64),
    },
    /// All of its vertices are near another mesh or surface.
    Near {
        /// The value.
        of: String,
        /// The other one.
        to: String,
        /// The largest distance that counts as near, in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        max: f64,
        /// The largest root mean square of all distances, in mm.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        rms: Option<f64>,
    },
    /// Nothing is torn at a part of a capture: no border of the mesh is seen near it in the picture.
    Whole {
        /// The mesh, with its texture coordinates in the capture's picture.
        of: String,
        /// The part.
        around: String,
        /// How near counts as near, in pixels of the picture.
        #[serde(default = "fifteen")]
        #[schemars(range(min = 0.0), extend("unit" = "px"))]
        band: f64,
    },
    /// No edge of the mesh is sharp.
    Bend {
        /// The mesh.
        of: String,
        /// The largest angle between the normals of two faces that share an edge, in degrees.
        #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
        max: f64,
    },
    /// What is new goes on from what was there.
    Continuity {
        /// The mesh.
        of: String,
        /// The part that is new. If left out, the vertices of the mesh say whether they were `filled`.
        #[serde(default)]
        around: Option<String>,
        /// The largest angle between the normals of a new face and one beside it that was there, in degrees.
        #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
        max: f64,
        /// The largest jump of the curvature across the rim, as root mean square along it, in 1/mm. If left out, any.
        #[serde(default)]
        #[schemars(range(min = 0.0), extend("unit" = "1/mm"))]
        curvature: Option<f64>,
    },
    /// A number of the vertices, such as a curvature, is nowhere out of its range.
    Attribute {
        /// The mesh.
        of: String,
        /// The attribute's name.
        name: String,
        /// At least so much.
        #[serde(default)]
        min: Option<f64>,
        /// At most so much.
        #[serde(default)]
        max: Option<f64>,
    },
    /// A property of an output of a graph that others use, which it promises.
    #[serde(skip)]
    Promised {
        /// The output.
        of: String,
        /// The property.
        property: String,
    },
}

fn fifteen() -> f64 {
    15.0
}

impl Expectation {
    /// A list of expectations and where each stands, and every problem of it.
    pub(crate) fn read_all(tree: &Tree) -> (Vec<(Self, Span)>, Vec<Finding>) {
        let (tree, misfits) = &Self::in_plain_numbers(tree);
        let root = serde_json::to_value(schemars::schema_for!(Vec<Self>)).unwrap_or_default();
        let mut walk = Walk {
            node: "Graph",
            root: &root,
            sheet: None,
            findings: misfits.clone(),
            links: Vec::new(),
            files: Vec::new(),
        };
        walk.value(tree, &root, "expect");
        let mut findings = walk.findings;
        let items = match &tree.kind {
            Kind::List(items) if findings.is_empty() => &items[..],
            _ => &[],
        };
        let mut expectations = Vec::new();
        for item in items {
            match read_tree(item) {
                Ok(expectation) => expectations.push((expectation, item.span)),
                Err(error) => findings.push(Finding {
                    code: code::WRONG_VALUE,
                    span: error.span.unwrap_or(item.span),
                    message: error.message,
                    help: Help::default(),
                    note: None,
                }),
            }
        }
        (expectations, findings)
    }

    /// A list of expectations with plain numbers in place of those with a unit, and what does not fit.
    pub fn in_plain_numbers(list: &Tree) -> (Tree, Vec<Finding>) {
        let schema = serde_json::to_value(schemars::schema_for!(Self)).unwrap_or_default();
        let mut findings = Vec::new();
        (calls_in_plain_numbers(list, &schema, &mut findings), findings)
    }

    /// The values that it speaks of.
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

    /// The same, to give them other names.
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

    /// The texts in a list of expectations that name values.
    pub fn value_texts(list: &Tree) -> Vec<&Tree> {
        let Kind::List(items) = &list.kind else { return Vec::new() };
        items.iter().flat_map(Self::value_texts_of).collect()
    }

    /// The same in one of them.
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

    /// The property that it is a promise of, if it is one.
    pub(super) fn promised(&self) -> Option<&str> {
        match self {
            Self::Promised { property, .. } => Some(property),
            _ => None,
        }
    }

    /// Its name, as in the file.
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
            Attribute(of: "m", name: "x"), Printable(of: "n", thickness: 1.2)]"#,
        );
        let (read, findings) = Expectation::read_all(&list);
        assert_eq!(findings, []);
        let values = read.iter().flat_map(|(expectation, _)| expectation.values());
        let texts = Expectation::value_texts(&list).into_iter().filter_map(Tree::text);
        assert_eq!(Vec::from_iter(texts), Vec::from_iter(values));
    }
}
