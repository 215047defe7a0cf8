//! The laws of readers of files: whatever bytes they are given, they give a value or an error.

use std::panic::{AssertUnwindSafe, catch_unwind};

use maquette_graph::catalog::Catalog;
use maquette_node::reading::{AnyReader, Reading};

/// At so many places a file is cut, and at so many a byte of it is another one.
const PLACES: usize = 24;

/// Checks a reader with files that the pack's own format writes of hard values, whole and damaged, and with bytes that are no file at all.
pub(super) fn check(reader: &AnyReader, catalog: &Catalog, broken: &mut Vec<String>) {
    let kind = reader.kind();
    for ending in reader.endings {
        if ending.is_empty() || ending.contains('.') || **ending != ending.to_lowercase() {
            broken.push(format!("`{ending}` is no ending: lower case, without the dot"));
        }
        let name = format!("file.{ending}");
        let written = kind.hostile().into_iter().filter_map(|value| {
            let files = catch_unwind(AssertUnwindSafe(|| catalog.write(&value, &name)));
            Some(files.ok()?.ok()?.swap_remove(0).bytes)
        });
        let noise = [Vec::new(), vec![0; 100], vec![0xff; 100], b"1 ".repeat(100)];
        let files: Vec<_> = noise.into_iter().chain(written).collect();
        let damaged = files.iter().flat_map(|file| damaged(file));
        fn reads(bytes: &[u8], name: &str, reader: &AnyReader) -> bool {
            let file = Reading::alone(name, bytes);
            catch_unwind(AssertUnwindSafe(|| {
                reader.ask_companions(&file);
                drop(reader.call(&file));
            }))
            .is_ok()
        }
        if let Some(bytes) =
            files.iter().cloned().chain(damaged).find(|bytes| !reads(bytes, &name, reader))
        {
            let start = String::from_utf8_lossy(&bytes[..bytes.len().min(60)]).into_owned();
            let (kind, count) = (kind.name, bytes.len());
            broken.push(format!(
                "reading a {kind} from a `.{ending}` file of {count} bytes panics; it begins with {start:?}"
            ));
        }
    }
}

/// Versions of a file, cut and with other bytes.
fn damaged(file: &[u8]) -> impl Iterator<Item = Vec<u8>> + '_ {
    let places = (0..PLACES.min(file.len())).map(|k| k * file.len() / PLACES.min(file.len()));
    places.flat_map(move |place| {
        let mut bent = file.to_vec();
        bent[place] = bent[place].wrapping_add(97);
        [file[..place].to_vec(), bent]
    })
}

#[cfg(test)]
mod tests {
    use maquette_format::READERS;
    use maquette_node::reading::{FileReader, reader};
    use maquette_syntax::error::Error;
    use maquette_value::Mask;

    use super::*;

    struct Careless;

    impl FileReader for Careless {
        type Value = Mask;
        const ENDINGS: &'static [&'static str] = &["png"];

        fn read(file: &Reading<'_>) -> Result<Mask, Error> {
            let width = usize::from(file.bytes()[20]);
            Ok(Mask::new(width, 1, vec![1; width])?)
        }
    }

    #[test]
    fn a_reader_that_panics_on_a_short_file_is_told() {
        let mut broken = Vec::new();
        check(&reader::<Careless>(), &Catalog::new(&[]), &mut broken);
        assert_eq!(broken.len(), 1, "{broken:?}");
        assert!(broken[0].contains("reading a Mask from a `.png` file of 0 bytes panics"));
    }

    #[test]
    fn all_readers_of_the_engine_keep_the_law() {
        let mut broken = Vec::new();
        let catalog = Catalog::new(&[&maquette_format::PACK]);
        READERS.iter().for_each(|reader| check(reader, &catalog, &mut broken));
        assert_eq!(broken, [""; 0]);
    }
}
