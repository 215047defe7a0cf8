//! The columns of a value as a table.

use std::fmt::Write;

use maquette_engine::six;
use maquette_value::{Part, Parts, Range};
use serde_json::{Value as Json, json};

/// Of elements with more numbers than that, one range of all numbers is printed.
const WIDE: usize = 4;

/// The facts, then a line for each column.
pub(super) fn table(parts: &Parts<'_>) -> String {
    let mut text = String::new();
    for fact in &parts.facts {
        let _ = writeln!(text, "  {}: {}", fact.name, fact.value);
    }
    let head = ["name", "on", "meaning", "width", "count", "least", "greatest", "mean"];
    let rows: Vec<[String; 8]> = parts.columns.iter().map(row).collect();
    let rows: Vec<_> = std::iter::once(head.map(str::to_owned)).chain(rows).collect();
    let widths: [usize; 8] = std::array::from_fn(|column: usize| {
        rows.iter().map(|row| row[column].len()).max().unwrap_or(0)
    });
    for row in &rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            let _ = write!(line, "  {cell:<width$}");
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}

fn row(part: &Part<'_>) -> [String; 8] {
    let ranges = match part.width {
        ..=WIDE => part.ranges(),
        _ => maquette_value::ranges(&part.items.numbers(), 1),
    };
    fn numbers(of: fn(&Range) -> f64, ranges: &[Option<Range>]) -> String {
        let number = |range: &Option<Range>| range.as_ref().map_or("-".into(), |it| six(of(it)));
        match &ranges[..] {
            [one] => number(one),
            all => format!("({})", all.iter().map(number).collect::<Vec<_>>().join(", ")),
        }
    }
    [
        part.name.clone().into_owned(),
        part.on.word().to_owned(),
        part.meaning.word().to_owned(),
        part.width.to_string(),
        part.count().to_string(),
        numbers(|range| range.least, &ranges),
        numbers(|range| range.greatest, &ranges),
        numbers(|range| range.mean, &ranges),
    ]
}

/// The same for programs: `least`, `greatest` and `mean` have a number for each of an element, null where none is finite.
pub(super) fn json(parts: &Parts<'_>) -> Json {
    let facts =
        parts.facts.iter().map(|fact| (fact.name.to_string(), json!(fact.value.to_string())));
    let column = |part: &Part<'_>| {
        let ranges = part.ranges();
        fn numbers(of: fn(&Range) -> f64, ranges: &[Option<Range>]) -> Vec<Option<f64>> {
            ranges.iter().map(|range| range.as_ref().map(of)).collect::<Vec<_>>()
        }
        json!({
            "name": part.name,
            "on": part.on.word(),
            "meaning": part.meaning.word(),
            "width": part.width,
            "count": part.count(),
            "least": numbers(|range| range.least, &ranges),
            "greatest": numbers(|range| range.greatest, &ranges),
            "mean": numbers(|range| range.mean, &ranges),
            "compared": !part.aside,
        })
    };
    json!({
        "facts": facts.collect::<serde_json::Map<_, _>>(),
        "row": parts.row,
        "columns": parts.columns.iter().map(column).collect::<Vec<_>>(),
    })
}
