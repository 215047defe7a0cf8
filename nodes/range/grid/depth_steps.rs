//! Depth steps in a region: places where neighboring cells are on different surfaces.

use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Mask, RangeImage};
use nalgebra::Point3;

use super::joins::{JUMP, longest_edge};

/// The depth steps in a set of cells.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct DepthSteps {
    /// The number of cells that steps separate from the largest surface.
    pub(crate) separated: usize,
    /// The number of pairs of neighboring cells on the largest surface that have a step between them.
    pub(crate) within: usize,
    /// The column and row of the cell at the largest step, and the distance across it in mm.
    pub(crate) largest: ([usize; 2], f64),
}

impl DepthSteps {
    /// A warning; `None` for fewer than three pairs of cells, which are noise.
    pub(crate) fn warning(&self) -> Option<String> {
        let ([column, row], distance) = self.largest;
        let place = format!(
            "the label crosses a depth step, the largest of {distance:.1} mm at cell ({column}, {row})"
        );
        if self.separated > 0 {
            let cells = self.separated;
            return Some(format!("{place}: {cells} cells on other surfaces are left out"));
        }
        (self.within >= 3).then(|| {
            format!(
                "{place}: the new surface stretches across it; label one side only, or remove the other one (`KeepCells`)"
            )
        })
    }
}

/// Finds the largest part of a region that no depth step divides: neighboring cells, along rows and columns, are on one surface if the
/// distance of their points is at most `JUMP` times the median spacing of the grid. Cells without a measured point that are connected
/// belong to the largest surface beside them, and connect it with those beside them that it continues. Of several equally large parts, the
/// first is taken.
///
/// Returns the cells of this part, and the steps. Without steps the region is returned unchanged.
pub(crate) fn without_steps(region: Mask, range: &RangeImage) -> (Mask, DepthSteps) {
    let (width, height) = (region.width(), region.height());
    let longest = longest_edge(range, JUMP);
    let mut surfaces = UnionFind::new(width * height);
    let mut gaps = UnionFind::new(width * height);
    let (mut crossed, mut beside_gaps) = (Vec::new(), Vec::new());
    for (cell, other) in neighbors(&region) {
        match (measured(cell, range), measured(other, range)) {
            (Some(a), Some(b)) if (b - a).norm() <= longest => {
                surfaces.union(cell as u32, other as u32);
            }
            (Some(a), Some(b)) => crossed.push((cell, other, (b - a).norm())),
            (None, None) => gaps.union(cell as u32, other as u32),
            (None, Some(_)) => beside_gaps.push((cell as u32, other as u32)),
            (Some(_), None) => beside_gaps.push((other as u32, cell as u32)),
        }
    }
    let sides = beside_gaps.iter().map(|&(gap, cell)| (gaps.find(gap), cell));
    let across_gaps = join_across_gaps(sides.collect(), range, longest, &mut surfaces);
    for gap in (0..width * height).filter(|&cell| is_inside(cell, &region)) {
        if measured(gap, range).is_none() {
            // A gap that `join_across_gaps` has joined to a surface takes all its cells with it.
            let first = gaps.find(gap as u32);
            surfaces.union(gap as u32, first);
        }
    }
    let steps = crossed.iter().chain(&across_gaps);
    let Some(&(cell, _, distance)) = steps.max_by(|a, b| a.2.total_cmp(&b.2)) else {
        return (region, DepthSteps::default());
    };
    let mut sizes = vec![0_u32; width * height];
    for cell in (0..width * height).filter(|&cell| is_inside(cell, &region)) {
        sizes[surfaces.find(cell as u32) as usize] += 1;
    }
    let most = sizes.iter().copied().max().unwrap_or_default();
    let largest = sizes.iter().position(|&size| size == most).unwrap_or_default() as u32;
    let mut across: Vec<u32> = Vec::new();
    let mut within = 0;
    let n_crossed = crossed.len();
    for (index, (a, b, _)) in crossed.into_iter().chain(across_gaps).enumerate() {
        let [a, b] = [a, b].map(|cell| surfaces.find(cell as u32));
        match (a == largest, b == largest) {
            // Surfaces on both sides of a gap may be connected elsewhere: there is no step.
            (true, true) => within += usize::from(index < n_crossed),
            (true, false) => across.push(b),
            (false, true) => across.push(a),
            (false, false) => {}
        }
    }
    across.sort_unstable();
    across.dedup();
    let separated = across.iter().map(|&surface| sizes[surface as usize] as usize).sum();
    let kept = (0..width * height)
        .map(|cell| is_inside(cell, &region) && surfaces.find(cell as u32) == largest)
        .collect::<Vec<bool>>();
    let cells = Mask::from_bools(width, height, kept).expect("one entry per cell");
    (cells, DepthSteps { separated, within, largest: ([cell % width, cell / width], distance) })
}

fn is_inside(cell: usize, region: &Mask) -> bool {
    region.pixels()[cell] == 1
}

fn measured(cell: usize, range: &RangeImage) -> Option<Point3<f64>> {
    range.point(cell).filter(|_| !range.is_filled(cell))
}

/// Returns all pairs of cells of a region that share a side.
fn neighbors(region: &Mask) -> impl Iterator<Item = (usize, usize)> {
    let (width, count) = (region.width(), region.pixels().len());
    (0..count).filter(|&cell| is_inside(cell, region)).flat_map(move |cell| {
        let right = (cell % width + 1 < width).then_some(cell + 1);
        let below = (cell + width < count).then_some(cell + width);
        let near = [right, below].into_iter().flatten();
        near.filter(|&other| is_inside(other, region)).map(move |other| (cell, other))
    })
}

/// Joins each gap (connected cells without a measured point) to the largest surface beside it, and to other surfaces beside it that may
/// continue that one: some cells on both sides are at most `longest` per step of the grid apart. `sides` has the first cell of a gap and a
/// measured cell beside it, for each such cell. Returns the pairs of cells beside a gap that it does not join, with their distances.
fn join_across_gaps(
    mut sides: Vec<(u32, u32)>,
    range: &RangeImage,
    longest: f64,
    surfaces: &mut UnionFind,
) -> Vec<(usize, usize, f64)> {
    let mut sizes = vec![0_u32; range.points().len()];
    for cell in 0..range.points().len() {
        sizes[surfaces.find(cell as u32) as usize] += 1;
    }
    sides.sort_unstable();
    sides.dedup();
    let mut separated = Vec::new();
    for gap in sides.chunk_by(|a, b| a.0 == b.0) {
        let surface_of: Vec<u32> = gap.iter().map(|&(_, cell)| surfaces.find(cell)).collect();
        let largest = surface_of
            .iter()
            .copied()
            .max_by_key(|&surface| (sizes[surface as usize], std::cmp::Reverse(surface)));
        let Some(largest) = largest else { continue };
        surfaces.union(gap[0].0, largest);
        let (here, there): (Vec<_>, Vec<_>) =
            gap.iter().zip(&surface_of).partition(|(_, surface)| **surface == largest);
        for (&(_, other), _) in there {
            let distances = here.iter().map(|&(&(_, cell), _)| {
                let [[a_x, a_y], [b_x, b_y]] = [cell, other]
                    .map(|cell| [cell as usize % range.width(), cell as usize / range.width()]);
                let steps = (a_x.abs_diff(b_x) + a_y.abs_diff(b_y)) as f64;
                let [a, b] = [cell, other].map(|cell| range.points()[cell as usize]);
                ((b - a).norm(), steps, cell)
            });
            let nearest = distances.min_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)));
            match nearest {
                Some((distance, steps, cell)) if distance > longest * steps => {
                    separated.push((cell as usize, other as usize, distance));
                }
                _ => surfaces.union(other, largest),
            }
        }
    }
    separated
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_belongs_to_one_of_the_surfaces_beside_it() {
        // A near surface of three columns, a column without points, and cells of the same row on a surface far behind, or just beyond.
        fn count(behind: f64) -> usize {
            let cells = (0..30).map(|cell| [cell % 6, cell / 6].map(f64::from));
            let points = cells.map(|[x, y]| match x {
                3.0 => Point3::new(f64::NAN, f64::NAN, f64::NAN),
                x => Point3::new(x, y, 700.0 + if x > 3.0 { behind } else { 0.0 }),
            });
            let range = RangeImage::new(6, 5, points.collect()).unwrap();
            without_steps(Mask::from_rows(&["######"; 5]), &range).0.count()
        }
        assert_eq!(count(0.0), 30);
        assert_eq!(count(8.0), 30);
        assert_eq!(count(40.0), 20);
    }
}
