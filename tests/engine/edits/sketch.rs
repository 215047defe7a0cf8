//! A simple model of a graph's text, derived only from its lines and quotes. It shares no code with the engine, so tests can check the
//! engine against it.

/// The names that a graph's text declares, and where the text uses them.
#[derive(Default)]
pub(crate) struct Sketch {
    pub(crate) nodes: Vec<Node>,
    /// The names of nodes, inputs and parameters. A parameter is named `params.nose` if there is also a node `nose`.
    pub(crate) names: Vec<String>,
    pub(crate) outputs: Vec<String>,
    /// The strings in nodes that may be links. Each has its path (`node.field` or `node.field.2`) and its content.
    pub(crate) links: Vec<(String, String)>,
    /// All other values. Each has its path (`node.field`, or the name of a parameter) and its text.
    pub(crate) fields: Vec<(String, String)>,
}

/// A node in the text.
pub(crate) struct Node {
    pub(crate) name: String,
    pub(crate) kind: String,
    /// The name and the value of each field, as text.
    pub(crate) fields: Vec<(String, String)>,
}

impl Sketch {
    pub(crate) fn parse(text: &str) -> Self {
        let text = without_comments(text);
        let mut sketch = Self::default();
        let open = text.find("Graph(").map_or(0, |at| at + 6);
        let close = text.rfind(')').unwrap_or(text.len()).max(open);
        for (section, map) in named_parts(&text[open..close]) {
            let inside = map.trim_start_matches('{').trim_end_matches('}');
            for (name, value) in named_parts(inside) {
                let name = name.trim_matches('"').to_owned();
                match &section[..] {
                    "nodes" => sketch.node(name, &value),
                    "inputs" => sketch.names.push(name),
                    "params" => {
                        sketch.fields.push((name.clone(), value.clone()));
                        sketch.names.push(format!("params.{name}"));
                    }
                    "outputs" => sketch.outputs.push(name),
                    _ => {}
                }
            }
        }
        sketch
    }

    fn node(&mut self, name: String, call: &str) {
        let Some((kind, inside)) = call.split_once('(') else { return };
        let fields = named_parts(inside.strip_suffix(')').unwrap_or(inside));
        for (field, value) in &fields {
            let port = format!("{name}.{field}");
            fn is_text(value: &str) -> bool {
                value.starts_with('"') && value.len() > 2
            }
            if is_text(value) {
                self.links.push((port, value.trim_matches('"').to_owned()));
            } else if let Some(list) = value.strip_prefix('[').filter(|list| is_text(list)) {
                for (index, link) in parts(list.trim_end_matches(']')).into_iter().enumerate() {
                    self.links.push((format!("{port}.{index}"), link.trim_matches('"').to_owned()));
                }
                self.links.push((port, "nothing".into()));
            } else {
                self.fields.push((port, value.clone()));
            }
        }
        self.names.push(format!("nodes.{name}"));
        self.nodes.push(Node { name, kind: kind.trim().to_owned(), fields });
    }
}

/// Splits a text at the commas outside of brackets and quotes.
pub(crate) fn parts(text: &str) -> Vec<String> {
    let (mut parts, mut depth, mut in_text) = (vec![String::new()], 0_usize, false);
    for c in text.chars() {
        in_text ^= c == '"';
        match c {
            '(' | '[' | '{' if !in_text => depth += 1,
            ')' | ']' | '}' if !in_text => depth = depth.saturating_sub(1),
            ',' if !in_text && depth == 0 => {
                parts.push(String::new());
                continue;
            }
            _ => {}
        }
        parts.last_mut().unwrap().push(c);
    }
    let trimmed = parts.into_iter().map(|part| part.trim().to_owned());
    trimmed.filter(|part| !part.is_empty()).collect()
}

/// Splits a text at the commas outside of brackets and quotes into pairs of a name and a value.
pub(crate) fn named_parts(text: &str) -> Vec<(String, String)> {
    parts(text)
        .into_iter()
        .filter_map(|part: String| {
            let colon = match part.strip_prefix('"') {
                Some(rest) => 2 + rest.find('"')?,
                None => part.find(':')?,
            };
            let value = part[colon..].trim_start().strip_prefix(':')?;
            Some((part[..colon].trim().to_owned(), value.trim().to_owned()))
        })
        .collect()
}

/// Returns the comments of a text. Assumes that no string spans several lines.
pub(crate) fn comments(text: &str) -> Vec<&str> {
    text.lines().filter_map(comment).collect()
}

fn comment(line: &str) -> Option<&str> {
    let starts = line.match_indices("//").map(|(at, _)| at);
    let start = starts.into_iter().find(|at| line[..*at].matches('"').count().is_multiple_of(2))?;
    Some(line[start..].trim_end())
}

fn without_comments(text: &str) -> String {
    text.lines()
        .map(|line| match comment(line) {
            Some(comment) => line[..line.len() - comment.len()].to_owned(),
            None => line.to_owned(),
        })
        .collect::<Vec<_>>()
        .join("\n")
}
