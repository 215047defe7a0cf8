//! Sparse sets of cells or nodes of a cube that is divided into equal cells. The positions are sorted by z, then y, then x. A row consists
//! of all positions with the same z and y.

use std::ops::Range;

use maquette_value::parallel::*;
use nalgebra::Point3;

/// The integer coordinates of a cell or a node in a cube: x, y, z.
pub(super) type CellIndex = [i32; 3];

/// A cube that is halved repeatedly: at depth `d` it has `2^d` cells along each side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cube {
    /// The corner with the lowest coordinates.
    pub(super) corner: Point3<f64>,
    /// Edge length of the finest cells, in mm.
    pub(super) edge: f64,
    /// Depth of the finest cells.
    pub(super) depth: u32,
}

impl Cube {
    /// Returns the edge length of the cells at a depth, in mm.
    pub(super) fn edge_at(&self, depth: u32) -> f64 {
        self.edge * f64::from(1_u32 << (self.depth - depth))
    }

    /// Converts a point to coordinates in units of the cells at a depth.
    pub(super) fn in_cells(&self, point: &Point3<f64>, depth: u32) -> [f64; 3] {
        let edge = self.edge_at(depth);
        [0, 1, 2].map(|axis| (point[axis] - self.corner[axis]) / edge)
    }

    /// Returns the cell at a depth that contains the coordinates.
    pub(super) fn cell(&self, coordinates: [f64; 3], depth: u32) -> CellIndex {
        let last = (1_i32 << depth) - 1;
        coordinates.map(|x| (x.floor() as i32).clamp(0, last))
    }

    /// Converts coordinates in units of the cells at a depth to a point in mm.
    pub(super) fn point(&self, coordinates: [f64; 3], depth: u32) -> Point3<f64> {
        let edge = self.edge_at(depth);
        Point3::from([0, 1, 2].map(|axis| self.corner[axis] + coordinates[axis] * edge))
    }
}

/// A sorted set of positions, each with an index.
#[derive(Clone, Debug, Default)]
pub(super) struct Places {
    /// The number of rows along y and along z.
    side: i32,
    places: Vec<[u16; 3]>,
    /// The index of each row's first position, ordered by z, then y; followed by the end of the last row.
    rows: Vec<u32>,
}

impl Places {
    /// Makes a set of sorted, distinct positions, whose coordinates are below `side`.
    pub(super) fn new(side: i32, places: Vec<[u16; 3]>) -> Self {
        let n_rows = (side * side) as usize;
        let mut rows = vec![0_u32; n_rows + 1];
        for place in &places {
            rows[usize::from(place[2]) * side as usize + usize::from(place[1]) + 1] += 1;
        }
        for row in 0..n_rows {
            rows[row + 1] += rows[row];
        }
        Self { side, places, rows }
    }

    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    pub(super) fn side(&self) -> i32 {
        self.side
    }

    pub(super) fn place(&self, number: usize) -> CellIndex {
        self.places[number].map(i32::from)
    }

    /// Returns the range of indices of the positions in a row.
    pub(super) fn row(&self, y: i32, z: i32) -> Range<usize> {
        if y < 0 || z < 0 || y >= self.side || z >= self.side {
            return 0..0;
        }
        let row = (z * self.side + y) as usize;
        self.rows[row] as usize..self.rows[row + 1] as usize
    }

    /// Returns the first index in a row whose position is at least `x`.
    pub(super) fn from(&self, row: Range<usize>, x: i32) -> usize {
        row.start + self.places[row].partition_point(|place| i32::from(place[0]) < x)
    }

    pub(super) fn find(&self, [x, y, z]: CellIndex) -> Option<usize> {
        let row = self.row(y, z);
        let at = self.from(row.clone(), x);
        (at < row.end && i32::from(self.places[at][0]) == x).then_some(at)
    }

    /// Returns the indices of the positions whose coordinates differ from the given ones by at most 1.
    pub(super) fn neighbors(&self, [x, y, z]: CellIndex) -> impl Iterator<Item = usize> {
        (0..9).flat_map(move |k| {
            let row = self.row(y + k % 3 - 1, z + k / 3 - 1);
            let first = self.from(row.clone(), x - 1);
            (first..row.end.min(first + 3)).take_while(move |&at| self.place(at)[0] <= x + 1)
        })
    }

    /// Returns the indices of the nodes at the eight corners of a cell; `None` if one is not in the set; corner `k` is offset by the bits
    /// of `k`, x first.
    pub(super) fn corners(&self, [x, y, z]: CellIndex) -> Option<[usize; 8]> {
        let mut corners = [0; 8];
        for k in 0..4 {
            let first = self.find([x, y + (k & 1), z + (k >> 1)])?;
            let next = self.places.get(first + 1)?;
            if next.map(i32::from) != [x + 1, y + (k & 1), z + (k >> 1)] {
                return None;
            }
            corners[2 * k as usize] = first;
            corners[2 * k as usize + 1] = first + 1;
        }
        Some(corners)
    }

    /// Dilates the set: returns all cells whose offset from a cell of the set is within `reach` along each axis, in a cube of `side` cells
    /// along each axis.
    pub(super) fn spread(&self, side: i32, reach: std::ops::RangeInclusive<i32>) -> Self {
        let (low, high) = (*reach.start(), *reach.end());
        let layers: Vec<Vec<[u16; 3]>> = (0..side)
            .into_par_iter()
            .map(|z: i32| {
                let mut places = Vec::new();
                let mut is_in = vec![0_u64; side as usize / 64 + 1];
                for y in 0..side {
                    let mut any = false;
                    for cell_z in z - high..=z - low {
                        for cell_y in y - high..=y - low {
                            for at in self.row(cell_y, cell_z) {
                                any = true;
                                let x = i32::from(self.places[at][0]);
                                for x in (x + low).max(0)..=(x + high).min(side - 1) {
                                    is_in[x as usize / 64] |= 1 << (x % 64);
                                }
                            }
                        }
                    }
                    if any {
                        for (word, bits) in is_in.iter_mut().enumerate() {
                            while *bits != 0 {
                                let x = 64 * word as u32 + bits.trailing_zeros();
                                places.push([x as u16, y as u16, z as u16]);
                                *bits &= *bits - 1;
                            }
                        }
                    }
                }
                places
            })
            .collect();
        Self::new(side, layers.concat())
    }

    /// Returns the set of all positions of a cube with `side` positions along each axis.
    pub(super) fn full(side: i32) -> Self {
        let count = side * side * side;
        Self::new(
            side,
            (0..count)
                .map(|k: i32| [k % side, k / side % side, k / side / side].map(|x| x as u16))
                .collect(),
        )
    }
}

/// Returns the value at `x` of the quadratic B-spline centered at 0; it is 0 if the absolute value of `x` is 1.5 or more.
pub(super) fn bell(x: f64) -> f64 {
    let x = x.abs();
    if x < 0.5 {
        0.75 - x * x
    } else if x < 1.5 {
        0.5 * (1.5 - x) * (1.5 - x)
    } else {
        0.0
    }
}

/// Returns the weights of a cell's corners for trilinear interpolation at a position within the cell, given from 0 to 1 along each axis.
pub(super) fn corner_weights([x, y, z]: [f64; 3]) -> [f64; 8] {
    std::array::from_fn(|k| {
        fn weight(x: f64, bit: usize, k: usize) -> f64 {
            if k & bit == 0 { 1.0 - x } else { x }
        }
        weight(x, 1, k) * weight(y, 2, k) * weight(z, 4, k)
    })
}
