//! Properties that a node requires of its inputs and guarantees for its outputs.

/// A [property](maquette_value::Property) that a node requires of the values at a port. A value is tested before the node runs, and only
/// once. It is not tested if the node that computes the value guarantees the property.
pub struct Want<N> {
    #[doc(hidden)]
    pub port: &'static str,
    #[doc(hidden)]
    pub property: &'static str,
    pub(crate) when: Option<Condition<N>>,
}

/// A [property](maquette_value::Property) that a node guarantees for the values of an output. These values need not be tested.
pub struct Promise<N> {
    #[doc(hidden)]
    pub output: &'static str,
    #[doc(hidden)]
    pub property: &'static str,
    #[doc(hidden)]
    pub source: Source,
    pub(crate) when: Option<Condition<N>>,
}

/// The condition under which a guaranteed property holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Source {
    /// The output always has the property.
    Always,
    /// The property holds if the port with this name has at least one value and all its values have the property.
    From(&'static str),
    /// The property does not hold, except for empty values.
    Never,
}

/// A condition on the parameters of a node, under which a requirement or guarantee applies.
pub(crate) struct Condition<N> {
    /// The condition in words for the manual, such as `with the scheme Loop`.
    pub(crate) words: &'static str,
    pub(crate) holds: fn(&N) -> bool,
}

impl<N> Want<N> {
    /// Requires that each value at `port` has the property.
    pub const fn new(port: &'static str, property: &'static str) -> Self {
        Self { port, property, when: None }
    }

    /// Restricts the requirement to nodes whose parameters satisfy `holds`. `words` describes this condition.
    #[must_use]
    pub const fn only_if(self, words: &'static str, holds: fn(&N) -> bool) -> Self {
        Self { port: self.port, property: self.property, when: Some(Condition { words, holds }) }
    }
}

impl<N> Promise<N> {
    const fn new(output: &'static str, property: &'static str, source: Source) -> Self {
        Self { output, property, source, when: None }
    }

    /// Guarantees the property for `output`.
    pub const fn always(output: &'static str, property: &'static str) -> Self {
        Self::new(output, property, Source::Always)
    }

    /// Guarantees the property for `output` if `port` has at least one value and all its values have the property.
    pub const fn from(output: &'static str, property: &'static str, port: &'static str) -> Self {
        Self::new(output, property, Source::From(port))
    }

    /// Guarantees for `output` all properties of meshes that the meshes at `port` have. For nodes that do not change the faces, but only
    /// positions and attributes.
    pub const fn faces_kept(output: &'static str, port: &'static str) -> [Self; 6] {
        [
            Self::from(output, "Closed", port),
            Self::from(output, "Manifold", port),
            Self::from(output, "Oriented", port),
            Self::from(output, "Unpinched", port),
            Self::from(output, "Triangles", port),
            Self::from(output, "NonEmpty", port),
        ]
    }

    /// Like [`faces_kept`](Self::faces_kept), but only for nodes whose parameters satisfy `holds`. `words` describes this condition.
    pub const fn faces_kept_when(
        output: &'static str,
        port: &'static str,
        words: &'static str,
        holds: fn(&N) -> bool,
    ) -> [Self; 6] {
        let [a, b, c, d, e, f] = Self::faces_kept(output, port);
        [
            a.only_if(words, holds),
            b.only_if(words, holds),
            c.only_if(words, holds),
            d.only_if(words, holds),
            e.only_if(words, holds),
            f.only_if(words, holds),
        ]
    }

    /// Declares that `output` never has the property, unless it is empty. The check of a graph reports a warning if another node requires
    /// the property of this output.
    pub const fn never_has(output: &'static str, property: &'static str) -> Self {
        Self::new(output, property, Source::Never)
    }

    /// Restricts the guarantee to nodes whose parameters satisfy `holds`. `words` describes this condition.
    #[must_use]
    pub const fn only_if(self, words: &'static str, holds: fn(&N) -> bool) -> Self {
        let Self { output, property, source, .. } = self;
        Self { output, property, source, when: Some(Condition { words, holds }) }
    }
}

fn applies<N>(when: Option<&Condition<N>>, node: &N) -> bool {
    when.is_none_or(|when| (when.holds)(node))
}

impl<N> Want<N> {
    /// Returns the port and the property if the requirement applies to `node`, given its parameters.
    pub(crate) fn for_node(&self, node: &N) -> Option<(&'static str, &'static str)> {
        applies(self.when.as_ref(), node).then_some((self.port, self.property))
    }
}

impl<N> Promise<N> {
    /// Returns the output, the property and its condition if the guarantee applies to `node`, given its parameters.
    pub(crate) fn for_node(&self, node: &N) -> Option<(&'static str, &'static str, Source)> {
        let promise = (self.output, self.property, self.source);
        applies(self.when.as_ref(), node).then_some(promise)
    }
}

/// A requirement for a port or a guarantee for an output, in the form for the documentation of a node type.
#[derive(Clone, Debug, PartialEq)]
#[doc(hidden)]
pub struct Term {
    /// The port of a requirement, or the output of a guarantee.
    #[doc(hidden)]
    pub at: &'static str,
    #[doc(hidden)]
    pub property: &'static str,
    /// The condition under which a guarantee holds. `None` for a requirement.
    #[doc(hidden)]
    pub source: Option<Source>,
    pub(crate) when: &'static str,
}

impl Term {
    pub(crate) fn collect<N>(wants: &[Want<N>], promises: &[Promise<N>]) -> Vec<Self> {
        fn words<N>(when: Option<&Condition<N>>) -> &'static str {
            when.map_or("", |when| when.words)
        }
        let wants = wants.iter().map(|want| {
            let when = words(want.when.as_ref());
            Self { at: want.port, property: want.property, source: None, when }
        });
        let promises = promises.iter().map(|promise| {
            let (when, source) = (words(promise.when.as_ref()), Some(promise.source));
            Self { at: promise.output, property: promise.property, source, when }
        });
        wants.chain(promises).collect()
    }

    /// Formats the term in words, such as "Closed as `mesh`, with the scheme Loop".
    #[doc(hidden)]
    pub fn describe(&self) -> String {
        let source = match self.source {
            None | Some(Source::Always) => String::new(),
            Some(Source::From(port)) => format!(" as `{port}`"),
            Some(Source::Never) => " never".into(),
        };
        let gap = if self.when.is_empty() { "" } else { ", " };
        format!("{}{source}{gap}{}", self.property, self.when)
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Mesh, Value};

    use super::*;

    #[test]
    fn faces_kept_covers_all_properties_of_meshes() {
        let known = Mesh::properties().iter().map(|property| property.name);
        let kept = Promise::<()>::faces_kept("mesh", "mesh").map(|promise| promise.property);
        assert_eq!(Vec::from_iter(known), kept);
    }
}
