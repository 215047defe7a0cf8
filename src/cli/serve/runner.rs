//! The thread that evaluates graphs, while the main thread reads the requests of the host.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use maquette_engine::eval::NodeTrace;
use maquette_engine::session;
use maquette_engine::session::{RunResult, Session, Targets};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Graph, InputValues, Options};
use maquette_node::CancelToken;
use maquette_syntax::error::{Diagnostic, merge_diagnostics, panic_message};
use maquette_value::AnyValue;
use serde_json::{Value as Json, json};

use super::columns::Columns;
use super::request::{Form, Input, Load, Run, ValueRequest};
use super::{Answer, lock};
use crate::events::{Events, Listener};
use crate::{has_errors, put_problems};

/// A job for the evaluating thread.
pub(super) enum Job {
    Run(Run, CancelToken),
    Input(Input),
    Why(Load, String),
}

/// The cancel token of each run that can be cancelled, by the id of its request.
pub(super) type RunTokens = Arc<Mutex<HashMap<String, CancelToken>>>;

pub(super) struct Runner {
    pub(super) session: Session,
    pub(super) catalog: Arc<Catalog>,
    pub(super) columns: Columns,
    pub(super) listener: Listener,
    pub(super) runs: RunTokens,
    /// The values that the host has created for inputs, the oldest first.
    pub(super) values: VecDeque<AnyValue>,
}

/// The maximum number of values for inputs that are stored. The oldest are dropped first.
const MAX_VALUES: usize = 64;

impl Runner {
    /// Processes jobs until the channel is closed.
    pub(super) fn work(mut self, jobs: &Receiver<(Json, Job)>) {
        let mut waiting = VecDeque::new();
        while let Some((id, job)) = waiting.pop_front().or_else(|| jobs.recv().ok()) {
            waiting.extend(jobs.try_iter());
            let answer = match &job {
                Job::Run(run, _) if waiting.iter().any(|(_, later)| has_same_slot(later, run)) => {
                    Ok(json!({ "replaced": true }))
                }
                job => {
                    catch_unwind(AssertUnwindSafe(|| self.run_job(&id, job))).unwrap_or_else(
                        |panic| {
                            // Drop all results, because after a panic some may be incomplete.
                            self.session.forget();
                            Err(RequestError::from(format!(
                                "a bug of this program: {}",
                                panic_message(&*panic)
                            )))
                        },
                    )
                }
            };
            lock(&self.runs).remove(&id.to_string());
            self.listener.answer(&id, answer);
        }
        self.session.finish();
    }

    fn run_job(&mut self, id: &Json, job: &Job) -> Result<Json, RequestError> {
        match job {
            Job::Run(run, cancel) => self.run(id, run, cancel),
            Job::Input(input) => self.input(input),
            Job::Why(load, node) => self.explain(load, node),
        }
    }

    fn graph(&self, load: &Load) -> Result<(Graph, Vec<Diagnostic>), RequestError> {
        let checked =
            Graph::load(&load.graph, &self.catalog, &load_options(load)).without_unknown_nodes();
        let diagnostics = checked.diagnostics;
        match checked.graph {
            Some(graph) => Ok((graph, diagnostics)),
            None => Err(RequestError { message: "the graph has errors".into(), diagnostics }),
        }
    }

    fn run(&mut self, id: &Json, run: &Run, cancel: &CancelToken) -> Result<Json, RequestError> {
        let start = Instant::now();
        let Run { graph, roots, set, inputs, want, .. } = run;
        let (graph, roots, set) = (graph.clone(), roots.clone(), set.clone());
        let Run { draft, pins, locked, .. } = *run;
        let load = Load { graph, roots, set, draft, pins, locked };
        let (graph, mut diagnostics) = self.graph(&load)?;
        let inputs = self.inputs(inputs)?;
        let targets = match want {
            None => Targets::Outputs,
            Some(want) => Targets::Named(want.iter().map(|want| want.value.clone()).collect()),
        };
        let run_listener = self.listener.clone();
        let named = id.clone();
        let listener = Listener::new(move |event| {
            let mut event = event.clone();
            event["run"] = named.clone();
            run_listener.forward(&event);
        });
        let events = Events::new(listener, cancel.clone());
        let run_options =
            session::Run { targets, inputs, observer: &events, cancel: cancel.clone() };
        let finished = self.session.run(&graph, &run_options).map_err(|diagnostics| {
            RequestError { message: "the graph cannot be run".into(), diagnostics }
        })?;
        if cancel.is_cancelled() {
            return Ok(json!({ "cancelled": true }));
        }
        diagnostics = merge_diagnostics(diagnostics, finished.diagnostics());
        diagnostics.extend(self.session.warnings(&graph));
        let values = self.values(&finished, &graph, want.as_deref());
        self.columns.finish_answer(&run.slot());
        let trace = finished.trace();
        let mut answer = json!({
            "ok": !has_errors(&diagnostics),
            "nodes": trace.0.iter().map(NodeTrace::to_json).collect::<Vec<_>>(),
            "values": values,
            "seconds": start.elapsed().as_secs_f64(),
        });
        put_problems(&mut answer, &diagnostics);
        Ok(answer)
    }

    /// Returns those requested values that exist. Without a request, returns all outputs. If a value cannot be returned in the requested
    /// form, the reason is returned in its place.
    fn values(
        &mut self,
        finished: &RunResult,
        graph: &Graph,
        want: Option<&[ValueRequest]>,
    ) -> BTreeMap<String, Json> {
        let want = want.map_or_else(
            || {
                let names = graph.results().map(|(name, _)| name.to_owned());
                names.map(|value| ValueRequest { value, form: Form::default() }).collect()
            },
            <[ValueRequest]>::to_vec,
        );
        let mut values = BTreeMap::new();
        for ValueRequest { value: name, form } in want {
            let Some(value) = finished.value(&name) else { continue };
            let (columns, catalog) = (&mut self.columns, &self.catalog);
            let entry = self.session.install(|| columns.value(value, form, catalog));
            let entry =
                entry.unwrap_or_else(|why| json!({ "type": value.kind().name, "why": why }));
            values.insert(name, entry);
        }
        values
    }

    fn inputs(&self, given: &BTreeMap<String, String>) -> Result<InputValues, RequestError> {
        given
            .iter()
            .map(|(name, hash): (&String, &String)| {
                let known = self.values.iter().find(|value| value.hash().to_string() == *hash);
                let value = known.ok_or_else(|| {
                    let why = format!("there is no value {hash} for the input `{name}`");
                    RequestError::from(
                        why + "; create it with `input`; the last 64 values are kept",
                    )
                })?;
                Ok((name.clone(), value.clone()))
            })
            .collect()
    }

    fn input(&mut self, input: &Input) -> Result<Json, RequestError> {
        let kind = self.catalog.value_type(&input.kind);
        let kind = kind.ok_or_else(|| format!("there is no type of values `{}`", input.kind))?;
        let value = self.session.install(|| self.columns.read(input, kind))?;
        let hash = value.hash();
        self.values.retain(|known| known.hash() != hash);
        self.values.push_back(value);
        if self.values.len() > MAX_VALUES {
            self.values.pop_front();
        }
        Ok(json!({ "value": hash.to_string() }))
    }

    fn explain(&mut self, load: &Load, node: &str) -> Result<Json, RequestError> {
        let (graph, _) = self.graph(load)?;
        let why = self.session.explain(&graph, node);
        Ok(json!({ "why": why.ok_or_else(|| graph.unknown("node", node, "", &[]))? }))
    }
}

/// Returns true if a job is a run in the same slot as `run`, so that one replaces the other.
fn has_same_slot(job: &Job, run: &Run) -> bool {
    matches!(job, Job::Run(later, _) if later.slot() == run.slot())
}

pub(super) fn load_options(load: &Load) -> Options {
    let set = load.set.clone().into_iter().collect();
    let Load { draft, pins, locked, .. } = *load;
    Options { roots: load.roots.clone(), set, draft, pins, locked, ..Options::default() }
}

/// The reason why a request cannot be answered.
pub(super) struct RequestError {
    pub(super) message: String,
    pub(super) diagnostics: Vec<Diagnostic>,
}

impl From<String> for RequestError {
    fn from(why: String) -> Self {
        Self { message: why, diagnostics: Vec::new() }
    }
}
