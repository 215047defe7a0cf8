//! Tests of graphs: whether their outputs are still those that somebody has accepted.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::catalog::Catalog;
use crate::eval::Evaluator;

pub(crate) mod case;
pub(crate) mod compare;
mod expect;
pub(crate) mod html;
mod intersect;
pub(crate) mod junit;
mod looks;
mod parts;
mod picture;
mod sketch;
pub(crate) mod store;
pub(crate) mod suite;
mod topology;

pub(crate) use compare::six;
pub use compare::{Comparison, Keep, Measure, Tolerance, Verdict, compare};
pub(crate) use expect::{Violation, nodes_of, violations};
pub(crate) use store::mesh_of;

/// What came out of the tests of a folder.
#[derive(Clone, Debug, PartialEq)]
pub struct TestRun {
    /// How many cases passed.
    pub passed: usize,
    /// The graphs that were tested.
    pub graphs: Vec<PathBuf>,
    /// What is wrong, one thing each.
    pub failures: Vec<String>,
}

/// Runs all tests of graphs in a folder, as `maquette test --cold` does, so many at once.
///
/// # Errors
/// If threads cannot be started.
pub fn test_graphs(folder: &Path, catalog: &Catalog, threads: usize) -> Result<TestRun, String> {
    /// Results of one case are small; this is plenty.
    const MEMORY: usize = 1 << 30;
    let settings = suite::Settings {
        catalog,
        filter: None,
        graphs: &BTreeMap::new(),
        cold: true,
        threads,
        evaluator: &|| Evaluator::new(1, MEMORY).map_err(|error| error.to_string()),
    };
    let report = suite::run(&case::find(folder), &settings)?;
    let mut failures =
        Vec::from_iter(report.problems.iter().map(|problem| problem.message.clone()));
    for case in report.cases.iter().filter(|case| case.failed()) {
        failures.extend(case.reasons().iter().map(|why| format!("{}: {why}", case.title())));
    }
    let orphans = report.orphans.iter();
    failures.extend(orphans.map(|path| format!("{} belongs to no test", path.display())));
    let mut graphs = Vec::from_iter(report.cases.iter().map(|case| case.graph.clone()));
    graphs.dedup();
    let passed = report.count(|case| case.state == suite::State::Passed);
    Ok(TestRun { passed, graphs, failures })
}
