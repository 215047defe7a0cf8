//! Converts Markdown to plain text for a terminal.

/// Removes the Markdown markup of a page, and wraps its lines to `width` characters. Code samples are indented and not wrapped.
pub fn plain(markdown: &str, width: usize) -> String {
    let mut page = Page { text: String::new(), open: String::new(), width };
    let mut is_sample = false;
    for line in markdown.lines() {
        if line.starts_with("```") {
            page.close();
            is_sample = !is_sample;
        } else if is_sample {
            page.line(&format!("    {line}"));
        } else if line.starts_with('#') {
            let title = line.trim_start_matches('#').trim();
            let rule = if line.starts_with("# ") { "=" } else { "-" };
            page.line(title);
            page.line(&rule.repeat(title.chars().count()));
        } else if line.is_empty() || line.starts_with('|') {
            page.line(line);
        } else {
            if line.starts_with("- ") {
                page.close();
            }
            let gap = if page.open.is_empty() { "" } else { " " };
            page.open += &format!("{gap}{}", line.trim());
        }
    }
    page.close();
    page.text
}

struct Page {
    text: String,
    /// The text of the current paragraph, without line breaks.
    open: String,
    width: usize,
}

impl Page {
    fn line(&mut self, line: &str) {
        self.close();
        self.text += line.trim_end();
        self.text.push('\n');
    }

    /// Wraps and ends the current paragraph.
    fn close(&mut self) {
        let paragraph = std::mem::take(&mut self.open);
        let indent = if paragraph.starts_with("- ") { "  " } else { "" };
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            let is_full = line.chars().count() + 1 + word.chars().count() > self.width;
            if is_full && !line.trim().is_empty() {
                self.text += &format!("{line}\n");
                line = format!("{indent}{word}");
            } else {
                let gap = if line.is_empty() { "" } else { " " };
                line += &format!("{gap}{word}");
            }
        }
        if !line.is_empty() {
            self.text += &format!("{line}\n");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paragraphs_are_filled_and_samples_keep_their_lines() {
        let page = "# A title\n\nSome words\nof `it`.\n- one, which\nis long\n- two\n\n## More\n\n```ron\nGraph(\n  x\n)\n```\n";
        let expected = "A title\n=======\n\nSome words\nof `it`.\n- one, which\n  is long\n- two\n\nMore\n----\n\n    Graph(\n      x\n    )\n";
        assert_eq!(plain(page, 12), expected);
        assert_eq!(plain("a word_that_is_long b", 4), "a\nword_that_is_long\nb\n");
    }
}
