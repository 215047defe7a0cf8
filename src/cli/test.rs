//! `maquette test`: golden tests of graphs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::BufRead as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use clap::Args;
use maquette_engine::eval::State as NodeState;
use maquette_engine::six;
use maquette_engine::writing::{Destination, Refused, Sources, remove};
use maquette_golden::case;
use maquette_golden::compare::{Comparison, Verdict};
use maquette_golden::store::Golden;
use maquette_golden::suite;
use maquette_golden::suite::{Case, Compared, Report, Settings, Shard, State, html, junit};
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::{Problem, Severity};
use serde_json::json;

use super::caching::{self, CacheOptions};
use super::files::{is_beside, without};
use super::{Exit, counted, eprint, print, print_json, report};
use crate::Shown;

#[derive(Args)]
pub(crate) struct Test {
    /// Test files, graphs that have some, or folders that are searched for them; the current folder if left out.
    #[arg(value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Only cases whose graph or name holds this.
    #[arg(long, value_name = "TEXT")]
    filter: Option<String>,
    /// Only part K of N of the cases: by name, so that the parts of N machines are together all cases.
    #[arg(long, value_name = "K/N")]
    shard: Option<Shard>,
    /// Accept all results as they are. Refused, as is --review, where CI is set and over goldens that are not committed.
    #[arg(long, conflicts_with = "review")]
    bless: bool,
    /// Accept or refuse the results one by one.
    #[arg(long)]
    review: bool,
    /// Write a page for the browser, with pictures.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Write the results for CI systems.
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,
    /// Compute everything: nothing may come from the cache.
    #[arg(long)]
    cold: bool,
    #[command(flatten)]
    cache: CacheOptions,
    /// Refuse graphs if one that they use is not what their lock file says.
    #[arg(long)]
    locked: bool,
    /// How many cases to run at once; 0 is as many as the machine has threads.
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
        for path in without(paths, is_beside) {
            if !path.exists() {
                return Exit::Usage(format!("there is no file or folder {}", path.shown()));
            }
            if path.is_file() && !path.to_string_lossy().ends_with(case::ENDING) {
                let tests = case::tests_of(path);
                if tests.is_empty() {
                    return Exit::Usage(no_test(path));
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
        // Who names a test file, too, or its folder, means all of its graphs.
        graphs.retain(|test, _| !files.contains(test));
        files.extend(graphs.keys().cloned());
        files.sort();
        files.dedup();
        if files.is_empty() {
            return Exit::Usage(format!("no file ends in {}", case::ENDING));
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
            finish: &caching::finish,
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
            show(&report);
        }
        exit(&report)
    }

    fn write_reports(&self, report: &Report) -> Result<(), String> {
        let mut sources = Sources::default();
        report.cases.iter().for_each(|case| sources.extend(&case.sources));
        let destination = Destination::anywhere(&sources);
        let write = |path: &Option<PathBuf>, make: &dyn Fn() -> String| match path {
            None => Ok(()),
            Some(path) => destination
                .put(path, make().as_bytes())
                .map_err(|error| format!("cannot write {}: {error}", path.shown())),
        };
        write(&self.report, &|| html::page(report))?;
        write(&self.junit, &|| junit::document(report))
    }

    /// Makes the results the goldens: all of them, or those that the user accepts. What cannot be accepted, or was not, fails.
    fn accept(&self, report: &Report) -> Result<Exit, String> {
        if std::env::var_os("CI").is_some_and(|ci| !ci.is_empty()) {
            return Err("refused where CI is set: goldens are accepted by people".into());
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
        if let Some(path) = paths.filter_map(|path| uncommitted(path)).next() {
            return Err(format!(
                "{path} has changes that are not committed: commit or drop them first"
            ));
        }
        let mut count = Count::default();
        for case in cases {
            let done = self.accept_case(case, &mut count);
            done.map_err(|error| format!("cannot write {}: {error}", case.folder.shown()))?;
            if count.quit {
                break;
            }
        }
        for orphan in &report.orphans {
            let gone = self.bless && remove(orphan).is_ok();
            count.refused += usize::from(!gone);
            let word = if gone { "removed " } else { "orphan  " };
            print(&format!("{word}  {}\n", orphan.shown()));
        }
        print(&format!("{} blessed\n", counted(count.accepted, "golden")));
        let wrong: Vec<&Case> = report
            .cases
            .iter()
            .filter(|case| {
                !case.violations.is_empty()
                    || case.problems.iter().any(|problem| problem.severity == Severity::Error)
            })
            .collect();
        let mut told = Told::default();
        for case in &wrong {
            print(&format!("{}  {}\n", word(case), case.title()));
            told.report(case);
        }
        self::report(&report.problems);
        if let Some(why) = broken(report) {
            return Err(why);
        }
        let failed = count.quit || count.refused + wrong.len() > 0;
        Ok(if failed { Exit::Failed } else { Exit::Done })
    }

    fn accept_case(&self, case: &Case, count: &mut Count) -> Result<(), Refused> {
        let why = reason(case);
        let mut all = true;
        for output in case.changed_outputs() {
            if !self.asks(count, case, &output.name, &reasons_of(output), &why) {
                all = false;
                continue;
            }
            // The same value in another form is still there for the reason that it had.
            let same = output.comparison.verdict == Verdict::Identical;
            let before = output.golden.as_ref().ok().filter(|_| same).map(Golden::because);
            let why = before.unwrap_or_else(|| why.clone());
            let size = case.bless(output, &why)?;
            count.accepted += 1;
            print(&format!("blessed   {} {}: {}\n", case.title(), output.name, in_short(output)));
            if size > LARGE {
                let size = size as f64 / 1e6;
                print(&format!(
                    "          takes {size:.1} MB; `keep: Sampled(every: 8)` in the test file keeps less\n"
                ));
            }
            why.iter().for_each(|why| print(&format!("          because {why}\n")));
        }
        let orphans = case.orphans.iter().map(|path| format!("{} goes", path.shown()));
        let rest: Vec<String> = case.warnings.iter().cloned().chain(orphans).collect();
        if all && (rest.is_empty() || self.asks(count, case, "the rest", &rest, &why)) {
            case.bless_rest()?;
            rest.iter().for_each(|rest| print(&format!("          {rest}\n")));
        }
        Ok(())
    }

    /// Asks whether a result is right, unless all are. No answer is no, and the end.
    fn asks(
        &self,
        count: &mut Count,
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

/// A golden of so many bytes is worth a word: it is committed again with each change.
const LARGE: usize = 1 << 20;

fn no_test(graph: &Path) -> String {
    let name = graph.file_name().unwrap_or_default().to_string_lossy();
    let test = graph.with_extension("test.ron");
    format!(
        "no test file beside or above {} tests it: write `Test(graph: \"{name}\")` to {}",
        graph.shown(),
        test.shown()
    )
}

/// What a user decided.
#[derive(Default)]
struct Count {
    accepted: usize,
    refused: usize,
    quit: bool,
}

/// Why results are others than they were.
fn reason(case: &Case) -> Vec<String> {
    let is_new = case.outputs.iter().all(|output| output.golden.is_err());
    match case.changed_nodes() {
        _ if is_new => Vec::new(),
        changed if changed.is_empty() => {
            vec!["no node of the graph changed: the program gives another result".into()]
        }
        changed => changed,
    }
}

/// Some of what is to be said of an output: how far it differs first.
fn reasons_of(output: &Compared) -> Vec<String> {
    let comparison = &output.comparison;
    let mut reasons = comparison.reasons.clone();
    if reasons.is_empty() {
        let outdated = output.outdated.filter(|_| comparison.verdict == Verdict::Identical);
        let outdated = outdated.map(|why| format!("; the golden {why}"));
        return vec![format!("{}{}", in_words(comparison), outdated.unwrap_or_default())];
    }
    let worst = comparison.worst().filter(|worst| worst.broken.is_empty());
    if let Some(worst) = worst.filter(|worst| worst.unit == "mm") {
        reasons.insert(0, worst.in_words());
    }
    let more = reasons.len().saturating_sub(MOST_REASONS);
    reasons.truncate(MOST_REASONS);
    reasons.extend((more > 0).then(|| format!("and {more} more")));
    if comparison.seen() < 1.0 {
        reasons.push(seen(comparison));
    }
    reasons
}

/// The verdict, and how much differs within the tolerance.
fn in_words(comparison: &Comparison) -> String {
    let verdict = comparison.verdict.word();
    let worst = comparison.worst().map_or(String::new(), |worst| format!(": {}", worst.in_words()));
    let some =
        if comparison.seen() < 1.0 { format!("; {}", seen(comparison)) } else { String::new() };
    format!("{verdict}{worst}{some}")
}

fn seen(comparison: &Comparison) -> String {
    format!("{} % of the entries were kept and seen", six(100.0 * comparison.seen()))
}

/// How many reasons of an output are told; the page tells all.
const MOST_REASONS: usize = 6;

fn in_short(output: &Compared) -> String {
    reasons_of(output).swap_remove(0)
}

/// The first file at a path, or below it, that git knows to be changed; none where there is no git.
fn uncommitted(path: &Path) -> Option<String> {
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

/// Why tests could not run, if some could not.
fn broken(report: &Report) -> Option<String> {
    let broken = report.count(|case| case.state == State::Broken) + report.broken_files();
    (broken > 0).then(|| format!("{} could not run", counted(broken, "test")))
}

fn exit(report: &Report) -> Exit {
    match broken(report) {
        Some(why) => Exit::Usage(why),
        None if report.count(Case::failed) + report.orphans.len() > 0 => Exit::Failed,
        None => Exit::Done,
    }
}

/// Problems that were told: those of a graph are the same in each of its cases.
#[derive(Default)]
struct Told(Vec<Problem>);

impl Told {
    /// Tells the problems of a case that were not told before.
    fn report(&mut self, case: &Case) {
        let problems = case.problems.iter().chain(case.violations.iter().map(|v| &v.problem));
        let (known, new): (Vec<&Problem>, Vec<&Problem>) = problems.partition(|problem| {
            self.0.iter().any(|known| {
                (&known.source.name, known.span, &known.message)
                    == (&problem.source.name, problem.span, &problem.message)
            })
        });
        let new: Vec<_> = new.into_iter().cloned().collect();
        report(&new);
        if !known.is_empty() {
            print(&format!("          {} as before\n", counted(known.len(), "problem")));
        }
        self.0.extend(new);
    }
}

/// The worst verdict of all outputs of a case, in words.
fn verdict(case: &Case) -> String {
    let worst = case.outputs.iter().map(|output| &output.comparison);
    worst.max_by_key(|comparison| comparison.verdict).map_or("identical".into(), in_words)
}

fn computed(case: &Case) -> usize {
    case.trace.count(NodeState::Computed)
}

fn show(result: &Report) {
    report(&result.problems);
    let (mut text, mut told) = (String::new(), Told::default());
    for case in &result.cases {
        let word = word(case);
        let nodes =
            format!("{} of {} computed", computed(case), counted(case.trace.0.len(), "node"));
        let _ = match &case.state {
            State::Skipped(why) => writeln!(text, "{word}  {}: {why}", case.title()),
            State::Passed => writeln!(
                text,
                "{word}  {}  {}; {nodes}; {:.0} ms",
                case.title(),
                verdict(case),
                case.seconds * 1e3
            ),
            State::Failed | State::Broken => writeln!(text, "{word}  {}", case.title()),
        };
        if case.failed() {
            print(&std::mem::take(&mut text));
            told.report(case);
            for output in
                case.outputs.iter().filter(|output| output.comparison.verdict == Verdict::Different)
            {
                for reason in reasons_of(output) {
                    let _ = writeln!(text, "          {}: {reason}", output.name);
                }
            }
            for warning in &case.warnings {
                let _ = writeln!(text, "          {warning}");
            }
            for orphan in &case.orphans {
                let _ = writeln!(text, "          {} belongs to no output", orphan.shown());
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
        let _ = writeln!(text, "failed    {} belongs to no test", orphan.shown());
    }
    let passed = result.count(|case| case.state == State::Passed);
    let skipped = result.count(|case| matches!(case.state, State::Skipped(_)));
    let failed = result.count(Case::failed) + result.orphans.len() + result.broken_files();
    let skips = if skipped > 0 { format!(", {skipped} skipped") } else { String::new() };
    let nodes = match result.node_seconds() {
        0.0 => String::new(),
        seconds => format!(
            " ({seconds:.2} s of nodes and {:.2} s of files on {})",
            result.file_seconds(),
            counted(result.threads, "thread")
        ),
    };
    let seconds = result.seconds;
    let _ = writeln!(text, "{passed} passed, {failed} failed{skips}; {seconds:.2} s{nodes}");
    print(&text);
    if failed > 0 {
        eprint("help: --report FILE.html shows what differs; --review or --bless accepts it\n");
    }
}

fn word(case: &Case) -> &'static str {
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
        let problems = case.problems.iter().chain(case.violations.iter().map(|v| &v.problem));
        json!({
            "graph": case.graph.display().to_string(),
            "case": case.name,
            "state": word(case).trim(),
            "reasons": case.reasons(),
            "outputs": outputs.collect::<Vec<_>>(),
            "changed": if case.failed() { case.changed_nodes() } else { Vec::new() },
            "problems": problems.map(Problem::to_json).collect::<Vec<_>>(),
            "orphans": case.orphans.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
            "notes": case.notes,
            "nodes": case.trace.0.iter().map(|node| node.to_json()).collect::<Vec<_>>(),
            "seconds": case.seconds,
        })
    });
    let errors = report.problems.iter().filter(|p| p.severity == Severity::Error);
    json!({
        "passed": report.count(|case| case.state == State::Passed),
        "failed": report.count(Case::failed) + report.orphans.len() + report.problems.len(),
        "cases": cases.collect::<Vec<_>>(),
        "problems": errors.map(Problem::to_json).collect::<Vec<_>>(),
        "orphans": report.orphans.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        "seconds": report.seconds,
        "node_seconds": report.node_seconds(),
        "file_seconds": report.file_seconds(),
        "threads": report.threads,
    })
}
