//! `maquette compare`: compares the contents of two files.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::six_digits;
use maquette_golden::compare::in_unit;
use maquette_golden::{Keep, Tolerance, Verdict, compare};
use maquette_graph::catalog::Catalog;
use maquette_value::AnyValue;

use super::{Exit, eprint, print, print_json};

#[derive(Args)]
pub(crate) struct Compare {
    /// The old file: any format that a node reads, such as a mesh (ply, obj, glb, stl), a range image (pcd) or a picture (png, jpg, tiff).
    old: PathBuf,
    /// The new file.
    new: PathBuf,
    /// The maximum allowed distance or difference, in mm.
    #[arg(long, value_name = "MM", value_parser = parse_non_negative)]
    max: Option<f64>,
    /// The maximum allowed root mean square of the distances, in mm.
    #[arg(long, value_name = "MM", value_parser = parse_non_negative)]
    rms: Option<f64>,
    /// The maximum allowed angle between normals, in degrees.
    #[arg(long, value_name = "DEGREES", value_parser = parse_up_to::<180>)]
    normals: Option<f64>,
    /// The maximum allowed difference of an attribute.
    #[arg(long = "attribute", value_name = "NAME=NUMBER", value_parser = parse_attribute)]
    attributes: Vec<(String, f64)>,
    /// The fraction of pixels that may differ by any amount, from 0 to 1; `--hard` bounds that amount.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = parse_up_to::<1>)]
    differing: f64,
    /// Color differences up to this value are ignored, from 0 to 255.
    #[arg(long, value_name = "LEVEL", default_value_t = 0.0, value_parser = parse_up_to::<255>)]
    level: f64,
    /// The maximum allowed difference of a color channel in any pixel, from 0 to 255.
    #[arg(long, value_name = "LEVEL", value_parser = parse_up_to::<255>)]
    hard: Option<f64>,
    /// Differences of colors and numbers up to this fraction of the mean of both are ignored, from 0 to 1.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = parse_up_to::<1>)]
    relative: f64,
    /// Compare only the surfaces; the faces may differ.
    #[arg(long)]
    remeshed: bool,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// The relative error that may come from rounding numbers to `float` in files.
const FLOAT_ROUNDING: f64 = 1e-6;

fn parse_attribute(text: &str) -> Result<(String, f64), String> {
    let (name, number) = text.split_once('=').ok_or("expected NAME=NUMBER")?;
    Ok((name.to_owned(), parse_non_negative(number)?))
}

fn parse_non_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| *number >= 0.0);
    number.ok_or_else(|| "expected a number that is not negative".into())
}

/// Parses a number from 0 to `MAX`.
fn parse_up_to<const MAX: u8>(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (0.0..=f64::from(MAX)).contains(number));
    number.ok_or_else(|| format!("expected a number from 0 to {MAX}"))
}

impl Compare {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let tolerance = self.tolerance();
        if let Some((message, help)) = tolerance.contradiction() {
            return Exit::Usage(format!("{message}; {help}"));
        }
        let (old, new) =
            rayon::join(|| read_value(&self.old, catalog), || read_value(&self.new, catalog));
        let (old, new) = match (old, new) {
            (Ok(old), Ok(new)) => (old, new),
            (Err(why), _) | (_, Err(why)) => return Exit::Usage(why),
        };
        let comparison = compare(&old, &new, &tolerance);
        if self.json {
            print_json(&comparison.to_json());
        } else {
            let mut text = format!("{}\n", comparison.verdict.word());
            for m in &comparison.measures {
                let _ = write!(
                    text,
                    "  {}: max {}, rms {}, 99 % {}",
                    m.name,
                    in_unit(m.max, m.unit),
                    in_unit(m.rms, m.unit),
                    in_unit(m.p99, m.unit)
                );
                if m.is_by_fraction {
                    let _ = write!(text, ", {} % differ", six_digits(100.0 * m.differing));
                }
                text.push('\n');
                if !m.worst.is_empty() {
                    let _ = writeln!(text, "      worst at {}", m.worst);
                }
            }
            for reason in &comparison.reasons {
                let _ = writeln!(text, "  {reason}");
            }
            print(&text);
        }
        // Do not free the memory, which takes time: the process is about to end.
        std::mem::forget((old, new));
        if comparison.verdict == Verdict::Different { Exit::Failed } else { Exit::Done }
    }

    fn tolerance(&self) -> Tolerance {
        Tolerance {
            max: self.max,
            rms: self.rms,
            p99: None,
            normals: self.normals,
            attributes: self.attributes.iter().cloned().collect::<BTreeMap<_, _>>(),
            differing: self.differing,
            level: self.level,
            hard: self.hard,
            relative: self.relative,
            remeshed: self.remeshed,
            keep: Keep::Whole,
            default_fraction: Some(FLOAT_ROUNDING),
        }
    }
}

/// Reads the value in a file. The extension determines the format. Prints warnings.
pub(super) fn read_value(path: &Path, catalog: &Catalog) -> Result<AnyValue, String> {
    let (value, warnings) = catalog.readers().open(path, None)?;
    warnings.iter().for_each(|warning| eprint(&format!("warning: {warning}\n")));
    Ok(value)
}
