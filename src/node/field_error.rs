//! Errors in the fields of a node that are known before it runs.

use std::fmt::Display;

/// Why a node with such fields fails whatever comes in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldError {
    /// The field to change; empty if that is not one field.
    pub field: &'static str,
    /// What is wrong, without the place.
    pub message: String,
    /// What to do.
    pub help: String,
}

impl FieldError {
    /// An error at this field.
    pub fn new(field: &'static str, message: impl Display, help: impl Into<String>) -> Self {
        Self { field, message: message.to_string(), help: help.into() }
    }
}
