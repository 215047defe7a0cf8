//! Writes a surface to the range grid that it was made from.

use maquette_image::dilate;
use maquette_node::{
    CancelledError, Carry, Context, Error, Estimate, In, Limit, Node, Previous, Progress, Transfer,
    bail,
};
use maquette_range::{
    GRAZING, JUMP, Joins, MAX_SHADOW_CELLS, fill_shadows, grid_triangles, longest_edge,
    neighborhood,
};
use maquette_value::parallel::*;
use maquette_value::{Mask, Pinhole, RangeImage, Region, Surface};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::blend_mode::BlendMode;
use super::grid::canvas::Canvas;
use super::grid::continuity::measure_gaps;
use super::grid::filled_beside::{is_border_moved, move_filled_cells};
use super::grid::fold::folded_cells;
use super::grid::refine::{refine, refined_range};
use super::grid::seam::{Seam, seam};

/// Writes a surface to the range grid that it was made from. Only cells of the region change; all others keep every bit. Exceptions are
/// filled cells beside a region whose border sinks (`OffsetNet`): they sink with it, so that they still lead to the scan.
///
/// The region stays connected to its surroundings, however steep the surface becomes, also where the sensor saw past the region's edge.
/// Shadows at the border of the region, which would leave a gap, are filled.
///
/// The result carries the largest angle between normals (G1) and the largest gap of curvature (G2) across the border of the region, which
/// `maquette inspect` shows and `Continuity(of: .., order: G1, limit: ..)` in `expect` limits. They are measured by quadratic functions
/// that are fitted to the cells near the border on each side, so the roughness of a scan counts, too.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Blend {
    /// The range image to change.
    pub range: In<RangeImage>,
    /// The cells to change: the region that the surface's net was made from, or a part of it.
    pub region: In<Region>,
    /// The surface.
    pub surface: In<Surface>,
    /// Mode of the blend.
    #[serde(default)]
    pub mode: BlendMode,
    /// Divides each cell into this number of rows and columns, for a finer grid. The surface is sampled again, the rest is interpolated.
    #[schemars(inner(range(min = 1, max = 16)))]
    #[serde(default = "default_resample")]
    pub resample: [usize; 2],
}

fn default_resample() -> [usize; 2] {
    [1, 1]
}

/// Maximum number of cells of the grid after `resample`. With this many cells, the computation needs about 5 GB of memory.
const CELLS: Limit = Limit { max: 1 << 26, items: "cells", help: "choose a smaller `resample`" };

impl Node for Blend {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    const CARRIES: &'static [Carry] =
        &[Carry::cells("range", "range", Transfer::Kept).excluding(&["filled", "joined"])];

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

    /// If only the surface has changed, updates only the region's cells in the last result. The cells outside of the region do not depend
    /// on the surface, unless the border of the region moves.
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
        if [surface, previous.get(&self.surface)].into_iter().any(is_border_moved) {
            return Ok(None);
        }
        let blended = follow(range, region, surface, self.mode, made)?;
        blended.warn(cx);
        Ok(Some((blended.range,)))
    }
}

/// The result of a blend.
#[derive(Clone, Debug, PartialEq)]
pub struct BlendedRange {
    /// The changed range image: the cells of the region have the points of the surface.
    pub range: RangeImage,
    /// The number of changed cells at which the grid newly folds over in the sensor's view, so that cells hide each other.
    pub folded: usize,
    /// The step between the surface and the scan at the border of the region. `None` on a finer grid and for the mode `Displacement`, where
    /// the only step is that of the offset itself.
    pub seam: Option<Seam>,
}

impl BlendedRange {
    fn warn(&self, cx: &Context<'_>) {
        if self.folded > 0 {
            cx.warn(format!("{} changed cells hide each other, seen from the sensor", self.folded));
        }
        if let Some(seam) = self.seam.filter(Seam::is_visible) {
            cx.warn(format!(
                "the surface leaves a step of {:.2} mm at the region's border, where cells are {:.2} mm apart",
                seam.step, seam.spacing
            ));
        }
    }
}

/// Returns the number of cells of a range grid after each cell is divided into `down` rows and `right` columns.
fn cells(range: &RangeImage, [down, right]: [usize; 2]) -> f64 {
    [range.width(), range.height(), down, right].iter().map(|&count| count as f64).product()
}

/// Writes `surface` to the cells of `region`. Cells of the region without a point become valid and are marked as filled.
///
/// Let S be a point of the surface, S' the point of the same surface before any offset of its net, and D the scanned point, or the region's
/// point if the scan has none. The new point of a cell is `D + (S - S')` in the mode `Displacement`, `S` in the mode `Replace`, and `(1 -
/// f) D + f S` in the mode `Feather`. The weight f is x^2 (3 - 2 x), where x is the distance from the nearest cell outside of the region,
/// scaled so that it is 1 at the end of the band. If all weights of the net are equal, `S - S'` is the surface of the net's offsets. Where
/// `S - S'` is 0, D keeps its bits.
///
/// Shadows are areas of cells without a point that the scan surrounds. A shadow of up to 1000 cells is filled by a thin plate under tension
/// if it borders on both the region and the rest of the scan. It is also filled if all its cells are within 8 cells of the region.
///
/// A triangle within the region is marked as joined if it was part of the scanned surface (with the default limits of `Triangulate`).
/// Triangles at the region's border, at filled cells and within 8 cells of the region are also marked, unless an edge was longer than 15
/// median spacings. So the region is connected to surroundings that it partly hides from the sensor, but not to the background.
///
/// `resample` divides each cell into (rows, columns); (1, 1) keeps the grid.
///
/// # Errors
/// Returns an error if the grids differ in size, a cell of the region is not on the surface, or a factor in `resample` is 0 or too large.
pub fn blend(
    range: &RangeImage,
    region: &Region,
    surface: &Surface,
    mode: BlendMode,
    resample: [usize; 2],
    progress: &Progress<'_>,
) -> Result<BlendedRange, Error> {
    let [down, right] = resample;
    if down == 0 || right == 0 {
        bail!("cells cannot be divided by {resample:?}: the factors are 1 or more");
    }
    let divided = resample != [1, 1];
    if divided {
        CELLS.check("the finer grid", cells(range, resample))?;
    }
    let mut same = Canvas::new(range, region, surface, mode)?;
    let own = Neighborhood::new(&same);
    let beside = fill_beside(&mut same, &own, range, progress)?;
    let (canvas, own) = if divided {
        let finer = refine(&same, resample);
        let own = Neighborhood::new(&finer);
        (finer, own)
    } else {
        (same, own)
    };
    let seamed = (mode != BlendMode::Displacement && !divided).then_some(region);
    let WrittenCells { mut points, folded, seam } =
        write_cells(&canvas, surface, mode, range.camera(), seamed)?;
    let cells = 0..range.points().len();
    let mut filled: Vec<_> = cells.map(|cell| u8::from(range.is_filled(cell))).collect();
    let new = region.cells().iter().zip(region.filled_cells());
    let new = new.filter(|&(&cell, &flag)| flag == 1 || range.point(cell as usize).is_none());
    new.map(|(cell, _)| cell).chain(&beside).for_each(|&cell| filled[cell as usize] = 1);
    if divided {
        filled = (0..points.len())
            .map(|cell| {
                filled[cell / canvas.width / down * range.width() + cell % canvas.width / right]
            })
            .collect();
    }
    if is_border_moved(surface) {
        let filled: Vec<bool> = filled.iter().map(|&filled| filled == 1).collect();
        move_filled_cells(&own.inside, &filled, &canvas.points, &mut points, progress)?;
    }
    let range = if divided {
        refined_range(range, resample, points, filled)?
    } else {
        range.with_points(points)?.with_filled(filled)?
    };
    let joined = joined_triangles(&canvas, &own, &range);
    let range = range.with_joined(joined)?;
    let gaps = measure_gaps(&own.inside, range.points());
    Ok(BlendedRange { range: range.with_seam(gaps), folded, seam })
}

/// Updates `made`, the last result of [`blend`] with an undivided grid, for a changed surface.
fn follow(
    range: &RangeImage,
    region: &Region,
    surface: &Surface,
    mode: BlendMode,
    made: &RangeImage,
) -> Result<BlendedRange, Error> {
    let mut canvas = Canvas::new(range, region, surface, mode)?;
    // The last result contains the points of filled shadows.
    let cells = canvas.points.par_iter_mut().zip(made.points()).with_min_len(16384);
    cells.for_each(|(point, made)| {
        if point.x.is_nan() {
            *point = *made;
        }
    });
    let seamed = (mode != BlendMode::Displacement).then_some(region);
    let WrittenCells { points, folded, seam } =
        write_cells(&canvas, surface, mode, range.camera(), seamed)?;
    let runs = region.cells().chunk_by(|before, cell| before + 1 == *cell);
    let rows: Vec<_> = runs.map(|run| run[0]..run[0] + run.len() as u32).collect();
    let moved = region.cells().iter().map(|&cell| points[cell as usize]).collect();
    let inside = inside_cells(&canvas);
    let range = made.with_moved(&rows, moved);
    let gaps = measure_gaps(&inside, range.points());
    Ok(BlendedRange { range: range.with_seam(gaps), folded, seam })
}

/// The points of all cells of a canvas (range grid) after a surface was written to it, with the number of folded cells and the seam.
struct WrittenCells {
    points: Vec<Point3<f64>>,
    folded: usize,
    seam: Option<Seam>,
}

/// Writes a surface to the cells of a canvas (range grid). If `region` is given, also measures the seam at the border of this region.
fn write_cells(
    canvas: &Canvas,
    surface: &Surface,
    mode: BlendMode,
    camera: Option<&Pinhole>,
    region: Option<&Region>,
) -> Result<WrittenCells, Error> {
    let changes = changes(canvas, surface, mode)?;
    let mut points = canvas.points.clone();
    changes.iter().for_each(|&(cell, point)| points[cell] = point);
    let changed: Vec<usize> = changes.iter().map(|(cell, _)| *cell).collect();
    let folded = folded_cells(canvas.width, &canvas.points, &points, &changed, camera);
    let seam = region.map(|region| seam(region, &canvas.points, &points));
    Ok(WrittenCells { points, folded, seam })
}

/// Gaps of the scan (shadows and slits between unconnected cells) are closed if they are at most this many cells away from the region, even
/// if they do not touch it.
const MAX_GAP_DISTANCE: usize = 8;

/// Maximum edge length of a triangle that continues a surface, in multiples of the grid's median spacing. The limit is large because the
/// region may protrude and hide some of its surroundings from the sensor. Longer edges lead to the background, which does not belong to the
/// surface.
const ACROSS: f64 = 15.0;

/// Two masks of range cells: the cells inside a region, and the cells that are inside or at most `MAX_GAP_DISTANCE` cells away.
struct Neighborhood {
    inside: Mask,
    near: Mask,
}

/// Returns the mask of the cells that change.
fn inside_cells(canvas: &Canvas) -> Mask {
    let mut inside = vec![0; canvas.points.len()];
    canvas.targets.iter().for_each(|target| inside[target.cell] = 1);
    Mask::new(canvas.width, canvas.height, inside).expect("a value for each cell")
}

impl Neighborhood {
    fn new(canvas: &Canvas) -> Self {
        let inside = inside_cells(canvas);
        Self { near: dilate(&inside, MAX_GAP_DISTANCE), inside }
    }

    fn has(&self, cell: usize) -> bool {
        self.inside.pixels()[cell] == 1
    }

    fn is_near(&self, cell: usize) -> bool {
        self.near.pixels()[cell] == 1
    }
}

/// Fills the shadows (areas without points) at the border of the region and near it. Returns the filled cells in raster order.
fn fill_beside(
    canvas: &mut Canvas,
    region: &Neighborhood,
    range: &RangeImage,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, CancelledError> {
    let width = canvas.width;
    // A region has a point for each of its cells, even for a cell without a scanned point.
    fn is_known(cell: usize, region: &Neighborhood, range: &RangeImage) -> bool {
        region.has(cell) || range.point(cell).is_some()
    }
    let longest = longest_edge(range, ACROSS);
    fill_shadows(
        width,
        &mut canvas.points,
        longest,
        |cells| {
            fn has(
                within: bool,
                width: usize,
                cells: &[u32],
                region: &Neighborhood,
                range: &RangeImage,
            ) -> bool {
                neighborhood(width, cells)
                    .any(|it| is_known(it, region, range) && region.has(it) == within)
            }
            cells.len() <= MAX_SHADOW_CELLS
                && has(false, width, cells, region, range)
                && (has(true, width, cells, region, range)
                    || cells.iter().all(|&cell| region.is_near(cell as usize)))
        },
        progress,
    )
}

/// Marks the triangles that stay connected even if the blend stretches them. These are the triangles of the old surface within the region,
/// and triangles at or near the region's border or at filled cells that did not bridge a gap to the background.
fn joined_triangles(canvas: &Canvas, region: &Neighborhood, range: &RangeImage) -> Vec<u8> {
    let Canvas { width, height, points, .. } = canvas;
    let outside: Vec<_> = (0..points.len())
        .map(|cell: usize| !region.has(cell) && !points[cell].x.is_nan())
        .collect();
    let outside = Mask::from_bools(*width, *height, outside).expect("a value for each cell");
    let rim = dilate(&outside, 1);
    let before = range.with_points(points.clone()).expect("as many points as cells");
    let seen = Joins::new(&before, JUMP, GRAZING);
    let across = seen.with_limits(ACROSS, 90.0);
    let mut joined: Vec<_> = (0..points.len()).map(|cell| range.forced_triangles(cell)).collect();
    let held = grid_triangles(
        *width,
        *height,
        points,
        |quad: usize| joined[quad],
        |triangle, corners| {
            let cells = triangle.cells(*width);
            fn any_cell(is: &dyn Fn(usize) -> bool, cells: [usize; 3]) -> bool {
                cells.iter().any(|&cell| is(cell))
            }
            let inside = any_cell(&|cell| region.has(cell), cells);
            if any_cell(&|cell| range.is_filled(cell), cells)
                || inside && any_cell(&|cell| rim.pixels()[cell] == 1, cells)
            {
                across.is_on_surface(corners)
            } else if inside {
                seen.is_on_surface(corners)
            } else {
                // Triangles near the region are joined, too: the outermost cells of the redesigned part often have mixed colors, so a
                // region that was selected by color lacks them.
                any_cell(&|cell| region.is_near(cell), cells)
                    && !seen.is_on_surface(corners)
                    && across.is_on_surface(corners)
            }
        },
    );
    for triangle in held {
        joined[triangle.quad as usize] |= triangle.half.bit();
    }
    joined
}

/// Returns the cells that change, in raster order, and their new points.
fn changes(
    canvas: &Canvas,
    surface: &Surface,
    mode: BlendMode,
) -> Result<Vec<(usize, Point3<f64>)>, Error> {
    let offsets = match mode {
        BlendMode::Displacement => Some(surface_of_offsets(surface)?),
        _ => None,
    };
    // The net coordinates of most cells are integers, so the surface parameters of all integer net coordinates are computed once.
    let [whole_u, whole_v] = [surface.u(), surface.v()]
        .map(|knots| (0..knots.n_control()).map(|k| knots.parameter(k as f64)).collect::<Vec<_>>());
    fn parameters(
        [a, b]: [f64; 2],
        whole_u: &[f64],
        whole_v: &[f64],
        surface: &Surface,
    ) -> (f64, f64) {
        fn known_parameter(whole: &[f64], a: f64) -> Option<f64> {
            whole.get(a as usize).copied().filter(|_| a >= 0.0 && a.fract() == 0.0)
        }
        let u = known_parameter(whole_u, a).unwrap_or_else(|| surface.u().parameter(a));
        (u, known_parameter(whole_v, b).unwrap_or_else(|| surface.v().parameter(b)))
    }
    Ok(canvas
        .targets
        .par_iter()
        .with_min_len(256)
        .map(|target| {
            let before = canvas.points[target.cell];
            let (u, v) = parameters(target.coordinate, &whole_u, &whole_v, surface);
            let after = match (&offsets, mode) {
                (Some(offsets), _) => {
                    let offset = offsets.point(u, v).coords;
                    // Adding a zero offset would change a coordinate of -0 to 0.
                    if offset == Vector3::zeros() { before } else { before + offset }
                }
                (None, BlendMode::Feather { band }) => {
                    let share = smoothstep(target.depth / band);
                    before + (surface.point(u, v) - before) * share
                }
                (None, _) => surface.point(u, v),
            };
            (target.cell, after)
        })
        .collect())
}

/// Returns a surface whose points are displacements. Its control points are the offsets `points - base` of the net of `surface`; its
/// weights and knots are those of `surface`.
fn surface_of_offsets(surface: &Surface) -> Result<Surface, Error> {
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
