//! Conditions on columns of numbers, such as `region == 7 and area > 2`. They are written as in an `Expr` of a graph.

use std::collections::BTreeMap;

use maquette_graph::expression::{Outcome, evaluate_any, named_parameters};
use maquette_syntax::{Quantity, Unit, unknown_name_message};

/// A condition all of whose names are known columns.
pub(crate) struct Condition<'t> {
    text: &'t str,
    names: Vec<String>,
}

impl<'t> Condition<'t> {
    /// Parses a condition. It may contain the names of the columns `known`. `what` describes the owner of these columns in error messages.
    ///
    /// # Errors
    /// A message if the text is not a condition, or contains the name of an unknown column.
    pub(crate) fn parse(text: &'t str, known: &[&str], what: &str) -> Result<Self, String> {
        fn format_error(why: &dyn std::fmt::Display, text: &str) -> String {
            format!("`{text}`: {why}")
        }
        let is_known = |name: &str| known.contains(&name);
        let Some(places) = named_parameters(text, &is_known) else {
            let why = evaluate_any(text, &BTreeMap::new()).err();
            return Err(format_error(&why.map_or_else(String::new, |why| why.to_string()), text));
        };
        let mut names: Vec<_> = places.into_iter().map(|place| text[place].to_owned()).collect();
        names.sort_unstable();
        names.dedup();
        names.retain(|name| is_known(name) || !matches!(&name[..], "true" | "false"));
        if let Some(name) = names.iter().find(|name| !is_known(name)) {
            let message = format!("there is no column `{name}` of {what}");
            return Err(unknown_name_message(message, name, "its columns", known));
        }
        let condition = Self { text, names };
        condition.evaluate(|_| 1.0)?;
        Ok(condition)
    }

    /// Returns the names of the columns that the condition uses.
    pub(crate) fn column_names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
    }

    /// Evaluates the condition for one row of the table. `number` returns the value of a column in that row.
    ///
    /// # Errors
    /// A message if the result is a number instead of true or false.
    pub(crate) fn evaluate(&self, number: impl Fn(&str) -> f64) -> Result<bool, String> {
        match evaluate_any(
            self.text,
            &self
                .names
                .iter()
                .map(|name| {
                    let quantity = Quantity { value: number(name), unit: Unit::default() };
                    (name.clone(), Outcome::Number(quantity))
                })
                .collect(),
        ) {
            Ok(Outcome::Truth(truth)) => Ok(truth),
            Ok(Outcome::Number(_)) => Err(format!("`{}` is a number, not a condition", self.text)),
            Err(why) => Err(format!("`{}`: {why}", self.text)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_use_the_syntax_of_parameters() {
        let known = ["region", "area", "k-1"];
        fn holds(text: &str, region: f64, known: &[&str; 3]) -> Result<bool, String> {
            let condition = Condition::parse(text, known, "faces")?;
            condition.evaluate(|name| if name == "region" { region } else { 2.0 })
        }
        assert_eq!(holds("region == 7 and k-1 * area > 3", 7.0, &known), Ok(true));
        assert_eq!(holds("region == 7", 6.0, &known), Ok(false));
        assert_eq!(holds("not true", 6.0, &known), Ok(false));
        let wrong = "there is no column `regoin` of faces; did you mean `region`?";
        assert_eq!(holds("regoin == 7", 7.0, &known), Err(wrong.into()));
        assert_eq!(
            holds("region", 7.0, &known),
            Err("`region` is a number, not a condition".into())
        );
        assert!(holds("region ==", 7.0, &known).unwrap_err().contains("ends where"));
        assert_eq!(
            holds("region $ 1", 7.0, &known).unwrap_err(),
            "`region $ 1`: `$` has no meaning in an expression"
        );
    }
}
