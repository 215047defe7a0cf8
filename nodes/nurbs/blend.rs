//! Writes a surface back to the range grid that it came from.

use maquette::value::{ControlNetError, RangeImage, Region, SizeError, Surface, SurfaceError};
use maquette::{Context, Error, In, Node};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::canvas::{Canvas, Target};
use super::fold::folded_cells;
use super::refine::{refine, refined_range};
use super::seam::{Seam, seam};

/// Writes a surface back to the range grid that it came from. Only cells of the region change; all others keep every bit.
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

/// What a blend writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum BlendMode {
    /// The scan, moved as the surface was moved by the offset of its net: keeps all detail and leaves no seam.
    #[default]
    Displacement,
    /// The surface itself: smooth inside, with a small step at the border where the scan is rough.
    Replace,
    /// The surface, fading into the scan towards the border.
    Feather {
        /// Width of the band in which it fades.
        #[schemars(range(min = 0.0, max = 1000.0), extend("unit" = "px"))]
        #[serde(default = "four")]
        band: f64,
    },
}

fn four() -> f64 {
    4.0
}

/// Most cells of a finer grid, some 13 GB of points. More would only run out of memory.
const MOST_CELLS: usize = 1 << 29;

/// Why a surface cannot be written to a range image.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BlendError {
    /// Grids of different sizes.
    #[error("{what} is for a grid of {size:?} cells, the range image has {range:?}")]
    Grid {
        /// `the region` or `the surface`.
        what: &'static str,
        /// Size of its grid.
        size: [usize; 2],
        /// Size of the range image.
        range: [usize; 2],
    },
    /// A surface without a place on the grid.
    #[error("the surface was not made from a region: nothing tells where cells lie on it")]
    NoChart,
    /// A cell without a place on the surface.
    #[error(
        "cell ({column}, {row}) of the region has no place on the surface, which was made from another region"
    )]
    NotOnSurface {
        /// Its column.
        column: usize,
        /// Its row.
        row: usize,
    },
    /// Factors that make no grid.
    #[error(
        "cells cannot be divided by {factors:?}: the factors are 1 or more, for at most 2^29 cells"
    )]
    Resample {
        /// The factors.
        factors: [usize; 2],
    },
    /// The net moved out of all bounds.
    #[error(transparent)]
    Net(#[from] ControlNetError),
    /// The difference between the surface and its base is no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Columns of different sizes.
    #[error(transparent)]
    Size(#[from] SizeError),
}

impl Node for Blend {
    type Outputs = (RangeImage,);
    const OUTPUTS: [&'static str; 1] = ["range"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (range, region, surface) =
            (cx.get(&self.range), cx.get(&self.region), cx.get(&self.surface));
        let blended = blend(range, region, surface, self.mode, self.resample)?;
        if blended.folded > 0 {
            cx.warn(format!(
                "{} changed cells lie in front of each other, seen from the sensor",
                blended.folded
            ));
        }
        if let Some(seam) = blended.seam.filter(Seam::is_visible) {
            cx.warn(format!(
                "the surface leaves a step of {:.2} mm at the region's border, where cells are {:.2} mm apart",
                seam.step, seam.spacing
            ));
        }
        Ok((blended.range,))
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

/// Writes `surface` to the cells of `region`; cells of the region that had no point become valid and are marked as filled.
///
/// With S the surface, S' the surface of its net before any offset, and D the scan, or the region's point where the range has
/// none, the new point of a cell is, by mode: `D + (S - S')`; `S`; `(1 - f) D + f S` with f = x^2 (3 - 2 x) and x from 0 to 1 over
/// the band, by distance from the nearest cell outside. With the same weights `S - S'` is the surface of the net's
/// offsets; where it is 0, D keeps its bits.
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
) -> Result<Blended, BlendError> {
    let [down, right] = resample;
    let cells =
        [range.width(), range.height(), right].iter().try_fold(down, |n, k| n.checked_mul(*k));
    let divided = resample != [1, 1];
    if down == 0 || right == 0 || divided && cells.is_none_or(|cells| MOST_CELLS < cells) {
        return Err(BlendError::Resample { factors: resample });
    }
    let same = Canvas::new(range, region, surface, mode)?;
    let canvas = if divided { refine(&same, resample) } else { same };
    let changes = changes(&canvas, surface, mode)?;
    let mut points = canvas.points.clone();
    changes.iter().for_each(|&(cell, point)| points[cell] = point);
    let changed: Vec<usize> = changes.iter().map(|(cell, _)| *cell).collect();
    let camera = range.camera();
    let folded = folded_cells(canvas.width, &canvas.points, &points, &changed, camera);
    let replaces = mode != BlendMode::Displacement && !divided;
    let seam = replaces.then(|| seam(region, &canvas.points, &points));

    let mut filled: Vec<u8> =
        (0..range.points().len()).map(|cell| u8::from(range.is_filled(cell))).collect();
    for (&cell, &flag) in region.cells().iter().zip(region.filled()) {
        if flag == 1 || range.point(cell as usize).is_none() {
            filled[cell as usize] = 1;
        }
    }
    let range = if divided {
        let old =
            |cell: usize| cell / canvas.width / down * range.width() + cell % canvas.width / right;
        let filled = (0..points.len()).map(|cell| filled[old(cell)]).collect();
        refined_range(range, resample, points, filled)?
    } else {
        range.with_points(points)?.with_filled(filled)?
    };
    Ok(Blended { range, folded, seam })
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
    let parameters = |[a, b]: [f64; 2]| {
        let known = |whole: &[f64], a: f64| {
            whole.get(a as usize).copied().filter(|_| a >= 0.0 && a.fract() == 0.0)
        };
        let u = known(&whole_u, a).unwrap_or_else(|| surface.u().parameter(a));
        (u, known(&whole_v, b).unwrap_or_else(|| surface.v().parameter(b)))
    };
    let change = |target: &Target| {
        let before = canvas.points[target.cell];
        let (u, v) = parameters(target.coordinate);
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
mod tests {
    use maquette::value::{self, Pinhole};
    use nalgebra::Unit;

    use super::super::control_net::tests::{range, region};
    use super::super::control_net::{NetMethod, control_net};
    use super::super::distance::from_border;
    use super::super::nurbs::nurbs;
    use super::super::offset_net::{OffsetStep, offset_net};
    use super::super::profile::Profile;
    use super::*;

    const ALL_MODES: [BlendMode; 3] =
        [BlendMode::Displacement, BlendMode::Replace, BlendMode::Feather { band: 3.0 }];

    /// A rough scan with a hole in it.
    fn bumpy() -> RangeImage {
        range(30, 26, |x, y| match (x, y) {
            (13.0, 12.0) => f64::NAN,
            _ => 700.0 + 0.3 * libm::sin(7.0 * x) * libm::cos(5.0 * y) - 0.02 * x * y,
        })
    }

    fn disk(range: &RangeImage) -> Region {
        region(range, |x, y| x.abs_diff(14).pow(2) + y.abs_diff(13).pow(2) < 64)
    }

    fn surface(
        range: &RangeImage,
        region: &Region,
        method: NetMethod,
        order: usize,
        growth: f64,
    ) -> Surface {
        let net = control_net(region, range, method, 0, 0).unwrap();
        let sensor = Unit::new_unchecked(-Vector3::z());
        let steps = [OffsetStep { distance: growth, angle: 0.0, axis: [0.0; 3] }];
        let net = offset_net(&net, Some(sensor), None, None, &steps, Profile::Cosine).unwrap();
        nurbs(&net, None, None, Some([order; 2])).unwrap()
    }

    fn bits(point: Option<Point3<f64>>) -> Option<[u64; 3]> {
        point.map(|point| [0, 1, 2].map(|k| point[k].to_bits()))
    }

    // T-BLD-01.
    #[test]
    fn a_displacement_by_nothing_keeps_every_bit() {
        let range = bumpy();
        let region = disk(&range);
        for order in 2..=5 {
            let surface = surface(&range, &region, NetMethod::Grid, order, 0.0);
            let same = blend(&range, &region, &surface, BlendMode::Displacement, [1, 1]).unwrap();
            for cell in 0..range.points().len() {
                let before = match region.find(cell) {
                    Some(index) => Some(region.points()[index]),
                    None => range.point(cell),
                };
                assert_eq!(bits(same.range.point(cell)), bits(before));
                assert_eq!(same.range.is_filled(cell), range.point(cell).is_none());
            }
            assert_eq!(same.folded, 0);
        }
    }

    // T-BLD-02.
    #[test]
    fn a_plane_replaced_by_its_surface_is_the_same_plane() {
        let range = range(22, 19, |x, y| 700.0 + 0.3 * x - 0.2 * y);
        let rectangle = region(&range, |x, y| (4..17).contains(&x) && (5..15).contains(&y));
        for (region, method) in [
            (&rectangle, NetMethod::Grid),
            (&rectangle, NetMethod::Rows),
            (&rectangle, NetMethod::Harmonic),
            (&disk(&range), NetMethod::Grid),
        ] {
            for order in 2..=5 {
                let surface = surface(&range, region, method, order, 0.0);
                let same = blend(&range, region, &surface, BlendMode::Replace, [1, 1]).unwrap();
                for (before, after) in range.points().iter().zip(same.range.points()) {
                    assert!((before - after).norm() <= 1e-12, "{method:?} {order} {before}");
                }
            }
        }
    }

    // T-BLD-03.
    #[test]
    fn cells_outside_of_the_region_keep_every_bit() {
        let range = bumpy();
        let region = disk(&range);
        let surface = surface(&range, &region, NetMethod::Grid, 3, 9.0);
        for mode in ALL_MODES {
            let after = blend(&range, &region, &surface, mode, [1, 1]).unwrap().range;
            let mut changed = 0;
            for cell in 0..range.points().len() {
                let same = bits(range.point(cell)) == bits(after.point(cell));
                assert!(same || region.find(cell).is_some());
                changed += usize::from(!same);
            }
            assert!(changed > 100, "{mode:?}");
        }
    }

    // T-BLD-04.
    #[test]
    fn replacing_leaves_a_known_part_of_a_spike() {
        let spike = |x: f64, y: f64| if (x, y) == (11.0, 10.0) { 1.0 } else { 0.0 };
        let range = range(22, 20, spike);
        let region = region(&range, |x, y| (4..18).contains(&x) && (4..17).contains(&y));
        for (order, left) in [(4, 16.0 / 36.0), (3, 36.0 / 64.0)] {
            let surface = surface(&range, &region, NetMethod::Grid, order, 0.0);
            let after = blend(&range, &region, &surface, BlendMode::Replace, [1, 1]).unwrap();
            let height = after.range.points()[10 * 22 + 11].z;
            assert!((height - left).abs() <= 1e-12, "{height}");
        }
    }

    /// A face with a nose: half a ball of 13 cells' radius and its cells' points, 1 mm apart.
    fn face() -> (RangeImage, Region) {
        let height_sq = |x: f64, y: f64| 169.0 - (x - 24.0) * (x - 24.0) - (y - 22.0) * (y - 22.0);
        let noise = |x: f64, y: f64| 0.05 * libm::sin(12.9898 * x + 78.233 * y);
        let range = range(49, 45, |x, y| 700.0 - height_sq(x, y).max(0.0).sqrt() + noise(x, y));
        let region = region(&range, |x, y| height_sq(x as f64, y as f64) > 0.0);
        (range, region)
    }

    #[test]
    fn the_summit_moves_by_the_growth_and_the_contour_stays() {
        let (range, nose) = face();
        let growth = 12.0;
        for order in [3, 4] {
            let surface = surface(&range, &nose, NetMethod::Grid, order, growth);
            let after = blend(&range, &nose, &surface, BlendMode::Displacement, [1, 1]).unwrap();
            let moved = |cell: usize| (after.range.points()[cell] - range.points()[cell]).norm();
            let summit = moved(22 * 49 + 24);
            assert!((summit - growth).abs() <= 0.1 * growth, "{summit}");
            let depths = from_border(&nose, 1.0);
            let contour = nose.cells().iter().zip(depths).filter(|(_, depth)| *depth <= 1.0);
            let most = contour.map(|(&cell, _)| moved(cell as usize)).fold(0.0, f64::max);
            assert!(0.0 < most && most <= 0.015 * growth, "order {order}: {most}");
            assert_eq!(after.folded, 0);
        }
    }

    #[test]
    fn the_methods_rows_and_feather_grow_the_nose_too() {
        let (range, nose) = face();
        for (method, mode) in [
            (NetMethod::Rows, BlendMode::Replace),
            (NetMethod::Rows, BlendMode::Displacement),
            (NetMethod::Harmonic, BlendMode::Replace),
            (NetMethod::Harmonic, BlendMode::Displacement),
            (NetMethod::Polar { order: 3 }, BlendMode::Displacement),
            (NetMethod::Grid, BlendMode::Feather { band: 4.0 }),
        ] {
            let surface = surface(&range, &nose, method, 3, 12.0);
            let after = blend(&range, &nose, &surface, mode, [1, 1]).unwrap();
            let summit = after.range.points()[22 * 49 + 24] - range.points()[22 * 49 + 24];
            assert!((summit.norm() - 12.0).abs() <= 1.5, "{method:?} {mode:?} {summit}");
        }
    }

    #[test]
    fn a_surface_that_misses_the_border_leaves_a_seam() {
        let (range, nose) = face();
        let steps = |mode| {
            let surface = surface(&range, &nose, NetMethod::Grid, 3, 0.0);
            let raised: Vec<_> =
                surface.net().points().iter().map(|p| p - 9.0 * Vector3::z()).collect();
            let net = surface.net().clone().with_points(raised).unwrap();
            let surface = nurbs(&net, None, None, None).unwrap();
            blend(&range, &nose, &surface, mode, [1, 1]).unwrap().seam
        };
        let seam = steps(BlendMode::Replace).unwrap();
        assert!(seam.is_visible() && (seam.step - 9.0).abs() < 2.0, "{seam:?}");
        let faded = steps(BlendMode::Feather { band: 6.0 }).unwrap();
        assert!(!faded.is_visible(), "{faded:?}");
        assert_eq!(steps(BlendMode::Displacement), None);
    }

    #[test]
    fn a_finer_grid_shows_the_same_nose() {
        let (range, nose) = face();
        let surface = surface(&range, &nose, NetMethod::Grid, 3, 12.0);
        for mode in ALL_MODES {
            let coarse = blend(&range, &nose, &surface, mode, [1, 1]).unwrap().range;
            let fine = blend(&range, &nose, &surface, mode, [3, 1]).unwrap().range;
            assert_eq!((fine.width(), fine.height()), (49, 135));
            // The middle one of three new rows lies on the old row.
            for cell in 0..coarse.points().len() {
                let there = (cell / 49 * 3 + 1) * 49 + cell % 49;
                let difference = fine.points()[there] - coarse.points()[cell];
                assert!(difference.norm() <= 1e-9, "{mode:?}, cell {cell}: {difference}");
            }
        }
    }

    #[test]
    fn a_point_pulled_aside_folds() {
        let (range, nose) = face();
        let net = control_net(&nose, &range, NetMethod::Grid, 0, 0).unwrap();
        let aside = Some(Unit::new_unchecked(Vector3::x()));
        let steps = [OffsetStep { distance: 30.0, angle: 0.0, axis: [0.0; 3] }];
        let net = offset_net(&net, aside, None, None, &steps, Profile::Cosine).unwrap();
        let surface = nurbs(&net, None, None, None).unwrap();
        let camera = Pinhole { focal: [700.0; 2], center: [0.0; 2] };
        for camera in [None, Some(camera)] {
            let range = range.clone().with_camera(camera);
            let after = blend(&range, &nose, &surface, BlendMode::Displacement, [1, 1]).unwrap();
            assert!(after.folded > 20, "{}", after.folded);
        }
    }

    #[test]
    fn surfaces_that_do_not_belong_to_the_range_are_refused() {
        let range = bumpy();
        let disk = disk(&range);
        let fitting = surface(&range, &disk, NetMethod::Grid, 3, 1.0);
        let refused = |range: &RangeImage, region: &Region, surface: &Surface, resample| {
            blend(range, region, surface, BlendMode::Replace, resample).unwrap_err()
        };
        let free = value::ControlNet::new(3, 3, vec![Point3::origin(); 9]).unwrap();
        let free = nurbs(&free, None, None, None).unwrap();
        assert_eq!(refused(&range, &disk, &free, [1, 1]), BlendError::NoChart);
        let all = region(&range, |_, _| true);
        let not_there = BlendError::NotOnSurface { column: 0, row: 0 };
        assert_eq!(refused(&range, &all, &fitting, [1, 1]), not_there);
        let other = self::range(5, 5, |_, _| 0.0);
        assert!(matches!(refused(&other, &disk, &fitting, [1, 1]), BlendError::Grid { .. }));
        for factors in [[0, 1], [1, 0], [1 << 15, 1 << 15], [usize::MAX, 2]] {
            assert_eq!(refused(&range, &disk, &fitting, factors), BlendError::Resample { factors });
        }
    }
}
