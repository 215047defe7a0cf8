//! Writes JSON for values of few numbers, readable by people and scripts.

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::{ControlNet, Direction, KnotVector, Labels, Trace};
use nalgebra::Point3;
use serde::Deserialize;
use serde_json::{Value, json};

/// Writes a direction.
pub(super) struct DirectionJson;

impl FileFormat for DirectionJson {
    type Value = Direction;
    const EXTENSION: &'static str = "json";

    fn write(direction: &Direction, name: &str) -> Result<Vec<NewFile>, Error> {
        let document = json!({
            "direction": direction.vector().as_slice(),
            "resultant": direction.resultant(),
        });
        Ok(NewFile::single(name, print(&document)))
    }
}

/// Writes a knot vector.
pub(super) struct KnotVectorJson;

impl FileFormat for KnotVectorJson {
    type Value = KnotVector;
    const EXTENSION: &'static str = "json";

    fn write(knots: &KnotVector, name: &str) -> Result<Vec<NewFile>, Error> {
        let document = json!({
            "degree": knots.degree(),
            "control_points": knots.n_control(),
            "domain": knots.domain(),
            "knots": knots.knots(),
        });
        Ok(NewFile::single(name, print(&document)))
    }
}

/// Writes the statistics of each component of a label image.
pub(super) struct LabelsJson;

impl FileFormat for LabelsJson {
    type Value = Labels;
    const EXTENSION: &'static str = "json";

    fn write(labels: &Labels, name: &str) -> Result<Vec<NewFile>, Error> {
        let components = labels.statistics().iter().zip(1..).map(|(component, label): (_, u32)| {
            json!({
                "label": label,
                "area": component.area,
                "first": component.first,
                "low": component.low,
                "high": component.high,
                "centroid": component.centroid,
                "touches_border": component.touches_border,
            })
        });
        let components: Vec<_> = components.collect();
        let document = json!({
            "width": labels.width(),
            "height": labels.height(),
            "components": components,
        });
        Ok(NewFile::single(name, print(&document)))
    }
}

/// Reads and writes a control net, row by row. The file has no frame and no chart.
pub(crate) struct ControlNetJson;

impl FileFormat for ControlNetJson {
    type Value = ControlNet;
    const EXTENSION: &'static str = "json";

    fn write(net: &ControlNet, name: &str) -> Result<Vec<NewFile>, Error> {
        let columns = net.columns();
        fn points(points: &[Point3<f64>], columns: usize) -> Value {
            Value::from_iter(points.chunks(columns).map(|row| {
                Value::from_iter(row.iter().map(|point| json!(point.coords.as_slice())))
            }))
        }
        let document = json!({
            "rows": net.rows(),
            "columns": columns,
            "points": points(net.points(), columns),
            "base": points(net.base(), columns),
            "weights": Value::from_iter(net.weights().chunks(columns).map(|row| json!(row))),
            "fixed": Value::from_iter(net.fixed_points().chunks(columns).map(|row| json!(row))),
        });
        Ok(NewFile::single(name, print(&document)))
    }
}

/// The contents of a JSON file with a control net, as [`ControlNetJson`] writes it. Other fields are ignored.
#[derive(Deserialize)]
struct ControlNetContent {
    points: Vec<Vec<[f64; 3]>>,
    #[serde(default)]
    base: Vec<Vec<[f64; 3]>>,
    #[serde(default)]
    weights: Vec<Vec<f64>>,
    #[serde(default)]
    fixed: Vec<Vec<u8>>,
}

impl FileReader for ControlNetJson {
    type Value = ControlNet;
    const EXTENSIONS: &'static [&'static str] = &["json"];

    fn read(file: &InputFile<'_>) -> Result<ControlNet, Error> {
        read_control_net(file.bytes())
    }
}

/// Reads a control net: an object with rows of `points`, and optionally rows of `weights`, of `base` points and of `fixed` flags (0 or 1).
///
/// # Errors
/// Returns an error if the text is not such an object, rows differ in length, a coordinate is not finite, or a weight is not greater than
/// 0.
fn read_control_net(bytes: &[u8]) -> Result<ControlNet, Error> {
    let content: ControlNetContent = serde_json::from_slice(bytes)
        .map_err(|error| Error::new(format!("line {}: {error}", error.line())))?;
    let rows = content.points.len();
    let columns = content.points.first().map_or(0, Vec::len);
    fn flatten<T: Clone>(
        name: &str,
        lists: &[Vec<T>],
        [rows, columns]: [usize; 2],
    ) -> Result<Vec<T>, Error> {
        let ragged = lists.iter().position(|row| row.len() != columns);
        match ragged {
            Some(row) => Err(Error::new(format!(
                "`{name}`: row {row} has {} entries, expected {columns}",
                lists[row].len()
            ))),
            None if lists.len() != rows => {
                Err(Error::new(format!("`{name}` has {} rows, expected {rows}", lists.len())))
            }
            None => Ok(lists.concat()),
        }
    }
    let size = [rows, columns];
    let points = flatten("points", &content.points, size)?;
    let points: Vec<Point3<f64>> = points.into_iter().map(Point3::from).collect();
    let mut net = if content.base.is_empty() {
        ControlNet::new(rows, columns, points)?
    } else {
        let base = flatten("base", &content.base, size)?;
        let base: Vec<Point3<f64>> = base.into_iter().map(Point3::from).collect();
        ControlNet::new(rows, columns, base)?.with_points(points)?
    };
    if !content.weights.is_empty() {
        let weights = flatten("weights", &content.weights, size)?;
        if let Some(index) = weights.iter().position(|weight| *weight <= 0.0) {
            let (row, column) = (index / columns, index % columns);
            return Err(Error::new(format!(
                "the weight of control point ({row}, {column}) is {}; expected a weight greater than 0",
                weights[index]
            )));
        }
        net = net.with_weights(weights)?;
    }
    if !content.fixed.is_empty() {
        let fixed = flatten("fixed", &content.fixed, size)?;
        if let Some(index) = fixed.iter().position(|flag| *flag > 1) {
            let (row, column) = (index / columns, index % columns);
            return Err(Error::new(format!(
                "the flag `fixed` of control point ({row}, {column}) is {}; expected 0 or 1",
                fixed[index]
            )));
        }
        net = net.with_fixed(fixed)?;
    }
    Ok(net)
}

/// Writes the steps of an iteration, and the bending energies of fillings if there are any. Infinite numbers are written as null.
pub(super) struct TraceJson;

impl FileFormat for TraceJson {
    type Value = Trace;
    const EXTENSION: &'static str = "json";

    fn write(trace: &Trace, name: &str) -> Result<Vec<NewFile>, Error> {
        let steps = trace
            .steps()
            .iter()
            .map(|step| json!({ "iteration": step.iteration, "max": step.max, "rms": step.rms }));
        let mut document = json!({ "steps": Value::from_iter(steps) });
        if !trace.bending().is_empty() {
            document["bending"] = json!(trace.bending());
        }
        Ok(NewFile::single(name, print(&document)))
    }
}

/// Formats a document as text. A list of scalars, such as a point or a row of weights, is written on one line.
pub(super) fn print(document: &Value) -> Vec<u8> {
    let mut text = String::new();
    push(&mut text, document, 0);
    text.push('\n');
    text.into_bytes()
}

fn push(text: &mut String, value: &Value, depth: usize) {
    match value {
        Value::Array(items)
            if items.iter().all(|value| !value.is_array() && !value.is_object()) =>
        {
            let items: Vec<_> = items.iter().map(Value::to_string).collect();
            text.push_str(&format!("[{}]", items.join(", ")));
        }
        Value::Array(items) => {
            text.push('[');
            for (index, item) in items.iter().enumerate() {
                break_line(text, index, depth + 1);
                push(text, item, depth + 1);
            }
            break_line(text, 0, depth);
            text.push(']');
        }
        Value::Object(entries) if !entries.is_empty() => {
            text.push('{');
            for (index, (key, entry)) in entries.iter().enumerate() {
                break_line(text, index, depth + 1);
                text.push_str(&format!("{}: ", json!(key)));
                push(text, entry, depth + 1);
            }
            break_line(text, 0, depth);
            text.push('}');
        }
        plain => text.push_str(&plain.to_string()),
    }
}

/// Begins a new line. Adds a comma before it unless `index` is 0.
fn break_line(text: &mut String, index: usize, depth: usize) {
    text.push_str(if index > 0 { ",\n" } else { "\n" });
    (0..depth).for_each(|_| text.push_str("  "));
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};
    use nalgebra::Vector3;

    use super::*;

    fn check<F: FileFormat>(value: &F::Value, expected: Expect) {
        let bytes = F::write(value, "a.json").unwrap().remove(0).bytes;
        let text = String::from_utf8(bytes).unwrap();
        assert!(serde_json::from_str::<Value>(&text).is_ok());
        expected.assert_eq(&text);
    }

    #[test]
    fn a_trace_is_its_steps() {
        use maquette_value::TraceStep;
        fn step(iteration: u64, max: f64) -> TraceStep {
            TraceStep { iteration, max, rms: 0.25 }
        }
        check::<TraceJson>(
            &Trace::new(vec![step(0, f64::INFINITY), step(2, 0.5)]).unwrap(),
            expect![[r#"
                {
                  "steps": [
                    {
                      "iteration": 0,
                      "max": null,
                      "rms": 0.25
                    },
                    {
                      "iteration": 2,
                      "max": 0.5,
                      "rms": 0.25
                    }
                  ]
                }
            "#]],
        );
    }

    #[test]
    fn a_control_net_is_read_as_it_was_written() {
        let points = (0..6).map(|k| Point3::new(0.1 * f64::from(k), -1e-300, 1.0 / 3.0));
        let net = ControlNet::new(2, 3, points.collect::<Vec<_>>()).unwrap();
        let moved = net.points().iter().map(|point| point + Vector3::z()).collect::<Vec<_>>();
        let net = net.with_points(moved).unwrap();
        let net = net.with_weights(vec![1.0, 2.0, 0.1, 1.0, 5e-3, 7.0]).unwrap();
        let net = net.with_fixed(vec![0, 1, 0, 0, 1, 1]).unwrap();
        let bytes = ControlNetJson::write(&net, "net.json").unwrap().remove(0).bytes;
        assert_eq!(read_control_net(&bytes).unwrap(), net);
        crate::hostile::check_no_panic(&bytes, |bytes| drop(read_control_net(bytes)));
    }

    #[test]
    fn an_invalid_control_net_is_refused_with_the_index() {
        fn error(text: &str) -> String {
            read_control_net(text.as_bytes()).unwrap_err().to_string()
        }
        let points = r#""points": [[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]]"#;
        assert!(read_control_net(format!("{{{points}}}").as_bytes()).is_ok());
        assert_eq!(
            error(&format!(r#"{{{points}, "weights": [[1, 1], [0, 1]]}}"#)),
            "the weight of control point (1, 0) is 0; expected a weight greater than 0"
        );
        assert_eq!(
            error(&format!(r#"{{{points}, "weights": [[1, 1], [1]]}}"#)),
            "`weights`: row 1 has 1 entries, expected 2"
        );
        assert_eq!(
            error(&format!(r#"{{{points}, "fixed": [[0, 0], [0, 2]]}}"#)),
            "the flag `fixed` of control point (1, 1) is 2; expected 0 or 1"
        );
        assert_eq!(
            error(&format!(r#"{{{points}, "weights": [[1, 1]]}}"#)),
            "`weights` has 1 rows, expected 2"
        );
        assert!(error("{}").contains("points"));
        assert!(error(r#"{"points": []}"#).contains("0 entries"));
    }

    #[test]
    fn a_trace_of_fillings_has_their_bending() {
        check::<TraceJson>(
            &Trace::default().with_bending(vec![0.5, f64::INFINITY]).unwrap(),
            expect![[r#"
                {
                  "steps": [],
                  "bending": [0.5, null]
                }
            "#]],
        );
    }

    #[test]
    fn a_direction_is_a_list_of_three() {
        let direction = Direction::mean(Vector3::new(0.0, 0.5, 0.0)).unwrap();
        check::<DirectionJson>(
            &direction,
            expect![[r#"
            {
              "direction": [0.0, 1.0, 0.0],
              "resultant": 0.5
            }
        "#]],
        );
    }

    #[test]
    fn a_knot_vector_is_one_line_of_knots() {
        let knots = KnotVector::new(1, vec![0.0, 0.0, 0.5, 1.0, 1.0]).unwrap();
        check::<KnotVectorJson>(
            &knots,
            expect![[r#"
            {
              "degree": 1,
              "control_points": 3,
              "domain": [0.0, 1.0],
              "knots": [0.0, 0.0, 0.5, 1.0, 1.0]
            }
        "#]],
        );
    }

    #[test]
    fn labels_list_their_components() {
        let labels = Labels::new(3, 2, vec![0, 9, 9, 4, 0, 0]).unwrap();
        check::<LabelsJson>(
            &labels,
            expect![[r#"
            {
              "width": 3,
              "height": 2,
              "components": [
                {
                  "label": 1,
                  "area": 2,
                  "first": [1, 0],
                  "low": [1, 0],
                  "high": [2, 0],
                  "centroid": [1.5, 0.0],
                  "touches_border": true
                },
                {
                  "label": 2,
                  "area": 1,
                  "first": [0, 1],
                  "low": [0, 1],
                  "high": [0, 1],
                  "centroid": [0.0, 1.0],
                  "touches_border": true
                }
              ]
            }
        "#]],
        );
        check::<LabelsJson>(
            &Labels::new(1, 1, vec![0]).unwrap(),
            expect![[r#"
            {
              "width": 1,
              "height": 1,
              "components": []
            }
        "#]],
        );
    }

    #[test]
    fn a_net_has_a_point_on_each_line() {
        let points = vec![Point3::origin(), Point3::new(1.0, 0.1, 2.5)];
        let net = ControlNet::new(2, 1, points).unwrap();
        check::<ControlNetJson>(
            &net,
            expect![[r#"
            {
              "rows": 2,
              "columns": 1,
              "points": [
                [
                  [0.0, 0.0, 0.0]
                ],
                [
                  [1.0, 0.1, 2.5]
                ]
              ],
              "base": [
                [
                  [0.0, 0.0, 0.0]
                ],
                [
                  [1.0, 0.1, 2.5]
                ]
              ],
              "weights": [
                [1.0],
                [1.0]
              ],
              "fixed": [
                [0],
                [0]
              ]
            }
        "#]],
        );
    }
}
