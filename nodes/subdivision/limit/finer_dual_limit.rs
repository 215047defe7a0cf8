//! The limit of a mesh refined by the Doo-Sabin scheme. The limit point of an inner vertex is the middle of the face that another step
//! would make around the vertex; only vertices on the border need matrix rows.

use maquette_base::linear::stencils::Stencils;
use maquette_node::Error;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::dual_limit::DualLimit;
use super::limit_rows::complete_normals;
use crate::masks::roots_of_unity::root_of_unity;
use crate::refine::doo_sabin::{Dual, FaceVertices};
use crate::refine::dual_halves::{FinerHalves, Rings};
use crate::refine::half_edges::{HalfEdges, Ring};

/// The number of vertices per parallel task.
const BLOCK: usize = 4096;

/// The limit positions and normals of a refined mesh.
#[derive(Debug)]
pub(crate) struct FinerDualLimit {
    limit: DualLimit,
    rings: Rings,
    /// The vertices whose faces do not form a closed ring. For these vertices `positions` has the limit positions, `tangents` the tangents,
    /// and `sides` the index of each vertex's first row in `tangents`.
    border: Vec<u32>,
    positions: Stencils,
    tangents: Stencils,
    sides: Column<u32>,
}

impl FinerDualLimit {
    /// Computes the limit of the vertices that the step `dual` made.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn new(dual: &Dual) -> Result<Self, Error> {
        let FinerHalves { mesh, starts, rings } = dual.finer_halves()?;
        let limit = DualLimit::new(mesh, starts, dual.boundary());
        let mut ring = Ring::default();
        let edges = (0..limit.mesh.halves.len() as u32).into_par_iter().with_min_len(BLOCK);
        let on_border = edges.filter(|&edge| limit.mesh.is_boundary(edge));
        let mut border: Vec<u32> = on_border.flat_map_iter(|edge| limit.mesh.ends(edge)).collect();
        border.sort_unstable();
        border.dedup();
        border.retain(|&vertex| {
            limit.mesh.ring(limit.starts[vertex as usize], &mut ring);
            !ring.closed
        });
        let (positions, (tangents, sides)) = (limit.positions(&border), limit.tangents(&border));
        Ok(Self { limit, rings, border, positions, tangents, sides })
    }

    /// Moves the vertices of `mesh` to the limit surface, and adds the attribute `normal`.
    ///
    /// # Errors
    /// If a position becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let control = &mesh.positions()[..];
        let inside = FaceVertices::new(&self.limit.mesh, control);
        let mut positions: Vec<Point3<f64>> = huge_vec(control.len());
        let mut normals: Vec<[f64; 3]> = huge_vec(control.len());
        let both = positions.par_iter_mut().zip(&mut normals).enumerate().with_min_len(BLOCK);
        both.for_each_init(Vec::new, |fan, (vertex, (position, normal))| {
            fan.clear();
            self.rings.fan(&self.limit.mesh, vertex, self.limit.starts[vertex], fan);
            let n = fan.len();
            let [mut sum, mut first, mut second] = [Vector3::zeros(); 3];
            for (j, &half) in fan.iter().enumerate() {
                let (point, [cosine, sine]) = (inside.vertex_at(half), root_of_unity(j, n));
                sum += point;
                first += point * cosine;
                second += point * sine;
            }
            *position = (sum / n as f64).into();
            // In a face with two corners the sines are zero up to rounding, so the tangents do not span a plane.
            let is_plane = n > 2;
            let across = first.cross(&second).try_normalize(0.0).filter(|_| is_plane);
            *normal = across.unwrap_or_default().into();
        });
        for (&vertex, position) in self.border.iter().zip(self.positions.apply(control)) {
            positions[vertex as usize] = position;
        }
        let limit = mesh.with_positions(positions)?;
        let odd = self.border.iter().map(|&vertex| [vertex, self.limit.starts[vertex as usize]]);
        let (odd, tangents) = (odd.collect::<Vec<_>>(), (&self.tangents, &self.sides[..]));
        complete_normals(&mut normals, &limit, control, &self.limit.mesh, &odd, tangents);
        limit.without_attribute("normal").with_vertex("normal", Attribute::Vector(normals.into()))
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        let rows = self.positions.size() + self.tangents.size() + self.sides.size();
        let lists = self.limit.starts.len() + self.border.len();
        self.limit.mesh.size() + self.rings.size() + 4 * lists + rows
    }
}
