//! What is wanted and promised of one value, and which of its elements stand against it.

use maquette_value::{AnyValue, Offence};

use super::Graph;

/// A property that somebody wants or promises of a value and that is not sure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    pub(crate) property: String,
    /// By whom, in words: port `mesh` of `skin`.
    pub(crate) by: Vec<String>,
}

/// A property that a value does not have.
#[derive(Clone, Debug)]
pub struct Broken {
    pub(crate) asked: Asked,
    pub offence: Offence,
}

impl Graph {
    /// What is asked of an output of a node, each property once.
    pub fn asked_of(&self, target: (usize, usize)) -> Vec<Asked> {
        let wanted = self.shape.users(target.0).flat_map(|user| {
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
            let property = it.expectation.promised()?;
            Some((property, format!("the promise of `{}`", it.expectation.values()[0])))
        });
        let mut all: Vec<Asked> = Vec::new();
        for (property, by) in wanted.chain(promised) {
            match all.iter_mut().find(|asked| asked.property == property) {
                Some(asked) if asked.by.contains(&by) => {}
                Some(asked) => asked.by.push(by),
                None => all.push(Asked { property: property.to_owned(), by: vec![by] }),
            }
        }
        all
    }
}

impl Asked {
    /// Those of which something of the value stands against.
    pub fn broken(all: &[Self], value: &AnyValue) -> Vec<Broken> {
        let broken = all.iter().filter_map(|asked| {
            let offence = value.offence(&asked.property)?;
            Some(Broken { asked: asked.clone(), offence })
        });
        broken.collect()
    }

    /// Port `mesh` of `skin` and 3 more.
    fn by_whom(&self) -> String {
        match &self.by[..] {
            [one] => one.clone(),
            [one, more @ ..] => format!("{one} and {} more", more.len()),
            [] => String::new(),
        }
    }
}

impl Broken {
    /// What is wrong: not Closed, as port `mesh` of `skin` wants: it has 3 edges with one face.
    pub fn in_words(&self) -> String {
        format!(
            "is not {}, which is asked by {}: it {}",
            self.asked.property,
            self.asked.by_whom(),
            self.offence.what
        )
    }

    /// The same for programs, with so many elements at most.
    pub fn to_json(&self, most: usize) -> serde_json::Value {
        let Asked { property, by } = &self.asked;
        let elements = self.offence.elements.iter().take(most).map(|element| {
            let place = element.place();
            serde_json::json!({ "name": element.name, "at": [place.x, place.y, place.z] })
        });
        serde_json::json!({
            "property": property,
            "asked_by": by,
            "words": self.in_words(),
            "count": self.offence.count,
            "elements": Vec::from_iter(elements),
        })
    }
}
