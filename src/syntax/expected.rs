//! What a schema expects at a place within a value, found by the same steps that lead through the value.

use std::borrow::Cow;

use serde_json::Value as Json;

use super::steps::{inside, variants};

/// What is expected of a value.
#[derive(Clone)]
pub struct Expected<'a> {
    /// The name of the field that it is, or that it is in.
    pub field: Cow<'a, str>,
    /// Its schema, without references and without what says that it may be left out.
    pub schema: Cow<'a, Json>,
    /// The text of the unit of its numbers, which a list has for all in it.
    pub unit: Option<String>,
    pub root: &'a Json,
}

impl<'a> Expected<'a> {
    /// What is expected of the call of a node.
    pub fn of_node(name: &'a str, schema: &'a Json) -> Self {
        Self { field: name.into(), schema: Cow::Borrowed(schema), unit: None, root: schema }
    }

    /// What is expected of a field.
    pub fn field(&self, name: &str) -> Option<Self> {
        let field = Cow::Owned(name.to_owned());
        self.step(field, None, |schema| schema.get("properties")?.get(name))
    }

    /// What is expected of an item of a list or tuple.
    pub fn item(&self, index: usize) -> Option<Self> {
        self.within(|schema| {
            let fixed = schema.get("prefixItems").and_then(|fixed| fixed.get(index));
            fixed.or_else(|| schema.get("items"))
        })
    }

    /// What is expected of an entry of a map.
    pub fn entry(&self) -> Option<Self> {
        self.within(|schema| schema.get("additionalProperties"))
    }

    /// What is expected in the parentheses behind a name, such as that of a choice; `Some` says nothing.
    pub fn behind(&self, name: &str) -> Option<Self> {
        match content(&self.schema, name) {
            Some(_) => self.within(|schema| content(schema, name)?),
            None => Some(self.clone()),
        }
    }

    /// What is expected of an item in the parentheses behind a name: the content itself, if that is no tuple.
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

    /// Whether it is written in parentheses, as a vector is, with numbers alone.
    pub fn is_tuple(&self) -> bool {
        fn count(name: &str, schema: &Json) -> Option<u64> {
            schema.get(name).and_then(Json::as_u64)
        }
        let is_fixed = self.schema.get("prefixItems").is_some()
            || count("minItems", &self.schema).is_some()
                && count("minItems", &self.schema) == count("maxItems", &self.schema);
        is_fixed && self.item(0).is_some_and(|item| item.is_number())
    }

    /// What is expected of something in it, which is of the same field.
    fn within(&self, pick: impl Fn(&Json) -> Option<&Json>) -> Option<Self> {
        self.step(self.field.clone(), self.unit.as_ref(), pick)
    }

    /// What is expected of something in it: a schema that lies there is not copied.
    fn step(
        &self,
        field: Cow<'a, str>,
        unit: Option<&String>,
        pick: impl Fn(&Json) -> Option<&Json>,
    ) -> Option<Self> {
        let schema = match &self.schema {
            Cow::Borrowed(schema) => inside(pick(schema)?, self.root),
            Cow::Owned(schema) => Cow::Owned(inside(pick(schema)?, self.root).into_owned()),
        };
        let own = schema.get("unit").and_then(Json::as_str).map(str::to_owned);
        Some(Self { field, unit: own.or_else(|| unit.cloned()), schema, root: self.root })
    }
}

/// What stands in the parentheses behind a choice, if that is one and has such.
fn content<'s>(schema: &'s Json, name: &str) -> Option<Option<&'s Json>> {
    let choice = variants(schema).into_iter().find(|(choice, _)| *choice == name);
    choice.map(|(_, content)| content)
}
