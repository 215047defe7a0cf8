//! Setting the draft value of an omitted field. The field becomes a `Draft`, whose value for final results is the field's default.

use maquette_graph::canonical::node_of_link;
use maquette_graph::definition::NodeKind;
use maquette_graph::draft_value::is_draft;
use maquette_graph::load::check_file;
use maquette_graph::place::{EditError, PathEnd, field, find, place_value};
use maquette_graph::tree::{entries, is_patch};
use maquette_graph::{Files, Options};
use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Kind, Tree, parse, resolve_field, to_ron, variants};
use serde_json::Value as Json;

use super::Editor;

impl Editor<'_> {
    /// Returns the text to write at the field `target` of a graph or patch. This is `value` or, if drafts are edited and `text` omits the
    /// field, a `Draft` of `value` and the field's default.
    ///
    /// # Errors
    /// The field has no default, or the default cannot be written.
    pub(super) fn with_default(
        &self,
        text: &str,
        target: &str,
        value: &str,
    ) -> Result<String, EditError> {
        if !self.options.draft {
            return Ok(value.to_owned());
        }
        let patched = is_patch(&parse(text).0).then(|| self.patched_text(text)).flatten();
        let whole = patched.as_deref().unwrap_or(text);
        let error = place_value(whole, target, value, false, true).map_err(|error| match patched {
            Some(_) => EditError { span: Span::default(), ..error },
            None => error,
        });
        match error.err().filter(|error| error.code == code::MISSING_FIELD) {
            None => Ok(value.to_owned()),
            Some(error) => match self.default_of_field(text, target) {
                Some(last) => Ok(format!("Draft(final: {last}, draft: {value})")),
                None => Err(error),
            },
        }
    }

    /// Returns the default of a node's field for final results, as text. `None` if there is no default that can be written into this file.
    fn default_of_field(&self, text: &str, target: &str) -> Option<String> {
        let options = Options { files: Files::Ignored, draft: false, ..self.options.clone() };
        let (_, whole) = check_file(self.path, text.to_owned(), self.catalog, &options);
        let definition = whole?.definition;
        let text = &definition.source_map.source.text;
        let (node, path) = target.split_once('.')?;
        fn has_fields(what: &NodeKind) -> bool {
            matches!(what, NodeKind::Node(_) | NodeKind::Use(..))
        }
        let mut parsed_nodes =
            definition.parsed_nodes.iter().filter(|parsed| has_fields(&parsed.what));
        let what = &parsed_nodes.find(|parsed| node_of_link(&parsed.name.text) == node)?.what;
        let root = what.schema()?;
        let (_, call) =
            entries(definition.tree.fields()?, "nodes").find(|(name, _)| *name == node)?;
        let steps: Vec<_> = path.split('.').collect();
        let (name, way) = steps.split_last()?;
        let (group, way) = match (call.name()?.text == "ForEach", way) {
            (false, way) => (call, way),
            (true, ["with", way @ ..]) => (&field(call, "with")?.value, way),
            (true, ["over", number, way @ ..]) => {
                // A field that the element omits may be set for all elements of the `ForEach`, by `with`.
                let with = field(call, "with").and_then(|with| field(&with.value, name));
                if let Some(with) = with.filter(|with| way.is_empty() && !is_draft(&with.value)) {
                    return Some(text[with.value.span.start..with.value.span.end].to_owned());
                }
                let Ok(PathEnd::Value(item)) = find(call, &["over", number], Some(false)) else {
                    return None;
                };
                (item, way)
            }
            (true, _) => return None,
        };
        let owner = schema_at(group, root, root, way)?;
        let schema = owner["properties"].get(name)?;
        let mut required = owner["required"].as_array().into_iter().flatten();
        let kind = resolve_field(schema, root);
        // Return `None` for a port, because ports take only links. Also for a text field of a used graph: its default may be a path
        // relative to the folder of the used graph, which would be wrong in this file.
        let is_foreign = matches!(what, NodeKind::Use(..)) && kind["type"] == "string";
        if required.any(|it| it == name)
            || kind.get("port").is_some()
            || is_foreign && kind.get("enum").is_none()
        {
            return None;
        }
        Some(to_ron(schema.get("default").unwrap_or(&Json::Null), schema, root))
    }
}

/// Returns the schema of the part of a value to which the path `way` leads. `schema` is that of the whole value.
fn schema_at(tree: &Tree, schema: &Json, root: &Json, way: &[&str]) -> Option<Json> {
    let schema = resolve_field(schema, root);
    let tree = tree.call_of("Some").unwrap_or(tree);
    let choice = tree
        .name()
        .and_then(|name| variants(&schema).into_iter().find(|(known, _)| *known == name.text));
    if let Some((name, content)) = choice {
        let way = way.strip_prefix(&[name]).unwrap_or(way);
        return match &tree.kind {
            Kind::Call { body: Body::Items(items), .. } => match &items[..] {
                [item] => schema_at(item, content?, root, way),
                _ => None,
            },
            _ => fields_at(tree, &resolve_field(content?, root), root, way),
        };
    }
    fields_at(tree, &schema, root, way)
}

fn fields_at(tree: &Tree, schema: &Json, root: &Json, way: &[&str]) -> Option<Json> {
    let Some((step, rest)) = way.split_first() else { return Some(schema.clone()) };
    let Ok(PathEnd::Value(within)) = find(tree, &[step], Some(false)) else { return None };
    let next = schema["properties"]
        .get(step)
        .or_else(|| schema["prefixItems"].get(step.parse::<usize>().ok()?))
        .or_else(|| schema.get("items"))?;
    schema_at(within, next, root, rest)
}
