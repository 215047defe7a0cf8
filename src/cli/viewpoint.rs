//! The target of the camera and the background, for pictures that `inspect` and `render` draw.

use std::collections::HashSet;

use clap::Args;
use maquette_engine::session::{Run, Session, Targets};
use maquette_graph::{Graph, UnmetRequirement};
use maquette_render::{Aim, Look, OwnedBackdrop, Representation, View, picture, picture_layer};
use maquette_syntax::error::Diagnostic;
use maquette_syntax::{unknown_name_message, with_article};
use maquette_value::{AnyValue, Image, Meaning, Picture, RangeImage, Value};
use nalgebra::Point3;

use super::{Exit, report};

/// The value of the option `--at`: what the camera aims at.
#[derive(Clone, Debug)]
pub(super) enum CameraTarget {
    /// A pixel, given as [column, row].
    Pixel([usize; 2]),
    /// A point in space, in mm, in the coordinate axes of the shown value.
    Point(Point3<f64>),
    /// The value with this name in the graph.
    Value(String),
}

impl CameraTarget {
    /// Returns the name of the value if the target is a value, otherwise `None`.
    fn name(&self) -> Option<&str> {
        match self {
            Self::Value(name) => Some(name),
            Self::Pixel(_) | Self::Point(_) => None,
        }
    }
}

/// Parses the option `--at`. Two numbers are a pixel, three numbers are a point, and anything else is the name of a value.
pub(super) fn parse_camera_target(text: &str) -> Result<CameraTarget, String> {
    const EXPECTED: &str =
        "expected COLUMN,ROW for a pixel, X,Y,Z for a point, NODE or NODE.OUTPUT";
    let parts: Vec<_> = text.split(',').map(str::trim).collect();
    fn number(part: &str) -> Option<f64> {
        part.parse::<f64>().ok().filter(|number| number.is_finite())
    }
    match parts[..] {
        [name] if !name.is_empty() && number(name).is_none() => {
            Ok(CameraTarget::Value(name.to_owned()))
        }
        [x, y] => {
            let pixel = x.parse().ok().zip(y.parse().ok());
            pixel.map(|(x, y)| CameraTarget::Pixel([x, y])).ok_or_else(|| EXPECTED.into())
        }
        [x, y, z] => {
            let place = number(x).zip(number(y)).zip(number(z));
            place
                .map(|((x, y), z)| CameraTarget::Point(Point3::new(x, y, z)))
                .ok_or_else(|| EXPECTED.into())
        }
        _ => Err(EXPECTED.into()),
    }
}

/// Option for the picture behind a flat picture.
#[derive(Args)]
pub(super) struct OverOptions {
    /// Draw a region, labels or a mask over this picture of the graph [default for regions and labels: the nearest picture of the same size
    /// from which they were computed].
    #[arg(long, value_name = "NODE[.OUTPUT]")]
    over: Option<String>,
}

/// A request for a picture of a value: the camera, the background and the marked elements.
pub(super) struct PictureRequest<'a> {
    pub(super) view: View,
    pub(super) kind: Representation,
    pub(super) target: Option<&'a CameraTarget>,
    pub(super) over: &'a OverOptions,
    /// The required properties that the value does not have. Elements that violate them are marked in the picture.
    pub(super) broken: &'a [UnmetRequirement],
}

/// The graph and the node that compute a value, and the session for evaluating further values.
pub(super) struct ValueSource<'a> {
    pub(super) graph: &'a Graph,
    pub(super) node: usize,
    pub(super) session: &'a mut Session,
}

impl PictureRequest<'_> {
    /// Checks that the values that the options name exist in the graph. Without a graph, no values may be named.
    ///
    /// # Errors
    /// A message that suggests similar names.
    pub(super) fn check(&self, graph: Option<&Graph>) -> Result<(), String> {
        let find = |name: &str| match graph {
            Some(graph) => find_target(graph, name).map(|at| (graph, at)),
            None => Err(format!("cannot use `{name}`: a file with a value has no nodes")),
        };
        self.target.and_then(CameraTarget::name).map(find).transpose()?;
        let Some(name) = &self.over.over else { return Ok(()) };
        let (graph, below) = find(name)?;
        match has_output_type::<Image>(graph, below) {
            true => Ok(()),
            false => Err(format!("`{name}` has no Image output, which --over needs")),
        }
    }

    /// Returns the names of the graph's values that the options use.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.target.and_then(CameraTarget::name).into_iter().chain(self.over.over.as_deref())
    }

    /// Returns true if the options set a camera target or a background picture.
    pub(super) fn has_target(&self) -> bool {
        self.target.is_some() || self.over.over.is_some()
    }

    /// Renders the picture of a value.
    ///
    /// # Errors
    /// If the value is not visible, or if a value that the options name cannot be computed.
    pub(super) fn picture(
        &self,
        value: &AnyValue,
        source: Option<ValueSource<'_>>,
    ) -> Result<Image, Exit> {
        let mut layers = value.show();
        self.broken.iter().for_each(|broken| broken.violation.mark(&mut layers));
        let flat = picture_layer(&layers).filter(|_| self.kind != Representation::Space);
        fn describe_kind(value: &AnyValue) -> String {
            with_article(value.kind().name)
        }
        if self.over.over.is_some() && flat.is_none() {
            let why = "has a position in space and cannot be drawn over a picture";
            return Err(Exit::Usage(format!("{} {why}; omit --over", describe_kind(value))));
        }
        let (mut view, mut ground) = (self.view, None);
        match (self.target, source) {
            (Some(CameraTarget::Value(name)), Some(mut source)) => {
                view.aim = Some(source.aim(name)?);
            }
            (Some(CameraTarget::Point(place)), _) => view.aim = Some(Aim::Point(*place)),
            (_, Some(source)) => {
                let found =
                    flat.map(|picture| source.find_backdrop(picture, self.over)).transpose()?;
                ground = found.flatten();
            }
            (_, None) => {}
        }
        let below = ground.as_ref().and_then(OwnedBackdrop::backdrop);
        picture(&layers, &Look { view, representation: self.kind, backdrop: below }).ok_or_else(
            || {
                let (why, help) = match picture_layer(&layers) {
                    Some(_) => (
                        "is a flat picture without a position in space",
                        "omit --at and the camera",
                    ),
                    None => ("is not visible", "use `maquette inspect` to print facts about it"),
                };
                Exit::Usage(format!("{} {why}; {help}", describe_kind(value)))
            },
        )
    }
}

impl ValueSource<'_> {
    /// Returns a camera target in which the value with this name just fits into the picture.
    fn aim(&mut self, name: &str) -> Result<Aim, Exit> {
        let target = find_target(self.graph, name).map_err(Exit::Usage)?;
        let value = self.values(&[target]).map_err(report_failure)?.pop().ok_or(Exit::Failed)?;
        Aim::at_points(positions_of(&value)).ok_or_else(|| {
            let what = with_article(value.kind().name);
            let help = "use a value with points for --at, such as a mesh, a region or a curve";
            Exit::Usage(format!("`{name}` is {what}, which has no position in space; {help}"))
        })
    }

    /// Returns the background of a flat picture. This is the picture that `--over` names. Without that option, a value in false colors is
    /// drawn on the nearest picture from which it was computed.
    fn find_backdrop(
        mut self,
        picture: &Picture,
        over: &OverOptions,
    ) -> Result<Option<OwnedBackdrop>, Exit> {
        let chosen = over.over.as_ref().map(|name| find_target(self.graph, name));
        let chosen = chosen.transpose().map_err(Exit::Usage)?;
        self.backdrop_of(picture, chosen).map_err(report_failure)
    }

    /// Returns the background: the output that `over` names, or else the nearest picture from which the value was computed.
    ///
    /// # Errors
    /// The diagnostics, if the background or the values on which it depends cannot be computed.
    pub(super) fn backdrop_of(
        &mut self,
        picture: &Picture,
        over: Option<(usize, usize)>,
    ) -> Result<Option<OwnedBackdrop>, Vec<Diagnostic>> {
        let linked = linked_outputs(self.graph, self.node);
        let chosen = match over {
            Some(place) => vec![place],
            None if picture.has_false_colors && picture.registration.is_none() => {
                image_outputs(self.graph, &linked)
            }
            None => return Ok(None),
        };
        let grids = linked.into_iter().filter(|at| has_output_type::<RangeImage>(self.graph, *at));
        let grids = self.values(&Vec::from_iter(grids))?;
        let grids = grids.iter().filter_map(AnyValue::get::<RangeImage>);
        let size = [picture.image.width(), picture.image.height()];
        let of_grids =
            grids.filter(|it| [it.width(), it.height()] == size).map(|it| *it.registration());
        let known: Vec<_> = picture.registration.into_iter().chain(of_grids).collect();
        for image in self.values(&chosen)? {
            let Some(given) = image.get::<Image>().map(|it| [it.width(), it.height()]) else {
                continue;
            };
            let registration = known.iter().copied().find(|known| known.picture == given);
            if registration.is_some() || given == size || over.is_some() {
                return Ok(Some(OwnedBackdrop { image, registration }));
            }
        }
        Ok(None)
    }

    /// Returns the values of some outputs of nodes. They are usually cached, because the shown value was computed from them.
    fn values(&mut self, targets: &[(usize, usize)]) -> Result<Vec<AnyValue>, Vec<Diagnostic>> {
        let wanted = Targets::Nodes(
            targets.iter().map(|&(node, _)| self.graph.nodes()[node].name.clone()).collect(),
        );
        let run = Run { targets: wanted, ..Run::default() };
        let finished = self.session.run(self.graph, &run)?;
        let values: Option<Vec<AnyValue>> = targets
            .iter()
            .map(|&(node, output)| {
                let node = &self.graph.nodes()[node];
                finished.value_of(&node.name, node.outputs[output]).cloned()
            })
            .collect();
        values.ok_or_else(|| finished.diagnostics())
    }
}

fn report_failure(diagnostics: Vec<Diagnostic>) -> Exit {
    report(&diagnostics);
    Exit::Failed
}

/// Returns the node and the output, by index, of the value with this name.
pub(super) fn find_target(graph: &Graph, name: &str) -> Result<(usize, usize), String> {
    graph.find_value(name).ok_or_else(|| {
        let node =
            name.split_once('.').and_then(|(node, output)| Some((graph.find(node)?, output)));
        if let Some((node, output)) = node {
            let node = &graph.nodes()[node];
            let message = format!("`{}` has no output `{output}`", node.name);
            return unknown_name_message(message, output, "its outputs", &node.outputs);
        }
        let known: Vec<_> = graph.output_names().chain(graph.names()).collect();
        graph.unknown("output or node", name, "it has", &known)
    })
}

/// Returns the positions of all points that a value contains.
fn positions_of(value: &AnyValue) -> Vec<Point3<f64>> {
    let parts = value.parts();
    let columns = parts.columns.iter().filter(|part| part.meaning == Meaning::Position);
    columns.filter_map(|part| part.to_points().ok()).flatten().collect()
}

/// Returns all outputs of nodes on which a node depends, as (node, output). The nearest come first.
fn linked_outputs(graph: &Graph, node: usize) -> Vec<(usize, usize)> {
    let (mut found, mut next) = (Vec::new(), 0);
    let mut visited = HashSet::from([node]);
    let mut nodes = vec![node];
    while let Some(&node) = nodes.get(next) {
        for link in &graph.nodes()[node].links {
            found.push((link.node, link.output));
            nodes.extend(visited.insert(link.node).then_some(link.node));
        }
        next += 1;
    }
    found
}

/// Returns those outputs in `linked` that are pictures, followed by other pictures of the same nodes.
fn image_outputs(graph: &Graph, linked: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let beside = linked.iter().flat_map(|&(node, _)| {
        (0..graph.nodes()[node].outputs.len()).map(move |output| (node, output))
    });
    let mut images = Vec::new();
    for at in linked.iter().copied().chain(beside).filter(|at| has_output_type::<Image>(graph, *at))
    {
        if !images.contains(&at) {
            images.push(at);
        }
    }
    images
}

fn has_output_type<T: Value>(graph: &Graph, (node, output): (usize, usize)) -> bool {
    let kind = graph.nodes()[node].types.get(output).copied().flatten();
    kind.is_some_and(|kind| kind.name == T::NAME)
}
