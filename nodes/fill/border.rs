//! Where a mesh ends: its border, cut into rims that meet no vertex twice.

use maquette::value::{Faces, Mesh};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::patch::{NONE, next, previous};

/// Places where a mesh is no surface, some of them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NotManifold {
    pub(super) edges: Vec<[u32; 2]>,
    pub(super) vertices: Vec<u32>,
}

/// As many places are listed as a message can hold.
const LISTED: usize = 8;

/// The rims of a mesh: closed ways along its border, none of which meets a vertex twice, each beginning at its lowest vertex, in the
/// order of these. A rim runs as the faces do that would fill it: against the faces that are there.
///
/// # Errors
/// If an edge has more than two faces, or two that disagree about their side; or a vertex has separate fans of faces one of which is
/// closed.
pub(super) fn rims(mesh: &Mesh) -> Result<Vec<Vec<u32>>, NotManifold> {
    let count = mesh.positions().len();
    let halves = Halves::new(mesh.faces(), count)?;
    // The rim's edges leave each vertex in a list: those of one vertex hang together.
    let mut newest = vec![NONE; count];
    let mut ways: Vec<Way> = Vec::new();
    for corner in
        (0..halves.twins.len() as u32).filter(|&corner| halves.twins[corner as usize] == NONE)
    {
        let [to, from] =
            [corner, halves.next(corner)].map(|corner| halves.corners[corner as usize]);
        ways.push(Way { to, older: newest[from as usize], used: false });
        newest[from as usize] = ways.len() as u32 - 1;
    }
    halves.check_fans(&newest)?;
    let mut walk = Walk { mesh, newest, ways, places: vec![NONE; count] };
    let mut rims = Vec::new();
    for vertex in 0..count as u32 {
        while let Some(way) = walk.any(vertex) {
            walk.follow(vertex, way, &mut rims);
        }
    }
    rims.iter_mut().for_each(|rim: &mut Vec<u32>| {
        let lowest = (0..rim.len()).min_by_key(|&k| rim[k]).unwrap_or(0);
        rim.rotate_left(lowest);
    });
    rims.sort();
    Ok(rims)
}

/// What lies next to what: a half-edge is that from a corner to the next one of its face.
struct Halves<'a> {
    corners: &'a [u32],
    /// The corner after each and the one before, where faces are no triangles.
    beside: Option<Vec<[u32; 2]>>,
    /// The half-edge on the other side of each; [`NONE`] at the border.
    twins: Vec<u32>,
}

/// Corners that one task looks at.
const BLOCK: usize = 8192;

impl<'a> Halves<'a> {
    fn new(faces: &'a Faces, count: usize) -> Result<Self, NotManifold> {
        let corners: &[u32] = faces.corners();
        let beside = (faces.sides() != Some(3)).then(|| {
            let mut beside = Vec::with_capacity(corners.len());
            let mut first = 0;
            for sides in faces.iter().map(|face| face.len() as u32) {
                let place = |k: u32| first + k % sides;
                beside.extend((0..sides).map(|k| [place(k + 1), place(k + sides - 1)]));
                first += sides;
            }
            beside
        });
        let mut halves = Self { corners, beside, twins: Vec::new() };
        // Of each vertex the half-edges that leave it, by their ends.
        let mut starts = vec![0u32; count + 1];
        corners.iter().for_each(|&from| starts[from as usize + 1] += 1);
        for vertex in 0..count {
            starts[vertex + 1] += starts[vertex];
        }
        let mut ends = starts.clone();
        let mut leaving = vec![[0u32; 2]; corners.len()];
        for (corner, &from) in (0u32..).zip(corners) {
            let end = &mut ends[from as usize];
            leaving[*end as usize] = [corners[halves.next(corner) as usize], corner];
            *end += 1;
        }
        let mut bad: Vec<[u32; 2]> = Vec::new();
        for vertex in 0..count {
            let own = &mut leaving[starts[vertex] as usize..starts[vertex + 1] as usize];
            own.sort_unstable();
            let twice = own.windows(2).filter(|pair| pair[0][0] == pair[1][0]);
            bad.extend(
                twice.map(|pair| [pair[0][0].min(vertex as u32), pair[0][0].max(vertex as u32)]),
            );
        }
        if !bad.is_empty() {
            bad.sort_unstable();
            bad.dedup();
            bad.truncate(LISTED);
            return Err(NotManifold { edges: bad, vertices: Vec::new() });
        }
        let twin = |corner: u32| {
            let [from, to] = [corner, halves.next(corner)].map(|corner| corners[corner as usize]);
            let other = &leaving[starts[to as usize] as usize..starts[to as usize + 1] as usize];
            other.binary_search_by_key(&from, |half| half[0]).map_or(NONE, |place| other[place][1])
        };
        let all = (0..corners.len() as u32).into_par_iter().with_min_len(BLOCK);
        halves.twins = all.map(twin).collect();
        Ok(halves)
    }

    fn next(&self, corner: u32) -> u32 {
        match &self.beside {
            Some(beside) => beside[corner as usize][0],
            None => next(corner),
        }
    }

    fn previous(&self, corner: u32) -> u32 {
        match &self.beside {
            Some(beside) => beside[corner as usize][1],
            None => previous(corner),
        }
    }

    /// Finds vertices with several fans of faces one of which goes all around: no way of filling makes a surface of them.
    ///
    /// `newest` is [`NONE`] for vertices that are not on the border.
    fn check_fans(&self, newest: &[u32]) -> Result<(), NotManifold> {
        let mut met = vec![false; self.corners.len()];
        let mut meet_fan = |start: u32| {
            let mut corner = start;
            while corner != NONE && !std::mem::replace(&mut met[corner as usize], true) {
                // Over the edge that leaves the vertex at this corner, into the other face there.
                let twin = self.twins[corner as usize];
                corner = if twin == NONE { NONE } else { self.next(twin) };
            }
        };
        let all = 0..self.corners.len() as u32;
        let is_first = |&corner: &u32| self.twins[self.previous(corner) as usize] == NONE;
        all.clone().filter(is_first).for_each(&mut meet_fan);
        let mut closed = vec![false; newest.len()];
        let mut bad = Vec::new();
        for corner in all {
            if met[corner as usize] {
                continue;
            }
            let vertex = self.corners[corner as usize];
            if newest[vertex as usize] != NONE
                || std::mem::replace(&mut closed[vertex as usize], true)
            {
                bad.push(vertex);
            }
            let mut at = corner;
            while !std::mem::replace(&mut met[at as usize], true) {
                at = self.next(self.twins[at as usize]);
            }
        }
        if bad.is_empty() {
            return Ok(());
        }
        bad.sort_unstable();
        bad.dedup();
        bad.truncate(LISTED);
        Err(NotManifold { edges: Vec::new(), vertices: bad })
    }
}

/// A border edge, from the vertex in whose list it is.
struct Way {
    to: u32,
    /// The next in the list of the same vertex.
    older: u32,
    used: bool,
}

struct Walk<'a> {
    mesh: &'a Mesh,
    newest: Vec<u32>,
    ways: Vec<Way>,
    /// The place of each vertex on the path walked so far.
    places: Vec<u32>,
}

impl Walk<'_> {
    fn unused(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let mut way = self.newest[vertex as usize];
        std::iter::from_fn(move || {
            while way != NONE {
                let this = way;
                way = self.ways[way as usize].older;
                if !self.ways[this as usize].used {
                    return Some(this);
                }
            }
            None
        })
    }

    fn any(&self, vertex: u32) -> Option<u32> {
        self.unused(vertex).last()
    }

    /// Walks along the border from a vertex until it is back; whenever it meets a vertex again, the way since then is a rim.
    fn follow(&mut self, start: u32, first: u32, rims: &mut Vec<Vec<u32>>) {
        let mut path = vec![start];
        self.places[start as usize] = 0;
        let mut way = first;
        loop {
            self.ways[way as usize].used = true;
            let (from, at) = (path[path.len() - 1], self.ways[way as usize].to);
            let place = self.places[at as usize];
            if place != NONE {
                let rim = path.split_off(place as usize);
                rim.iter().for_each(|&vertex| self.places[vertex as usize] = NONE);
                rims.push(rim);
                if place == 0 {
                    return;
                }
            }
            self.places[at as usize] = path.len() as u32;
            path.push(at);
            let Some(next) = self.onwards(from, at) else { return };
            way = next;
        }
    }

    /// The way on at a vertex. Where several parts of the mesh touch, each gap between them is a hole of its own: the way on is the
    /// one that lies nearest.
    fn onwards(&self, from: u32, at: u32) -> Option<u32> {
        let mut ways = self.unused(at);
        let first = ways.next()?;
        let Some(second) = ways.next() else { return Some(first) };
        let place = |vertex: u32| self.mesh.positions()[vertex as usize];
        let back = (place(from) - place(at)).normalize();
        let fits = |way: u32| {
            let ahead = (place(self.ways[way as usize].to) - place(at)).normalize();
            let same_part = self.is_same_part(from, at, self.ways[way as usize].to);
            (u8::from(!same_part), ahead.dot(&back))
        };
        let mut best = (fits(first), first);
        for way in std::iter::once(second).chain(ways) {
            let fit = fits(way);
            if fit.0 > best.0.0 || (fit.0 == best.0.0 && fit.1 > best.0.1) {
                best = (fit, way);
            }
        }
        Some(best.1)
    }

    /// Whether the border edges from `from` to `at` and on to `to` are the two sides of one fan of faces around `at`.
    fn is_same_part(&self, from: u32, at: u32, to: u32) -> bool {
        // The edge of the fan that the walk came along, turned from face to face until there is none.
        let faces: Vec<[u32; 2]> = spokes(self.mesh.faces(), at);
        let mut end = from;
        while let Some(&[_, next]) = faces.iter().find(|[first, _]| *first == end) {
            end = next;
            if end == from {
                return false;
            }
        }
        let mut begin = from;
        while let Some(&[next, _]) = faces.iter().find(|[_, last]| *last == begin) {
            begin = next;
            if begin == from {
                return false;
            }
        }
        end == to || begin == to
    }
}

/// Of each face around a vertex the corner after it and the one before.
fn spokes(faces: &Faces, vertex: u32) -> Vec<[u32; 2]> {
    let around = faces.iter().filter_map(|face| {
        let place = face.iter().position(|&corner| corner == vertex)?;
        Some([face[(place + 1) % face.len()], face[(place + face.len() - 1) % face.len()]])
    });
    around.collect()
}

/// Half the sum of the cross products along a closed way: the area that it encloses, seen from where it is most.
pub(super) fn enclosed(mesh: &Mesh, rim: &[u32]) -> Vector3<f64> {
    let place = |vertex: u32| mesh.positions()[vertex as usize];
    let Some(&first) = rim.first() else { return Vector3::zeros() };
    let origin = place(first);
    rim.windows(2)
        .map(|pair| (place(pair[0]) - origin).cross(&(place(pair[1]) - origin)) / 2.0)
        .sum()
}
