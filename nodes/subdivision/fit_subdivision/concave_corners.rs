//! Detection and repair of corners at which the limit surface folds.

use maquette_value::{Mesh, MeshError};
use nalgebra::Vector3;

use super::net::{Net, SHARP};

/// The sine of 3 degrees, the maximum angle by which a sector may exceed 180 degrees.
const MAX_SINE: f64 = 0.052_335_956_242_943_83;

/// Adds sharp edges that divide each folding sector (the faces of a vertex between two neighboring sharp edges). Also returns true if it
/// has added any.
///
/// At a vertex with three or more sharp edges, two neighboring sharp edges span the tangent plane of the sector between them. The limit
/// surface always covers the side on which the angle is less than 180 degrees, independent of the control faces: Biermann, Levin and Zorin,
/// "Piecewise smooth subdivision surfaces with normal control" (2000). A flat face around the corner of a hole has a sector of more than
/// 180 degrees, and its surface would thus begin inside the hole. If a sharp edge divides this sector into two of less than 180 degrees,
/// neither of them folds, and the edge is not visible in a flat face.
///
/// # Errors
/// If a position is infinite.
pub(super) fn cut_concave_corners(mesh: &Mesh) -> Result<(Mesh, bool), MeshError> {
    let mut net = Net::new(mesh);
    let mut has_cut = false;
    loop {
        let mut cuts = Vec::new();
        for vertex in 0..net.positions.len() as u32 {
            for sector in net.sectors(vertex) {
                Sector { net: &net, vertex, ends: &sector }.cut(&mut cuts);
            }
        }
        if cuts.is_empty() {
            return Ok((net.mesh()?.0.with_frame(mesh.frame().copied()), has_cut));
        }
        // A cut may have changed the vertex at the other end of the new sharp edge from a crease to a corner, so all vertices are checked
        // again.
        cuts.into_iter().for_each(|edge| net.sharpen(edge, SHARP));
        has_cut = true;
    }
}

/// A sector: the faces of a vertex from one sharp edge to the next.
#[derive(Clone, Copy)]
struct Sector<'a> {
    net: &'a Net,
    vertex: u32,
    /// The vertices at the other ends of the edges from the sector's vertex, in order around the vertex.
    ends: &'a [u32],
}

impl<'a> Sector<'a> {
    fn spoke(&self, index: usize) -> Vector3<f64> {
        self.net.positions[self.ends[index] as usize] - self.net.positions[self.vertex as usize]
    }

    /// Returns true if the normal of the plane spanned by the sector's first and last edge is opposite to the normal of the sector's faces.
    fn folds(&self) -> bool {
        let last = self.ends.len() - 1;
        let spanned = self.spoke(0).cross(&self.spoke(last));
        let normal: Vector3<f64> = (0..last).map(|k| self.spoke(k).cross(&self.spoke(k + 1))).sum();
        let lengths = self.spoke(0).norm() * self.spoke(last).norm() * normal.norm();
        spanned.dot(&normal) < -MAX_SINE * lengths
    }

    fn angle(&self) -> f64 {
        (1..self.ends.len()).map(|k| self.spoke(k - 1).angle(&self.spoke(k))).sum()
    }

    /// Divides the sector into two at an edge.
    fn halves(&self, index: usize) -> [Self; 2] {
        [&self.ends[..=index], &self.ends[index..]].map(|ends| Self { ends, ..*self })
    }

    /// Adds to `cuts` the edges that divide the sector. Prefers edges that leave no fold, then edges whose other end is not on a crease (a
    /// sharp edge would bend the crease), then edges near the middle.
    fn cut(&self, cuts: &mut Vec<[u32; 2]>) {
        if self.ends.len() < 3 || !self.folds() {
            return;
        }
        let judged = (1..self.ends.len() - 1).map(|index| {
            let halves = self.halves(index);
            let folds = halves.iter().filter(|half| half.folds()).count();
            let is_crease = self.net.sharp_neighbors(self.ends[index]).len() == 2;
            let larger = f64::max(halves[0].angle(), halves[1].angle());
            (index, (folds, is_crease), larger)
        });
        let best = judged.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)));
        if let Some((index, ..)) = best {
            cuts.push([self.vertex, self.ends[index]]);
            self.halves(index).iter().for_each(|half| half.cut(cuts));
        }
    }
}
