//! `maquette compare`: compares two files by what they mean.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::six;
use maquette_golden::compare::in_unit;
use maquette_golden::{Keep, Tolerance, Verdict, compare};
use maquette_graph::catalog::Catalog;
use maquette_value::AnyValue;

use super::{Exit, eprint, print, print_json};

#[derive(Args)]
pub(crate) struct Compare {
    /// What it was: a file that some node reads, such as a mesh (ply, obj, glb, stl), a range image (pcd) or a picture (png, jpg, tiff).
    old: PathBuf,
    /// What it is.
    new: PathBuf,
    /// The largest distance or difference that is allowed, in mm.
    #[arg(long, value_name = "MM", value_parser = not_negative)]
    max: Option<f64>,
    /// The root of the mean square of distances that is allowed, in mm.
    #[arg(long, value_name = "MM", value_parser = not_negative)]
    rms: Option<f64>,
    /// The angle between normals that is allowed, in degrees.
    #[arg(long, value_name = "DEGREES", value_parser = up_to::<180>)]
    normals: Option<f64>,
    /// How much an attribute may differ.
    #[arg(long = "attribute", value_name = "NAME=NUMBER", value_parser = attribute)]
    attributes: Vec<(String, f64)>,
    /// The fraction of pixels that may differ by any amount, from 0 to 1; `--hard` bounds that amount.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = up_to::<1>)]
    differing: f64,
    /// The difference of a color channel that does not count, from 0 to 255.
    #[arg(long, value_name = "LEVEL", default_value_t = 0.0, value_parser = up_to::<255>)]
    level: f64,
    /// The largest difference of any color channel that is allowed, from 0 to 255, however few pixels differ.
    #[arg(long, value_name = "LEVEL", value_parser = up_to::<255>)]
    hard: Option<f64>,
    /// The difference of colors and numbers that does not count, as a fraction of the mean of both, from 0 to 1.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0, value_parser = up_to::<1>)]
    relative: f64,
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
    Ok((name.to_owned(), not_negative(number)?))
}

fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| *number >= 0.0);
    number.ok_or_else(|| "expected a number that is not negative".into())
}

/// Reads a number from 0 to `MAX`.
fn up_to<const MAX: u8>(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (0.0..=f64::from(MAX)).contains(number));
    number.ok_or_else(|| format!("expected a number from 0 to {MAX}"))
}

impl Compare {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let tolerance = self.tolerance();
        if let Some((message, help)) = tolerance.contradiction() {
            return Exit::Usage(format!("{message}; {help}"));
        }
        let (old, new) = rayon::join(|| read(&self.old, catalog), || read(&self.new, catalog));
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
                fn number(x: f64, m_unit: &str) -> String {
                    in_unit(x, m_unit)
                }
                let _ = write!(
                    text,
                    "  {}: max {}, rms {}, 99 % {}",
                    m.name,
                    number(m.max, m.unit),
                    number(m.rms, m.unit),
                    number(m.p99, m.unit)
                );
                if m.by_share {
                    let _ = write!(text, ", {} % differ", six(100.0 * m.differing));
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
        // Nothing that follows needs the memory.
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
            share: Some(FLOATS),
        }
    }
}

/// The value in a file, by its ending; warnings are printed.
pub(super) fn read(path: &Path, catalog: &Catalog) -> Result<AnyValue, String> {
    let (value, warnings) = catalog.readers().open(path, None)?;
    warnings.iter().for_each(|warning| eprint(&format!("warning: {warning}\n")));
    Ok(value)
}
