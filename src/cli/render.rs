//! `maquette render`: renders a picture of a value of a graph or file, contact sheets, or a gallery.

mod gallery;
mod sheet;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, Subcommand};
use maquette_engine::session::{Run, Targets};
use maquette_engine::writing::{Destination, Sources};
use maquette_format::png;
use maquette_graph::catalog::Catalog;
use maquette_node::CancelToken;
use maquette_render::{Projection, Representation, View};
use maquette_value::Image;
use maquette_value::fs::extension;

use super::inspect::parse_view;
use super::progress::Progress;
use super::viewpoint::{
    CameraTarget, OverOptions, PictureRequest, ValueSource, find_target, parse_camera_target,
};
use super::{EvaluationOptions, Exit, compare, report};
use crate::DisplayPath;

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Render {
    #[command(subcommand)]
    overview: Option<Overview>,
    #[command(flatten)]
    picture: PictureOptions,
}

/// Renderings of whole graphs.
#[derive(Subcommand)]
enum Overview {
    /// Render contact sheets: each graph from five sides, with the minimum and the maximum of each parameter.
    Sheet(sheet::Sheet),
    /// Write a page of all graphs of a folder, each with its picture.
    Gallery(gallery::Gallery),
}

/// Options for a picture of one value.
#[derive(Args)]
struct PictureOptions {
    /// A graph file, or a file with a value: a mesh (ply, obj, glb, stl), points, a curve, a range image (pcd), a picture.
    #[arg(required = true)]
    file: Option<PathBuf>,
    /// The output of the graph, or a node: NODE[.OUTPUT]. For a file with a value, the picture to write.
    #[arg(value_name = "OUTPUT", required = true)]
    output: Option<PathBuf>,
    /// The picture to write, PNG.
    #[arg(value_name = "PICTURE")]
    picture: Option<PathBuf>,
    /// The camera: degrees to the right and above, and the zoom relative to a value that fills the picture.
    #[arg(long, value_name = "YAW,PITCH[,ZOOM]", value_parser = parse_view, allow_hyphen_values = true)]
    camera: Option<View>,
    /// The center of the picture: a point (in mm, in the axes of the value), or a value of the graph, such as a region, which fills the
    /// picture. Use ZOOM to go nearer.
    #[arg(long, value_name = "X,Y,Z|NODE[.OUTPUT]", value_parser = parse_space_target, allow_hyphen_values = true)]
    at: Option<CameraTarget>,
    #[command(flatten)]
    over: OverOptions,
    /// Width and height in pixels [default: 800x600, or the size of a flat picture].
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<[usize; 2]>,
    /// Use orthographic projection.
    #[arg(long)]
    orthographic: bool,
    #[command(flatten)]
    evaluation: EvaluationOptions,
}

/// The maximum width and height in pixels. Larger numbers are probably typing errors.
const MAX_SIZE: usize = 1 << 14;

pub(super) fn parse_size(text: &str) -> Result<[usize; 2], String> {
    fn parse(part: &str) -> Option<usize> {
        part.trim().parse::<usize>().ok()
    }
    let parts = text.split_once('x').and_then(|(width, height)| parse(width).zip(parse(height)));
    let (width, height) = parts.ok_or("expected WIDTHxHEIGHT")?;
    match [width, height].iter().all(|size| (1..=MAX_SIZE).contains(size)) {
        true => Ok([width, height]),
        false => Err(format!("expected 1 to {MAX_SIZE} pixels in each direction")),
    }
}

/// Parses the target of the camera: a point in space, or the name of a value of the graph.
fn parse_space_target(text: &str) -> Result<CameraTarget, String> {
    match parse_camera_target(text)? {
        CameraTarget::Pixel(_) => Err("expected X,Y,Z for a point, NODE or NODE.OUTPUT".into()),
        at => Ok(at),
    }
}

impl Render {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        match &self.overview {
            Some(Overview::Sheet(sheet)) => sheet.run(catalog),
            Some(Overview::Gallery(gallery)) => gallery.run(catalog),
            None => self.picture.run(catalog),
        }
    }
}

impl PictureOptions {
    fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        // clap requires both arguments unless a subcommand is given, so this error should not occur.
        let (Some(file), Some(output)) = (&self.file, &self.output) else {
            return Exit::Usage("expected FILE, `sheet` or `gallery`".into());
        };
        let picture = self.picture.as_ref().unwrap_or(output);
        if extension(picture) != "png" {
            return Exit::Usage(format!("expected a PNG file, found {}", picture.for_display()));
        }
        let mut sources = Sources::default();
        let made = match &self.picture {
            None => self.render_file(file, catalog, &mut sources),
            Some(_) => self.render_graph(file, &output.to_string_lossy(), catalog, &mut sources),
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
            Err(error) => Exit::Usage(format!("cannot write {}: {error}", picture.for_display())),
        }
    }

    /// Returns a request for the picture that the options describe.
    fn request(&self) -> PictureRequest<'_> {
        let mut view = self.camera.unwrap_or_else(View::front);
        if self.orthographic {
            view.projection = Projection::Orthographic;
        }
        let is_aimed = self.camera.is_some() || self.at.is_some();
        let kind = match self.size {
            _ if is_aimed => Representation::Space,
            Some(_) => Representation::Fitted,
            None => Representation::Native,
        };
        view.size = self.size.unwrap_or(view.size);
        PictureRequest { view, kind, target: self.at.as_ref(), over: &self.over, broken: &[] }
    }

    fn render_file(
        &self,
        file: &Path,
        catalog: &Arc<Catalog>,
        sources: &mut Sources,
    ) -> Result<Image, Exit> {
        sources.add(file, "this is the file that is shown");
        self.request().check(None).map_err(Exit::Usage)?;
        let value = compare::read_value(file, catalog).map_err(Exit::Usage)?;
        self.request().picture(&value, None)
    }

    fn render_graph(
        &self,
        file: &Path,
        name: &str,
        catalog: &Arc<Catalog>,
        sources: &mut Sources,
    ) -> Result<Image, Exit> {
        let checked = self.evaluation.graph.load(file, catalog).without_unknown_nodes();
        report(&checked.diagnostics);
        let graph = checked.graph.ok_or(Exit::Failed)?;
        sources.extend(&Sources::of_graph(&graph));
        let is_whole = graph.loops().is_empty();
        let check = |graph| {
            let (node, _) = find_target(graph, name).map_err(Exit::Usage)?;
            self.request().check(Some(graph)).map_err(Exit::Usage)?;
            Ok(node)
        };
        if is_whole {
            check(&graph)?;
        }
        let mut session =
            self.evaluation.cache.reporting_session(0, catalog).map_err(Exit::Usage)?;
        self.evaluation.inputs.protect(sources);
        let graph = self.evaluation.inputs.feed_and_report(&session, &graph)?;
        let progress = Progress::new(graph.nodes().len());
        let request = self.request();
        let names = Vec::from_iter([name].into_iter().chain(request.names()));
        let graph = session.resolve_for(&graph, &names, &progress, &CancelToken::default());
        let node = check(&graph)?;
        let wanted = Targets::Named(vec![name.to_string()]);
        let run = Run { targets: wanted, observer: &progress, ..Run::default() };
        let finished = session.run(&graph, &run).map_err(|diagnostics| {
            report(&diagnostics);
            Exit::Failed
        })?;
        progress.end();
        report(&finished.diagnostics());
        let value = finished.value(name).ok_or(Exit::Failed)?;
        let source = ValueSource { graph: &graph, node, session: &mut session };
        self.request().picture(value, Some(source))
    }
}
