//! Reads tables of values in CSV or JSON, with one task per row. Ambiguous input is an error.

use maquette_syntax::quote;
use serde_json::Value as Json;

/// A table. All rows have the same number of cells.
#[derive(Debug, PartialEq)]
pub(super) struct Table {
    pub(super) names: Vec<String>,
    pub(super) rows: Vec<Vec<Cell>>,
}

/// A value of a table, in two forms: as RON, and as text for display.
#[derive(Debug, PartialEq)]
pub(super) struct Cell {
    pub(super) text: String,
    pub(super) shown: String,
}

/// Reads a table as CSV or JSON, depending on the extension of the path.
///
/// # Errors
/// A message that contains the number of the line.
pub(super) fn read(path: &str, text: &str) -> Result<Table, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let table =
        match path.rsplit_once('.').map(|(_, extension)| extension.to_lowercase()).as_deref() {
            Some("csv") => csv(text)?,
            Some("json") => json(text)?,
            _ => return Err("expected a table, a file that ends with .csv or .json".into()),
        };
    if table.rows.is_empty() {
        return Err("expected rows, found none".into());
    }
    for (index, name) in table.names.iter().enumerate() {
        if name.is_empty() {
            return Err(format!("column {} has no name", index + 1));
        }
        if table.names[..index].contains(name) {
            return Err(format!("there are two columns `{name}`"));
        }
    }
    Ok(table)
}

/// Returns the value of a CSV field. A field in quotes is a text. A field without quotes is a number, `true`, `false`, RON in brackets, or
/// otherwise a text.
fn cell(field: &Field) -> Cell {
    let shown = field.text.clone();
    let is_word = ["true", "false"].contains(&&shown[..]);
    let starts_call = shown.find('(').is_some_and(|at| {
        shown[..at].chars().all(|c| c.is_ascii_alphanumeric() || c == '_') && shown.ends_with(')')
    });
    let is_value = is_word
        || is_number(&shown)
        || starts_call
        || shown.starts_with('[') && shown.ends_with(']');
    let text = if is_value && !field.is_quoted { shown.clone() } else { quote(&shown) };
    Cell { text, shown }
}

fn is_number(text: &str) -> bool {
    let begins = text.trim_start_matches(['+', '-']);
    begins.starts_with(|c: char| c.is_ascii_digit() || c == '.') && text.parse::<f64>().is_ok()
}

/// A field of a CSV file, with the number of the line on which it begins.
struct Field {
    text: String,
    is_quoted: bool,
    line: usize,
}

fn csv(text: &str) -> Result<Table, String> {
    let first = text.lines().next().unwrap_or_default();
    for (sign, name) in [(';', "a semicolon"), ('\t', "a tab")] {
        if first.contains(sign) && !first.contains(',') {
            return Err(format!("line 1: expected commas between columns, found {name}"));
        }
    }
    let mut records = records(text)?.into_iter();
    let names = records.next().unwrap_or_default();
    let names: Vec<_> = names.into_iter().map(|field| field.text.trim().to_owned()).collect();
    let mut rows = Vec::new();
    for record in records {
        let line = record.first().map_or(1, |field| field.line);
        if record.len() != names.len() {
            let (wanted, count) = (names.len(), record.len());
            return Err(format!(
                "line {line}: expected {wanted} fields, found {count}; write a point in numbers, and quotes around a text with a comma"
            ));
        }
        for (name, field) in names.iter().zip(&record) {
            if field.text.is_empty() && !field.is_quoted {
                return Err(format!("line {line}: `{name}` has no value"));
            }
            let decimal = field.text.replacen(',', ".", 1);
            if field.text.contains(',') && is_number(&decimal) {
                return Err(format!(
                    "line {line}: `{name}`: expected a point in a number, found `{}`",
                    field.text
                ));
            }
        }
        rows.push(record.iter().map(cell).collect());
    }
    Ok(Table { names, rows })
}

/// Parses the records of a CSV file (RFC 4180). Empty lines are left out.
fn records(text: &str) -> Result<Vec<Vec<Field>>, String> {
    let (mut records, mut record) = (Vec::new(), Vec::new());
    let (mut rest, mut line) = (text, 1);
    while !rest.is_empty() {
        let start = line;
        let is_quoted = rest.trim_start_matches(' ').starts_with('"');
        let field = if is_quoted {
            let mut field = String::new();
            rest = &rest.trim_start_matches(' ')[1..];
            loop {
                let end =
                    rest.find('"').ok_or_else(|| format!("line {start}: a quote is not closed"))?;
                field += &rest[..end];
                rest = &rest[end + 1..];
                match rest.strip_prefix('"') {
                    Some(behind) => {
                        field.push('"');
                        rest = behind;
                    }
                    None => break,
                }
            }
            line += field.matches('\n').count();
            rest = rest.trim_start_matches(' ');
            if !rest.is_empty() && !rest.starts_with([',', '\n', '\r']) {
                return Err(format!("line {line}: expected a comma after a quote"));
            }
            field
        } else {
            let end = rest.find([',', '\n', '\r']).unwrap_or(rest.len());
            let field = rest[..end].trim().to_owned();
            rest = &rest[end..];
            field
        };
        record.push(Field { text: field, is_quoted, line: start });
        if let Some(behind) = rest.strip_prefix(',') {
            rest = behind;
            if !rest.is_empty() {
                continue;
            }
            record.push(Field { text: String::new(), is_quoted: false, line });
        }
        rest =
            rest.strip_prefix("\r\n").or_else(|| rest.strip_prefix(['\n', '\r'])).unwrap_or(rest);
        line += 1;
        let is_empty = matches!(&record[..], [field] if field.text.is_empty() && !field.is_quoted);
        let done = std::mem::take(&mut record);
        if !is_empty {
            records.push(done);
        }
    }
    Ok(records)
}

fn json(text: &str) -> Result<Table, String> {
    let rows: Json = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let rows = rows.as_array().ok_or("expected a list of objects")?;
    let mut table = Table { names: Vec::new(), rows: Vec::new() };
    for (index, row) in rows.iter().enumerate() {
        let row =
            row.as_object().ok_or_else(|| format!("row {}: expected an object", index + 1))?;
        if index == 0 {
            table.names = row.keys().cloned().collect();
        }
        if let Some(name) = row.keys().find(|name| !table.names.contains(name)) {
            return Err(format!("row {}: the first row has no `{name}`", index + 1));
        }
        table.rows.push(
            table
                .names
                .iter()
                .map(|name| {
                    let value = row.get(name).filter(|value| !value.is_null());
                    let value =
                        value.ok_or_else(|| format!("row {}: `{name}` has no value", index + 1))?;
                    let text = ron(value)
                        .ok_or_else(|| format!("row {}: `{name}` is an object", index + 1))?;
                    Ok(Cell {
                        shown: value.as_str().map_or_else(|| text.clone(), str::to_owned),
                        text,
                    })
                })
                .collect::<Result<_, String>>()?,
        );
    }
    Ok(table)
}

/// Converts a JSON value to RON. Returns `None` for an object.
fn ron(value: &Json) -> Option<String> {
    Some(match value {
        Json::String(text) => quote(text),
        Json::Array(items) => {
            let items = items.iter().map(ron).collect::<Option<Vec<_>>>()?;
            format!("[{}]", items.join(", "))
        }
        Json::Object(_) | Json::Null => return None,
        Json::Bool(_) | Json::Number(_) => value.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(path: &str, text: &str) -> Vec<Vec<String>> {
        let table = read(path, text).unwrap();
        std::iter::once(table.names.clone())
            .chain(table.rows.iter().map(|row| row.iter().map(|cell| cell.text.clone()).collect()))
            .collect()
    }

    #[test]
    fn all_formats_of_a_table_are_equivalent() {
        let expected = [["growth", "name"], ["5", "\"a, \\\"b\\\"\""], ["mm(2.5)", "\"x\""]];
        for text in [
            "growth,name\n5,\"a, \"\"b\"\"\"\nmm(2.5),x\n",
            "\u{feff}growth , name\r\n5, \"a, \"\"b\"\"\"\r\n\r\nmm(2.5), x",
            "growth,name\r5,\"a, \"\"b\"\"\"\rmm(2.5),x\r",
        ] {
            assert_eq!(rows("t.CSV", text), expected, "{text}");
        }
        let json = r#"[{"growth": 5, "name": "a, \"b\""}, {"name": "x", "growth": 2.5}]"#;
        assert_eq!(rows("t.json", json)[..2], expected[..2]);
        assert_eq!(
            rows("t.csv", "a\n\"5\"\ntrue\n[1, 2]\n".replace("[1, 2]", "-1e3").as_str())[1..],
            [["\"5\""], ["true"], ["-1e3"]]
        );
        assert_eq!(
            rows("t.json", r#"[{"a": [1, "b"]}, {"a": true}]"#)[1..],
            [["[1, \"b\"]"], ["true"]]
        );
    }

    #[test]
    fn ambiguous_tables_are_rejected() {
        for (path, text, word) in [
            ("t.csv", "a;b\n1;2\n", "semicolon"),
            ("t.csv", "a\tb\n1\t2\n", "tab"),
            ("t.csv", "a,b\n1,5,2\n", "line 2: expected 2 fields, found 3"),
            ("t.csv", "a,b\n\"1,5\",2\n", "point"),
            ("t.csv", "a,b\n1\n", "found 1"),
            ("t.csv", "a,b\n1,\n", "`b` has no value"),
            ("t.csv", "a,a\n1,2\n", "two columns"),
            ("t.csv", "a,\n1,2\n", "no name"),
            ("t.csv", "a\n\"1\n", "not closed"),
            ("t.csv", "a\n\"1\"2\n", "comma after"),
            ("t.csv", "a\n", "found none"),
            ("t.csv", "", "found none"),
            ("t.json", "{}", "list"),
            ("t.json", "[1]", "object"),
            ("t.json", "[]", "found none"),
            ("t.json", "[{\"a\": 1}, {\"b\": 1}]", "`b`"),
            ("t.json", "[{\"a\": null}]", "no value"),
            ("t.json", "[{\"a\": {}}]", "object"),
            ("t.txt", "a\n1\n", ".csv"),
        ] {
            let why = read(path, text).unwrap_err();
            assert!(why.contains(word), "{why} for {text}");
        }
    }
}
