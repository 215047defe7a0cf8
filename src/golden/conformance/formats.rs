//! Law 14: if a file format encodes large files in pieces, the pieces equal the corresponding parts of the whole file, wherever they begin
//! and end.

use std::panic::{AssertUnwindSafe, catch_unwind};

use maquette_node::pack::Format;
use maquette_value::AnyValue;
use maquette_value::rng::Random;

use super::updates::change_numbers;

/// The sizes of pieces to test, in bytes. None of them is a multiple of the size of a row.
const PIECES: [usize; 3] = [1, 61, 4099];

/// Checks a format with edge cases of its value type.
pub(super) fn check(format: &Format, broken: &mut Vec<String>) {
    for value in (format.kind)().edge_cases() {
        if let Some(why) = catch_unwind(AssertUnwindSafe(|| {
            piece_mismatch(format, &value).or_else(|| false_source_claim(format, &value))
        }))
        .unwrap_or(None)
        {
            broken.push(format!("`.{}`: {why}, with {value:?}", format.extension));
        }
    }
}

/// Returns a description of how a value's file in pieces differs from the whole file, or `None` if they are equal.
fn piece_mismatch(format: &Format, value: &AnyValue) -> Option<String> {
    let whole = format.write(value, "file");
    let content = match format.content(value) {
        Ok(content) => content?,
        Err(_) if whole.is_err() => return None,
        Err(error) => return Some(format!("in pieces it cannot be written: {error}")),
    };
    let Ok([file]) = whole.as_deref() else {
        return Some("it has pieces, but is not one file as a whole".into());
    };
    if content.len() != file.bytes.len() {
        return Some(format!("{} bytes in pieces, {} as a whole", content.len(), file.bytes.len()));
    }
    let size = PIECES.into_iter().find(|&size| {
        let mut bytes = vec![0xa5; file.bytes.len()];
        let pieces = bytes.chunks_mut(size).enumerate();
        pieces.for_each(|(k, piece)| content.fill(k * size, piece));
        bytes != file.bytes
    })?;
    Some(format!("pieces of {size} bytes are not those of the whole"))
}

/// The number of changes that are tested with each value.
const CHANGES: usize = 12;

/// Returns a description of two pieces that differ although they claim to have the same source, or `None` if there are none.
fn false_source_claim(format: &Format, value: &AnyValue) -> Option<String> {
    let before = format.content(value).ok()??;
    let mut dice = Random(0);
    (0..CHANGES).find_map(|_| {
        let changed = change_numbers(value, &mut dice)?;
        let now = format.content(&changed).ok()??;
        let common = before.len().min(now.len());
        let size = PIECES[1 + dice.next_below(PIECES.len() - 1)];
        let mut stretches = (0..common).step_by(size).map(|k| k..common.min(k + size));
        let wrong = stretches.find(|stretch| {
            let [a, b] = [&before, &now].map(|content| {
                let mut bytes = vec![0; stretch.len()];
                content.fill(stretch.start, &mut bytes);
                (content.range_hash(stretch.clone()), bytes)
            });
            a.0.is_some() && a.0 == b.0 && a.1 != b.1
        })?;
        Some(format!("bytes {wrong:?} have the same source as those of another value, {changed:?}, but differ"))
    })
}

#[cfg(test)]
mod tests {
    use maquette_format::FORMATS;
    use maquette_node::pack::{Content, FileFormat, NewFile, format};
    use maquette_syntax::error::Error;
    use maquette_value::{Hash, Mask, Mesh};

    use super::*;

    #[test]
    fn pieces_of_all_formats_are_those_of_the_whole_file() {
        let mut broken = Vec::new();
        FORMATS.iter().for_each(|format| check(format, &mut broken));
        assert_eq!(broken, [""; 0]);
    }

    /// A faulty format for the test: its pieces depend on the position at which they begin.
    struct PositionDependent;

    impl FileFormat for PositionDependent {
        type Value = Mask;
        const EXTENSION: &'static str = "late";

        fn write(_: &Mask, name: &str) -> Result<Vec<NewFile>, Error> {
            Ok(NewFile::single(name, vec![1; 100]))
        }

        fn content<'a>(
            _: &'a Mask,
            _: Option<&maquette_node::provenance::Signature>,
        ) -> Result<Option<Content<'a>>, Error> {
            Ok(Some(Content::pieces(100, |place, bytes| bytes.fill(u8::from(place < 90)))))
        }
    }

    #[test]
    fn pieces_that_depend_on_their_position_are_reported() {
        let mut broken = Vec::new();
        check(&format::<PositionDependent>(), &mut broken);
        assert!(broken[0].starts_with("`.late`: pieces of 1 bytes are not"), "{broken:?}");
    }

    /// A faulty format for the test: it claims that all pieces have the same source.
    struct ConstantSource;

    impl FileFormat for ConstantSource {
        type Value = Mesh;
        const EXTENSION: &'static str = "same";

        fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
            let places: Vec<[f64; 3]> =
                mesh.positions().iter().map(|it| it.coords.into()).collect();
            Ok(NewFile::single(name, bytemuck::cast_slice(&places).to_vec()))
        }

        fn content<'a>(
            mesh: &'a Mesh,
            _: Option<&maquette_node::provenance::Signature>,
        ) -> Result<Option<Content<'a>>, Error> {
            let bytes = Self::write(mesh, "")?.remove(0).bytes;
            let len = size_of_val(&mesh.positions()[..]);
            Ok(Some(
                Content::pieces(len, move |place: usize, piece: &mut [u8]| {
                    piece.copy_from_slice(&bytes[place..][..piece.len()]);
                })
                .made_of(|_| Hash::compute(b"mesh")),
            ))
        }
    }

    #[test]
    fn false_claims_of_a_common_source_are_reported() {
        let mut broken = Vec::new();
        check(&format::<ConstantSource>(), &mut broken);
        assert!(broken[0].contains("have the same source as those of another value"), "{broken:?}");
    }
}
