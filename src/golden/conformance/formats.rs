//! The law of formats that make large files in pieces: they are those of the whole file, wherever they begin and end.

use std::panic::{AssertUnwindSafe, catch_unwind};

use maquette_node::pack::Format;
use maquette_value::AnyValue;
use maquette_value::random::Random;

use super::updates::changed;

/// Pieces of so many bytes are asked for: none of them ends where rows do.
const PIECES: [usize; 3] = [1, 61, 4099];

/// Checks a format with the hostile values of its type.
pub(super) fn check(format: &Format, broken: &mut Vec<String>) {
    for value in (format.kind)().hostile() {
        if let Some(why) = catch_unwind(AssertUnwindSafe(|| {
            wrong(format, &value).or_else(|| mistaken(format, &value))
        }))
        .unwrap_or(None)
        {
            broken.push(format!("`.{}`: {why}, with {value:?}", format.ending));
        }
    }
}

/// How the pieces of a value's file are not what it writes.
fn wrong(format: &Format, value: &AnyValue) -> Option<String> {
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
    let differs = |&size: &usize| {
        let mut bytes = vec![0xa5; file.bytes.len()];
        let pieces = bytes.chunks_mut(size).enumerate();
        pieces.for_each(|(k, piece)| content.fill(k * size, piece));
        bytes != file.bytes
    };
    let size = PIECES.iter().find(|size| differs(size))?;
    Some(format!("pieces of {size} bytes are not those of the whole"))
}

/// So many changes are made to each value.
const CHANGES: usize = 12;

/// Two pieces that are not the same, but are said to be made of the same.
fn mistaken(format: &Format, value: &AnyValue) -> Option<String> {
    let before = format.content(value).ok()??;
    let mut dice = Random(0);
    (0..CHANGES).find_map(|_| {
        let changed = changed(value, &mut dice)?;
        let now = format.content(&changed).ok()??;
        let common = before.len().min(now.len());
        let size = PIECES[1 + dice.below(PIECES.len() - 1)];
        let mut stretches = (0..common).step_by(size).map(|k| k..common.min(k + size));
        let wrong = stretches.find(|stretch| {
            let [a, b] = [&before, &now].map(|content| {
                let mut bytes = vec![0; stretch.len()];
                content.fill(stretch.start, &mut bytes);
                (content.stretch(stretch.clone()), bytes)
            });
            a.0.is_some() && a.0 == b.0 && a.1 != b.1
        })?;
        Some(format!("bytes {wrong:?} are said to be those of another value, {changed:?}"))
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

    /// Makes pieces of other bytes if they begin late.
    struct Late;

    impl FileFormat for Late {
        type Value = Mask;
        const ENDING: &'static str = "late";

        fn write(_: &Mask, name: &str) -> Result<Vec<NewFile>, Error> {
            Ok(NewFile::only(name, vec![1; 100]))
        }

        fn content<'a>(
            _: &'a Mask,
            _: Option<&maquette_node::provenance::Signature>,
        ) -> Result<Option<Content<'a>>, Error> {
            Ok(Some(Content::pieces(100, |place, bytes| bytes.fill(u8::from(place < 90)))))
        }
    }

    #[test]
    fn pieces_that_hang_on_where_they_begin_are_told() {
        let mut broken = Vec::new();
        check(&format::<Late>(), &mut broken);
        assert!(broken[0].starts_with("`.late`: pieces of 1 bytes are not"), "{broken:?}");
    }

    /// Says of all that it is made of the same.
    struct Same;

    impl FileFormat for Same {
        type Value = Mesh;
        const ENDING: &'static str = "same";

        fn write(mesh: &Mesh, name: &str) -> Result<Vec<NewFile>, Error> {
            let places: Vec<[f64; 3]> =
                mesh.positions().iter().map(|it| it.coords.into()).collect();
            Ok(NewFile::only(name, bytemuck::cast_slice(&places).to_vec()))
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
                .made_of(|_| Hash::of(b"mesh")),
            ))
        }
    }

    #[test]
    fn pieces_that_are_said_to_be_made_of_the_same_and_are_not_are_told() {
        let mut broken = Vec::new();
        check(&format::<Same>(), &mut broken);
        assert!(broken[0].contains("are said to be those of another value"), "{broken:?}");
    }
}
