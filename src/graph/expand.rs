//! Expansion: converts a graph, and all graphs that it uses as nodes, into one flat graph of built-in nodes.
//!
//! If a node `nose` uses a graph, the nodes of that graph are named `nose/mask` and so on. The evaluator only sees built-in nodes. If two
//! nodes use one graph with equal inputs, the nodes of both copies have equal cache keys and are computed once.
//!
//! Nodes that do not depend on parameters are built once and shared by all uses of their graph. The other nodes are built again with the
//! parameter values of each use. Errors that appear only with these values are reported at the position of the value, with the path of
//! uses. A link to an output of a `Switch` becomes a link to the chosen case.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use maquette_syntax::error::{Diagnostic, Severity, Use, code};
use maquette_syntax::{Body, Field, Kind, LocalDiagnostic, Tree};

use super::check::Check;
use super::definition::Definition;
use super::expected::GraphExpectation;
use super::guards::KnownProperties;
use super::header::name_of;
use super::input::input_node;
use super::parameters::{Parameters, for_other_file};
use super::unknown::unknown_node;
use super::{Graph, GraphInput, GraphNode, GraphOutput, GraphPort, GraphUse, Link, Topology};
use crate::definition::{Branches, BuiltNode, CheckedFields, NodeKind, ParsedFile, ParsedNode};
use crate::flat::{Counts, Loop};
use crate::world::{World, with_enough_stack};

mod elements;
mod expect;
mod optional;

use optional::{absent_links, without_links};

/// The index of a node in the flat graph, and the index of the node's output.
type Target = (usize, usize);

/// The outputs of the nodes of one copy of a used graph, as targets in the flat graph.
struct Values {
    /// For each node, the target of each of its outputs.
    first_targets: Vec<Vec<Target>>,
    /// The outputs of repeated nodes, by the indices of these nodes.
    repeated: HashMap<usize, RepeatedValues>,
}

/// The outputs of the elements of a `ForEach`.
struct RepeatedValues {
    /// For each element, the target of each of its outputs.
    elements: Vec<Vec<Target>>,
    /// For each output, the targets of all elements. For an output that is passed from element to element, only the target of the last
    /// element.
    outputs: Vec<Vec<Target>>,
    /// True if the number of elements is still unknown, so that one example node represents them.
    is_open: bool,
}

impl Values {
    /// Returns the targets in the flat graph for a link to this output of this node.
    fn get(&self, (node, output): (usize, usize)) -> &[Target] {
        match self.repeated.get(&node) {
            Some(repeated) => repeated.outputs.get(output).map_or(&[], Vec::as_slice),
            None => self.first_targets[node].get(output).map_or(&[], std::slice::from_ref),
        }
    }

    /// Returns the first target in the flat graph for a link to this output of this node.
    fn first_target(&self, target: (usize, usize)) -> Option<Target> {
        self.get(target).first().copied()
    }
}

/// Maximum number of nodes of a flat graph. Without a limit, ten files in a chain, each of which uses the next one ten times, would make
/// 10^10 nodes.
const MAX_NODES: usize = 1_000_000;

/// Expands a graph. Returns `None` if the graph is broken, or if the values that are given to the parameters of used graphs cause errors.
/// Such errors are reported.
pub(super) fn expand<'a>(
    world: &mut World<'a>,
    whole: &ParsedFile,
    is_broken: bool,
    is_partial: bool,
    counts: &Counts,
) -> Option<Graph> {
    let ParsedFile { definition, outputs, undecided, unused, .. } = whole;
    let (nodes, uses, loops, expect) = Default::default();
    let mut expansion = Expansion { world, nodes, uses, loops, expect, counts, count: 0 };
    let inputs = expansion.expand_inputs(definition);
    let scope = Scope { prefix: String::new(), uses: Arc::new([]), inputs, values: None };
    let values = expansion.expand_graph(definition, &scope);
    expansion.add_guards(definition, &scope, 0);
    let Expansion { mut nodes, uses, loops, mut expect, .. } = expansion;
    if !is_broken {
        // Report stale pins only at the first expansion, not again after the numbers of elements are known.
        if counts.is_empty() {
            world.report_stale_pins(&nodes, &definition.source_map.source);
        }
        world.insert_pinned_nodes(&mut nodes);
    }
    // After an error, some links may lead to nodes that were not built.
    if is_broken || world.diagnostics.iter().any(|diagnostic| world.is_fatal(diagnostic)) {
        return None;
    }
    let (known, mut doubts) = KnownProperties::resolve_guards(&mut nodes);
    known.retain_open_promises(&mut expect, &mut doubts);
    expect.retain(|expected| !expected.is_example);
    // If the graph has nodes of unknown types, keep the outputs that depend on these nodes, so that their failure is reported.
    let undecided = undecided.iter().filter(|_| is_partial);
    let outputs = outputs
        .iter()
        .chain(undecided)
        .map(|output| {
            let (node, index) = values.first_target((output.node, output.output))?;
            Some(GraphOutput { node, output: index, ..output.clone() })
        })
        .collect::<Option<_>>()?;
    let ports = definition
        .ports
        .iter()
        .filter_map(|port| {
            let (node, output) = values.first_target(port.target?)?;
            let (name, lineage) = (port.name.clone(), port.lineage.clone());
            Some(GraphPort { name, kind: port.kind, node, output, lineage, span: port.span })
        })
        .collect();
    let inputs = definition
        .parsed_nodes
        .iter()
        .zip(&scope.inputs)
        .filter_map(|(parsed, target): (&ParsedNode, &Option<Target>)| {
            let kind = parsed.types.first().copied().flatten()?;
            Some(GraphInput::new(parsed, kind, target.as_ref()?.0))
        })
        .collect();
    let shape = Arc::new(Topology::new(&nodes));
    let source = definition.source_map.source.clone();
    let Definition { source_map, doc, schema, .. } = definition;
    let unused = unused.iter().map(|(name, span)| {
        let help = "add an output for it, or remove it";
        let message = format!("nothing needs `{name}`");
        let diagnostic = LocalDiagnostic::new(code::UNUSED, *span, message, help);
        Diagnostic { severity: Severity::Warning, ..source_map.diagnostic(diagnostic, &[]) }
    });
    let warnings = unused.chain(doubts).collect();
    let subgraphs = world.subgraphs.clone();
    Some(Graph {
        source,
        subgraphs,
        doc: doc.clone(),
        nodes: nodes.into(),
        topology: shape,
        outputs,
        readers: world.catalog.readers().clone(),
        inputs,
        ports,
        text: None,
        expect: expect.into(),
        schema: schema.clone(),
        uses: uses.into(),
        loops: loops.into(),
        counted: BTreeSet::new(),
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
    expect: Vec<GraphExpectation>,
    counts: &'w Counts,
    /// The number of used graphs and nodes that have been added so far.
    count: usize,
}

/// The data in which a copy of a node differs from the parsed node.
#[derive(Default)]
struct Instance {
    /// The name of an element of a `ForEach`. `None` for any other copy, which has the name of the parsed node.
    name: Option<String>,
    /// The targets that replace the links at some ports, as pairs of a port name and a target.
    links: Vec<(String, Target)>,
    /// The field that receives the number of the element of a `ForEach`. `None` if no field does.
    number: Option<Field>,
}

impl Instance {
    fn name(&self, parsed: &ParsedNode, scope: &Scope) -> String {
        format!("{}{}", scope.prefix, self.name.as_ref().unwrap_or(&parsed.name.text))
    }

    /// Returns the targets of the link with the index `link`.
    fn targets_at(&self, parsed: &ParsedNode, link: usize, values: &Values) -> Vec<Target> {
        let port = &parsed.links[link].port;
        match self.links.iter().find(|(own, _)| own == port) {
            Some((_, target)) => vec![*target],
            None => link_targets(parsed, link, values),
        }
    }

    /// Returns the fields of the copy, including the one that receives the element's number.
    fn tree(&self, parsed: &ParsedNode) -> Tree {
        let mut tree = parsed.tree.clone();
        if let (Some(number), Kind::Call { body: Body::Fields(fields), .. }) =
            (&self.number, &mut tree.kind)
        {
            fields.retain(|field| field.name.text != number.name.text);
            fields.push(number.clone());
        }
        tree
    }
}

/// The context in which one graph is expanded.
struct Scope {
    /// The prefix of the names of the graph's nodes, such as `nose/`.
    prefix: String,
    uses: Arc<[Use]>,
    /// For each input of the graph, its target in the flat graph. `None` if the input is omitted.
    inputs: Vec<Option<Target>>,
    /// The values of the graph's parameters. `None` if all of them have their defaults.
    values: Option<Parameters>,
}

impl Scope {
    fn values<'s>(&'s self, definition: &'s Definition) -> &'s Parameters {
        self.values.as_ref().unwrap_or(&definition.defaults)
    }
}

impl<'a> Expansion<'_, 'a> {
    /// Adds a node for each input of the root graph.
    fn expand_inputs(&mut self, definition: &Definition) -> Vec<Option<Target>> {
        let scope =
            Scope { prefix: String::new(), uses: Arc::new([]), inputs: Vec::new(), values: None };
        let inputs = definition.parsed_nodes[..definition.inputs].iter().map(|parsed| {
            let name = parsed.name.text.clone();
            if self.world.absent.contains(&name) {
                return None;
            }
            let built = input_node(&name, &parsed.tree);
            let new_node = NewNode { name, built, links: Vec::new(), outputs: vec!["value"] };
            Some((self.push_node(definition, parsed, new_node, &scope), 0))
        });
        inputs.collect()
    }

    /// Adds the nodes of a graph, and returns the outputs of these nodes.
    fn expand_graph(&mut self, definition: &Definition, scope: &Scope) -> Values {
        let first = self.nodes.len();
        let single = vec![Vec::new(); definition.parsed_nodes.len()];
        let mut values = Values { first_targets: single, repeated: HashMap::new() };
        for &index in &definition.order {
            if self.count_and_check(definition, &definition.parsed_nodes[index], scope) {
                break;
            }
            let parsed = &definition.parsed_nodes[index];
            if let Some(repeat) = &parsed.repeat {
                let given = self.expand_repeated(definition, parsed, repeat, scope, &values);
                values.repeated.insert(index, given);
                continue;
            }
            values.first_targets[index] = match &parsed.what {
                NodeKind::Input => scope.inputs.get(index).copied().flatten().into_iter().collect(),
                NodeKind::Node(_) | NodeKind::Use(..) => {
                    self.expand_instance(definition, parsed, &Instance::default(), scope, &values)
                }
                NodeKind::Switch(branches) => {
                    self.expand_switch(definition, parsed, branches, scope, &values)
                }
                NodeKind::Elements(elements) => {
                    self.expand_elements(definition, parsed, elements, scope, &values)
                }
                NodeKind::Pick(pick) => self.expand_pick(definition, parsed, pick, scope, &values),
                NodeKind::Unknown(diagnostic) => {
                    let diagnostic = diagnostic.clone();
                    let diagnostic = diagnostic.map(|diagnostic| {
                        definition.source_map.diagnostic(diagnostic, &scope.uses)
                    });
                    let (built, links) = (unknown_node(&parsed.tree, diagnostic), Vec::new());
                    let name = Instance::default().name(parsed, scope);
                    let new_node = NewNode { name, built, links, outputs: vec!["value"] };
                    vec![(self.push_node(definition, parsed, new_node, scope), 0)]
                }
            };
        }
        for each in &definition.for_each_nodes {
            let element =
                each.elements.first().map(|&element| &definition.parsed_nodes[element].what);
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
                    let given = elements.iter().filter_map(|&k| values.first_target((k, index)));
                    (name.to_owned(), given.collect())
                })
                .collect();
            let name = format!("{}{}", scope.prefix, each.name);
            let (kind, inputs) = (format!("ForEach({})", each.kind), Vec::new());
            self.uses.push(GraphUse { name, kind, inputs, outputs, is_open: false });
        }
        self.add_expectations(definition, scope, first..self.nodes.len(), &values);
        values
    }

    /// Counts one more node. Returns true if the number of nodes exceeds [`MAX_NODES`]. Only the first excess is reported.
    fn count_and_check(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        scope: &Scope,
    ) -> bool {
        self.count += 1;
        if self.count == MAX_NODES + 1 {
            self.with_check(definition, scope, |check| {
                let message = format!("the graph has more than {MAX_NODES} nodes");
                let help = "use fewer nested graphs, or iterate over fewer elements";
                check.report(code::CYCLE, parsed.name.span, message, help);
            });
        }
        self.count > MAX_NODES
    }

    /// Adds a node or a used graph, and returns its outputs.
    fn expand_instance(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        one: &Instance,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        match &parsed.what {
            NodeKind::Node(_) => self.expand_node(definition, parsed, one, scope, values),
            NodeKind::Use(_, graph) => {
                self.expand_use(definition, parsed, graph, one, scope, values)
            }
            _ => Vec::new(),
        }
    }

    /// Runs a check in the context of a graph's file, and reports the diagnostics of the check.
    fn with_check<R>(
        &mut self,
        definition: &Definition,
        scope: &Scope,
        work: impl FnOnce(&mut Check<'_, 'a>) -> R,
    ) -> R {
        let mut check = Check::new(self.world, definition.source_map.clone(), scope.uses.to_vec());
        let result = work(&mut check);
        let mut diagnostics = check.diagnostics;
        diagnostics.sort_by_key(|diagnostic| diagnostic.span);
        let diagnostics = diagnostics.into_iter();
        let diagnostics =
            diagnostics.map(|diagnostic| definition.source_map.diagnostic(diagnostic, &scope.uses));
        self.world.diagnostics.extend(diagnostics);
        result
    }

    fn expand_node(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        one: &Instance,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let NodeKind::Node(entry) = &parsed.what else { return Vec::new() };
        let absent = absent_links(definition, parsed, scope);
        let targets = parsed.targets.iter().flatten().flatten();
        let takes_lists = targets.clone().any(|(node, _)| values.repeated.contains_key(node));
        let reusable = parsed.built.as_ref().filter(|_| {
            let is_parametric = scope.values.is_some() && parsed.parametric;
            !is_parametric && !takes_lists && one.number.is_none() && absent.is_empty()
        });
        let targets_by_link =
            (0..parsed.links.len()).map(|link| one.targets_at(parsed, link, values));
        let targets_by_link = Vec::from_iter(targets_by_link);
        let built = match reusable {
            Some(built) => Some(built.clone()),
            None => self.with_check(definition, scope, |check| {
                let tree = without_links(&one.tree(parsed), &absent);
                let checked = check.check_fields(&parsed.what, &tree, scope.values(definition));
                let has_other_links = takes_lists || !absent.is_empty();
                let checked = CheckedFields { has_other_links, ..checked };
                checked.files.iter().for_each(|file| check.check_file_access(file));
                let is_valid = check.is_valid_since(0) && checked.tree.is_complete();
                let links = parsed.links.iter().zip(&targets_by_link);
                let present = links.filter(|(link, _)| !absent.contains_key(&link.span));
                let counts = present.map(|(_, targets)| targets.len());
                is_valid.then(|| check.build_node(entry, checked, counts)).flatten()
            }),
        };
        let Some(built) = built else { return Vec::new() };
        let mut links = Vec::with_capacity(parsed.links.len());
        for (link, targets) in parsed.links.iter().zip(targets_by_link) {
            links.extend(targets.into_iter().map(|(node, output)| Link {
                port: link.port.clone(),
                node,
                output,
            }));
        }
        let outputs = entry.outputs().iter().map(|output| output.name).collect();
        let new_node = NewNode { name: one.name(parsed, scope), built, links, outputs };
        let node = self.push_node(definition, parsed, new_node, scope);
        (0..parsed.types.len()).map(|output| (node, output)).collect()
    }

    fn push_node(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        new_node: NewNode,
        scope: &Scope,
    ) -> usize {
        let NewNode { name, built, links, outputs } = new_node;
        let last = parsed.types.last().copied().flatten();
        let types = parsed.types.iter().copied().chain(std::iter::repeat(last));
        self.nodes.push(GraphNode {
            name,
            recipe: built.recipe,
            source_map: definition.source_map.clone(),
            span: parsed.tree.span,
            uses: scope.uses.clone(),
            node: built.node,
            pack: built.pack,
            links,
            files: built.files,
            tree: built.tree,
            types: types.take(outputs.len().max(parsed.types.len())).collect(),
            outputs,
            guards: Vec::new(),
        });
        self.nodes.len() - 1
    }

    /// Adds a used graph, and returns its outputs.
    fn expand_use(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        graph: &Definition,
        one: &Instance,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let own = scope.values(definition);
        let is_known = (scope.values.is_none() || !parsed.parametric) && one.number.is_none();
        let tree = match is_known {
            true => parsed.is_valid.then(|| {
                own.resolve_call(&parsed.tree, parsed.what.kind(), &graph.fields, &mut Vec::new())
            }),
            // The parameter values differ from those with which the file was checked, so check the fields again.
            false => self.with_check(definition, scope, |check| {
                let checked = check.check_fields(&parsed.what, &one.tree(parsed), own);
                (check.diagnostics.is_empty() && checked.tree.is_complete()).then_some(checked.tree)
            }),
        };
        // If the fields that are given to a used graph have an error, do not check the graph's nodes.
        let Some(tree) = tree else { return Vec::new() };
        let fields = tree.fields().unwrap_or_default().iter();
        let given = fields.filter_map(|field| {
            let name = name_of(&field.name.text);
            let is_parameter = graph.declared.iter().any(|declared| declared.name == name);
            is_parameter
                .then(|| (name, for_other_file(field.value.clone(), &definition.source_map)))
        });
        let given = Vec::from_iter(given);
        let mut inputs = vec![None; graph.inputs];
        let mut linked_ports = Vec::with_capacity(graph.inputs);
        for (case, link) in parsed.links.iter().enumerate() {
            let name = name_of(&link.port);
            let port = graph.parsed_nodes[..graph.inputs].iter().position(|d| d.name.text == name);
            let target = one.targets_at(parsed, case, values).first().copied();
            if let (Some(port), Some(target)) = (port, target) {
                inputs[port] = Some(target);
                linked_ports.push((link.port.clone(), target));
            }
        }
        let (source, span) = definition.source_map.locate(parsed.name.span);
        let name = one.name.clone().unwrap_or_else(|| parsed.name.text.clone());
        let uses = scope.uses.iter().cloned().chain([Use { name, source, span }]).collect();
        let name = one.name(parsed, scope);
        let mut inside = Scope { prefix: format!("{name}/"), uses, inputs, values: None };
        if !given.is_empty() {
            let values = self.with_check(graph, &inside, |check| {
                graph.defaults.with_values(given, &mut check.diagnostics)
            });
            inside.values = Some(values);
        }
        let first = self.nodes.len();
        let values = with_enough_stack(inside.uses.len(), || self.expand_graph(graph, &inside));
        self.add_guards(graph, &inside, first);
        fn output(port: &super::definition::Port, values: &Values) -> Option<(usize, usize)> {
            values.first_target(port.target?)
        }
        let outputs = graph
            .ports
            .iter()
            .map(|port| output(port, &values).unwrap_or_default())
            .collect::<Vec<_>>();
        let names = graph.ports.iter().map(|port| port.name.clone());
        let given = names.zip(outputs.iter().map(|&target| vec![target])).collect();
        let kind = parsed.what.kind().to_owned();
        let (inputs, is_open) = (linked_ports, false);
        self.uses.push(GraphUse { name, kind, inputs, outputs: given, is_open });
        outputs
    }

    /// Returns the targets of the chosen case. The nodes of the other cases are added as well, but no node depends on them.
    fn expand_switch(
        &mut self,
        definition: &Definition,
        parsed: &ParsedNode,
        branches: &Branches,
        scope: &Scope,
        values: &Values,
    ) -> Vec<Target> {
        let chosen = self.with_check(definition, scope, |check| {
            let own = scope.values(definition);
            let chosen = own.substitute(&branches.choose, &mut check.diagnostics);
            let case = branches.find_case(&chosen);
            // A broken choice has already been reported, for example at the default of its parameter.
            if chosen.is_broken() {
                Err(())
            } else {
                case.map_err(|(message, word): (String, String)| {
                    let help = check.guess(|| branches.suggest_case(&word));
                    check.report(code::WRONG_VALUE, chosen.span, message, help);
                })
            }
        });
        let Ok(case) = chosen else { return Vec::new() };
        let given = link_targets(parsed, case, values);
        let outputs = vec![(String::new(), given.clone())];
        let name = format!("{}{}", scope.prefix, parsed.name.text);
        let inputs = Vec::new();
        self.uses.push(GraphUse { name, kind: "Switch".into(), inputs, outputs, is_open: false });
        given
    }
}

/// The data of a node that is to be added to the flat graph.
struct NewNode {
    name: String,
    built: BuiltNode,
    links: Vec<Link>,
    outputs: Vec<&'static str>,
}

/// Returns the targets of a link of a parsed node in the flat graph.
fn link_targets(parsed: &ParsedNode, link: usize, values: &Values) -> Vec<Target> {
    let targets = parsed.targets.get(link).and_then(Option::as_ref).into_iter().flatten();
    targets.flat_map(|&target| values.get(target).iter().copied()).collect()
}
