//! The nodes of a graph as its file has them, looked at one by one with the defaults of parameters.

use std::collections::HashSet;

use maquette_syntax::error::code;
use maquette_syntax::{Finding, FoundLink, Kind, Name, Tree, nearest};

use super::check::Check;
use super::definition::Used;
use super::each::{Over, element_name};
use super::migrate::renewed;
use super::node::is_own;
use super::parameters::Parameters;
use crate::definition::{Draft, Each, What};

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
        let sound = self.is_sound_since(known) && survey.tree.is_whole();
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
