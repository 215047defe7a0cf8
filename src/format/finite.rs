//! What is at no finite place: sensors and programs write NaN for what they could not tell.

use maquette_node::reading::Reading;
use maquette_value::{Mesh, Points, first_not_finite};
use nalgebra::Point3;

/// Which places of a file are finite.
pub(super) struct Finite(Option<Vec<bool>>);

impl Finite {
    /// Those that are; the others are put at the origin, until what is there is left out.
    pub(super) fn of(places: &mut [Point3<f64>]) -> Self {
        if first_not_finite(places).is_none() {
            return Self(None);
        }
        fn is_finite(place: &Point3<f64>) -> bool {
            place.coords.iter().all(|x| x.is_finite())
        }
        let finite = places.iter().map(is_finite).collect();
        places.iter_mut().filter(|place| !is_finite(place)).for_each(|it| *it = Point3::origin());
        Self(Some(finite))
    }

    /// Whether that of this number is.
    pub(super) fn contains(&self, index: usize) -> bool {
        self.0.as_ref().is_none_or(|finite| finite[index])
    }

    /// How many are not.
    pub(super) fn n_left_out(&self) -> usize {
        self.0.iter().flatten().filter(|finite| !**finite).count()
    }

    /// Drops the entries of those that are not.
    pub(super) fn retain<T>(&self, entries: &mut Vec<T>) {
        let mut index = 0;
        entries.retain(|_| {
            index += 1;
            self.contains(index - 1)
        });
    }

    /// The points at those that are.
    pub(super) fn points(&self, points: Points) -> Points {
        let Some(finite) = &self.0 else { return points };
        let kept = (0..).zip(finite).filter(|(_, finite)| **finite).map(|(index, _)| index);
        points.select(&Vec::from_iter(kept))
    }

    /// The mesh of the faces that have no corner elsewhere, and how many others there are.
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

/// Puts zeros in place of entries of an attribute that are NaN or infinite, which stand for none, and gives what is told of those that
/// are kept.
pub(super) fn mend<const N: usize>(
    entries: &mut [[f64; N]],
    name: &str,
    of: &str,
    is_kept: impl Fn(usize) -> bool,
) -> Option<String> {
    let mut broken = 0;
    for (index, entry) in entries.iter_mut().enumerate() {
        if entry.iter().any(|x| !x.is_finite()) {
            *entry = [0.0; N];
            broken += usize::from(is_kept(index));
        }
    }
    (broken > 0).then(|| match broken {
        1 => format!("`{name}` of 1 {of} is NaN or infinite: there is a zero in place of it"),
        more => {
            let of = if of == "vertex" { "vertices".to_owned() } else { format!("{of}s") };
            format!("`{name}` of {more} {of} is NaN or infinite: there are zeros in place of it")
        }
    })
}

/// What is told of so many that are left out, if any: `what` is the word for one.
pub(super) fn doubt(left_out: usize, what: &str) -> Option<String> {
    let left_out = match left_out {
        0 => return None,
        1 => format!("1 {what} is left out"),
        more => format!("{more} {what}s are left out"),
    };
    Some(format!("{left_out}: a coordinate is NaN or infinite"))
}

/// Tells that so many of a file are left out, if any.
pub(super) fn tell(file: &Reading<'_>, left_out: usize, what: &str) {
    doubt(left_out, what).into_iter().for_each(|doubt| file.doubt(doubt));
}
