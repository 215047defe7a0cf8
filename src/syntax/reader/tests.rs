use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use super::*;
use crate::error::Position;
use crate::parse;
use crate::{Walk, as_tree};

/// A shape.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
enum Shape {
    /// No shape.
    Nothing,
    /// A ball, as a variant with a struct.
    Ball(Ball),
    /// A shape at a position.
    At(Place3),
    /// A shape of this size.
    Size(f64),
    /// A flat shape, as a variant with fields.
    Sheet {
        /// Number of sides of the sheet.
        sides: u32,
    },
}

/// A ball.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
struct Ball {
    /// Radius of the ball.
    #[serde(default)]
    radius: f64,
    /// Number of layers of the ball.
    #[serde(default)]
    layers: u32,
    /// Core inside of the ball.
    inside: Option<Core>,
}

/// The inside of a ball.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
enum Core {
    /// A solid core.
    Solid(Solid),
}

/// The material of a solid core.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
struct Solid {
    /// Hardness of the material.
    hardness: f64,
}

/// A position in the plane.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
enum Place3 {
    /// The origin.
    Origin,
    /// A point with these coordinates.
    Point(f64, f64),
}

/// A struct without defaults that knows all its fields.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Strict {
    layers: u32,
}

#[derive(Debug, PartialEq, Deserialize)]
enum Choice {
    Strict(Strict),
}

fn schema() -> Json {
    schemars::schema_for!(Shape).into()
}

/// Checks and reads a text. Errors are formatted as line, column and message.
fn read(text: &str) -> Result<Shape, Vec<String>> {
    let (tree, errors) = parse(text);
    assert!(errors.is_empty(), "{errors:?}");
    let root = schema();
    let mut walk = Walk {
        node: "Node",
        root: &root,
        source_map: None,
        diagnostics: Vec::new(),
        links: Vec::new(),
        files: Vec::new(),
    };
    walk.value(&tree, &root, "shape");
    if walk.diagnostics.is_empty() {
        return read_tree(&tree).map_err(|error| vec![format!("unchecked: {error}")]);
    }
    fn format_diagnostic(span: Span, message: &str, text: &str) -> String {
        let Position { line, column } = Position::from_offset(text, span.start);
        format!("{line}:{column} {message}")
    }
    Err(walk
        .diagnostics
        .iter()
        .map(|found| format_diagnostic(found.span, &found.message, text))
        .collect())
}

fn ball(radius: f64, layers: u32) -> Shape {
    Shape::Ball(Ball { radius, layers, inside: None })
}

#[test]
fn a_struct_in_a_variant_needs_no_extra_parentheses() {
    assert_eq!(read("Ball(radius: 2, layers: 3)"), Ok(ball(2.0, 3)));
    let inside = Some(Core::Solid(Solid { hardness: 2.0 }));
    let whole = Shape::Ball(Ball { radius: 0.0, layers: 1, inside });
    assert_eq!(
        read("Ball(\n    layers: 1.0,\n    inside: Some(Solid(hardness: 2)),\n)"),
        Ok(whole)
    );
}

#[test]
fn a_struct_in_a_variant_may_be_left_to_its_defaults() {
    for text in ["Ball", "Ball()", "Ball(radius: 0)"] {
        assert_eq!(read(text), Ok(ball(0.0, 0)), "{text}");
    }
}

#[test]
fn other_content_of_variants_stays_one_value_in_parentheses() {
    assert_eq!(read("Nothing"), Ok(Shape::Nothing));
    assert_eq!(read("Size(2)"), Ok(Shape::Size(2.0)));
    assert_eq!(read("At(Origin)"), Ok(Shape::At(Place3::Origin)));
    assert_eq!(read("At(Point(1, 2.5))"), Ok(Shape::At(Place3::Point(1.0, 2.5))));
    assert_eq!(read("Sheet(sides: 4)"), Ok(Shape::Sheet { sides: 4 }));
}

#[track_caller]
fn check_refused(text: &str, errors: &[&str]) {
    assert_eq!(read(text), Err(errors.iter().map(|&error| error.to_owned()).collect()));
}

#[test]
fn errors_in_a_struct_in_a_variant_have_their_own_positions() {
    check_refused(
        "Ball(\n  radus: 2,\n  layers: 1.5,\n  inside: Solid(hardness: \"2\"),\n)",
        &[
            "2:3 Ball has no field `radus`",
            "3:11 field `layers` of Node: expected a number without fraction, found the number 1.5",
            "4:27 field `hardness` of Node: expected a number, found the text \"2\"",
        ],
    );
    check_refused(
        "Ball(3)",
        &[
            "1:1 field `Ball` of Node: expected named fields: `(field: value, ..)`, found `Ball(..)`",
        ],
    );
    check_refused(
        "Size(radius: 3)",
        &["1:1 `Size(..)` holds one value without a name, not `radius: ..`"],
    );
    check_refused("At", &["1:1 field `shape` of Node: expected one value: `At(..)`, found `At`"]);
}

/// Deserializes a text without a schema check. Returns the error as line, column and message.
fn read_unchecked<T: DeserializeOwned + fmt::Debug>(text: &str) -> String {
    let error = read_tree::<T>(&parse(text).0).unwrap_err();
    let Position { line, column } = Position::from_offset(text, error.span.unwrap().start);
    format!("{line}:{column} {error}")
}

#[test]
fn errors_of_serde_have_positions() {
    assert_eq!(
        read_tree::<Choice>(&parse("Strict(layers: 2)").0).unwrap(),
        Choice::Strict(Strict { layers: 2 })
    );
    assert_eq!(
        read_tree::<Choice>(&parse("Strict((layers: 2))").0).unwrap(),
        Choice::Strict(Strict { layers: 2 })
    );
    assert_eq!(
        read_unchecked::<Choice>("Strict(layers: 2, lairs: 1)"),
        "1:19 unknown field `lairs`, expected `layers`"
    );
    assert_eq!(
        read_unchecked::<Choice>("Strict(\n  layers: \"two\")"),
        "2:11 invalid type: string \"two\", expected u32"
    );
    assert_eq!(read_unchecked::<Vec<Choice>>("[\n Strict]"), "2:2 missing field `layers`");
    for text in ["At", "At()", "At(Point: 3)", "Size(radius: 2)"] {
        assert_eq!(
            read_unchecked::<Shape>(text),
            "1:1 expected one value in parentheses",
            "{text}"
        );
    }
}

#[derive(Debug, PartialEq, Deserialize)]
struct FlattenedBall {
    name: String,
    #[serde(flatten)]
    ball: Ball,
}

#[test]
fn flattened_fields_are_read() {
    let text = "(layers: 3.0, name: \"a\", radius: -0.0)";
    let read: FlattenedBall = read_tree(&parse(text).0).unwrap();
    let ball = Ball { radius: 0.0, layers: 3, inside: None };
    assert_eq!(read, FlattenedBall { name: "a".into(), ball });
    assert!(read.ball.radius.is_sign_negative());
    let huge: FlattenedBall = read_tree(&parse("(name: \"b\", radius: 1e300)").0).unwrap();
    assert_eq!(huge.ball.radius, 1e300);
}

#[test]
fn a_struct_in_a_variant_survives_a_round_trip() {
    for (json, shape) in [
        (json!({ "Ball": { "radius": 2.0, "layers": 3, "inside": null } }), ball(2.0, 3)),
        (json!({ "At": { "Point": [1.0, 2.0] } }), Shape::At(Place3::Point(1.0, 2.0))),
    ] {
        assert_eq!(serde_json::to_value(&shape).unwrap(), json);
        assert_eq!(read_tree::<Shape>(&as_tree(&json)).unwrap(), shape);
    }
}
