//! Law 9: a reader of files returns a value or an error for any bytes.

use std::panic::{AssertUnwindSafe, catch_unwind};

use maquette_graph::catalog::Catalog;
use maquette_node::importers::{AnyReader, InputFile};

/// The number of positions at which a file is cut off, and also the number of positions at which a byte is changed.
const DAMAGE_POSITIONS: usize = 24;

/// Checks a reader with three kinds of files: edge cases that the pack's own format writes, damaged versions of these files, and bytes that
/// have nothing to do with the format.
pub(super) fn check(reader: &AnyReader, catalog: &Catalog, broken: &mut Vec<String>) {
    let kind = reader.kind();
    for ending in reader.extensions {
        if ending.is_empty() || ending.contains('.') || **ending != ending.to_lowercase() {
            broken.push(format!(
                "`{ending}` is not an extension: expected lower case, without the dot"
            ));
        }
        let name = format!("file.{ending}");
        let written = kind.edge_cases().into_iter().filter_map(|value| {
            let files = catch_unwind(AssertUnwindSafe(|| catalog.write(&value, &name)));
            Some(files.ok()?.ok()?.swap_remove(0).bytes)
        });
        let noise = [Vec::new(), vec![0; 100], vec![0xff; 100], b"1 ".repeat(100)];
        let files: Vec<_> = noise.into_iter().chain(written).collect();
        let damaged = files.iter().flat_map(|file| damaged_versions(file));
        fn returns(bytes: &[u8], name: &str, reader: &AnyReader) -> bool {
            let file = InputFile::standalone(name, bytes);
            catch_unwind(AssertUnwindSafe(|| {
                reader.ask_companions(&file);
                drop(reader.call(&file));
            }))
            .is_ok()
        }
        if let Some(bytes) =
            files.iter().cloned().chain(damaged).find(|bytes| !returns(bytes, &name, reader))
        {
            let start = String::from_utf8_lossy(&bytes[..bytes.len().min(60)]).into_owned();
            let (kind, count) = (kind.name, bytes.len());
            broken.push(format!(
                "reading a {kind} from a `.{ending}` file of {count} bytes panics; it begins with {start:?}"
            ));
        }
    }
}

/// Returns damaged versions of a file: some are cut off, and in others a byte is changed.
fn damaged_versions(file: &[u8]) -> impl Iterator<Item = Vec<u8>> + '_ {
    let places = (0..DAMAGE_POSITIONS.min(file.len()))
        .map(|k| k * file.len() / DAMAGE_POSITIONS.min(file.len()));
    places.flat_map(move |place| {
        let mut changed = file.to_vec();
        changed[place] = changed[place].wrapping_add(97);
        [file[..place].to_vec(), changed]
    })
}

#[cfg(test)]
mod tests {
    use maquette_format::READERS;
    use maquette_node::importers::{FileReader, reader};
    use maquette_syntax::error::Error;
    use maquette_value::Mask;

    use super::*;

    struct Careless;

    impl FileReader for Careless {
        type Value = Mask;
        const EXTENSIONS: &'static [&'static str] = &["png"];

        fn read(file: &InputFile<'_>) -> Result<Mask, Error> {
            let width = usize::from(file.bytes()[20]);
            Ok(Mask::new(width, 1, vec![1; width])?)
        }
    }

    #[test]
    fn a_reader_that_panics_on_a_short_file_is_reported() {
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
