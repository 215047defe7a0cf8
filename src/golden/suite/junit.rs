//! The JUnit XML report, for CI systems.

use std::fmt::Write as _;

use maquette_engine::digits::six_digits;
use maquette_syntax::diagnostics::escape_xml as escape;

use super::{Report, State};
use crate::compare::Comparison;

/// Returns the JUnit document of a report.
pub fn document(report: &Report) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let failures = report.count(|case| case.state == State::Failed) + report.orphans.len();
    let errors = report.count(|case| case.state == State::Broken) + report.diagnostics.len();
    let skipped = report.count(|case| matches!(case.state, State::Skipped(_)));
    let tests = report.cases.len() + report.orphans.len() + report.diagnostics.len();
    let _ = writeln!(
        text,
        "<testsuites><testsuite name=\"maquette\" tests=\"{tests}\" failures=\"{failures}\" errors=\"{errors}\" skipped=\"{skipped}\" time=\"{:.3}\">",
        report.seconds
    );
    for case in &report.cases {
        let (graph, name) = (escape(case.graph.display()), escape(&case.name));
        let _ = writeln!(
            text,
            "<testcase classname=\"{graph}\" name=\"{name}\" time=\"{:.3}\">",
            case.seconds
        );
        if !case.outputs.is_empty() {
            text.push_str("<properties>");
            for output in &case.outputs {
                let name = escape(&output.name);
                let value = escape(in_words(&output.comparison));
                let hash = output.value.hash().short();
                let _ = write!(text, "<property name=\"{name}\" value=\"{value}; {hash}\"/>");
            }
            text.push_str("</properties>\n");
        }
        let reasons = escape(case.reasons().join("\n"));
        let first = escape(case.reasons().first().map_or("", |reason| reason));
        let _ = match &case.state {
            State::Passed => Ok(()),
            State::Failed => writeln!(text, "<failure message=\"{first}\">{reasons}</failure>"),
            State::Broken => writeln!(text, "<error message=\"{first}\">{reasons}</error>"),
            State::Skipped(why) => writeln!(text, "<skipped message=\"{}\"/>", escape(why)),
        };
        text.push_str("</testcase>\n");
    }
    for orphan in &report.orphans {
        let name = escape(orphan.display());
        let _ = writeln!(
            text,
            "<testcase classname=\"goldens\" name=\"{name}\"><failure message=\"belongs to no test\"/></testcase>"
        );
    }
    for diagnostic in &report.diagnostics {
        let (name, message) =
            (escape(diagnostic.source.name.display()), escape(&diagnostic.message));
        let _ = writeln!(
            text,
            "<testcase classname=\"tests\" name=\"{name}\"><error message=\"{message}\"/></testcase>"
        );
    }
    text + "</testsuite></testsuites>\n"
}

/// Describes a comparison by its verdict, its largest difference, and the fraction of entries that was compared.
fn in_words(comparison: &Comparison) -> String {
    let verdict = comparison.verdict.word().to_owned();
    let worst = comparison.worst().map(|worst| worst.in_words());
    let seen =
        format!("{} % of the entries seen", six_digits(100.0 * comparison.compared_fraction()));
    [Some(verdict), worst, Some(seen)].into_iter().flatten().collect::<Vec<_>>().join("; ")
}
