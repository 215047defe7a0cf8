// The live page: keeps what the watch says, and shows it.

import { Graph } from "/graph.js";
import { Parameters } from "/parameters.js";
import { connect } from "/socket.js";
import { Viewer } from "/viewer.js";

const by = (id) => document.getElementById(id);

/** A new element with a text and attributes. */
function element(name, text = "", attributes = {}) {
  const made = document.createElement(name);
  made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

const viewer = new Viewer(by("viewer"), (views) => connection.send({ ask: "views", views }));
const graph = new Graph(by("graph"), (node) => showNode(node));

const parameters = new Parameters(by("parameters"), (name, value) => {
  by("refused").textContent = "";
  connection.send({ ask: "set", values: [[name, value]] });
});

/** What is known of nodes: by name what `done` and `finished` say. */
const nodes = new Map();

/** What one state says of a whole graph whose nodes have others: the first of these that one of them has. */
const STATES = ["failed", "started", "skipped", "computed", "equal", "cached"];

/** The node that is shown, if any: at first the one that the address names. */
let chosen = null;
let asked = viewer.address(location.hash);

const hear = {
  hello(message) {
    const file = message.graph.split(/[\\/]/).at(-1);
    document.title = `${file} - maquette`;
    by("title").textContent = file;
    by("title").title = `${message.graph}, ${message.program}`;
  },
  graph(message) {
    graph.draw(message);
    parameters.show(message.schema);
    for (const name of graph.boxes.keys()) graph.mark(name, known(name));
    const wanted = asked?.node ?? chosen;
    showNode(graph.box(wanted) ? wanted : graph.last(), asked?.output);
    asked = null;
  },
  run(message) {
    showRun("running ...", "running");
    viewer.at(message.run);
  },
  refused(message) {
    by("refused").textContent = message.why;
  },
  value(message) {
    viewer.hear(message);
  },
  started(message) {
    note(message.node, { state: "started" });
  },
  progress(message) {
    showRun(`running ${message.node}, ${Math.round(100 * message.share)} %`, "running");
  },
  finished(message) {
    note(message.node, message);
  },
  problems(message) {
    showProblems(message.problems, message.more_problems ?? 0);
  },
  done(message) {
    for (const node of message.nodes) note(node.name, node);
    const counts = ["computed", "cached", "failed", "skipped"];
    const said = counts.filter((state) => message[state]).map((state) => `${message[state]} ${state}`);
    viewer.at(message.run);
    const took = `${message.seconds.toFixed(2)} s`;
    showRun(message.ok ? `${said.join(", ")}; ${took}` : "errors: the outputs stay as they are", message.ok ? "good" : "failed");
  },
};

function note(name, node) {
  nodes.set(name, node);
  const box = graph.of(name);
  if (box === undefined) return;
  graph.mark(box, known(box));
  if (box === chosen) showFacts(box);
}

/** What is known of a box: of a graph that is used, of all nodes in it. */
function known(box) {
  const parts = [...nodes].filter(([name]) => name === box || name.startsWith(`${box}/`)).map(([, node]) => node);
  const state = STATES.find((state) => parts.some((part) => part.state === state));
  const timed = parts.filter((part) => part.seconds !== undefined);
  return { state, seconds: timed.length > 0 ? timed.reduce((sum, part) => sum + part.seconds, 0) : undefined };
}

function showRun(text, state) {
  by("run").textContent = text;
  by("run").dataset.state = state;
}

function showProblems(problems, more) {
  const items = problems.map((problem) => {
    const item = element("li", "", { "data-severity": problem.severity });
    item.append(element("b", `${problem.severity}: ${problem.message}`));
    item.append(element("span", `${problem.file}:${problem.line}:${problem.column}  ${problem.code}`, { class: "place" }));
    if (problem.help) item.append(element("span", problem.help, { class: "help" }));
    return item;
  });
  if (more > 0) items.push(element("li", `and ${more} more`));
  if (items.length === 0) items.push(element("li", "none"));
  by("problems").replaceChildren(...items);
}

/** Shows a node, and one of its outputs. */
function showNode(name, output) {
  chosen = name;
  graph.choose(name);
  showFacts(name);
  const box = graph.box(name);
  if (box) viewer.show(name, box.outputs, output);
}

function showFacts(name) {
  const box = graph.box(name);
  if (!box) {
    by("node").replaceChildren(element("p", "Choose a node in the graph."));
    return;
  }
  const { state, seconds } = known(name);
  const rows = [
    ["name", name],
    ["type", box.node ?? "a file"],
    ["state", box.node === null ? "" : state ?? "not needed yet"],
    ["time", seconds === undefined ? "" : `${(1000 * seconds).toFixed(1)} ms`],
    ["takes", box.inputs.map((port) => port.name).join(", ")],
    ["gives", box.outputs.map((port) => `${port.name}: ${port.type}`).join(", ")],
  ];
  const table = element("table");
  for (const [label, value] of rows.filter(([, value]) => value)) {
    const row = element("tr");
    row.append(element("th", label, { scope: "row" }), element("td", value));
    table.append(row);
  }
  by("node").replaceChildren(table);
}

document.addEventListener("keydown", (event) => {
  const isTyping = event.target instanceof HTMLInputElement && event.target.type !== "range";
  if (event.key === "z" && (event.ctrlKey || event.metaKey) && !isTyping) {
    event.preventDefault();
    connection.send({ ask: "undo" });
  }
  if (event.key === "?" && !isTyping && !by("help").open) by("help").showModal();
});

showNode(null);
const connection = connect(
  (message) => hear[message.event]?.(message),
  (state, text) => {
    by("link").textContent = text;
    by("link").dataset.state = state;
    if (state === "live") viewer.askAgain();
  },
);
