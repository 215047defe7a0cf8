//! Writes a surface back to the range grid that it came from.

use maquette_image::dilate;
use maquette_node::{
    Cancelled, Carry, Context, Error, Estimate, Fate, In, Limit, Node, Previous, Progress,
};
use maquette_range::{
    GRAZING, JUMP, Joins, LARGEST_SHADOW, around, fill_shadows, grid_triangles, longest_edge,
};
use maquette_value::parallel::*;
use maquette_value::{Mask, Pinhole, RangeImage, Region, Surface};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::blend_error::BlendError;
use super::blend_mode::BlendMode;
use super::grid::canvas::{Canvas, Target};
use super::grid::fold::folded_cells;
use super::grid::refine::{refine, refined_range};
use super::grid::seam::{Seam, seam};

/// Writes a surface back to the range grid that it came from. Only cells of the region change; all others keep every bit.
///
/// The region keeps hanging on what is around it, however steep it becomes, also where the sensor saw past its edge. Shadows at its
/// border, which would leave a slit there, are filled.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Blend {
    /// The range image to change.
    pub range: In<RangeImage>,
    /// The cells to change: the region that the surface's net was made from, or a part of it.
    pub region: In<Region>,
    /// The surface.
    pub surface: In<Surface>,
    /// What is written.
    #[serde(default)]
    pub mode: BlendMode,
    /// Divides each cell into so many rows and columns, for a finer grid. The surface is sampled anew, the rest interpolated.
    #[schemars(inner(range(min = 1, max = 16)))]
    #[serde(default = "same_grid")]
    pub resample: [usize; 2],
}

fn same_grid() -> [usize; 2] {
    [1, 1]
}

/// Cells of a finer grid: some 5 GB while it is made.
const CELLS: Limit = Limit { most: 1 << 26, of: "cells", help: "choose a smaller `resample`" };

impl Node for Blend {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] =
        &[Carry::cells("range", "range", Fate::Kept).but(&["filled", "joined"])];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let cells = cells(cx.get(&self.range), self.resample);
        Some(Estimate { bytes: cells * 80.0, help: CELLS.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (range, region, surface) =
            (cx.get(&self.range), cx.get(&self.region), cx.get(&self.surface));
        let blended = blend(range, region, surface, self.mode, self.resample, cx.progress())?;
        blended.warn(cx);
        Ok((blended.range,))
    }

    /// Where only the surface is another, writes it to the same cells: what is around them does not hang on it.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let same = previous.is_same(cx, &self.range) && previous.is_same(cx, &self.region);
        let Some(made) = previous.output(0).filter(|_| same && self.resample == [1, 1]) else {
            return Ok(None);
        };
        let (range, region, surface) =
            (cx.get(&self.range), cx.get(&self.region), cx.get(&self.surface));
        let blended = follow(range, region, surface, self.mode, made)?;
        blended.warn(cx);
        Ok(Some((blended.range,)))
    }
}

/// A changed range image.
#[derive(Clone, Debug, PartialEq)]
pub struct Blended {
    /// The range image.
    pub range: RangeImage,
    /// How many of the changed cells the sensor would no longer see as they lie in the grid.
    pub folded: usize,
    /// The step that the surface leaves at the border of the region; none for the mode `Displacement`, whose step is that of the
    /// offset, and on a finer grid.
    pub seam: Option<Seam>,
}

impl Blended {
    fn warn(&self, cx: &Context<'_>) {
        if self.folded > 0 {
            cx.warn(format!(
                "{} changed cells lie in front of each other, seen from the sensor",
                self.folded
            ));
        }
        if let Some(seam) = self.seam.filter(Seam::is_visible) {
            cx.warn(format!(
                "the surface leaves a step of {:.2} mm at the region's border, where cells are {:.2} mm apart",
                seam.step, seam.spacing
            ));
        }
    }
}

/// How many cells a grid has after each was divided.
fn cells(range: &RangeImage, [down, right]: [usize; 2]) -> f64 {
    [range.width(), range.height(), down, right].iter().map(|&count| count as f64).product()
}

/// Writes `surface` to the cells of `region`; cells of the region that had no point become valid and are marked as filled.
///
/// With S the surface, S' the surface of its net before any offset, and D the scan, or the region's point where the range has
/// none, the new point of a cell is, by mode: `D + (S - S')`; `S`; `(1 - f) D + f S` with f = x^2 (3 - 2 x) and x from 0 to 1 over
/// the band, by distance from the nearest cell outside. With the same weights `S - S'` is the surface of the net's
/// offsets; where it is 0, D keeps its bits.
///
/// Shadows (cells without a point that the scan surrounds) of up to 1000 cells between the region and the rest of the scan, and those of
/// which all cells are within 8 cells of the region, are filled, too, by a thin plate under tension. Triangles within the region that were
/// part of a surface before are marked as joined (as `Triangulate` joins cells when nothing else is asked of it). So are those at its
/// border, at filled cells and within 8 cells of it, unless an edge was longer than 15 median spacings: what a part hides of its
/// surroundings hangs on it, what is behind the object does not.
///
/// `resample` divides each cell into (rows, columns); (1, 1) keeps the grid.
///
/// # Errors
/// If the grids differ in size, a cell of the region has no place on the surface, or a factor is 0 or too large.
pub fn blend(
    range: &RangeImage,
    region: &Region,
    surface: &Surface,
    mode: BlendMode,
    resample: [usize; 2],
    progress: &Progress<'_>,
) -> Result<Blended, BlendError> {
    let [down, right] = resample;
    if down == 0 || right == 0 {
        return Err(BlendError::Resample { factors: resample });
    }
    let divided = resample != [1, 1];
    if divided {
        CELLS.check("the finer grid", cells(range, resample))?;
    }
    let mut same = Canvas::new(range, region, surface, mode)?;
    let own = Neighborhood::of(&same);
    let beside = fill_beside(&mut same, &own, range, progress)?;
    let (canvas, own) = if divided {
        let finer = refine(&same, resample);
        let own = Neighborhood::of(&finer);
        (finer, own)
    } else {
        (same, own)
    };
    let seamed = (mode != BlendMode::Displacement && !divided).then_some(region);
    let Written { points, folded, seam } = written(&canvas, surface, mode, range.camera(), seamed)?;
    let cells = 0..range.points().len();
    let mut filled: Vec<_> = cells.map(|cell| u8::from(range.is_filled(cell))).collect();
    let new = region.cells().iter().zip(region.filled());
    let new = new.filter(|&(&cell, &flag)| flag == 1 || range.point(cell as usize).is_none());
    new.map(|(cell, _)| cell).chain(&beside).for_each(|&cell| filled[cell as usize] = 1);
    let range = if divided {
        let old =
            |cell: usize| cell / canvas.width / down * range.width() + cell % canvas.width / right;
        let filled = (0..points.len()).map(|cell| filled[old(cell)]).collect();
        refined_range(range, resample, points, filled)?
    } else {
        range.with_points(points)?.with_filled(filled)?
    };
    let joined = joined(&canvas, &own, &range);
    Ok(Blended { range: range.with_joined(joined)?, folded, seam })
}

/// What [`blend`] makes on the same grid, made of the range image that it `made` of another surface.
fn follow(
    range: &RangeImage,
    region: &Region,
    surface: &Surface,
    mode: BlendMode,
    made: &RangeImage,
) -> Result<Blended, BlendError> {
    let mut canvas = Canvas::new(range, region, surface, mode)?;
    // Shadows have been filled.
    let cells = canvas.points.par_iter_mut().zip(made.points()).with_min_len(16384);
    cells.for_each(|(point, made)| {
        if point.x.is_nan() {
            *point = *made;
        }
    });
    let seamed = (mode != BlendMode::Displacement).then_some(region);
    let Written { points, folded, seam } = written(&canvas, surface, mode, range.camera(), seamed)?;
    let runs = region.cells().chunk_by(|before, cell| before + 1 == *cell);
    let rows: Vec<_> = runs.map(|run| run[0]..run[0] + run.len() as u32).collect();
    let moved = region.cells().iter().map(|&cell| points[cell as usize]).collect();
    Ok(Blended { range: made.with_moved(&rows, moved), folded, seam })
}

/// A surface as it is written to a canvas.
struct Written {
    points: Vec<Point3<f64>>,
    folded: usize,
    seam: Option<Seam>,
}

/// Writes a surface to the cells of a canvas; the seam is that with what is around a region.
fn written(
    canvas: &Canvas,
    surface: &Surface,
    mode: BlendMode,
    camera: Option<&Pinhole>,
    region: Option<&Region>,
) -> Result<Written, BlendError> {
    let changes = changes(canvas, surface, mode)?;
    let mut points = canvas.points.clone();
    changes.iter().for_each(|&(cell, point)| points[cell] = point);
    let changed: Vec<usize> = changes.iter().map(|(cell, _)| *cell).collect();
    let folded = folded_cells(canvas.width, &canvas.points, &points, &changed, camera);
    let seam = region.map(|region| seam(region, &canvas.points, &points));
    Ok(Written { points, folded, seam })
}

/// Slits, and shadows of which all cells are at most so far from the region, lie beside it, though they do not touch it.
const BESIDE: usize = 8;

/// Longest edge where a surface is known to go on, in multiples of the median spacing: a part may stand out far and hide some of its own
/// surroundings from the sensor, but what is behind the object is no part of it.
const ACROSS: f64 = 15.0;

/// The cells of a region, and those at most `BESIDE` from it.
struct Neighborhood {
    inside: Mask,
    near: Mask,
}

impl Neighborhood {
    fn of(canvas: &Canvas) -> Self {
        let mut inside = vec![0; canvas.points.len()];
        canvas.targets.iter().for_each(|target| inside[target.cell] = 1);
        let inside = Mask::new(canvas.width, canvas.height, inside).expect("a value for each cell");
        Self { near: dilate(&inside, BESIDE), inside }
    }

    fn has(&self, cell: usize) -> bool {
        self.inside.pixels()[cell] == 1
    }

    fn is_near(&self, cell: usize) -> bool {
        self.near.pixels()[cell] == 1
    }
}

/// Gives points to the shadows between the region and the rest of the scan, and to those beside it; their cells, in raster order.
fn fill_beside(
    canvas: &mut Canvas,
    region: &Neighborhood,
    range: &RangeImage,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Cancelled> {
    let width = canvas.width;
    // Cells of the region may have points that the scan has not.
    fn seen(cell: usize, region: &Neighborhood, range: &RangeImage) -> bool {
        region.has(cell) || range.point(cell).is_some()
    }
    let longest = longest_edge(range, ACROSS);
    fill_shadows(
        width,
        &mut canvas.points,
        longest,
        |cells| {
            let has = |within| {
                around(width, cells).any(|it| seen(it, region, range) && region.has(it) == within)
            };
            let is_near = || has(true) || cells.iter().all(|&cell| region.is_near(cell as usize));
            cells.len() <= LARGEST_SHADOW && has(false) && is_near()
        },
        progress,
    )
}

/// The triangles that stay part of the surface, however the blend stretches them: those within the region that were so before, and those
/// at its border and at filled cells that did not bridge the gap to a background.
fn joined(canvas: &Canvas, region: &Neighborhood, range: &RangeImage) -> Vec<u8> {
    let Canvas { width, height, points, .. } = canvas;
    let outside: Vec<_> = (0..points.len())
        .map(|cell: usize| !region.has(cell) && !points[cell].x.is_nan())
        .collect();
    let outside = Mask::from_bools(*width, *height, outside).expect("a value for each cell");
    let rim = dilate(&outside, 1);
    let before = range.with_points(points.clone()).expect("as many points as cells");
    let seen = Joins::new(&before, JUMP, GRAZING);
    let across = seen.allowing(ACROSS, 90.0);
    let mut joined: Vec<_> = (0..points.len()).map(|cell| range.joined(cell)).collect();
    let held = grid_triangles(
        *width,
        *height,
        points,
        |quad: usize| joined[quad],
        |triangle, corners| {
            let cells = triangle.cells(*width);
            fn any(is: &dyn Fn(usize) -> bool, cells: [usize; 3]) -> bool {
                cells.iter().any(|&cell| is(cell))
            }
            let inside = any(&|cell| region.has(cell), cells);
            if any(&|cell| range.is_filled(cell), cells)
                || inside && any(&|cell| rim.pixels()[cell] == 1, cells)
            {
                across.holds(corners)
            } else if inside {
                seen.holds(corners)
            } else {
                // What is redesigned is to stand in one skin; its own outermost cells, of mixed colors, are often none of the region.
                any(&|cell| region.is_near(cell), cells)
                    && !seen.holds(corners)
                    && across.holds(corners)
            }
        },
    );
    for triangle in held {
        joined[triangle.quad as usize] |= triangle.half.bit();
    }
    joined
}

/// The cells that change, in raster order, and their new points.
fn changes(
    canvas: &Canvas,
    surface: &Surface,
    mode: BlendMode,
) -> Result<Vec<(usize, Point3<f64>)>, BlendError> {
    let offsets = match mode {
        BlendMode::Displacement => Some(surface_of_offsets(surface)?),
        _ => None,
    };
    // Most charts hold whole net coordinates, whose parameters are needed again and again.
    let [whole_u, whole_v] = [surface.u(), surface.v()]
        .map(|knots| (0..knots.n_control()).map(|k| knots.parameter(k as f64)).collect::<Vec<_>>());
    fn parameters(
        [a, b]: [f64; 2],
        whole_u: &[f64],
        whole_v: &[f64],
        surface: &Surface,
    ) -> (f64, f64) {
        fn known(whole: &[f64], a: f64) -> Option<f64> {
            whole.get(a as usize).copied().filter(|_| a >= 0.0 && a.fract() == 0.0)
        }
        let u = known(whole_u, a).unwrap_or_else(|| surface.u().parameter(a));
        (u, known(whole_v, b).unwrap_or_else(|| surface.v().parameter(b)))
    }
    let change = |target: &Target| {
        let before = canvas.points[target.cell];
        let (u, v) = parameters(target.coordinate, &whole_u, &whole_v, surface);
        let after = match (&offsets, mode) {
            (Some(offsets), _) => {
                let offset = offsets.point(u, v).coords;
                // Adding 0 would turn -0 into 0.
                if offset == Vector3::zeros() { before } else { before + offset }
            }
            (None, BlendMode::Feather { band }) => {
                let share = smoothstep(target.depth / band);
                before + (surface.point(u, v) - before) * share
            }
            (None, _) => surface.point(u, v),
        };
        (target.cell, after)
    };
    Ok(canvas.targets.par_iter().with_min_len(256).map(change).collect())
}

/// The surface of `points - base` with the same weights and knots: how far each parameter is moved.
fn surface_of_offsets(surface: &Surface) -> Result<Surface, BlendError> {
    let net = surface.net();
    let offsets: Vec<Point3<f64>> = (net.points().iter().zip(net.base()))
        .map(|(point, base)| Point3::from(point - base))
        .collect();
    let net = net.clone().with_points(offsets)?;
    Ok(Surface::new(net, surface.u().clone(), surface.v().clone())?)
}

fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests;
