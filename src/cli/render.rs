//! `maquette render`: a picture of any value, from a graph or a file.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::{Run, Wanted};
use maquette_engine::writing::{Destination, Sources};
use maquette_format::png;
use maquette_graph::catalog::Catalog;
use maquette_node::CancelToken;
use maquette_render::{Kind, Projection, View};
use maquette_value::Image;
use maquette_value::plain::ending;

use super::caching::CacheOptions;
use super::inputs::InputOptions;
use super::inspect::view;
use super::look::{At, Over, Request, Source, at, place};
use super::progress::Progress;
use super::{Exit, GraphOptions, compare, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Render {
    /// A graph file, or a file with a value: a mesh (ply, obj, glb, stl), points, a curve, a range image (pcd), a picture.
    file: PathBuf,
    /// The output of the graph, or a node of it, NODE[.OUTPUT]; for any other file the picture to be written.
    #[arg(value_name = "OUTPUT")]
    output: PathBuf,
    /// The picture to be written, PNG.
    #[arg(value_name = "PICTURE")]
    picture: Option<PathBuf>,
    /// From where: how far to the right and above, in degrees, and how much nearer than what just fits.
    #[arg(long, value_name = "YAW,PITCH[,ZOOM]", value_parser = view, allow_hyphen_values = true)]
    camera: Option<View>,
    /// What is in the middle: a place, in mm, in the axes of what is shown, or a value of the graph, such as a region, which then just
    /// fits into the picture. ZOOM goes nearer.
    #[arg(long, value_name = "X,Y,Z|NODE[.OUTPUT]", value_parser = at_in_space, allow_hyphen_values = true)]
    at: Option<At>,
    #[command(flatten)]
    over: Over,
    /// Width and height in pixels: 800x600 for what lies in space; as many as it has for what is a flat picture.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<[usize; 2]>,
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
    fn parse(part: &str) -> Option<usize> {
        part.trim().parse::<usize>().ok()
    }
    let parts = text.split_once('x').and_then(|(width, height)| parse(width).zip(parse(height)));
    let (width, height) = parts.ok_or("write WIDTHxHEIGHT")?;
    match [width, height].iter().all(|size| (1..=LARGEST).contains(size)) {
        true => Ok([width, height]),
        false => Err(format!("a picture has 1 to {LARGEST} pixels each way")),
    }
}

/// A place in space or a name.
fn at_in_space(text: &str) -> Result<At, String> {
    match at(text)? {
        At::Pixel(_) => Err("write X,Y,Z for a place, or NODE or NODE.OUTPUT".into()),
        at => Ok(at),
    }
}

impl Render {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let picture = self.picture.as_ref().unwrap_or(&self.output);
        if ending(picture) != "png" {
            return Exit::Usage(format!("{} is no name of a PNG file", picture.shown()));
        }
        let mut sources = Sources::default();
        let made = match &self.picture {
            None => self.of_file(catalog, &mut sources),
            Some(_) => self.of_graph(catalog, &mut sources),
        };
        let image = match made {
            Ok(image) => image,
            Err(exit) => return exit,
        };
        let destination = Destination::anywhere(&sources);
        let written = png::encode_rgb(&image).map_err(|error| error.to_string());
        match written
            .and_then(|bytes| destination.put(picture, &bytes).map_err(|error| error.to_string()))
        {
            Ok(()) => Exit::Done,
            Err(error) => Exit::Usage(format!("cannot write {}: {error}", picture.shown())),
        }
    }

    /// What the options say of the picture.
    fn request(&self) -> Request<'_> {
        let mut view = self.camera.unwrap_or_else(View::front);
        if self.orthographic {
            view.projection = Projection::Orthographic;
        }
        let is_aimed = self.camera.is_some() || self.at.is_some();
        let kind = match self.size {
            _ if is_aimed => Kind::Space,
            Some(_) => Kind::Fitted,
            None => Kind::Own,
        };
        view.size = self.size.unwrap_or(view.size);
        Request { view, kind, at: self.at.as_ref(), over: &self.over, broken: &[] }
    }

    fn of_file(&self, catalog: &Arc<Catalog>, sources: &mut Sources) -> Result<Image, Exit> {
        sources.add(&self.file, "this is the file that is shown");
        self.request().check(None).map_err(Exit::Usage)?;
        let value = compare::read(&self.file, catalog).map_err(Exit::Usage)?;
        self.request().picture(&value, None)
    }

    fn of_graph(&self, catalog: &Arc<Catalog>, sources: &mut Sources) -> Result<Image, Exit> {
        let checked = self.options.load(&self.file, catalog).as_far_as_known();
        report(&checked.problems);
        let graph = checked.graph.ok_or(Exit::Failed)?;
        sources.extend(&Sources::of(&graph));
        let name = self.output.to_string_lossy();
        let is_whole = graph.loops().is_empty();
        let check = |graph| {
            let (node, _) = place(graph, &name).map_err(Exit::Usage)?;
            self.request().check(Some(graph)).map_err(Exit::Usage)?;
            Ok(node)
        };
        if is_whole {
            check(&graph)?;
        }
        let mut session = self.cache.told_session(0, catalog).map_err(Exit::Usage)?;
        self.inputs.protect(sources);
        let graph = self.inputs.told(&session, &graph)?;
        let progress = Progress::new(graph.nodes().len());
        let request = self.request();
        let names = Vec::from_iter([&name[..]].into_iter().chain(request.names()));
        let graph = session.resolved_for(&graph, &names, &progress, &CancelToken::default());
        let node = check(&graph)?;
        let wanted = Wanted::Named(vec![name.to_string()]);
        let run = Run { wanted, observer: &progress, ..Run::default() };
        let finished = session.run(&graph, &run).map_err(|problems| {
            report(&problems);
            Exit::Failed
        })?;
        progress.end();
        report(&finished.problems());
        let value = finished.value(&name).ok_or(Exit::Failed)?;
        let source = Source { graph: &graph, node, session: &mut session };
        self.request().picture(value, Some(source))
    }
}
