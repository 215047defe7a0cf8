//! What may happen to a project, and the chances of each.

use proptest::prelude::*;

/// A kind of node in the author's mind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Add,
    Split,
    Read,
    Fragile,
    Use,
    Each,
    Switch,
}

/// A change of the folder. Numbers pick among what is there, so that a sequence stays one whatever is taken out of it.
#[derive(Clone, Debug)]
pub(super) enum Edit {
    Add {
        at: u8,
        kind: Kind,
        number: u8,
        links: Vec<u8>,
    },
    Number {
        node: u8,
        number: u8,
    },
    Kind {
        node: u8,
        kind: Kind,
    },
    Rename {
        node: u8,
    },
    Link {
        node: u8,
        link: u8,
        to: u8,
    },
    /// Its links in the opposite order.
    Turn {
        node: u8,
    },
    /// It takes the other outputs of what it is linked to.
    Other {
        node: u8,
    },
    Swap {
        node: u8,
    },
    Remove {
        node: u8,
    },
    Inner {
        number: u8,
    },
    Longer,
    Switch,
    File {
        file: u8,
        number: u8,
    },
    Replace {
        file: u8,
        number: u8,
    },
    Date {
        file: u8,
        seconds: u16,
    },
    Delete {
        file: u8,
    },
    /// Files become old enough to be known by what the system says of them.
    Settle,
}

/// What is asked of a process.
#[derive(Clone, Debug)]
pub(super) enum Command {
    /// Evaluates some nodes: all, if `wanted` is empty. The values are wanted, too, or only hashes.
    Evaluate { wanted: Vec<u8>, values: bool },
    /// The same, but somebody cancels it when this many nodes have begun.
    Cancel { wanted: Vec<u8>, after: usize },
    /// Another process goes on, with what is on `disk` or without; the one before lives on if `keep`.
    Process { keep: bool, disk: bool },
    /// How much memory there is for results.
    Memory { kilobytes: usize },
    /// What is on disk goes.
    Clear,
    /// A file of the cache is damaged at a place.
    Damage { file: u16, at: u16 },
    /// Everything is to be computed again.
    Forget,
    /// Results that could be taken from the cache are computed and compared.
    Verify { share: u8 },
}

#[derive(Clone, Debug)]
pub(super) enum Step {
    Edit(Edit),
    Command(Command),
}

fn kind() -> impl Strategy<Value = Kind> {
    use Kind::{Add, Each, Fragile, Read, Split, Switch, Use};
    prop_oneof![
        6 => Just(Add),
        2 => Just(Split),
        2 => Just(Read),
        1 => Just(Fragile),
        1 => Just(Use),
        1 => Just(Each),
        1 => Just(Switch),
    ]
}

fn add() -> impl Strategy<Value = Edit> {
    let links = prop::collection::vec(any::<u8>(), 0..3);
    (any::<u8>(), kind(), any::<u8>(), links).prop_map(|(at, kind, number, links)| Edit::Add {
        at,
        kind,
        number,
        links,
    })
}

fn edit() -> impl Strategy<Value = Edit> {
    fn pair() -> (prop::num::u8::Any, prop::num::u8::Any) {
        (any::<u8>(), any::<u8>())
    }
    prop_oneof![
        4 => add(),
        6 => pair().prop_map(|(node, number)| Edit::Number { node, number }),
        2 => (any::<u8>(), kind()).prop_map(|(node, kind)| Edit::Kind { node, kind }),
        1 => any::<u8>().prop_map(|node| Edit::Rename { node }),
        2 => (pair(), any::<u8>()).prop_map(|((node, link), to)| Edit::Link { node, link, to }),
        2 => any::<u8>().prop_map(|node| Edit::Turn { node }),
        2 => any::<u8>().prop_map(|node| Edit::Other { node }),
        1 => any::<u8>().prop_map(|node| Edit::Swap { node }),
        1 => any::<u8>().prop_map(|node| Edit::Remove { node }),
        1 => any::<u8>().prop_map(|number| Edit::Inner { number }),
        1 => Just(Edit::Longer),
        2 => Just(Edit::Switch),
        1 => pair().prop_map(|(file, number)| Edit::File { file, number }),
        1 => pair().prop_map(|(file, number)| Edit::Replace { file, number }),
        1 => (any::<u8>(), any::<u16>()).prop_map(|(file, seconds)| Edit::Date { file, seconds }),
        1 => any::<u8>().prop_map(|file| Edit::Delete { file }),
        1 => Just(Edit::Settle),
    ]
}

fn command() -> impl Strategy<Value = Command> {
    fn wanted() -> prop::collection::VecStrategy<prop::num::u8::Any> {
        prop::collection::vec(any::<u8>(), 0..3)
    }
    prop_oneof![
        16 => (wanted(), any::<bool>())
            .prop_map(|(wanted, values)| Command::Evaluate { wanted, values }),
        1 => (wanted(), 0..6_usize).prop_map(|(wanted, after)| Command::Cancel { wanted, after }),
        2 => (any::<bool>(), prop::bool::weighted(0.8))
            .prop_map(|(keep, disk)| Command::Process { keep, disk }),
        1 => (0..12_usize).prop_map(|kilobytes| Command::Memory { kilobytes }),
        1 => Just(Command::Clear),
        1 => (any::<u16>(), any::<u16>()).prop_map(|(file, at)| Command::Damage { file, at }),
        1 => Just(Command::Forget),
        1 => any::<u8>().prop_map(|share| Command::Verify { share }),
    ]
}

/// Some nodes, and then whatever may happen.
pub(super) fn sequence() -> impl Strategy<Value = Vec<Step>> {
    let first = prop::collection::vec(add().prop_map(Step::Edit), 1..7);
    let step = prop_oneof![edit().prop_map(Step::Edit), command().prop_map(Step::Command)];
    let then = prop::collection::vec(step, 1..24);
    (first, then).prop_map(|(mut steps, then)| {
        steps.extend(then);
        steps
    })
}
