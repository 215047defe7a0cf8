//! What must hold of a value whatever its parameters are: assertions in graphs and in tests.

use std::convert::Infallible;

use maquette_graph::{Expectation, Expected, Graph};
use maquette_syntax::error::Problem;
use maquette_value::{AnyValue, Meaning, Mesh, Offender, Region, counted};
use nalgebra::Point3;

use super::distances::distances;
use super::looks::{self, Wrong};
use super::printable::printable;
use super::six::six;

/// An expectation that does not hold.
pub struct Violation {
    pub problem: Problem,
    /// The value for which it does not hold.
    pub value: Option<AnyValue>,
    /// Where in space it does not: the middle of offending elements, some of them.
    pub places: Vec<Point3<f64>>,
}

/// How many offending elements are named.
const NAMED: usize = 5;

/// Checks it; what is wrong if it does not hold, with the places of offending elements.
fn check(expectation: &Expectation, values: &[&AnyValue]) -> Wrong {
    let value = values.first()?;
    match expectation {
        Expectation::Count { what, min, max, .. } => count(value, what, *min, *max),
        Expectation::Promised { property, .. } => {
            let offence = value.offence(property)?;
            let places = offence.elements.iter().take(1000).map(Offender::place);
            Some((offence.what, places.collect()))
        }
        Expectation::Bounds { low, high, .. } => {
            bounds(value, [low.0, low.1, low.2], [high.0, high.1, high.2])
        }
        _ => {
            let Some(mesh) = value.as_mesh() else {
                return Some((
                    format!("is a {}, which has no faces", value.kind().name),
                    Vec::new(),
                ));
            };
            match expectation {
                Expectation::Closed(_) => closed(&mesh),
                Expectation::Manifold(_) => manifold(&mesh),
                Expectation::NoSelfIntersection(_) => no_self_intersection(&mesh),
                Expectation::Printable { thickness, .. } => printable(&mesh, *thickness),
                Expectation::Bend { max, .. } => looks::bend(&mesh, *max),
                Expectation::Continuity { around, max, curvature, .. } => {
                    let region = values.get(1).map(|value| value.get::<Region>());
                    match (around, region) {
                        (Some(around), None | Some(None)) => Some(no_region(around)),
                        (_, region) => looks::continuity(&mesh, region.flatten(), *max, *curvature),
                    }
                }
                Expectation::Attribute { name, min, max, .. } => {
                    looks::numbers(&mesh, name, *min, *max)
                }
                Expectation::Whole { around, band, .. } => {
                    match values.get(1).and_then(|value| value.get::<Region>()) {
                        Some(region) => looks::whole(&mesh, region, *band),
                        None => Some(no_region(around)),
                    }
                }
                Expectation::Near { max, rms, to, .. } => {
                    match values.get(1).and_then(|to| to.as_mesh()) {
                        Some(other) => near(&mesh, &other, *max, *rms, to),
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

fn no_region(name: &str) -> (String, Vec<Point3<f64>>) {
    (format!("is not judged: `{name}` is no region"), Vec::new())
}

/// The nodes whose values these expectations speak of.
pub(crate) fn nodes_of(expectations: &[&Expected]) -> Vec<usize> {
    let values = expectations.iter().flat_map(|expected| &expected.values);
    values.flatten().map(|(node, _)| *node).collect()
}

/// Expectations that do not hold, of the values that `value` gives by node and output. Those whose values could not be computed are not
/// judged.
pub(crate) fn violations<'v>(
    graph: &Graph,
    value: impl Fn(usize, usize) -> Option<&'v AnyValue>,
    expectations: &[&Expected],
) -> Vec<Violation> {
    let mut violations = Vec::new();
    for expected in expectations {
        let expectation = &expected.expectation;
        let names = expectation.values();
        if let Some(unknown) = expected.values.iter().position(Option::is_none) {
            let message = format!("there is no output or node `{}`", names[unknown]);
            let help = graph.value_meant(names[unknown]);
            let problem = Problem { help, ..expected.problem(message) };
            violations.push(Violation { problem, value: None, places: Vec::new() });
            continue;
        }
        let values = expected.values.iter().flatten();
        let values: Vec<_> = values.filter_map(|&(node, output)| value(node, output)).collect();
        if values.len() < names.len() {
            continue;
        }
        if let Some((why, places)) = check(expectation, &values) {
            let message = format!("expected {}, but `{}` {why}", expectation.name(), names[0]);
            let (problem, value) = (expected.problem(message), values.first().copied().cloned());
            violations.push(Violation { problem, value, places });
        }
    }
    violations
}

/// `3 edges: 1-2, 4-7, ..`, and the middles of the edges.
fn edges(mesh: &Mesh, offending: &[[u32; 2]], what: &str) -> Wrong {
    if offending.is_empty() {
        return None;
    }
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let middle = |[a, b]: &[u32; 2]| nalgebra::center(&place(*a, mesh), &place(*b, mesh));
    let names = offending.iter().take(NAMED).map(|[a, b]| format!("{a}-{b}"));
    let more = if offending.len() > NAMED { ", .." } else { "" };
    let first = middle(&offending[0]);
    let why = format!(
        "has {} {what} (vertices {}{more}; the first is at ({}, {}, {}))",
        offending.len(),
        Vec::from_iter(names).join(", "),
        six(first.x),
        six(first.y),
        six(first.z)
    );
    Some((why, offending.iter().take(1000).map(middle).collect()))
}

pub(super) fn closed(mesh: &Mesh) -> Wrong {
    let found = mesh.edges();
    let open = found.vertices.iter().zip(&found.faces).filter(|(_, faces)| **faces == 1);
    edges(mesh, &open.map(|(edge, _)| *edge).collect::<Vec<_>>(), "edges with one face")
}

pub(super) fn manifold(mesh: &Mesh) -> Wrong {
    let found = mesh.edges();
    let many = found.vertices.iter().zip(&found.faces).filter(|(_, faces)| **faces > 2);
    let many: Vec<[u32; 2]> = many.map(|(edge, _)| *edge).collect();
    if let Some(why) = edges(mesh, &many, "edges with more than two faces") {
        return Some(why);
    }
    if found.misoriented == 0 {
        return None;
    }
    // Where the face that met an edge before came from.
    let mut before = vec![u32::MAX; found.vertices.len()];
    let mut twice = Vec::new();
    let corners =
        mesh.faces().iter().flat_map(|face| face.iter().zip(face[1..].iter().chain(&face[..1])));
    for ((&from, &to), &edge) in corners.zip(&found.of_corner) {
        if std::mem::replace(&mut before[edge as usize], from) == from {
            twice.push([from, to]);
        }
    }
    edges(mesh, &twice, "edges between faces that look to different sides")
}

pub(super) fn no_self_intersection(mesh: &Mesh) -> Wrong {
    let pairs = mesh.crossings(|| Ok::<_, Infallible>(())).unwrap_or_else(|never| match never {});
    if pairs.is_empty() {
        return None;
    }
    let names = pairs.iter().take(NAMED).map(|[a, b]| format!("{a} and {b}"));
    let more = if pairs.len() > NAMED { ", .." } else { "" };
    let count = pairs.len();
    let why = format!(
        "has {count} pair{} of faces that run through each other (faces {}{more})",
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

fn count(value: &AnyValue, what: &str, min: Option<f64>, max: Option<f64>) -> Wrong {
    let counts = counted(value);
    let Some(&(_, found)) = counts.iter().find(|(name, _)| *name == what) else {
        let names = counts.iter().map(|(name, _)| &**name).collect::<Vec<_>>().join(", ");
        let kind = value.kind().name;
        return Some((
            format!("is a {kind}, of which no `{what}` are counted, only: {names}"),
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
    (!fits)
        .then(|| (format!("has {found} {what}; wanted are {}", wanted.join(" and ")), Vec::new()))
}

fn bounds(value: &AnyValue, low: [f64; 3], high: [f64; 3]) -> Wrong {
    let points = match value.as_mesh() {
        Some(mesh) => Some(mesh.positions().to_vec()),
        None => {
            let parts = value.parts();
            let mut columns = parts.columns.iter();
            let places = columns.find(|part| part.meaning == Meaning::Position);
            places.and_then(|part| part.places().ok())
        }
    };
    let Some(mut points) = points else {
        return Some((format!("is a {}, which has no bounds", value.kind().name), Vec::new()));
    };
    // Cells without a point are nowhere.
    points.retain(|point| !point.x.is_nan());
    fn outside(p: &Point3<f64>, low: [f64; 3], high: [f64; 3]) -> bool {
        (0..3).any(|k| p[k] < low[k] || high[k] < p[k])
    }
    let outside: Vec<usize> =
        (0..points.len()).filter(|&index| outside(&points[index], low, high)).collect();
    let first = *outside.first()?;
    let p = points[first];
    let why = format!(
        "has {} vertices outside of the box; the first is {first} at ({}, {}, {})",
        outside.len(),
        six(p.x),
        six(p.y),
        six(p.z)
    );
    Some((why, outside.iter().take(1000).map(|&index| points[index]).collect()))
}

fn near(mesh: &Mesh, other: &Mesh, max: f64, rms: Option<f64>, to: &str) -> Wrong {
    let distances = distances(mesh, other);
    let squares: f64 = distances.iter().map(|distance| distance * distance).sum();
    let found = (squares / distances.len().max(1) as f64).sqrt();
    if let Some(most) = rms.filter(|most| found > *most) {
        let why =
            format!("is {} mm from `{to}` on average (RMS), more than {}", six(found), six(most));
        return Some((why, Vec::new()));
    }
    let far: Vec<usize> = (0..distances.len()).filter(|&vertex| distances[vertex] > max).collect();
    let worst = *far.iter().max_by(|&&a, &&b| distances[a].total_cmp(&distances[b]))?;
    let p = mesh.positions()[worst];
    let why = format!(
        "has {} vertices farther than {} mm from `{to}`; the worst is {worst} at ({}, {}, {}), {} mm away",
        far.len(),
        six(max),
        six(p.x),
        six(p.y),
        six(p.z),
        six(distances[worst])
    );
    Some((why, far.iter().take(1000).map(|&vertex| mesh.positions()[vertex]).collect()))
}
