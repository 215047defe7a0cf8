//! How `inspect` and `render` look at a value: at what the camera aims, and on which picture a flat one lies.

use std::collections::HashSet;

use clap::Args;
use maquette_engine::session::{Run, Session, Wanted};
use maquette_graph::{Broken, Graph};
use maquette_render::{Aim, Ground, Kind, Look, View, picture, picture_of};
use maquette_syntax::error::Problem;
use maquette_syntax::{unknown, with_article};
use maquette_value::{AnyValue, Image, Meaning, Picture, RangeImage, Value};
use nalgebra::Point3;

use super::{Exit, report};

/// What `--at` names.
#[derive(Clone, Debug)]
pub(super) enum At {
    /// A pixel.
    Pixel([usize; 2]),
    /// A place in space.
    Place(Point3<f64>),
    /// A value of the graph.
    Value(String),
}

impl At {
    /// The name of a value.
    fn name(&self) -> Option<&str> {
        match self {
            Self::Value(name) => Some(name),
            Self::Pixel(_) | Self::Place(_) => None,
        }
    }
}

/// Two numbers are a pixel, three a place, anything else a name.
pub(super) fn at(text: &str) -> Result<At, String> {
    const WRITE: &str = "write COLUMN,ROW for a pixel, X,Y,Z for a place, or NODE or NODE.OUTPUT";
    let parts: Vec<_> = text.split(',').map(str::trim).collect();
    fn number(part: &str) -> Option<f64> {
        part.parse::<f64>().ok().filter(|number| number.is_finite())
    }
    match parts[..] {
        [name] if !name.is_empty() && number(name).is_none() => Ok(At::Value(name.to_owned())),
        [x, y] => {
            let pixel = x.parse().ok().zip(y.parse().ok());
            pixel.map(|(x, y)| At::Pixel([x, y])).ok_or_else(|| WRITE.into())
        }
        [x, y, z] => {
            let place = number(x).zip(number(y)).zip(number(z));
            place.map(|((x, y), z)| At::Place(Point3::new(x, y, z))).ok_or_else(|| WRITE.into())
        }
        _ => Err(WRITE.into()),
    }
}

/// The picture that a flat one lies on.
#[derive(Args)]
pub(super) struct Over {
    /// Draw a region, labels or a mask on this picture of the graph. Without it, a region and labels lie on the nearest picture of
    /// their size that they were made from.
    #[arg(long, value_name = "NODE[.OUTPUT]")]
    over: Option<String>,
}

/// How a picture of a value is to be made.
pub(super) struct Request<'a> {
    pub(super) view: View,
    pub(super) kind: Kind,
    pub(super) at: Option<&'a At>,
    pub(super) over: &'a Over,
    /// What of the value is not as it is asked to be: it is marked.
    pub(super) broken: &'a [Broken],
}

/// The graph of a value, with the node that gives it.
pub(super) struct Source<'a> {
    pub(super) graph: &'a Graph,
    pub(super) node: usize,
    pub(super) session: &'a mut Session,
}

impl Request<'_> {
    /// Whether the graph has all that is named; without a graph nothing may be.
    ///
    /// # Errors
    /// In words, with a guess at what was meant.
    pub(super) fn check(&self, graph: Option<&Graph>) -> Result<(), String> {
        let find = |name: &str| match graph {
            Some(graph) => place(graph, name).map(|at| (graph, at)),
            None => Err(format!("`{name}` is a node of no graph: a file is shown alone")),
        };
        self.at.and_then(At::name).map(find).transpose()?;
        let Some(name) = &self.over.over else { return Ok(()) };
        let (graph, below) = find(name)?;
        match gives::<Image>(graph, below) {
            true => Ok(()),
            false => Err(format!("`{name}` gives no Image, which is what --over takes")),
        }
    }

    /// The values that it names.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.at.and_then(At::name).into_iter().chain(self.over.over.as_deref())
    }

    /// Whether it says at what to aim, or what lies below.
    pub(super) fn is_special(&self) -> bool {
        self.at.is_some() || self.over.over.is_some()
    }

    /// The picture.
    ///
    /// # Errors
    /// If nothing of what is asked for can be seen, or something that is named fails.
    pub(super) fn picture(
        &self,
        value: &AnyValue,
        source: Option<Source<'_>>,
    ) -> Result<Image, Exit> {
        let mut layers = value.show();
        self.broken.iter().for_each(|broken| broken.offence.mark(&mut layers));
        let flat = picture_of(&layers).filter(|_| self.kind != Kind::Space);
        fn what(value: &AnyValue) -> String {
            with_article(value.kind().name)
        }
        if self.over.over.is_some() && flat.is_none() {
            let why = "is seen in space, not as a flat picture that lies on another";
            return Err(Exit::Usage(format!("{} {why}: leave --over out", what(value))));
        }
        let (mut view, mut ground) = (self.view, None);
        match (self.at, source) {
            (Some(At::Value(name)), Some(mut source)) => view.aim = Some(source.aim(name)?),
            (Some(At::Place(place)), _) => view.aim = Some(Aim::Place(*place)),
            (_, Some(source)) => {
                let found = flat.map(|picture| source.ground(picture, self.over)).transpose()?;
                ground = found.flatten();
            }
            (_, None) => {}
        }
        let below = ground.as_ref().and_then(Ground::below);
        picture(&layers, &Look { view, kind: self.kind, below }).ok_or_else(|| {
            let (why, help) = match picture_of(&layers) {
                Some(_) => (
                    "is a flat picture, which lies nowhere in space",
                    "leave --at and the camera out",
                ),
                None => ("has nothing to be seen", "`maquette inspect` prints what it is"),
            };
            Exit::Usage(format!("{} {why}: {help}", what(value)))
        })
    }
}

impl Source<'_> {
    /// Aims at all of a value.
    fn aim(&mut self, name: &str) -> Result<Aim, Exit> {
        let target = place(self.graph, name).map_err(Exit::Usage)?;
        let value = self.values(&[target]).map_err(failed)?.pop().ok_or(Exit::Failed)?;
        Aim::around(places_of(&value)).ok_or_else(|| {
            let what = with_article(value.kind().name);
            let help = "--at takes what has points, such as meshes, regions and curves";
            Exit::Usage(format!("`{name}` gives {what}, which lies nowhere in space: {help}"))
        })
    }

    /// What a flat picture of the value lies on: what is asked for, or the nearest picture that it was made from, if its colors were
    /// made up for the drawing.
    fn ground(mut self, picture: &Picture, over: &Over) -> Result<Option<Ground>, Exit> {
        let chosen = over.over.as_ref().map(|name| place(self.graph, name));
        let chosen = chosen.transpose().map_err(Exit::Usage)?;
        self.ground_or(picture, chosen).map_err(failed)
    }

    /// The same of this output, or of the nearest one.
    ///
    /// # Errors
    /// If what the value was made from cannot be computed.
    pub(super) fn ground_or(
        &mut self,
        picture: &Picture,
        over: Option<(usize, usize)>,
    ) -> Result<Option<Ground>, Vec<Problem>> {
        let linked = linked(self.graph, self.node);
        let chosen = match over {
            Some(place) => vec![place],
            None if picture.drawn && picture.registration.is_none() => images(self.graph, &linked),
            None => return Ok(None),
        };
        let grids = linked.into_iter().filter(|at| gives::<RangeImage>(self.graph, *at));
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
                return Ok(Some(Ground { image, registration }));
            }
        }
        Ok(None)
    }

    /// The values of some outputs of nodes, which take no time if the value was computed from them.
    fn values(&mut self, targets: &[(usize, usize)]) -> Result<Vec<AnyValue>, Vec<Problem>> {
        let wanted = Wanted::Nodes(
            targets.iter().map(|&(node, _)| self.graph.nodes()[node].name.clone()).collect(),
        );
        let run = Run { wanted, ..Run::default() };
        let finished = self.session.run(self.graph, &run)?;
        let values: Option<Vec<AnyValue>> = targets
            .iter()
            .map(|&(node, output)| {
                let node = &self.graph.nodes()[node];
                finished.value_of(&node.name, node.outputs[output]).cloned()
            })
            .collect();
        values.ok_or_else(|| finished.problems())
    }
}

fn failed(problems: Vec<Problem>) -> Exit {
    report(&problems);
    Exit::Failed
}

/// The node and output of this name.
pub(super) fn place(graph: &Graph, name: &str) -> Result<(usize, usize), String> {
    graph.value_named(name).ok_or_else(|| {
        let node =
            name.split_once('.').and_then(|(node, output)| Some((graph.find(node)?, output)));
        if let Some((node, output)) = node {
            let node = &graph.nodes()[node];
            let message = format!("`{}` has no output `{output}`", node.name);
            return unknown(message, output, "its outputs", &node.outputs);
        }
        let known: Vec<_> = graph.output_names().chain(graph.names()).collect();
        graph.unknown("output or node", name, "it has", &known)
    })
}

/// All places of which a value is made.
fn places_of(value: &AnyValue) -> Vec<Point3<f64>> {
    let parts = value.parts();
    let columns = parts.columns.iter().filter(|part| part.meaning == Meaning::Position);
    columns.filter_map(|part| part.places().ok()).flatten().collect()
}

/// The outputs of nodes that a node hangs on, the nearest first.
fn linked(graph: &Graph, node: usize) -> Vec<(usize, usize)> {
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

/// The pictures among some outputs, then those of the same nodes that nothing is linked to.
fn images(graph: &Graph, linked: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let beside = linked.iter().flat_map(|&(node, _)| {
        (0..graph.nodes()[node].outputs.len()).map(move |output| (node, output))
    });
    let mut images = Vec::new();
    for at in linked.iter().copied().chain(beside).filter(|at| gives::<Image>(graph, *at)) {
        if !images.contains(&at) {
            images.push(at);
        }
    }
    images
}

fn gives<T: Value>(graph: &Graph, (node, output): (usize, usize)) -> bool {
    let kind = graph.nodes()[node].types.get(output).copied().flatten();
    kind.is_some_and(|kind| kind.name == T::NAME)
}
