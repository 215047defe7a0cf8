//! Tests the parser against the crate `ron`, which is the reference for the grammar. Both must read the same value from every valid text.

use std::path::Path;

use ::ron::Value;

use super::{Body, Kind, Tree, parse};

/// Returns true if the value that `ron` has read equals the value `tree` that the parser has read. Names of calls and bare words are not
/// compared, because `ron` does not keep them in untyped values.
fn is_same(tree: &Tree, value: &Value) -> bool {
    fn all_same(items: &[Tree], values: &[Value]) -> bool {
        items.len() == values.len() && items.iter().zip(values).all(|(a, b)| is_same(a, b))
    }
    match (&tree.kind, value) {
        (Kind::Number { value, .. }, Value::Number(number)) => *value == number.into_f64(),
        (Kind::Bool(a), Value::Bool(b)) => a == b,
        (Kind::Text(a), Value::String(b)) => a == b,
        (Kind::Word(word), Value::Option(None)) => word == "None",
        (Kind::Word(word), Value::Number(number)) => {
            ["NaN", "inf"].iter().any(|name| word.starts_with(name))
                && !number.into_f64().is_finite()
        }
        (Kind::Word(word), Value::Unit) => !["None", "NaN", "inf"].contains(&&word[..]),
        (Kind::Call { name, body: Body::Empty }, Value::Unit) => name.is_none(),
        (Kind::Call { body: Body::Empty, .. }, Value::Seq(items)) => items.is_empty(),
        (
            Kind::Call { name: Some(name), body: Body::Items(items) },
            Value::Option(Some(inside)),
        ) => name.text == "Some" && all_same(items, std::slice::from_ref(inside)),
        (Kind::Call { body: Body::Items(items), .. }, Value::Seq(values))
        | (Kind::List(items), Value::Seq(values)) => all_same(items, values),
        (Kind::Call { body: Body::Fields(fields), .. }, Value::Map(map)) => {
            let found = |name: &str| map.get(&Value::String(name.into()));
            fields.iter().rev().all(|field| {
                let is_last = fields.iter().rfind(|other| other.name.text == field.name.text);
                !std::ptr::eq(is_last.unwrap_or(field), field)
                    || found(&field.name.text).is_some_and(|value| is_same(&field.value, value))
            })
        }
        (Kind::Map(entries), Value::Map(map)) => {
            // If a key occurs more than once, both parsers keep the last value.
            map.iter().all(|(key, value)| {
                let entry = entries.iter().rfind(|(own, _)| is_same(own, key));
                entry.is_some_and(|(_, own)| is_same(own, value))
            })
        }
        _ => false,
    }
}

/// Compares both parsers on a text. Describes the difference if `ron` rejects a text that the parser accepts, or reads another value.
fn difference(text: &str) -> Option<String> {
    let (tree, errors) = parse(text);
    if !errors.is_empty() {
        return None;
    }
    // Graph files differ from RON in two ways: `ron` rejects a byte order mark, and requires `path:` in `Graph("lib/skirt.ron", version:
    // "2.1")`.
    let text = with_named_paths(text.trim_start_matches('\u{feff}'));
    match ::ron::from_str::<Value>(&text) {
        Err(error) => Some(format!("ron refuses it: {error}")),
        Ok(value) if is_same(&tree, &value) => None,
        Ok(value) => Some(format!("{:?} is {value:?} to ron", tree.kind)),
    }
}

/// Inserts `path:` before the first text in each `Graph(..)`, if other fields follow the text.
fn with_named_paths(text: &str) -> String {
    let mut pieces = text.split("Graph(");
    let mut named = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let is_use = piece.trim_start().starts_with('"')
            && piece.find(')').is_some_and(|end| piece[..end].contains(':'));
        named += if is_use { "Graph(path: " } else { "Graph(" };
        named += piece;
    }
    named
}

fn corpus() -> Vec<String> {
    fn collect(folder: &Path, texts: &mut Vec<String>) {
        let mut paths = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect::<Vec<_>>();
        paths.sort();
        for path in paths {
            if path.is_dir() {
                collect(&path, texts);
            } else if path.extension().is_some_and(|ending| ending == "ron") {
                texts.push(std::fs::read_to_string(path).unwrap());
            }
        }
    }
    let mut texts = Vec::new();
    for folder in ["graphs", "tests/third_party/graphs"] {
        collect(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder), &mut texts);
    }
    assert!(texts.len() > 30);
    texts
}

#[test]
fn every_graph_of_the_project_is_read_like_by_ron() {
    for text in corpus() {
        assert_eq!(parse(&text).1, []);
        assert_eq!(difference(&text), None, "{text}");
    }
}

/// Removes, duplicates and inserts random pieces of a text. `case` is the seed of the random numbers.
fn mutate(text: &str, case: u64) -> String {
    const PIECES: [&str; 30] = [
        "(", ")", "[", "]", "{", "}", ",", ":", "\"", "\\", "// a\n", "/* b", "*/", "\n", "\u{a0}",
        "#", "-1.", "Some(", "None", "r#\"", "\"#", "\\u{41}", "0x_1", "1_0", "A", "a: 1", "NaN",
        "'", "()", "+",
    ];
    let mut state = case;
    fn random_below(bound: usize, state: &mut u64) -> usize {
        // SplitMix64 generator: Steele, Lea, Flood, *Fast splittable pseudorandom number generators* (2014).
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % bound as u64) as usize
    }
    let mut chars: Vec<_> = text.chars().collect();
    for _ in 0..=random_below(3, &mut state) {
        let at = random_below(chars.len() + 1, &mut state);
        let end = (at + random_below(10, &mut state)).min(chars.len());
        match random_below(3, &mut state) {
            0 => drop(chars.drain(at..end)),
            1 => drop(chars.splice(at..at, PIECES[random_below(PIECES.len(), &mut state)].chars())),
            _ => {
                let copy = chars[at..end].to_vec();
                drop(chars.splice(at..at, copy));
            }
        }
    }
    chars.into_iter().collect()
}

#[test]
fn mutated_graphs_are_read_like_by_ron() {
    let texts = corpus();
    let (mut read, mut found) = (0, String::new());
    for (index, text) in texts.iter().enumerate() {
        // Mutate a short piece of the text, which is more likely to stay valid, so that both parsers read it.
        let start = text.find("nodes:").map_or(0, |at| at + 6);
        let piece = Vec::from_iter(text[start..].chars().take(500)).into_iter().collect::<String>();
        for case in 0..25 {
            let seed = index as u64 * 1000 + case;
            for whole in [mutate(text, seed), format!("({})", mutate(&piece, seed))] {
                read += usize::from(parse(&whole).1.is_empty());
                if let Some(difference) = difference(&whole) {
                    found += &format!("{difference}: {whole}\n");
                }
            }
        }
    }
    assert!(read > 500, "only {read} were read");
    assert_eq!(found, "");
}

#[test]
fn literals_are_read_like_by_ron() {
    let texts = [
        "1",
        "-1",
        "+1",
        "0",
        "-0",
        "007",
        "1_000",
        "1__0",
        "1_",
        "0x1F",
        "0X1F",
        "-0x1F",
        "0b101",
        "0o17",
        "0x",
        "0x_1",
        "1.",
        ".5",
        "-.5",
        "1.5e3",
        "1e3",
        "1E-3",
        "1e+3",
        "1_0.0_1",
        "1e",
        "1.e3",
        "1e999",
        "1e-999",
        "5e-324",
        "0.1",
        "16777217.0",
        "0.30000000000000004",
        "123456789012345678",
        "18446744073709551615",
        "18446744073709551616",
        "-9223372036854775808",
        "-9223372036854775809",
        "1f32",
        "1u8",
        "1.0f64",
        "256u8",
        "NaN",
        "inf",
        "-inf",
        "-NaN",
        "NaNf32",
        "true",
        "false",
        "True",
        "None",
        "Some(1)",
        "Some(Some(()))",
        "Some",
        "Some()",
        "Some(1, 2)",
        "Some(a: 1)",
        "()",
        "(  )",
        "A",
        "A()",
        "A ( )",
        "A(1)",
        "A(1, 2)",
        "A(a: 1)",
        "(1)",
        "(1,)",
        "(a: 1,)",
        "((1))",
        "((a: 1))",
        "A((a: 1))",
        "A((1, 2))",
        "[]",
        "[ ]",
        "[1,]",
        "[,]",
        "{}",
        "{1: 2}",
        "{\"a\": 1, \"a\": 2}",
        "(a: 1, a: 2)",
        "{[1]: (2)}",
        "{(): 1}",
        "A{}",
        "A{a: 1}",
        "A[1]",
        "{a: 1}",
        "(a: 1, 2)",
        "(1, a: 2)",
        "(1 2)",
        "\"\"",
        "\"ä\"",
        "\"a\nb\"",
        r#""\n\r\t\0\\\"\'""#,
        r#""\x41""#,
        r#""\u{e4}""#,
        r#""\u{0e4}""#,
        r#""\u{}""#,
        r#""\u{110000}""#,
        r#""\u{d800}""#,
        r#""\u{ 41}""#,
        r#""\u{+41}""#,
        r#""\u{4_1}""#,
        r#""\q""#,
        r#""\u41""#,
        "\"\\\n a\"",
        "\"",
        "\"\\\"",
        r##"r"""##,
        r##"r"a""##,
        r##"r"\n""##,
        r###"r#"a"b"#"###,
        r###"r#""a""#"###,
        r###"r#"#a#"#"###,
        r####"r##"a"#b"##"####,
        r###"r#""""#"###,
        r###"r#"#"#"###,
        "r#\"",
        "'a'",
        "'\\n'",
        "b\"a\"",
        "b'a'",
        "br\"a\"",
        "r#a",
        "r#type",
        "r#a-b",
        "a-b",
        "a.b",
        "a+b",
        "ä",
        "_",
        "_a",
        "a1",
        "1a",
        "// a\n1",
        "1 // a",
        "1 /* a */",
        "/* /* */ 1 */ 2",
        "/* a */ 1",
        "/* 1",
        "1 /*",
        "/**/1",
        "/*/ 1",
        "//",
        "# 1",
        "\u{feff}1",
        "1\u{feff}",
        "\u{a0}1",
        "\u{2003}1",
        "\u{200e}1",
        "\u{2028}1",
        "\u{85}1",
        "\u{b}1",
        "\u{c}1",
        "\r\n1\r",
        "1 2",
        "1,",
        "",
        "#![enable(implicit_some)] 1",
        "#![enable(unwrap_newtypes)] A(1)",
        "#![enable(implicit_some, unwrap_newtypes,)]1",
        "#![enable(foo)] 1",
        "#![enable()] 1",
        "#![disable(implicit_some)] 1",
        "#![] 1",
        "1 #![enable(implicit_some)]",
        "#![enable(implicit_some)]\n#![enable(unwrap_newtypes)] 1",
        "#![ enable ( implicit_some ) ] 1",
        "(a: #![enable(implicit_some)] 1)",
        "1..2",
        "1..=2",
        "a::b",
        "A::B(1)",
        "(a:1,b:A,c:[A,B(1)])",
        "(a: , b: 1)",
        "(: 1)",
        "(\"a\": 1)",
        "(1: 2)",
        "(true: 1)",
        "(None: 1)",
        "(r#a: 1)",
        "(NaN: 1)",
        "(inf: 2)",
        "{A: 1}",
        "{A(1): 1}",
        "{1.0: 1}",
        "trueish",
        "true()",
        "None()",
        "None(1)",
        "NaN()",
        "inf(1)",
        "A(NaN)",
        "A (1)",
        "A /* a */ (1)",
        "A\n(1)",
    ];
    let found = texts.iter().filter_map(|text| Some(format!("{text:?}: {}\n", difference(text)?)));
    assert_eq!(String::from_iter(found), "");
}
