//! Errors in the fields of a node, which are detected before the node runs.

use std::fmt::Display;

/// An error in the fields of a node because of which the node fails for all inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldError {
    /// The field that must be changed. Empty if the error concerns several fields.
    pub field: &'static str,
    /// The message, without the position of the field.
    pub message: String,
    /// The help text, which may be empty.
    pub help: String,
}

impl FieldError {
    /// Creates an error in the field `field`.
    pub fn new(field: &'static str, message: impl Display, help: impl Into<String>) -> Self {
        Self { field, message: message.to_string(), help: help.into() }
    }
}
