//! Checks that triangles in the plane face up and do not overlap.

use maquette_base::topology::lists::Lists;
use maquette_value::parallel::*;
use nalgebra::Vector2;
use robust::{Coord, orient2d};

/// Minimum number of items for which a part of a loop is worth it.
const MIN_PART: usize = 2048;

fn side(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    let [a, b, c] = [a, b, c].map(|it| Coord { x: it.x, y: it.y });
    orient2d(a, b, c)
}

/// Returns true if all triangles are counter-clockwise, and no two of them share more than a part of their borders. Uses exact predicates
/// (Shewchuk, "Adaptive precision floating-point arithmetic and fast robust geometric predicates", 1997).
pub(super) fn are_free_of_overlaps(triangles: &[[u32; 3]], places: &[Vector2<f64>]) -> bool {
    let triangles = triangles.par_iter().with_min_len(MIN_PART);
    let all: Vec<_> = triangles.map(|triangle| triangle.map(|it| places[it as usize])).collect();
    all.par_iter().with_min_len(MIN_PART).all(|&[a, b, c]| side(a, b, c) > 0.0)
        && overlap(&all).is_none()
}

/// Finds two counter-clockwise triangles whose interiors overlap, that is, no side of either triangle separates them. Only triangles in the
/// same cell of a grid are compared.
pub(crate) fn overlap(triangles: &[[Vector2<f64>; 3]]) -> Option<[u32; 2]> {
    let boxes =
        triangles.iter().map(|[a, b, c]| [a.inf(b).inf(c), a.sup(b).sup(c)]).collect::<Vec<_>>();
    let whole = boxes.iter().copied().reduce(|a, b| [a[0].inf(&b[0]), a[1].sup(&b[1])])?;
    let size = whole[1] - whole[0];
    // The grid has about as many cells as there are triangles.
    let cell = (size.x * size.y / triangles.len() as f64).sqrt();
    let counts =
        [0, 1].map(|axis| ((size[axis] / cell).ceil() as usize).clamp(1, 2 * triangles.len()));
    fn cell_of(
        at: Vector2<f64>,
        whole: &[Vector2<f64>; 2],
        size: Vector2<f64>,
        counts: [usize; 2],
    ) -> [usize; 2] {
        [0, 1].map(|axis| {
            let place = (at[axis] - whole[0][axis]) / size[axis] * counts[axis] as f64;
            (place as usize).min(counts[axis] - 1)
        })
    }
    let lists = Lists::group(counts[0] * counts[1], || {
        (0u32..).zip(&boxes).flat_map(|(number, &[low, high])| {
            let [left, bottom] = cell_of(low, &whole, size, counts);
            let [right, top] = cell_of(high, &whole, size, counts);
            (bottom..=top).flat_map(move |row| {
                (left..=right).map(move |column| ((row * counts[0] + column) as u32, number))
            })
        })
    });
    let (boxes, lists) = (&boxes, &lists);
    let cells = (0..lists.len()).into_par_iter().with_min_len(MIN_PART);
    cells.find_map_first(|own| {
        let list = lists.list(own);
        let mut pairs =
            (0..list.len()).flat_map(|k| list[k + 1..].iter().map(move |&other| [list[k], other]));
        pairs.find(|&[a, b]| {
            let [one, other] = [a, b].map(|it| boxes[it as usize]);
            // Test each pair only once: in the cell that contains the lower corner of the intersection of the two bounding boxes.
            let [column, row] = cell_of(one[0].sup(&other[0]), &whole, size, counts);
            let is_apart =
                (0..2).any(|axis| one[1][axis] <= other[0][axis] || other[1][axis] <= one[0][axis]);
            !is_apart
                && row * counts[0] + column == own
                && meet(triangles[a as usize], triangles[b as usize])
        })
    })
}

/// Returns true if the interiors of two counter-clockwise triangles intersect.
fn meet(one: [Vector2<f64>; 3], other: [Vector2<f64>; 3]) -> bool {
    fn parts(from: [Vector2<f64>; 3], it: [Vector2<f64>; 3]) -> bool {
        (0..3).any(|k| it.iter().all(|&at| side(from[k], from[(k + 1) % 3], at) <= 0.0))
    }
    !parts(one, other) && !parts(other, one)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [[f64; 2]; 3]) -> [Vector2<f64>; 3] {
        corners.map(Vector2::from)
    }

    #[test]
    fn only_insides_overlap() {
        let own = triangle([[0., 0.], [4., 0.], [0., 4.]]);
        fn check(other: [[f64; 2]; 3], expected: bool, own: [Vector2<f64>; 3]) {
            let other = triangle(other);
            assert_eq!(overlap(&[own, other]).is_some(), expected, "{other:?}");
            assert_eq!(overlap(&[other, own]).is_some(), expected, "{other:?}");
        }
        // The triangles touch in a side, in a part of a side, in a corner, or not at all.
        check([[4., 0.], [4., 4.], [0., 4.]], false, own);
        check([[1., 0.], [2., -3.], [3., 0.]], false, own);
        check([[4., 0.], [8., 0.], [8., 1.]], false, own);
        check([[9., 0.], [10., 0.], [9., 1.]], false, own);
        // The triangles are equal, nested, crossing, or overlap by the smallest possible amount.
        check([[0., 0.], [4., 0.], [0., 4.]], true, own);
        check([[1., 1.], [2., 1.], [1., 2.]], true, own);
        check([[-1., 1.], [5., 1.], [5., 2.]], true, own);
        check([[2.0f64.next_down(), 2.0], [5., 3.], [3., 5.]], true, own);
        check([[2.0, 2.0], [5., 3.], [3., 5.]], false, own);
    }

    #[test]
    fn flipped_triangles_are_overlaps() {
        let places = [[0., 0.], [1., 0.], [0., 1.], [1., 1.]].map(Vector2::from);
        assert!(are_free_of_overlaps(&[[0, 1, 2], [1, 3, 2]], &places));
        assert!(!are_free_of_overlaps(&[[0, 1, 2], [1, 2, 3]], &places));
        assert!(!are_free_of_overlaps(&[[0, 1, 2], [0, 1, 3]], &places));
        assert!(are_free_of_overlaps(&[], &places));
    }
}
