// The live page: receives the messages of `maquette watch` and updates the graph, the viewer and the side panels.

import { brokenItems } from "./broken.js";
import { element, elementById, find } from "./element.js";
import { Graph } from "./graph.js";
import { Parameters } from "./parameters.js";
import { Profile, formatBytes, formatSeconds } from "./profile.js";
import { connect, renew } from "./socket.js";
import { Viewer } from "./viewer.js";

const viewer = new Viewer(elementById("viewer"), (views) => connection.send({ ask: "views", views }), query);
const graph = new Graph(elementById("graph"), (node) => showNode(node), (node) => openEditor({ node }));
const profile = new Profile(find(document.body, "#profile", HTMLSelectElement), elementById("legend"), () => showProfile());

const parameters = new Parameters(elementById("parameters"), {
  set(name, value) {
    elementById("refused").textContent = "";
    connection.send({ ask: "set", values: [[name, value]] });
  },
  drag(name, value) {
    elementById("refused").textContent = "";
    connection.send({ ask: "drag", values: [[name, value]] });
  },
  drop: () => connection.send({ ask: "drop" }),
  want(kind, done) {
    elementById("refused").textContent = "";
    viewer.want(kind, done, (why) => {
      elementById("refused").textContent = why;
    });
  },
});

/**
 * Pending questions about the point under the pointer: the callback for each answer, by question number.
 * @type {Map<number, (answer: any) => void>}
 */
const questions = new Map();
let lastQuestion = 0;

/**
 * Asks what is under the pointer; resolves to null if there is no answer within 2 s.
 * @param {import("./types").Question} question
 */
function query(question) {
  const id = (lastQuestion += 1);
  connection.send({ ...question, id });
  return new Promise((done) => {
    questions.set(id, done);
    setTimeout(answer, 2000, id, null);
  });
}

/**
 * @param {number} id
 * @param {any} found
 */
function answer(id, found) {
  questions.get(id)?.(found);
  questions.delete(id);
}

/**
 * The state of each node by name, as the messages `finished` and `done` report it.
 * @type {Map<string, import("./types").NodeState>}
 */
const nodes = new Map();

/** True during a run. An evaluation of only the viewed outputs is not a run. */
let isRunning = false;

/**
 * The previous states of the nodes that are being evaluated now.
 * @type {Map<string, import("./types").NodeState>}
 */
const before = new Map();

/**
 * The names of the nodes in each box.
 * @type {Map<string, Set<string>>}
 */
const inside = new Map();

/** The states by priority: a box with several nodes shows the first state in this list that one of its nodes has. */
const STATES = ["failed", "started", "skipped", "computed", "equal", "cached"];

/**
 * The name of the selected node, if any.
 * @type {string | null}
 */
let chosen = null;

/** True if runs are draft runs. */
let isDraft = false;

/** The output that the page's address names at the start. */
let wanted = viewer.address(location.hash);

/**
 * The handler of each message.
 * @type {{[Event in import("./types").Message["event"]]?: (message: Extract<import("./types").Message, {event: Event}>) => void}}
 */
const handlers = {
  hello(message) {
    renew(message.page);
    const file = message.graph.split(/[\\/]/).at(-1) ?? "";
    document.title = `${file}${message.draft ? " (draft)" : ""} - maquette`;
    isDraft = message.draft ?? false;
    elementById("draft").hidden = !isDraft;
    elementById("title").textContent = file;
    elementById("title").title = `${message.graph}, ${message.program}`;
  },
  graph(message) {
    graph.draw(message);
    parameters.show(message.schema);
    inside.clear();
    for (const name of nodes.keys()) addToBox(graph.boxOf(name), name);
    for (const name of graph.boxes.keys()) graph.mark(name, boxState(name));
    const name = wanted?.node ?? chosen;
    showNode(graph.boxes.has(name ?? "") ? name : graph.last(), wanted?.output);
    wanted = null;
    showProfile();
  },
  run(message) {
    isRunning = true;
    showRun("running ...", "running");
    viewer.setRun(message.run);
  },
  refused(message) {
    elementById("refused").textContent = message.why;
  },
  value(message) {
    viewer.receive(message);
    if (viewer.main.shows(message)) askFacts();
  },
  probe(message) {
    answer(message.id, message);
  },
  pick(message) {
    answer(message.id, message);
  },
  started(message) {
    before.set(message.node, nodes.get(message.node) ?? {});
    note(message.node, { ...nodes.get(message.node), state: "started" });
  },
  cancelled() {
    isRunning = false;
    // Nodes that had started get their previous state back.
    for (const [name, node] of before) note(name, node);
    before.clear();
  },
  progress(message) {
    showRun(`running ${message.node}, ${Math.round(100 * message.share)} %`, "running");
  },
  stubborn(message) {
    showRun(message.why, "failed");
  },
  finished(message) {
    const old = before.get(message.node);
    before.delete(message.node);
    // Outside of a run, a node that is cached or equal keeps the state that the last run has given it.
    const isUnchanged = message.state === "cached" || message.state === "equal";
    if (isRunning || !isUnchanged || nodes.get(message.node)?.reason === undefined) note(message.node, message);
    else if (old !== undefined) note(message.node, old);
  },
  problems(message) {
    showProblems(message.problems, message.more_problems ?? 0);
  },
  done(message) {
    isRunning = false;
    for (const node of message.nodes) note(node.name, node);
    showProfile();
    const { failed, skipped, computed, cached } = message;
    const counts = Object.entries({ failed, skipped, computed, cached }).filter(([, count]) => count > 0);
    const parts = counts.map(([state, count]) => `${count} ${state}`);
    viewer.setRun(message.run);
    const took = `${parts.join(", ")}; ${message.seconds.toFixed(2)} s`;
    showRun(parts.length > 0 || message.ok ? took : "the graph has errors: the outputs are unchanged", message.ok ? "good" : "failed");
  },
};

/**
 * @param {string} name
 * @param {import("./types").NodeState} node
 */
function note(name, node) {
  // Keep the facts of the last run until this run reports new ones.
  nodes.set(name, { ...nodes.get(name), ...node });
  const box = graph.boxOf(name);
  if (box === undefined) return;
  addToBox(box, name);
  if (changed.size === 0) requestAnimationFrame(markChanged);
  changed.add(box);
}

/**
 * Boxes whose state has changed and is not displayed yet.
 * @type {Set<string>}
 */
const changed = new Set();

function markChanged() {
  for (const box of changed) graph.mark(box, boxState(box));
  if (chosen !== null && changed.has(chosen)) showFacts(chosen);
  changed.clear();
}

/**
 * @param {string | undefined} box
 * @param {string} name
 */
function addToBox(box, name) {
  if (box === undefined) return;
  const names = inside.get(box) ?? new Set();
  inside.set(box, names.add(name));
}

/**
 * The state of a box; for a box with a graph, the combined state of all nodes in it.
 * @param {string} box
 * @returns {import("./types").NodeState}
 */
function boxState(box) {
  const names = [...(inside.get(box) ?? [])];
  const parts = names.map((name) => nodes.get(name) ?? {});
  const state = STATES.find((state) => parts.some((part) => part.state === state));
  const which = parts.findIndex((part) => part.state === state);
  const words = parts[which]?.reason;
  const reason = words !== undefined && names[which] !== box ? `${names[which]}: ${words}` : words;
  return { state, reason, seconds: sum(parts.map((part) => part.seconds)), bytes: sum(parts.map((part) => part.bytes)) };
}

/**
 * The sum of the defined values; undefined if all are undefined.
 * @param {(number | undefined)[]} values
 */
function sum(values) {
  const known = values.filter((value) => value !== undefined);
  return known.length > 0 ? known.reduce((sum, value) => sum + value) : undefined;
}

/** Colors the boxes by the selected measure. */
function showProfile() {
  const boxes = [...graph.boxes.values()].filter((box) => box.node !== null);
  elementById("graph").dataset.profile = profile.select.value;
  graph.heat(profile.shares(boxes.map((box) => [box.name, boxState(box.name)])));
}

/**
 * Opens the user's editor at the position of a node or a problem.
 * @param {{node: string} | {problem: import("./types").Location}} wanted
 */
function openEditor(wanted) {
  elementById("refused").textContent = "";
  connection.send({ ask: "open", ...wanted });
}

/**
 * Creates a button that opens the user's editor at a position in a file.
 * @param {import("./types").Location} place
 * @param {string} text
 * @param {() => void} open
 */
function placeButton(place, text, open) {
  const button = element("button", { class: "place", type: "button", title: `Open ${place.file}:${place.line}:${place.column} in the editor` }, text);
  button.addEventListener("click", open);
  return button;
}

/**
 * @param {string} text
 * @param {string} state
 */
function showRun(text, state) {
  elementById("run").textContent = text;
  elementById("run").dataset.state = state;
}

/**
 * @param {import("./types").Problem[]} problems
 * @param {number} more the number of problems that are not in the list
 */
function showProblems(problems, more) {
  const items = problems.map((problem) => {
    const item = element("li", { "data-severity": problem.severity });
    item.append(element("b", {}, `${problem.severity}: ${problem.message}`));
    const { file, line, column, code } = problem;
    item.append(placeButton(problem, `${file}:${line}:${column}  ${code}`, () => openEditor({ problem: { file, line, column } })));
    if (problem.note) {
      const { file, line, column, message } = problem.note;
      const words = `${file}:${line}:${column}  ${message}`;
      item.append(placeButton(problem.note, words, () => openEditor({ problem: { file, line, column } })));
    }
    if (problem.help) item.append(element("span", { class: "help" }, problem.help));
    return item;
  });
  if (more > 0) items.push(element("li", {}, `and ${more} more`));
  if (items.length === 0) items.push(element("li", {}, "none"));
  elementById("problems").replaceChildren(...items);
}

/**
 * Shows a node, and one of its outputs.
 * @param {string | null} name
 * @param {string} [output]
 */
function showNode(name, output) {
  chosen = name;
  graph.choose(name);
  showFacts(name);
  const box = graph.boxes.get(name ?? "");
  // A file has no outputs: the viewed value stays.
  if (!box || box.node === null) return;
  viewer.show(box.name, box.outputs, output);
  askFacts();
}

/** @param {string | null} name */
function showFacts(name) {
  const box = graph.boxes.get(name ?? "");
  if (!box) {
    elementById("node").replaceChildren(element("p", {}, "Choose a node in the graph."));
    return;
  }
  const { state, reason, seconds, bytes } = boxState(box.name);
  const drafts = box.drafts ?? [];
  const mark = (/** @type {string} */ words) => element("span", { class: "draft" }, words);
  /** @type {[string, any][]} */
  const rows = [
    ["name", box.name],
    ["type", box.node ?? "a file"],
    ["state", box.node === null ? "" : state ?? "not needed yet"],
    ["why", reason ?? ""],
    ["time", seconds === undefined ? "" : formatSeconds(seconds)],
    ["bytes", bytes === undefined ? "" : formatBytes(bytes)],
    ["takes", box.inputs.map((port) => port.name).join(", ")],
    ["gives", box.outputs.map((port) => `${port.name}: ${port.type}`).join(", ")],
    ...drafts.map(
      ({ field, final, draft }) => /** @type {[string, any]} */ ([field, mark(`final ${final}, draft ${draft}`)]),
    ),
    ["shown", isDraft ? mark("a draft, not the final result") : ""],
  ];
  const table = tableOf(rows.filter(([, value]) => value));
  const hadFocus = elementById("node").contains(document.activeElement);
  elementById("node").replaceChildren(table);
  const { file, line, column } = box;
  if (file === undefined || line === undefined || column === undefined) return;
  const text = `${file.split(/[\\/]/).at(-1)}:${line}`;
  const button = placeButton({ file, line, column }, text, () => openEditor({ node: box.name }));
  elementById("node").append(button);
  if (hadFocus) button.focus();
}

/** @param {[string, any][]} rows labels and facts */
function tableOf(rows) {
  const table = element("table");
  for (const [label, fact] of rows) {
    const row = element("tr");
    const cell = element("td");
    cell.append(...factNodes(fact));
    row.append(element("th", { scope: "row" }, label), cell);
    table.append(row);
  }
  return table;
}

/**
 * A fact as nodes of the page: numbers with six digits, histograms as bars.
 * @param {any} fact
 * @returns {(string | HTMLElement)[]}
 */
function factNodes(fact) {
  if (fact instanceof HTMLElement) return [fact];
  if (typeof fact === "number") return [String(Number(fact.toPrecision(6)))];
  if (Array.isArray(fact)) return [fact.flatMap(factNodes).join(", ")];
  if (!Array.isArray(fact?.counts)) return [typeof fact === "string" ? fact : JSON.stringify(fact)];
  const { from, to, counts } = fact;
  const bars = element("canvas", { class: "counts", width: 8 * counts.length, height: 40, role: "img", "aria-label": `counts from ${from} to ${to}` });
  const pen = bars.getContext("2d");
  if (pen) pen.fillStyle = getComputedStyle(document.body).getPropertyValue("--quiet");
  const max = Math.max(1, ...counts);
  counts.forEach((/** @type {number} */ count, /** @type {number} */ k) => pen?.fillRect(8 * k, 40 - (40 * count) / max, 7, (40 * count) / max));
  return [bars, `${factNodes(from)} to ${factNodes(to)}`];
}

/** The facts of a value are requested when the value has not changed for this time, in milliseconds. */
const FACTS_DELAY = 300;

let factsTimer = 0;

/** Shows the facts of the viewed value once it has stopped changing: the server may take long to compute them. */
function askFacts() {
  clearTimeout(factsTimer);
  const value = viewer.main.value;
  elementById("broken").replaceChildren(...brokenItems(value?.broken ?? [], (position) => viewer.aim(position)));
  if (value === null) {
    elementById("facts").replaceChildren(element("p", {}, "not computed yet"));
    return;
  }
  factsTimer = setTimeout(async () => {
    /** @type {[string, any][]} */
    const rows = await fetch(`/facts/${value.hash}`).then((answer) => (answer.ok ? answer.json() : []), () => []);
    if (viewer.main.value?.hash !== value.hash) return;
    elementById("facts").replaceChildren(tableOf([["type", value.type], ...rows.filter(([, fact]) => fact !== "")]));
  }, FACTS_DELAY);
}

document.addEventListener("keydown", (event) => {
  const isTyping = event.target instanceof HTMLInputElement && event.target.type !== "range";
  if (event.key === "z" && (event.ctrlKey || event.metaKey) && !isTyping) {
    event.preventDefault();
    connection.send({ ask: "undo" });
  }
  if (event.key === "Escape") viewer.stopWanting();
  const help = find(document.body, "#help", HTMLDialogElement);
  if (event.key === "?" && !isTyping && !help.open) help.showModal();
});

showNode(null);
const connection = connect(
  (message) => /** @type {((message: any) => void) | undefined} */ (handlers[message.event])?.(message),
  (state, text) => {
    elementById("link").textContent = text;
    elementById("link").dataset.state = state;
    if (state === "live") viewer.askAgain();
  },
);
