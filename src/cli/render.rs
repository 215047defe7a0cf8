//! `maquette render`: a picture of a mesh or surface, from a graph or a file.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::caching::CacheOptions;
use super::inputs::InputOptions;
use super::inspect::view;
use super::progress::Progress;
use super::{Exit, GraphOptions, compare, report};
use crate::catalog::Catalog;
use crate::format::png;
use crate::plain::ending;
use crate::render::{Projection, View, render};
use crate::session::{Run, Wanted};
use crate::text::{unknown, with_article};
use crate::value::AnyValue;
use crate::writing::{Destination, Sources};

#[derive(Args)]
pub(super) struct Render {
    /// A graph file, or a file with a mesh: ply, obj, glb, stl.
    file: PathBuf,
    /// The output of the graph, or a node of it, NODE[.OUTPUT]; for a mesh file the picture to be written.
    #[arg(value_name = "OUTPUT")]
    output: PathBuf,
    /// The picture to be written, PNG.
    #[arg(value_name = "PICTURE")]
    picture: Option<PathBuf>,
    /// From where: how far to the right and above, in degrees, and how much nearer than what just fits.
    #[arg(long, value_name = "YAW,PITCH[,ZOOM]", value_parser = view, allow_hyphen_values = true)]
    camera: Option<View>,
    /// Width and height in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "800x600", value_parser = size)]
    size: [usize; 2],
    /// Far things look as large as near ones.
    #[arg(long)]
    orthographic: bool,
    #[command(flatten)]
    inputs: InputOptions,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
}

/// Larger pictures are a slip of the finger.
const LARGEST: usize = 1 << 14;

pub(super) fn size(text: &str) -> Result<[usize; 2], String> {
    let parse = |part: &str| part.trim().parse().ok().filter(|size| (1..=LARGEST).contains(size));
    let (width, height) = text.split_once('x').ok_or("write WIDTHxHEIGHT")?;
    parse(width).zip(parse(height)).map(|(w, h)| [w, h]).ok_or_else(|| "write WIDTHxHEIGHT".into())
}

impl Render {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let mut sources = Sources::default();
        let (value, picture) = match &self.picture {
            None => {
                sources.add(&self.file, "this is the file that is shown");
                (compare::read(&self.file, catalog), &self.output)
            }
            Some(picture) => match self.evaluate(catalog, &mut sources) {
                Ok(value) => (value, picture),
                Err(exit) => return exit,
            },
        };
        let value = match value {
            Ok(value) => value,
            Err(why) => return Exit::Usage(why),
        };
        if ending(picture) != "png" {
            return Exit::Usage(format!("{} is no name of a PNG file", picture.display()));
        }
        let Some(mesh) = value.as_mesh() else {
            return Exit::Usage(format!(
                "{} has no faces to be seen",
                with_article(value.kind().name)
            ));
        };
        let mut view = View { size: self.size, ..self.camera.unwrap_or_else(View::front) };
        if self.orthographic {
            view.projection = Projection::Orthographic;
        }
        let destination = Destination::anywhere(&sources);
        let written = png::encode_rgb(&render(&mesh, &view)).map_err(|error| error.to_string());
        match written
            .and_then(|bytes| destination.put(picture, &bytes).map_err(|error| error.to_string()))
        {
            Ok(()) => Exit::Done,
            Err(error) => Exit::Usage(format!("cannot write {}: {error}", picture.display())),
        }
    }

    fn evaluate(
        &self,
        catalog: &Arc<Catalog>,
        sources: &mut Sources,
    ) -> Result<Result<AnyValue, String>, Exit> {
        let checked = self.options.load(&self.file, catalog);
        report(&checked.problems);
        let graph = checked.graph.ok_or(Exit::Failed)?;
        sources.extend(&Sources::of(&graph));
        let name = self.output.to_string_lossy();
        if graph.value_named(&name).is_none() {
            let known = Vec::from_iter(graph.output_names().chain(graph.node_names()));
            let message = format!("the graph has no output or node `{name}`");
            return Ok(Err(unknown(message, &name, "it has", &known)));
        }
        let mut session = self.cache.session(0, catalog).map_err(Exit::Usage)?;
        self.inputs.protect(sources);
        let graph = self.inputs.told(&session, &graph)?;
        let progress = Progress::new(graph.nodes.len());
        let wanted = Wanted::Named(vec![name.into_owned()]);
        let run = Run { wanted, observer: &progress, ..Run::default() };
        let finished = session.run(&graph, &run).map_err(|problems| {
            report(&problems);
            Exit::Failed
        })?;
        progress.end();
        report(&finished.problems());
        finished.value(&self.output.to_string_lossy()).cloned().map(Ok).ok_or(Exit::Failed)
    }
}
