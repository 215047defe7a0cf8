//! The corners of faces: each is coded by its rank among the vertices that are likely there.
//!
//! Where two faces meet at an edge, one of them runs through it in the other direction. So what follows a vertex in a face is
//! mostly the start of an edge towards it that had no partner yet. Gumhold and Strasser, "Real time compression of triangle mesh
//! connectivity" (1998), grow a region by this; here the faces keep their order.

use super::coder::{Bit, Coder, EVEN, Numbers};

/// How many likely vertices are tried.
const LIKELY: usize = 12;

/// Edges of a vertex that are remembered as long as they have no partner.
const OPEN: usize = 8;

/// Vertices that are likely at a corner, each once, the likeliest first.
#[derive(Default)]
struct Likely {
    vertices: [u32; LIKELY],
    count: usize,
}

impl Likely {
    fn add(&mut self, vertex: i64) {
        let Ok(vertex) = u32::try_from(vertex) else { return };
        if self.count < LIKELY && !self.vertices[..self.count].contains(&vertex) {
            self.vertices[self.count] = vertex;
            self.count += 1;
        }
    }
}

/// Edges without a partner: for each vertex, where those that end there begin, the latest last.
#[derive(Default)]
struct Open(Vec<Vec<u32>>);

impl Open {
    fn of(&self, vertex: u32) -> &[u32] {
        self.0.get(vertex as usize).map_or(&[], |open| open)
    }

    fn insert(&mut self, from: u32, to: u32) {
        // A damaged file names vertices that are not there; they are not worth the memory.
        if to as usize >= self.0.len() + (1 << 20) {
            return;
        }
        if to as usize >= self.0.len() {
            self.0.resize(to as usize + 1, Vec::new());
        }
        let open = &mut self.0[to as usize];
        if open.len() == OPEN {
            open.remove(0);
        }
        open.push(from);
    }

    /// Whether the edge was there; it is no more.
    fn take(&mut self, from: u32, to: u32) -> bool {
        let Some(open) = self.0.get_mut(to as usize) else { return false };
        let found = open.iter().rposition(|&other| other == from);
        found.map(|place| open.remove(place)).is_some()
    }
}

/// Codes the corners of faces with so many sides each. When they are read, only the number of the given ones counts.
pub(super) fn code(coder: &mut impl Coder, sides: &[usize], corners: &[u32]) -> Option<Vec<u32>> {
    let mut read: Vec<u32> = Vec::new();
    // Edges towards a vertex and away from it.
    let (mut to, mut from) = (Open::default(), Open::default());
    let mut ranks = vec![[EVEN; LIKELY + 1]; 4 * (LIKELY + 2)];
    let mut far = Numbers::new();
    let mut last_ranks = [0; 4];
    let mut next = 0u32;
    for &sides in sides {
        let start = read.len();
        let before = start.saturating_sub(sides);
        for corner in 0..sides {
            let likely = likely(&read, start, sides, corner, [&to, &from], next);
            let place = read.len();
            let wanted = corners.get(place).copied().unwrap_or(0);
            let known = &likely.vertices[..likely.count];
            let kind = corner.min(3);
            let bits: &mut [Bit; LIKELY + 1] = &mut ranks[kind * (LIKELY + 2) + last_ranks[kind]];
            let rank = known.iter().position(|&vertex| vertex == wanted).unwrap_or(known.len());
            let mut found = 0;
            while found < known.len() && coder.bit(&mut bits[found], rank > found) {
                found += 1;
            }
            last_ranks[kind] = found + usize::from(found == known.len());
            let vertex = match known.get(found) {
                Some(&vertex) => vertex,
                None => {
                    let near = read.get(before + corner).copied().unwrap_or(0);
                    let by = far.code(coder, i64::from(wanted) - i64::from(near));
                    u32::try_from(i64::from(near).checked_add(by)?).ok()?
                }
            };
            next = next.max(vertex.saturating_add(1));
            read.push(vertex);
        }
        for corner in 0..sides {
            let [a, b] = [read[start + corner], read[start + (corner + 1) % sides]];
            if to.take(b, a) {
                from.take(a, b);
            } else {
                to.insert(a, b);
                from.insert(b, a);
            }
        }
    }
    Some(read)
}

fn likely(
    read: &[u32],
    start: usize,
    sides: usize,
    corner: usize,
    [to, from]: [&Open; 2],
    next: u32,
) -> Likely {
    let mut likely = Likely::default();
    let earlier = |faces: usize, corner: usize| {
        let place = (start + corner).checked_sub(faces * sides)?;
        read.get(place).map(|&vertex| i64::from(vertex))
    };
    if corner > 0 {
        let here = read[start + corner - 1];
        let begun: &[u32] = if corner + 1 == sides { from.of(read[start]) } else { &[] };
        let both = to.of(here).iter().rev().filter(|vertex| begun.contains(vertex));
        both.for_each(|&vertex| likely.add(vertex.into()));
        to.of(here).iter().rev().take(3).for_each(|&vertex| likely.add(vertex.into()));
        begun.iter().rev().take(2).for_each(|&vertex| likely.add(vertex.into()));
    }
    likely.add(next.into());
    for faces in [2, 1, 4] {
        earlier(faces, corner).into_iter().for_each(|vertex| likely.add(vertex + 1));
    }
    for other in (0..sides).rev() {
        earlier(1, other).into_iter().for_each(|vertex| likely.add(vertex));
    }
    earlier(4, corner).into_iter().for_each(|vertex| likely.add(vertex));
    likely
}
