//! Checks expectations: conditions on values that graphs and tests state.

use std::convert::Infallible;

use maquette_graph::{ContinuityOrder, Expectation, Graph, GraphExpectation};
use maquette_syntax::error::Diagnostic;
use maquette_value::{
    AnyValue, Meaning, Mesh, RangeImage, Region, SeamGaps, ViolatingElement, value_counts,
};
use nalgebra::Point3;

use super::defects::{self, Defect};
use super::digits::six_digits;
use super::distances::distances;
use super::printable::check_printable;

/// A violated expectation, with its diagnostic.
pub struct Violation {
    pub diagnostic: Diagnostic,
    /// The value that violates the expectation. `None` if the expectation names a node or output that does not exist.
    pub value: Option<AnyValue>,
    /// The centers of some of the mesh elements that violate the expectation.
    pub positions: Vec<Point3<f64>>,
}

/// The maximum number of violating elements that an error message names.
const MAX_NAMED: usize = 5;

/// Checks an expectation. Returns a description of the violation and the positions of violating elements, or `None` if the expectation
/// holds.
fn check(expectation: &Expectation, values: &[&AnyValue]) -> Defect {
    let value = values.first()?;
    match expectation {
        Expectation::Count { what, min, max, .. } => check_count(value, what, *min, *max),
        Expectation::Promised { property, .. } => {
            let violation = value.violation(property)?;
            let places = violation.elements.iter().take(1000).map(ViolatingElement::center);
            Some((violation.what, places.collect()))
        }
        Expectation::Bounds { low, high, .. } => {
            check_bounds(value, [low.0, low.1, low.2], [high.0, high.1, high.2])
        }
        Expectation::Continuity { order: Some(order), limit: Some(limit), .. }
            if value.get::<RangeImage>().is_some() =>
        {
            check_seam(value.get::<RangeImage>()?, *order, *limit)
        }
        _ => {
            let Some(mesh) = value.as_mesh() else {
                return Some((
                    format!("is a {}, which has no faces", value.kind().name),
                    Vec::new(),
                ));
            };
            match expectation {
                Expectation::Closed(_) => check_closed(&mesh),
                Expectation::Manifold(_) => check_manifold(&mesh),
                Expectation::NoSelfIntersection(_) => check_no_self_intersection(&mesh),
                Expectation::Printable { thickness, .. } => check_printable(&mesh, *thickness),
                Expectation::Bend { max, .. } => defects::check_bend(&mesh, *max),
                Expectation::Continuity { around, order, limit, max, curvature, .. } => {
                    let (max, curvature) = match (order, limit) {
                        (Some(ContinuityOrder::G1), limit) => (*limit, None),
                        (Some(ContinuityOrder::G2), limit) => (None, *limit),
                        (None, _) => (*max, *curvature),
                    };
                    let region = values.get(1).map(|value| value.get::<Region>());
                    match (around, region) {
                        (Some(around), None | Some(None)) => Some(no_region(around)),
                        (_, region) => defects::check_continuity(
                            &mesh,
                            region.flatten(),
                            max.unwrap_or(180.0),
                            curvature,
                        ),
                    }
                }
                Expectation::Attribute { name, min, max, .. } => {
                    defects::check_attribute(&mesh, name, *min, *max)
                }
                Expectation::Whole { around, band, .. } => {
                    match values.get(1).and_then(|value| value.get::<Region>()) {
                        Some(region) => defects::check_whole(&mesh, region, *band),
                        None => Some(no_region(around)),
                    }
                }
                Expectation::Near { max, rms, to, .. } => {
                    match values.get(1).and_then(|to| to.as_mesh()) {
                        Some(other) => check_near(&mesh, &other, *max, *rms, to),
                        None => {
                            Some((format!("cannot be near `{to}`, which has no faces"), Vec::new()))
                        }
                    }
                }
                _ => None,
            }
        }
    }
}

/// Checks the continuity that `Blend` has measured at the border of a region.
fn check_seam(range: &RangeImage, order: ContinuityOrder, limit: f64) -> Defect {
    let Some(SeamGaps { angle, curvature }) = range.seam() else {
        let why = "has no measured seam: it is not the result of `Blend`, or no cells on both sides of the border are on one surface";
        return Some((why.to_owned(), Vec::new()));
    };
    let why = match order {
        ContinuityOrder::G1 if angle > limit => format!(
            "has normals that differ by up to {} degrees at the seam, more than {}",
            six_digits(angle),
            six_digits(limit)
        ),
        ContinuityOrder::G2 if curvature > limit => format!(
            "has curvatures that differ by up to {}/mm at the seam, more than {}",
            six_digits(curvature),
            six_digits(limit)
        ),
        _ => return None,
    };
    Some((why, Vec::new()))
}

fn no_region(name: &str) -> (String, Vec<Point3<f64>>) {
    (format!("is not checked: `{name}` is not a region"), Vec::new())
}

/// Returns the indices of the nodes whose values the given expectations are about.
pub(crate) fn nodes_of(expectations: &[&GraphExpectation]) -> Vec<usize> {
    let values = expectations.iter().flat_map(|expected| &expected.values);
    values.flatten().map(|(node, _)| *node).collect()
}

/// Returns the violations of expectations. `value` returns the value of an output, given the indices of the node and of the output.
/// Expectations whose value could not be computed are skipped.
pub(crate) fn violations<'v>(
    graph: &Graph,
    value: impl Fn(usize, usize) -> Option<&'v AnyValue>,
    expectations: &[&GraphExpectation],
) -> Vec<Violation> {
    let mut violations = Vec::new();
    for expected in expectations {
        let expectation = &expected.expectation;
        let names = expectation.values();
        if let Some(unknown) = expected.values.iter().position(Option::is_none) {
            let message = format!("there is no output or node `{}`", names[unknown]);
            let help = graph.value_help(names[unknown]);
            let diagnostic = Diagnostic { help, ..expected.diagnostic(message) };
            violations.push(Violation { diagnostic, value: None, positions: Vec::new() });
            continue;
        }
        let values = expected.values.iter().flatten();
        let values: Vec<_> = values.filter_map(|&(node, output)| value(node, output)).collect();
        if values.len() < names.len() {
            continue;
        }
        if let Some((why, places)) = check(expectation, &values) {
            let message = format!("expected {}, but `{}` {why}", expectation.name(), names[0]);
            let (diagnostic, value) =
                (expected.diagnostic(message), values.first().copied().cloned());
            violations.push(Violation { diagnostic, value, positions: places });
        }
    }
    violations
}

/// Describes the edges `offending`, for example `3 edges: 1-2, 4-7, ..`. Also returns their midpoints.
fn edges(mesh: &Mesh, offending: &[[u32; 2]], what: &str) -> Defect {
    if offending.is_empty() {
        return None;
    }
    fn midpoint(mesh: &Mesh, [a, b]: [u32; 2]) -> Point3<f64> {
        nalgebra::center(&mesh.positions()[a as usize], &mesh.positions()[b as usize])
    }
    let names = offending.iter().take(MAX_NAMED).map(|[a, b]| format!("{a}-{b}"));
    let more = if offending.len() > MAX_NAMED { ", .." } else { "" };
    let first = midpoint(mesh, offending[0]);
    let why = format!(
        "has {} {what} (vertices {}{more}; the first is at ({}, {}, {}))",
        offending.len(),
        Vec::from_iter(names).join(", "),
        six_digits(first.x),
        six_digits(first.y),
        six_digits(first.z)
    );
    Some((why, offending.iter().take(1000).map(|edge| midpoint(mesh, *edge)).collect()))
}

pub(super) fn check_closed(mesh: &Mesh) -> Defect {
    let found = mesh.edges();
    let open = found.vertices.iter().zip(&found.faces).filter(|(_, faces)| **faces == 1);
    edges(mesh, &open.map(|(edge, _)| *edge).collect::<Vec<_>>(), "edges with one face")
}

pub(super) fn check_manifold(mesh: &Mesh) -> Defect {
    let found = mesh.edges();
    let many = found.vertices.iter().zip(&found.faces).filter(|(_, faces)| **faces > 2);
    let many: Vec<[u32; 2]> = many.map(|(edge, _)| *edge).collect();
    if let Some(why) = edges(mesh, &many, "edges with more than two faces") {
        return Some(why);
    }
    if found.misoriented == 0 {
        return None;
    }
    // For each edge, its start vertex in the face visited before. Two faces of equal orientation pass an edge in opposite directions.
    let mut before = vec![u32::MAX; found.vertices.len()];
    let mut twice = Vec::new();
    let corners =
        mesh.faces().iter().flat_map(|face| face.iter().zip(face[1..].iter().chain(&face[..1])));
    for ((&from, &to), &edge) in corners.zip(&found.of_corner) {
        if std::mem::replace(&mut before[edge as usize], from) == from {
            twice.push([from, to]);
        }
    }
    edges(mesh, &twice, "edges between faces of opposite orientation")
}

pub(super) fn check_no_self_intersection(mesh: &Mesh) -> Defect {
    let pairs = mesh.crossings(|| Ok::<_, Infallible>(())).unwrap_or_else(|never| match never {});
    if pairs.is_empty() {
        return None;
    }
    let names = pairs.iter().take(MAX_NAMED).map(|[a, b]| format!("{a} and {b}"));
    let more = if pairs.len() > MAX_NAMED { ", .." } else { "" };
    let count = pairs.len();
    let why = format!(
        "has {count} pair{} of intersecting faces (faces {}{more})",
        if count == 1 { "" } else { "s" },
        Vec::from_iter(names).join(", ")
    );
    Some((
        why,
        pairs
            .iter()
            .take(1000)
            .map(|[face, _]| {
                let face = mesh.faces().face(*face as usize);
                let sum: nalgebra::Vector3<f64> =
                    face.iter().map(|&vertex| mesh.positions()[vertex as usize].coords).sum();
                Point3::from(sum / face.len() as f64)
            })
            .collect(),
    ))
}

fn check_count(value: &AnyValue, what: &str, min: Option<f64>, max: Option<f64>) -> Defect {
    let counts = value_counts(value);
    let Some(&(_, found)) = counts.iter().find(|(name, _)| *name == what) else {
        let names = counts.iter().map(|(name, _)| &**name).collect::<Vec<_>>().join(", ");
        let kind = value.kind().name;
        return Some((
            format!("is a {kind}, which has no count of `{what}`, only of {names}"),
            Vec::new(),
        ));
    };
    let fits =
        min.is_none_or(|min| min <= found as f64) && max.is_none_or(|max| found as f64 <= max);
    fn limit(word: &str, limit: Option<f64>) -> Option<String> {
        limit.map(|limit| format!("{word} {limit}"))
    }
    let wanted: Vec<String> =
        [limit("at least", min), limit("at most", max)].into_iter().flatten().collect();
    (!fits).then(|| (format!("has {found} {what}, expected {}", wanted.join(" and ")), Vec::new()))
}

fn check_bounds(value: &AnyValue, low: [f64; 3], high: [f64; 3]) -> Defect {
    let points = match value.as_mesh() {
        Some(mesh) => Some(mesh.positions().to_vec()),
        None => {
            let parts = value.parts();
            let mut columns = parts.columns.iter();
            let places = columns.find(|part| part.meaning == Meaning::Position);
            places.and_then(|part| part.to_points().ok())
        }
    };
    let Some(mut points) = points else {
        return Some((format!("is a {}, which has no bounds", value.kind().name), Vec::new()));
    };
    // Ignore grid cells without a point: their position is NaN.
    points.retain(|point| !point.x.is_nan());
    fn is_outside(p: &Point3<f64>, low: [f64; 3], high: [f64; 3]) -> bool {
        (0..3).any(|k| p[k] < low[k] || high[k] < p[k])
    }
    let outside: Vec<usize> =
        (0..points.len()).filter(|&index| is_outside(&points[index], low, high)).collect();
    let first = *outside.first()?;
    let p = points[first];
    let why = format!(
        "has {} vertices outside of the box; the first is {first} at ({}, {}, {})",
        outside.len(),
        six_digits(p.x),
        six_digits(p.y),
        six_digits(p.z)
    );
    Some((why, outside.iter().take(1000).map(|&index| points[index]).collect()))
}

fn check_near(mesh: &Mesh, other: &Mesh, max: f64, rms: Option<f64>, to: &str) -> Defect {
    let distances = distances(mesh, other);
    let squares: f64 = distances.iter().map(|distance| distance * distance).sum();
    let found = (squares / distances.len().max(1) as f64).sqrt();
    if let Some(most) = rms.filter(|most| found > *most) {
        let why = format!(
            "is {} mm from `{to}` on average (RMS), more than {}",
            six_digits(found),
            six_digits(most)
        );
        return Some((why, Vec::new()));
    }
    let far: Vec<usize> = (0..distances.len()).filter(|&vertex| distances[vertex] > max).collect();
    let worst = *far.iter().max_by(|&&a, &&b| distances[a].total_cmp(&distances[b]))?;
    let p = mesh.positions()[worst];
    let why = format!(
        "has {} vertices farther than {} mm from `{to}`; the worst is {worst} at ({}, {}, {}), {} mm away",
        far.len(),
        six_digits(max),
        six_digits(p.x),
        six_digits(p.y),
        six_digits(p.z),
        six_digits(distances[worst])
    );
    Some((why, far.iter().take(1000).map(|&vertex| mesh.positions()[vertex]).collect()))
}
