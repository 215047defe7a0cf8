//! Nested dissection: computes an elimination order of the unknowns. The order is divided into groups (supernodes); the factor's columns of
//! one group have the same pattern of nonzero rows.
//!
//! George, "Nested dissection of a regular finite element mesh" (1973). The separator consists of the middle levels of a breadth-first
//! search.

/// The graph of the unknowns: two unknowns are linked if the matrix has an entry in the row of one and the column of the other. Each link
/// is listed in both directions; an unknown may be listed as its own neighbor.
#[derive(Clone, Copy)]
pub struct Links<'a> {
    /// For each unknown the index in `neighbors` at which its neighbors begin, followed by the length of `neighbors`.
    pub starts: &'a [u32],
    /// The neighbors of all unknowns, one unknown after another.
    pub neighbors: &'a [u32],
}

impl Links<'_> {
    fn neighbors_of(&self, unknown: u32) -> &[u32] {
        let [start, end] = [unknown, unknown + 1].map(|k| self.starts[k as usize] as usize);
        &self.neighbors[start..end]
    }
}

/// An elimination order of the unknowns, divided into groups.
#[derive(Clone, Debug)]
pub struct Dissection {
    /// The unknowns in elimination order.
    pub order: Vec<u32>,
    /// For each group the index in `order` at which it begins, followed by the number of unknowns.
    pub groups: Vec<u32>,
}

/// A part of the unknowns with at most this many members is not divided further. Smaller groups need more lists of rows; larger groups
/// waste more time on zeros. From 8 to 32 the time to factor a plate with 1000 unknowns differs by less than an eighth.
const MAX_LEAF: usize = 24;

impl Dissection {
    /// Orders the unknowns recursively: first the two halves, then the separator between them. The matrix may have entries for pairs of
    /// unknowns that are up to `reach` links apart.
    pub fn new(links: Links<'_>, reach: usize) -> Self {
        let count = links.starts.len() - 1;
        let mut order = vec![0u32; count];
        let mut groups = vec![count as u32];
        let mut search = Search { links, part: vec![0; count], parts: 1 };
        // Each job consists of the unknowns of a part, the end of the part's range in the order, and the number of the part.
        let mut jobs = vec![((0..count as u32).collect::<Vec<u32>>(), count, 0u32)];
        while let Some((members, end, own)) = jobs.pop() {
            if members.is_empty() {
                continue;
            }
            let mut put = |members: &[u32], end: usize| {
                order[end - members.len()..end].copy_from_slice(members);
                groups.push((end - members.len()) as u32);
            };
            if members.len() <= MAX_LEAF {
                put(&members, end);
                continue;
            }
            // Start the breadth-first search from an unknown that is far from the others. This gives many small levels, and thus small
            // separators.
            let (far, _) = search.levels(members[0], own);
            let (reached, levels) = search.levels(far[far.len() - 1], search.parts - 1);
            let rest = if reached.len() < members.len() {
                let part = &search.part;
                members.into_iter().filter(|&k| part[k as usize] == own).collect()
            } else {
                Vec::new()
            };
            jobs.push((rest, end - reached.len(), own));
            if reached.len() <= MAX_LEAF {
                put(&reached, end);
                continue;
            }
            let Some(separator) = middle(&levels, reach) else {
                put_undivided(links, reached, end, &mut put);
                continue;
            };
            let (first, second) = (&reached[..separator.start], &reached[separator.end..]);
            put(&reached[separator.clone()], end);
            let end = end - separator.len();
            for (part, end) in [(first, end - second.len()), (second, end)] {
                let own = search.create_part(part);
                jobs.push((part.to_vec(), end, own));
            }
        }
        groups.sort_unstable();
        Self { order, groups }
    }
}

/// Orders a part whose breadth-first search has too few levels for a separator. A small part becomes one group. A large part becomes groups
/// of one unknown each, those with the fewest links first.
fn put_undivided(
    links: Links<'_>,
    mut members: Vec<u32>,
    end: usize,
    put: &mut impl FnMut(&[u32], usize),
) {
    if members.len() <= 4 * MAX_LEAF {
        return put(&members, end);
    }
    members.sort_by_key(|&k| links.neighbors_of(k).len());
    let begin = end - members.len();
    (begin + 1..).zip(members.chunks(1)).for_each(|(end, member)| put(member, end));
}

/// Returns the range, in the order of the breadth-first search, of the unknowns in the middle levels. These levels separate the earlier
/// levels from the later ones. Returns `None` if there are too few levels. `levels` has the start of each level, followed by the end of the
/// last level.
fn middle(levels: &[usize], reach: usize) -> Option<std::ops::Range<usize>> {
    let count = levels.len() - 1;
    let half = levels[count] / 2;
    let first = (1..count.checked_sub(reach)?)
        .min_by_key(|&k| ((levels[k] + levels[k + reach]) / 2).abs_diff(half))?;
    Some(levels[first]..levels[first + reach])
}

/// Breadth-first search that is restricted to one part of the unknowns.
struct Search<'a> {
    links: Links<'a>,
    /// For each unknown the number of the part to which it belongs.
    part: Vec<u32>,
    parts: u32,
}

impl Search<'_> {
    /// Creates a new part that consists of the unknowns `members`, and returns the number of the part.
    fn create_part(&mut self, members: &[u32]) -> u32 {
        members.iter().for_each(|&k| self.part[k as usize] = self.parts);
        self.parts += 1;
        self.parts - 1
    }

    /// Returns those unknowns of part `own` that are connected to `start`, nearest first. Also returns the start of each level, followed by
    /// the end of the last level. The returned unknowns become a new part.
    fn levels(&mut self, start: u32, own: u32) -> (Vec<u32>, Vec<usize>) {
        let new = self.parts;
        self.parts += 1;
        let mut reached = vec![start];
        let mut levels = vec![0];
        self.part[start as usize] = new;
        let mut next = 0;
        while next < reached.len() {
            let end = reached.len();
            levels.push(end);
            while next < end {
                for &neighbor in self.links.neighbors_of(reached[next]) {
                    if self.part[neighbor as usize] == own {
                        self.part[neighbor as usize] = new;
                        reached.push(neighbor);
                    }
                }
                next += 1;
            }
        }
        (reached, levels)
    }
}
