"""Tests of the two scripts: what counts and what does not, on small sources."""

import unittest

import figures
import messages


class Figures(unittest.TestCase):
    def counted(self, text):
        totals, found = figures.count(text)
        return totals, [(kind, line) for kind, _, line in found]

    def test_a_question_counts_once_for_each_block_of_comments(self):
        totals, found = self.counted("/// What it is.\n/// Whether it is.\nfn read() {}\n/// The number of faces.\nfn write() {}")
        self.assertEqual(totals["docs"], 2)
        self.assertEqual(found, [("questions", "/// What it is.")])

    def test_participles_and_function_words_count_as_names_outside_of_trait_implementations(self):
        text = "fn told() {}\nfn of() {}\nfn is_told() {}\nfn feed() {}\nimpl From<A> for B {\n    fn of() {}\n}\nfn kept() {}"
        totals, found = self.counted(text)
        self.assertEqual(totals["fns"], 5)
        self.assertEqual([line for _, line in found], ["fn told() {}", "fn of() {}", "fn kept() {}"])

    def test_a_type_must_be_a_noun(self):
        _, found = self.counted("struct Kept;\nenum Diagnostic {}\npub trait Gone {}")
        self.assertEqual(found, [("types", "struct Kept;"), ("types", "pub trait Gone {}")])

    def test_closures_are_those_that_let_binds(self):
        text = "let f = |x| x;\nlet g =\n    move |x| x;\nlet h = a | b;\nxs.map(|x| x);\nlet v =\n    a.map(|x| x);"
        _, found = self.counted(text)
        self.assertEqual(found, [("closures", "let f = |x| x;"), ("closures", "let g =")])

    def test_a_figure_above_its_bound_fails(self):
        totals, found = figures.count("/// What it is.\nfn read() {}")
        self.assertEqual(figures.figures(totals, found)["questions"], 100)


class Messages(unittest.TestCase):
    def test_texts_of_two_words_are_messages(self):
        text = 'let a = "cannot read {name}"; let b = "name"; // "no message here"\nlet c = r#"two "words" more"#; let d = \'"\'; let e = "the end";'
        self.assertEqual(messages.messages(text), ["cannot read {name}", 'two "words" more', "the end"])

    def test_tests_and_attributes_have_none(self):
        text = '#[serde(rename = "no message here")]\nstruct A;\n#[cfg(test)]\nmod tests {\n    fn a() { b("not this {one}"); }\n}\nconst B: &str = "but this";'
        self.assertEqual(messages.messages(text), ["but this"])

    def test_a_module_of_tests_may_be_visible_to_others(self):
        text = '#[cfg(test)]\npub(crate) mod tests {\n    fn a() { b("not this {one}"); }\n}\nconst B: &str = "but this\\0";'
        self.assertEqual(messages.messages(text), ["but this"])

    def test_a_continued_line_is_one_message(self):
        self.assertEqual(messages.messages('"a long \\\n    message"'), ["a long message"])


if __name__ == "__main__":
    unittest.main()
