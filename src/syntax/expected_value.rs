//! Finds the schema of a part of a value, given the path from the value to the part.

use std::borrow::Cow;

use serde_json::Value as Json;

use super::schema_path::{resolve_field, variants};

/// The value that a schema expects at a certain path.
#[derive(Clone)]
pub struct ExpectedValue<'a> {
    /// The name of the innermost field around the value.
    pub field: Cow<'a, str>,
    /// The schema of the value. References are resolved, and the `null` of an optional field is removed.
    pub schema: Cow<'a, Json>,
    /// The unit of the numbers in the value, if the schema states one. Items of a list have the unit of the list.
    pub unit: Option<String>,
    pub root: &'a Json,
}

impl<'a> ExpectedValue<'a> {
    /// Returns the expected value for the call of a node.
    pub fn for_node(name: &'a str, schema: &'a Json) -> Self {
        Self { field: name.into(), schema: Cow::Borrowed(schema), unit: None, root: schema }
    }

    /// Returns the expected value of one of this value's fields. `None` if there is no such field.
    pub fn field(&self, name: &str) -> Option<Self> {
        let field = Cow::Owned(name.to_owned());
        self.step(field, None, |schema| schema.get("properties")?.get(name))
    }

    /// Returns the expected value of an item of a list or tuple.
    pub fn item(&self, index: usize) -> Option<Self> {
        self.descend(|schema| {
            let fixed = schema.get("prefixItems").and_then(|fixed| fixed.get(index));
            fixed.or_else(|| schema.get("items"))
        })
    }

    /// Returns the expected value of an entry of a map.
    pub fn entry(&self) -> Option<Self> {
        self.descend(|schema| schema.get("additionalProperties"))
    }

    /// Returns the expected content of the parentheses after a name, such as the name of an enum variant. For the name `Some`, this is the
    /// expected value itself.
    pub fn variant_content(&self, name: &str) -> Option<Self> {
        match content(&self.schema, name) {
            Some(_) => self.descend(|schema| content(schema, name)?),
            None => Some(self.clone()),
        }
    }

    /// Returns the expected value of an item in the parentheses after a name. If the content is a tuple, this is an item of the tuple.
    /// Otherwise it is the content itself.
    pub fn argument(&self, index: usize) -> Option<Self> {
        match self.schema.get("prefixItems") {
            Some(_) => self.item(index),
            None => Some(self.clone()),
        }
    }

    pub fn is_number(&self) -> bool {
        matches!(self.schema.get("type").and_then(Json::as_str), Some("number" | "integer"))
    }

    pub fn is_whole_number(&self) -> bool {
        self.schema.get("type").and_then(Json::as_str) == Some("integer")
    }

    /// Returns true if the expected value is a tuple of numbers, such as a vector.
    pub fn is_tuple(&self) -> bool {
        fn count(name: &str, schema: &Json) -> Option<u64> {
            schema.get(name).and_then(Json::as_u64)
        }
        let is_fixed = self.schema.get("prefixItems").is_some()
            || count("minItems", &self.schema).is_some()
                && count("minItems", &self.schema) == count("maxItems", &self.schema);
        is_fixed && self.item(0).is_some_and(|item| item.is_number())
    }

    /// Returns the expected value for the part of the schema that `pick` selects. The part belongs to the same field.
    fn descend(&self, pick: impl Fn(&Json) -> Option<&Json>) -> Option<Self> {
        self.step(self.field.clone(), self.unit.as_ref(), pick)
    }

    /// Selects a part of the schema. Borrows the part if possible, and clones it otherwise.
    fn step(
        &self,
        field: Cow<'a, str>,
        unit: Option<&String>,
        pick: impl Fn(&Json) -> Option<&Json>,
    ) -> Option<Self> {
        let schema = match &self.schema {
            Cow::Borrowed(schema) => resolve_field(pick(schema)?, self.root),
            Cow::Owned(schema) => Cow::Owned(resolve_field(pick(schema)?, self.root).into_owned()),
        };
        let own = schema.get("unit").and_then(Json::as_str).map(str::to_owned);
        Some(Self { field, unit: own.or_else(|| unit.cloned()), schema, root: self.root })
    }
}

/// Returns the schema of the content of an enum variant's parentheses. Returns `None` if the variant does not exist, and `Some(None)` if it
/// has no parentheses.
fn content<'s>(schema: &'s Json, name: &str) -> Option<Option<&'s Json>> {
    let choice = variants(schema).into_iter().find(|(choice, _)| *choice == name);
    choice.map(|(_, content)| content)
}
