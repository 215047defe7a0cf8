//! Borders of a grid's mesh without the steps of the grid.

use nalgebra::{Point3, Vector2, Vector3};

/// The vertices along the borders of a mesh of a grid.
pub(crate) struct Border {
    /// Each with the one before it and the one behind it, by index among themselves.
    beside: Vec<[u32; 2]>,
    /// Their indices in the mesh.
    vertices: Vec<u32>,
}

/// Shares of the way to the middle of both neighbors, in turn: Taubin, "A signal processing approach to fair surface design" (1995).
/// Waves shorter than some eight cells are removed, longer ones stay.
const SHARES: [f64; 2] = [0.5, -0.53];

impl Border {
    /// The borders of `faces`, each vertex of which is passed by one border at most. `may_be` says which vertices can lie there.
    pub(crate) fn new(faces: &[[u32; 3]], may_be: impl Fn(u32) -> bool) -> Self {
        let sides = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
        let mut edges: Vec<[u32; 2]> = (faces.iter().flat_map(sides))
            .filter(|&[from, to]| may_be(from) && may_be(to))
            .collect();
        edges.sort_unstable();
        let has = |edge: [u32; 2]| edges.binary_search(&edge).is_ok();
        let alone: Vec<[u32; 2]> = edges.iter().copied().filter(|&[a, b]| !has([b, a])).collect();
        let vertices: Vec<u32> = alone.iter().map(|&[from, _]| from).collect();
        let index = |vertex: u32| vertices.binary_search(&vertex).ok();
        let mut beside = vec![[u32::MAX; 2]; vertices.len()];
        for (from, &[_, to]) in alone.iter().enumerate() {
            let to = index(to).expect("a border goes on where it arrives");
            beside[from][1] = to as u32;
            beside[to][0] = from as u32;
        }
        Self { beside, vertices }
    }

    /// Smooths the borders `rounds` times: the vertices' positions, and with them their `places`, column and row in a grid of
    /// `size` = (width, height). No place moves by more than one cell, none on the border of the grid at all.
    pub(crate) fn smooth(
        &self,
        rounds: u32,
        size: [usize; 2],
        positions: &mut [Point3<f64>],
        places: &mut [[f64; 2]],
    ) {
        let at = |&vertex: &u32| {
            let vertex = vertex as usize;
            (positions[vertex].coords, Vector2::from(places[vertex]))
        };
        let old: Vec<(Vector3<f64>, Vector2<f64>)> = self.vertices.iter().map(at).collect();
        let on_rim = |place: &Vector2<f64>| {
            (0..2).any(|k| place[k] == 0.0 || place[k] + 1.0 == size[k] as f64)
        };
        let mut now = old.clone();
        for share in (0..rounds).flat_map(|_| SHARES) {
            let step = |(&[before, behind], here): (&[u32; 2], &(_, _))| {
                let (a, b): &(Vector3<f64>, Vector2<f64>) = here;
                let ((c, d), (e, f)) = (now[before as usize], now[behind as usize]);
                (a + ((c + e) / 2.0 - a) * share, b + ((d + f) / 2.0 - b) * share)
            };
            let next: Vec<_> = self.beside.iter().zip(&now).map(step).collect();
            now = next;
            for (now, old) in now.iter_mut().zip(&old).filter(|(_, old)| on_rim(&old.1)) {
                *now = *old;
            }
        }
        for ((&vertex, now), old) in self.vertices.iter().zip(now).zip(old) {
            let most = (now.1 - old.1).norm().max(1.0);
            positions[vertex as usize] = Point3::from(old.0 + (now.0 - old.0) / most);
            places[vertex as usize] = (old.1 + (now.1 - old.1) / most).into();
        }
    }
}
