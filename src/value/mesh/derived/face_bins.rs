//! A coarse index from vertices to faces. With it, the faces at some vertices are found without a scan of all faces.

use std::ops::Range;

use crate::mesh::Faces;
use crate::parallel::*;

/// The number of faces per block.
const FACES: usize = 256;

/// The number of consecutive vertices per bin.
pub(crate) const BIN: usize = 4096;

/// For each block of faces, the bins that contain the vertices of these faces.
#[derive(Debug)]
pub(crate) struct FaceBins(Vec<Box<[u32]>>);

impl FaceBins {
    pub(in crate::mesh) fn new(faces: &Faces) -> Self {
        let corners = faces.corners();
        let bins = corners.iter().max().map_or(0, |&last| last as usize / BIN + 1);
        let blocks = (0..faces.len().div_ceil(FACES)).into_par_iter();
        let bins_of_blocks = blocks.map_init(
            || vec![u32::MAX; bins],
            |last_block: &mut Vec<u32>, block: usize| bins_of_block(faces, block, last_block),
        );
        Self(bins_of_blocks.collect())
    }

    /// The faces for which `is_wanted` is true, in order. Only the blocks of faces that use a vertex in one of the given bins are scanned.
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

/// The bins that contain the vertices of a block. `last_block` holds, for each bin, the last block for which the bin was listed, so that no
/// bin is listed twice.
fn bins_of_block(faces: &Faces, block: usize, last_block: &mut [u32]) -> Box<[u32]> {
    let rows = faces_of(block, faces);
    let corners = faces.first_corner(rows.start)..faces.first_corner(rows.end);
    let mut bins = Vec::new();
    for &vertex in &faces.corners()[corners] {
        let bin = vertex as usize / BIN;
        if last_block[bin] != block as u32 {
            last_block[bin] = block as u32;
            bins.push(bin as u32);
        }
    }
    bins.into_boxed_slice()
}

fn faces_of(block: usize, faces: &Faces) -> Range<usize> {
    block * FACES..faces.len().min((block + 1) * FACES)
}
