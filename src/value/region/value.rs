//! The implementation of `Value` for regions.

use super::{Contour, Region};
use crate::edge_cases::point_sets;
use crate::mesh::describe_bounds;
use crate::{
    Axes, BACKGROUND, Column, DecodeError, Decoder, ElementKind, Encoder, Image, Layer, Lines,
    Meaning, Mesh, Parts, PartsError, Picture, Summary, Value,
};

/// The names of two parts: the number of cells of each contour, and a flag that marks the contours of holes. Tests ignore both parts, and
/// those of the rims, and compare the cells of the contours.
const LENGTHS: &str = "contour cells";
const HOLES: &str = "contour of a hole";

/// The names of two more parts: the points of the rims, and the number of them of each contour.
const RIM: &str = "rim";
const RIM_LENGTHS: &str = "rim points";

impl Value for Region {
    const NAME: &'static str = "Region";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.width, self.height, self.contours.len()])
            .column(&self.cells)
            .column(&self.points)
            .column(&self.filled);
        for contour in &self.contours {
            to.plain(&u8::from(contour.hole))
                .column(&Column::from(contour.cells.clone()))
                .column(&Column::from(contour.rim.clone()));
        }
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [width, height, contours] = from.counts()?;
        let (cells, points, filled) = (from.column()?, from.column()?, from.column()?);
        let contours = (0..contours)
            .map(|_| {
                let hole = from.plain::<u8>()? == 1;
                let cells = from.column::<u32>()?.to_vec();
                Ok(Contour { hole, cells, rim: from.column::<[f64; 2]>()?.to_vec() })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { width, height, cells, points, filled, contours })
    }

    fn size(&self) -> usize {
        let contours = self.contours.iter();
        let contours: usize =
            contours.map(|contour| 4 * contour.cells.len() + 16 * contour.rim.len()).sum();
        self.cells.size() + self.points.size() + self.filled.size() + contours
    }

    fn describe(&self) -> Summary {
        let ([left, top], [right, bottom]) = self.bounds();
        let filled = self.filled.iter().filter(|&&filled| filled == 1).count();
        let holes = self.contours.iter().filter(|contour| contour.hole).count();
        let summary = Summary::default()
            .with_fact("grid", format!("{} x {}", self.width, self.height))
            .with_fact("cells", self.cells.len())
            .with_fact("filled", filled)
            .with_fact("box", format!("({left}, {top})-({right}, {bottom})"))
            .with_fact("holes", holes);
        describe_bounds(summary, self.points.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.fact("cells", self.cells.len());
        parts.fact("contours", self.contours.len());
        parts.push("point", ElementKind::Point, Meaning::Position, 3, &self.points[..]);
        parts.push("cell", ElementKind::Point, Meaning::Index, 1, &self.cells[..]);
        parts.push("filled", ElementKind::Point, Meaning::Exact, 1, &self.filled[..]);
        let contours = &self.contours;
        let cells: Vec<_> =
            contours.iter().flat_map(|contour| contour.cells.iter().copied()).collect();
        parts.push("contour", ElementKind::Entry, Meaning::Index, 1, cells);
        let lengths: Vec<_> = contours.iter().map(|contour| contour.cells.len() as u32).collect();
        parts.push_hidden(LENGTHS, ElementKind::Entry, Meaning::Exact, 1, lengths);
        let holes: Vec<_> = contours.iter().map(|contour| u8::from(contour.hole)).collect();
        parts.push_hidden(HOLES, ElementKind::Entry, Meaning::Exact, 1, holes);
        if contours.iter().any(|contour| !contour.rim.is_empty()) {
            let rims: Vec<f64> =
                contours.iter().flat_map(|contour| contour.rim.iter().flatten().copied()).collect();
            parts.push_hidden(RIM, ElementKind::Entry, Meaning::Number, 2, rims);
            let lengths: Vec<_> = contours.iter().map(|contour| contour.rim.len() as u32).collect();
            parts.push_hidden(RIM_LENGTHS, ElementKind::Entry, Meaning::Exact, 1, lengths);
        }
        parts
    }

    /// Builds a region from parts. Without the part `filled` all points count as measured. Without the part `contour` the region has no
    /// contours.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size_of("size")?;
        let points = parts.require("point", 3)?.to_points()?;
        let cells = parts.require("cell", 1)?.to_u32()?;
        let filled = parts.column_of("filled", 1)?.map(|part| part.to_u8(1)).transpose()?;
        let filled = filled.unwrap_or_else(|| vec![0; cells.len()]);
        let contours = match parts.column("contour") {
            Some(_) => contours(parts, &cells)?,
            None => Vec::new(),
        };
        Self::new(width, height, cells, points, filled, contours).map_err(PartsError::from_error)
    }

    /// Draws the region in white on the range grid, and its contours in space.
    fn show(&self) -> Vec<Layer> {
        let pixels: Vec<_> = self
            .grid()
            .into_iter()
            .map(|inside: u8| if inside == 1 { [255; 3] } else { BACKGROUND })
            .collect();
        let mut layers = Picture::from_false_colors(Image::new(self.width, self.height, pixels));
        let chains: Vec<Vec<u32>> = self
            .contours
            .iter()
            .map(|contour| {
                let ring = contour.cells.iter().chain(contour.cells.first());
                ring.filter_map(|cell| self.find(*cell as usize).map(|index| index as u32))
                    .collect()
            })
            .collect();
        if !chains.is_empty() {
            let points = self.points.clone();
            layers.push(Layer::Lines(Lines { points, chains, axes: Axes::Sensor }));
        }
        layers
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn edge_cases() -> Vec<Self> {
        let sizes = [[1, 1], [7, 1], [1, 7], [3, 3], [400, 300]];
        let regions = sizes.into_iter().flat_map(|[width, height]| {
            let count = (width * height).min(9);
            point_sets(count).into_iter().map(move |points| {
                let cells = (0..count as u32).collect();
                Self::new(width, height, cells, points, vec![0; count], Vec::new())
            })
        });
        regions.flatten().collect()
    }
}

fn contours(parts: &Parts<'_>, cells: &[u32]) -> Result<Vec<Contour>, PartsError> {
    let (contour, lengths) = (parts.require("contour", 1)?, parts.require(LENGTHS, 1)?);
    let all = contour.to_u32()?;
    if let Some(index) = all.iter().position(|cell| cells.binary_search(cell).is_err()) {
        return Err(contour.number_error(index, f64::from(all[index]), "a cell of the region"));
    }
    let counts = lengths.to_u32()?;
    contour.with_count(counts.iter().map(|&count| count as usize).sum())?;
    let holes = parts.require(HOLES, 1)?.with_count(counts.len())?.to_u8(1)?;
    let rims = rims(parts, counts.len())?;
    let mut rest = &all[..];
    Ok(counts
        .iter()
        .zip(&holes)
        .zip(rims)
        .map(|((&count, &hole), rim): ((&u32, &u8), Vec<[f64; 2]>)| {
            let (cells, behind) = rest.split_at(count as usize);
            rest = behind;
            Contour { hole: hole == 1, cells: cells.to_vec(), rim }
        })
        .collect())
}

/// Returns the rim of each contour; empty ones if the parts have none.
fn rims(parts: &Parts<'_>, contours: usize) -> Result<Vec<Vec<[f64; 2]>>, PartsError> {
    if parts.column(RIM).is_none() {
        return Ok(vec![Vec::new(); contours]);
    }
    let counts = parts.require(RIM_LENGTHS, 1)?.with_count(contours)?.to_u32()?;
    let count = counts.iter().map(|&count| count as usize).sum();
    let part = parts.require(RIM, 2)?;
    let all: Vec<[f64; 2]> = part.with_count(count)?.elements()?;
    if let Some(index) = all.iter().position(|at| at.iter().any(|x| !x.is_finite())) {
        return Err(part.number_error(index, all[index][0], "a finite position"));
    }
    let mut rest = &all[..];
    let rims = counts.iter().map(|&count| {
        let (rim, behind) = rest.split_at(count as usize);
        rest = behind;
        rim.to_vec()
    });
    Ok(rims.collect())
}
