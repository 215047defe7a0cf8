//! One node of a graph: its fields looked at, and the node itself made of them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_node::{AnyNode, FieldError};
use maquette_syntax::error::{Problem, Span, code};
use maquette_syntax::paths::{PathProblem, may_read};
use maquette_syntax::{
    Body, DEEPEST, Field, Finding, FoundFile, Kind, Name, Reader, Slots, Tree, Walk,
    nearest_or_all, unit_names,
};

use super::check::Check;
use super::definition::Used;
use super::migrate::{Renewed, kind_of, renewed_put};
use super::parameters::{Parameters, read_set};
use super::quality::{has_draft, is_draft, is_side};
use super::recipe::Recipe;
use super::{Files, ReadFile, Refusal, unreachable_part};
use crate::catalog::Entry;
use crate::definition::{Built, Draft, Each, Survey, What};
use crate::files::NodeFile;

impl Check<'_, '_> {
    /// Finds the problems of a node's fields with these values of parameters; what a `Draft` does not stand for now must be right, too.
    pub(super) fn survey(&mut self, what: &What, tree: &Tree, values: &Parameters) -> Survey {
        let survey = self.survey_of_side(what, tree, values);
        if has_draft(tree) {
            let known = std::mem::take(&mut self.findings);
            let other = self.survey_of_side(what, tree, &values.of_other_side());
            let found = std::mem::replace(&mut self.findings, known);
            for finding in found {
                if !self.findings.iter().any(|known| {
                    (known.code, known.span, &known.message)
                        == (finding.code, finding.span, &finding.message)
                }) {
                    self.findings.push(finding);
                }
            }
            if let Some(link) =
                survey.links.iter().find(|link| other.links.iter().all(|o| o.span != link.span))
            {
                let message = format!("port `{}` cannot take a Draft: it takes a link", link.port);
                let help = "give a parameter of the node before it a Draft, or choose by a Switch";
                self.find(code::WRONG_VALUE, link.span, message, help);
            }
        }
        survey
    }

    fn survey_of_side(&mut self, what: &What, tree: &Tree, values: &Parameters) -> Survey {
        let Some(schema) = what.schema() else {
            let tree = values.substitute(tree, &mut self.findings);
            let (links, files) = (Vec::new(), Vec::new());
            return Survey { tree, links, files, has_other_links: false };
        };
        let name = what.kind();
        let tree = values.fitted(tree, name, schema, &mut self.findings);
        let mut walk = Walk {
            node: name,
            root: schema,
            sheet: Some(&self.sheet),
            findings: std::mem::take(&mut self.findings),
            links: Vec::new(),
            files: Vec::new(),
        };
        walk.node(&tree);
        let (links, files) = (walk.links, walk.files);
        self.findings = walk.findings;
        Survey { tree, links, files, has_other_links: false }
    }

    /// The node itself, with what only its own type can tell of its fields. `counts` says how many values each link has.
    pub(super) fn built(
        &mut self,
        entry: &Entry,
        survey: Survey,
        counts: impl Iterator<Item = usize>,
    ) -> Option<Built> {
        let mut first = 0;
        let mut slots = HashMap::with_capacity(survey.links.len());
        for (link, count) in survey.links.iter().zip(counts) {
            slots.entry(link.span).or_insert(Slots { first, count });
            first += count;
        }
        let reader = Reader { tree: &survey.tree, links: &slots, files: &survey.files };
        let node = match (entry.node.read)(&reader) {
            Ok(node) => node,
            Err(error) => {
                let message = format!("{} cannot be read: {}", entry.name, error.message);
                let span = error.span.unwrap_or(survey.tree.span);
                self.find(code::WRONG_VALUE, span, message, "");
                return None;
            }
        };
        if !survey.has_other_links
            && let Err(FieldError { field, message, help }) = node.check()
        {
            let fields = survey.tree.fields().unwrap_or_default();
            let found = fields.iter().find(|it| it.name.text == field);
            let span = found.map_or(survey.tree.span, |it| it.value.span);
            self.find(code::WRONG_VALUE, span, format!("{}: {message}", entry.name), help);
            return None;
        }
        let optional = node.files();
        if self.world.options.files != Files::Ignored {
            for file in &optional {
                let (given, resolved) = (file.given(), file.resolved());
                if let Err(PathProblem::Outside { message, help }) =
                    may_read(given, resolved, &self.world.roots)
                {
                    self.find(code::OUTSIDE, survey.tree.span, message, help);
                }
            }
        }
        let parameters = match node.parameters() {
            Ok(parameters) => parameters,
            Err(error) => {
                let message = format!("{} cannot be written: {error}", entry.name);
                let help = "this is a fault of the node";
                self.find(code::WRONG_VALUE, survey.tree.span, message, help);
                return None;
            }
        };
        let roots: Arc<[PathBuf]> = match survey.files.is_empty() && optional.is_empty() {
            true => Arc::default(),
            false => self.world.roots.as_slice().into(),
        };
        fn file(given: &str, path: &Path, needed: bool, roots: &Arc<[PathBuf]>) -> NodeFile {
            NodeFile { given: given.to_owned(), needed, ..NodeFile::given(path, roots.clone()) }
        }
        let named = survey.files.iter().map(|found| NodeFile {
            missing: self.world.missing.get(&self.place_of(found)).cloned(),
            ..file(&found.given, &found.resolved, true, &roots)
        });
        let optional =
            optional.iter().map(|found| file(found.given(), found.resolved(), false, &roots));
        let files: Vec<_> = named.chain(optional).collect();
        let recipe = Arc::new(Recipe::new(&entry.name, parameters, &files));
        let (pack, tree) = (entry.pack, Arc::new(survey.tree));
        Some(Built { node: node.into(), pack, recipe, files, tree })
    }

    /// Returns true if no finding since this one keeps a node from being made: a file that is missing does not.
    pub(super) fn is_sound_since(&self, known: usize) -> bool {
        self.findings[known..].iter().all(|finding| finding.code == code::MISSING_FILE)
    }

    /// The path of a file, and where it is named.
    fn place_of(&self, file: &FoundFile) -> (PathBuf, PathBuf, Span) {
        (file.resolved.clone(), self.sheet.source.name.clone(), file.at)
    }

    /// Says what is wrong with a file: where it is, its ending, or that it is not there.
    pub(super) fn may_read(&mut self, file: &FoundFile) {
        let found = match self.world.options.files {
            Files::Ignored => Ok(()),
            Files::Needed => may_read(&file.given, &file.resolved, &self.world.roots),
            Files::Inside => match may_read(&file.given, &file.resolved, &self.world.roots) {
                Err(PathProblem::Missing { .. }) => Ok(()),
                found => found,
            },
        };
        let misfit = file.misfit.clone();
        let (code, message, help) = match (found, misfit) {
            (Err(PathProblem::Outside { message, help }), _) => (code::OUTSIDE, message, help),
            (_, Some((message, help))) => (code::WRONG_VALUE, message, help.into()),
            (Err(PathProblem::Missing { message, help }), _) => (code::MISSING_FILE, message, help),
            (Ok(()), None) => return,
        };
        let Some(from) = &file.from else {
            let finding = Finding { code, span: file.at, message, help, note: None };
            self.note_missing(file, self.sheet.problem(finding.clone(), &self.uses));
            return self.findings.push(finding);
        };
        // The mistake is where the name stands, not in the graph that was given it.
        let (source, _) = from.sheet.place(from.span);
        let outer = self.uses.iter().position(|at| Arc::ptr_eq(&at.source, &source));
        let uses = &self.uses[..outer.unwrap_or(0)];
        let finding = Finding { code, span: from.span, message, help, note: None };
        let problem = from.sheet.problem(finding, uses);
        self.note_missing(file, problem.clone());
        self.world.problems.push(problem);
    }

    /// Remembers what is reported of a file if it is missing.
    fn note_missing(&mut self, file: &FoundFile, problem: Problem) {
        if problem.code == code::MISSING_FILE {
            self.world.missing.insert(self.place_of(file), problem.into());
        }
    }

    /// Remembers which files a node reads; those that it can do without are known only if its fields have no problem.
    pub(super) fn note_files(
        &mut self,
        node: &str,
        named: &[FoundFile],
        read: Option<&dyn AnyNode>,
    ) {
        let uses = self.uses.iter().map(|at| &at.name[..]);
        let name = uses.chain([node]).collect::<Vec<_>>().join("/");
        fn file(path: &Path, optional: bool, name: &str) -> ReadFile {
            ReadFile { path: path.to_owned(), node: name.to_owned(), optional }
        }
        self.world.files.extend(named.iter().map(|found| file(&found.resolved, false, &name)));
        let optional = read.map(AnyNode::files).unwrap_or_default();
        self.world.files.extend(optional.iter().map(|found| file(found.resolved(), true, &name)));
    }

    /// The node's call with the fields that `--set node.field=value` gives.
    pub(super) fn with_sets(&mut self, node: &str, mut tree: Tree, subgraphs: &[Used]) -> Tree {
        if !self.is_first() {
            return tree;
        }
        let options = self.world.options;
        let is_own = is_own(&tree, subgraphs);
        for (target, text) in &options.set {
            let Some(path) = target.strip_prefix(node).and_then(|rest| rest.strip_prefix('.'))
            else {
                continue;
            };
            if target.split('.').count() > DEEPEST {
                continue;
            }
            let value = read_set(text, &format!("{target}={text}"), Span::default());
            let renewed = match is_own {
                true => None,
                false => renewed_put(&tree, path, &value, self.world.catalog),
            };
            let Some(Renewed { path, value, findings }) = renewed else {
                self.set(&mut tree, (target, text), path, &value);
                continue;
            };
            let told = findings.into_iter().map(|finding| {
                let message = format!("--set {target}={text}: {}", finding.message);
                let help = format!("set `{node}.{path}`, with the value as it is now");
                Finding { span: Span::default(), message, help: help.into(), ..finding }
            });
            self.findings.extend(told);
            self.set(&mut tree, (target, text), &path, &value);
        }
        tree
    }

    /// Puts a value into a call, or says why there is no such place in it.
    fn set(&mut self, tree: &mut Tree, (target, text): (&str, &str), path: &str, value: &Tree) {
        let steps: Vec<_> = path.split('.').collect();
        if let Some(Refusal { code, message, help, .. }) =
            unreachable_part(tree, &steps, self.world.options.draft)
        {
            let message = format!("--set {target}={text}: {message}");
            self.find(code, Span::default(), message, help);
        } else {
            set_field(tree, path, value);
        }
    }

    /// Values of `--set` that go nowhere.
    pub(super) fn unknown_sets(
        &mut self,
        parameters: &Parameters,
        drafts: &[Draft],
        eaches: &[Each],
    ) {
        let nodes = drafts.iter().map(|draft| &draft.name.text[..]);
        let nodes: Vec<_> = nodes.chain(eaches.iter().map(|each| &each.name[..])).collect();
        let options = self.world.options;
        for (target, text) in &options.set {
            if target.split('.').count() > DEEPEST {
                let message = format!("--set ..={text}: this leads more than {DEEPEST} deep");
                self.find(code::UNKNOWN_FIELD, Span::default(), message, "no node needs that");
                continue;
            }
            let (what, name, known) = match target.split_once('.') {
                Some((node, _)) => ("node", node, nodes.clone()),
                None => ("parameter", &target[..], parameters.names()),
            };
            if !known.contains(&name) {
                let message = format!("--set {target}={text}: the graph has no {what} `{name}`");
                let inside = name.split_once('/').map(|(outer, _)| outer);
                fn is_repeated(outer: &&str, drafts: &[Draft]) -> bool {
                    drafts.iter().any(|it| it.name.text == **outer && it.repeat.is_some())
                }
                let help = match inside.filter(|outer| known.contains(outer)) {
                    Some(outer) if is_repeated(&outer, drafts) => format!(
                        "how many elements `{outer}` has is not known, so that they are not set one by one; all of them: --set {outer}.with.field=VALUE"
                    )
                    .into(),
                    Some(outer) => format!(
                        "what is inside of `{outer}` is set by its parameters: --set {outer}.name=VALUE"
                    )
                    .into(),
                    None if what == "node" && parameters.names().contains(&name) => format!(
                        "`{name}` is a parameter, whose value is set as a whole: --set {name}=VALUE"
                    )
                    .into(),
                    None => nearest_or_all(name, &format!("its {what}s"), &known),
                };
                self.find(code::UNKNOWN_LINK, Span::default(), message, help);
            }
        }
    }
}

/// Whether the type of a node, or that which a `ForEach` repeats, is one of the file's own graphs.
pub(super) fn is_own(node: &Tree, subgraphs: &[Used]) -> bool {
    kind_of(node).is_some_and(|kind| subgraphs.iter().any(|own| own.name == kind.text))
}

/// Puts a value at `field` or `field.field` of a call, or `field.0` of a list, if that is no [`unreachable_part`]; a field that is not there
/// is added.
fn set_field(tree: &mut Tree, path: &str, value: &Tree) {
    let (name, rest) = match path.split_once('.') {
        Some((name, rest)) => (name, Some(rest)),
        None => (path, None),
    };
    if is_draft(tree) && !is_side(name) {
        // For this run it counts in any case.
        if let Kind::Call { body: Body::Fields(sides), .. } = &mut tree.kind {
            sides.iter_mut().for_each(|side| set_field(&mut side.value, path, value));
        }
        return;
    }
    let span = tree.span;
    let index = name.parse::<usize>().ok();
    if index.is_some() {
        spread_unit(tree);
    }
    if let Kind::Word(choice) = &mut tree.kind {
        let name = Some(Name { text: std::mem::take(choice), span });
        tree.kind = Kind::Call { name, body: Body::Empty };
    }
    let field = match &mut tree.kind {
        // `Some(..)` and other choices with one value have the fields of the value.
        Kind::Call { body: Body::Items(items), .. } if items.len() == 1 && index.is_none() => {
            return set_field(&mut items[0], path, value);
        }
        Kind::List(items) | Kind::Call { body: Body::Items(items), .. } => {
            match index.and_then(|index| items.get_mut(index)) {
                Some(item) => item,
                None => return,
            }
        }
        Kind::Map(entries) => match entries.iter_mut().find(|(key, _)| key.text() == Some(name)) {
            Some((_, value)) => value,
            None => return,
        },
        Kind::Call { body, .. } => {
            if *body == Body::Empty {
                *body = Body::Fields(Vec::new());
            }
            let Body::Fields(fields) = body else { return };
            let found = fields.iter().position(|field| field.name.text == name);
            let index = found.unwrap_or_else(|| {
                let name = Name { text: name.to_owned(), span };
                let value = Tree::new(span, Kind::Call { name: None, body: Body::Empty });
                fields.push(Field { name, value });
                fields.len() - 1
            });
            &mut fields[index].value
        }
        _ => return,
    };
    match rest {
        Some(rest) => set_field(field, rest, value),
        None => *field = Tree { span: field.span, ..value.clone() },
    }
}

/// Gives each number of a vector the unit of all, so that one of them can have another: `(cm(1), cm(0), cm(2))` of `cm(1, 0, 2)`.
fn spread_unit(tree: &mut Tree) {
    let Kind::Call { name, body: Body::Items(items) } = &mut tree.kind else { return };
    fn is_unit(name: &Name) -> bool {
        unit_names().any(|unit| unit == name.text)
    }
    let Some(unit) = name.take_if(|name| is_unit(name) && items.len() > 1) else { return };
    for item in items {
        let number = std::mem::replace(item, Tree::new(item.span, Kind::Broken));
        let name = Some(unit.clone());
        item.kind = Kind::Call { name, body: Body::Items(vec![number]) };
    }
}
