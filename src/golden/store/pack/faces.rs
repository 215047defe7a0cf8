//! Codes the corners of faces. The vertex at each corner is coded by its rank in a list of likely vertices (candidates).
//!
//! Two faces that share an edge pass it in opposite directions. So after a vertex `v`, a face mostly continues to the start of an edge that
//! ends at `v` and that only one face has passed so far (an open edge). Gumhold and Strasser, "Real time compression of triangle mesh
//! connectivity" (1998), grow a region in this way. Here the faces keep their order.

use super::streams::Coder;

/// The maximum number of candidates (likely vertices) for a corner.
const MAX_CANDIDATES: usize = 12;

/// The maximum number of open edges that are stored for a vertex.
const MAX_OPEN_EDGES: usize = 8;

/// The stream of the ranks of all vertices. The rank of an unlikely vertex is `MAX_CANDIDATES`.
const RANKS: usize = 0;

/// The stream of the unlikely vertices, as differences from the vertex of the same corner in the previous face.
const RESIDUALS: usize = 1;

/// The likely vertices of a corner, with the likeliest first. Each occurs once.
#[derive(Default)]
struct Candidates {
    vertices: [u32; MAX_CANDIDATES],
    count: usize,
}

impl Candidates {
    fn add(&mut self, vertex: i64) {
        let Ok(vertex) = u32::try_from(vertex) else { return };
        if self.count < MAX_CANDIDATES && !self.vertices[..self.count].contains(&vertex) {
            self.vertices[self.count] = vertex;
            self.count += 1;
        }
    }
}

/// The open edges: for each vertex, the start vertices of the open edges that end at the vertex. The latest edge is the last item.
#[derive(Default)]
struct OpenEdges(Vec<Vec<u32>>);

impl OpenEdges {
    fn starts_of(&self, vertex: u32) -> &[u32] {
        self.0.get(vertex as usize).map_or(&[], |open| open)
    }

    fn insert(&mut self, from: u32, to: u32) {
        // Ignore vertices with huge indices, for which much memory would be allocated. Only a damaged file contains them.
        if to as usize >= self.0.len() + (1 << 20) {
            return;
        }
        if to as usize >= self.0.len() {
            self.0.resize(to as usize + 1, Vec::new());
        }
        let open = &mut self.0[to as usize];
        if open.len() == MAX_OPEN_EDGES {
            open.remove(0);
        }
        open.push(from);
    }

    /// Removes the open edge from `from` to `to`. Returns true if there was such an edge.
    fn take(&mut self, from: u32, to: u32) -> bool {
        let Some(open) = self.0.get_mut(to as usize) else { return false };
        let found = open.iter().rposition(|&other| other == from);
        found.map(|place| open.remove(place)).is_some()
    }
}

/// Codes the corners of faces. `sides` contains the number of corners of each face. For reading, `corners` is empty.
pub(super) fn code(coder: &mut impl Coder, sides: &[usize], corners: &[u32]) -> Option<Vec<u32>> {
    let mut read: Vec<u32> = Vec::new();
    // The open edges by their end vertex, and the same edges by their start vertex.
    let (mut to, mut from) = (OpenEdges::default(), OpenEdges::default());
    let mut next = 0u32;
    for &sides in sides {
        let start = read.len();
        let before = start.saturating_sub(sides);
        for corner in 0..sides {
            let likely = likely(&read, start, sides, corner, [&to, &from], next);
            let place = read.len();
            let wanted = corners.get(place).copied().unwrap_or(0);
            let known = &likely.vertices[..likely.count];
            let rank = known.iter().position(|&vertex| vertex == wanted).unwrap_or(MAX_CANDIDATES);
            let rank = coder.code(RANKS, rank as i64);
            let vertex = match usize::try_from(rank).ok().and_then(|rank| known.get(rank)) {
                Some(&vertex) => vertex,
                None => {
                    let near = read.get(before + corner).copied().unwrap_or(0);
                    let by = coder.code(RESIDUALS, i64::from(wanted) - i64::from(near));
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
    [to, from]: [&OpenEdges; 2],
    next: u32,
) -> Candidates {
    let mut likely = Candidates::default();
    let earlier_corner = |faces: usize, corner: usize| {
        let place = (start + corner).checked_sub(faces * sides)?;
        read.get(place).map(|&vertex| i64::from(vertex))
    };
    if corner > 0 {
        let here = read[start + corner - 1];
        let starting_here: &[u32] =
            if corner + 1 == sides { from.starts_of(read[start]) } else { &[] };
        let both = to.starts_of(here).iter().rev().filter(|vertex| starting_here.contains(vertex));
        both.for_each(|&vertex| likely.add(vertex.into()));
        to.starts_of(here).iter().rev().take(3).for_each(|&vertex| likely.add(vertex.into()));
        starting_here.iter().rev().take(2).for_each(|&vertex| likely.add(vertex.into()));
    }
    likely.add(next.into());
    for faces in [2, 1, 4] {
        earlier_corner(faces, corner).into_iter().for_each(|vertex| likely.add(vertex + 1));
    }
    for other in (0..sides).rev() {
        earlier_corner(1, other).into_iter().for_each(|vertex| likely.add(vertex));
    }
    earlier_corner(4, corner).into_iter().for_each(|vertex| likely.add(vertex));
    likely
}
