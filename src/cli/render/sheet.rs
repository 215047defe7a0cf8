//! `maquette render sheet`: writes contact sheets. Each shows the output of a graph from five sides, for the minimum and the maximum of
//! each parameter.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use maquette_engine::session::Session;
use maquette_engine::writing::{Destination, Sources};
use maquette_format::png;
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, Options};
use maquette_render::{Look, Representation, View, picture};
use maquette_syntax::resolve_field;
use maquette_value::{Image, Layer, Rgb};
use serde_json::Value as Json;

use super::parse_size;
use crate::cache_options::CacheOptions;
use crate::files::{filter_paths, is_no_graph};
use crate::{Exit, GraphOptions, all_outputs, print, report};

/// Each sheet has a row for the defaults and one for the minimum and the maximum of each parameter.
#[derive(Args)]
pub(crate) struct Sheet {
    /// The graphs. If several files are given, tests, lock files, pins and layouts are skipped.
    #[arg(required = true, value_name = "GRAPH")]
    graphs: Vec<PathBuf>,
    /// The folder for the sheets. Each is named after its graph.
    #[arg(long, default_value = ".", value_name = "DIR")]
    out: PathBuf,
    /// Width and height of each picture in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "200x150", value_parser = parse_size)]
    size: [usize; 2],
    /// The zoom relative to a value that fills the picture.
    #[arg(long, default_value_t = 1.0)]
    zoom: f64,
    #[command(flatten)]
    options: GraphOptions,
    #[command(flatten)]
    cache: CacheOptions,
}

/// The cameras of the pictures in a row, as yaw and pitch in degrees: from the front, right, left, above and behind.
const SIDES: [[f64; 2]; 5] = [[0.0, 0.0], [60.0, 10.0], [-60.0, 10.0], [0.0, 60.0], [180.0, 10.0]];

/// The color of a picture if the graph fails with the values of that row.
const FAILURE_COLOR: Rgb = [255, 0, 255];

impl Sheet {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let mut session = match self.cache.reporting_session(0, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let mut exit = Exit::Done;
        let graphs = Vec::from_iter(filter_paths(&self.graphs, is_no_graph));
        if graphs.is_empty() {
            return Exit::Usage("none of these files is a graph".into());
        }
        for path in graphs {
            match self.make_sheet(path, catalog, &mut session) {
                Ok(true) => {}
                Ok(false) => exit = Exit::Failed,
                Err(why) => return Exit::Usage(why),
            }
        }
        exit
    }

    /// Writes the sheet of one graph. Returns true if the graph had a visible output in every row.
    fn make_sheet(
        &self,
        path: &Path,
        catalog: &Arc<Catalog>,
        session: &mut Session,
    ) -> Result<bool, String> {
        let checked = self.options.load(path, catalog).without_unknown_nodes();
        report(&checked.diagnostics);
        let Some(graph) = checked.graph else { return Ok(false) };
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let file = self.out.join(format!("{name}.png"));
        let sources = Sources::of_graph(&graph);
        let destination = Destination::folder(&self.out, &sources);
        let refused =
            |why: &dyn std::fmt::Display| format!("cannot write {}: {why}", file.display());
        destination.check(&file).map_err(|why| refused(&why))?;
        print(&format!("{}\n", file.display()));
        let mut rows = Vec::new();
        let mut complete = true;
        for values in rows_of(&graph) {
            let layers = self.layers(path, &values, catalog, session);
            complete &= layers.is_some();
            print(&format!("  row {}: {}\n", rows.len() + 1, row_title(&values)));
            rows.push(layers);
        }
        let bytes = png::encode_rgb(&self.draw(&rows)).map_err(|why| refused(&why))?;
        destination.put(&file, &bytes).map_err(|why| refused(&why))?;
        Ok(complete)
    }

    /// Returns the layers to draw: those of the first output with faces, or else those of the first visible output.
    fn layers(
        &self,
        path: &Path,
        values: &[(String, String)],
        catalog: &Arc<Catalog>,
        session: &mut Session,
    ) -> Option<Vec<Layer>> {
        let mut options: Options = self.options.to_options();
        options.set.extend_from_slice(values);
        let checked = Graph::load(path, catalog, &options).without_unknown_nodes();
        let Some(graph) = checked.graph else {
            report(&checked.diagnostics);
            return None;
        };
        let finished = all_outputs(session, &graph)?;
        let values = || graph.output_names().filter_map(|name| finished.value(name));
        let solid = values().find(|value| value.as_mesh().is_some());
        let shown = solid.map(|value| value.show());
        shown.or_else(|| values().map(|value| value.show()).find(|layers| !layers.is_empty()))
    }

    fn draw(&self, rows: &[Option<Vec<Layer>>]) -> Image {
        let [width, height] = self.size;
        let full = SIDES.len() * width;
        let mut pixels = vec![FAILURE_COLOR; full * height * rows.len()];
        for (row, layers) in rows.iter().enumerate() {
            let Some(layers) = layers else { continue };
            for (column, [yaw, pitch]) in SIDES.into_iter().enumerate() {
                let view = View { size: self.size, yaw, pitch, zoom: self.zoom, ..View::front() };
                let look = Look { view, representation: Representation::Fitted, backdrop: None };
                let Some(picture) = picture(layers, &look) else { continue };
                for (y, line) in picture.pixels().chunks(width).enumerate() {
                    let start = (row * height + y) * full + column * width;
                    pixels[start..start + width].copy_from_slice(line);
                }
            }
        }
        Image::new(full, height * rows.len(), pixels).expect("a pixel for each place")
    }
}

/// Returns the parameter values of each row. The first row has the default values. Each of the others sets one parameter: to its minimum or
/// maximum, to an enum variant, or to false or true.
fn rows_of(graph: &Graph) -> Vec<Vec<(String, String)>> {
    let mut rows = vec![Vec::new()];
    let fields = graph.schema().get("properties").and_then(Json::as_object);
    for (name, field) in fields.into_iter().flatten() {
        let field = resolve_field(field, graph.schema());
        let kind = field.get("type").and_then(Json::as_str);
        let is_whole = kind == Some("integer");
        let ends = ["minimum", "maximum"].map(|end| {
            let number = field.get(end).and_then(Json::as_f64)?;
            Some(if is_whole { format!("{number}") } else { format!("{number:?}") })
        });
        let choices = field.get("enum").and_then(Json::as_array).into_iter().flatten();
        let choices = choices.filter_map(Json::as_str);
        let toggles = ["false", "true"].into_iter().filter(|_| kind == Some("boolean"));
        let choices = choices.chain(toggles).map(str::to_owned);
        let ends =
            if let [Some(least), Some(most)] = ends { vec![least, most] } else { Vec::new() };
        rows.extend(ends.into_iter().chain(choices).map(|value| vec![(name.clone(), value)]));
    }
    rows
}

fn row_title(values: &[(String, String)]) -> String {
    match values {
        [] => "the defaults".to_owned(),
        values => values
            .iter()
            .map(|(name, value)| format!("{name} = {value}"))
            .collect::<Vec<_>>()
            .join(", "),
    }
}
