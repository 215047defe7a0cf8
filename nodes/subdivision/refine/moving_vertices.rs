//! A refined mesh that follows its control points: if some control points move, only the vertices that depend on them are recomputed.
//!
//! In one step a vertex affects the new vertices of its faces: at their corners, on their edges and in their interior. Each new vertex is
//! computed by the same operations as in the full refinement, so both results are equal bit for bit.

use maquette_value::parallel::ParallelSliceMut;
use nalgebra::Point3;

use super::half_edges::{HalfEdges, NONE, Ring};
use super::primal::Primal;
use super::step::Step;

/// The positions of the vertices after each step, updated when control points move.
pub struct MovingVertices<'a> {
    steps: &'a [Step],
    /// A half-edge that starts at each control point.
    starts: Vec<u32>,
    /// The control points, followed by the vertices after each step.
    positions: Vec<Vec<Point3<f64>>>,
}

/// Vertex indices, each paired with a half-edge that starts at the vertex.
type VertexHalfEdges = Vec<[u32; 2]>;

impl<'a> MovingVertices<'a> {
    pub(crate) fn new(steps: &'a [Step], control: &[Point3<f64>]) -> Self {
        let mut starts = vec![NONE; control.len()];
        if let Some(step) = steps.first().and_then(Step::primal) {
            let corners = step.level.mesh.corners();
            (0..).zip(corners).for_each(|(half, &vertex)| starts[vertex as usize] = half);
        }
        let mut live = Self { steps, starts, positions: vec![control.to_vec()] };
        live.compute(0);
        live
    }

    /// The vertices after the last step.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions[self.positions.len() - 1]
    }

    /// Moves control points. Returns the vertices after the last step that may have moved, ascending.
    ///
    /// The time depends on the number of affected vertices, not on the size of the mesh; but with the Doo-Sabin scheme all vertices are
    /// recomputed.
    ///
    /// # Panics
    /// If a control point does not exist.
    pub fn update(&mut self, changed: &[(u32, Point3<f64>)]) -> Vec<u32> {
        changed
            .iter()
            .for_each(|&(vertex, position)| self.positions[0][vertex as usize] = position);
        let reached = changed.iter().map(|&(vertex, _)| [vertex, self.starts[vertex as usize]]);
        let mut reached = VertexHalfEdges::from_iter(reached);
        reached.sort_unstable();
        reached.dedup();
        let steps = self.steps;
        for (level, step) in steps.iter().enumerate() {
            let Some(step) = step.primal() else {
                self.compute(level);
                return (0..self.positions().len() as u32).collect();
            };
            let (before, after) = self.positions.split_at_mut(level + 1);
            reached = follow(step, &reached, &before[level], &mut after[0]);
        }
        reached.into_iter().map(|[vertex, _]| vertex).collect()
    }

    /// Recomputes all vertices made by the step with the index `level` and by each later step. The vertices before the step `level` must be
    /// valid.
    fn compute(&mut self, level: usize) {
        self.positions.truncate(level + 1);
        for step in &self.steps[level..] {
            let next = step.positions(self.positions());
            self.positions.push(next);
        }
    }
}

/// Recomputes the vertices after a step that depend on the vertices `moved`.
fn follow(
    step: &Primal,
    moved: &VertexHalfEdges,
    old: &[Point3<f64>],
    new: &mut [Point3<f64>],
) -> VertexHalfEdges {
    let mesh = &step.level.mesh;
    let mut ring = Ring::default();
    let mut faces = Vec::new();
    let mut reached = VertexHalfEdges::new();
    for &[vertex, half] in moved {
        if half == NONE {
            reached.push([vertex, NONE]);
            continue;
        }
        mesh.ring(mesh.clockwise_most(half), &mut ring);
        faces.extend(ring.halves.iter().map(|&half| mesh.face_of(half)));
    }
    faces.par_sort_unstable();
    faces.dedup();
    for &face in &faces {
        reached.extend(step.middle(face));
        for half in mesh.halves_around(face) {
            reached.extend([step.on_edge(half), step.at_start(half)]);
        }
    }
    // One half-edge per vertex is enough. Vertices are computed in descending order, because vertices on edges and at old vertices depend
    // on the new vertices inside faces, whose indices are higher.
    reached.sort_unstable();
    reached.dedup_by_key(|reached| reached[0]);
    for &[vertex, _] in reached.iter().rev() {
        new[vertex as usize] = step.vertex_position(vertex, old, new);
    }
    reached
}
