//! A refined mesh that follows its control points: where some move, only what they reach is computed again.
//!
//! What a vertex reaches in one step lies in the faces around it: their vertices, edges and middles. Each of these is computed as the
//! whole product computes it, number by number, so that both give the same bits.

use nalgebra::Point3;

use super::half_edges::{HalfEdges, NONE, Ring};
use super::primal::Primal;
use super::step::Step;

/// The places of the vertices after each step, which follow the control points.
pub struct Live<'a> {
    steps: &'a [Step],
    /// A half-edge from each control point.
    starts: Vec<u32>,
    /// The control points, and the vertices after each step.
    places: Vec<Vec<Point3<f64>>>,
}

/// Vertices with a half-edge from each.
type Reached = Vec<[u32; 2]>;

impl<'a> Live<'a> {
    pub(crate) fn new(steps: &'a [Step], control: &[Point3<f64>]) -> Self {
        let mut starts = vec![NONE; control.len()];
        if let Some(step) = steps.first().and_then(Step::primal) {
            let corners = step.level.mesh.corners();
            (0..).zip(corners).for_each(|(half, &vertex)| starts[vertex as usize] = half);
        }
        let mut live = Self { steps, starts, places: vec![control.to_vec()] };
        live.compute(0);
        live
    }

    /// The vertices after the last step.
    pub fn places(&self) -> &[Point3<f64>] {
        &self.places[self.places.len() - 1]
    }

    /// Puts control points to other places; the vertices after the last step that may have moved, ascending.
    ///
    /// The cost grows with what is reached, not with the mesh; but with the scheme of Doo and Sabin everything is computed again.
    ///
    /// # Panics
    /// If there is no such control point.
    pub fn update(&mut self, changed: &[(u32, Point3<f64>)]) -> Vec<u32> {
        changed.iter().for_each(|&(vertex, place)| self.places[0][vertex as usize] = place);
        let reached = changed.iter().map(|&(vertex, _)| [vertex, self.starts[vertex as usize]]);
        let mut reached = Reached::from_iter(reached);
        reached.sort_unstable();
        reached.dedup();
        let steps = self.steps;
        for (level, step) in steps.iter().enumerate() {
            let Some(step) = step.primal() else {
                self.compute(level);
                return (0..self.places().len() as u32).collect();
            };
            let (before, after) = self.places.split_at_mut(level + 1);
            reached = follow(step, &reached, &before[level], &mut after[0]);
        }
        reached.into_iter().map(|[vertex, _]| vertex).collect()
    }

    /// Computes everything after some of the steps.
    fn compute(&mut self, level: usize) {
        self.places.truncate(level + 1);
        for step in &self.steps[level..] {
            let next = step.positions(self.places());
            self.places.push(next);
        }
    }
}

/// Computes again what some vertices reach in a step.
fn follow(step: &Primal, moved: &Reached, old: &[Point3<f64>], new: &mut [Point3<f64>]) -> Reached {
    let mesh = &step.level.mesh;
    let mut ring = Ring::default();
    let mut faces = Vec::new();
    let mut reached = Reached::new();
    for &[vertex, half] in moved {
        if half == NONE {
            reached.push([vertex, NONE]);
            continue;
        }
        mesh.ring(mesh.first(half), &mut ring);
        faces.extend(ring.halves.iter().map(|&half| mesh.face_of(half)));
    }
    faces.sort_unstable();
    faces.dedup();
    for &face in &faces {
        reached.extend(step.middle(face));
        for half in mesh.halves_around(face) {
            reached.extend([step.on_edge(half), step.at_start(half)]);
        }
    }
    // Of each vertex one half-edge is enough; middles come last, and what lies on edges before them.
    reached.sort_unstable();
    reached.dedup_by_key(|reached| reached[0]);
    for &[vertex, _] in reached.iter().rev() {
        new[vertex as usize] = step.place(vertex, old, new);
    }
    reached
}
