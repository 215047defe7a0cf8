//! The limit points of a refined mesh as sparse weighted sums of control points.

use maquette_base::linear::stencils::Stencils;
use maquette_node::Error;
use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::Point3;

use super::limit_rows::LimitPositions;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::sharpness::Sharpness;
use crate::masks::vertex_rings::{RingMasks, Scratch};
use crate::refine::connectivity::Connectivity;
use crate::refine::level::{check_triangles, creases};
use crate::refine::step::Step;
use crate::refine::topology::Topology;
use crate::rules::Rules;
use crate::{Boundary, Creases, Scheme};

/// The limit points of a mesh refined by Loop's scheme, as a matrix that can be applied to any control points.
pub(crate) struct ComposedLimit {
    /// The limit points as weighted sums of the control points: about 15 entries per row.
    pub(crate) rows: Stencils,
    /// The faces of the mesh after all refinement steps.
    faces: Faces,
}

impl ComposedLimit {
    /// Computes the matrix for the mesh that results from refining `mesh` `levels` times.
    ///
    /// # Errors
    /// If a face is not a triangle or the mesh is not manifold.
    pub(crate) fn new(mesh: &Mesh, levels: u32) -> Result<Self, Error> {
        let rules = Rules {
            scheme: Scheme::Loop,
            boundary: Boundary::EdgeAndCorner,
            creases: Creases::OpenSubdiv,
        };
        let mut topology = Topology {
            rules,
            vertices: mesh.positions().len(),
            faces: mesh.faces().clone(),
            creases: mesh.creases().collect(),
        };
        let mut rows: Option<Stencils> = None;
        fn compose(rows: Option<Stencils>, next: Stencils) -> Stencils {
            match rows {
                Some(rows) => next.times(&rows),
                None => next,
            }
        }
        let mut step: Option<Step> = None;
        for _ in 0..levels {
            let refined = refinement(&topology)?;
            let next = match &step {
                None => Step::from_topology(&topology)?,
                Some(step) => step.next()?,
            };
            topology.vertices = refined.len();
            topology.faces = next.finer().clone();
            topology.creases = next.finer_creases();
            rows = Some(compose(rows.take(), refined));
            step = Some(next);
        }
        let rows = compose(rows, LimitPositions::new(&topology)?.positions);
        Ok(Self { rows, faces: topology.faces })
    }

    /// Returns the refined mesh for the control points `control`, with the vertices of the refined mesh moved to the limit surface.
    ///
    /// # Errors
    /// If a position is infinite.
    pub(crate) fn surface(&self, control: &[Point3<f64>]) -> Result<Mesh, MeshError> {
        Mesh::new(self.rows.apply(control), self.faces.clone())
    }
}

/// Returns the matrix of one step of Loop's scheme.
fn refinement(topology: &Topology) -> Result<Stencils, Error> {
    check_triangles(&topology.faces, "Loop's scheme")?;
    let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
    let creases = creases(topology, &mesh);
    let rules = topology.rules;
    let sharpness = Sharpness::new(&mesh, rules, &creases);
    let stars =
        RingMasks { mesh: &mesh, sharpness: &sharpness, rules: rules.of_edges(), masks: LoopMasks };
    let count = starts.len() + mesh.halves.len();
    let (rows, _) = Stencils::build(count, |scratch: &mut Scratch, row, rows| {
        match row.checked_sub(starts.len()) {
            None => stars.vertex(scratch, row as u32, starts[row], rows),
            Some(edge) => stars.edge(edge as u32, rows),
        }
        rows.end();
    });
    Ok(rows)
}

/// Returns the Laplacian matrix, which gives the difference of each control point from the mean of its neighbors. For vertices on creases
/// and borders only the two neighbors on the crease or border count. The rows of vertices where creases end or meet are empty.
pub(crate) fn laplacian(mesh: &Mesh) -> Stencils {
    let count = mesh.positions().len();
    let edges = mesh.edges();
    let (mut all, mut sharp) = (vec![Vec::new(); count], vec![Vec::new(); count]);
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    let creases = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
    let held = borders.map(|(&ends, _)| ends).chain(creases.map(|(ends, _)| ends));
    for (lists, ends) in [(&mut all, edges.vertices.to_vec()), (&mut sharp, held.collect())] {
        for [a, b] in ends {
            lists[a as usize].push(b);
            lists[b as usize].push(a);
        }
    }
    let (rows, _) = Stencils::build(count, |_: &mut (), vertex, rows| {
        let neighbors = match sharp[vertex].len() {
            0 => &all[vertex][..],
            2 => &sharp[vertex][..],
            _ => &[],
        };
        if !neighbors.is_empty() {
            rows.push(vertex as u32, 1.0);
        }
        neighbors.iter().for_each(|&other| rows.push(other, -1.0 / neighbors.len() as f64));
        rows.end();
    });
    rows
}

#[cfg(test)]
mod tests;
