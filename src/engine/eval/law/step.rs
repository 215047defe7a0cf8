//! The random steps of a test sequence, and how often each kind of step occurs.

use proptest::prelude::*;

/// A kind of node in the random graph.
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

/// An edit of the project. Nodes are selected by numbers modulo the number of nodes, so a sequence stays valid when the test removes steps
/// to shrink it.
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
    /// Reverses the order of the node's links.
    Turn {
        node: u8,
    },
    /// Moves each link of the node to the other output of the same linked node.
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
    /// Waits until the files are so old that their modification times prove that they are unchanged.
    Settle,
}

/// A command to one of the simulated processes that evaluate the graph.
#[derive(Clone, Debug)]
pub(super) enum Command {
    /// Evaluates the nodes `wanted`, or all nodes if the list is empty. Requests the values if `values` is true, otherwise only the hashes.
    Evaluate { wanted: Vec<u8>, values: bool },
    /// Evaluates like `Evaluate`, but cancels after `after` nodes have started.
    Cancel { wanted: Vec<u8>, after: usize },
    /// Starts another process. `disk` says if it has the disk cache, and `keep` if the earlier process stays alive.
    Process { keep: bool, disk: bool },
    /// Sets the memory limit of results to this number of kilobytes.
    Memory { kilobytes: usize },
    /// Clears the disk cache.
    Clear,
    /// Damages a cache file. `file` selects the file and `at` the position of the damage.
    Damage { file: u16, at: u16 },
    /// Drops all results in memory.
    Forget,
    /// Sets the fraction (in 1/255) of cached results that is computed again and compared with the cache.
    Verify { fraction: u8 },
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
    fn node_picks() -> prop::collection::VecStrategy<prop::num::u8::Any> {
        prop::collection::vec(any::<u8>(), 0..3)
    }
    prop_oneof![
        16 => (node_picks(), any::<bool>())
            .prop_map(|(wanted, values)| Command::Evaluate { wanted, values }),
        1 => (node_picks(), 0..6_usize).prop_map(|(wanted, after)| Command::Cancel { wanted, after }),
        2 => (any::<bool>(), prop::bool::weighted(0.8))
            .prop_map(|(keep, disk)| Command::Process { keep, disk }),
        1 => (0..12_usize).prop_map(|kilobytes| Command::Memory { kilobytes }),
        1 => Just(Command::Clear),
        1 => (any::<u16>(), any::<u16>()).prop_map(|(file, at)| Command::Damage { file, at }),
        1 => Just(Command::Forget),
        1 => any::<u8>().prop_map(|fraction| Command::Verify { fraction }),
    ]
}

/// Returns a strategy that generates sequences. Each begins with edits that add nodes, followed by random steps.
pub(super) fn sequence() -> impl Strategy<Value = Vec<Step>> {
    let first = prop::collection::vec(add().prop_map(Step::Edit), 1..7);
    let step = prop_oneof![edit().prop_map(Step::Edit), command().prop_map(Step::Command)];
    let then = prop::collection::vec(step, 1..24);
    (first, then).prop_map(|(mut steps, then)| {
        steps.extend(then);
        steps
    })
}
