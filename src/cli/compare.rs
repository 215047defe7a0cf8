//! `maquette compare`: two files, by what they mean.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use super::{Exit, eprint, print, print_json};
use crate::eval::read_companion;
use crate::format::{glb, obj, pcd, picture_file, ply, stl};
use crate::golden::compare::in_unit;
use crate::golden::{Keep, Tolerance, Verdict, compare};
use crate::paths::project_root;
use crate::plain::ending;
use crate::value::AnyValue;

#[derive(Args)]
pub(super) struct Compare {
    /// What it was: a mesh (ply, obj, glb, stl), a range image (pcd) or a picture (png, jpg, tiff).
    old: PathBuf,
    /// What it is.
    new: PathBuf,
    /// The largest distance or difference that is allowed, in mm.
    #[arg(long, value_name = "MM")]
    max: Option<f64>,
    /// The root of the mean square of distances that is allowed, in mm.
    #[arg(long, value_name = "MM")]
    rms: Option<f64>,
    /// The angle between normals that is allowed, in degrees.
    #[arg(long, value_name = "DEGREES")]
    normals: Option<f64>,
    /// How much an attribute may differ.
    #[arg(long = "attribute", value_name = "NAME=NUMBER", value_parser = attribute)]
    attributes: Vec<(String, f64)>,
    /// The share of pixels that may differ, from 0 to 1.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    differing: f64,
    /// By how much a channel of a color may differ without counting.
    #[arg(long, value_name = "LEVEL", default_value_t = 0.0)]
    level: f64,
    /// Other faces are no difference, as long as the surfaces are near.
    #[arg(long)]
    remeshed: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// What the rounding of files to `float` may change, as a share of the whole.
const FLOATS: f64 = 1e-6;

fn attribute(text: &str) -> Result<(String, f64), String> {
    let (name, number) = text.split_once('=').ok_or("write NAME=NUMBER")?;
    Ok((name.to_owned(), number.parse().map_err(|_| "write NAME=NUMBER")?))
}

impl Compare {
    pub(super) fn run(&self) -> Exit {
        let (old, new) = rayon::join(|| read(&self.old), || read(&self.new));
        let (old, new) = match (old, new) {
            (Ok(old), Ok(new)) => (old, new),
            (Err(why), _) | (_, Err(why)) => return Exit::Usage(why),
        };
        let tolerance = Tolerance {
            max: self.max,
            rms: self.rms,
            p99: None,
            normals: self.normals,
            attributes: self.attributes.iter().cloned().collect::<BTreeMap<_, _>>(),
            differing: self.differing,
            level: self.level,
            remeshed: self.remeshed,
            keep: Keep::Whole,
            share: Some(FLOATS),
        };
        let comparison = compare(&old, &new, &tolerance);
        if self.json {
            print_json(&comparison.to_json());
        } else {
            let mut text = format!("{}\n", comparison.verdict.word());
            for m in &comparison.measures {
                let number = |x: f64| in_unit(x, m.unit);
                let _ = writeln!(
                    text,
                    "  {}: max {}, rms {}, 99 % {}",
                    m.name,
                    number(m.max),
                    number(m.rms),
                    number(m.p99)
                );
                if !m.worst.is_empty() {
                    let _ = writeln!(text, "      worst at {}", m.worst);
                }
            }
            for reason in &comparison.reasons {
                let _ = writeln!(text, "  {reason}");
            }
            print(&text);
        }
        // Nothing that follows needs the memory.
        std::mem::forget((old, new));
        if comparison.verdict == Verdict::Different { Exit::Failed } else { Exit::Done }
    }
}

/// The value in a file, by its ending.
pub(super) fn read(path: &Path) -> Result<AnyValue, String> {
    let wrong = |error: &dyn std::fmt::Display| format!("cannot read {}: {error}", path.display());
    let bytes = crate::plain::read(path).map_err(|error| wrong(&error))?;
    match &ending(path)[..] {
        "ply" => match ply::read(&bytes) {
            Ok(mesh) if !mesh.faces().is_empty() => Ok(AnyValue::new(mesh)),
            // Points, or a mesh without faces: the same to the eye.
            Ok(mesh) => {
                Ok(ply::read_points(&bytes).map_or_else(|_| AnyValue::new(mesh), AnyValue::new))
            }
            Err(error) => ply::read_points(&bytes).map(AnyValue::new).map_err(|_| wrong(&error)),
        },
        "obj" => {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = std::fs::canonicalize(folder.unwrap_or(Path::new(".")));
            let folder = folder.map_err(|error| wrong(&error))?;
            let roots = [project_root(&folder)];
            let mut find = |name: &str| read_companion(name, &folder.join(name), &roots);
            let read = obj::read_textured(&bytes, &mut find);
            let (mesh, doubts) = read.map_err(|error| wrong(&error))?;
            doubts.iter().for_each(|doubt| eprint(&format!("warning: {doubt}\n")));
            Ok(AnyValue::new(mesh))
        }
        "glb" => glb::read(&bytes).map(AnyValue::new).map_err(|error| wrong(&error)),
        "stl" => stl::read(&bytes).map(AnyValue::new).map_err(|error| wrong(&error)),
        "pcd" => pcd::read(&bytes).map(AnyValue::new).map_err(|error| wrong(&error)),
        "png" | "jpg" | "jpeg" | "tif" | "tiff" => {
            picture_file::read(&bytes).map(AnyValue::new).map_err(|error| wrong(&error))
        }
        other => Err(wrong(&format!("files that end in `{other}` are not compared"))),
    }
}
