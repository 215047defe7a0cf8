//! What a node wants of the values that come in, and promises of those that it gives.

/// A [property](maquette_value::Property) that a node wants of the values at a port. It is tested before the node runs, once per value,
/// unless whoever gives the value promises it.
pub struct Want<N> {
    #[doc(hidden)]
    pub port: &'static str,
    #[doc(hidden)]
    pub property: &'static str,
    pub(crate) when: Option<When<N>>,
}

/// A [property](maquette_value::Property) of the values at an output, which nobody needs to test.
pub struct Promise<N> {
    #[doc(hidden)]
    pub output: &'static str,
    #[doc(hidden)]
    pub property: &'static str,
    #[doc(hidden)]
    pub source: Source,
    pub(crate) when: Option<When<N>>,
}

/// On what a promise depends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Source {
    /// Nothing.
    Always,
    /// All values at this port have the property, and there are some.
    From(&'static str),
    /// A value with anything in it never has the property.
    Never,
}

/// For which parameters something is wanted or promised.
pub(crate) struct When<N> {
    /// In words that go on the sentence: `with the scheme Loop`.
    pub(crate) words: &'static str,
    pub(crate) holds: fn(&N) -> bool,
}

impl<N> Want<N> {
    /// Each value at `port` must have the property.
    pub const fn new(port: &'static str, property: &'static str) -> Self {
        Self { port, property, when: None }
    }

    /// Only with some parameters: `words` say with which.
    #[must_use]
    pub const fn when(self, words: &'static str, holds: fn(&N) -> bool) -> Self {
        Self { port: self.port, property: self.property, when: Some(When { words, holds }) }
    }
}

impl<N> Promise<N> {
    const fn new(output: &'static str, property: &'static str, source: Source) -> Self {
        Self { output, property, source, when: None }
    }

    /// `output` has the property, whatever comes in.
    pub const fn always(output: &'static str, property: &'static str) -> Self {
        Self::new(output, property, Source::Always)
    }

    /// `output` has the property if all values at `port`, one at least, have it.
    pub const fn from(output: &'static str, property: &'static str, port: &'static str) -> Self {
        Self::new(output, property, Source::From(port))
    }

    /// All that may hold of a mesh beyond its type: `output` has what all meshes at `port` have, because its faces are theirs, whatever
    /// becomes of places and attributes.
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

    /// The same only with some parameters: `words` say with which.
    pub const fn faces_kept_when(
        output: &'static str,
        port: &'static str,
        words: &'static str,
        holds: fn(&N) -> bool,
    ) -> [Self; 6] {
        let [a, b, c, d, e, f] = Self::faces_kept(output, port);
        [
            a.when(words, holds),
            b.when(words, holds),
            c.when(words, holds),
            d.when(words, holds),
            e.when(words, holds),
            f.when(words, holds),
        ]
    }

    /// `output` never has the property, unless there is nothing in it: who wants it is warned when the graph is checked.
    pub const fn never(output: &'static str, property: &'static str) -> Self {
        Self::new(output, property, Source::Never)
    }

    /// Only with some parameters: `words` say with which.
    #[must_use]
    pub const fn when(self, words: &'static str, holds: fn(&N) -> bool) -> Self {
        let Self { output, property, source, .. } = self;
        Self { output, property, source, when: Some(When { words, holds }) }
    }
}

fn applies<N>(when: Option<&When<N>>, node: &N) -> bool {
    when.is_none_or(|when| (when.holds)(node))
}

impl<N> Want<N> {
    /// The port and the property, if this node wants it.
    pub(crate) fn of(&self, node: &N) -> Option<(&'static str, &'static str)> {
        applies(self.when.as_ref(), node).then_some((self.port, self.property))
    }
}

impl<N> Promise<N> {
    /// What this node promises.
    pub(crate) fn of(&self, node: &N) -> Option<(&'static str, &'static str, Source)> {
        let promise = (self.output, self.property, self.source);
        applies(self.when.as_ref(), node).then_some(promise)
    }
}

/// What a type of nodes wants of a port, or promises of an output, as people and programs are told.
#[derive(Clone, Debug, PartialEq)]
#[doc(hidden)]
pub struct Term {
    /// The port, or the output.
    #[doc(hidden)]
    pub at: &'static str,
    #[doc(hidden)]
    pub property: &'static str,
    /// None for what is wanted.
    #[doc(hidden)]
    pub source: Option<Source>,
    pub(crate) when: &'static str,
}

impl Term {
    pub(crate) fn all<N>(wants: &[Want<N>], promises: &[Promise<N>]) -> Vec<Self> {
        let words = |when: &Option<When<N>>| when.as_ref().map_or("", |when| when.words);
        let wants = wants.iter().map(|want| {
            let when = words(&want.when);
            Self { at: want.port, property: want.property, source: None, when }
        });
        let promises = promises.iter().map(|promise| {
            let (when, source) = (words(&promise.when), Some(promise.source));
            Self { at: promise.output, property: promise.property, source, when }
        });
        wants.chain(promises).collect()
    }

    /// `Closed, if the values at `mesh` are so, with the scheme Loop`.
    #[doc(hidden)]
    pub fn in_words(&self) -> String {
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
    fn who_keeps_the_faces_of_a_mesh_keeps_all_that_may_hold_of_it() {
        let known = Mesh::properties().iter().map(|property| property.name);
        let kept = Promise::<()>::faces_kept("mesh", "mesh").map(|promise| promise.property);
        assert_eq!(Vec::from_iter(known), kept);
    }
}
