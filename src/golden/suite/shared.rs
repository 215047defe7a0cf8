//! Finds cases in different test files that use the same folder of goldens. Accepting the results of one such case would overwrite the
//! goldens of another.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use maquette_syntax::error::{Diagnostic, code};

use super::{Job, jobs_of, test_folder};
use crate::case;
use crate::case::TestFile;

/// Returns an error for each case that shares its folder of goldens with a case in another test file. The other test file need not be one
/// of `tests`. Also returns the test files with such cases.
pub fn shared_golden_folders(tests: &[TestFile]) -> (Vec<Diagnostic>, BTreeSet<PathBuf>) {
    // Handle the other test files before `tests`, so that each error is reported in a file of `tests`.
    let others = other_tests(tests);
    let mut first: BTreeMap<PathBuf, Job<'_>> = BTreeMap::new();
    let (mut diagnostics, mut files) = (Vec::new(), BTreeSet::new());
    for (index, test) in others.iter().chain(tests).enumerate() {
        for job in jobs_of(test) {
            let Some(other) = first.get(&job.folder) else {
                first.insert(job.folder.clone(), job);
                continue;
            };
            let names = [other, &job].map(|job| job.test.source.name.clone());
            if others.len() <= index && names[0] != names[1] {
                diagnostics.push(shared_folder_error(&job, &names));
                files.extend(names);
            }
        }
    }
    (diagnostics, files)
}

fn shared_folder_error(job: &Job<'_>, files: &[PathBuf; 2]) -> Diagnostic {
    let (name, case) = &job.test.cases[job.case];
    let (graph, [first, second]) =
        (job.graph.display(), files.each_ref().map(|file| file.display()));
    let message = format!("case `{name}` of {graph} is in {first} and in {second}");
    let folder = job.folder.display();
    let help = format!("both would have the goldens in {folder}: give one case another name");
    Diagnostic { help, ..job.test.diagnostic(code::BAD_NAME, case.span, message) }
}

/// Returns the valid test files that are in the folders of `tests`, but are not among `tests`.
fn other_tests(tests: &[TestFile]) -> Vec<TestFile> {
    let folders = BTreeSet::from_iter(tests.iter().map(test_folder));
    let paths = folders
        .into_iter()
        .flat_map(case::test_files_in)
        .filter(|path| tests.iter().all(|test| test.source.name != *path));
    paths.filter_map(|path| case::skim(&path)).collect()
}
