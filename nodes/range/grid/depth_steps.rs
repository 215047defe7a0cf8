//! Depth steps in a region: places where neighboring cells are on different surfaces.

use maquette_base::topology::union_find::UnionFind;
use maquette_value::{Mask, RangeImage};

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
/// distance of their points is at most `JUMP` times the median spacing of the grid. A cell without a measured point is on the surface of
/// any neighbor. Of several equally large parts, the first is taken.
///
/// Returns the cells of this part, and the steps. Without steps the region is returned unchanged.
pub(crate) fn without_steps(region: Mask, range: &RangeImage) -> (Mask, DepthSteps) {
    let (width, height) = (region.width(), region.height());
    let longest = longest_edge(range, JUMP);
    fn measured(cell: usize, range: &RangeImage) -> Option<nalgebra::Point3<f64>> {
        range.point(cell).filter(|_| !range.is_filled(cell))
    }
    fn is_inside(cell: usize, region: &Mask) -> bool {
        region.pixels()[cell] == 1
    }
    let mut surfaces = UnionFind::new(width * height);
    let mut crossed = Vec::new();
    for cell in (0..width * height).filter(|&cell| is_inside(cell, &region)) {
        let right = (cell % width + 1 < width).then_some(cell + 1);
        let below = (cell + width < width * height).then_some(cell + width);
        for other in [right, below].into_iter().flatten().filter(|&other| is_inside(other, &region))
        {
            let distance = measured(cell, range)
                .zip(measured(other, range))
                .map_or(0.0, |(a, b)| (b - a).norm());
            if distance <= longest {
                surfaces.union(cell as u32, other as u32);
            } else {
                crossed.push((cell, other, distance));
            }
        }
    }
    let Some(&(cell, _, distance)) = crossed.iter().max_by(|a, b| a.2.total_cmp(&b.2)) else {
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
    for (a, b, _) in crossed {
        let [a, b] = [a, b].map(|cell| surfaces.find(cell as u32));
        match (a == largest, b == largest) {
            (true, true) => within += 1,
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
