//! What a region is made of, and how it looks.

use super::{Contour, Region};
use crate::hostile::clouds;
use crate::layer::PLAIN;
use crate::{Axes, Image, Layer, Lines, Meaning, On, Parts, PartsError, Picture};

/// How many cells each contour has, and whether it is one of a hole: tests see the contours' cells.
const LENGTHS: &str = "contour cells";
const HOLES: &str = "contour of a hole";

pub(super) fn parts(region: &Region) -> Parts<'_> {
    let mut parts = Parts::default();
    parts.grid(region.width, region.height);
    parts.fact("cells", region.cells.len());
    parts.fact("contours", region.contours.len());
    parts.push("point", On::Point, Meaning::Position, 3, &region.points[..]);
    parts.push("cell", On::Point, Meaning::Index, 1, &region.cells[..]);
    parts.push("filled", On::Point, Meaning::Exact, 1, &region.filled[..]);
    let contours = || region.contours.iter();
    let cells: Vec<_> = contours().flat_map(|contour| contour.cells.iter().copied()).collect();
    parts.push("contour", On::Entry, Meaning::Index, 1, cells);
    let lengths: Vec<_> = contours().map(|contour| contour.cells.len() as u32).collect();
    parts.push_aside(LENGTHS, On::Entry, Meaning::Exact, 1, lengths);
    let holes: Vec<_> = contours().map(|contour| u8::from(contour.hole)).collect();
    parts.push_aside(HOLES, On::Entry, Meaning::Exact, 1, holes);
    parts
}

/// Without `filled` all points are measured; without `contour` there are no contours.
pub(super) fn made_of(parts: &Parts<'_>) -> Result<Region, PartsError> {
    let [width, height] = parts.size_of("size")?;
    let points = parts.need("point", 3)?.places()?;
    let cells = parts.need("cell", 1)?.whole()?;
    let filled = parts.column_of("filled", 1)?.map(|part| part.small(1)).transpose()?;
    let filled = filled.unwrap_or_else(|| vec![0; cells.len()]);
    let contours = match parts.column("contour") {
        Some(_) => contours(parts, &cells)?,
        None => Vec::new(),
    };
    Region::new(width, height, cells, points, filled, contours).map_err(PartsError::refused)
}

fn contours(parts: &Parts<'_>, cells: &[u32]) -> Result<Vec<Contour>, PartsError> {
    let (contour, lengths) = (parts.need("contour", 1)?, parts.need(LENGTHS, 1)?);
    let all = contour.whole()?;
    if let Some(index) = all.iter().position(|cell| cells.binary_search(cell).is_err()) {
        return Err(contour.wrong(index, f64::from(all[index]), "a cell of the region"));
    }
    let counts = lengths.whole()?;
    contour.with_count(counts.iter().map(|&count| count as usize).sum())?;
    let holes = parts.need(HOLES, 1)?.with_count(counts.len())?.small(1)?;
    let mut rest = &all[..];
    Ok(counts
        .iter()
        .zip(&holes)
        .map(|(&count, &hole): (&u32, &u8)| {
            let (cells, behind) = rest.split_at(count as usize);
            rest = behind;
            Contour { hole: hole == 1, cells: cells.to_vec() }
        })
        .collect())
}

/// White on its grid; its contours in space.
pub(super) fn show(region: &Region) -> Vec<Layer> {
    let pixels: Vec<_> = region
        .grid()
        .into_iter()
        .map(|inside: u8| if inside == 1 { [255; 3] } else { PLAIN })
        .collect();
    let mut layers = Picture::drawn(Image::new(region.width, region.height, pixels));
    let chains: Vec<Vec<u32>> = region
        .contours
        .iter()
        .map(|contour| {
            let ring = contour.cells.iter().chain(contour.cells.first());
            ring.filter_map(|cell| region.find(*cell as usize).map(|index| index as u32)).collect()
        })
        .collect();
    if !chains.is_empty() {
        let points = region.points.clone();
        layers.push(Layer::Lines(Lines { points, chains, axes: Axes::Sensor }));
    }
    layers
}

pub(super) fn hostile() -> Vec<Region> {
    let sizes = [[1, 1], [7, 1], [1, 7], [3, 3], [400, 300]];
    let regions = sizes.into_iter().flat_map(|[width, height]| {
        let count = (width * height).min(9);
        clouds(count).into_iter().map(move |points| {
            let cells = (0..count as u32).collect();
            Region::new(width, height, cells, points, vec![0; count], Vec::new())
        })
    });
    regions.flatten().collect()
}
