//! Removes intersections of a fill by a few edge flips and collapses, and leaves the rest as it is.
//!
//! Around points that coincide, or nearly so, triangles fold however smooth a surface is. There an edge is flipped or collapsed wherever
//! that leaves fewer intersecting triangles.

use std::cell::Cell;
use std::collections::VecDeque;
use std::ops::Range;

use super::boxes::{Boxes, Triangle};
use super::detect::{Intersections, intersect};
use crate::border::rim::Rim;
use crate::triangles::triangulation::{NONE, Triangulation, previous};

/// As many changes are made at most: what intersects in more places needs another surface altogether.
const MOST_CHANGES: usize = 100;

/// The repair gives up after so many faces for which no change helps: they are where a whole region intersects something.
const MOST_HOPELESS: usize = 30;

/// As many pairs of triangles are compared at most: some tenths of a second. Where each triangle lies near all others, no small change
/// helps.
const MOST_COMPARISONS: usize = 100_000;

/// A triangle that intersects more others than these is not merely folded, and no small change helps.
const MOST_MET: usize = 20;

/// What the fill of a hole must not intersect: the data, and the fills of the other holes.
pub(crate) struct Obstacles<'a> {
    pub(crate) intersections: &'a Intersections,
    /// The faces that fill this hole so far, which do not count.
    pub(crate) own: Range<u32>,
    pub(crate) rim: &'a Rim,
}

/// Flips and collapses edges as long as that leaves fewer triangles that intersect each other or the obstacles.
pub(crate) fn repair(triangulation: &mut Triangulation, obstacles: &Obstacles<'_>) {
    let faces = 0..triangulation.corners.len() as u32 / 3;
    let triangles = faces.clone().filter_map(|face| triangle(triangulation, obstacles.rim, face));
    let all = Boxes::new(triangles);
    let comparisons = Cell::new(0);
    let mut repair = Repair { triangulation, obstacles, all, changed: Vec::new(), comparisons };
    let is_hopeful = |repair: &Repair<'_>| repair.comparisons.get() < MOST_COMPARISONS;
    let intersecting =
        faces.take_while(|_| is_hopeful(&repair)).filter(|&face| repair.met(face) > 0);
    let mut queue: VecDeque<u32> = intersecting.collect();
    let (mut changes, mut hopeless) = (0, 0);
    while let Some(face) = queue.pop_front() {
        if changes == MOST_CHANGES || hopeless == MOST_HOPELESS || !is_hopeful(&repair) {
            return;
        }
        let met = repair.met(face);
        if met == 0 {
            continue;
        }
        let change = if met <= MOST_MET { repair.best_change(face) } else { None };
        match change {
            Some(change) => {
                changes += 1;
                queue.extend(repair.make(change));
            }
            None => hopeless += 1,
        }
    }
}

#[derive(Clone, Copy)]
enum Change {
    Flip(u32),
    Collapse(u32),
}

struct Repair<'a> {
    triangulation: &'a mut Triangulation,
    obstacles: &'a Obstacles<'a>,
    /// The triangulation's faces as they were at first.
    all: Boxes,
    /// Those that have changed since, or are gone.
    changed: Vec<u32>,
    /// How many pairs of triangles were compared.
    comparisons: Cell<usize>,
}

/// A face of a triangulation; none if it is gone. Inner vertices get numbers that no vertex of the data or of another fill has.
fn triangle(triangulation: &Triangulation, rim: &Rim, face: u32) -> Option<Triangle> {
    let corners = [0, 1, 2].map(|k| triangulation.corners[(3 * face + k) as usize]);
    triangulation.is_alive(3 * face).then(|| named(triangulation, rim, corners, face))
}

fn named(triangulation: &Triangulation, rim: &Rim, corners: [u32; 3], face: u32) -> Triangle {
    Triangle {
        vertices: corners.map(|vertex: u32| match rim.vertices.get(vertex as usize) {
            Some(&data) => data,
            None => NONE - vertex,
        }),
        corners: corners.map(|vertex: u32| triangulation.points[vertex as usize]),
        face,
    }
}

impl Repair<'_> {
    fn triangle(&self, face: u32) -> Option<Triangle> {
        triangle(self.triangulation, self.obstacles.rim, face)
    }

    /// How many triangles a face intersects.
    fn met(&self, face: u32) -> usize {
        self.triangle(face).map_or(0, |triangle| self.count(&[triangle], &[face]))
    }

    /// How many intersections these triangles would have, with each other included, if they took the place of some faces.
    fn count(&self, triangles: &[Triangle], replaced: &[u32]) -> usize {
        fn is_there(face: &u32, replaced: &[u32]) -> bool {
            !replaced.contains(face)
        }
        let changed = self.changed.iter().filter(|face| is_there(face, replaced));
        let changed: Vec<Triangle> = changed.filter_map(|&face| self.triangle(face)).collect();
        let mut count = 0;
        for (k, triangle) in triangles.iter().enumerate() {
            fn count_one(comparisons: &Cell<usize>) {
                comparisons.set(comparisons.get() + 1)
            }
            self.obstacles.intersections.with(triangle, |face| {
                count_one(&self.comparisons);
                count += usize::from(!self.obstacles.own.contains(&face));
            });
            self.all.near(&triangle.bounds(), |other| {
                count_one(&self.comparisons);
                let other = &other.triangle;
                let is_same =
                    is_there(&other.face, replaced) && !self.changed.contains(&other.face);
                count += usize::from(is_same && intersect(triangle, other));
            });
            let others = changed.iter().chain(&triangles[k + 1..]);
            count += others.filter(|other| intersect(triangle, other)).count();
        }
        count
    }

    /// The change near a face that leaves the fewest intersections, if one helps at all.
    fn best_change(&self, face: u32) -> Option<Change> {
        let mut changes = Vec::new();
        for half in 3 * face..3 * face + 3 {
            if self.may_flip(half) {
                changes.push(Change::Flip(half));
            }
            let vertex = self.triangulation.corners[half as usize];
            if !self.triangulation.is_rim(vertex) {
                let spokes = self.triangulation.around(vertex);
                let spokes = spokes.filter(|&spoke| self.triangulation.may_collapse(spoke));
                changes.extend(spokes.map(Change::Collapse));
            }
        }
        let gain = |change: Change| {
            let (faces, after) = self.outcome(change);
            let before: Vec<Triangle> =
                faces.iter().filter_map(|&face| self.triangle(face)).collect();
            self.count(&before, &faces).saturating_sub(self.count(&after, &faces))
        };
        let gains = changes.into_iter().map(|change| (gain(change), change));
        let best = gains.reduce(|best, other| if best.0 < other.0 { other } else { best });
        best.filter(|(gain, _)| *gain > 0).map(|(_, change)| change)
    }

    /// The faces that a change affects, and the triangles that take their place.
    fn outcome(&self, change: Change) -> (Vec<u32>, Vec<Triangle>) {
        let (triangulation, rim) = (&*self.triangulation, self.obstacles.rim);
        match change {
            Change::Flip(half) => {
                let twin = self.triangulation.twins[half as usize];
                let [a, b] = self.triangulation.ends(half);
                let [c, d] =
                    [half, twin].map(|half| self.triangulation.corners[previous(half) as usize]);
                let (f, g) = (half / 3, twin / 3);
                (
                    vec![f, g],
                    vec![
                        named(triangulation, rim, [a, d, c], f),
                        named(triangulation, rim, [d, b, c], g),
                    ],
                )
            }
            Change::Collapse(half) => {
                let [v, u] = self.triangulation.ends(half);
                let faces: Vec<u32> = self.triangulation.around(v).map(|half| half / 3).collect();
                fn corners(face: u32, triangulation_corners: &[u32]) -> [u32; 3] {
                    [0, 1, 2].map(|k| triangulation_corners[3 * face as usize + k])
                }
                let left =
                    faces.iter().map(|&face| (face, corners(face, &self.triangulation.corners)));
                let left =
                    left.filter(|(_, corners)| !corners.contains(&u)).map(|(face, corners)| {
                        named(
                            triangulation,
                            rim,
                            corners.map(|vertex| if vertex == v { u } else { vertex }),
                            face,
                        )
                    });
                let left = left.collect();
                (faces, left)
            }
        }
    }

    /// Makes a change, and gives the faces that it affected.
    fn make(&mut self, change: Change) -> Vec<u32> {
        let faces = self.outcome(change).0;
        match change {
            Change::Flip(half) => self.triangulation.flip(half),
            Change::Collapse(half) => self.triangulation.collapse(half),
        }
        self.changed.extend(&faces);
        self.changed.sort_unstable();
        self.changed.dedup();
        faces
    }

    /// Whether an edge may be flipped: no other edge has the ends that it would get.
    fn may_flip(&self, half: u32) -> bool {
        let triangulation = &*self.triangulation;
        let twin = triangulation.twins[half as usize];
        if twin == NONE {
            return false;
        }
        let [c, d] = [half, twin].map(|half| triangulation.corners[previous(half) as usize]);
        let is_between = |half: u32| [[c, d], [d, c]].contains(&triangulation.ends(half));
        if triangulation.is_rim(c) && triangulation.is_rim(d) {
            let mut halves = (0..triangulation.corners.len() as u32)
                .filter(|&half| triangulation.is_alive(half));
            return c != d
                && !halves.any(is_between)
                && !self.obstacles.rim.is_taken(c as usize, d as usize);
        }
        c != d && !triangulation.around(if triangulation.is_rim(c) { d } else { c }).any(is_between)
    }
}
