//! Deserializes the struct of a node from the tree of the node's call.
//!
//! The tree must have been checked by [`super::schema`]. The remaining errors are those of the type's own `Deserialize` implementation.

use std::collections::HashMap;
use std::fmt;

use serde::de::{self, DeserializeOwned, DeserializeSeed, IntoDeserializer, Visitor};

use super::schema::FoundFile;
use super::tree::{Body, Field, Kind, Tree};
use crate::error::Span;

/// Keys of JSON objects that represent links and files in the serialized parameters of a node. They cannot be confused with parameters,
/// because field names contain no dollar sign.
pub const LINK: &str = "$link";
pub const FILE: &str = "$file";

/// Deserializes a node from a tree, given the links and files that the check of the tree has found.
pub struct Reader<'a> {
    pub tree: &'a Tree,
    pub links: &'a HashMap<Span, InputSlots>,
    pub files: &'a [FoundFile],
}

/// The input slots of a node that one link fills. A link to the output of a `ForEach` fills several slots.
pub struct InputSlots {
    pub first: usize,
    pub count: usize,
}

/// An error of deserializing the fields of a node, with the position of the invalid value.
#[derive(Debug)]
pub struct ReadError {
    pub span: Option<Span>,
    pub message: String,
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for ReadError {}

impl de::Error for ReadError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self { span: None, message: message.to_string() }
    }
}

impl Reader<'_> {
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, ReadError> {
        T::deserialize(Value { tree: self.tree, reader: self, nth: 0 })
    }
}

/// Deserializes a value that contains no links and no files.
pub fn read_tree<T: DeserializeOwned>(tree: &Tree) -> Result<T, ReadError> {
    Reader { tree, links: &HashMap::new(), files: &[] }.read()
}

#[derive(Clone, Copy)]
struct Value<'a> {
    tree: &'a Tree,
    reader: &'a Reader<'a>,
    /// For a link with several values, the index of the next value to be read.
    nth: usize,
}

impl<'a> Value<'a> {
    fn with_tree(self, tree: &'a Tree) -> Self {
        Self { tree, nth: 0, ..self }
    }

    /// Returns the number of values to which the link at `tree` leads. For any value other than a link, returns 1.
    fn count(self, tree: &Tree) -> usize {
        if tree.text().is_none() {
            return 1;
        }
        self.reader.links.get(&tree.span).map_or(1, |link| link.count)
    }

    /// Adds the span of this value to an error that has no span.
    fn with_span<T>(self, result: Result<T, ReadError>) -> Result<T, ReadError> {
        result.map_err(|error| ReadError { span: error.span.or(Some(self.tree.span)), ..error })
    }

    fn fields<'de, V: Visitor<'de>>(
        self,
        fields: &[Field],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        visitor.visit_map(Fields { value: self, fields, next: 0 })
    }

    fn items<'de, V: Visitor<'de>>(
        self,
        items: &[Tree],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        visitor.visit_seq(Items { value: self, items, nth: 0 })
    }

    fn body<'de, V: Visitor<'de>>(self, body: &Body, visitor: V) -> Result<V::Value, ReadError> {
        match body {
            Body::Empty => self.fields(&[], visitor),
            Body::Fields(fields) => self.fields(fields, visitor),
            Body::Items(items) => self.items(items, visitor),
        }
    }

    /// Deserializes the content of an enum variant's parentheses. The variant may have no parentheses.
    fn content<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.tree.kind {
            Kind::Call { body, .. } => self.body(body, visitor),
            _ => self.fields(&[], visitor),
        }
    }

    fn visit_value<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.tree.kind {
            Kind::Number { value, whole } if *whole || is_whole(*value) => {
                visitor.visit_i64(*value as i64)
            }
            Kind::Number { value, .. } => visitor.visit_f64(*value),
            Kind::Bool(value) => visitor.visit_bool(*value),
            Kind::Text(text) | Kind::Word(text) => visitor.visit_str(text),
            Kind::Call { body, .. } => self.body(body, visitor),
            Kind::List(items) => self.items(items, visitor),
            Kind::Map(entries) => visitor.visit_map(Entries { value: self, entries, next: 0 }),
            Kind::Broken => Err(de::Error::custom("unreadable")),
        }
    }
}

/// Returns true if a number should be passed to serde as an integer, which `i64` represents exactly. In a flattened struct, serde buffers
/// fields before it knows their types, and would reject `2.0` for an integer field.
fn is_whole(value: f64) -> bool {
    const MAX_EXACT: f64 = (1_u64 << 53) as f64;
    value.fract() == 0.0 && value.abs() <= MAX_EXACT && !(value == 0.0 && value.is_sign_negative())
}

macro_rules! integers {
    ($($method:ident),+) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
            match self.tree.kind {
                Kind::Number { value, .. } if value.fract() == 0.0 => {
                    self.with_span(visitor.visit_i64(value as i64))
                }
                _ => self.deserialize_any(visitor),
            }
        })+
    };
}

impl<'de> de::Deserializer<'de> for Value<'_> {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        self.with_span(self.visit_value(visitor))
    }

    integers!(
        deserialize_i8,
        deserialize_i16,
        deserialize_i32,
        deserialize_i64,
        deserialize_u8,
        deserialize_u16,
        deserialize_u32,
        deserialize_u64
    );

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.tree.kind {
            Kind::Word(word) if word == "None" => visitor.visit_none(),
            _ => match self.tree.call_of("Some") {
                Some(inner) => visitor.visit_some(self.with_tree(inner)),
                None => visitor.visit_some(self),
            },
        }
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        let is_link = self.reader.links.contains_key(&self.tree.span);
        match &self.tree.kind {
            // Accept a single link where a list of links is expected.
            Kind::Text(_) if is_link => self.items(std::slice::from_ref(self.tree), visitor),
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match name {
            LINK => {
                let link = self.reader.links.get(&self.tree.span);
                let slot = link.map(|link| link.first + self.nth);
                let slot = slot.ok_or_else(|| de::Error::custom("this link was not found"));
                self.with_span(slot.and_then(|slot| visitor.visit_u64(slot as u64)))
            }
            FILE => match self.reader.files.iter().find(|file| file.span == self.tree.span) {
                Some(file) => {
                    let paths = [file.given.clone(), file.resolved.to_string_lossy().into_owned()];
                    visitor.visit_seq(de::value::SeqDeserializer::new(paths.into_iter()))
                }
                None => self.deserialize_any(visitor),
            },
            _ => visitor.visit_newtype_struct(self),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        let Some(name) = self.tree.name() else {
            return self.with_span(Err(de::Error::custom("expected a name")));
        };
        self.with_span(visitor.visit_enum(Variant { value: self, name: name.text }))
    }

    serde::forward_to_deserialize_any! {
        bool f32 f64 char str string bytes byte_buf unit unit_struct tuple tuple_struct map struct
        identifier ignored_any i128 u128
    }
}

struct Items<'a> {
    value: Value<'a>,
    items: &'a [Tree],
    /// The first item of a list is a link. `nth` is the number of its values that have been read.
    nth: usize,
}

impl<'de> de::SeqAccess<'de> for Items<'_> {
    type Error = ReadError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, ReadError> {
        while let Some((first, rest)) = self.items.split_first() {
            if self.nth < self.value.count(first) {
                let value = Value { nth: self.nth, ..self.value.with_tree(first) };
                self.nth += 1;
                return seed.deserialize(value).map(Some);
            }
            (self.items, self.nth) = (rest, 0);
        }
        Ok(None)
    }
}

struct Fields<'a> {
    value: Value<'a>,
    fields: &'a [Field],
    next: usize,
}

impl<'de> de::MapAccess<'de> for Fields<'_> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ReadError> {
        let Some(field) = self.fields.get(self.next) else { return Ok(None) };
        let name: Result<_, ReadError> =
            seed.deserialize(field.name.text.as_str().into_deserializer());
        name.map(Some).map_err(|error| ReadError { span: Some(field.name.span), ..error })
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        let field = &self.fields[self.next];
        self.next += 1;
        let value = self.value.with_tree(&field.value);
        value.with_span(seed.deserialize(value))
    }
}

struct Entries<'a> {
    value: Value<'a>,
    entries: &'a [(Tree, Tree)],
    next: usize,
}

impl<'de> de::MapAccess<'de> for Entries<'_> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ReadError> {
        let Some((key, _)) = self.entries.get(self.next) else { return Ok(None) };
        seed.deserialize(self.value.with_tree(key)).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        let (_, value) = &self.entries[self.next];
        self.next += 1;
        seed.deserialize(self.value.with_tree(value))
    }
}

struct Variant<'a> {
    value: Value<'a>,
    name: String,
}

impl<'de, 'a> de::EnumAccess<'de> for Variant<'a> {
    type Error = ReadError;
    type Variant = Value<'a>;

    fn variant_seed<V: DeserializeSeed<'de>>(
        self,
        seed: V,
    ) -> Result<(V::Value, Value<'a>), ReadError> {
        let variant = seed.deserialize(self.name.into_deserializer())?;
        Ok((variant, self.value))
    }
}

impl<'de> de::VariantAccess<'de> for Value<'_> {
    type Error = ReadError;

    fn unit_variant(self) -> Result<(), ReadError> {
        Ok(())
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, ReadError> {
        match &self.tree.kind {
            Kind::Call { body: Body::Items(items), .. } if items.len() == 1 => {
                seed.deserialize(self.with_tree(&items[0]))
            }
            _ => self.with_span(seed.deserialize(Content(self))),
        }
    }

    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, ReadError> {
        self.with_span(self.visit_value(visitor))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        self.content(visitor)
    }
}

/// The content of the parentheses of an enum variant that contains a single struct. The fields of the struct are written directly in these
/// parentheses. If the variant has no parentheses, all fields have their defaults.
struct Content<'a>(Value<'a>);

impl<'de> de::Deserializer<'de> for Content<'_> {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, ReadError> {
        Err(de::Error::custom("expected one value in parentheses"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        self.0.content(visitor)
    }

    // serde asks for a map if the struct has flattened fields.
    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        self.0.content(visitor)
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests;
