//! Parses the modules of a crate just far enough to find the dependencies between its files.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// A dependency of one file on another file of the same crate.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Arrow {
    pub(crate) from: String,
    pub(crate) to: String,
    /// The path in the source code that causes the dependency.
    pub(crate) path: String,
    pub(crate) line: usize,
}

/// All modules of a crate except its unit tests. The first one is the root.
pub(crate) struct Sources {
    modules: Vec<Module>,
}

#[derive(Default)]
struct Module {
    file: String,
    parent: usize,
    children: BTreeMap<String, usize>,
    /// The imports of the module: the path of each imported name.
    uses: BTreeMap<String, Vec<String>>,
    /// The names of the items that the module defines.
    items: BTreeSet<String>,
    /// All paths in the module that have at least two segments.
    paths: Vec<Mention>,
    words: Vec<String>,
}

struct Mention {
    path: Vec<String>,
    line: usize,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Use,
    PublicUse,
    Inline,
}

struct Token {
    text: String,
    line: usize,
}

/// The target of a path: a module, or an item in a module. The module is given by its index.
enum Resolution {
    Module(usize),
    Item(usize),
}

impl Sources {
    /// Reads the crate in `folder`, whose root file is `lib.rs`.
    pub(crate) fn read(folder: &Path) -> Self {
        Self::read_from(folder, "lib.rs")
    }

    /// Reads the crate in `folder`, whose root file is `root`.
    pub(crate) fn read_from(folder: &Path, root: &str) -> Self {
        let mut sources = Self { modules: Vec::new() };
        sources.add_file(root, "", 0, &|name| fs::read_to_string(folder.join(name)).ok());
        sources
    }

    /// Parses a crate. `text` returns the content of a file of the crate, given its name.
    pub(crate) fn parse(text: &dyn Fn(&str) -> Option<String>) -> Self {
        let mut sources = Self { modules: Vec::new() };
        sources.add_file("lib.rs", "", 0, text);
        sources
    }

    fn add_file(
        &mut self,
        file: &str,
        folder: &str,
        parent: usize,
        text: &dyn Fn(&str) -> Option<String>,
    ) -> usize {
        let source = text(file).unwrap_or_else(|| panic!("{file} cannot be read"));
        let tokens = without_tests(tokens(&source));
        self.add_module(file, folder, parent, &tokens, text)
    }

    fn add_module(
        &mut self,
        file: &str,
        folder: &str,
        parent: usize,
        tokens: &[Token],
        text: &dyn Fn(&str) -> Option<String>,
    ) -> usize {
        let module = self.modules.len();
        let words = tokens.iter().map(|token| token.text.clone()).collect();
        self.modules.push(Module { file: file.to_owned(), parent, words, ..Module::default() });
        let mut depth = 0;
        let mut is_public = false;
        let mut at = 0;
        while at < tokens.len() {
            let Token { text: word, line } = &tokens[at];
            let after = |n: usize| tokens.get(at + n).map_or("", |token| &token.text);
            match word.as_str() {
                "{" => depth += 1,
                "}" => depth -= 1,
                ";" => is_public = false,
                "pub" => is_public = true,
                "mod" if depth == 0 => {
                    let name = after(1).to_owned();
                    let inside = format!("{folder}{name}/");
                    let child = if after(2) == ";" {
                        let file = format!("{folder}{name}.rs");
                        self.add_file(&file, &inside, module, text)
                    } else {
                        let end = closing(tokens, at + 2);
                        let tokens = &tokens[at + 3..end];
                        at = end;
                        self.add_module(file, &inside, module, tokens, text)
                    };
                    self.modules[module].children.insert(name, child);
                    is_public = false;
                }
                "fn" | "struct" | "enum" | "union" | "trait" | "type" | "const" | "static"
                | "macro_rules" | "impl"
                    if depth == 0 =>
                {
                    self.modules[module].items.insert(after(1).to_owned());
                    is_public = false;
                }
                "use" => {
                    let mut all = Vec::new();
                    at = tree(tokens, at + 1, &[], &mut all);
                    for (path, name, line) in all {
                        let module = &mut self.modules[module];
                        module.paths.push(Mention {
                            path: path.clone(),
                            line,
                            kind: if is_public && depth == 0 { Kind::PublicUse } else { Kind::Use },
                        });
                        module.uses.insert(name, path);
                    }
                    is_public = false;
                }
                _ if is_name(word) && at.checked_sub(1).is_none_or(|k| tokens[k].text != "::") => {
                    let mut path = vec![word.clone()];
                    while after(2 * path.len() - 1) == "::" && is_name(after(2 * path.len())) {
                        path.push(after(2 * path.len()).to_owned());
                    }
                    // Skip `pub(in crate::pack)`, which is a visibility and not a dependency.
                    let says_who =
                        at > 1 && tokens[at - 1].text == "in" && tokens[at - 2].text == "(";
                    if path.len() > 1 && !says_who {
                        at += 2 * (path.len() - 1);
                        self.modules[module].paths.push(Mention {
                            path,
                            line: *line,
                            kind: Kind::Inline,
                        });
                    }
                }
                _ => {}
            }
            at += 1;
        }
        module
    }

    /// Returns the dependencies between files. A file that only re-exports an item (`pub use`) does not depend on the file of the item. A
    /// file that uses the re-exported item does.
    pub(crate) fn arrows(&self) -> impl Iterator<Item = Arrow> {
        self.find(|module, mention| mention.kind != Kind::PublicUse || !module.only_hands_on())
    }

    /// Returns the dependencies between files, including those that are only re-exports.
    pub(crate) fn arrows_with_reexports(&self) -> impl Iterator<Item = Arrow> {
        self.find(|_, _| true)
    }

    fn find(&self, wanted: impl Fn(&Module, &Mention) -> bool) -> impl Iterator<Item = Arrow> {
        let mut found = BTreeSet::new();
        for (index, module) in self.modules.iter().enumerate() {
            for mention in module.paths.iter().filter(|mention| wanted(module, mention)) {
                // Skip a path that begins with an imported name, because the import already counts as the dependency.
                let first = module.uses.get(&mention.path[0]);
                let is_told = mention.kind == Kind::Inline
                    && first.is_some_and(|path| {
                        matches!(self.resolve(index, path, true, 0), Some(Resolution::Item(_)))
                    });
                if is_told {
                    continue;
                }
                // A path to a module is not a dependency. The paths to items in that module are.
                let Some(Resolution::Item(to)) = self.resolve(index, &mention.path, false, 0)
                else {
                    continue;
                };
                let to = &self.modules[to].file;
                if *to != module.file {
                    found.insert(Arrow {
                        from: module.file.clone(),
                        to: to.clone(),
                        path: mention.path.join("::"),
                        line: mention.line,
                    });
                }
            }
        }
        found.into_iter()
    }

    /// Returns the files that contain these tokens one after the other.
    pub(crate) fn files_with(
        &self,
        words: &'static [&'static str],
    ) -> impl Iterator<Item = String> {
        self.modules
            .iter()
            .filter(move |module| module.words.windows(words.len()).any(|at| at == words))
            .map(|module| module.file.clone())
    }

    /// Returns the target of a path in the module `from`. Returns `None` if it is outside of the crate. If a module and another item have
    /// the same name, `to_module` is true to select the module.
    fn resolve(
        &self,
        from: usize,
        path: &[String],
        to_module: bool,
        depth: usize,
    ) -> Option<Resolution> {
        assert!(depth < 100, "{}: {} leads round", self.modules[from].file, path.join("::"));
        let mut at = from;
        for (k, name) in path.iter().enumerate() {
            let module = &self.modules[at];
            let is_last = k + 1 == path.len();
            at = match name.as_str() {
                "crate" => 0,
                "self" => at,
                "super" => module.parent,
                _ => {
                    let child = module.children.get(name).copied();
                    let is_item = module.items.contains(name);
                    // Skip an import such as `use serde::Serialize`, whose first name is that of another crate.
                    let brought = module.uses.get(name).filter(|used| k > 0 || used[0] != *name);
                    match (child, brought) {
                        _ if is_item && is_last && !to_module => return Some(Resolution::Item(at)),
                        (Some(child), _) if !is_last || to_module => child,
                        (_, Some(used)) => {
                            match self.resolve(at, used, !is_last || to_module, depth + 1)? {
                                Resolution::Module(found) => found,
                                item => return Some(item),
                            }
                        }
                        (Some(child), None) => child,
                        (None, None) if k > 0 => return Some(Resolution::Item(at)),
                        (None, None) => return None,
                    }
                }
            };
        }
        Some(Resolution::Module(at))
    }
}

impl Module {
    /// Returns true if the module defines no items, so that it contains only `mod` and `use`.
    fn only_hands_on(&self) -> bool {
        self.items.is_empty()
    }
}

/// Parses the tree of a `use` declaration that begins at the token `at`. Adds the path, name and line of each imported item to `all`.
/// Returns the index of the token after the tree.
fn tree(
    tokens: &[Token],
    mut at: usize,
    before: &[String],
    all: &mut Vec<(Vec<String>, String, usize)>,
) -> usize {
    let mut path = before.to_vec();
    let line = tokens[at].line;
    loop {
        match tokens[at].text.as_str() {
            "{" => {
                while tokens[at].text != "}" {
                    at += 1;
                    if tokens[at].text != "}" {
                        at = tree(tokens, at, &path, all);
                    }
                }
                return at + 1;
            }
            "as" => {
                all.push((path, tokens[at + 1].text.clone(), line));
                return at + 2;
            }
            "," | "}" | ";" => {
                let name = path[path.len() - 1].clone();
                all.push((path, name, line));
                return at;
            }
            "::" => {}
            "self" if !path.is_empty() => {}
            name => path.push(name.to_owned()),
        }
        at += 1;
    }
}

/// Removes the code that is only compiled for tests.
fn without_tests(tokens: Vec<Token>) -> Vec<Token> {
    let mut kept = Vec::new();
    let mut at = 0;
    fn is(at: usize, words: &[&str], tokens: &[Token]) -> bool {
        words
            .iter()
            .enumerate()
            .all(|(k, word)| tokens.get(at + k).is_some_and(|t| t.text == *word))
    }
    while at < tokens.len() {
        if is(at, &["#", "[", "cfg", "(", "test", ")", "]"], &tokens) {
            while is(at, &["#"], &tokens) {
                at = closing(&tokens, at + 1) + 1;
            }
            let is_use = (at..at + 6)
                .take_while(|&k| !is(k, &["{"], &tokens))
                .any(|k| is(k, &["use"], &tokens));
            while !is(at, &[";"], &tokens) && (is_use || !is(at, &["{"], &tokens)) {
                at += 1;
            }
            at = if is_use || is(at, &[";"], &tokens) { at } else { closing(&tokens, at) };
        } else {
            kept.push(at);
        }
        at += 1;
    }
    let mut kept = kept.into_iter().peekable();
    let numbered = tokens.into_iter().enumerate();
    numbered.filter(|(k, _)| kept.next_if_eq(k).is_some()).map(|(_, token)| token).collect()
}

/// Returns the index of the bracket that closes the bracket at the index `open`.
fn closing(tokens: &[Token], open: usize) -> usize {
    let mut depth = 0;
    for (k, token) in tokens.iter().enumerate().skip(open) {
        match token.text.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return k;
        }
    }
    panic!("line {}: a bracket is not closed", tokens[open].line)
}

fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Splits Rust code into identifiers and punctuation. Leaves out comments, strings, characters, lifetimes and numbers.
fn tokens(source: &str) -> Vec<Token> {
    let mut tokens = Vec::new();
    let chars: Vec<_> = source.chars().collect();
    fn starts(at: usize, text: &str, chars: &[char]) -> bool {
        text.chars().enumerate().all(|(k, c)| chars.get(at + k) == Some(&c))
    }
    let mut at = 0;
    let mut line = 1;
    while at < chars.len() {
        let start = at;
        let c = chars[at];
        if starts(at, "//", &chars) {
            while at < chars.len() && chars[at] != '\n' {
                at += 1;
            }
        } else if starts(at, "/*", &chars) {
            let mut depth = 0;
            loop {
                if starts(at, "/*", &chars) {
                    depth += 1;
                    at += 2;
                } else if starts(at, "*/", &chars) {
                    depth -= 1;
                    at += 2;
                } else {
                    at += 1;
                }
                if depth == 0 || at >= chars.len() {
                    break;
                }
            }
        } else if c == '"' {
            at += 1;
            while chars[at] != '"' {
                at += if chars[at] == '\\' { 2 } else { 1 };
            }
            at += 1;
        } else if c == '\'' {
            let is_char = chars[at + 1] == '\\' || chars.get(at + 2) == Some(&'\'');
            at += if is_char && chars[at + 1] == '\\' { 3 } else { 1 };
            while is_char && chars[at] != '\'' {
                at += 1;
            }
            while !is_char && (chars[at].is_alphanumeric() || chars[at] == '_') {
                at += 1;
            }
            at += usize::from(is_char);
        } else if c.is_alphanumeric() || c == '_' {
            while at < chars.len() && (chars[at].is_alphanumeric() || chars[at] == '_') {
                at += 1;
            }
            let text = String::from_iter(&chars[start..at]);
            let hashes = chars[at..].iter().take_while(|c| **c == '#').count();
            if ["r", "br"].contains(&&*text) && chars.get(at + hashes) == Some(&'"') {
                let end = format!("\"{}", "#".repeat(hashes));
                at += hashes + 1;
                while !starts(at, &end, &chars) {
                    at += 1;
                }
                at += end.len();
            } else if is_name(&text) {
                tokens.push(Token { text, line });
            }
        } else if starts(at, "::", &chars) {
            tokens.push(Token { text: "::".to_owned(), line });
            at += 2;
        } else {
            if !c.is_whitespace() {
                tokens.push(Token { text: c.to_string(), line });
            }
            at += 1;
        }
        line += chars[start..at].iter().filter(|c| **c == '\n').count();
    }
    tokens
}
