//! The HTML report of tests: a single page, without other files, that shows old values, new values and differences.

use std::fmt::Display;

use maquette_engine::digits::six_digits;
use maquette_engine::eval::NodeTrace;
use maquette_format::data_uri;
use maquette_syntax::diagnostics::escape_xml as escape;
use maquette_syntax::error::Severity;

use super::picture::{self, Figure};
use super::{Case, OutputComparison, Report, State};
use crate::compare::{Measure, Verdict};

const STYLE: &str = include_str!("report.css");

/// Returns the HTML page of a report.
pub fn page(report: &Report) -> String {
    let n_failed = report.count(Case::has_failed) + report.orphans.len() + report.diagnostics.len();
    let passed = report.count(|case| case.state == State::Passed);
    let skipped = report.count(|case| matches!(case.state, State::Skipped(_)));
    let title = format!("{passed} passed, {n_failed} failed");
    let class = if n_failed > 0 { "bad" } else { "good" };
    let (n_cases, seconds) = (report.cases.len(), report.seconds);
    let skipped = if skipped > 0 { format!(", {skipped} skipped") } else { String::new() };
    let diagnostics = report.diagnostics.iter().map(|diagnostic| {
        let name = escape(diagnostic.source.name.display());
        let message = list("reasons", [&diagnostic.message]);
        format!("<article class=\"case\"><h2>{name}</h2>{message}</article>")
    });
    let (failed, passed): (Vec<&Case>, Vec<&Case>) =
        report.cases.iter().partition(|case| case.has_failed());
    let cases = failed.iter().enumerate().map(|(index, case)| case_article(case, index));
    let orphans = report.orphans.iter().map(|orphan| {
        format!("<p class=\"reasons\">{} belongs to no test</p>", escape(orphan.display()))
    });
    let content: String = diagnostics
        .chain([contents(&failed)])
        .chain(cases)
        .chain(orphans)
        .chain([passed_table(&passed)])
        .collect();
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body>\
         <header><h1 class=\"{class}\">{title}</h1><p>{n_cases} cases in {seconds:.2} s{skipped}</p></header>\
         <main>{content}</main></body></html>\n"
    )
}

fn list<T: Display>(class: &str, items: impl IntoIterator<Item = T>) -> String {
    let items: String =
        items.into_iter().map(|item| format!("<li>{}</li>", escape(item))).collect();
    if items.is_empty() { items } else { format!("<ul class=\"{class}\">{items}</ul>") }
}

/// Returns a table. Each row is HTML: a `tr` element.
fn table(headings: &[&str], rows: impl Iterator<Item = String>) -> String {
    let (headings, rows) = (headings.join("<th>"), rows.collect::<String>());
    format!("<div class=\"wide\"><table><tr><th>{headings}</tr>{rows}</table></div>")
}

/// If there are many failed cases, returns a table of contents with the first failure of each.
fn contents(failed: &[&Case]) -> String {
    const MAX_WITHOUT_CONTENTS: usize = 3;
    if failed.len() <= MAX_WITHOUT_CONTENTS {
        return String::new();
    }
    let rows = failed.iter().enumerate().map(|(index, case)| {
        let graph = escape(case.graph.display());
        let first = escape(case.reasons().first().map_or("", |reason| reason));
        let name = escape(&case.name);
        format!("<tr><td><a href=\"#case-{index}\">{graph}</a><td>{name}<td>{first}</tr>")
    });
    let table = table(&["failed", "case", "first reason"], rows);
    format!("<div class=\"contents\">{table}</div>")
}

fn case_article(case: &Case, index: usize) -> String {
    let (graph, name) = (escape(case.graph.display()), escape(&case.name));
    let errors =
        case.diagnostics.iter().filter(|diagnostic| diagnostic.severity == Severity::Error);
    let own = errors.chain(case.violations.iter().map(|violation| &violation.diagnostic));
    let orphans =
        case.orphans.iter().map(|path| format!("{} belongs to no output", path.display()));
    let own = own.map(|diagnostic| diagnostic.message.clone());
    let reasons = list("reasons", own.chain(case.warnings.iter().cloned()).chain(orphans));
    let mut nodes = list("nodes", case.changed_nodes());
    if !nodes.is_empty() {
        nodes.insert_str(0, "<h3>What changed in the graph</h3>");
    }
    let violations = case.violations.iter().filter(|violation| !violation.positions.is_empty());
    let violations = violations.filter_map(|violation| {
        picture::violation_figures(violation.value.as_ref()?, &violation.positions)
    });
    let violations: String = violations.map(|figures| figures_row(&figures)).collect();
    let outputs = case.outputs.iter();
    let outputs = outputs.filter(|output| output.comparison.verdict == Verdict::Different);
    let outputs: String = outputs.map(output_section).collect();
    let profile = profile(&case.trace.0);
    format!(
        "<article class=\"case\" id=\"case-{index}\"><h2>{graph} <small>{name}</small></h2>\
         {reasons}{nodes}{violations}{outputs}{profile}</article>"
    )
}

fn output_section(output: &OutputComparison) -> String {
    let (name, kind) = (escape(&output.name), output.value.kind().name);
    let files = escape(output.files.join(", "));
    let reasons = list("reasons", &output.comparison.reasons);
    let measures: Vec<&Measure> =
        output.comparison.measures.iter().filter(|m| m.max > 0.0).collect();
    let mut measured = String::new();
    if !measures.is_empty() {
        let headings =
            ["measured", "largest", "rms", "99 %", "allowed", "compared", "worst position"];
        measured = table(&headings, measures.into_iter().map(measure_row));
    }
    let figures = figures_row(&picture::figures(output));
    format!(
        "<section><h3>{name} <small>{kind} {files}</small></h3>{reasons}{measured}{figures}</section>"
    )
}

fn measure_row(m: &Measure) -> String {
    fn number(x: f64) -> String {
        if x.is_finite() { six_digits(x) } else { "∞".into() }
    }
    let numbers = match m.is_by_fraction {
        // Differences of flags have no size, so only the fraction of different elements is shown.
        true => format!("<td colspan=\"3\">{} % differ", six_digits(100.0 * m.differing)),
        false => [m.max, m.rms, m.p99].map(|x| format!("<td>{}", number(x))).concat(),
    };
    let class = if m.failure.is_empty() { "" } else { " class=\"bad\"" };
    let (name, unit, worst) = (escape(&m.name), m.unit, escape(&m.worst));
    let (allowed, compared) = (number(m.allowed), six_digits(100.0 * m.compared_fraction));
    format!(
        "<tr{class}><td>{name} <small>{unit}</small>{numbers}<td>{allowed}<td>{compared} %<td>{worst}</tr>"
    )
}

fn figures_row(figures: &[Figure]) -> String {
    if figures.is_empty() {
        return String::new();
    }
    let figures = figures.iter().map(|figure| {
        let caption = escape(&figure.caption);
        let class = if figure.pictures.len() > 1 { " class=\"flicker\"" } else { "" };
        let pictures = figure.pictures.iter().map(|picture| data_uri("image/png", picture));
        let pictures: String =
            pictures.map(|uri| format!("<img alt=\"{caption}\" src=\"{uri}\">")).collect();
        format!("<figure{class}><div>{pictures}</div><figcaption>{caption}</figcaption></figure>")
    });
    format!("<div class=\"figures\">{}</div>", figures.collect::<String>())
}

fn profile(nodes: &[NodeTrace]) -> String {
    if nodes.is_empty() {
        return String::new();
    }
    let longest = nodes.iter().map(|node| node.seconds).fold(1e-9, f64::max);
    let rows = nodes.iter().map(|node| {
        let (name, kind, reason) = (escape(&node.name), escape(&node.node), escape(&node.reason));
        let (state, percent) = (node.state.word(), 100.0 * node.seconds / longest);
        format!(
            "<tr><td>{name}<td>{kind}<td>{state}<td>{reason}\
             <td class=\"time\"><span style=\"width:{percent:.1}%\"></span>{:.1} ms</tr>",
            node.seconds * 1e3
        )
    });
    let table = table(&["node", "type", "state", "why", "time"], rows);
    format!("<details><summary>Nodes</summary>{table}</details>")
}

fn passed_table(cases: &[&Case]) -> String {
    if cases.is_empty() {
        return String::new();
    }
    let rows = cases.iter().map(|case| {
        let (graph, name, verdict) =
            (escape(case.graph.display()), escape(&case.name), verdict_cell(case));
        let outputs: Vec<_> = case.outputs.iter().map(|output| &output.name[..]).collect();
        let outputs = escape(outputs.join(", "));
        let milliseconds = case.seconds * 1e3;
        format!(
            "<tr><td>{graph}<td>{name}<td>{verdict}<td>{outputs}<td class=\"number\">{milliseconds:.0} ms</tr>"
        )
    });
    let table = table(&["graph", "case", "verdict", "outputs", "time"], rows);
    format!("<h2>Passed</h2>{table}")
}

/// Returns the verdict on a case that has not failed, and the notes on the case.
fn verdict_cell(case: &Case) -> String {
    let verdict = match &case.state {
        State::Skipped(why) => format!("skipped: {}", escape(why)),
        _ => {
            let worst = case.outputs.iter().map(|output| output.comparison.verdict).max();
            let word = worst.map_or("", Verdict::word);
            let seen = case.outputs.iter().map(|output| output.comparison.compared_fraction());
            match seen.fold(1.0, f64::min) {
                seen if seen < 1.0 => format!("{word}, {} % seen", six_digits(100.0 * seen)),
                _ => word.to_owned(),
            }
        }
    };
    let notes = case.notes.iter().map(|note| format!("<br><small>{}</small>", escape(note)));
    verdict + &notes.collect::<String>()
}
