//! Changes a filling a little where its triangles run through something, and leaves the rest as it is.
//!
//! Around points that are in one place, or nearly so, triangles fold however smooth a surface is. There an edge is flipped, or a vertex
//! goes into one next to it, wherever that leaves fewer triangles that meet.

use std::cell::Cell;
use std::collections::VecDeque;
use std::ops::Range;

use super::boxes::{Boxes, Triangle};
use super::intersections::{Crossings, meet};
use crate::fill::border::rim::Rim;
use crate::fill::triangles::patch::{NONE, Patch, previous};

/// As many changes are made at most: what crosses in more places is another surface altogether.
const MOST_CHANGES: usize = 100;

/// So many faces are looked at for which no change helps: they are where a whole part runs through something.
const MOST_HOPELESS: usize = 30;

/// So many triangles are looked at at most, whichever lie near those that cross: some tenths of a second. Where each lies near all others,
/// no small change helps.
const MOST_LOOKS: usize = 100_000;

/// A triangle that meets more others than these is no fold, and no small change helps.
const MOST_MET: usize = 20;

/// What is around a hole: the data, and what fills the other holes.
pub(crate) struct Around<'a> {
    pub(crate) crossings: &'a Crossings,
    /// The faces that fill this hole so far, which do not count.
    pub(crate) own: Range<u32>,
    pub(crate) rim: &'a Rim,
}

/// Flips edges and collapses them as long as fewer triangles meet each other or what is around.
pub(crate) fn mend(patch: &mut Patch, around: &Around<'_>) {
    let faces = 0..patch.corners.len() as u32 / 3;
    let triangles = faces.clone().filter_map(|face| triangle(patch, around.rim, face));
    let all = Boxes::new(triangles);
    let looks = Cell::new(0);
    let mut mending = Mending { patch, around, all, changed: Vec::new(), looks };
    let is_hopeful = |mending: &Mending<'_>| mending.looks.get() < MOST_LOOKS;
    let crossing = faces.take_while(|_| is_hopeful(&mending)).filter(|&face| mending.met(face) > 0);
    let mut queue: VecDeque<u32> = crossing.collect();
    let (mut changes, mut hopeless) = (0, 0);
    while let Some(face) = queue.pop_front() {
        if changes == MOST_CHANGES || hopeless == MOST_HOPELESS || !is_hopeful(&mending) {
            return;
        }
        let met = mending.met(face);
        if met == 0 {
            continue;
        }
        let change = if met <= MOST_MET { mending.best_change(face) } else { None };
        match change {
            Some(change) => {
                changes += 1;
                queue.extend(mending.make(change));
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

struct Mending<'a> {
    patch: &'a mut Patch,
    around: &'a Around<'a>,
    /// The patch's faces as they were at first.
    all: Boxes,
    /// Those that are others now, or gone.
    changed: Vec<u32>,
    /// How many triangles were looked at.
    looks: Cell<usize>,
}

/// A face of a patch, with numbers that no vertex elsewhere has; none if it is gone.
fn triangle(patch: &Patch, rim: &Rim, face: u32) -> Option<Triangle> {
    let corners = [0, 1, 2].map(|k| patch.corners[(3 * face + k) as usize]);
    patch.is_alive(3 * face).then(|| named(patch, rim, corners, face))
}

fn named(patch: &Patch, rim: &Rim, corners: [u32; 3], face: u32) -> Triangle {
    let number = |vertex: u32| match rim.vertices.get(vertex as usize) {
        Some(&data) => data,
        None => NONE - vertex,
    };
    let place = |vertex: u32| patch.points[vertex as usize];
    Triangle { vertices: corners.map(number), corners: corners.map(place), face }
}

impl Mending<'_> {
    fn triangle(&self, face: u32) -> Option<Triangle> {
        triangle(self.patch, self.around.rim, face)
    }

    /// How many triangles a face meets.
    fn met(&self, face: u32) -> usize {
        self.triangle(face).map_or(0, |triangle| self.count(&[triangle], &[face]))
    }

    /// How many triangles these meet, each other included, if they were there in place of some faces.
    fn count(&self, triangles: &[Triangle], replaced: &[u32]) -> usize {
        let is_there = |face: &u32| !replaced.contains(face);
        let changed = self.changed.iter().filter(|face| is_there(face));
        let changed: Vec<Triangle> = changed.filter_map(|&face| self.triangle(face)).collect();
        let mut count = 0;
        for (k, triangle) in triangles.iter().enumerate() {
            let looked = || self.looks.set(self.looks.get() + 1);
            self.around.crossings.with(triangle, |face| {
                looked();
                count += usize::from(!self.around.own.contains(&face));
            });
            self.all.near(&triangle.bounds(), |other| {
                looked();
                let other = &other.triangle;
                let is_same = is_there(&other.face) && !self.changed.contains(&other.face);
                count += usize::from(is_same && meet(triangle, other));
            });
            let others = changed.iter().chain(&triangles[k + 1..]);
            count += others.filter(|other| meet(triangle, other)).count();
        }
        count
    }

    /// The change near a face that leaves the fewest triangles meeting, if there is one that helps.
    fn best_change(&self, face: u32) -> Option<Change> {
        let mut changes = Vec::new();
        for half in 3 * face..3 * face + 3 {
            if self.may_flip(half) {
                changes.push(Change::Flip(half));
            }
            let vertex = self.patch.corners[half as usize];
            if !self.patch.is_rim(vertex) {
                let spokes = self.patch.around(vertex);
                let spokes = spokes.filter(|&spoke| self.patch.may_collapse(spoke));
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

    /// The faces that a change changes, and what is there after it.
    fn outcome(&self, change: Change) -> (Vec<u32>, Vec<Triangle>) {
        let named = |corners, face| named(self.patch, self.around.rim, corners, face);
        match change {
            Change::Flip(half) => {
                let twin = self.patch.twins[half as usize];
                let [a, b] = self.patch.ends(half);
                let [c, d] = [half, twin].map(|half| self.patch.corners[previous(half) as usize]);
                let (f, g) = (half / 3, twin / 3);
                (vec![f, g], vec![named([a, d, c], f), named([d, b, c], g)])
            }
            Change::Collapse(half) => {
                let [v, u] = self.patch.ends(half);
                let faces: Vec<u32> = self.patch.around(v).map(|half| half / 3).collect();
                let corners =
                    |face: u32| [0, 1, 2].map(|k| self.patch.corners[3 * face as usize + k]);
                let left = faces.iter().map(|&face| (face, corners(face)));
                let left =
                    left.filter(|(_, corners)| !corners.contains(&u)).map(|(face, corners)| {
                        named(corners.map(|vertex| if vertex == v { u } else { vertex }), face)
                    });
                let left = left.collect();
                (faces, left)
            }
        }
    }

    /// Makes a change, and gives the faces that it changed.
    fn make(&mut self, change: Change) -> Vec<u32> {
        let faces = self.outcome(change).0;
        match change {
            Change::Flip(half) => self.patch.flip(half),
            Change::Collapse(half) => self.patch.collapse(half),
        }
        self.changed.extend(&faces);
        self.changed.sort_unstable();
        self.changed.dedup();
        faces
    }

    /// Whether an edge may be flipped, and no other edge has the ends that it would get.
    fn may_flip(&self, half: u32) -> bool {
        let patch = &*self.patch;
        let twin = patch.twins[half as usize];
        if twin == NONE {
            return false;
        }
        let [c, d] = [half, twin].map(|half| patch.corners[previous(half) as usize]);
        let is_between = |half: u32| [[c, d], [d, c]].contains(&patch.ends(half));
        if patch.is_rim(c) && patch.is_rim(d) {
            let mut halves = (0..patch.corners.len() as u32).filter(|&half| patch.is_alive(half));
            return c != d
                && !halves.any(is_between)
                && !self.around.rim.is_taken(c as usize, d as usize);
        }
        c != d && !patch.around(if patch.is_rim(c) { d } else { c }).any(is_between)
    }
}
