//! Codes elements of whole numbers. Each number is predicted from earlier neighbors, and only the residual (the small difference from the
//! prediction) is coded.

use super::streams::Coder;

/// The kind of neighbors from which an element is predicted. Only neighbors that come before the element are used.
pub(super) enum Layout<'a> {
    /// The neighbors are the previous elements in the list.
    List,
    /// The elements form a grid with rows of this length. The neighbors are the elements at the left and above.
    Grid(usize),
    /// The neighbors are the vertices that share a face with the element.
    Mesh(&'a MeshNeighbors),
}

/// For each vertex, the earlier vertices from which it is predicted: its neighbors in a face, and the opposite vertex in the adjacent face.
pub(super) struct MeshNeighbors {
    /// The index at which the entries of each vertex begin in `corners`.
    starts: Vec<u32>,
    /// Two neighbors of a vertex in a face, and the vertex opposite to them in the adjacent face. The prediction completes the
    /// parallelogram. Without an opposite vertex, the third number is the vertex itself.
    corners: Vec<[u32; 3]>,
}

impl MeshNeighbors {
    /// Finds the neighbors of the vertices of a mesh. Returns `None` if a corner refers to a vertex that does not exist.
    pub(super) fn new(vertices: usize, sides: &[usize], corners: &[u32]) -> Option<Self> {
        if corners.iter().any(|&vertex| vertex as usize >= vertices) {
            return None;
        }
        // For each edge of a triangle, the vertex opposite to it. Sorted by edge.
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
                let (next, before) = (face[(k + 1) % sides], face[(k + sides - 1) % sides]);
                let opposite = if sides > 3 { face[(k + 2) % sides] } else { face[k] };
                around.push((face[k], [before, next, opposite]));
            }
        }
        across.sort_unstable();
        for (vertex, [before, next, opposite]) in &mut around {
            if opposite == vertex {
                // The face on the other side passes the edge in the opposite direction.
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

    fn predictors(&self, vertex: usize) -> &[[u32; 3]] {
        match self.starts.get(vertex..vertex + 2) {
            Some(&[start, end]) => &self.corners[start as usize..end as usize],
            _ => &[],
        }
    }
}

/// The number of formulas by which a number is predicted.
const WAYS: usize = 4;

/// Whole numbers, `width` for each element. An element that is stored to the last bit (an odd element) contains the bits of floating-point
/// numbers instead.
#[derive(Clone, Default)]
pub(super) struct WholeNumbers {
    pub(super) width: usize,
    pub(super) numbers: Vec<i64>,
    /// For each element, true if the element is odd.
    pub(super) odd: Vec<bool>,
}

impl WholeNumbers {
    fn number(&self, element: usize, component: usize) -> Option<i64> {
        let is_whole = !*self.odd.get(element)?;
        is_whole.then(|| self.numbers[element * self.width + component])
    }

    /// Returns a component of an earlier element: the one `back` positions before the next element.
    fn earlier_number(&self, back: usize, component: usize) -> Option<i64> {
        self.number(self.odd.len().checked_sub(back)?, component)
    }

    /// Returns a component of an element, or 0 if it does not exist.
    fn number_or_zero(&self, element: usize, component: usize) -> i64 {
        self.numbers.get(element * self.width + component).copied().unwrap_or(0)
    }

    /// Returns the predictions of each formula for a component of the next element.
    fn guesses(&self, layout: &Layout<'_>, component: usize) -> [Option<i64>; WAYS] {
        let element = self.odd.len();
        let before = self.earlier_number(1, component);
        let second = self.earlier_number(2, component);
        let straight = before.zip(second).map(|(one, two)| one.wrapping_mul(2).wrapping_sub(two));
        match layout {
            Layout::List => [before, straight, None, None],
            Layout::Grid(row) => {
                let left = if element.is_multiple_of(*row) { None } else { before };
                let up = self.earlier_number(*row, component);
                let corner = self.earlier_number(row + 1, component);
                let sum = left.zip(up).map(|(left, up)| left.wrapping_add(up));
                let flat = sum.zip(corner).map(|(sum, corner)| sum.wrapping_sub(corner));
                [left, up, flat, sum.map(|sum| sum >> 1)]
            }
            Layout::Mesh(around) => {
                let (mut near, mut n_near, mut flat, mut n_flat) = (0i64, 0, 0i64, 0);
                for &[one, other, across] in around.predictors(element) {
                    let [one, other, across] = [one, other, across]
                        .map(|vertex: u32| self.number(vertex as usize, component));
                    for x in one.into_iter().chain(other) {
                        near = near.wrapping_add(x);
                        n_near += 1;
                    }
                    if let (Some(one), Some(other), Some(across)) = (one, other, across) {
                        flat = flat.wrapping_add(one.wrapping_add(other).wrapping_sub(across));
                        n_flat += 1;
                    }
                }
                fn mean(sum: i64, n: i64) -> Option<i64> {
                    (n > 0).then(|| sum.wrapping_add(n / 2).div_euclid(n))
                }
                [mean(near, n_near), mean(flat, n_flat), before, straight]
            }
        }
    }
}

/// The stream that has a 1 for each odd element, and a 0 for each other one.
const ODD: usize = 0;

/// The stream of the bits of odd elements.
const BITS: usize = 1;

/// The stream of the residuals of the elements that are not odd.
const RESIDUALS: usize = 2;

/// The stream of the last digits, which are not predicted.
pub(super) const DIGITS: usize = 3;

/// Codes `count` elements. A reader uses only the width of `given`.
pub(super) fn code(
    coder: &mut impl Coder,
    layout: &Layout<'_>,
    count: usize,
    given: &WholeNumbers,
) -> WholeNumbers {
    let width = given.width;
    let mut read = WholeNumbers { width, ..WholeNumbers::default() };
    // For each component, the recent error of each prediction.
    let mut off = vec![[0u64; 2 * WAYS]; width];
    let mut last = vec![0i64; width];
    for element in 0..count {
        let is_odd = given.odd.get(element).copied().unwrap_or(false);
        let is_odd = coder.code(ODD, is_odd.into()) != 0;
        let mut left_before = 0i64;
        let mut numbers = Vec::with_capacity(width);
        for component in 0..width {
            let number = given.number_or_zero(element, component);
            if is_odd {
                numbers.push(coder.code(BITS, number));
                continue;
            }
            let guesses = read.guesses(layout, component);
            // The second half of the predictions adds the error that the same prediction had for the previous component.
            let guess_of = |way: usize| match way {
                way if way < WAYS => guesses[way],
                _ if component == 0 => None,
                way => guesses[way - WAYS].map(|guess| guess.wrapping_add(left_before)),
            };
            let known = (0..2 * WAYS).filter(|&way| guess_of(way).is_some());
            let best = known.min_by_key(|&way| off[component][way]);
            let expected = best.and_then(guess_of).unwrap_or(last[component]);
            let left = coder.code(RESIDUALS, number.wrapping_sub(expected));
            let number = expected.wrapping_add(left);
            for (way, off) in off[component].iter_mut().enumerate() {
                if let Some(guess) = guess_of(way) {
                    let size = number.wrapping_sub(guess).unsigned_abs().min(1 << 50);
                    *off = *off * 15 / 16 + size;
                }
            }
            left_before = number
                .wrapping_sub(best.map_or(expected, |way| guesses[way % WAYS].unwrap_or(expected)));
            last[component] = number;
            numbers.push(number);
        }
        read.numbers.extend(numbers);
        read.odd.push(is_odd);
    }
    read
}
