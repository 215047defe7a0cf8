//! What must hold of a value whatever its parameters are: assertions in graphs and in tests.

use std::collections::HashMap;
use std::sync::Arc;

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::Deserialize;

use super::compare::{distances, six};
use super::intersect::intersections;
use super::looks;
use super::topology::Topology;
use crate::error::{Problem, Severity, Source, Span, code};
use crate::eval::Evaluation;
use crate::graph::Graph;
use crate::text::{Finding, Kind, Tree, Walk, nearest_or_all, read_tree};
use crate::value::{AnyValue, Labels, Mask, Mesh, Points, RangeImage, Region, Surface};

/// What must hold of a value, which is named by its link, `node` or `node.output`, or by the name of an output file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
pub(crate) enum Expectation {
    /// The mesh has no boundary.
    Closed(String),
    /// No edge has more than two faces, and all faces that meet look to the same side.
    Manifold(String),
    /// No two faces of the mesh run through each other.
    NoSelfIntersection(String),
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
        low: (f64, f64, f64),
        /// Highest coordinates, in mm.
        high: (f64, f64, f64),
    },
    /// All of its vertices are near another mesh or surface.
    Near {
        /// The value.
        of: String,
        /// The other one.
        to: String,
        /// The largest distance that counts as near, in mm.
        #[schemars(range(min = 0.0))]
        max: f64,
        /// The largest root mean square of all distances, in mm.
        #[serde(default)]
        #[schemars(range(min = 0.0))]
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
        #[schemars(range(min = 0.0))]
        band: f64,
    },
    /// No edge of the mesh is sharp.
    Bend {
        /// The mesh.
        of: String,
        /// The largest angle between the normals of two faces that share an edge, in degrees.
        #[schemars(range(min = 0.0, max = 180.0))]
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
        #[schemars(range(min = 0.0, max = 180.0))]
        max: f64,
        /// The largest jump of the curvature across the rim, as root mean square along it, in 1/mm. If left out, any.
        #[serde(default)]
        #[schemars(range(min = 0.0))]
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
}

fn fifteen() -> f64 {
    15.0
}

/// Where an expectation stands.
#[derive(Clone)]
pub(crate) struct Place {
    pub(crate) source: Arc<Source>,
    pub(crate) span: Span,
}

/// An expectation that does not hold.
pub(crate) struct Violation {
    pub(crate) problem: Problem,
    /// The value of which it does not.
    pub(crate) value: Option<AnyValue>,
    /// Where in space it does not: the middle of offending elements, some of them.
    pub(crate) places: Vec<Point3<f64>>,
}

/// How many offending elements are named.
const NAMED: usize = 5;

impl Expectation {
    /// A list of expectations and where each stands, and every problem of it.
    pub(crate) fn read_all(tree: &Tree) -> (Vec<(Self, Span)>, Vec<Finding>) {
        let root = serde_json::to_value(schemars::schema_for!(Vec<Self>)).unwrap_or_default();
        let mut walk = Walk {
            node: "Graph",
            root: &root,
            folder: std::path::Path::new(""),
            findings: Vec::new(),
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
                    help: String::new(),
                    note: None,
                }),
            }
        }
        (expectations, findings)
    }

    /// The values that it speaks of.
    pub(crate) fn values(&self) -> Vec<&str> {
        match self {
            Self::Closed(of) | Self::Manifold(of) | Self::NoSelfIntersection(of) => vec![of],
            Self::Count { of, .. } | Self::Bounds { of, .. } => vec![of],
            Self::Bend { of, .. } | Self::Attribute { of, .. } => vec![of],
            Self::Continuity { of, around, .. } => {
                [&of[..]].into_iter().chain(around.as_deref()).collect()
            }
            Self::Near { of, to, .. } => vec![of, to],
            Self::Whole { of, around, .. } => vec![of, around],
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Closed(_) => "Closed",
            Self::Manifold(_) => "Manifold",
            Self::NoSelfIntersection(_) => "NoSelfIntersection",
            Self::Count { .. } => "Count",
            Self::Bounds { .. } => "Bounds",
            Self::Near { .. } => "Near",
            Self::Whole { .. } => "Whole",
            Self::Bend { .. } => "Bend",
            Self::Continuity { .. } => "Continuity",
            Self::Attribute { .. } => "Attribute",
        }
    }

    /// Checks it; what is wrong if it does not hold, with the places of offending elements.
    fn check(&self, values: &[&AnyValue]) -> Option<(String, Vec<Point3<f64>>)> {
        let value = values.first()?;
        match self {
            Self::Count { what, min, max, .. } => count(value, what, *min, *max),
            Self::Bounds { low, high, .. } => {
                bounds(value, [low.0, low.1, low.2], [high.0, high.1, high.2])
            }
            _ => {
                let Some(mesh) = mesh_of(value) else {
                    return Some((
                        format!("is a {}, which has no faces", value.kind().name),
                        Vec::new(),
                    ));
                };
                match self {
                    Self::Closed(_) => closed(&mesh),
                    Self::Manifold(_) => manifold(&mesh),
                    Self::NoSelfIntersection(_) => no_self_intersection(&mesh),
                    Self::Bend { max, .. } => looks::bend(&mesh, *max),
                    Self::Continuity { around, max, curvature, .. } => {
                        let region = values.get(1).map(|value| value.get::<Region>());
                        match (around, region) {
                            (Some(around), None | Some(None)) => Some(no_region(around)),
                            (_, region) => {
                                looks::continuity(&mesh, region.flatten(), *max, *curvature)
                            }
                        }
                    }
                    Self::Attribute { name, min, max, .. } => {
                        looks::numbers(&mesh, name, *min, *max)
                    }
                    Self::Whole { around, band, .. } => {
                        match values.get(1).and_then(|value| value.get::<Region>()) {
                            Some(region) => looks::whole(&mesh, region, *band),
                            None => Some(no_region(around)),
                        }
                    }
                    Self::Near { max, rms, to, .. } => {
                        match values.get(1).and_then(|to| mesh_of(to)) {
                            Some(other) => near(&mesh, &other, *max, *rms, to),
                            None => Some((
                                format!("cannot be near `{to}`, which has no faces"),
                                Vec::new(),
                            )),
                        }
                    }
                    _ => None,
                }
            }
        }
    }
}

fn no_region(name: &str) -> (String, Vec<Point3<f64>>) {
    (format!("is not judged: `{name}` is no region"), Vec::new())
}

/// The node and output that a name of an expectation means.
pub(crate) fn target(graph: &Graph, name: &str) -> Option<(usize, usize)> {
    if let Some(output) = graph.outputs.iter().find(|output| output.name == name) {
        return Some((output.node, output.output));
    }
    graph.target(name)
}

/// The nodes whose values these expectations speak of.
pub(crate) fn nodes_of(graph: &Graph, expectations: &[(Expectation, Place)]) -> Vec<usize> {
    let values = expectations.iter().flat_map(|(expectation, _)| expectation.values());
    values.filter_map(|value| target(graph, value).map(|(node, _)| node)).collect()
}

impl Graph {
    /// What the graph's own file expects.
    pub(crate) fn expectations(&self) -> Vec<(Expectation, Place)> {
        let place = |span: Span| Place { source: self.source.clone(), span };
        self.expect.iter().map(|(expectation, span)| (expectation.clone(), place(*span))).collect()
    }
}

/// Expectations that do not hold. Those whose values could not be computed are not judged.
pub(crate) fn violations(
    graph: &Graph,
    evaluation: &Evaluation,
    expectations: &[(Expectation, Place)],
) -> Vec<Violation> {
    let mut violations = Vec::new();
    for (expectation, place) in expectations {
        let names = expectation.values();
        let targets: Vec<_> = names.iter().map(|name| target(graph, name)).collect();
        let problem = |message: String| Problem {
            severity: Severity::Error,
            code: code::EXPECTED,
            source: place.source.clone(),
            span: place.span,
            message,
            help: String::new(),
            note: None,
            uses: Vec::new(),
        };
        if let Some(unknown) = targets.iter().position(Option::is_none) {
            let message = format!("there is no output or node `{}`", names[unknown]);
            let known = graph.outputs.iter().map(|output| &output.name[..]);
            let known = known.chain(graph.nodes.iter().map(|node| &node.name[..]));
            let known = Vec::from_iter(known.filter(|name| !name.contains('/')));
            let help = nearest_or_all(names[unknown], "its outputs and nodes", &known);
            let problem = Problem { help, ..problem(message) };
            violations.push(Violation { problem, value: None, places: Vec::new() });
            continue;
        }
        let values =
            targets.iter().flatten().filter_map(|&(node, output)| evaluation.value(node, output));
        let values: Vec<&AnyValue> = values.collect();
        if values.len() < names.len() {
            continue;
        }
        if let Some((why, places)) = expectation.check(&values) {
            let message = format!("expected {}, but `{}` {why}", expectation.name(), names[0]);
            let (problem, value) = (problem(message), values.first().copied().cloned());
            violations.push(Violation { problem, value, places });
        }
    }
    violations
}

fn mesh_of(value: &AnyValue) -> Option<Mesh> {
    let surface = || value.get::<Surface>()?.tessellate(0, 0).ok();
    value.get::<Mesh>().cloned().or_else(surface)
}

/// `3 edges: 1-2, 4-7, ..`, and the middles of the edges.
fn edges(mesh: &Mesh, offending: &[[u32; 2]], what: &str) -> Option<(String, Vec<Point3<f64>>)> {
    if offending.is_empty() {
        return None;
    }
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let middle = |[a, b]: &[u32; 2]| nalgebra::center(&place(*a), &place(*b));
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

fn closed(mesh: &Mesh) -> Option<(String, Vec<Point3<f64>>)> {
    let found = mesh.edges();
    let open = found.vertices.iter().zip(&found.faces).filter(|(_, faces)| **faces == 1);
    edges(mesh, &open.map(|(edge, _)| *edge).collect::<Vec<_>>(), "edges with one face")
}

fn manifold(mesh: &Mesh) -> Option<(String, Vec<Point3<f64>>)> {
    let found = mesh.edges();
    let many = found.vertices.iter().zip(&found.faces).filter(|(_, faces)| **faces > 2);
    let many: Vec<[u32; 2]> = many.map(|(edge, _)| *edge).collect();
    if let Some(why) = edges(mesh, &many, "edges with more than two faces") {
        return Some(why);
    }
    let mut directions: HashMap<[u32; 2], ()> = HashMap::new();
    let mut twice = Vec::new();
    for face in mesh.faces().iter() {
        for (&from, &to) in face.iter().zip(face[1..].iter().chain(&face[..1])) {
            if directions.insert([from, to], ()).is_some() {
                twice.push([from, to]);
            }
        }
    }
    edges(mesh, &twice, "edges between faces that look to different sides")
}

fn no_self_intersection(mesh: &Mesh) -> Option<(String, Vec<Point3<f64>>)> {
    let pairs = intersections(mesh);
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
    let middle = |[face, _]: &[u32; 2]| {
        let face = mesh.faces().face(*face as usize);
        let sum: nalgebra::Vector3<f64> =
            face.iter().map(|&vertex| mesh.positions()[vertex as usize].coords).sum();
        Point3::from(sum / face.len() as f64)
    };
    Some((why, pairs.iter().take(1000).map(middle).collect()))
}

fn count(
    value: &AnyValue,
    what: &str,
    min: Option<f64>,
    max: Option<f64>,
) -> Option<(String, Vec<Point3<f64>>)> {
    let counts: Vec<(&str, i64)> = if let Some(mesh) = mesh_of(value) {
        let loops = [("border loops", looks::border_loops(&mesh) as i64)];
        Topology::of(&mesh).facts().into_iter().chain(loops).collect()
    } else if let Some(mask) = value.get::<Mask>() {
        vec![("pixels", mask.count() as i64)]
    } else if let Some(labels) = value.get::<Labels>() {
        vec![("components", labels.statistics().len() as i64)]
    } else if let Some(range) = value.get::<RangeImage>() {
        vec![("cells", range.n_valid() as i64)]
    } else if let Some(region) = value.get::<Region>() {
        vec![("cells", region.cells().len() as i64)]
    } else if let Some(points) = value.get::<Points>() {
        vec![("points", points.positions().len() as i64)]
    } else {
        Vec::new()
    };
    let Some(&(_, found)) = counts.iter().find(|(name, _)| *name == what) else {
        let names = Vec::from_iter(counts.iter().map(|(name, _)| *name)).join(", ");
        let kind = value.kind().name;
        return Some((
            format!("is a {kind}, of which no `{what}` are counted, only: {names}"),
            Vec::new(),
        ));
    };
    let fits =
        min.is_none_or(|min| min <= found as f64) && max.is_none_or(|max| found as f64 <= max);
    let limit = |word: &str, limit: Option<f64>| limit.map(|limit| format!("{word} {limit}"));
    let wanted: Vec<String> =
        [limit("at least", min), limit("at most", max)].into_iter().flatten().collect();
    (!fits)
        .then(|| (format!("has {found} {what}; wanted are {}", wanted.join(" and ")), Vec::new()))
}

fn bounds(value: &AnyValue, low: [f64; 3], high: [f64; 3]) -> Option<(String, Vec<Point3<f64>>)> {
    let points: Vec<Point3<f64>> = if let Some(mesh) = mesh_of(value) {
        mesh.positions().to_vec()
    } else if let Some(range) = value.get::<RangeImage>() {
        range.points().iter().filter(|p| p.x.is_finite()).copied().collect()
    } else if let Some(points) = value.get::<Points>() {
        points.positions().to_vec()
    } else if let Some(region) = value.get::<Region>() {
        region.points().to_vec()
    } else {
        return Some((format!("is a {}, which has no bounds", value.kind().name), Vec::new()));
    };
    let outside = |p: &Point3<f64>| (0..3).any(|k| p[k] < low[k] || high[k] < p[k]);
    let outside: Vec<usize> = (0..points.len()).filter(|&index| outside(&points[index])).collect();
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

fn near(
    mesh: &Mesh,
    other: &Mesh,
    max: f64,
    rms: Option<f64>,
    to: &str,
) -> Option<(String, Vec<Point3<f64>>)> {
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
