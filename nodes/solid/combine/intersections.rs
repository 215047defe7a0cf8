//! Computes the intersections of the surfaces of two solids.

use std::cmp::Ordering;
use std::ops::Range;

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Bounds, BoxTree, Mesh};
use nalgebra::Point3;
use thiserror::Error;

use super::assembly::{Triangle, triangles};
use super::exact::{Grid, Leading, Site, first_of, height};

/// Number of triangles per parallel task.
const CHUNK: usize = 256;

/// Two solids as one mesh: the vertices and faces of the second follow those of the first.
pub(super) struct Pair<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) triangles: Vec<Triangle>,
    /// The index of the second solid's first triangle, and the index of its first vertex.
    second: (usize, usize),
    sites: Vec<Site>,
    /// Distance in mm below which two points count as one point.
    pub(super) tolerance: f64,
}

/// A point at which an edge of one solid intersects a triangle of the other solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    /// The vertices of the intersected edge, in ascending order of their indices.
    pub(super) edge: [u32; 2],
    pub(super) triangle: u32,
    /// True if a walk along the edge from `edge[0]` to `edge[1]` enters the other solid at this point.
    pub(super) enters: bool,
    /// Position on the edge, as a fraction of the edge's length from `edge[0]`: 0 to 1.
    pub(super) share: f64,
}

/// The line segment in which two triangles cross.
pub(super) struct Segment {
    /// A triangle of the first solid, and one of the second.
    pub(super) triangles: [u32; 2],
    /// The intersection points at the segment's ends. They are ordered such that the part of the first triangle to the left of the segment
    /// is inside of the second solid.
    pub(super) ends: [u32; 2],
}

/// All intersection points of the surfaces of two solids, and the segments between the points.
pub(super) struct Meet {
    /// The intersection points, sorted by edge.
    pub(super) meetings: Vec<Meeting>,
    pub(super) segments: Vec<Segment>,
    /// Indices of the intersection points, grouped by edge, and ordered along each edge.
    along: Vec<u32>,
}

/// Error returned if one of two solids has no well-defined inside around a point.
#[derive(Debug, Error)]
#[error("mesh {solid} has no inside, seen from {at}")]
pub(super) struct NoInsideError {
    /// The index of the solid, 0 or 1.
    pub(super) solid: usize,
    pub(super) at: Point3<f64>,
}

impl<'a> Pair<'a> {
    /// Prepares the intersection of two solids, which are merged in `mesh`. `second` is the number of vertices and of faces of the first
    /// solid. The second solid grows by an infinitesimal amount, or shrinks if `grows` is false; so no faces of both solids are coplanar.
    pub(super) fn new(mesh: &'a Mesh, second: (usize, usize), grows: bool) -> Self {
        let triangles = triangles(mesh);
        let start = triangles.partition_point(|it| (it.face as usize) < second.1);
        let grid =
            Grid::new(mesh.bounds().map_or([Point3::origin(); 2], |(low, high)| [low, high]));
        let sign = if grows { 1.0 } else { -1.0 };
        let normals = mesh.vertex_normals();
        let sites = (0..mesh.positions().len())
            .into_par_iter()
            .map(|vertex: usize| {
                let at = &mesh.positions()[vertex];
                if vertex < second.0 {
                    grid.resting_site(at)
                } else {
                    grid.moving(at, normals[vertex] * sign)
                }
            })
            .collect();
        Self { mesh, triangles, second: (start, second.0), sites, tolerance: grid.tolerance() }
    }

    /// Returns the triangles of one of the solids.
    pub(super) fn triangles_of(&self, solid: usize) -> Range<usize> {
        [0..self.second.0, self.second.0..self.triangles.len()][solid].clone()
    }

    /// Returns the solid, 0 or 1, to which a vertex belongs.
    pub(super) fn solid_of(&self, vertex: u32) -> usize {
        usize::from(self.second.1 <= vertex as usize)
    }

    fn sites_of(&self, triangle: u32) -> [&Site; 3] {
        self.triangles[triangle as usize].vertices.map(|vertex| &self.sites[vertex as usize])
    }

    fn bounds(&self, triangle: u32) -> Bounds {
        Bounds::from_points(&self.sites_of(triangle).map(place))
    }

    /// Computes the intersection points of both surfaces.
    pub(super) fn meet(&self, progress: &Progress<'_>) -> Result<Meet, CancelledError> {
        let all = [0, 1].map(|solid| {
            let triangles = self.triangles_of(solid).into_par_iter().with_min_len(CHUNK);
            let bounds = triangles.map(|it| (it as u32, self.bounds(it as u32)));
            bounds.collect::<Vec<_>>()
        });
        let whole = all.each_ref().map(|own| own.iter().map(|it| it.1).reduce(|a, b| a.join(&b)));
        let [Some(first), Some(second)] = whole else { return Ok(self.collect(&[])) };
        fn overlapping(own: &[(u32, Bounds)], other: &Bounds) -> Vec<(u32, Bounds)> {
            own.iter().filter(|it| it.1.overlaps(other)).copied().collect::<Vec<_>>()
        }
        let [first, second] = [overlapping(&all[0], &second), overlapping(&all[1], &first)];
        progress.tick(0.1)?;
        let boxes = BoxTree::new(second.iter().map(|it| it.1));
        progress.tick(0.2)?;
        let found: Vec<Vec<_>> = first
            .par_chunks(CHUNK)
            .map(|chunk| {
                progress.check()?;
                let mut found = Vec::new();
                for &(triangle, bounds) in chunk {
                    boxes.visit_overlapping(&bounds, |other| {
                        let pair = [triangle, second[other as usize].0];
                        found.extend(self.cross(pair).map(|ends| (pair, ends)));
                    });
                }
                Ok(found)
            })
            .collect::<Result<_, CancelledError>>()?;
        Ok(self.collect(&found.concat()))
    }

    fn collect(&self, found: &[([u32; 2], [Meeting; 2])]) -> Meet {
        fn key(it: &Meeting) -> ([u32; 2], u32) {
            (it.edge, it.triangle)
        }
        let mut meetings: Vec<_> = found.iter().flat_map(|it| it.1).collect();
        meetings.sort_unstable_by_key(key);
        meetings.dedup_by_key(|it| key(it));
        let segments = found.iter().map(|(triangles, ends)| Segment {
            triangles: *triangles,
            ends: ends.each_ref().map(|it| {
                meetings.binary_search_by_key(&key(it), key).expect("all are there") as u32
            }),
        });
        let segments = segments.collect();
        let mut along: Vec<_> = (0..meetings.len() as u32).collect();
        for own in
            along.chunk_by_mut(|&a, &b| meetings[a as usize].edge == meetings[b as usize].edge)
        {
            own.sort_by(|&a, &b| self.order(&meetings[a as usize], &meetings[b as usize]));
        }
        Meet { meetings, segments, along }
    }

    /// Compares the positions of two intersection points of the same edge.
    fn order(&self, a: &Meeting, b: &Meeting) -> Ordering {
        if 1e-12 < (a.share - b.share).abs() {
            return a.share.total_cmp(&b.share);
        }
        let edge = a.edge.map(|vertex| &self.sites[vertex as usize]);
        first_of(edge, [a, b].map(|it| self.sites_of(it.triangle)))
    }

    /// Returns the start and the end of the line in which two triangles cross; `None` if they do not cross.
    fn cross(&self, [a, b]: [u32; 2]) -> Option<[Meeting; 2]> {
        let [first, second] = [a, b].map(|it| self.sites_of(it));
        fn heights(of: [&Site; 3], over: [&Site; 3]) -> [Leading; 3] {
            of.map(|site| height([over[0], over[1], over[2], site]))
        }
        // If all heights are zero, one of the triangles is degenerate. The heights over a degenerate triangle are undefined and do not
        // separate the triangles.
        fn is_apart(heights: &[Leading; 3]) -> bool {
            heights.iter().all(|it| it.is_above() == heights[0].is_above())
                && heights.iter().any(|it| !it.is_zero())
        }
        let above_second = heights(first, second);
        if is_apart(&above_second) {
            return None;
        }
        let above_first = heights(second, first);
        if is_apart(&above_first) {
            return None;
        }
        fn next(k: usize) -> usize {
            (k + 1) % 3
        }
        // `past[k][j]` is true if edge `k` of the first triangle passes above edge `j` of the second one.
        let past = [0, 1, 2].map(|k| {
            [0, 1, 2]
                .map(|j| height([first[k], first[next(k)], second[j], second[next(j)]]).is_above())
        });
        let (mut start, mut end) = (None, None);
        let mut meets = |heights: &[Leading; 3], k: usize, [own, other]: [u32; 2], swap: bool| {
            let [low, high] = [heights[k], heights[next(k)]];
            if low.is_above() == high.is_above() {
                return;
            }
            let vertices = self.triangles[own as usize].vertices;
            let edge = [vertices[k], vertices[next(k)]];
            let (edge, [low_end, high_end]) = match edge[0] < edge[1] {
                true => (edge, [low, high]),
                false => ([edge[1], edge[0]], [high, low]),
            };
            let (enters, share) = (low_end.is_above(), low_end.share(high_end));
            let meeting = Meeting { edge, triangle: other, enters, share };
            let place = if low.is_above() == swap { &mut start } else { &mut end };
            *place = Some(meeting);
        };
        for k in 0..3 {
            if past[k].iter().all(|it| *it == past[k][0]) {
                meets(&above_second, k, [a, b], false);
            }
            if past.iter().all(|of| of[k] == past[0][k]) {
                meets(&above_first, k, [b, a], true);
            }
        }
        start.zip(end).map(|(start, end)| [start, end])
    }

    /// Returns, for each vertex, true if the vertex is inside of the solid to which it does not belong.
    pub(super) fn find_inside(&self, meet: &Meet) -> Result<Vec<bool>, NoInsideError> {
        let mut is_touched = vec![false; self.triangles.len()];
        meet.segments
            .iter()
            .flat_map(|it| it.triangles)
            .for_each(|it| is_touched[it as usize] = true);
        let mut sets = UnionFind::new(self.sites.len());
        for (triangle, &is_touched) in self.triangles.iter().zip(&is_touched).until_stopped() {
            for k in 0..3 {
                let [a, b] = [triangle.vertices[k], triangle.vertices[(k + 1) % 3]];
                if !is_touched || meet.meetings_of_edge([a, b]).is_empty() {
                    sets.union(a, b);
                }
            }
        }
        let mut known = vec![None; self.sites.len()];
        let mut tell = |vertex: u32, is_inside: bool| {
            let own = &mut known[sets.find(vertex) as usize];
            if own.is_some_and(|it| it != is_inside) {
                let at = self.mesh.positions()[vertex as usize];
                return Err(NoInsideError { solid: 1 - self.solid_of(vertex), at });
            }
            *own = Some(is_inside);
            Ok(())
        };
        for own in meet.meetings.chunk_by(|a, b| a.edge == b.edge) {
            let [low, high] = own[0].edge;
            let along = meet.meetings_of_edge([low, high]);
            fn enters(k: u32, meet_meetings: &[Meeting]) -> bool {
                meet_meetings[k as usize].enters
            }
            if along
                .windows(2)
                .any(|it| enters(it[0], &meet.meetings) == enters(it[1], &meet.meetings))
            {
                let at = self.mesh.positions()[low as usize];
                return Err(NoInsideError { solid: 1 - self.solid_of(low), at });
            }
            tell(low, !enters(along[0], &meet.meetings))?;
            tell(high, enters(along[along.len() - 1], &meet.meetings))?;
        }
        // Compute one winding number per connected component. Crossings alone are not enough: a surface that touches itself may intersect
        // itself after the infinitesimal growth.
        let mut parts = UnionFind::new(self.sites.len());
        let mut is_asked = vec![false; self.sites.len()];
        let mut trees = [None, None];
        self.triangles.iter().for_each(|triangle| {
            let [a, b, c] = triangle.vertices;
            parts.union(a, b);
            parts.union(b, c);
        });
        for triangle in self.triangles.iter().until_stopped() {
            let vertex = triangle.vertices[0];
            let (set, part) = (sets.find(vertex) as usize, parts.find(vertex) as usize);
            if known[set].is_some() && is_asked[part] {
                continue;
            }
            is_asked[part] = true;
            let other = 1 - self.solid_of(vertex);
            let triangles = self.triangles_of(other);
            let tree = trees[other].get_or_insert_with(|| {
                BoxTree::new(triangles.clone().map(|it| self.bounds(it as u32)))
            });
            let windings = self.windings(vertex, tree, triangles.start);
            let is_inside = windings == 1;
            if !(0..=1).contains(&windings) || known[set].is_some_and(|it| it != is_inside) {
                let at = self.mesh.positions()[vertex as usize];
                return Err(NoInsideError { solid: other, at });
            }
            known[set] = Some(is_inside);
        }
        Ok((0..self.sites.len() as u32)
            .until_stopped()
            .map(|vertex: u32| known[sets.find(vertex) as usize].unwrap_or(false))
            .collect())
    }

    /// Returns the winding number of the other solid around a vertex: the number of exits minus the number of entries along a ray from the
    /// vertex in the direction of x.
    fn windings(&self, vertex: u32, tree: &BoxTree, first: usize) -> i32 {
        let from = self.sites[vertex as usize];
        let to = from.far(3 << 28);
        let mut windings = 0;
        tree.visit_overlapping(&Bounds::from_points(&[place(&from), place(&to)]), |number| {
            let [a, b, c] = self.sites_of(first as u32 + number);
            let [near, far] = [&from, &to].map(|site| height([a, b, c, site]).is_above());
            if near != far {
                let past = [[a, b], [b, c], [c, a]]
                    .map(|[start, end]| height([&from, &to, start, end]).is_above());
                if past[0] == past[1] && past[1] == past[2] {
                    windings += if far { 1 } else { -1 };
                }
            }
        });
        windings
    }
}

fn place(site: &Site) -> Point3<f64> {
    site.at.map(|cells| cells as f64).into()
}

impl Meet {
    /// Returns the intersection points of an edge, ordered from its vertex with the lower index to the other one.
    pub(super) fn meetings_of_edge(&self, [a, b]: [u32; 2]) -> &[u32] {
        let edge = [a.min(b), a.max(b)];
        let first = self.meetings.partition_point(|it| it.edge < edge);
        let count = self.meetings[first..].iter().take_while(|it| it.edge == edge).count();
        &self.along[first..first + count]
    }
}
