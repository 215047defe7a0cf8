use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use super::*;
use crate::error::Place;
use crate::parse;
use crate::{Walk, as_tree};

/// A shape.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
enum Shape {
    /// None.
    Nothing,
    /// A round one.
    Ball(Ball),
    /// Where another one is.
    At(Place3),
    /// As large as this.
    Size(f64),
    /// A flat one.
    Sheet {
        /// Its sides.
        sides: u32,
    },
}

/// A ball.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
struct Ball {
    /// Its radius.
    #[serde(default)]
    radius: f64,
    /// Its layers.
    #[serde(default)]
    layers: u32,
    /// What is inside.
    inside: Option<Core>,
}

/// The inside of a ball.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
enum Core {
    /// Something solid.
    Solid(Solid),
}

/// Something solid.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
struct Solid {
    /// How hard it is.
    hardness: f64,
}

/// A place.
#[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
enum Place3 {
    /// The origin.
    Origin,
    /// A point.
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

/// The value of a text as a graph would have it, or every problem of it: line, column and message.
fn read(text: &str) -> Result<Shape, Vec<String>> {
    let (tree, mistakes) = parse(text);
    assert!(mistakes.is_empty(), "{mistakes:?}");
    let root = schema();
    let mut walk = Walk {
        node: "Node",
        root: &root,
        sheet: None,
        findings: Vec::new(),
        links: Vec::new(),
        files: Vec::new(),
    };
    walk.value(&tree, &root, "shape");
    if walk.findings.is_empty() {
        return read_tree(&tree).map_err(|error| vec![format!("unchecked: {error}")]);
    }
    fn say(span: Span, message: &str, text: &str) -> String {
        let Place { line, column } = Place::of(text, span.start);
        format!("{line}:{column} {message}")
    }
    Err(walk.findings.iter().map(|finding| say(finding.span, &finding.message, text)).collect())
}

fn ball(radius: f64, layers: u32) -> Shape {
    Shape::Ball(Ball { radius, layers, inside: None })
}

#[test]
fn the_fields_of_a_struct_in_a_variant_stand_directly_behind_its_name() {
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
fn check_refused(text: &str, problems: &[&str]) {
    assert_eq!(read(text), Err(problems.iter().map(|&problem| problem.to_owned()).collect()));
}

#[test]
fn problems_of_a_struct_in_a_variant_stand_at_their_own_places() {
    check_refused(
        "Ball(\n  radus: 2,\n  layers: 1.5,\n  inside: Solid(hardness: \"2\"),\n)",
        &[
            "2:3 Ball has no field `radus`",
            "3:11 field `layers` of Node wants a number without fraction, not the number 1.5",
            "4:27 field `hardness` of Node wants a number, not the text \"2\"",
        ],
    );
    check_refused(
        "Ball(3)",
        &["1:1 field `Ball` of Node wants named fields: `(field: value, ..)`, not `Ball(..)`"],
    );
    check_refused(
        "Size(radius: 3)",
        &["1:1 `Size(..)` holds one value without a name, not `radius: ..`"],
    );
    check_refused("At", &["1:1 field `shape` of Node wants one value: `At(..)`, not `At`"]);
}

/// What goes wrong where no schema is asked: line, column and message.
fn unchecked<T: DeserializeOwned + fmt::Debug>(text: &str) -> String {
    let error = read_tree::<T>(&parse(text).0).unwrap_err();
    let Place { line, column } = Place::of(text, error.span.unwrap().start);
    format!("{line}:{column} {error}")
}

#[test]
fn serde_s_own_errors_have_places_too() {
    assert_eq!(
        read_tree::<Choice>(&parse("Strict(layers: 2)").0).unwrap(),
        Choice::Strict(Strict { layers: 2 })
    );
    assert_eq!(
        read_tree::<Choice>(&parse("Strict((layers: 2))").0).unwrap(),
        Choice::Strict(Strict { layers: 2 })
    );
    assert_eq!(
        unchecked::<Choice>("Strict(layers: 2, lairs: 1)"),
        "1:19 unknown field `lairs`, expected `layers`"
    );
    assert_eq!(
        unchecked::<Choice>("Strict(\n  layers: \"two\")"),
        "2:11 invalid type: string \"two\", expected u32"
    );
    assert_eq!(unchecked::<Vec<Choice>>("[\n Strict]"), "2:2 missing field `layers`");
    for text in ["At", "At()", "At(Point: 3)", "Size(radius: 2)"] {
        assert_eq!(unchecked::<Shape>(text), "1:1 this wants one value in parentheses", "{text}");
    }
}

#[derive(Debug, PartialEq, Deserialize)]
struct Layered {
    name: String,
    #[serde(flatten)]
    ball: Ball,
}

#[test]
fn fields_that_several_structs_share_are_read_as_their_own() {
    let text = "(layers: 3.0, name: \"a\", radius: -0.0)";
    let read: Layered = read_tree(&parse(text).0).unwrap();
    let ball = Ball { radius: 0.0, layers: 3, inside: None };
    assert_eq!(read, Layered { name: "a".into(), ball });
    assert!(read.ball.radius.is_sign_negative());
    let huge: Layered = read_tree(&parse("(name: \"b\", radius: 1e300)").0).unwrap();
    assert_eq!(huge.ball.radius, 1e300);
}

#[test]
fn a_struct_in_a_variant_is_given_back_as_its_fields() {
    for (json, shape) in [
        (json!({ "Ball": { "radius": 2.0, "layers": 3, "inside": null } }), ball(2.0, 3)),
        (json!({ "At": { "Point": [1.0, 2.0] } }), Shape::At(Place3::Point(1.0, 2.0))),
    ] {
        assert_eq!(serde_json::to_value(&shape).unwrap(), json);
        assert_eq!(read_tree::<Shape>(&as_tree(&json)).unwrap(), shape);
    }
}
