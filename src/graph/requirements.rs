//! Required and promised properties of values, and the elements of a value that violate them.

use maquette_value::{AnyValue, Violation};

use super::Graph;

/// A required or promised property of a value that must be tested, because it is not known to hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Requirement {
    pub(crate) property: String,
    /// Descriptions of what requires the property, such as port `mesh` of `skin`.
    pub(crate) by: Vec<String>,
}

/// A required property that a value violates.
#[derive(Clone, Debug)]
pub struct UnmetRequirement {
    pub(crate) requirement: Requirement,
    pub violation: Violation,
}

impl Graph {
    /// Returns the properties that are required or promised of an output of a node. Each property occurs once.
    pub fn requirements_of(&self, target: (usize, usize)) -> Vec<Requirement> {
        let wanted = self.topology.users(target.0).flat_map(|user| {
            let node = &self.nodes[user];
            let guards = node.guards.iter().filter(move |guard| {
                let link = &node.links[guard.slot];
                (link.node, link.output) == target
            });
            guards.map(|guard| {
                let by = match guard.input {
                    Some(_) => guard.by.to_string(),
                    None => format!("{} of `{}`", guard.by, node.name),
                };
                (guard.property, by)
            })
        });
        let promised = self.expect.iter().filter(|it| it.values.first() == Some(&Some(target)));
        let promised = promised.filter_map(|it| {
            let property = it.expectation.promised_property()?;
            Some((property, format!("the promise of `{}`", it.expectation.values()[0])))
        });
        let mut all: Vec<Requirement> = Vec::new();
        for (property, by) in wanted.chain(promised) {
            match all.iter_mut().find(|requirement| requirement.property == property) {
                Some(requirement) if requirement.by.contains(&by) => {}
                Some(requirement) => requirement.by.push(by),
                None => all.push(Requirement { property: property.to_owned(), by: vec![by] }),
            }
        }
        all
    }
}

impl Requirement {
    /// Returns those of the requirements `all` that the value violates.
    pub fn find_unmet(all: &[Self], value: &AnyValue) -> Vec<UnmetRequirement> {
        let broken = all.iter().filter_map(|requirement| {
            let violation = value.violation(&requirement.property)?;
            Some(UnmetRequirement { requirement: requirement.clone(), violation })
        });
        broken.collect()
    }

    /// Returns a short description of what requires the property, such as port `mesh` of `skin` and 3 more.
    fn requirers(&self) -> String {
        match &self.by[..] {
            [one] => one.clone(),
            [one, more @ ..] => format!("{one} and {} more", more.len()),
            [] => String::new(),
        }
    }
}

impl UnmetRequirement {
    /// Describes in words how the value violates the property.
    pub fn in_words(&self) -> String {
        format!(
            "is not {}, as required by {}: it {}",
            self.requirement.property,
            self.requirement.requirers(),
            self.violation.what
        )
    }

    /// Returns the violation as JSON. At most `most` of the violating elements are included.
    pub fn to_json(&self, most: usize) -> serde_json::Value {
        let Requirement { property, by } = &self.requirement;
        let elements = self.violation.elements.iter().take(most).map(|element| {
            let place = element.center();
            serde_json::json!({ "name": element.name, "at": [place.x, place.y, place.z] })
        });
        serde_json::json!({
            "property": property,
            "asked_by": by,
            "words": self.in_words(),
            "count": self.violation.count,
            "elements": Vec::from_iter(elements),
        })
    }
}
