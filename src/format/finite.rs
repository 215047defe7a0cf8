//! Handling of coordinates that are NaN or infinite: sensors and programs write NaN for missing values.

use maquette_node::importers::InputFile;
use maquette_value::{Mesh, Points, first_not_finite};
use nalgebra::Point3;

/// Marks the points of a file with finite coordinates. The mask is `None` if all points are finite.
pub(super) struct FiniteMask(Option<Vec<bool>>);

impl FiniteMask {
    /// Finds the points with finite coordinates. Moves all other points to the origin; the elements that use these points are left out
    /// later.
    pub(super) fn clear_non_finite(points: &mut [Point3<f64>]) -> Self {
        if first_not_finite(points).is_none() {
            return Self(None);
        }
        fn is_finite(point: &Point3<f64>) -> bool {
            point.coords.iter().all(|x| x.is_finite())
        }
        let finite = points.iter().map(is_finite).collect();
        points.iter_mut().filter(|point| !is_finite(point)).for_each(|it| *it = Point3::origin());
        Self(Some(finite))
    }

    /// Returns true if the point at `index` was finite.
    pub(super) fn contains(&self, index: usize) -> bool {
        self.0.as_ref().is_none_or(|finite| finite[index])
    }

    /// Returns the number of points that were not finite.
    pub(super) fn n_left_out(&self) -> usize {
        self.0.iter().flatten().filter(|finite| !**finite).count()
    }

    /// Removes the entries that belong to points that were not finite.
    pub(super) fn retain<T>(&self, entries: &mut Vec<T>) {
        let mut index = 0;
        entries.retain(|_| {
            index += 1;
            self.contains(index - 1)
        });
    }

    /// Removes the points that were not finite.
    pub(super) fn points(&self, points: Points) -> Points {
        let Some(finite) = &self.0 else { return points };
        let kept = (0..).zip(finite).filter(|(_, finite)| **finite).map(|(index, _)| index);
        points.select(&kept.collect::<Vec<_>>())
    }

    /// Removes the faces that have a corner that was not finite. Returns the mesh and the number of faces that were removed.
    pub(super) fn mesh(&self, mesh: Mesh) -> (Mesh, usize) {
        let Some(finite) = &self.0 else { return (mesh, 0) };
        fn is_kept(face: &[u32], finite: &[bool]) -> bool {
            face.iter().all(|&vertex| finite[vertex as usize])
        }
        let kept = (0..).zip(mesh.faces().iter()).filter(|(_, face)| is_kept(face, finite));
        let kept: Vec<_> = kept.map(|(index, _)| index).collect();
        (mesh.select(&kept), mesh.faces().len() - kept.len())
    }
}

/// Replaces entries that are NaN or infinite by zeros, which represent missing values. Returns a note on the replaced entries for which
/// `is_kept` is true.
pub(super) fn replace_non_finite<const N: usize>(
    entries: &mut [[f64; N]],
    name: &str,
    element: &str,
    is_kept: impl Fn(usize) -> bool,
) -> Option<String> {
    let mut n_replaced = 0;
    for (index, entry) in entries.iter_mut().enumerate() {
        if entry.iter().any(|x| !x.is_finite()) {
            *entry = [0.0; N];
            n_replaced += usize::from(is_kept(index));
        }
    }
    (n_replaced > 0).then(|| match n_replaced {
        1 => format!("`{name}` of 1 {element} is NaN or infinite: there is a zero in place of it"),
        more => {
            let element =
                if element == "vertex" { "vertices".to_owned() } else { format!("{element}s") };
            format!(
                "`{name}` of {more} {element} is NaN or infinite: there are zeros in place of it"
            )
        }
    })
}

/// Returns a note on elements that were left out, or `None` if there are none. `what` is the singular name of such an element.
pub(super) fn left_out_note(left_out: usize, what: &str) -> Option<String> {
    let left_out = match left_out {
        0 => return None,
        1 => format!("1 {what} is left out"),
        more => format!("{more} {what}s are left out"),
    };
    Some(format!("{left_out}: a coordinate is NaN or infinite"))
}

/// Adds the note of [`left_out_note`] to the warnings of a file.
pub(super) fn warn_left_out(file: &InputFile<'_>, left_out: usize, what: &str) {
    left_out_note(left_out, what).into_iter().for_each(|note| file.warn(note));
}
