//! The order in which the unknowns of equations are eliminated, in groups (supernodes) whose columns in the factor have the same pattern.
//!
//! George, "Nested dissection of a regular finite element mesh" (1973), with the middle levels of a breadth-first search as separator.

/// Which unknowns are linked: both directions given, an unknown may be its own neighbor.
#[derive(Clone, Copy)]
pub struct Links<'a> {
    /// Where the neighbors of each unknown begin, with the end behind the last.
    pub starts: &'a [u32],
    /// The neighbors of one unknown after those of another.
    pub neighbors: &'a [u32],
}

impl Links<'_> {
    fn of(&self, unknown: u32) -> &[u32] {
        let [start, end] = [unknown, unknown + 1].map(|k| self.starts[k as usize] as usize);
        &self.neighbors[start..end]
    }
}

/// Unknowns in the order of their elimination, cut into groups.
#[derive(Clone, Debug)]
pub struct Dissection {
    /// The unknowns, the first to be eliminated first.
    pub order: Vec<u32>,
    /// Where each group begins in the order, with the end behind the last.
    pub groups: Vec<u32>,
}

/// Parts of at most so many unknowns are not divided further. Smaller groups cost lists of rows, larger ones zeros that are computed with;
/// from 8 to 32 the factors of a plate with 1000 unknowns take the same time within an eighth.
const SMALL: usize = 24;

impl Dissection {
    /// Two halves, each ordered alike, and then what separates them. Equations may link unknowns that are `reach` links apart.
    pub fn new(links: Links<'_>, reach: usize) -> Self {
        let count = links.starts.len() - 1;
        let mut order = vec![0u32; count];
        let mut groups = vec![count as u32];
        let mut search = Search { links, part: vec![0; count], parts: 1 };
        // Each job is a part of the unknowns and where it ends in the order.
        let mut jobs = vec![((0..count as u32).collect::<Vec<u32>>(), count, 0u32)];
        while let Some((members, end, own)) = jobs.pop() {
            if members.is_empty() {
                continue;
            }
            let mut put = |members: &[u32], end: usize| {
                order[end - members.len()..end].copy_from_slice(members);
                groups.push((end - members.len()) as u32);
            };
            if members.len() <= SMALL {
                put(&members, end);
                continue;
            }
            // From far out, so that levels are many and small.
            let (far, _) = search.levels(members[0], own);
            let (reached, levels) = search.levels(far[far.len() - 1], search.parts - 1);
            let rest = if reached.len() < members.len() {
                let part = &search.part;
                members.into_iter().filter(|&k| part[k as usize] == own).collect()
            } else {
                Vec::new()
            };
            jobs.push((rest, end - reached.len(), own));
            if reached.len() <= SMALL {
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
                let own = search.name(part);
                jobs.push((part.to_vec(), end, own));
            }
        }
        groups.sort_unstable();
        Self { order, groups }
    }
}

/// Orders unknowns that no level divides: few as one group, many one by one, those with the fewest links first.
fn put_undivided(
    links: Links<'_>,
    mut members: Vec<u32>,
    end: usize,
    put: &mut impl FnMut(&[u32], usize),
) {
    if members.len() <= 4 * SMALL {
        return put(&members, end);
    }
    members.sort_by_key(|&k| links.of(k).len());
    let begin = end - members.len();
    (begin + 1..).zip(members.chunks(1)).for_each(|(end, member)| put(member, end));
}

/// The levels in the middle that separate those before from those behind; none if there are too few. `levels` are their beginnings and
/// the end of the last.
fn middle(levels: &[usize], reach: usize) -> Option<std::ops::Range<usize>> {
    let count = levels.len() - 1;
    let half = levels[count] / 2;
    let first = (1..count.checked_sub(reach)?)
        .min_by_key(|&k| ((levels[k] + levels[k + reach]) / 2).abs_diff(half))?;
    Some(levels[first]..levels[first + reach])
}

/// Breadth-first searches within parts of the unknowns.
struct Search<'a> {
    links: Links<'a>,
    /// The number of the part of each unknown.
    part: Vec<u32>,
    parts: u32,
}

impl Search<'_> {
    /// Makes these a part of their own.
    fn name(&mut self, members: &[u32]) -> u32 {
        members.iter().for_each(|&k| self.part[k as usize] = self.parts);
        self.parts += 1;
        self.parts - 1
    }

    /// What can be reached within a part, nearest first, and where each level begins, with the end behind the last. What is reached
    /// becomes a new part.
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
                for &neighbor in self.links.of(reached[next]) {
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
