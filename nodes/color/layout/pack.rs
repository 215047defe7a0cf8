//! Packs charts into a square, without overlap.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::Vector2;

/// A chart to be packed.
pub(super) struct Piece<'a> {
    pub(super) triangles: &'a [[u32; 3]],
    /// Positions of the chart's vertices, in mm.
    pub(super) flat: Vec<Vector2<f64>>,
}

/// The texture coordinates of packed charts.
pub(super) struct PackedCharts {
    /// The coordinates of each chart's vertices.
    pub(super) places: Vec<Vec<[f64; 2]>>,
    /// Scale of the layout: texels per mm of the surface.
    pub(super) scale: f64,
}

/// Maximum number of positions that are tried along each side of the square: a multiple of 64.
const PLACES: usize = 512;

/// Factor by which all charts are shrunk repeatedly until they fit.
const SHRINK: f64 = 0.95;

/// Fraction of the square's area that the charts fill at the scale that is tried first.
const INITIAL_FILL: f64 = 0.85;

/// Number of bisection steps that increase the scale again to the largest one that fits.
const HALVINGS: usize = 3;

/// Packs all charts into a square of `size` texels, with `padding` texels between two charts and half of that at the border. All charts
/// have one scale, the largest that is found. The result is `None` if the charts do not fit.
///
/// Long charts are placed first. Each chart is placed in that of four orientations, and at that position, where its top is lowest. This
/// order and this criterion are those of Levy, Petitjean, Ray and Maillot, "Least squares conformal maps for automatic texture atlas
/// generation" (2002), section 4. Unlike in that paper, all blocks that a chart covers are tracked, so that small charts fill the gaps of
/// large ones.
pub(super) fn pack(
    pieces: &[Piece<'_>],
    size: usize,
    padding: usize,
    progress: &Progress<'_>,
) -> Result<Option<PackedCharts>, CancelledError> {
    let pieces: Vec<_> = pieces.par_iter().map(upright).collect();
    let block = size.div_ceil(PLACES);
    let square = Square { blocks: size / block, block: block as f64, margin: padding as f64 / 2.0 };
    let area: f64 = pieces.iter().map(|piece| piece.area).sum();
    let least = (2.0 * square.margin / square.block).ceil().max(1.0);
    let side = square.blocks as f64;
    if side * side < pieces.len() as f64 * least * least {
        return Ok(None);
    }
    let heights: Vec<f64> = pieces.iter().map(|piece| piece.size.max()).collect();
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by(|&a, &b| heights[b].total_cmp(&heights[a]).then(a.cmp(&b)));
    let longest = order.first().map_or(1.0, |&k| heights[k]);
    let mut scale = side * square.block * (INITIAL_FILL / area).sqrt().min(1.0 / longest);
    let mut found = None;
    // After this many steps, all charts are far below their minimum size.
    for _ in 0..200 {
        found = square.place(&pieces, &order, scale, progress)?;
        if found.is_some() {
            break;
        }
        scale *= SHRINK;
    }
    let Some(mut found) = found else { return Ok(None) };
    let mut step = scale * (1.0 / SHRINK - 1.0);
    for _ in 0..HALVINGS {
        step /= 2.0;
        if let Some(better) = square.place(&pieces, &order, scale + step, progress)? {
            (found, scale) = (better, scale + step);
        }
    }
    let places = pieces.iter().zip(&found).map(|(piece, spot)| {
        let blocks = square.blocks_of(piece, scale).map(|count| count as f64 * square.block);
        piece
            .flat
            .iter()
            .map(|place| {
                let [x, y] = [place.x * scale + square.margin, place.y * scale + square.margin];
                let turned = match spot.turn {
                    0 => [x, y],
                    1 => [blocks[1] - y, x],
                    2 => [blocks[0] - x, blocks[1] - y],
                    _ => [y, blocks[0] - x],
                };
                let corner = spot.at.map(|it| it as f64 * square.block);
                [0, 1].map(|axis| (corner[axis] + turned[axis]) / size as f64)
            })
            .collect()
    });
    Ok(Some(PackedCharts { places: places.collect(), scale }))
}

/// A chart rotated to the smallest bounding box, with its lower left corner at the origin.
struct Upright<'a> {
    triangles: &'a [[u32; 3]],
    flat: Vec<Vector2<f64>>,
    size: Vector2<f64>,
    area: f64,
}

/// Rotates a chart to its bounding box of minimum area. A side of that box is parallel to a side of the convex hull: Freeman and Shapira,
/// "Determining the minimum-area encasing rectangle for an arbitrary closed curve" (1975).
fn upright<'a>(piece: &Piece<'a>) -> Upright<'a> {
    let hull = hull(&piece.flat);
    fn extent(right: Vector2<f64>, hull: &[Vector2<f64>]) -> (Vector2<f64>, Vector2<f64>) {
        let up = Vector2::new(-right.y, right.x);
        fn spread(axis: Vector2<f64>, hull: &[Vector2<f64>]) -> [f64; 2] {
            let along = hull.iter().map(|at| axis.dot(at));
            let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            });
            [low, high]
        }
        let [[left, right], [bottom, top]] = [spread(right, hull), spread(up, hull)];
        (Vector2::new(left, bottom), Vector2::new(right - left, top - bottom))
    }
    let sides = hull.iter().zip(hull[1..].iter().chain(&hull[..1]));
    let directions = sides.filter_map(|(a, b)| (b - a).try_normalize(0.0));
    fn cost(right: &Vector2<f64>, hull: &[Vector2<f64>]) -> f64 {
        let size = extent(*right, hull).1;
        // The second term prefers the shorter of two boxes with equal areas.
        size.x * size.y + 1e-6 * size.max() * size.max()
    }
    let best = directions.min_by(|a, b| cost(a, &hull).total_cmp(&cost(b, &hull)));
    let right = best.unwrap_or_else(Vector2::x);
    let (low, size) = extent(right, &hull);
    let flat: Vec<_> = piece
        .flat
        .iter()
        .map(|at| Vector2::new(right.dot(at) - low.x, right.perp(at) - low.y))
        .collect();
    let area = piece
        .triangles
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.map(|it| flat[it as usize]);
            (b - a).perp(&(c - a)).abs()
        })
        .sum::<f64>()
        / 2.0;
    Upright { triangles: piece.triangles, flat, size, area }
}

/// Returns the corners of the convex hull, counter-clockwise: Andrew, "Another efficient algorithm for convex hulls in two dimensions"
/// (1979).
fn hull(points: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    fn half(points: &mut dyn Iterator<Item = &Vector2<f64>>) -> Vec<Vector2<f64>> {
        let mut half: Vec<Vector2<f64>> = Vec::new();
        for &at in points {
            while let [.., a, b] = half[..]
                && (b - a).perp(&(at - a)) <= 0.0
            {
                half.pop();
            }
            half.push(at);
        }
        half.pop();
        half
    }
    let mut hull = half(&mut sorted.iter());
    hull.extend(half(&mut sorted.iter().rev()));
    if hull.is_empty() { sorted.into_iter().take(1).collect() } else { hull }
}

/// The square divided into blocks of texels, in which charts are placed.
struct Square {
    blocks: usize,
    /// Side length of a block in texels.
    block: f64,
    /// Margin around each chart in texels.
    margin: f64,
}

/// A row of blocks, one bit per block.
type Row = [u64; PLACES / 64];

/// Adjacent blocks in a row: the index of the row, the first block, and the number of blocks.
type Run = [usize; 3];

#[derive(Clone, Copy)]
struct Spot {
    /// The number of quarter rotations, counter-clockwise, by which the chart is placed.
    turn: usize,
    /// The block (column, row) at the lower left corner of the chart.
    at: [usize; 2],
}

impl Square {
    /// Returns the width and height of a chart in blocks.
    fn blocks_of(&self, piece: &Upright<'_>, scale: f64) -> [usize; 2] {
        [0, 1].map(|axis| {
            let count = (piece.size[axis] * scale + 2.0 * self.margin) / self.block;
            (count.ceil() as usize).max(1)
        })
    }

    /// Returns a position for each chart; `None` if not all charts fit.
    fn place(
        &self,
        pieces: &[Upright<'_>],
        order: &[usize],
        scale: f64,
        progress: &Progress<'_>,
    ) -> Result<Option<Vec<Spot>>, CancelledError> {
        let mut taken = vec![Row::default(); self.blocks];
        // For each row of blocks, the length of the longest run of free blocks in the row.
        let mut longest = vec![self.blocks; self.blocks];
        // The size of the last piece whose search began at the lowest row, and the row in which that piece was placed.
        let (mut searched, mut begin) = ([usize::MAX / 9; 2], 0);
        if pieces
            .iter()
            .any(|piece| self.blocks_of(piece, scale).iter().any(|&it| self.blocks < it))
        {
            return Ok(None);
        }
        let covers = pieces
            .par_iter()
            .map(|piece| runs(&self.cover(piece, scale, self.blocks_of(piece, scale))));
        let covers: Vec<_> = covers.collect();
        let mut spots = vec![Spot { turn: 0, at: [0, 0] }; pieces.len()];
        for &index in order {
            progress.check()?;
            let piece = &pieces[index];
            let counts = self.blocks_of(piece, scale);
            let runs = &covers[index];
            let sides = [counts[0].max(counts[1]), counts[0].min(counts[1])];
            if (0..2).any(|k| 10 * sides[k] < 9 * searched[k]) {
                (searched, begin) = (sides, 0);
            }
            let mut best: Option<(usize, Spot, Vec<Run>)> = None;
            for turn in 0..4 {
                let [width, height] = if turn % 2 == 0 { counts } else { [counts[1], counts[0]] };
                let mut runs = rotate(runs, counts, turn);
                // Test the longest run of blocks first, because it fits least often.
                runs.sort_by_key(|run| (self.blocks - run[2], run[0]));
                let most = best.as_ref().map_or(self.blocks, |best| best.0 - 1);
                let Some(last) = most.checked_sub(height) else { continue };
                let places = self.blocks - width + 1;
                if let Some(at) =
                    (begin..=last).find_map(|row| Some([free(&taken, &runs, row, places)?, row]))
                {
                    best = Some((at[1] + height, Spot { turn, at }, runs));
                }
            }
            let Some((_, spot, runs)) = best else { return Ok(None) };
            // Begin the next search at this row: a piece of similar size does not fit below it, either.
            begin = spot.at[1];
            for [row, first, count] in runs {
                let row = spot.at[1] + row;
                set(&mut taken[row], spot.at[0] + first, count);
                longest[row] = longest_free(&taken[row], self.blocks);
            }
            spots[index] = spot;
        }
        Ok(Some(spots))
    }

    /// Returns the blocks that a chart covers, dilated by a margin along both axes; the lowest row comes first.
    fn cover(&self, piece: &Upright<'_>, scale: f64, [width, height]: [usize; 2]) -> Vec<Row> {
        let mut rows = vec![Row::default(); height];
        let margin = self.margin;
        fn block(x: f64, most: usize, block: f64) -> usize {
            ((x / block).max(0.0) as usize).min(most - 1)
        }
        let mut fill = |corners: &[Vector2<f64>]| {
            fn ends(axis: usize, it: &mut dyn Iterator<Item = Vector2<f64>>) -> [f64; 2] {
                it.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| {
                    [low.min(at[axis]), high.max(at[axis])]
                })
            }
            let [bottom, top] = ends(1, &mut corners.iter().copied());
            let last = block(top + 2.0 * margin, height, self.block);
            for (row, bits) in
                rows.iter_mut().enumerate().take(last + 1).skip(block(bottom, height, self.block))
            {
                // Each side is clipped to the lower and upper edge of the row of blocks.
                let low = row as f64 * self.block - 2.0 * margin;
                let high = (row + 1) as f64 * self.block;
                let next = corners[1..].iter().chain(&corners[..1]);
                let cut = corners.iter().zip(next).flat_map(|(&a, &b)| {
                    fn point_at_height(y: f64, a: Vector2<f64>, b: Vector2<f64>) -> Vector2<f64> {
                        match b.y - a.y {
                            0.0 => a,
                            rise => {
                                a + (b - a) * ((y.clamp(a.y.min(b.y), a.y.max(b.y)) - a.y) / rise)
                            }
                        }
                    }
                    let misses = a.y.max(b.y) < low || high < a.y.min(b.y);
                    let ends = if a.y == b.y {
                        [a, b]
                    } else {
                        [point_at_height(low, a, b), point_at_height(high, a, b)]
                    };
                    ends.into_iter().filter(move |_| !misses)
                });
                let [left, right] = ends(0, &mut cut.into_iter());
                if left <= right {
                    let [first, last] =
                        [left, right + 2.0 * margin].map(|x| block(x, width, self.block));
                    set(bits, first, last - first + 1);
                }
            }
        };
        piece
            .triangles
            .iter()
            .for_each(|triangle| fill(&triangle.map(|it: u32| piece.flat[it as usize] * scale)));
        if piece.triangles.is_empty() {
            fill(&[Vector2::zeros(), piece.size * scale]);
        }
        rows
    }
}

/// Sets `count` bits of a row, from the bit `first` on.
fn set(row: &mut Row, first: usize, count: usize) {
    for (word, bits) in row.iter_mut().enumerate() {
        let [from, to] =
            [first, first + count].map(|it| it.clamp(64 * word, 64 * word + 64) - 64 * word);
        if from < to {
            *bits |= (u64::MAX >> (64 - (to - from))) << from;
        }
    }
}

/// Returns the first index, at least `from`, at which the row has the bit `bit`; the end of the row if there is none.
fn next(row: &Row, from: usize, bit: bool) -> usize {
    let mut place = from;
    while place < PLACES {
        let word = if bit { row[place / 64] } else { !row[place / 64] } >> (place % 64);
        if word != 0 {
            return place + word.trailing_zeros() as usize;
        }
        place = (place / 64 + 1) * 64;
    }
    PLACES
}

/// Returns the length of the longest run of free blocks among the first `blocks`.
fn longest_free(row: &Row, blocks: usize) -> usize {
    let (mut longest, mut place) = (0, 0);
    while place < blocks {
        let start = next(row, place, false).min(blocks);
        place = next(row, start, true).min(blocks);
        longest = longest.max(place - start);
    }
    longest
}

fn runs(rows: &[Row]) -> Vec<Run> {
    let mut runs = Vec::new();
    for (row, bits) in rows.iter().enumerate() {
        let mut start = next(bits, 0, true);
        while start < PLACES {
            let end = next(bits, start, false);
            runs.push([row, start, end - start]);
            start = next(bits, end, true);
        }
    }
    runs
}

/// Returns the runs of a piece that is rotated by `turn` quarters of a full rotation, counter-clockwise.
fn rotate(own: &[Run], [width, height]: [usize; 2], turn: usize) -> Vec<Run> {
    match turn {
        0 => own.to_vec(),
        2 => own
            .iter()
            .map(|[row, first, count]| [height - 1 - row, width - first - count, *count])
            .collect(),
        _ => {
            let mut rows = vec![Row::default(); width];
            for &[row, first, count] in own {
                for column in first..first + count {
                    let [x, y] = if turn == 1 {
                        [height - 1 - row, column]
                    } else {
                        [row, width - 1 - column]
                    };
                    rows[y][x / 64] |= 1 << (x % 64);
                }
            }
            runs(&rows)
        }
    }
}

/// Returns the first of `places` columns at which a piece fits with its lowest row at `row`. All columns are tried at once.
fn free(taken: &[Row], runs: &[Run], row: usize, places: usize) -> Option<usize> {
    let mut free = Row::default();
    set(&mut free, 0, places);
    for &[own, first, count] in runs {
        // Bit `k` is set if a run that starts at block `k` would cover a block that is taken.
        let mut met = taken[row + own];
        let mut done = 1;
        while done < count {
            let step = done.min(count - done);
            let shifted = shift(&met, step);
            met.iter_mut().zip(shifted).for_each(|(met, shifted)| *met |= shifted);
            done += step;
        }
        let met = shift(&met, first);
        free.iter_mut().zip(met).for_each(|(free, met)| *free &= !met);
        if free == Row::default() {
            return None;
        }
    }
    let word = free.iter().position(|&bits| bits != 0)?;
    Some(64 * word + free[word].trailing_zeros() as usize)
}

/// Returns the row with its bits shifted: bit k becomes bit k + `by`.
fn shift(row: &Row, by: usize) -> Row {
    let (words, bits) = (by / 64, by % 64);
    #[inline(always)]
    fn word(k: usize, row: &Row) -> u64 {
        row.get(k).copied().unwrap_or(0)
    }
    std::array::from_fn(|k| match bits {
        0 => word(k + words, row),
        _ => word(k + words, row) >> bits | word(k + words + 1, row) << (64 - bits),
    })
}
