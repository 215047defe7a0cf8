//! Removes intersections of a fill by a few edge flips and collapses. If some remain, the caller fills the hole with another surface.
//!
//! Near points that coincide or nearly coincide, triangles fold even on a smooth surface. An edge of such a triangle is flipped or
//! collapsed if that reduces the number of intersecting triangles.

use std::cell::Cell;
use std::collections::VecDeque;
use std::ops::Range;

use super::boxes::{Boxes, Triangle};
use super::detect::{Intersections, intersect};
use crate::border::rim::Rim;
use crate::triangles::triangulation::{NONE, Triangulation, previous};

/// Maximum number of edge flips and collapses in the repair of one fill. A fill that intersects at more positions needs to be replaced by
/// another surface.
const MAX_CHANGES: usize = 100;

/// Maximum number of faces for which no change helps. If there are more, a whole region intersects something, and the repair stops.
const MAX_HOPELESS: usize = 30;

/// Maximum number of triangle pairs to compare, which takes some tenths of a second. More are needed if every triangle is near all others;
/// then no small change helps.
const MAX_COMPARISONS: usize = 100_000;

/// Maximum number of triangles that a face to be repaired may intersect. A face that intersects more is not just folded, and no small
/// change helps.
const MAX_INTERSECTIONS: usize = 20;

/// The surfaces that the fill of a hole must not intersect: the input mesh and the fills of other holes.
pub(crate) struct Obstacles<'a> {
    pub(crate) intersections: &'a Intersections,
    /// The faces of the hole's current fill, which are not obstacles.
    pub(crate) own: Range<u32>,
    pub(crate) rim: &'a Rim,
}

/// Flips and collapses edges as long as that reduces the number of intersections of the triangles with each other and with the obstacles.
pub(crate) fn repair(triangulation: &mut Triangulation, obstacles: &Obstacles<'_>) {
    let faces = 0..triangulation.corners.len() as u32 / 3;
    let triangles = faces.clone().filter_map(|face| triangle(triangulation, obstacles.rim, face));
    let all = Boxes::new(triangles);
    let comparisons = Cell::new(0);
    let mut repair = Repair { triangulation, obstacles, all, changed: Vec::new(), comparisons };
    let intersecting = faces
        .take_while(|_| repair.is_hopeful())
        .filter(|&face| repair.intersection_count(face) > 0);
    let mut queue: VecDeque<u32> = intersecting.collect();
    let (mut changes, mut hopeless) = (0, 0);
    while let Some(face) = queue.pop_front() {
        if changes == MAX_CHANGES || hopeless == MAX_HOPELESS || !repair.is_hopeful() {
            return;
        }
        let count = repair.intersection_count(face);
        if count == 0 {
            continue;
        }
        let change = if count <= MAX_INTERSECTIONS { repair.best_change(face) } else { None };
        match change {
            Some(change) => {
                changes += 1;
                queue.extend(repair.apply(change));
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
    /// The faces of the triangulation, as they were before the repair.
    all: Boxes,
    /// The faces that were changed or removed since the repair began.
    changed: Vec<u32>,
    /// The number of triangle pairs compared so far.
    comparisons: Cell<usize>,
}

/// Returns a face of the fill's triangulation; `None` if the face was removed. Inner vertices get numbers that neither the input mesh nor
/// other fills use.
fn triangle(triangulation: &Triangulation, rim: &Rim, face: u32) -> Option<Triangle> {
    let corners = [0, 1, 2].map(|k| triangulation.corners[(3 * face + k) as usize]);
    triangulation.is_alive(3 * face).then(|| numbered_triangle(triangulation, rim, corners, face))
}

fn numbered_triangle(
    triangulation: &Triangulation,
    rim: &Rim,
    corners: [u32; 3],
    face: u32,
) -> Triangle {
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

    /// Returns true as long as the repair may compare more triangle pairs.
    fn is_hopeful(&self) -> bool {
        self.comparisons.get() < MAX_COMPARISONS
    }

    /// Returns the number of triangles that a face of the fill intersects.
    fn intersection_count(&self, face: u32) -> usize {
        self.triangle(face).map_or(0, |triangle| self.count(&[triangle], &[face]))
    }

    /// Returns the number of intersections that `triangles` would have, including those with each other, if they replaced the faces
    /// `replaced`.
    fn count(&self, triangles: &[Triangle], replaced: &[u32]) -> usize {
        let changed = self.changed.iter().filter(|face| !replaced.contains(face));
        let changed: Vec<Triangle> = changed.filter_map(|&face| self.triangle(face)).collect();
        let mut count = 0;
        for (k, triangle) in triangles.iter().enumerate() {
            self.obstacles.intersections.for_each_intersecting(triangle, |face| {
                self.comparisons.set(self.comparisons.get() + 1);
                count += usize::from(!self.obstacles.own.contains(&face));
            });
            self.all.for_each_near(&triangle.bounds(), |other| {
                self.comparisons.set(self.comparisons.get() + 1);
                let other = &other.triangle;
                let is_unchanged =
                    !replaced.contains(&other.face) && !self.changed.contains(&other.face);
                count += usize::from(is_unchanged && intersect(triangle, other));
            });
            let others = changed.iter().chain(&triangles[k + 1..]);
            count += others.filter(|other| intersect(triangle, other)).count();
        }
        count
    }

    /// Returns the change near a face that removes the most intersections; `None` if no change helps.
    fn best_change(&self, face: u32) -> Option<Change> {
        let mut changes = Vec::new();
        for half in 3 * face..3 * face + 3 {
            if self.may_flip(half) {
                changes.push(Change::Flip(half));
            }
            let vertex = self.triangulation.corners[half as usize];
            if !self.triangulation.is_rim(vertex) {
                let spokes = self.triangulation.halves_around(vertex);
                let spokes = spokes.filter(|&spoke| self.triangulation.may_collapse(spoke));
                changes.extend(spokes.map(Change::Collapse));
            }
        }
        let gains = changes.into_iter().map(|change| (self.gain(change), change));
        let best = gains.reduce(|best, other| if best.0 < other.0 { other } else { best });
        best.filter(|(gain, _)| *gain > 0).map(|(_, change)| change)
    }

    /// Returns the number of intersections that a change removes; 0 if it removes none.
    fn gain(&self, change: Change) -> usize {
        let (faces, after) = self.outcome(change);
        let before: Vec<Triangle> = faces.iter().filter_map(|&face| self.triangle(face)).collect();
        self.count(&before, &faces).saturating_sub(self.count(&after, &faces))
    }

    /// Returns the faces that a change would affect, and the triangles that would replace them.
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
                        numbered_triangle(triangulation, rim, [a, d, c], f),
                        numbered_triangle(triangulation, rim, [d, b, c], g),
                    ],
                )
            }
            Change::Collapse(half) => {
                let [v, u] = self.triangulation.ends(half);
                let faces: Vec<u32> =
                    self.triangulation.halves_around(v).map(|half| half / 3).collect();
                let triangles = faces.iter().filter_map(|&face| {
                    let corners: [u32; 3] =
                        [0, 1, 2].map(|k| triangulation.corners[3 * face as usize + k]);
                    let moved = corners.map(|vertex| if vertex == v { u } else { vertex });
                    (!corners.contains(&u))
                        .then(|| numbered_triangle(triangulation, rim, moved, face))
                });
                let triangles = triangles.collect();
                (faces, triangles)
            }
        }
    }

    /// Applies a change. Returns the affected faces.
    fn apply(&mut self, change: Change) -> Vec<u32> {
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

    /// Returns true if an edge may be flipped: the two vertices that the flipped edge would connect have no edge yet.
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
        c != d
            && !triangulation
                .halves_around(if triangulation.is_rim(c) { d } else { c })
                .any(is_between)
    }
}
