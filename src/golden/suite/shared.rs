//! Cases of different test files that would have one folder of goldens, so that what one accepts the other loses.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use maquette_syntax::error::{Problem, code};

use super::{Job, beside, jobs_of};
use crate::case;
use crate::case::TestFile;

/// An error for each case whose folder of goldens is that of a case of another test file, be that one named now or not, and the files
/// that have such cases.
pub fn shared(tests: &[TestFile]) -> (Vec<Problem>, BTreeSet<PathBuf>) {
    // Those that are not named now come first, so that each error stands in a named one.
    let others = others(tests);
    let mut first: BTreeMap<PathBuf, Job<'_>> = BTreeMap::new();
    let (mut problems, mut files) = (Vec::new(), BTreeSet::new());
    for (index, test) in others.iter().chain(tests).enumerate() {
        for job in jobs_of(test) {
            let Some(other) = first.get(&job.folder) else {
                first.insert(job.folder.clone(), job);
                continue;
            };
            let names = [other, &job].map(|job| job.test.source.name.clone());
            if others.len() <= index && names[0] != names[1] {
                problems.push(told(&job, &names));
                files.extend(names);
            }
        }
    }
    (problems, files)
}

fn told(job: &Job<'_>, files: &[PathBuf; 2]) -> Problem {
    let (name, case) = &job.test.cases[job.case];
    let (graph, [first, second]) =
        (job.graph.display(), files.each_ref().map(|file| file.display()));
    let message = format!("case `{name}` of {graph} is in {first} and in {second}");
    let folder = job.folder.display();
    let help = format!("both would have the goldens in {folder}: give one case another name");
    Problem { help, ..job.test.problem(code::BAD_NAME, case.span, message) }
}

/// The other test files in the folders of these, as far as they can be read.
fn others(tests: &[TestFile]) -> Vec<TestFile> {
    let folders = BTreeSet::from_iter(tests.iter().map(beside));
    let paths = folders
        .into_iter()
        .flat_map(case::in_folder)
        .filter(|path| tests.iter().all(|test| test.source.name != *path));
    paths.filter_map(|path| case::skim(&path)).collect()
}
