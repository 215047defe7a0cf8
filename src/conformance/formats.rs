//! The law of formats that make large files in pieces: they are those of the whole file, wherever they begin and end.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::pack::Format;
use crate::value::AnyValue;

/// Pieces of so many bytes are asked for: none of them ends where rows do.
const PIECES: [usize; 3] = [1, 61, 4099];

/// Checks a format with the hostile values of its type.
pub(super) fn check(format: &Format, broken: &mut Vec<String>) {
    for value in (format.kind)().hostile() {
        if let Some(why) = catch_unwind(AssertUnwindSafe(|| wrong(format, &value))).unwrap_or(None)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::format::FORMATS;
    use crate::pack::{Content, FileFormat, NewFile, format};
    use crate::value::Mask;

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
            _: Option<&crate::Signature>,
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
}
