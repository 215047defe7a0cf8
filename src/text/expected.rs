//! What a schema expects at a place within a value, found by the same steps that lead through the value.

use std::borrow::Cow;

use serde_json::Value as Json;

use super::schema::{inside_option, resolve, variants};

/// What is expected of a value.
#[derive(Clone)]
pub(crate) struct Expected<'a> {
    /// The name of the field that it is, or that it is in.
    pub(crate) field: Cow<'a, str>,
    /// Its schema, without references and without what says that it may be left out.
    pub(crate) schema: Cow<'a, Json>,
    /// The text of the unit of its numbers, which a list has for all in it.
    pub(crate) unit: Option<String>,
    pub(crate) root: &'a Json,
}

impl<'a> Expected<'a> {
    /// What is expected of the call of a node.
    pub(crate) fn of_node(name: &'a str, schema: &'a Json) -> Self {
        Self { field: name.into(), schema: Cow::Borrowed(schema), unit: None, root: schema }
    }

    /// What is expected of a field.
    pub(crate) fn field(&self, name: &str) -> Option<Self> {
        let schema = self.schema.get("properties")?.get(name)?;
        let field = Cow::Owned(name.to_owned());
        Some(Self { field, unit: None, ..self.clone() }.with(schema))
    }

    /// What is expected of an item of a list or tuple.
    pub(crate) fn item(&self, index: usize) -> Option<Self> {
        let fixed = self.schema.get("prefixItems").and_then(|fixed| fixed.get(index));
        let schema = fixed.or_else(|| self.schema.get("items"))?;
        Some(self.clone().with(schema))
    }

    /// What is expected of an entry of a map.
    pub(crate) fn entry(&self) -> Option<Self> {
        Some(self.clone().with(self.schema.get("additionalProperties")?))
    }

    /// What is expected in the parentheses behind a name, such as that of a choice; `Some` says nothing.
    pub(crate) fn behind(&self, name: &str) -> Option<Self> {
        match variants(&self.schema).into_iter().find(|(choice, _)| choice == name) {
            Some((_, content)) => Some(self.clone().with(&content?)),
            None => Some(self.clone()),
        }
    }

    /// What is expected of an item in the parentheses behind a name: the content itself, if that is no tuple.
    pub(crate) fn argument(&self, index: usize) -> Option<Self> {
        match self.schema.get("prefixItems") {
            Some(_) => self.item(index),
            None => Some(self.clone()),
        }
    }

    pub(crate) fn is_number(&self) -> bool {
        matches!(self.schema.get("type").and_then(Json::as_str), Some("number" | "integer"))
    }

    pub(crate) fn is_whole_number(&self) -> bool {
        self.schema.get("type").and_then(Json::as_str) == Some("integer")
    }

    /// Whether it is written in parentheses, as a vector is, with numbers alone.
    pub(crate) fn is_tuple(&self) -> bool {
        let count = |name: &str| self.schema.get(name).and_then(Json::as_u64);
        let is_fixed = self.schema.get("prefixItems").is_some()
            || count("minItems").is_some() && count("minItems") == count("maxItems");
        is_fixed && self.item(0).is_some_and(|item| item.is_number())
    }

    fn with(self, schema: &Json) -> Self {
        let mut schema = resolve(self.root, schema);
        if let Some(inner) = inside_option(&schema) {
            schema = resolve(self.root, &inner);
        }
        let own = schema.get("unit").and_then(Json::as_str).map(str::to_owned);
        Self { unit: own.or(self.unit), schema: Cow::Owned(schema), ..self }
    }
}
