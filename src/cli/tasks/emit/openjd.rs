//! Writes a batch as a job template for Open Job Description.

use serde_json::{Value as Json, json};

use super::Handover;

impl Handover<'_> {
    /// Returns the job template as JSON. The project folder is a parameter of the job, because each session of Open Job Description runs
    /// its tasks in a folder of its own.
    pub(super) fn openjd(&self) -> String {
        let (jobs, chunk) = self.jobs();
        let on_run = |last: &[&str]| {
            let mut run = self.action("cd \"$0\" && exec \"$@\"", last);
            if let Some(limit) = self.resources.job_limit() {
                run["timeout"] = limit.as_secs().into();
            }
            json!({ "actions": { "onRun": run } })
        };
        let mut task = vec!["--events=openjd"];
        task.extend(chunk.split_whitespace());
        task.extend(["--task", "{{Task.Param.Task}}"]);
        // Write the page in the exit action of an environment. An exit action always runs, but a step does not run if one of the tasks
        // before it has failed.
        let page = self.action("cd \"$0\" && \"$@\" || true", &["--report"]);
        let page = json!({ "name": "Page", "script": { "actions": { "onExit": page } } });
        let range = format!("0-{}", jobs.saturating_sub(1));
        let tasks = json!({ "name": "Task", "type": "INT", "range": range });
        let project = json!({
            "name": "Project",
            "type": "PATH",
            "objectType": "DIRECTORY",
            "dataFlow": "INOUT",
            "default": ".",
            "description": "The folder that the paths of the sweep and its results are relative to.",
        });
        let own = self.parameters.iter().map(|parameter| parameter.definition.clone());
        let definitions = Vec::from_iter([project].into_iter().chain(own));
        let mut steps = [
            json!({ "name": "Warm", "script": on_run(&["--warm", "--events=openjd"]) }),
            json!({
                "name": "Tasks",
                "dependencies": [{ "dependsOn": "Warm" }],
                "parameterSpace": { "taskParameterDefinitions": [tasks] },
                "stepEnvironments": [page],
                "script": on_run(&task),
            }),
            json!({ "name": "Sheet", "dependencies": [{ "dependsOn": "Tasks" }], "script": on_run(&["--report"]) }),
        ];
        let amounts = Vec::from_iter(self.resource_amounts());
        if !amounts.is_empty() {
            for step in &mut steps[..2] {
                step["hostRequirements"] = json!({ "amounts": amounts });
            }
        }
        let job = json!({
            "specificationVersion": "jobtemplate-2023-09",
            "name": job_name(self.name),
            "parameterDefinitions": definitions,
            "steps": steps,
        });
        format!("{job:#}\n")
    }

    /// Returns an action that runs the command in the project folder, with the additional arguments `last`. `inside` is the shell code that
    /// runs the command.
    fn action(&self, inside: &str, last: &[&str]) -> Json {
        let (decode, words) = encode_words(self.words);
        let start = ["-c".to_owned(), decode + inside, "{{Param.Project}}".to_owned()];
        let assignments = self.parameters.iter().map(|it| it.assignment.clone());
        let set = assignments.flat_map(|assignment| ["--set".to_owned(), assignment]);
        let last = last.iter().map(|&word| word.to_owned());
        let args: Vec<_> = start.into_iter().chain(words).chain(set).chain(last).collect();
        json!({ "command": "bash", "args": args })
    }

    /// Returns the resources that a machine needs to run a task.
    fn resource_amounts(&self) -> impl Iterator<Item = Json> {
        let threads = self.resources.threads.map(|threads| ("vcpu", threads as u64));
        let memory = self.resources.mebibytes().map(|memory| ("memory", memory));
        threads.into_iter().chain(memory).map(|(name, min): (&str, u64)| json!({ "name": format!("amount.worker.{name}"), "min": min }))
    }
}

/// Encodes arguments for a template. Returns the shell code that decodes them, and the encoded arguments. Templates do not allow control
/// characters, and `{{` would begin a parameter.
fn encode_words(words: &[String]) -> (String, Vec<String>) {
    if words.iter().all(|word| !word.contains(['{', '}']) && !word.contains(char::is_control)) {
        return (String::new(), words.to_vec());
    }
    let encoded = words.iter().map(|word| {
        word.chars()
            .map(|c: char| match c {
                '\\' => "\\\\".to_owned(),
                '{' | '}' => format!("\\x{:02x}", u32::from(c)),
                // Encode bytes instead of characters, because the meaning of a character code in a shell depends on its locale.
                c if c.is_control() => {
                    c.to_string().bytes().map(|byte| format!("\\x{byte:02x}")).collect()
                }
                c => c.to_string(),
            })
            .collect()
    });
    let decode = format!(
        "own=(); for word in \"${{@:1:{0}}}\"; do printf -v word %b \"$word\"; own+=(\"$word\"); done; shift {0}; set -- \"${{own[@]}}\" \"$@\"; ",
        words.len()
    );
    (decode, encoded.collect())
}

/// Returns a valid job name: at most 128 characters, without control characters, and without `{{`, which would begin a parameter.
fn job_name(name: &str) -> String {
    let name = name.replace("{{", "{ {").replace("}}", "} }");
    let name = name.chars().map(|c| if c.is_control() { '-' } else { c }).take(128);
    let name = String::from_iter(name);
    if name.trim().is_empty() { "batch".into() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_becomes_a_valid_job_name() {
        assert_eq!(job_name("a{{{b}}\n"), "a{ {{b} }-");
        assert_eq!(job_name(""), "batch");
        assert_eq!(job_name(&"\u{e4}".repeat(300)).chars().count(), 128);
    }

    #[test]
    fn arguments_that_a_template_cannot_contain_are_encoded() {
        fn words(words: &[&str]) -> Vec<String> {
            words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>()
        }
        let plain = words(&["it's", "a\\b", "\u{e4}"]);
        assert_eq!(encode_words(&plain), (String::new(), plain.clone()));
        let (decode, found) = encode_words(&words(&["a\\b", "{{x}}\t\n"]));
        assert!(decode.contains("${@:1:2}"), "{decode}");
        assert_eq!(found, words(&["a\\\\b", "\\x7b\\x7bx\\x7d\\x7d\\x09\\x0a"]));
    }
}
