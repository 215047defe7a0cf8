//! Checks the nodes of a graph one by one, with the default values of parameters.

use std::collections::HashSet;

use maquette_syntax::error::code;
use maquette_syntax::{FoundLink, Kind, LocalDiagnostic, Name, Tree, nearest};

use super::check::Check;
use super::definition::UsedGraph;
use super::for_each::{ForEachSource, element_name};
use super::migrate::migrate_node;
use super::node::is_own_type;
use super::parameters::Parameters;
use crate::definition::{ForEachNode, NodeKind, ParsedNode};

impl<'a> Check<'_, 'a> {
    /// Reports links from optional inputs of the graph to ports that require a link.
    pub(super) fn check_optional_inputs(&mut self, parsed_nodes: &[ParsedNode]) {
        for parsed in parsed_nodes {
            for (link, targets) in parsed.links.iter().zip(&parsed.targets) {
                let input = targets.iter().flatten().map(|(node, _)| &parsed_nodes[*node]);
                let Some(input) = input.into_iter().find(|input| input.is_optional) else {
                    continue;
                };
                let is_case = matches!(parsed.what, NodeKind::Switch(_));
                if link.is_optional || link.is_list && !is_case {
                    continue;
                }
                let (port, kind, name) = (&link.port, parsed.what.kind(), &input.name.text);
                let what = if is_case { "case" } else { "port" };
                let message = format!(
                    "{what} `{port}` of {kind} needs a value, but input `{name}` may be left out"
                );
                let help = format!("declare `{name}` without Optional(..), or link something else");
                self.report(code::MISSING_FIELD, link.span, message, help);
            }
        }
    }

    /// Parses the nodes of the graph and appends them to `parsed_nodes`.
    pub(super) fn parse_nodes(
        &mut self,
        entries: &[(&Tree, &Tree)],
        subgraphs: &[UsedGraph],
        defaults: &Parameters,
        parsed_nodes: &mut Vec<ParsedNode>,
    ) -> Vec<ForEachNode> {
        let mut for_each_nodes = Vec::new();
        for (key, value) in entries {
            let text = key.text().unwrap_or_default().to_owned();
            let name = Name { text, span: key.span };
            // A used graph takes precedence over a pack's node type of the same name. This applies to current and outdated names of node
            // types.
            let value = match is_own_type(value, subgraphs) {
                true => (*value).clone(),
                false => {
                    let (value, outdated) = migrate_node(value, self.world.catalog);
                    self.diagnostics.extend(outdated);
                    value
                }
            };
            let value = self.with_sets(&name.text, value, subgraphs);
            match value.name().as_ref().map(|kind| &kind.text[..]) {
                Some("ForEach") => {
                    for_each_nodes.extend(self.parse_for_each(
                        name,
                        &value,
                        subgraphs,
                        defaults,
                        parsed_nodes,
                    ));
                }
                Some("Switch") => parsed_nodes.push(self.parse_switch(name, value, defaults)),
                _ => {
                    let what = self.node_kind(&value, &name, subgraphs);
                    let mut parsed = ParsedNode::new(name, value, what);
                    self.check_node_fields(&mut parsed, defaults);
                    parsed_nodes.push(parsed);
                }
            }
        }
        for_each_nodes
    }

    /// Parses the nodes of a `ForEach`. An error that all of these nodes share is reported once.
    fn parse_for_each(
        &mut self,
        name: Name,
        value: &Tree,
        subgraphs: &[UsedGraph],
        defaults: &Parameters,
        parsed_nodes: &mut Vec<ParsedNode>,
    ) -> Option<ForEachNode> {
        let Some(repeated) = self.read_for_each(value) else {
            parsed_nodes.push(ParsedNode::new(name, value.clone(), NodeKind::Unknown(None)));
            return None;
        };
        if !self.check_carry(&name, value, &repeated, subgraphs) {
            parsed_nodes.push(ParsedNode::new(name, value.clone(), NodeKind::Unknown(None)));
            return None;
        }
        let ForEachSource::List(list) = &repeated.over else {
            self.parse_repeat(name, value, repeated, subgraphs, defaults, parsed_nodes);
            return None;
        };
        let first = parsed_nodes.len();
        let known = self.diagnostics.len();
        let mut outputs = None;
        for (index, call) in repeated.calls(&name.text, list).into_iter().enumerate() {
            let text = element_name(&name.text, index);
            let call = self.with_sets(&text, call, subgraphs);
            let element = Name { text, span: name.span };
            let what = self.node_kind(&call, &element, subgraphs);
            let mut parsed = ParsedNode::new(element, call, what);
            self.check_node_fields(&mut parsed, defaults);
            parsed_nodes.push(parsed);
        }
        let mut said = HashSet::new();
        let mut found = self.diagnostics.split_off(known);
        found.retain(|diagnostic| said.insert((diagnostic.code, diagnostic.message.clone())));
        self.diagnostics.append(&mut found);
        if parsed_nodes.len() == first {
            // Check the node type even if there are no elements.
            let call = Tree::new(value.span, Kind::Word(repeated.kind.text.clone()));
            let what = self.node_kind(&call, &name, subgraphs);
            outputs = Some(what.outputs().iter().map(|&name| name.to_owned()).collect());
        }
        Some(ForEachNode {
            name: name.text,
            span: name.span,
            carry: repeated.carried_outputs(),
            kind: repeated.kind.text,
            elements: (first..parsed_nodes.len()).collect(),
            outputs,
        })
    }

    fn parse_switch(&mut self, name: Name, value: Tree, defaults: &Parameters) -> ParsedNode {
        let Some(branches) = self.read_switch(&value) else {
            return ParsedNode::new(name, value, NodeKind::Unknown(None));
        };
        let chosen = defaults.substitute(&branches.choose, &mut self.diagnostics);
        if let Err((message, word)) = branches.find_case(&chosen)
            && !chosen.is_broken()
        {
            let help = self.guess(|| branches.suggest_case(&word));
            self.report(code::WRONG_VALUE, chosen.span, message, help);
        }
        let links = branches.cases.iter().map(|(name, link)| link_of(link, name, true)).collect();
        ParsedNode::with_links(name, value, NodeKind::Switch(branches), links)
    }

    /// Determines the kind of a node from the name of its call, such as `Threshold` in `Threshold(..)`.
    pub(super) fn node_kind(
        &mut self,
        tree: &Tree,
        name: &Name,
        subgraphs: &[UsedGraph],
    ) -> NodeKind {
        let Some(kind) = tree.name() else {
            if !tree.is_broken() {
                let message = format!("node `{}` is {}, not a node", name.text, tree.describe());
                self.report(
                    code::WRONG_VALUE,
                    tree.span,
                    message,
                    "write `Type(field: value, ..)`",
                );
            }
            return NodeKind::Unknown(None);
        };
        if let Some(entry) = self.world.catalog.find_shared(&kind.text) {
            return NodeKind::Node(entry);
        }
        if let Some(subgraph) = subgraphs.iter().find(|subgraph| subgraph.name == kind.text) {
            // Errors in the file of a used graph are reported in that file, not here.
            let definition = subgraph.definition.clone();
            return definition
                .map_or(NodeKind::Unknown(None), |it| NodeKind::Use(kind.text.clone(), it));
        }
        let message = format!("there is no node type `{}`", kind.text);
        let help = self.guess(|| {
            let mut names = self.world.catalog.names();
            names.extend(subgraphs.iter().map(|subgraph| &subgraph.name[..]));
            let near = Some(nearest(&kind.text, names)).filter(|help| !help.is_empty());
            match (near, self.missing_packs()) {
                (Some(near), Some(packs)) => format!("{near} Or {packs}").into(),
                (Some(near), None) => near,
                (None, Some(packs)) => packs.into(),
                (None, None) => match &self.world.catalog.described_with(&kind.text)[..] {
                    "" => "run `maquette nodes` for a list; other types come in packs".into(),
                    others => format!("{others}; other types come in packs").into(),
                },
            }
        });
        let (code, span) = (code::UNKNOWN_NODE, kind.span);
        let diagnostic = LocalDiagnostic { code, span, message, help, note: None };
        self.diagnostics.push(diagnostic.clone());
        NodeKind::Unknown(Some(diagnostic))
    }

    /// Checks a node's fields with the default values of parameters.
    pub(super) fn check_node_fields(&mut self, parsed: &mut ParsedNode, defaults: &Parameters) {
        parsed.types = parsed.what.types();
        let known = self.diagnostics.len();
        let checked = self.check_fields(&parsed.what, &parsed.tree, defaults);
        // If a parameter names a file, the file is checked for each use of the graph.
        let is_open = parsed.parametric && !self.is_root();
        if is_open {
            let mut found = self.diagnostics.split_off(known);
            found.retain(|diagnostic| diagnostic.code != code::MISSING_FILE);
            self.diagnostics.append(&mut found);
        } else {
            checked.files.iter().for_each(|file| self.check_file_access(file));
        }
        // Store missing files too, because they are watched for changes.
        self.note_files(&parsed.name.text, &checked.files, None);
        parsed.links.clone_from(&checked.links);
        let is_valid = self.is_valid_since(known) && checked.tree.is_complete();
        parsed.is_valid = is_valid;
        let left_open = is_open && !checked.files.is_empty();
        parsed.checked_fields = (is_valid && !left_open).then_some(checked);
    }

    /// Builds the nodes whose fields are valid.
    pub(super) fn build_nodes(&mut self, parsed_nodes: &mut [ParsedNode]) {
        for parsed in parsed_nodes {
            let Some(checked) = parsed.checked_fields.take() else { continue };
            let NodeKind::Node(entry) = &parsed.what else { continue };
            let counts = parsed.targets.iter().map(|targets| targets.as_ref().map_or(1, Vec::len));
            parsed.built = self.build_node(entry, checked, counts);
            if let Some(built) = &parsed.built {
                self.note_files(&parsed.name.text, &[], Some(&*built.node));
            }
        }
    }
}

/// Creates a link of an entry that is not of a type in the catalog, such as a `Switch`.
pub(super) fn link_of(link: &Tree, port: &str, many: bool) -> FoundLink {
    FoundLink {
        span: link.span,
        text: link.text().unwrap_or_default().to_owned(),
        port: port.to_owned(),
        wants: String::new(),
        types: Vec::new(),
        is_list: many,
        is_optional: false,
    }
}
