//! A value for drafts where the file says nothing: the final value that goes beside it is the one that counts if it is left out.

use maquette_graph::definition::What;
use maquette_graph::load::first;
use maquette_graph::meaning::named_node;
use maquette_graph::place::{Found, Refusal, field, find, place};
use maquette_graph::quality::is_draft;
use maquette_graph::tree::{entries, is_patch};
use maquette_graph::{Files, Options};
use maquette_syntax::error::{Span, code};
use maquette_syntax::{Body, Kind, Tree, inside, parse, ron, variants};
use serde_json::Value as Json;

use super::Judge;

impl Judge<'_> {
    /// The value as it is put into a graph or a patch of it: for drafts, what is left out becomes a `Draft` whose final value is the
    /// default.
    ///
    /// # Errors
    /// There is no default that could be written.
    pub(super) fn beside_default(
        &self,
        text: &str,
        target: &str,
        value: &str,
    ) -> Result<String, Refusal> {
        if !self.options.draft {
            return Ok(value.to_owned());
        }
        let patched = is_patch(&parse(text).0).then(|| self.patched(text)).flatten();
        let whole = patched.as_deref().unwrap_or(text);
        let refusal = place(whole, target, value, false, true).map_err(|refusal| match patched {
            Some(_) => Refusal { span: Span::default(), ..refusal },
            None => refusal,
        });
        match refusal.err().filter(|refusal| refusal.code == code::MISSING_FIELD) {
            None => Ok(value.to_owned()),
            Some(refusal) => match self.left_out(text, target) {
                Some(last) => Ok(format!("Draft(final: {last}, draft: {value})")),
                None => Err(refusal),
            },
        }
    }

    /// What a field of a node has for final results if it is left out, as text.
    fn left_out(&self, text: &str, target: &str) -> Option<String> {
        let options = Options { files: Files::Ignored, draft: false, ..self.options.clone() };
        let (_, whole) = first(self.path, text.to_owned(), self.catalog, &options);
        let definition = whole?.definition;
        let text = &definition.sheet.source.text;
        let (node, path) = target.split_once('.')?;
        fn is_it(what: &What) -> bool {
            matches!(what, What::Node(_) | What::Use(..))
        }
        let mut drafts = definition.drafts.iter().filter(|draft| is_it(&draft.what));
        let what = &drafts.find(|draft| named_node(&draft.name.text) == node)?.what;
        let root = what.schema()?;
        let (_, call) =
            entries(definition.tree.fields()?, "nodes").find(|(name, _)| *name == node)?;
        let steps: Vec<_> = path.split('.').collect();
        let (name, way) = steps.split_last()?;
        let (group, way) = match (call.name()?.text == "ForEach", way) {
            (false, way) => (call, way),
            (true, ["with", way @ ..]) => (&field(call, "with")?.value, way),
            (true, ["over", number, way @ ..]) => {
                // What all elements have is what this one has.
                let with = field(call, "with").and_then(|with| field(&with.value, name));
                if let Some(with) = with.filter(|with| way.is_empty() && !is_draft(&with.value)) {
                    return Some(text[with.value.span.start..with.value.span.end].to_owned());
                }
                let Ok(Found::Value(item)) = find(call, &["over", number], Some(false)) else {
                    return None;
                };
                (item, way)
            }
            (true, _) => return None,
        };
        let owner = schema_at(group, root, root, way)?;
        let schema = owner["properties"].get(name)?;
        let mut required = owner["required"].as_array().into_iter().flatten();
        let kind = inside(schema, root);
        // A port takes links alone. A text of another file may be a path, which is another one here.
        let is_foreign = matches!(what, What::Use(..)) && kind["type"] == "string";
        if required.any(|it| it == name)
            || kind.get("port").is_some()
            || is_foreign && kind.get("enum").is_none()
        {
            return None;
        }
        Some(ron(schema.get("default").unwrap_or(&Json::Null), schema, root))
    }
}

/// The schema of what a way through a value with this schema leads to.
fn schema_at(tree: &Tree, schema: &Json, root: &Json, way: &[&str]) -> Option<Json> {
    let schema = inside(schema, root);
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
            _ => fields_at(tree, &inside(content?, root), root, way),
        };
    }
    fields_at(tree, &schema, root, way)
}

fn fields_at(tree: &Tree, schema: &Json, root: &Json, way: &[&str]) -> Option<Json> {
    let Some((step, rest)) = way.split_first() else { return Some(schema.clone()) };
    let Ok(Found::Value(within)) = find(tree, &[step], Some(false)) else { return None };
    let next = schema["properties"]
        .get(step)
        .or_else(|| schema["prefixItems"].get(step.parse::<usize>().ok()?))
        .or_else(|| schema.get("items"))?;
    schema_at(within, next, root, rest)
}
