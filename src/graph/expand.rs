//! One flat graph of built-in nodes, made of a graph and all that it uses.
//!
//! The nodes of a use `nose` are named `nose/mask`. The evaluator knows nothing of uses: two of them with equal inputs have nodes
//! with equal keys, which are computed once.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use super::check::{Check, Whole};
use super::definition::{Definition, World, deeper};
use super::draft::{Draft, What};
use super::each::Branches;
use super::expected::{Expected, Expecter, Expecting};
use super::guards::Known;
use super::input::input_node;
use super::node::Built;
use super::parameters::{Parameters, handed_over};
use super::unknown::unknown_node;
use super::{Graph, GraphInput, GraphNode, GraphOutput, GraphPort, GraphUse, Guard, Link, Shape};
use crate::error::{Problem, Severity, Span, Use, code};
use crate::text::{Body, Field, Finding, Kind, Tree};

/// A node and an output of it, by their places in the flat graph.
type Target = (usize, usize);

/// What each draft gives: the value at each of its outputs.
type Values = Vec<Vec<Target>>;

/// A graph of more nodes than this is a mistake, or a trap: ten files that use each other ten times each would make 10^10.
const MOST: usize = 1_000_000;

/// The flat graph; none if something is wrong that depends on the values which uses give to parameters, which is reported, or
/// if the graph is broken anyway.
pub(super) fn expand<'a>(
    world: &mut World<'a>,
    whole: Whole<'a>,
    is_broken: bool,
    is_partial: bool,
) -> Option<Graph> {
    let Whole { definition, mut outputs, undecided, unused, .. } = whole;
    if is_partial {
        // Nothing will come of them, which is to be told.
        outputs.extend(undecided);
    }
    let (nodes, uses, expect) = (Vec::new(), Vec::new(), Vec::new());
    let mut expansion = Expansion { world, nodes, uses, expect, count: 0 };
    let inputs = expansion.inputs(&definition);
    let scope = Scope { prefix: String::new(), uses: Arc::new([]), inputs, values: None };
    let values = expansion.graph(&definition, &scope);
    expansion.guard(&definition, &scope, 0);
    let Expansion { mut nodes, uses, mut expect, .. } = expansion;
    // Where something is wrong, links may lead to nodes that could not be made.
    let is_error = |problem: &Problem| problem.severity == Severity::Error;
    if world.problems.iter().any(is_error) || is_broken {
        return None;
    }
    let (known, mut doubts) = Known::settle(&mut nodes);
    known.judge(&mut expect, &mut doubts);
    let output = |output: GraphOutput| {
        let (node, index) = *values.get(output.node)?.get(output.output)?;
        Some(GraphOutput { node, output: index, ..output })
    };
    let outputs = outputs.into_iter().map(output).collect::<Option<_>>()?;
    let port = |port: &super::definition::Port| {
        let (draft, index) = port.target?;
        let &(node, output) = values.get(draft)?.get(index)?;
        let (name, lineage) = (port.name.clone(), port.lineage.clone());
        Some(GraphPort { name, kind: port.kind, node, output, lineage, span: port.span })
    };
    let ports = definition.ports.iter().filter_map(port).collect();
    let input = |(draft, target): (&Draft<'_>, &Option<Target>)| {
        let kind = draft.types.first().copied().flatten()?;
        Some(GraphInput::new(draft, kind, target.as_ref()?.0))
    };
    let inputs = definition.drafts.iter().zip(&scope.inputs).filter_map(input).collect();
    let shape = Arc::new(Shape::new(&nodes));
    let source = definition.sheet.source.clone();
    let Definition { sheet, doc, schema, .. } = definition;
    let unused = unused.into_iter().map(|(name, span)| {
        let message = format!("nothing needs `{name}`");
        let help = "name an output for it, or leave it out".to_owned();
        let finding = Finding { code: code::UNUSED, span, message, help, note: None };
        Problem { severity: Severity::Warning, ..sheet.problem(finding, &[]) }
    });
    let warnings = unused.chain(doubts).collect();
    let subgraphs = world.subgraphs.clone();
    Some(Graph {
        source,
        subgraphs,
        doc,
        nodes: nodes.into(),
        shape,
        outputs,
        readers: world.catalog.readers().clone(),
        inputs,
        ports,
        text: None,
        expect: expect.into(),
        schema,
        uses: uses.into(),
        warnings,
    })
}

struct Expansion<'w, 'a> {
    world: &'w mut World<'a>,
    nodes: Vec<GraphNode>,
    uses: Vec<GraphUse>,
    expect: Vec<Expected>,
    /// How many graphs and nodes have been put in.
    count: usize,
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
    fn values<'s>(&'s self, definition: &'s Definition<'_>) -> &'s Parameters {
        self.values.as_ref().unwrap_or(&definition.defaults)
    }
}

impl<'a> Expansion<'_, 'a> {
    /// Nodes that stand for the inputs of a graph that nobody uses.
    fn inputs(&mut self, definition: &Definition<'a>) -> Vec<Option<Target>> {
        let scope =
            Scope { prefix: String::new(), uses: Arc::new([]), inputs: Vec::new(), values: None };
        let inputs = definition.drafts[..definition.inputs].iter().map(|draft| {
            if self.world.absent.contains(&draft.name.text) {
                return None;
            }
            let built = input_node(&draft.name.text, &draft.tree);
            Some((self.put(definition, draft, built, &scope, Vec::new()), 0))
        });
        inputs.collect()
    }

    /// Puts the nodes of a graph in; what all of its nodes give.
    fn graph(&mut self, definition: &Definition<'a>, scope: &Scope) -> Values {
        let first = self.nodes.len();
        let mut values: Values = vec![Vec::new(); definition.drafts.len()];
        for &index in &definition.order {
            self.count += 1;
            if self.count > MOST {
                if self.count == MOST + 1 {
                    self.checked(definition, scope, |check| {
                        let message = format!("the graph has more than {MOST} nodes");
                        let span = definition.drafts[index].name.span;
                        check.find(code::CYCLE, span, message, "use fewer graphs in each other");
                    });
                }
                break;
            }
            let draft = &definition.drafts[index];
            values[index] = match &draft.what {
                What::Input => scope.inputs.get(index).copied().flatten().into_iter().collect(),
                What::Node(_) => self.node(definition, draft, scope, &values),
                What::Use(_, graph) => self.used(definition, draft, graph, scope, &values),
                What::Switch(branches) => self.switch(definition, draft, branches, scope, &values),
                What::Unknown => {
                    let built = unknown_node(&draft.tree);
                    vec![(self.put(definition, draft, built, scope, Vec::new()), 0)]
                }
            };
        }
        for each in &definition.eaches {
            let element = each.elements.first().map(|&element| &definition.drafts[element].what);
            let Some(element) = element else { continue };
            let output = |(index, name): (usize, &str)| {
                let carried = each.carry.iter().any(|(carried, _)| carried == name);
                let elements = if carried {
                    &each.elements[each.elements.len() - 1..]
                } else {
                    &each.elements
                };
                let given = elements.iter().filter_map(|&k| values[k].get(index).copied());
                (name.to_owned(), given.collect())
            };
            let outputs = element.outputs().into_iter().enumerate().map(output).collect();
            let name = format!("{}{}", scope.prefix, each.name);
            let kind = format!("ForEach({})", each.kind);
            self.uses.push(GraphUse { name, kind, inputs: Vec::new(), outputs });
        }
        self.expect(definition, scope, first..self.nodes.len(), &values);
        values
    }

    /// What a graph wants of its inputs is tested where a node inside takes them, which stand behind the `first`.
    fn guard(&mut self, graph: &Definition<'a>, scope: &Scope, first: usize) {
        for (input, wants) in graph.wants.iter().enumerate().filter(|(_, wants)| !wants.is_empty())
        {
            let name = &graph.drafts[input].name.text;
            let by: Arc<str> = match scope.prefix.strip_suffix('/') {
                Some(prefix) => format!("input `{name}` of `{prefix}`").into(),
                None => format!("input `{name}`").into(),
            };
            for node in &mut self.nodes[first..] {
                let slots = node.links.iter().enumerate();
                let slots =
                    slots.filter(|(_, it)| Some((it.node, it.output)) == scope.inputs[input]);
                let tests = slots.flat_map(|(slot, _)| wants.iter().map(move |&want| (slot, want)));
                let tests = Vec::from_iter(tests);
                if !tests.is_empty() {
                    node.recipe = Arc::new(node.recipe.guarded(&tests));
                }
                let guard = |(slot, property)| Guard { slot, property, by: by.clone() };
                node.guards.extend(tests.into_iter().map(guard));
            }
        }
    }

    /// What a graph expects of its values in this use.
    fn expect(
        &mut self,
        definition: &Definition<'a>,
        scope: &Scope,
        inside: Range<usize>,
        values: &Values,
    ) {
        if definition.expect.is_empty() {
            return;
        }
        let target = |&(draft, output): &(usize, usize)| values[draft].get(output).copied();
        let of = scope.prefix.strip_suffix('/').map(|name| {
            let ports = definition.ports.iter().filter_map(|port| target(port.target.as_ref()?));
            let givers = ports.map(|(node, _)| node).collect();
            (name, Expecter { uses: scope.uses.clone(), inside, givers })
        });
        let at_border = |word: &str| {
            let inputs = definition.drafts[..definition.inputs].iter();
            definition.ports.iter().any(|port| port.name == word)
                || inputs.map(|input| &input.name.text).any(|name| name == word)
        };
        for Expecting { expectation, span, targets } in &definition.expect {
            // Of an input that is left out nothing is expected.
            if targets.iter().flatten().any(|it| target(it).is_none()) {
                continue;
            }
            let mut expectation = expectation.clone();
            if let Some((name, _)) = &of {
                for word in expectation.values_mut() {
                    let gap = if at_border(word) { '.' } else { '/' };
                    *word = format!("{name}{gap}{word}");
                }
            }
            let values = targets.iter().map(|it| it.as_ref().and_then(target)).collect();
            let (source, span) = definition.sheet.place(*span);
            let of = of.as_ref().map(|(_, of)| of.clone());
            self.expect.push(Expected { expectation, values, source, span, of });
        }
    }

    /// Does something that may find problems in the file of a graph.
    fn checked<R>(
        &mut self,
        definition: &Definition<'a>,
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
        definition: &Definition<'a>,
        draft: &Draft<'a>,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let What::Node(entry) = draft.what else { return Vec::new() };
        let absent = absent(definition, draft, scope);
        let as_it_stands = draft.built.as_ref().filter(|_| absent.is_empty());
        let as_it_stands = as_it_stands.filter(|_| scope.values.is_none() || !draft.parametric);
        let built = match as_it_stands {
            Some(built) => Some(built.clone()),
            None => self.checked(definition, scope, |check| {
                let tree = without_links(&draft.tree, &absent);
                let survey = check.survey(&draft.what, &tree, scope.values(definition));
                survey.files.iter().for_each(|file| check.may_read(file));
                let sound = check.findings.is_empty() && survey.tree.is_whole();
                let links = draft.links.iter().zip(&draft.targets);
                let there = links.filter(|(link, _)| !absent.contains_key(&link.span));
                let targets = Vec::from_iter(there.map(|(_, targets)| targets.clone()));
                sound.then(|| check.built(entry, survey, &targets)).flatten()
            }),
        };
        let Some(built) = built else { return Vec::new() };
        let mut links = Vec::with_capacity(draft.links.len());
        for (case, link) in draft.links.iter().enumerate() {
            let link = |(node, output)| Link { port: link.port.clone(), node, output };
            links.extend(linked(draft, case, values).map(link));
        }
        let node = self.put(definition, draft, built, scope, links);
        (0..draft.types.len()).map(|output| (node, output)).collect()
    }

    fn put(
        &mut self,
        definition: &Definition<'a>,
        draft: &Draft<'a>,
        built: Built,
        scope: &Scope,
        links: Vec<Link>,
    ) -> usize {
        let outputs = match draft.what {
            What::Node(entry) => entry.outputs().iter().map(|output| output.name).collect(),
            _ => vec!["value"],
        };
        self.nodes.push(GraphNode {
            name: format!("{}{}", scope.prefix, draft.name.text),
            recipe: built.recipe,
            sheet: definition.sheet.clone(),
            span: draft.tree.span,
            uses: scope.uses.clone(),
            node: built.node,
            pack: built.pack,
            links,
            files: built.files,
            tree: built.tree,
            outputs,
            types: match draft.what {
                What::Unknown => vec![None],
                _ => draft.types.clone(),
            },
            guards: Vec::new(),
        });
        self.nodes.len() - 1
    }

    /// Puts a used graph in; what its ports give.
    fn used(
        &mut self,
        definition: &Definition<'a>,
        draft: &Draft<'a>,
        graph: &Definition<'a>,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let own = scope.values(definition);
        let is_known = scope.values.is_none() || !draft.parametric;
        let tree = match is_known {
            true => draft.is_sound.then(|| {
                own.fitted(&draft.tree, draft.what.kind(), &graph.schema, &mut Vec::new())
            }),
            // Other values than those that the file has been checked with.
            false => self.checked(definition, scope, |check| {
                let survey = check.survey(&draft.what, &draft.tree, own);
                (check.findings.is_empty() && survey.tree.is_whole()).then_some(survey.tree)
            }),
        };
        // What is wrong at the border says nothing of the inside.
        let Some(tree) = tree else { return Vec::new() };
        let fields = tree.fields().unwrap_or_default().iter();
        let is_parameter = |name: &str| graph.declared.iter().any(|declared| declared.name == name);
        let given = fields.filter(|field| is_parameter(&field.name.text)).map(|field| {
            let value = handed_over(field.value.clone(), &definition.sheet);
            (field.name.text.clone(), value)
        });
        let given = Vec::from_iter(given);
        let mut inputs = vec![None; graph.inputs];
        let mut linked_ports = Vec::with_capacity(graph.inputs);
        for (case, link) in draft.links.iter().enumerate() {
            let port = graph.drafts[..graph.inputs].iter().position(|d| d.name.text == link.port);
            if let (Some(port), Some(target)) = (port, linked(draft, case, values).next()) {
                inputs[port] = Some(target);
                linked_ports.push((link.port.clone(), target));
            }
        }
        let (source, span) = definition.sheet.place(draft.name.span);
        let name = draft.name.text.clone();
        let uses = scope.uses.iter().cloned().chain([Use { name, source, span }]).collect();
        let name = format!("{}{}", scope.prefix, draft.name.text);
        let values = (!given.is_empty()).then(|| graph.defaults.with(given));
        let inside = Scope { prefix: format!("{name}/"), uses, inputs, values };
        let first = self.nodes.len();
        let values = deeper(inside.uses.len(), || self.graph(graph, &inside));
        self.guard(graph, &inside, first);
        let output = |port: &super::definition::Port| {
            let (node, output) = port.target?;
            values.get(node)?.get(output).copied()
        };
        let outputs =
            Vec::from_iter(graph.ports.iter().map(|port| output(port).unwrap_or_default()));
        let names = graph.ports.iter().map(|port| port.name.clone());
        let given = names.zip(outputs.iter().map(|&target| vec![target])).collect();
        let kind = draft.what.kind().to_owned();
        self.uses.push(GraphUse { name, kind, inputs: linked_ports, outputs: given });
        outputs
    }

    /// What the chosen branch gives. The nodes of the others are in the graph, but nothing needs them.
    fn switch(
        &mut self,
        definition: &Definition<'a>,
        draft: &Draft<'a>,
        branches: &Branches,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let chosen = self.checked(definition, scope, |check| {
            let own = scope.values(definition);
            let chosen = own.substitute(&branches.choose, &mut check.findings);
            let case = branches.chosen(&chosen);
            let wrong = |(message, word): (String, String)| {
                let help = check.guess(|| branches.meant(&word));
                check.find(code::WRONG_VALUE, chosen.span, message, help);
            };
            case.map_err(wrong)
        });
        let Ok(case) = chosen else { return Vec::new() };
        let given = Vec::from_iter(linked(draft, case, values));
        let outputs = vec![(String::new(), given.clone())];
        let name = format!("{}{}", scope.prefix, draft.name.text);
        let inputs = Vec::new();
        self.uses.push(GraphUse { name, kind: "Switch".into(), inputs, outputs });
        given
    }
}

/// The places of links that are left out, and whether each is at a port that takes many.
type Absent = HashMap<Span, bool>;

/// The links of a draft to inputs that are left out, by their places.
fn absent(definition: &Definition<'_>, draft: &Draft<'_>, scope: &Scope) -> Absent {
    let is_absent = |&(node, _): &Target| {
        definition.drafts[node].is_optional && scope.inputs.get(node).is_none_or(Option::is_none)
    };
    let links = draft.links.iter().zip(&draft.targets);
    let absent = links.filter(|(_, targets)| targets.iter().flatten().any(is_absent));
    absent.map(|(link, _)| (link.span, link.many)).collect()
}

/// A node's fields without these links: one at a port of its own goes with its field, one in a list leaves the others there.
fn without_links(tree: &Tree, gone: &Absent) -> Tree {
    if gone.is_empty() {
        return tree.clone();
    }
    let is_gone = |tree: &Tree| {
        let link = tree.call_of("Some").unwrap_or(tree);
        gone.get(&link.span).copied().filter(|_| link.text().is_some())
    };
    let items = |items: &[Tree]| {
        let kept = items.iter().filter(|item| is_gone(item).is_none());
        kept.map(|item| without_links(item, gone)).collect()
    };
    let kind = match &tree.kind {
        Kind::Call { name, body: Body::Fields(fields) } => {
            let kept = fields.iter().filter_map(|field| {
                let value = match is_gone(&field.value) {
                    None => without_links(&field.value, gone),
                    // The only link of a list.
                    Some(true) => Tree::new(field.value.span, Kind::List(Vec::new())),
                    Some(false) => return None,
                };
                Some(Field { name: field.name.clone(), value })
            });
            Kind::Call { name: name.clone(), body: Body::Fields(kept.collect()) }
        }
        Kind::Call { name, body: Body::Items(list) } => {
            Kind::Call { name: name.clone(), body: Body::Items(items(list)) }
        }
        Kind::List(list) => Kind::List(items(list)),
        plain => plain.clone(),
    };
    Tree { kind, ..tree.clone() }
}

/// What comes in at a link of a draft.
fn linked<'v>(
    draft: &'v Draft<'_>,
    link: usize,
    values: &'v Values,
) -> impl Iterator<Item = Target> + 'v {
    let targets = draft.targets.get(link).and_then(Option::as_ref).into_iter().flatten();
    targets.filter_map(|&(node, output)| values[node].get(output).copied())
}
