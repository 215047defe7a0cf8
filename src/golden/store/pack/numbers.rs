//! Whole numbers for each element: each is predicted from its neighbors, and the small residual is coded.

use super::coder::{Bit, Coder, EVEN, Numbers, length};

/// The elements around one, of which some come before it.
pub(super) enum Layout<'a> {
    /// Those before it in the list.
    List,
    /// Those to the left and above, in rows of so many.
    Grid(usize),
    /// The vertices that share a face.
    Mesh(&'a MeshNeighbors),
}

/// For each vertex the earlier vertices that predict it: neighbors, and corners of parallelograms of which it is the fourth.
pub(super) struct MeshNeighbors {
    /// Where those of a vertex begin.
    starts: Vec<u32>,
    /// Two neighbors in a face, and the vertex across; itself if none is known.
    corners: Vec<[u32; 3]>,
}

impl MeshNeighbors {
    /// None if a corner is no vertex.
    pub(super) fn new(vertices: usize, sides: &[usize], corners: &[u32]) -> Option<Self> {
        if corners.iter().any(|&vertex| vertex as usize >= vertices) {
            return None;
        }
        // What lies opposite of each edge of a triangle, sorted by the edge.
        let mut across: Vec<([u32; 2], u32)> = Vec::new();
        let mut around: Vec<(u32, [u32; 3])> = Vec::with_capacity(corners.len());
        let mut rest = corners;
        for &sides in sides {
            let (face, others) = rest.split_at_checked(sides)?;
            rest = others;
            if let &[a, b, c] = face {
                across.extend([([a, b], c), ([b, c], a), ([c, a], b)]);
            }
            for k in 0..sides {
                let at = |ahead: usize| face[(k + ahead) % sides];
                let (next, before) = (at(1), at(sides - 1));
                let opposite = if sides > 3 { at(2) } else { face[k] };
                around.push((face[k], [before, next, opposite]));
            }
        }
        across.sort_unstable();
        for (vertex, [before, next, opposite]) in &mut around {
            if opposite == vertex {
                // The face on the other side runs through the edge in the other direction.
                let edge = [*before, *next];
                let found = across.binary_search_by_key(&edge, |(edge, _)| *edge);
                *opposite = found.map_or(*vertex, |place| across[place].1);
            }
        }
        around.sort_by_key(|(vertex, _)| *vertex);
        let mut starts = vec![0; vertices + 1];
        around.iter().for_each(|(vertex, _)| starts[*vertex as usize + 1] += 1);
        for vertex in 0..vertices {
            starts[vertex + 1] += starts[vertex];
        }
        Some(Self { starts, corners: around.into_iter().map(|(_, corners)| corners).collect() })
    }

    fn of(&self, vertex: usize) -> &[[u32; 3]] {
        match self.starts.get(vertex..vertex + 2) {
            Some(&[start, end]) => &self.corners[start as usize..end as usize],
            _ => &[],
        }
    }
}

/// Ways to foretell a number.
const WAYS: usize = 4;

/// Whole numbers, `width` for each element; some elements have others.
#[derive(Clone, Default)]
pub(super) struct Whole {
    pub(super) width: usize,
    pub(super) numbers: Vec<i64>,
    /// Elements that are not whole numbers; theirs are the bits of what they are.
    pub(super) odd: Vec<bool>,
}

impl Whole {
    fn at(&self, element: usize, component: usize) -> Option<i64> {
        let is_whole = !*self.odd.get(element)?;
        is_whole.then(|| self.numbers[element * self.width + component])
    }

    /// What is likely at the place of the next element.
    fn guesses(&self, layout: &Layout<'_>, component: usize) -> [Option<i64>; WAYS] {
        let element = self.odd.len();
        let at = |back: usize| self.at(element.checked_sub(back)?, component);
        let before = at(1);
        let straight = before.zip(at(2)).map(|(one, two)| one.wrapping_mul(2).wrapping_sub(two));
        match layout {
            Layout::List => [before, straight, None, None],
            Layout::Grid(row) => {
                let left = if element.is_multiple_of(*row) { None } else { before };
                let (up, corner) = (at(*row), at(row + 1));
                let sum = left.zip(up).map(|(left, up)| left.wrapping_add(up));
                let flat = sum.zip(corner).map(|(sum, corner)| sum.wrapping_sub(corner));
                [left, up, flat, sum.map(|sum| sum >> 1)]
            }
            Layout::Mesh(around) => {
                let (mut near, mut n_near, mut flat, mut n_flat) = (0i64, 0, 0i64, 0);
                for &[one, other, across] in around.of(element) {
                    let [one, other, across] =
                        [one, other, across].map(|vertex: u32| self.at(vertex as usize, component));
                    for x in one.into_iter().chain(other) {
                        near = near.wrapping_add(x);
                        n_near += 1;
                    }
                    if let (Some(one), Some(other), Some(across)) = (one, other, across) {
                        flat = flat.wrapping_add(one.wrapping_add(other).wrapping_sub(across));
                        n_flat += 1;
                    }
                }
                let mean =
                    |sum: i64, n: i64| (n > 0).then(|| sum.wrapping_add(n / 2).div_euclid(n));
                [mean(near, n_near), mean(flat, n_flat), before, straight]
            }
        }
    }
}

/// Codes so many elements. When they are read, only the width of the given ones counts.
pub(super) fn code(
    coder: &mut impl Coder,
    layout: &Layout<'_>,
    count: usize,
    given: &Whole,
) -> Whole {
    const LEVELS: usize = 24;
    let width = given.width;
    let mut read = Whole { width, ..Whole::default() };
    let mut odd_bits = [EVEN; 4];
    let mut unknown_bit: Bit = EVEN;
    let mut tables: Vec<Numbers> = (0..2 * LEVELS).map(|_| Numbers::new()).collect();
    // By component: how far each way was off lately, and how long what was left was, in sixteenths.
    let mut off = vec![[0u64; 2 * WAYS]; width];
    let mut lengths = vec![0usize; width];
    let mut last = vec![0i64; width];
    for element in 0..count {
        let is_grid = if let Layout::Grid(row) = layout { *row } else { 1 };
        fn odd(back: usize, element: usize, read_odd: &[bool]) -> bool {
            element.checked_sub(back).is_some_and(|other| read_odd[other])
        }
        let context = usize::from(odd(1, element, &read.odd))
            + 2 * usize::from(odd(is_grid, element, &read.odd));
        let is_odd = given.odd.get(element).copied().unwrap_or(false);
        let is_odd = coder.bit(&mut odd_bits[context], is_odd);
        let number = |component: usize| given.numbers.get(element * width + component);
        if is_odd {
            for component in 0..width {
                let bits = number(component).copied().unwrap_or(0) as u64;
                let unknown = f64::NAN.to_bits();
                let is_unknown = coder.bit(&mut unknown_bit, bits == unknown);
                let bits = if is_unknown { unknown } else { coder.plain(64, bits) };
                read.numbers.push(bits as i64);
            }
            read.odd.push(true);
            continue;
        }
        let (mut left_before, mut length_before) = (0i64, 0);
        let mut whole = Vec::with_capacity(width);
        for component in 0..width {
            let guesses = read.guesses(layout, component);
            let number = number(component).copied().unwrap_or(0);
            // The second half of the ways: what was wrong with the component before is wrong with this one, too.
            let guess = |way: usize| match way {
                way if way < WAYS => guesses[way],
                _ if component == 0 => None,
                way => guesses[way - WAYS].map(|guess| guess.wrapping_add(left_before)),
            };
            let known = (0..2 * WAYS).filter(|&way| guess(way).is_some());
            let best = known.min_by_key(|&way| off[component][way]);
            let expected = best.and_then(guess).unwrap_or(last[component]);
            let level = match component {
                0 => lengths[0] / 8,
                _ => lengths[component] / 16 + length_before,
            };
            let table = level.min(LEVELS - 1) + LEVELS * usize::from(component > 0);
            let left = tables[table].code(coder, number.wrapping_sub(expected));
            let number = expected.wrapping_add(left);
            for (way, off) in off[component].iter_mut().enumerate() {
                if let Some(guess) = guess(way) {
                    let size = number.wrapping_sub(guess).unsigned_abs().min(1 << 50);
                    *off = *off * 15 / 16 + size;
                }
            }
            length_before = length(left.unsigned_abs());
            lengths[component] = (lengths[component] * 3 + 16 * length_before) / 4;
            left_before = number
                .wrapping_sub(best.map_or(expected, |way| guesses[way % WAYS].unwrap_or(expected)));
            last[component] = number;
            whole.push(number);
        }
        read.numbers.extend(whole);
        read.odd.push(false);
    }
    read
}
