//! Work on the corners of faces, shared out among threads.

use std::ops::Range;

use maquette_value::Faces;
use maquette_value::parallel::*;

/// Elements that one task looks at: enough to outweigh the cost of giving it to a thread, some 10 us.
pub(crate) const BLOCK: usize = 4096;

/// Calls `f` with some of these faces at a time and the items of their corners, on all threads.
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
    Vec::from_iter(blocks).into_par_iter().for_each(|(here, items)| f(here, items));
}
