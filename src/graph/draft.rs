//! The nodes of a graph as its file has them, looked at one by one with the defaults of parameters.

use std::collections::HashSet;
use std::sync::Arc;

use maquette_node::Output;
use maquette_syntax::error::code;
use maquette_syntax::{Finding, FoundLink, Kind, Name, Tree, nearest};
use maquette_value::ValueType;
use serde_json::Value as Json;

use super::check::Check;
use super::definition::{Definition, Used};
use super::each::{Branches, Each, Over, element_name};
use super::migrate::renewed;
use super::node::{Built, Survey, is_own};
use super::parameters::{Parameters, is_parametric};
use super::repeat::{Elements, Pick, Repeat};
use crate::catalog::{Entry, PortDescription, ports};

/// A node while it is checked.
pub struct Draft {
    pub name: Name,
    /// What stands in the file.
    pub tree: Tree,
    pub what: What,
    pub links: Vec<FoundLink>,
    /// For each link, the nodes and outputs that it names, if they exist.
    pub(super) targets: Vec<Option<Vec<(usize, usize)>>>,
    /// The type of each output, as far as it is known.
    pub types: Vec<Option<&'static ValueType>>,
    /// Whether parameters of the graph shape it.
    pub(super) parametric: bool,
    /// Whether its fields have no problem with the defaults.
    pub(super) is_sound: bool,
    /// Whether it is an input that a use may leave out.
    pub is_optional: bool,
    /// Its fields with the defaults, if they have no problem, until the node is made of them.
    survey: Option<Survey>,
    /// A built-in node itself, with the defaults.
    pub(super) built: Option<Built>,
    /// Whether it stands for as many as there will be.
    pub(super) repeat: Option<Repeat>,
}

/// What a node is.
pub enum What {
    /// Built in.
    Node(Arc<Entry>),
    /// A graph, under this name.
    Use(String, Arc<Definition>),
    /// What comes into the graph.
    Input,
    /// One of its links.
    Switch(Branches),
    /// What a `ForEach` goes over: the elements of a value.
    Elements(Elements),
    /// One element of a `ForEach` over data.
    Pick(Pick),
    /// Of a type that no pack has, with what is told of it; or something that is wrong in another way.
    Unknown(Option<Finding>),
}

impl What {
    /// The names of the outputs.
    pub fn outputs(&self) -> Vec<&str> {
        match self {
            Self::Node(entry) => entry.outputs().iter().map(|output| output.name).collect(),
            Self::Use(_, graph) => graph.ports.iter().map(|port| &port.name[..]).collect(),
            Self::Pick(pick) => pick.outputs.iter().map(String::as_str).collect(),
            Self::Input | Self::Switch(_) | Self::Elements(_) | Self::Unknown(_) => Vec::new(),
        }
    }

    /// Its ports, if it is a node or a graph.
    pub fn ports(&self) -> Vec<PortDescription> {
        match self {
            Self::Node(entry) => entry.ports(),
            Self::Use(_, graph) => ports(&graph.fields),
            _ => Vec::new(),
        }
    }

    /// The type of each output, as far as no link decides it.
    fn types(&self) -> Vec<Option<&'static ValueType>> {
        let of_node = |output: &Output| match output.types[..] {
            [kind] => Some(kind),
            _ => None,
        };
        match self {
            Self::Node(entry) => entry.outputs().iter().map(of_node).collect(),
            Self::Use(_, graph) => graph.ports.iter().map(|port| port.kind).collect(),
            _ => Vec::new(),
        }
    }

    /// The description of its fields.
    pub fn schema(&self) -> Option<&Json> {
        match self {
            Self::Node(entry) => Some(entry.merged_schema()),
            Self::Use(_, graph) => Some(&graph.fields),
            _ => None,
        }
    }

    /// The name of its type.
    pub(super) fn kind(&self) -> &str {
        match self {
            Self::Node(entry) => &entry.name,
            Self::Use(name, _) => name,
            Self::Input => "input",
            Self::Switch(_) => "Switch",
            Self::Elements(_) => "ForEach",
            Self::Pick(pick) => &pick.kind,
            Self::Unknown(_) => "",
        }
    }
}

impl Draft {
    pub(super) fn input(
        name: Name,
        tree: Tree,
        kind: Option<&'static ValueType>,
        is_optional: bool,
    ) -> Self {
        Self { types: vec![kind], is_optional, ..Self::new(name, tree, What::Input) }
    }

    /// A draft that is no node of the catalog, with its links.
    pub(super) fn linked(name: Name, tree: Tree, what: What, links: Vec<FoundLink>) -> Self {
        Self { links, ..Self::new(name, tree, what) }
    }

    pub(super) fn new(name: Name, tree: Tree, what: What) -> Self {
        Self {
            name,
            parametric: is_parametric(&tree),
            tree,
            what,
            links: Vec::new(),
            targets: Vec::new(),
            types: Vec::new(),
            is_sound: true,
            is_optional: false,
            survey: None,
            built: None,
            repeat: None,
        }
    }

    /// Whether a link to this output leads to a list, of a length that is known late.
    pub fn is_list(&self, output: usize) -> bool {
        let Some(repeat) = &self.repeat else { return false };
        let outputs = self.what.outputs();
        let name = outputs.get(output).copied().unwrap_or_default();
        repeat.carry.iter().all(|(carried, _)| carried != name)
    }
}

impl<'a> Check<'_, 'a> {
    /// What may be left out must not be needed.
    pub(super) fn optional_inputs(&mut self, drafts: &[Draft]) {
        for draft in drafts {
            for (link, targets) in draft.links.iter().zip(&draft.targets) {
                let input = targets.iter().flatten().map(|(node, _)| &drafts[*node]);
                let Some(input) = input.into_iter().find(|input| input.is_optional) else {
                    continue;
                };
                let is_case = matches!(draft.what, What::Switch(_));
                if link.optional || link.many && !is_case {
                    continue;
                }
                let (port, kind, name) = (&link.port, draft.what.kind(), &input.name.text);
                let what = if is_case { "case" } else { "port" };
                let message = format!(
                    "{what} `{port}` of {kind} needs a value, but input `{name}` may be left out"
                );
                let help = format!("declare `{name}` without Optional(..), or link something else");
                self.find(code::MISSING_FIELD, link.span, message, help);
            }
        }
    }

    /// The nodes as drafts, behind those that are there already.
    pub(super) fn drafts(
        &mut self,
        entries: &[(&Tree, &Tree)],
        subgraphs: &[Used],
        defaults: &Parameters,
        drafts: &mut Vec<Draft>,
    ) -> Vec<Each> {
        let mut eaches = Vec::new();
        for (key, value) in entries {
            let text = key.text().unwrap_or_default().to_owned();
            let name = Name { text, span: key.span };
            // The file's own types go before the packs', old names and new.
            let value = match is_own(value, subgraphs) {
                true => (*value).clone(),
                false => {
                    let (value, outdated) = renewed(value, self.world.catalog);
                    self.findings.extend(outdated);
                    value
                }
            };
            let value = self.with_sets(&name.text, value, subgraphs);
            match value.name().as_ref().map(|kind| &kind.text[..]) {
                Some("ForEach") => {
                    eaches.extend(self.each(name, &value, subgraphs, defaults, drafts));
                }
                Some("Switch") => drafts.push(self.switch(name, value, defaults)),
                _ => {
                    let what = self.what(&value, &name, subgraphs);
                    let mut draft = Draft::new(name, value, what);
                    self.look(&mut draft, defaults);
                    drafts.push(draft);
                }
            }
        }
        eaches
    }

    /// The nodes of a `ForEach`. What is wrong with all of them is one problem.
    fn each(
        &mut self,
        name: Name,
        value: &Tree,
        subgraphs: &[Used],
        defaults: &Parameters,
        drafts: &mut Vec<Draft>,
    ) -> Option<Each> {
        let Some(repeated) = self.repeated(value) else {
            drafts.push(Draft::new(name, value.clone(), What::Unknown(None)));
            return None;
        };
        if !self.carries(&name, value, &repeated, subgraphs) {
            drafts.push(Draft::new(name, value.clone(), What::Unknown(None)));
            return None;
        }
        let Over::List(list) = &repeated.over else {
            self.repeat(name, value, repeated, subgraphs, defaults, drafts);
            return None;
        };
        let first = drafts.len();
        let known = self.findings.len();
        let mut outputs = None;
        for (index, call) in repeated.calls(&name.text, list).into_iter().enumerate() {
            let text = element_name(&name.text, index);
            let call = self.with_sets(&text, call, subgraphs);
            let element = Name { text, span: name.span };
            let what = self.what(&call, &element, subgraphs);
            let mut draft = Draft::new(element, call, what);
            self.look(&mut draft, defaults);
            drafts.push(draft);
        }
        let mut said = HashSet::new();
        let mut found = self.findings.split_off(known);
        found.retain(|finding| said.insert((finding.code, finding.message.clone())));
        self.findings.append(&mut found);
        if drafts.len() == first {
            // Without elements there is still something to say about the type.
            let call = Tree::new(value.span, Kind::Word(repeated.kind.text.clone()));
            let what = self.what(&call, &name, subgraphs);
            outputs = Some(what.outputs().iter().map(|&name| name.to_owned()).collect());
        }
        Some(Each {
            name: name.text,
            span: name.span,
            carry: repeated.carried(),
            kind: repeated.kind.text,
            elements: (first..drafts.len()).collect(),
            outputs,
        })
    }

    fn switch(&mut self, name: Name, value: Tree, defaults: &Parameters) -> Draft {
        let Some(branches) = self.branches(&value) else {
            return Draft::new(name, value, What::Unknown(None));
        };
        let chosen = defaults.substitute(&branches.choose, &mut self.findings);
        if let Err((message, word)) = branches.chosen(&chosen)
            && !chosen.is_broken()
        {
            let help = self.guess(|| branches.meant(&word));
            self.find(code::WRONG_VALUE, chosen.span, message, help);
        }
        let links = branches.cases.iter().map(|(name, link)| link_of(link, name, true)).collect();
        Draft::linked(name, value, What::Switch(branches), links)
    }

    /// What a node is by the name before its parentheses.
    pub(super) fn what(&mut self, tree: &Tree, name: &Name, subgraphs: &[Used]) -> What {
        let Some(kind) = tree.name() else {
            if !tree.is_broken() {
                let message = format!("node `{}` is {}, not a node", name.text, tree.in_words());
                self.find(code::WRONG_VALUE, tree.span, message, "write `Type(field: value, ..)`");
            }
            return What::Unknown(None);
        };
        if let Some(entry) = self.world.catalog.shared(&kind.text) {
            return What::Node(entry);
        }
        if let Some(subgraph) = subgraphs.iter().find(|subgraph| subgraph.name == kind.text) {
            // What is wrong with its file is said there.
            let definition = subgraph.definition.clone();
            return definition.map_or(What::Unknown(None), |it| What::Use(kind.text.clone(), it));
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
                    "" => "the command `nodes` lists those of this program; others come in packs"
                        .into(),
                    others => format!("{others}; others come in packs").into(),
                },
            }
        });
        let (code, span) = (code::UNKNOWN_NODE, kind.span);
        let finding = Finding { code, span, message, help, note: None };
        self.findings.push(finding.clone());
        What::Unknown(Some(finding))
    }

    /// Looks at a node's fields with the default values of parameters.
    pub(super) fn look(&mut self, draft: &mut Draft, defaults: &Parameters) {
        draft.types = draft.what.types();
        let known = self.findings.len();
        let survey = self.survey(&draft.what, &draft.tree, defaults);
        // Which file a parameter names is a matter of the uses.
        let is_open = draft.parametric && !self.is_first();
        if is_open {
            let mut found = self.findings.split_off(known);
            found.retain(|finding| finding.code != code::MISSING_FILE);
            self.findings.append(&mut found);
        } else {
            survey.files.iter().for_each(|file| self.may_read(file));
        }
        // A file that is not there is waited for.
        self.note_files(&draft.name.text, &survey.files, None);
        draft.links.clone_from(&survey.links);
        let sound = self.findings.len() == known && survey.tree.is_whole();
        draft.is_sound = sound;
        let left_open = is_open && !survey.files.is_empty();
        draft.survey = (sound && !left_open).then_some(survey);
    }

    /// Makes the nodes whose fields have no problem.
    pub(super) fn build(&mut self, drafts: &mut [Draft]) {
        for draft in drafts {
            let Some(survey) = draft.survey.take() else { continue };
            let What::Node(entry) = &draft.what else { continue };
            let counts = draft.targets.iter().map(|targets| targets.as_ref().map_or(1, Vec::len));
            draft.built = self.built(entry, survey, counts);
            if let Some(built) = &draft.built {
                self.note_files(&draft.name.text, &[], Some(&*built.node));
            }
        }
    }
}

/// A link of a draft that is no node of the catalog.
pub(super) fn link_of(link: &Tree, port: &str, many: bool) -> FoundLink {
    FoundLink {
        span: link.span,
        text: link.text().unwrap_or_default().to_owned(),
        port: port.to_owned(),
        wants: String::new(),
        types: Vec::new(),
        many,
        optional: false,
    }
}
