//! Where the faces of a mesh are: roughly, but without a look at each of them.

use std::ops::Range;

use crate::mesh::Faces;
use crate::parallel::*;

/// Faces of a block.
const FACES: usize = 256;

/// Vertices of a bin.
pub(crate) const BIN: usize = 4096;

/// For each block of faces, the bins in which its corners are.
#[derive(Debug)]
pub(crate) struct Spread(Vec<Box<[u32]>>);

impl Spread {
    pub(in crate::mesh) fn new(faces: &Faces) -> Self {
        let corners = faces.corners();
        let bins = corners.iter().max().map_or(0, |&last| last as usize / BIN + 1);
        let of_block = |last: &mut Vec<u32>, block: usize| {
            let faces_of = faces_of(block, faces);
            let mut found = Vec::new();
            for &vertex in
                &corners[faces.first_corner(faces_of.start)..faces.first_corner(faces_of.end)]
            {
                let bin = vertex as usize / BIN;
                if last[bin] != block as u32 {
                    last[bin] = block as u32;
                    found.push(bin as u32);
                }
            }
            found.into_boxed_slice()
        };
        let blocks = (0..faces.len().div_ceil(FACES)).into_par_iter();
        Self(blocks.map_init(|| vec![u32::MAX; bins], of_block).collect())
    }

    /// The faces of which `is_wanted` is true, in order; those that have no corner in one of these bins are not looked at.
    pub(in crate::mesh) fn faces(
        &self,
        faces: &Faces,
        bins: &[bool],
        is_wanted: impl Fn(&[u32]) -> bool + Copy + Send + Sync,
    ) -> Vec<u32> {
        let blocks: Vec<_> = (0..self.0.len())
            .filter(|&block| self.0[block].iter().any(|&bin| bins[bin as usize]))
            .collect();
        let found = blocks.par_iter().with_min_len(16).map(|&block| {
            let found = faces_of(block, faces).filter(|&face| is_wanted(faces.face(face)));
            found.map(|face| face as u32).collect::<Vec<_>>()
        });
        found.collect::<Vec<_>>().concat()
    }
}

fn faces_of(block: usize, faces: &Faces) -> Range<usize> {
    block * FACES..faces.len().min((block + 1) * FACES)
}
