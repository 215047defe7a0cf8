//! The HTML report of tests: a single page, without other files, that shows old values, new values and differences.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use maquette_engine::digits::six_digits;
use maquette_engine::eval::NodeTrace;
use maquette_syntax::error::Severity;

use super::junit::escape;
use super::picture::{self, Figure};
use super::{Case, OutputComparison, Report, State};
use crate::compare::{Measure, Verdict};

const STYLE: &str = include_str!("report.css");

/// Returns the HTML page of a report.
pub fn page(report: &Report) -> String {
    let failed = report.count(Case::has_failed) + report.orphans.len() + report.diagnostics.len();
    let passed = report.count(|case| case.state == State::Passed);
    let skipped = report.count(|case| matches!(case.state, State::Skipped(_)));
    let title = format!("{passed} passed, {failed} failed");
    let mut text = String::new();
    let _ = write!(
        text,
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body>\
         <header><h1 class=\"{}\">{title}</h1><p>{} cases in {:.2} s{}</p></header><main>",
        if failed > 0 { "bad" } else { "good" },
        report.cases.len(),
        report.seconds,
        if skipped > 0 { format!(", {skipped} skipped") } else { String::new() },
    );
    for diagnostic in &report.diagnostics {
        let (name, message) = (diagnostic.source.name.display().to_string(), &diagnostic.message);
        let _ = write!(
            text,
            "<article class=\"case\"><h2>{}</h2><ul class=\"reasons\"><li>{}</li></ul></article>",
            escape(&name),
            escape(message)
        );
    }
    let failed: Vec<&Case> = report.cases.iter().filter(|case| case.has_failed()).collect();
    push_contents(&mut text, &failed);
    for (index, case) in failed.iter().enumerate() {
        push_case(&mut text, case, index);
    }
    for orphan in &report.orphans {
        let _ = write!(
            text,
            "<p class=\"reasons\">{} belongs to no test</p>",
            escape(&orphan.display().to_string())
        );
    }
    push_table(&mut text, report);
    text + "</main></body></html>\n"
}

/// Adds a table of contents with the first failure of each case, if many cases have failed.
fn push_contents(text: &mut String, failed: &[&Case]) {
    const MAX_WITHOUT_CONTENTS: usize = 3;
    if failed.len() <= MAX_WITHOUT_CONTENTS {
        return;
    }
    text.push_str(
        "<div class=\"wide\"><table class=\"contents\"><tr><th>failed<th>case<th>first reason</tr>",
    );
    for (index, case) in failed.iter().enumerate() {
        let first = case.reasons().into_iter().next().unwrap_or_default();
        let _ = write!(
            text,
            "<tr><td><a href=\"#case-{index}\">{}</a><td>{}<td>{}</tr>",
            escape(&case.graph.display().to_string()),
            escape(&case.name),
            escape(&first)
        );
    }
    text.push_str("</table></div>");
}

fn push_case(text: &mut String, case: &Case, index: usize) {
    let title = format!(
        "{} <small>{}</small>",
        escape(&case.graph.display().to_string()),
        escape(&case.name)
    );
    let _ = write!(text, "<article class=\"case\" id=\"case-{index}\"><h2>{title}</h2>");
    let errors =
        case.diagnostics.iter().filter(|diagnostic| diagnostic.severity == Severity::Error);
    let own = errors.chain(case.violations.iter().map(|violation| &violation.diagnostic));
    let own: Vec<_> = own.map(|diagnostic| escape(&diagnostic.message)).collect();
    let orphans = case
        .orphans
        .iter()
        .map(|path| format!("{} belongs to no output", escape(&path.display().to_string())));
    let warnings = case.warnings.iter().map(|warning| escape(warning));
    push_list(text, "reasons", own.into_iter().chain(warnings).chain(orphans));
    let nodes = case.changed_nodes();
    if !nodes.is_empty() {
        text.push_str("<h3>What changed in the graph</h3>");
        push_list(text, "nodes", nodes.iter().map(|node| escape(node)));
    }
    for violation in case.violations.iter().filter(|violation| !violation.positions.is_empty()) {
        let value = violation.value.as_ref();
        let figures =
            value.and_then(|value| picture::violation_figures(value, &violation.positions));
        push_figures(text, &figures.unwrap_or_default());
    }
    for output in
        case.outputs.iter().filter(|output| output.comparison.verdict == Verdict::Different)
    {
        push_output(text, output);
    }
    push_profile(text, &case.trace.0);
    text.push_str("</article>");
}

fn push_list(text: &mut String, class: &str, items: impl Iterator<Item = String>) {
    let items: String = items.map(|item| format!("<li>{item}</li>")).collect();
    if !items.is_empty() {
        let _ = write!(text, "<ul class=\"{class}\">{items}</ul>");
    }
}

fn push_output(text: &mut String, output: &OutputComparison) {
    let files = output.files.join(", ");
    let _ = write!(
        text,
        "<section><h3>{} <small>{} {}</small></h3>",
        escape(&output.name),
        output.value.kind().name,
        escape(&files)
    );
    push_list(text, "reasons", output.comparison.reasons.iter().map(|reason| escape(reason)));
    fn differs(m: &&Measure) -> bool {
        m.max > 0.0
    }
    if output.comparison.measures.iter().any(|m| differs(&m)) {
        text.push_str("<div class=\"wide\"><table><tr><th>measured<th>largest<th>rms<th>99 %<th>allowed<th>compared<th>worst position</tr>");
        for m in output.comparison.measures.iter().filter(differs) {
            let class = if m.failure.is_empty() { "" } else { " class=\"bad\"" };
            fn number(x: f64) -> String {
                if x.is_finite() { six_digits(x) } else { "∞".into() }
            }
            let numbers = match m.is_by_fraction {
                // Elements that are only equal or different have no size of difference, so show the fraction of different elements.
                true => format!("<td colspan=\"3\">{} % differ", six_digits(100.0 * m.differing)),
                false => [m.max, m.rms, m.p99].map(|x| format!("<td>{}", number(x))).concat(),
            };
            let _ = write!(
                text,
                "<tr{class}><td>{} <small>{}</small>{numbers}<td>{}<td>{} %<td>{}</tr>",
                escape(&m.name),
                m.unit,
                number(m.allowed),
                six_digits(100.0 * m.compared_fraction),
                escape(&m.worst)
            );
        }
        text.push_str("</table></div>");
    }
    push_figures(text, &picture::figures(output));
    text.push_str("</section>");
}

fn push_figures(text: &mut String, figures: &[Figure]) {
    if figures.is_empty() {
        return;
    }
    text.push_str("<div class=\"figures\">");
    for figure in figures {
        let caption = escape(&figure.caption);
        let _ = write!(
            text,
            "<figure{}>",
            if figure.pictures.len() > 1 { " class=\"flicker\"" } else { "" }
        );
        text.push_str("<div>");
        for picture in &figure.pictures {
            let _ = write!(
                text,
                "<img alt=\"{caption}\" src=\"data:image/png;base64,{}\">",
                BASE64_STANDARD.encode(picture)
            );
        }
        let _ = write!(text, "</div><figcaption>{caption}</figcaption></figure>");
    }
    text.push_str("</div>");
}

fn push_profile(text: &mut String, nodes: &[NodeTrace]) {
    if nodes.is_empty() {
        return;
    }
    let longest = nodes.iter().map(|node| node.seconds).fold(1e-9, f64::max);
    text.push_str("<details><summary>Nodes</summary><div class=\"wide\"><table><tr><th>node<th>type<th>state<th>why<th>time</tr>");
    for node in nodes {
        let percent = 100.0 * node.seconds / longest;
        let _ = write!(
            text,
            "<tr><td>{}<td>{}<td>{}<td>{}<td class=\"time\"><span style=\"width:{percent:.1}%\"></span>{:.1} ms</tr>",
            escape(&node.name),
            escape(&node.node),
            node.state.word(),
            escape(&node.reason),
            node.seconds * 1e3
        );
    }
    text.push_str("</table></div></details>");
}

fn push_table(text: &mut String, report: &Report) {
    let rest: Vec<&Case> = report.cases.iter().filter(|case| !case.has_failed()).collect();
    if rest.is_empty() {
        return;
    }
    text.push_str("<h2>Passed</h2><div class=\"wide\"><table><tr><th>graph<th>case<th>verdict<th>outputs<th>time</tr>");
    for case in rest {
        let worst = case.outputs.iter().map(|output| output.comparison.verdict).max();
        let verdict = match &case.state {
            State::Skipped(why) => format!("skipped: {}", escape(why)),
            _ => {
                let seen = case.outputs.iter().map(|output| output.comparison.compared_fraction());
                let seen = seen.fold(1.0, f64::min);
                let some = if seen < 1.0 {
                    format!(", {} % seen", six_digits(100.0 * seen))
                } else {
                    String::new()
                };
                format!("{}{some}", worst.map_or("", Verdict::word))
            }
        };
        let outputs =
            case.outputs.iter().map(|output| escape(&output.name)).collect::<Vec<_>>().join(", ");
        let notes: String =
            case.notes.iter().map(|note| format!("<br><small>{}</small>", escape(note))).collect();
        let _ = write!(
            text,
            "<tr><td>{}<td>{}<td>{verdict}{notes}<td>{outputs}<td class=\"number\">{:.0} ms</tr>",
            escape(&case.graph.display().to_string()),
            escape(&case.name),
            case.seconds * 1e3
        );
    }
    text.push_str("</table></div>");
}
