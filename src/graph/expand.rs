//! One flat graph of built-in nodes, made of a graph and all that it uses.
//!
//! The nodes of a use `nose` are named `nose/mask`. The evaluator knows nothing of uses: two of them with equal inputs have nodes
//! with equal keys, which are computed once.
//!
//! Drafts that no parameter shapes are shared by all uses; all others are made again with the values of the use. Only there can an error
//! appear that the check of the file has not found: it is reported inside, with the path of uses and the position of the value. A link to
//! an output of a `Switch` becomes a link to what the `Switch` chooses.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use maquette_syntax::error::{Problem, Severity, Use, code};
use maquette_syntax::{Body, Field, Finding, Kind, Tree};

use super::check::Check;
use super::definition::Definition;
use super::expected::Expected;
use super::guards::Known;
use super::input::input_node;
use super::parameters::{Parameters, handed_over};
use super::top::name_of;
use super::unknown::unknown_node;
use super::{Graph, GraphInput, GraphNode, GraphOutput, GraphPort, GraphUse, Link, Shape};
use crate::definition::{Branches, Built, Draft, Survey, What, Whole};
use crate::flat::{Counts, Loop};
use crate::world::{World, deeper};

mod elements;
mod expect;
mod optional;

use optional::{absent, without_links};

/// A node and an output of it, by their places in the flat graph.
type Target = (usize, usize);

/// What the drafts of a graph give.
struct Values {
    /// The value at each output of each draft.
    single: Vec<Vec<Target>>,
    /// The drafts that are repeated.
    repeated: HashMap<usize, Elemental>,
}

/// What the elements of a `ForEach` give.
struct Elemental {
    /// Of each element, the value at each output.
    elements: Vec<Vec<Target>>,
    /// At each output the values of all, or the last one of what is carried.
    outputs: Vec<Vec<Target>>,
    /// Whether there is an example only.
    is_open: bool,
}

impl Values {
    /// The values that a link leads to.
    fn get(&self, (draft, output): (usize, usize)) -> &[Target] {
        match self.repeated.get(&draft) {
            Some(repeated) => repeated.outputs.get(output).map_or(&[], Vec::as_slice),
            None => self.single[draft].get(output).map_or(&[], std::slice::from_ref),
        }
    }

    /// The only value that a link leads to.
    fn only(&self, target: (usize, usize)) -> Option<Target> {
        self.get(target).first().copied()
    }
}

/// A graph of more nodes than this is a mistake, or a trap: ten files that use each other ten times each would make 10^10.
const MOST: usize = 1_000_000;

/// The flat graph; none if something is wrong that depends on the values which uses give to parameters, which is reported, or
/// if the graph is broken anyway.
pub(super) fn expand<'a>(
    world: &mut World<'a>,
    whole: &Whole,
    is_broken: bool,
    is_partial: bool,
    counts: &Counts,
) -> Option<Graph> {
    let Whole { definition, outputs, undecided, unused, .. } = whole;
    let (nodes, uses, loops, expect) = Default::default();
    let mut expansion = Expansion { world, nodes, uses, loops, expect, counts, count: 0 };
    let inputs = expansion.inputs(definition);
    let scope = Scope { prefix: String::new(), uses: Arc::new([]), inputs, values: None };
    let values = expansion.graph(definition, &scope);
    expansion.guard(definition, &scope, 0);
    let Expansion { mut nodes, uses, loops, mut expect, .. } = expansion;
    if !is_broken {
        // With more elements the same is said of pins.
        if counts.is_empty() {
            world.judge_pins(&nodes, &definition.sheet.source);
        }
        world.put_pins(&mut nodes);
    }
    // Where something is wrong, links may lead to nodes that could not be made.
    if is_broken || world.problems.iter().any(|problem| world.is_fatal(problem)) {
        return None;
    }
    let (known, mut doubts) = Known::settle(&mut nodes);
    known.judge(&mut expect, &mut doubts);
    expect.retain(|expected| !expected.is_example);
    // Of these nothing will come, which is to be told.
    let undecided = undecided.iter().filter(|_| is_partial);
    let outputs = outputs
        .iter()
        .chain(undecided)
        .map(|output| {
            let (node, index) = values.only((output.node, output.output))?;
            Some(GraphOutput { node, output: index, ..output.clone() })
        })
        .collect::<Option<_>>()?;
    let ports = definition
        .ports
        .iter()
        .filter_map(|port| {
            let (node, output) = values.only(port.target?)?;
            let (name, lineage) = (port.name.clone(), port.lineage.clone());
            Some(GraphPort { name, kind: port.kind, node, output, lineage, span: port.span })
        })
        .collect();
    let inputs = definition
        .drafts
        .iter()
        .zip(&scope.inputs)
        .filter_map(|(draft, target): (&Draft, &Option<Target>)| {
            let kind = draft.types.first().copied().flatten()?;
            Some(GraphInput::new(draft, kind, target.as_ref()?.0))
        })
        .collect();
    let shape = Arc::new(Shape::new(&nodes));
    let source = definition.sheet.source.clone();
    let Definition { sheet, doc, schema, .. } = definition;
    fn warning(
        code: &'static str,
        span: maquette_syntax::Span,
        message: String,
        help: &'static str,
        sheet: &Arc<maquette_syntax::Sheet>,
    ) -> Problem {
        let finding = Finding { code, span, message, help: help.into(), note: None };
        Problem { severity: Severity::Warning, ..sheet.problem(finding, &[]) }
    }
    let unused = unused.iter().map(|(name, span)| {
        let help = "name an output for it, or leave it out";
        warning(code::UNUSED, *span, format!("nothing needs `{name}`"), help, sheet)
    });
    let warnings = unused.chain(doubts).collect();
    let subgraphs = world.subgraphs.clone();
    Some(Graph {
        source,
        subgraphs,
        doc: doc.clone(),
        nodes: nodes.into(),
        shape,
        outputs,
        readers: world.catalog.readers().clone(),
        inputs,
        ports,
        text: None,
        expect: expect.into(),
        schema: schema.clone(),
        uses: uses.into(),
        loops: loops.into(),
        settled: BTreeSet::new(),
        stage: None,
        given: BTreeMap::new(),
        words: world.options.words().into(),
        warnings,
    })
}

struct Expansion<'w, 'a> {
    world: &'w mut World<'a>,
    nodes: Vec<GraphNode>,
    uses: Vec<GraphUse>,
    loops: Vec<Loop>,
    expect: Vec<Expected>,
    counts: &'w Counts,
    /// How many graphs and nodes have been put in.
    count: usize,
}

/// What one node or use differs in from its draft.
#[derive(Default)]
struct One {
    /// Its name, if it is an element.
    name: Option<String>,
    /// What comes in at some of its ports.
    links: Vec<(String, Target)>,
    /// The field that gets its number.
    number: Option<Field>,
}

impl One {
    fn name(&self, draft: &Draft, scope: &Scope) -> String {
        format!("{}{}", scope.prefix, self.name.as_ref().unwrap_or(&draft.name.text))
    }

    /// What comes in at a link of the draft.
    fn linked(&self, draft: &Draft, link: usize, values: &Values) -> Vec<Target> {
        let port = &draft.links[link].port;
        match self.links.iter().find(|(own, _)| own == port) {
            Some((_, target)) => vec![*target],
            None => linked(draft, link, values),
        }
    }

    /// The draft's fields with its own.
    fn tree(&self, draft: &Draft) -> Tree {
        let mut tree = draft.tree.clone();
        if let (Some(number), Kind::Call { body: Body::Fields(fields), .. }) =
            (&self.number, &mut tree.kind)
        {
            fields.retain(|field| field.name.text != number.name.text);
            fields.push(number.clone());
        }
        tree
    }
}

/// One use of a graph.
struct Scope {
    /// What stands before the names of its nodes: `nose/`.
    prefix: String,
    uses: Arc<[Use]>,
    /// What comes in; none where an input is left out.
    inputs: Vec<Option<Target>>,
    /// The values of its parameters, if some are not the defaults.
    values: Option<Parameters>,
}

impl Scope {
    fn values<'s>(&'s self, definition: &'s Definition) -> &'s Parameters {
        self.values.as_ref().unwrap_or(&definition.defaults)
    }
}

impl<'a> Expansion<'_, 'a> {
    /// Nodes that stand for the inputs of a graph that nobody uses.
    fn inputs(&mut self, definition: &Definition) -> Vec<Option<Target>> {
        let scope =
            Scope { prefix: String::new(), uses: Arc::new([]), inputs: Vec::new(), values: None };
        let inputs = definition.drafts[..definition.inputs].iter().map(|draft| {
            let name = draft.name.text.clone();
            if self.world.absent.contains(&name) {
                return None;
            }
            let built = input_node(&name, &draft.tree);
            let put = Put { name, built, links: Vec::new(), outputs: vec!["value"] };
            Some((self.put(definition, draft, put, &scope), 0))
        });
        inputs.collect()
    }

    /// Puts the nodes of a graph in; what all of its nodes give.
    fn graph(&mut self, definition: &Definition, scope: &Scope) -> Values {
        let first = self.nodes.len();
        let single = vec![Vec::new(); definition.drafts.len()];
        let mut values = Values { single, repeated: HashMap::new() };
        for &index in &definition.order {
            if self.is_full(definition, &definition.drafts[index], scope) {
                break;
            }
            let draft = &definition.drafts[index];
            if let Some(repeat) = &draft.repeat {
                let given = self.repeated(definition, draft, repeat, scope, &values);
                values.repeated.insert(index, given);
                continue;
            }
            values.single[index] = match &draft.what {
                What::Input => scope.inputs.get(index).copied().flatten().into_iter().collect(),
                What::Node(_) | What::Use(..) => {
                    self.one(definition, draft, &One::default(), scope, &values)
                }
                What::Switch(branches) => self.switch(definition, draft, branches, scope, &values),
                What::Elements(elements) => {
                    self.elements(definition, draft, elements, scope, &values)
                }
                What::Pick(pick) => self.pick(definition, draft, pick, scope, &values),
                What::Unknown(told) => {
                    let told = told.clone();
                    let told = told.map(|told| definition.sheet.problem(told, &scope.uses));
                    let (built, links) = (unknown_node(&draft.tree, told), Vec::new());
                    let name = One::default().name(draft, scope);
                    let put = Put { name, built, links, outputs: vec!["value"] };
                    vec![(self.put(definition, draft, put, scope), 0)]
                }
            };
        }
        for each in &definition.eaches {
            let element = each.elements.first().map(|&element| &definition.drafts[element].what);
            let Some(element) = element else { continue };
            let outputs = element
                .outputs()
                .into_iter()
                .enumerate()
                .map(|(index, name)| {
                    let carried = each.carry.iter().any(|(carried, _)| carried == name);
                    let elements = if carried {
                        &each.elements[each.elements.len() - 1..]
                    } else {
                        &each.elements
                    };
                    let given = elements.iter().filter_map(|&k| values.only((k, index)));
                    (name.to_owned(), given.collect())
                })
                .collect();
            let name = format!("{}{}", scope.prefix, each.name);
            let (kind, inputs) = (format!("ForEach({})", each.kind), Vec::new());
            self.uses.push(GraphUse { name, kind, inputs, outputs, is_open: false });
        }
        self.expect(definition, scope, first..self.nodes.len(), &values);
        values
    }

    /// Counts one more; whether that is one too many, which is told once.
    fn is_full(&mut self, definition: &Definition, draft: &Draft, scope: &Scope) -> bool {
        self.count += 1;
        if self.count == MOST + 1 {
            self.checked(definition, scope, |check| {
                let message = format!("the graph has more than {MOST} nodes");
                let help = "use fewer graphs in each other, or go over fewer elements";
                check.find(code::CYCLE, draft.name.span, message, help);
            });
        }
        self.count > MOST
    }

    /// Puts a node or a used graph in; what it gives.
    fn one(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        one: &One,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        match &draft.what {
            What::Node(_) => self.node(definition, draft, one, scope, values),
            What::Use(_, graph) => self.used(definition, draft, graph, one, scope, values),
            _ => Vec::new(),
        }
    }

    /// Does something that may find problems in the file of a graph.
    fn checked<R>(
        &mut self,
        definition: &Definition,
        scope: &Scope,
        work: impl FnOnce(&mut Check<'_, 'a>) -> R,
    ) -> R {
        let mut check = Check::new(self.world, definition.sheet.clone(), scope.uses.to_vec());
        let result = work(&mut check);
        let mut findings = check.findings;
        findings.sort_by_key(|finding| finding.span);
        let problems = findings.into_iter();
        let problems = problems.map(|finding| definition.sheet.problem(finding, &scope.uses));
        self.world.problems.extend(problems);
        result
    }

    fn node(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        one: &One,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let What::Node(entry) = &draft.what else { return Vec::new() };
        let absent = absent(definition, draft, scope);
        let targets = draft.targets.iter().flatten().flatten();
        let takes_lists = targets.clone().any(|(node, _)| values.repeated.contains_key(node));
        let as_it_stands = draft.built.as_ref().filter(|_| {
            let is_parametric = scope.values.is_some() && draft.parametric;
            !is_parametric && !takes_lists && one.number.is_none() && absent.is_empty()
        });
        let coming = (0..draft.links.len()).map(|link| one.linked(draft, link, values));
        let coming = Vec::from_iter(coming);
        let built = match as_it_stands {
            Some(built) => Some(built.clone()),
            None => self.checked(definition, scope, |check| {
                let tree = without_links(&one.tree(draft), &absent);
                let survey = check.survey(&draft.what, &tree, scope.values(definition));
                let has_other_links = takes_lists || !absent.is_empty();
                let survey = Survey { has_other_links, ..survey };
                survey.files.iter().for_each(|file| check.may_read(file));
                let sound = check.is_sound_since(0) && survey.tree.is_whole();
                let links = draft.links.iter().zip(&coming);
                let there = links.filter(|(link, _)| !absent.contains_key(&link.span));
                let counts = there.map(|(_, targets)| targets.len());
                sound.then(|| check.built(entry, survey, counts)).flatten()
            }),
        };
        let Some(built) = built else { return Vec::new() };
        let mut links = Vec::with_capacity(draft.links.len());
        for (link, targets) in draft.links.iter().zip(coming) {
            links.extend(targets.into_iter().map(|(node, output)| Link {
                port: link.port.clone(),
                node,
                output,
            }));
        }
        let outputs = entry.outputs().iter().map(|output| output.name).collect();
        let put = Put { name: one.name(draft, scope), built, links, outputs };
        let node = self.put(definition, draft, put, scope);
        (0..draft.types.len()).map(|output| (node, output)).collect()
    }

    fn put(&mut self, definition: &Definition, draft: &Draft, put: Put, scope: &Scope) -> usize {
        let Put { name, built, links, outputs } = put;
        let last = draft.types.last().copied().flatten();
        let types = draft.types.iter().copied().chain(std::iter::repeat(last));
        self.nodes.push(GraphNode {
            name,
            recipe: built.recipe,
            sheet: definition.sheet.clone(),
            span: draft.tree.span,
            uses: scope.uses.clone(),
            node: built.node,
            pack: built.pack,
            links,
            files: built.files,
            tree: built.tree,
            types: types.take(outputs.len().max(draft.types.len())).collect(),
            outputs,
            guards: Vec::new(),
        });
        self.nodes.len() - 1
    }

    /// Puts a used graph in; what its ports give.
    fn used(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        graph: &Definition,
        one: &One,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let own = scope.values(definition);
        let is_known = (scope.values.is_none() || !draft.parametric) && one.number.is_none();
        let tree = match is_known {
            true => draft.is_sound.then(|| {
                own.fitted(&draft.tree, draft.what.kind(), &graph.fields, &mut Vec::new())
            }),
            // Other values than those that the file has been checked with.
            false => self.checked(definition, scope, |check| {
                let survey = check.survey(&draft.what, &one.tree(draft), own);
                (check.findings.is_empty() && survey.tree.is_whole()).then_some(survey.tree)
            }),
        };
        // What is wrong at the border says nothing of the inside.
        let Some(tree) = tree else { return Vec::new() };
        let fields = tree.fields().unwrap_or_default().iter();
        let given = fields.filter_map(|field| {
            let name = name_of(&field.name.text);
            let is_parameter = graph.declared.iter().any(|declared| declared.name == name);
            is_parameter.then(|| (name, handed_over(field.value.clone(), &definition.sheet)))
        });
        let given = Vec::from_iter(given);
        let mut inputs = vec![None; graph.inputs];
        let mut linked_ports = Vec::with_capacity(graph.inputs);
        for (case, link) in draft.links.iter().enumerate() {
            let name = name_of(&link.port);
            let port = graph.drafts[..graph.inputs].iter().position(|d| d.name.text == name);
            let target = one.linked(draft, case, values).first().copied();
            if let (Some(port), Some(target)) = (port, target) {
                inputs[port] = Some(target);
                linked_ports.push((link.port.clone(), target));
            }
        }
        let (source, span) = definition.sheet.place(draft.name.span);
        let name = one.name.clone().unwrap_or_else(|| draft.name.text.clone());
        let uses = scope.uses.iter().cloned().chain([Use { name, source, span }]).collect();
        let name = one.name(draft, scope);
        let mut inside = Scope { prefix: format!("{name}/"), uses, inputs, values: None };
        if !given.is_empty() {
            let values = self
                .checked(graph, &inside, |check| graph.defaults.with(given, &mut check.findings));
            inside.values = Some(values);
        }
        let first = self.nodes.len();
        let values = deeper(inside.uses.len(), || self.graph(graph, &inside));
        self.guard(graph, &inside, first);
        fn output(port: &super::definition::Port, values: &Values) -> Option<(usize, usize)> {
            values.only(port.target?)
        }
        let outputs = graph
            .ports
            .iter()
            .map(|port| output(port, &values).unwrap_or_default())
            .collect::<Vec<_>>();
        let names = graph.ports.iter().map(|port| port.name.clone());
        let given = names.zip(outputs.iter().map(|&target| vec![target])).collect();
        let kind = draft.what.kind().to_owned();
        let (inputs, is_open) = (linked_ports, false);
        self.uses.push(GraphUse { name, kind, inputs, outputs: given, is_open });
        outputs
    }

    /// What the chosen branch gives. The nodes of the others are in the graph, but nothing needs them.
    fn switch(
        &mut self,
        definition: &Definition,
        draft: &Draft,
        branches: &Branches,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let chosen = self.checked(definition, scope, |check| {
            let own = scope.values(definition);
            let chosen = own.substitute(&branches.choose, &mut check.findings);
            let case = branches.chosen(&chosen);
            // What is wrong with a default is told where it stands.
            if chosen.is_broken() {
                Err(())
            } else {
                case.map_err(|(message, word): (String, String)| {
                    let help = check.guess(|| branches.meant(&word));
                    check.find(code::WRONG_VALUE, chosen.span, message, help);
                })
            }
        });
        let Ok(case) = chosen else { return Vec::new() };
        let given = linked(draft, case, values);
        let outputs = vec![(String::new(), given.clone())];
        let name = format!("{}{}", scope.prefix, draft.name.text);
        let inputs = Vec::new();
        self.uses.push(GraphUse { name, kind: "Switch".into(), inputs, outputs, is_open: false });
        given
    }
}

/// A node on its way into the flat graph.
struct Put {
    name: String,
    built: Built,
    links: Vec<Link>,
    outputs: Vec<&'static str>,
}

/// What comes in at a link of a draft.
fn linked(draft: &Draft, link: usize, values: &Values) -> Vec<Target> {
    let targets = draft.targets.get(link).and_then(Option::as_ref).into_iter().flatten();
    targets.flat_map(|&target| values.get(target).iter().copied()).collect()
}
