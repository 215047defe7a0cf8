//! `maquette test`: compares the outputs of graphs with accepted outputs (goldens).

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::BufRead as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use clap::Args;
use maquette_engine::eval::State as NodeState;
use maquette_engine::six_digits;
use maquette_engine::writing::{Destination, Sources, WriteError, remove};
use maquette_golden::case;
use maquette_golden::compare::{Comparison, Verdict};
use maquette_golden::store::Golden;
use maquette_golden::suite;
use maquette_golden::suite::{Case, OutputComparison, Report, Settings, Shard, State, html, junit};
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Diagnostic, Severity};
use serde_json::json;

use super::cache_options::{self, CacheOptions};
use super::files::{filter_paths, is_companion};
use super::{Exit, eprint, format_count, has_errors, print, print_json, report};
use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct Test {
    /// Test files, graphs with tests, or folders to search for tests [default: the current folder].
    #[arg(value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Run only cases whose graph or name contains this text.
    #[arg(long, value_name = "TEXT")]
    filter: Option<String>,
    /// Run only part K of N. The cases are divided by name, so that N machines together run all cases.
    #[arg(long, value_name = "K/N")]
    shard: Option<Shard>,
    /// Accept all results as goldens. Like --review, refused if CI is set or goldens have uncommitted changes.
    #[arg(long, conflicts_with = "review")]
    bless: bool,
    /// Accept or reject the results one by one.
    #[arg(long)]
    review: bool,
    /// Write an HTML report with pictures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Write a JUnit report for CI systems.
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,
    /// Compute everything; do not use the cache.
    #[arg(long)]
    cold: bool,
    #[command(flatten)]
    cache: CacheOptions,
    /// Reject graphs if a used graph differs from the lock file.
    #[arg(long)]
    locked: bool,
    /// The number of cases to run at the same time; 0 for the number of hardware threads.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

impl Test {
    pub(super) fn run(&self, catalog: &Arc<Catalog>) -> Exit {
        let mut files = Vec::new();
        let mut graphs: BTreeMap<PathBuf, BTreeSet<PathBuf>> = BTreeMap::new();
        let here = [PathBuf::from(".")];
        let paths = if self.paths.is_empty() { &here[..] } else { &self.paths };
        for path in filter_paths(paths, is_companion) {
            if !path.exists() {
                return Exit::Usage(format!("there is no file or folder {}", path.for_display()));
            }
            if path.is_file() && !path.to_string_lossy().ends_with(case::EXTENSION) {
                let tests = case::tests_of(path);
                if tests.is_empty() {
                    return Exit::Usage(no_test_message(path));
                }
                for test in tests {
                    let graph = case::graph_of(&test, path);
                    graphs.entry(test).or_default().extend(graph);
                }
                continue;
            }
            files.extend(case::find(path).into_iter().map(|file| match file.strip_prefix(".") {
                Ok(file) => file.to_owned(),
                Err(_) => file,
            }));
        }
        // A test file may be selected both by one of its graphs and by its own path. Then run the test file for all of its graphs.
        graphs.retain(|test, _| !files.contains(test));
        files.extend(graphs.keys().cloned());
        files.sort();
        files.dedup();
        if files.is_empty() {
            return Exit::Usage(format!(
                "no test file found: expected a name that ends in {}",
                case::EXTENSION
            ));
        }
        let threads = match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let settings = Settings {
            catalog,
            filter: self.filter.as_deref(),
            shard: self.shard,
            graphs: &graphs,
            cold: self.cold,
            locked: self.locked,
            threads,
            session: &|| match self.cold {
                true => suite::cold_session(catalog, self.cache.max_memory),
                false => self.cache.session(1, catalog),
            },
            finish: &cache_options::finish,
        };
        let report = match suite::run(&files, &settings) {
            Ok(report) => report,
            Err(why) => return Exit::Usage(why),
        };
        if let Err(why) = self.write_reports(&report) {
            return Exit::Usage(why);
        }
        if self.bless || self.review {
            return self.accept(&report).unwrap_or_else(Exit::Usage);
        }
        if self.json {
            print_json(&to_json(&report));
        } else {
            print_report(&report);
        }
        exit_code(&report)
    }

    fn write_reports(&self, report: &Report) -> Result<(), String> {
        let mut sources = Sources::default();
        report.cases.iter().for_each(|case| sources.extend(&case.sources));
        let destination = Destination::anywhere(&sources);
        let write = |path: &Option<PathBuf>, make: &dyn Fn() -> String| match path {
            None => Ok(()),
            Some(path) => destination
                .put(path, make().as_bytes())
                .map_err(|error| format!("cannot write {}: {error}", path.for_display())),
        };
        write(&self.report, &|| html::page(report))?;
        write(&self.junit, &|| junit::document(report))
    }

    /// Stores results as goldens: all of them, or those that the user accepts. Fails if a result has errors or is not accepted.
    fn accept(&self, report: &Report) -> Result<Exit, String> {
        if std::env::var_os("CI").is_some_and(|ci| !ci.is_empty()) {
            return Err("cannot accept goldens where CI is set: a person must accept them".into());
        }
        let cases: Vec<&Case> = report
            .cases
            .iter()
            .filter(|case| {
                let rest = case.warnings.len() + case.orphans.len();
                case.state != State::Broken && (rest > 0 || case.changed_outputs().next().is_some())
            })
            .collect();
        let paths = cases.iter().map(|case| &case.folder).chain(&report.orphans);
        if let Some(path) = paths.filter_map(|path| find_uncommitted_change(path)).next() {
            return Err(format!("{path} has uncommitted changes; commit or discard them first"));
        }
        let mut count = Decisions::default();
        for case in cases {
            let done = self.accept_case(case, &mut count);
            done.map_err(|error| format!("cannot write {}: {error}", case.folder.for_display()))?;
            if count.quit {
                break;
            }
        }
        for orphan in &report.orphans {
            let gone = self.bless && remove(orphan).is_ok();
            count.refused += usize::from(!gone);
            let word = if gone { "removed " } else { "orphan  " };
            print(&format!("{word}  {}\n", orphan.for_display()));
        }
        print(&format!("{} blessed\n", format_count(count.accepted, "golden")));
        let wrong: Vec<&Case> = report
            .cases
            .iter()
            .filter(|case| !case.violations.is_empty() || has_errors(&case.diagnostics))
            .collect();
        let mut reported = ReportedDiagnostics::default();
        for case in &wrong {
            print(&format!("{}  {}\n", state_word(case), case.title()));
            reported.report(case);
        }
        self::report(&report.diagnostics);
        if let Some(why) = broken_message(report) {
            return Err(why);
        }
        let failed = count.quit || count.refused + wrong.len() > 0;
        Ok(if failed { Exit::Failed } else { Exit::Done })
    }

    fn accept_case(&self, case: &Case, count: &mut Decisions) -> Result<(), WriteError> {
        let why = describe_cause(case);
        let mut all = true;
        for output in case.changed_outputs() {
            if !self.ask(count, case, &output.name, &main_reasons(output), &why) {
                all = false;
                continue;
            }
            // Keep the reasons stored with the old golden if the value is the same and only its encoding has changed.
            let same = output.comparison.verdict == Verdict::Identical;
            let before = output.golden.as_ref().ok().filter(|_| same).map(Golden::reasons);
            let why = before.unwrap_or_else(|| why.clone());
            let size = case.bless(output, &why)?;
            count.accepted += 1;
            print(&format!(
                "blessed   {} {}: {}\n",
                case.title(),
                output.name,
                first_reason(output)
            ));
            if size > LARGE_GOLDEN {
                let size = size as f64 / 1e6;
                print(&format!(
                    "          takes {size:.1} MB; `keep: Sampled(every: 8)` in the test file keeps less\n"
                ));
            }
            why.iter().for_each(|why| print(&format!("          because {why}\n")));
        }
        let orphans = case.orphans.iter().map(|path| format!("{} goes", path.for_display()));
        let rest: Vec<String> = case.warnings.iter().cloned().chain(orphans).collect();
        if all && (rest.is_empty() || self.ask(count, case, "the rest", &rest, &why)) {
            case.bless_rest()?;
            rest.iter().for_each(|rest| print(&format!("          {rest}\n")));
        }
        Ok(())
    }

    /// Asks the user if a result is accepted. With `--bless`, returns true without asking. At the end of stdin, rejects the result and
    /// quits.
    fn ask(
        &self,
        count: &mut Decisions,
        case: &Case,
        what: &str,
        reasons: &[String],
        why: &[String],
    ) -> bool {
        if self.bless || count.quit {
            return self.bless;
        }
        print(&format!("\n{} {what}\n", case.title()));
        reasons.iter().for_each(|reason| print(&format!("  {reason}\n")));
        why.iter().for_each(|why| print(&format!("  because {why}\n")));
        loop {
            print("  accept, refuse, quit? [a/r/q] ");
            let mut answer = String::new();
            let read = std::io::stdin().lock().read_line(&mut answer);
            match (read, answer.trim()) {
                (Ok(0) | Err(_), _) | (_, "q" | "quit") => {
                    count.quit = true;
                    return false;
                }
                (_, "a" | "accept") => return true,
                (_, "r" | "refuse") => {
                    count.refused += 1;
                    return false;
                }
                _ => {}
            }
        }
    }
}

/// The size in bytes from which a golden is reported as large. Each change of a golden adds another copy to the repository.
const LARGE_GOLDEN: usize = 1 << 20;

fn no_test_message(graph: &Path) -> String {
    let name = graph.file_name().unwrap_or_default().to_string_lossy();
    let test = graph.with_extension("test.ron");
    format!(
        "no test file beside or above {} tests it: write `Test(graph: \"{name}\")` to {}",
        graph.for_display(),
        test.for_display()
    )
}

/// The decisions of the user in a review.
#[derive(Default)]
struct Decisions {
    accepted: usize,
    refused: usize,
    quit: bool,
}

/// Describes the changed nodes that may be the cause of different results.
fn describe_cause(case: &Case) -> Vec<String> {
    let is_new = case.outputs.iter().all(|output| output.golden.is_err());
    match case.changed_nodes() {
        _ if is_new => Vec::new(),
        changed if changed.is_empty() => {
            vec!["no node of the graph changed; the program computes another result".into()]
        }
        changed => changed,
    }
}

/// Returns the main reasons for the verdict on an output. The largest difference comes first.
fn main_reasons(output: &OutputComparison) -> Vec<String> {
    let comparison = &output.comparison;
    let mut reasons = comparison.reasons.clone();
    if reasons.is_empty() {
        let outdated = output.outdated_reason.filter(|_| comparison.verdict == Verdict::Identical);
        let outdated = outdated.map(|why| format!("; the golden {why}"));
        return vec![format!(
            "{}{}",
            describe_comparison(comparison),
            outdated.unwrap_or_default()
        )];
    }
    let worst = comparison.worst().filter(|worst| worst.failure.is_empty());
    if let Some(worst) = worst.filter(|worst| worst.unit == "mm") {
        reasons.insert(0, worst.in_words());
    }
    let more = reasons.len().saturating_sub(MAX_REASONS);
    reasons.truncate(MAX_REASONS);
    reasons.extend((more > 0).then(|| format!("and {more} more")));
    if comparison.compared_fraction() < 1.0 {
        reasons.push(describe_coverage(comparison));
    }
    reasons
}

/// Formats the verdict of a comparison and its largest difference.
fn describe_comparison(comparison: &Comparison) -> String {
    let verdict = comparison.verdict.word();
    let worst = comparison.worst().map_or(String::new(), |worst| format!(": {}", worst.in_words()));
    let some = if comparison.compared_fraction() < 1.0 {
        format!("; {}", describe_coverage(comparison))
    } else {
        String::new()
    };
    format!("{verdict}{worst}{some}")
}

fn describe_coverage(comparison: &Comparison) -> String {
    format!(
        "{} % of the entries were kept and compared",
        six_digits(100.0 * comparison.compared_fraction())
    )
}

/// The maximum number of reasons that are printed for an output. The HTML report contains all of them.
const MAX_REASONS: usize = 6;

fn first_reason(output: &OutputComparison) -> String {
    main_reasons(output).swap_remove(0)
}

/// Returns the first file with uncommitted changes in git, at or below a path. Returns `None` if no file has such changes, or if git is not
/// installed.
fn find_uncommitted_change(path: &Path) -> Option<String> {
    let folder = path.ancestors().find(|folder| folder.is_dir() && !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let path = std::path::absolute(path).ok()?;
    let mut git = Command::new("git");
    git.current_dir(folder)
        .args(["status", "--porcelain", "--untracked-files=all", "--"])
        .arg(path);
    let output = git.output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.lines().next().map(|line| line.get(3..).unwrap_or(line).to_owned())
}

/// Returns the message about tests that could not run. Returns `None` if all tests could run.
fn broken_message(report: &Report) -> Option<String> {
    let broken = report.count(|case| case.state == State::Broken) + report.broken_files();
    (broken > 0).then(|| format!("{} could not run", format_count(broken, "test")))
}

fn exit_code(report: &Report) -> Exit {
    match broken_message(report) {
        Some(why) => Exit::Usage(why),
        None if report.count(Case::has_failed) + report.orphans.len() > 0 => Exit::Failed,
        None => Exit::Done,
    }
}

/// The diagnostics that have already been reported. Several cases of one graph often have the same diagnostics.
#[derive(Default)]
struct ReportedDiagnostics(Vec<Diagnostic>);

impl ReportedDiagnostics {
    /// Reports the diagnostics of a case that have not been reported yet, and the number of those that have.
    fn report(&mut self, case: &Case) {
        let diagnostics =
            case.diagnostics.iter().chain(case.violations.iter().map(|v| &v.diagnostic));
        let (known, new): (Vec<&Diagnostic>, Vec<&Diagnostic>) =
            diagnostics.partition(|diagnostic| {
                self.0.iter().any(|known| {
                    (&known.source.name, known.span, &known.message)
                        == (&diagnostic.source.name, diagnostic.span, &diagnostic.message)
                })
            });
        let new: Vec<_> = new.into_iter().cloned().collect();
        report(&new);
        if !known.is_empty() {
            print(&format!("          {} (unchanged)\n", format_severities(&known)));
        }
        self.0.extend(new);
    }
}

/// Formats the numbers of errors and warnings, such as `1 error, 2 warnings`.
fn format_severities(diagnostics: &[&Diagnostic]) -> String {
    let counts =
        [(Severity::Error, "error"), (Severity::Warning, "warning")].map(|(severity, word)| {
            (diagnostics.iter().filter(|it| it.severity == severity).count(), word)
        });
    let counts = counts.iter().filter(|(count, _)| *count > 0);
    counts.map(|(count, word)| format_count(*count, word)).collect::<Vec<_>>().join(", ")
}

/// Formats the worst verdict among all outputs of a case.
fn worst_verdict(case: &Case) -> String {
    let worst = case.outputs.iter().map(|output| &output.comparison);
    worst
        .max_by_key(|comparison| comparison.verdict)
        .map_or("identical".into(), describe_comparison)
}

fn computed_count(case: &Case) -> usize {
    case.trace.count(NodeState::Computed)
}

fn print_report(result: &Report) {
    report(&result.diagnostics);
    let (mut text, mut reported) = (String::new(), ReportedDiagnostics::default());
    for case in &result.cases {
        let word = state_word(case);
        let nodes = format!(
            "{} of {} computed",
            computed_count(case),
            format_count(case.trace.0.len(), "node")
        );
        let _ = match &case.state {
            State::Skipped(why) => writeln!(text, "{word}  {}: {why}", case.title()),
            State::Passed => writeln!(
                text,
                "{word}  {}  {}; {nodes}; {:.0} ms",
                case.title(),
                worst_verdict(case),
                case.seconds * 1e3
            ),
            State::Failed | State::Broken => writeln!(text, "{word}  {}", case.title()),
        };
        if case.has_failed() {
            print(&std::mem::take(&mut text));
            reported.report(case);
            for output in
                case.outputs.iter().filter(|output| output.comparison.verdict == Verdict::Different)
            {
                for reason in main_reasons(output) {
                    let _ = writeln!(text, "          {}: {reason}", output.name);
                }
            }
            for warning in &case.warnings {
                let _ = writeln!(text, "          {warning}");
            }
            for orphan in &case.orphans {
                let _ = writeln!(text, "          {} belongs to no output", orphan.for_display());
            }
            for node in case.changed_nodes() {
                let _ = writeln!(text, "          {node}");
            }
        }
        for note in &case.notes {
            let _ = writeln!(text, "note      {}: {note}", case.title());
        }
    }
    for orphan in &result.orphans {
        let _ = writeln!(text, "failed    {} belongs to no test", orphan.for_display());
    }
    let passed = result.count(|case| case.state == State::Passed);
    let skipped = result.count(|case| matches!(case.state, State::Skipped(_)));
    let failed = result.count(Case::has_failed) + result.orphans.len() + result.broken_files();
    let skips = if skipped > 0 { format!(", {skipped} skipped") } else { String::new() };
    let nodes = match result.node_seconds() {
        0.0 => String::new(),
        seconds => format!(
            " ({seconds:.2} s of nodes and {:.2} s of files on {})",
            result.file_seconds(),
            format_count(result.threads, "thread")
        ),
    };
    let seconds = result.seconds;
    let _ = writeln!(text, "{passed} passed, {failed} failed{skips}; {seconds:.2} s{nodes}");
    print(&text);
    if failed > 0 {
        eprint("help: --report FILE.html shows what differs; --review or --bless accepts it\n");
    }
}

fn state_word(case: &Case) -> &'static str {
    match case.state {
        State::Passed => "passed  ",
        State::Failed => "failed  ",
        State::Broken => "broken  ",
        State::Skipped(_) => "skipped ",
    }
}

fn to_json(report: &Report) -> serde_json::Value {
    let cases = report.cases.iter().map(|case| {
        let outputs = case.outputs.iter().map(|output| {
            let mut json = output.comparison.to_json();
            json["name"] = output.name.clone().into();
            json["files"] = output.files.clone().into();
            json["type"] = output.value.kind().name.into();
            json
        });
        let diagnostics = case.diagnostics.iter().chain(case.violations.iter().map(|v| &v.diagnostic));
        json!({
            "graph": case.graph.display().to_string(),
            "case": case.name,
            "state": state_word(case).trim(),
            "reasons": case.reasons(),
            "outputs": outputs.collect::<Vec<_>>(),
            "changed": if case.has_failed() { case.changed_nodes() } else { Vec::new() },
            "problems": diagnostics.map(Diagnostic::to_json).collect::<Vec<_>>(),
            "orphans": case.orphans.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
            "notes": case.notes,
            "nodes": case.trace.0.iter().map(|node| node.to_json()).collect::<Vec<_>>(),
            "seconds": case.seconds,
        })
    });
    let errors = report.diagnostics.iter().filter(|p| p.severity == Severity::Error);
    json!({
        "passed": report.count(|case| case.state == State::Passed),
        "failed": report.count(Case::has_failed) + report.orphans.len() + report.diagnostics.len(),
        "cases": cases.collect::<Vec<_>>(),
        "problems": errors.map(Diagnostic::to_json).collect::<Vec<_>>(),
        "orphans": report.orphans.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        "seconds": report.seconds,
        "node_seconds": report.node_seconds(),
        "file_seconds": report.file_seconds(),
        "threads": report.threads,
    })
}
