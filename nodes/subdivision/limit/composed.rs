//! The limit points of a refined mesh as sparse sums of its control points.

use maquette_base::linear::stencils::Stencils;
use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::Point3;

use super::limit_rows::LimitPlaces;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::sharpness::Sharpness;
use crate::masks::stars::{Scratch, Stars};
use crate::refine::connectivity::Connectivity;
use crate::refine::level::{check_triangles, creases};
use crate::refine::step::Step;
use crate::refine::topology::Topology;
use crate::rules::Rules;
use crate::{Boundary, Creases, Scheme, SubdivideError};

/// Some steps of Loop's scheme, and then the limit, for any control points of one mesh.
pub(crate) struct Composed {
    /// The limit points in terms of the control points: some 15 entries a row.
    pub(crate) rows: Stencils,
    /// The refined faces.
    faces: Faces,
}

impl Composed {
    /// # Errors
    /// If a face is no triangle or the mesh is not manifold.
    pub(crate) fn new(mesh: &Mesh, levels: u32) -> Result<Self, SubdivideError> {
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
        fn after(rows: Option<Stencils>, next: Stencils) -> Stencils {
            match rows {
                Some(rows) => next.times(&rows),
                None => next,
            }
        }
        let mut step: Option<Step> = None;
        for _ in 0..levels {
            let refined = refinement(&topology)?;
            let next = match &step {
                None => Step::first(&topology)?,
                Some(step) => step.next()?,
            };
            topology.vertices = refined.len();
            topology.faces = next.finer().clone();
            topology.creases = next.finer_creases();
            rows = Some(after(rows.take(), refined));
            step = Some(next);
        }
        let rows = after(rows, LimitPlaces::new(&topology)?.positions);
        Ok(Self { rows, faces: topology.faces })
    }

    /// The refined mesh of these control points, on the limit surface.
    ///
    /// # Errors
    /// If a place is infinite.
    pub(crate) fn surface(&self, control: &[Point3<f64>]) -> Result<Mesh, MeshError> {
        Mesh::new(self.rows.apply(control), self.faces.clone())
    }
}

/// The new vertices of one step of Loop's scheme in terms of the old ones.
fn refinement(topology: &Topology) -> Result<Stencils, SubdivideError> {
    check_triangles(&topology.faces)?;
    let (mesh, starts) = Connectivity::new(&topology.faces, topology.vertices)?;
    let creases = creases(topology, &mesh);
    let rules = topology.rules;
    let sharpness = Sharpness::new(&mesh, rules, &creases);
    let stars =
        Stars { mesh: &mesh, sharpness: &sharpness, rules: rules.of_edges(), masks: LoopMasks };
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

/// How far each control point is from the mean of its neighbors. On creases and borders its two neighbors
/// there count; where creases end or meet nothing does.
pub(crate) fn laplacian(mesh: &Mesh) -> Stencils {
    let count = mesh.positions().len();
    let edges = mesh.edges();
    let (mut all, mut sharp) = (vec![Vec::new(); count], vec![Vec::new(); count]);
    let borders = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    let creases = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
    let held = borders.map(|(&ends, _)| ends).chain(creases.map(|(ends, _)| ends));
    for (lists, ends) in [
        (&mut all, edges.vertices.iter().copied().collect::<Vec<_>>()),
        (&mut sharp, held.collect()),
    ] {
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
