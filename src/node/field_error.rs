//! Errors in the fields of a node. They are detected before the node runs.

use std::fmt::Display;

/// An error in the fields of a node that makes the node fail for all inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldError {
    /// The field to be changed. Empty if the error does not concern a single field.
    pub field: &'static str,
    /// The message, without the position of the field.
    pub message: String,
    /// The help text, which may be empty.
    pub help: String,
}

impl FieldError {
    /// Creates an error that concerns one field.
    pub fn new(field: &'static str, message: impl Display, help: impl Into<String>) -> Self {
        Self { field, message: message.to_string(), help: help.into() }
    }
}
