//! Parallel iteration over the corners of faces.

use std::ops::Range;

use maquette_value::Faces;
use maquette_value::parallel::*;

/// The number of items per parallel task: enough to outweigh the cost of starting a task, about 10 us.
pub(crate) const BLOCK: usize = 4096;

/// Calls `f` in parallel with blocks of faces, each with the slice of items for the corners of these faces.
pub(crate) fn by_faces<T: Send>(
    faces: &Faces,
    which: Range<usize>,
    mut items: &mut [T],
    f: impl Fn(Range<usize>, &mut [T]) + Sync,
) {
    let blocks = which.clone().step_by(BLOCK).map(|first| {
        let here = first..which.end.min(first + BLOCK);
        let count = faces.first_corner(here.end) - faces.first_corner(first);
        (here, items.split_off_mut(..count).expect("an item for each corner"))
    });
    blocks.collect::<Vec<_>>().into_par_iter().for_each(|(here, items)| f(here, items));
}
