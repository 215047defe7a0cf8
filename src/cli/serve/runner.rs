//! The thread that evaluates while the other one listens to the host.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use maquette_engine::eval::NodeTrace;
use maquette_engine::session;
use maquette_engine::session::{Finished, Session, Wanted};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, InputValues, Options};
use maquette_node::CancelToken;
use maquette_syntax::error::{Problem, Severity, in_words, with_those_of_run};
use maquette_value::AnyValue;
use serde_json::{Value as Json, json};

use super::columns::Columns;
use super::request::{Form, Input, Load, Run, Want};
use super::{Answer, lock};
use crate::events::{Events, Listener};
use crate::put_problems;

/// What the thread is to do.
pub(super) enum Job {
    Run(Run, CancelToken),
    Input(Input),
    Why(Load, String),
}

/// The runs that can be stopped, by the ids of their requests.
pub(super) type Runs = Arc<Mutex<HashMap<String, CancelToken>>>;

pub(super) struct Runner {
    pub(super) session: Session,
    pub(super) catalog: Arc<Catalog>,
    pub(super) columns: Columns,
    pub(super) listener: Listener,
    pub(super) runs: Runs,
    /// Values for inputs, by hash, the oldest first.
    pub(super) values: VecDeque<AnyValue>,
}

/// So many values for inputs are kept.
const VALUES: usize = 64;

impl Runner {
    /// Does all jobs, until there can be no more of them.
    pub(super) fn work(mut self, jobs: &Receiver<(Json, Job)>) {
        let mut waiting = VecDeque::new();
        while let Some((id, job)) = waiting.pop_front().or_else(|| jobs.recv().ok()) {
            waiting.extend(jobs.try_iter());
            let answer = match &job {
                Job::Run(run, _) if waiting.iter().any(|(_, later)| is_of(later, run)) => {
                    Ok(json!({ "replaced": true }))
                }
                job => {
                    catch_unwind(AssertUnwindSafe(|| self.done(&id, job))).unwrap_or_else(|panic| {
                        // What it was about to remember may be half of something.
                        self.session.forget();
                        Err(Refused::from(format!("a bug of this program: {}", in_words(&*panic))))
                    })
                }
            };
            lock(&self.runs).remove(&id.to_string());
            self.listener.answer(&id, answer);
        }
        self.session.finish();
    }

    fn done(&mut self, id: &Json, job: &Job) -> Result<Json, Refused> {
        match job {
            Job::Run(run, cancel) => self.run(id, run, cancel),
            Job::Input(input) => self.input(input),
            Job::Why(load, node) => self.why(load, node),
        }
    }

    fn graph(&self, load: &Load) -> Result<(Graph, Vec<Problem>), Refused> {
        let checked = Graph::load(&load.graph, &self.catalog, &options(load)).as_far_as_known();
        let problems = checked.problems;
        match checked.graph {
            Some(graph) => Ok((graph, problems)),
            None => Err(Refused { why: "the graph has problems".into(), problems }),
        }
    }

    fn run(&mut self, id: &Json, run: &Run, cancel: &CancelToken) -> Result<Json, Refused> {
        let start = Instant::now();
        let Run { graph, roots, set, inputs, want, .. } = run;
        let (graph, roots, set) = (graph.clone(), roots.clone(), set.clone());
        let Run { draft, pins, locked, .. } = *run;
        let load = Load { graph, roots, set, draft, pins, locked };
        let (graph, mut problems) = self.graph(&load)?;
        let inputs = self.inputs(inputs)?;
        let wanted = match want {
            None => Wanted::Outputs,
            Some(want) => Wanted::Named(want.iter().map(|want| want.value.clone()).collect()),
        };
        let hear = self.listener.clone();
        let named = id.clone();
        let listener = Listener::new(move |event| {
            let mut event = event.clone();
            event["run"] = named.clone();
            hear.pass(&event);
        });
        let events = Events::new(listener, cancel.clone());
        let asked = session::Run { wanted, inputs, observer: &events, cancel: cancel.clone() };
        let finished = self
            .session
            .run(&graph, &asked)
            .map_err(|problems| Refused { why: "it cannot be run".into(), problems })?;
        if cancel.is_cancelled() {
            return Ok(json!({ "cancelled": true }));
        }
        problems = with_those_of_run(problems, finished.problems());
        problems.extend(self.session.warnings(&graph));
        let values = self.values(&finished, &graph, want.as_deref());
        self.columns.answered(&run.slot());
        let trace = finished.trace();
        let mut answer = json!({
            "ok": problems.iter().all(|problem| problem.severity != Severity::Error),
            "nodes": trace.0.iter().map(NodeTrace::to_json).collect::<Vec<_>>(),
            "values": values,
            "seconds": start.elapsed().as_secs_f64(),
        });
        put_problems(&mut answer, &problems);
        Ok(answer)
    }

    /// The values that were wanted, all outputs of the graph if nothing is named: those that there are, and why one cannot be given as it
    /// was wanted.
    fn values(
        &mut self,
        finished: &Finished,
        graph: &Graph,
        want: Option<&[Want]>,
    ) -> BTreeMap<String, Json> {
        let want = want.map_or_else(
            || {
                let names = graph.results().map(|(name, _)| name.to_owned());
                names.map(|value| Want { value, form: Form::default() }).collect()
            },
            <[Want]>::to_vec,
        );
        let mut values = BTreeMap::new();
        for Want { value: name, form } in want {
            let Some(value) = finished.value(&name) else { continue };
            let (columns, catalog) = (&mut self.columns, &self.catalog);
            let told = self.session.install(|| columns.value(value, form, catalog));
            let told = told.unwrap_or_else(|why| json!({ "type": value.kind().name, "why": why }));
            values.insert(name, told);
        }
        values
    }

    fn inputs(&self, given: &BTreeMap<String, String>) -> Result<InputValues, Refused> {
        given
            .iter()
            .map(|(name, hash): (&String, &String)| {
                let known = self.values.iter().find(|value| value.hash().to_string() == *hash);
                let value = known.ok_or_else(|| {
                    let why = format!("there is no value {hash} for the input `{name}`");
                    Refused::from(why + ": make it with `input`; the last 64 are kept")
                })?;
                Ok((name.clone(), value.clone()))
            })
            .collect()
    }

    fn input(&mut self, input: &Input) -> Result<Json, Refused> {
        let kind = self.catalog.value_type(&input.kind);
        let kind = kind.ok_or_else(|| format!("there is no type of values `{}`", input.kind))?;
        let value = self.session.install(|| self.columns.read(input, kind))?;
        let hash = value.hash();
        self.values.retain(|known| known.hash() != hash);
        self.values.push_back(value);
        if self.values.len() > VALUES {
            self.values.pop_front();
        }
        Ok(json!({ "value": hash.to_string() }))
    }

    fn why(&mut self, load: &Load, node: &str) -> Result<Json, Refused> {
        let (graph, _) = self.graph(load)?;
        let why = self.session.why(&graph, node);
        Ok(json!({ "why": why.ok_or_else(|| graph.unknown("node", node, "", &[]))? }))
    }
}

/// Whether a job is a run for the same.
fn is_of(job: &Job, run: &Run) -> bool {
    matches!(job, Job::Run(later, _) if later.slot() == run.slot())
}

pub(super) fn options(load: &Load) -> Options {
    let set = load.set.clone().into_iter().collect();
    let Load { draft, pins, locked, .. } = *load;
    Options { roots: load.roots.clone(), set, draft, pins, locked, ..Options::default() }
}

/// Why a host does not get what it wants.
pub(super) struct Refused {
    pub(super) why: String,
    pub(super) problems: Vec<Problem>,
}

impl From<String> for Refused {
    fn from(why: String) -> Self {
        Self { why, problems: Vec::new() }
    }
}
