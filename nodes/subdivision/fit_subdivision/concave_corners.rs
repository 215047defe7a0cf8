//! Corners at which a smooth surface folds.

use maquette_value::{Mesh, MeshError};
use nalgebra::Vector3;

use super::net::{Net, SHARP};

/// The sine of how much more than 180 degrees a sector of a corner may have: 3 degrees.
const MOST_SINE: f64 = 0.052_335_956_242_943_83;

/// The mesh with sharp edges that cut the sectors of its corners that fold, and whether there are any.
///
/// Where three sharp edges meet or more, the directions of two neighboring ones span the tangent plane of the sector between, of which the
/// surface takes the side below 180 degrees, whatever its control faces do: Biermann, Levin and Zorin, "Piecewise smooth subdivision
/// surfaces with normal control" (2000). A flat face around the corner of a hole would begin in the hole. Two sectors below 180
/// degrees, with a sharp edge between that nobody sees there, do not.
///
/// # Errors
/// If a place is infinite.
pub(super) fn cut_concave_corners(mesh: &Mesh) -> Result<(Mesh, bool), MeshError> {
    let mut net = Net::new(mesh);
    let mut has_cut = false;
    loop {
        let mut cuts = Vec::new();
        for vertex in 0..net.places.len() as u32 {
            for sector in net.sectors(vertex) {
                Sector { net: &net, vertex, ends: &sector }.cut(&mut cuts);
            }
        }
        if cuts.is_empty() {
            return Ok((net.mesh()?.0.with_frame(mesh.frame().copied()), has_cut));
        }
        // What was a crease at the other end may have become a corner.
        cuts.into_iter().for_each(|edge| net.sharpen(edge, SHARP));
        has_cut = true;
    }
}

/// The faces of a vertex from one sharp edge to the next.
#[derive(Clone, Copy)]
struct Sector<'a> {
    net: &'a Net,
    vertex: u32,
    /// The other ends of its edges, in order.
    ends: &'a [u32],
}

impl<'a> Sector<'a> {
    fn spoke(&self, place: usize) -> Vector3<f64> {
        self.net.places[self.ends[place] as usize] - self.net.places[self.vertex as usize]
    }

    /// Whether its first and last edge span a plane that looks away from its faces.
    fn folds(&self) -> bool {
        let last = self.ends.len() - 1;
        let spanned = self.spoke(0).cross(&self.spoke(last));
        let normal: Vector3<f64> = (0..last).map(|k| self.spoke(k).cross(&self.spoke(k + 1))).sum();
        let lengths = self.spoke(0).norm() * self.spoke(last).norm() * normal.norm();
        spanned.dot(&normal) < -MOST_SINE * lengths
    }

    fn angle(&self) -> f64 {
        (1..self.ends.len()).map(|k| self.spoke(k - 1).angle(&self.spoke(k))).sum()
    }

    /// The sectors on both sides of an edge.
    fn halves(&self, place: usize) -> [Self; 2] {
        [&self.ends[..=place], &self.ends[place..]].map(|ends| Self { ends, ..*self })
    }

    /// Adds the edges that are to cut it: such as leave no fold, then such as end at no crease, which they would bend, then the middle one.
    fn cut(&self, cuts: &mut Vec<[u32; 2]>) {
        if self.ends.len() < 3 || !self.folds() {
            return;
        }
        let judged = (1..self.ends.len() - 1).map(|place| {
            let halves = self.halves(place);
            let folds = halves.iter().filter(|half| half.folds()).count();
            let is_crease = self.net.sharp_neighbors(self.ends[place]).len() == 2;
            let larger = f64::max(halves[0].angle(), halves[1].angle());
            (place, (folds, is_crease), larger)
        });
        let best = judged.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)));
        if let Some((place, ..)) = best {
            cuts.push([self.vertex, self.ends[place]]);
            self.halves(place).iter().for_each(|half| half.cut(cuts));
        }
    }
}
