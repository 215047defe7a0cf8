//! Handles (positions with target positions) as RON, JSON and CSV text, which may be written by hand or by a script.

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::{Error, Position};
use maquette_value::{Handle, HandleSpace, Handles};
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Value, json};

use super::excerpt;
use super::json::print;

/// The content of a RON or JSON file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    space: Option<HandleSpace>,
    handles: Vec<Handle>,
    /// The provenance of an output file; only the command `replay` reads it.
    #[serde(default, rename = "maquette")]
    _provenance: IgnoredAny,
}

impl Content {
    fn new(handles: Vec<Handle>) -> Self {
        Self { space: None, handles, _provenance: IgnoredAny }
    }
}

fn text(bytes: &[u8]) -> Result<&str, Error> {
    str::from_utf8(bytes).map_err(|_| Error::new("the file is not text in UTF-8"))
}

/// Reads the handles of a RON file: `Handles(space: World, handles: [(at: (0, 0, 0), to: (0, 0, 1), sigma: (1, 1, 1))])`. `to`, `sigma` and
/// `weight` are optional; if the file does not state the space, it is `space`. A plain list of handles is accepted, too.
///
/// Returns an error if the text is not such a file, a number is not finite, or a number that must be greater than 0 is not.
pub fn read_ron(bytes: &[u8], space: HandleSpace) -> Result<Handles, Error> {
    let text = text(bytes)?;
    fn syntax_error(offset: usize, message: &str, text: &str) -> Error {
        let line = Position::from_offset(text, offset).line;
        Error::new(format!("line {line}: {message}"))
    }
    let (tree, mistakes) = maquette_syntax::parse(text);
    if let Some(mistake) = mistakes.into_iter().next() {
        return Err(syntax_error(mistake.span.start, &mistake.message, text));
    }
    let content = match &tree.kind {
        maquette_syntax::Kind::List(_) => maquette_syntax::read_tree(&tree).map(Content::new),
        _ => maquette_syntax::read_tree(&tree),
    };
    let content = content.map_err(|error| {
        syntax_error(error.span.map_or(0, |span| span.start), &error.message, text)
    })?;
    Ok(Handles::new(content.space.unwrap_or(space), &content.handles)?)
}

/// Reads the handles of a JSON file: `{"space": "World", "handles": [{"at": [0, 0, 0], "to": [0, 0, 1]}]}`; see [`read_ron`].
///
/// # Errors
/// The errors of [`read_ron`].
pub fn read_json(bytes: &[u8], space: HandleSpace) -> Result<Handles, Error> {
    let is_list = text(bytes)?.trim_start().starts_with('[');
    let content = if is_list {
        serde_json::from_slice(bytes).map(Content::new)
    } else {
        serde_json::from_slice(bytes)
    };
    let content = content.map_err(|error| Error::new(format!("line {}: {error}", error.line())))?;
    Ok(Handles::new(content.space.unwrap_or(space), &content.handles)?)
}

/// The columns of a CSV file, in the order in which a handle's numbers are stored.
const COLUMNS: [&str; 10] =
    ["x", "y", "z", "to_x", "to_y", "to_z", "sigma_x", "sigma_y", "sigma_z", "weight"];

/// Reads the handles of a CSV file, one per line. The first line names the columns in any order: `x`, `y` and `z`, and optionally `weight`
/// and the triples `to_x`, `to_y`, `to_z` and `sigma_x`, `sigma_y`, `sigma_z`, each complete. An empty entry counts as not given.
///
/// # Errors
/// The errors of [`read_ron`].
pub fn read_csv(bytes: &[u8], space: HandleSpace) -> Result<Handles, Error> {
    let mut lines = text(bytes)?.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let first = lines.next().map_or("", |(_, line)| line);
    let mut columns = Vec::new();
    for name in first.split(',').map(str::trim) {
        let Some(column) = COLUMNS.iter().position(|known| *known == name) else {
            let name = excerpt(name.as_bytes());
            return Err(columns_error(&format!("found the unknown column `{name}`")));
        };
        if columns.contains(&column) {
            return Err(columns_error(&format!("`{name}` is given twice")));
        }
        columns.push(column);
    }
    if let Some(missing) = (0..3).find(|column| !columns.contains(column)) {
        return Err(columns_error(&format!("`{}` is missing", COLUMNS[missing])));
    }
    let handles: Result<Vec<Handle>, _> = lines
        .map(|(index, line)| {
            row(line, &columns)
                .map_err(|message| Error::new(format!("line {}: {message}", index + 1)))
        })
        .collect();
    Ok(Handles::new(space, &handles?)?)
}

/// Returns the error that a column of a CSV file is unknown or missing.
fn columns_error(problem: &str) -> Error {
    Error::new(format!(
        "the first line must name the columns x, y and z, and may name to_x, to_y, to_z, sigma_x, sigma_y, sigma_z and weight; {problem}"
    ))
}

fn row(line: &str, columns: &[usize]) -> Result<Handle, String> {
    let mut numbers = [None; 10];
    let mut count = 0;
    for entry in line.split(',').map(str::trim) {
        if let Some(&column) = columns.get(count).filter(|_| !entry.is_empty()) {
            let number = super::parse(entry.as_bytes());
            let number =
                number.ok_or_else(|| format!("`{}` is not a number", excerpt(entry.as_bytes())))?;
            numbers[column] = Some(number);
        }
        count += 1;
    }
    if count != columns.len() {
        return Err(format!("expected {} entries, found {count}", columns.len()));
    }
    fn triple(first: usize, numbers: &[Option<f64>; 10]) -> Result<Option<[f64; 3]>, String> {
        match [0, 1, 2].map(|axis| numbers[first + axis]) {
            [Some(x), Some(y), Some(z)] => Ok(Some([x, y, z])),
            [None, None, None] => Ok(None),
            _ => Err(format!(
                "give all or none of `{}`, `{}` and `{}`",
                COLUMNS[first],
                COLUMNS[first + 1],
                COLUMNS[first + 2]
            )),
        }
    }
    let at = triple(0, &numbers)?.ok_or("`x`, `y` and `z` are missing")?;
    Ok(Handle {
        at,
        to: triple(3, &numbers)?,
        sigma: triple(6, &numbers)?,
        weight: numbers[9].unwrap_or(1.0),
    })
}

/// Writes handles in the form that [`read_json`] reads.
pub(super) struct HandlesJson;

impl FileFormat for HandlesJson {
    type Value = Handles;
    const EXTENSION: &'static str = "json";

    fn write(handles: &Handles, name: &str) -> Result<Vec<NewFile>, Error> {
        fn entry(handle: Handle) -> Value {
            let Handle { at, to, sigma, weight } = handle;
            match sigma {
                Some(sigma) => json!({ "at": at, "to": to, "sigma": sigma, "weight": weight }),
                None => json!({ "at": at, "to": to, "weight": weight }),
            }
        }
        let document = json!({
            "space": handles.space(),
            "handles": Value::from_iter(handles.iter().map(entry)),
        });
        Ok(NewFile::single(name, print(&document)))
    }
}

/// Reads handles from RON.
pub(crate) struct HandlesRon;

impl FileReader for HandlesRon {
    type Value = Handles;
    const EXTENSIONS: &'static [&'static str] = &["ron"];

    fn read(file: &InputFile<'_>) -> Result<Handles, Error> {
        read_ron(file.bytes(), HandleSpace::default())
    }
}

impl FileReader for HandlesJson {
    type Value = Handles;
    const EXTENSIONS: &'static [&'static str] = &["json"];

    fn read(file: &InputFile<'_>) -> Result<Handles, Error> {
        read_json(file.bytes(), HandleSpace::default())
    }
}

/// Reads handles from CSV.
pub(crate) struct HandlesCsv;

impl FileReader for HandlesCsv {
    type Value = Handles;
    const EXTENSIONS: &'static [&'static str] = &["csv"];

    fn read(file: &InputFile<'_>) -> Result<Handles, Error> {
        read_csv(file.bytes(), HandleSpace::default())
    }
}

#[cfg(test)]
mod tests {
    use super::super::hostile::check_no_panic;
    use super::*;

    const RON: &str = "// Two handles.\nHandles(space: World, handles: [\n    (at: (0, 1, 2), to: (3, 4.5, 5), sigma: (1, 2, 3), weight: 2),\n    (at: (1, 1, 1)),\n])\n";
    const CSV: &str = "x, y, z, weight, to_x, to_y, to_z, sigma_x, sigma_y, sigma_z\n0,1,2,2,3,4.5,5,1,2,3\n\n1,1,1,,,,,,,\n";

    fn expected_handles() -> Handles {
        let first = Handle {
            at: [0.0, 1.0, 2.0],
            to: Some([3.0, 4.5, 5.0]),
            sigma: Some([1.0, 2.0, 3.0]),
            weight: 2.0,
        };
        let second = Handle { at: [1.0; 3], to: None, sigma: None, weight: 1.0 };
        Handles::new(HandleSpace::World, &[first, second]).unwrap()
    }

    #[test]
    fn the_same_handles_are_read_from_every_format() {
        assert_eq!(read_ron(RON.as_bytes(), HandleSpace::Box).unwrap(), expected_handles());
        assert_eq!(read_csv(CSV.as_bytes(), HandleSpace::World).unwrap(), expected_handles());
        let json = HandlesJson::write(&expected_handles(), "a.json").unwrap().remove(0).bytes;
        assert_eq!(read_json(&json, HandleSpace::Box).unwrap(), expected_handles());
        let words = "{\"maquette\":\"0.1.0\"}".to_owned();
        let signature = maquette_node::provenance::Signature { words, hash: String::new() };
        let signed = HandlesJson::write_signed(&expected_handles(), "a.json", &signature).unwrap();
        assert_ne!(signed[0].bytes, json);
        assert_eq!(read_json(&signed[0].bytes, HandleSpace::Box).unwrap(), expected_handles());
    }

    #[test]
    fn a_plain_list_has_the_given_space() {
        let from_ron = read_ron(b"[(at: (1, 1, 1))]", HandleSpace::Cube).unwrap();
        let from_json = read_json(b"[{\"at\": [1, 1, 1]}]", HandleSpace::Cube).unwrap();
        assert_eq!((from_ron.space(), from_ron.len()), (HandleSpace::Cube, 1));
        assert_eq!(from_ron, from_json);
    }

    #[test]
    fn errors_have_a_line() {
        fn ron(text: &str) -> String {
            read_ron(text.as_bytes(), HandleSpace::Box).unwrap_err().to_string()
        }
        assert_eq!(
            ron("[\n(at: (0, 0, 0), too: 1)]"),
            "line 2: unknown field `too`, expected one of `at`, `to`, `sigma`, `weight`"
        );
        assert!(ron("[\n\n(at: (0, 0]").starts_with("line 3: "), "{}", ron("[\n\n(at: (0, 0]"));
        fn csv(text: &str) -> String {
            read_csv(text.as_bytes(), HandleSpace::Box).unwrap_err().to_string()
        }
        assert_eq!(csv("x,y,z\n0,0,0\n0,a,0"), "line 3: `a` is not a number");
        assert_eq!(csv("x,y,z\n0,0"), "line 2: expected 3 entries, found 2");
        assert!(csv("x,y,w\n").ends_with("unknown column `w`"));
        assert!(csv("").ends_with("unknown column ``"));
        assert!(csv("x,y,z,to_x\n1,2,3,4").starts_with("line 2: give all or none of `to_x`"));
        let json = read_json(b"{\"handles\": 5}", HandleSpace::Box).unwrap_err().to_string();
        assert!(json.starts_with("line 1: invalid type"), "{json}");
    }

    #[test]
    fn damaged_files_never_panic() {
        check_no_panic(RON.as_bytes(), |bytes| read_ron(bytes, HandleSpace::Box));
        check_no_panic(CSV.as_bytes(), |bytes| read_csv(bytes, HandleSpace::Box));
        let json = HandlesJson::write(&expected_handles(), "a.json").unwrap().remove(0).bytes;
        check_no_panic(&json, |bytes| read_json(bytes, HandleSpace::Box));
    }
}
