//! The limit of a mesh that the scheme of Doo and Sabin has refined: inside it is the middle of the face that the next step would put
//! around a vertex, and rows are made for the vertices on the border alone.

use maquette_base::linear::stencils::Stencils;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::dual_limit::DualLimit;
use super::limit_rows::complete_normals;
use crate::SubdivideError;
use crate::masks::turns::turn;
use crate::refine::doo_sabin::{Dual, Inside};
use crate::refine::dual_halves::{FinerHalves, Rings};
use crate::refine::half_edges::{HalfEdges, Ring};

/// Vertices that one task looks at.
const BLOCK: usize = 4096;

/// Where the vertices of a refined mesh go, and which way the surface faces there.
#[derive(Debug)]
pub(crate) struct FinerDualLimit {
    limit: DualLimit,
    rings: Rings,
    /// The vertices whose faces do not close to a ring, their limits, and their tangents with the first row of each.
    border: Vec<u32>,
    positions: Stencils,
    tangents: Stencils,
    sides: Column<u32>,
}

impl FinerDualLimit {
    /// That of the vertices which a step makes.
    ///
    /// # Errors
    /// If the refined mesh is not manifold.
    pub(crate) fn new(dual: &Dual) -> Result<Self, SubdivideError> {
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

    /// The same mesh with its vertices on the limit surface, and the attribute `normal`.
    ///
    /// # Errors
    /// If a place becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let control = &mesh.positions()[..];
        let inside = Inside::new(&self.limit.mesh, control);
        let mut positions: Vec<Point3<f64>> = huge_vec(control.len());
        let mut normals: Vec<[f64; 3]> = huge_vec(control.len());
        let both = positions.par_iter_mut().zip(&mut normals).enumerate().with_min_len(BLOCK);
        both.for_each_init(Vec::new, |fan, (vertex, (place, normal))| {
            fan.clear();
            self.rings.fan(&self.limit.mesh, vertex, self.limit.starts[vertex], fan);
            let n = fan.len();
            let [mut sum, mut first, mut second] = [Vector3::zeros(); 3];
            for (j, &half) in fan.iter().enumerate() {
                let (point, [cosine, sine]) = (inside.at(half), turn(j, n));
                sum += point;
                first += point * cosine;
                second += point * sine;
            }
            *place = (sum / n as f64).into();
            // The sines of half turns vanish but for rounding.
            let is_plane = n > 2;
            let across = first.cross(&second).try_normalize(0.0).filter(|_| is_plane);
            *normal = across.unwrap_or_default().into();
        });
        for (&vertex, place) in self.border.iter().zip(self.positions.apply(control)) {
            positions[vertex as usize] = place;
        }
        let limit = mesh.with_positions(positions)?;
        let odd = self.border.iter().map(|&vertex| [vertex, self.limit.starts[vertex as usize]]);
        let (odd, tangents) = (Vec::from_iter(odd), (&self.tangents, &self.sides[..]));
        complete_normals(&mut normals, &limit, control, &self.limit.mesh, &odd, tangents);
        limit.without("normal").with_vertex("normal", Attribute::Vector(normals.into()))
    }

    /// How many bytes it holds.
    pub(crate) fn size(&self) -> usize {
        let rows = self.positions.size() + self.tangents.size() + self.sides.size();
        let lists = self.limit.starts.len() + self.border.len();
        self.limit.mesh.size() + self.rings.size() + 4 * lists + rows
    }
}
