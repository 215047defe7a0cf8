//! Fills one hole without exemplars: flat, as a membrane, as a thin plate, or with creases that continue those of the surrounding surface.

use maquette_node::Progress;

use super::hole_fill::{Fallback, HoleFill};
use super::options::{PlainMethod, PlainOptions};
use super::plates::{fan, goes_too_far, membrane, min_weight_or_fan, plate};
use super::sizes::Sizes;
use crate::border::rim::Rim;
use crate::creases::{divide, sharpen};
use crate::triangles::density::{RefineError, refine};
use crate::triangles::filling::Filling;
use crate::triangles::triangulation::Triangulation;

/// Minimum number of rim edges for extending creases that the user did not ask for.
const MIN_RIM_EDGES: usize = 16;

/// Maximum number of folded faces in a fill across which creases are extended that the user did not ask for. More are a sign that the
/// surface has no creases.
const MAX_FOLDED: usize = 2;

/// Fills one hole. Edges have the length `edge`; if that is `None`, the edge length of the input mesh at the rim.
///
/// # Errors
/// Returns an error if the fill would have too many triangles, or if the evaluation is cancelled.
pub(crate) fn fill_hole(
    filling: &Filling,
    rim: &Rim,
    PlainOptions { method, edge }: PlainOptions,
    progress: &Progress<'_>,
) -> Result<HoleFill, RefineError> {
    progress.tick(0.0)?;
    let sizes = Sizes::new(rim, edge);
    let mut triangulation = match method {
        PlainMethod::Centroid => fan(rim, true),
        _ => min_weight_or_fan(rim),
    };
    sizes.check(&triangulation)?;
    let mut fallback = None;
    match method {
        PlainMethod::Flat | PlainMethod::Centroid => {
            refine(&mut triangulation, |point| sizes.length_at(point), progress)?;
        }
        PlainMethod::Membrane => membrane(&mut triangulation, rim, &sizes, progress)?,
        PlainMethod::ThinPlate | PlainMethod::CreaseAware | PlainMethod::PlateOrCreases => {
            let start = triangulation.clone();
            plate(&mut triangulation, rim, &sizes, progress)?;
            if goes_too_far(&triangulation, rim) {
                fallback = Some(Fallback::RoughRim);
                triangulation = start;
                membrane(&mut triangulation, rim, &sizes, progress)?;
            }
        }
    }
    // Creases are not certain if the rim is too rough for a plate or has few edges: then they may be found by chance.
    fn are_creases_certain(fallback: &Option<Fallback>, rim: &Rim) -> bool {
        fallback.is_none() && MIN_RIM_EDGES <= rim.len()
    }
    let is_asked = method == PlainMethod::CreaseAware;
    if is_asked || method == PlainMethod::PlateOrCreases && are_creases_certain(&fallback, rim) {
        let max_folded = if is_asked { usize::MAX } else { MAX_FOLDED };
        match extend_creases(filling, &triangulation, rim, &sizes, max_folded, progress)? {
            Some(fill) => return Ok(fill),
            None if is_asked => fallback = fallback.or(Some(Fallback::NoCreases)),
            None => {}
        }
    }
    Ok(HoleFill { triangulation, fallback, is_sharp: false, is_relief: Vec::new() })
}

/// Returns a fill across which the creases of the data are extended; `None` if there are no creases that meet or can be joined. Curved
/// creases are joined by curves. Straight ones are extended as surfaces, which also meet in corners; if the surfaces are not smooth enough
/// for that, as that of a relief, straight creases are joined by lines.
fn extend_creases(
    filling: &Filling,
    plate: &Triangulation,
    rim: &Rim,
    sizes: &Sizes,
    max_folded: usize,
    progress: &Progress<'_>,
) -> Result<Option<HoleFill>, RefineError> {
    let divided = divide::divide(filling, rim, sizes, progress)?;
    let sharp = match &divided {
        Some(divided) if divided.is_clear => None,
        _ => sharpen::sharpen(filling, plate, rim, sizes, max_folded, progress)?,
    };
    fn fill(triangulation: Triangulation, is_relief: Vec<bool>) -> HoleFill {
        HoleFill { triangulation, fallback: None, is_sharp: true, is_relief }
    }
    let sharp = sharp.map(|triangulation| fill(triangulation, Vec::new()));
    Ok(sharp.or(divided.map(|divided| fill(divided.triangulation, divided.is_relief))))
}
