// The live page: keeps what the watch says, and shows it.

import { listOf } from "./broken.js";
import { by, element, find } from "./element.js";
import { Graph } from "./graph.js";
import { Parameters } from "./parameters.js";
import { Profile, inBytes, inTime } from "./profile.js";
import { connect, renew } from "./socket.js";
import { Viewer } from "./viewer.js";

const viewer = new Viewer(by("viewer"), (views) => connection.send({ ask: "views", views }), query);
const graph = new Graph(by("graph"), (node) => showNode(node), (node) => openEditor({ node }));
const profile = new Profile(find(document.body, "#profile", HTMLSelectElement), by("legend"), () => showProfile());

const parameters = new Parameters(by("parameters"), {
  set(name, value) {
    by("refused").textContent = "";
    connection.send({ ask: "set", values: [[name, value]] });
  },
  drag(name, value) {
    by("refused").textContent = "";
    connection.send({ ask: "drag", values: [[name, value]] });
  },
  drop: () => connection.send({ ask: "drop" }),
  want(kind, done) {
    by("refused").textContent = "";
    viewer.want(kind, done, (why) => {
      by("refused").textContent = why;
    });
  },
});

/**
 * What was asked about places and is not answered yet, by number.
 * @type {Map<number, (answer: any) => void>}
 */
const questions = new Map();
let asked = 0;

/**
 * Asks what is at a place; nothing if nobody answers.
 * @param {import("./types").Question} question
 */
function query(question) {
  const id = (asked += 1);
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
 * What is known of nodes: by name what `done` and `finished` say.
 * @type {Map<string, import("./types").NodeState>}
 */
const nodes = new Map();

/** Whether a run is under way, and not only something looked at. */
let isRunning = false;

/**
 * The same of nodes under way, from before they began.
 * @type {Map<string, import("./types").NodeState>}
 */
const before = new Map();

/**
 * The names of the nodes in each box.
 * @type {Map<string, Set<string>>}
 */
const inside = new Map();

/** What one state says of a whole graph whose nodes have others: the first of these that one of them has. */
const STATES = ["failed", "started", "skipped", "computed", "equal", "cached"];

/**
 * The node that is shown, if any.
 * @type {string | null}
 */
let chosen = null;

/** Whether runs are drafts. */
let isDraft = false;

/** What the address names at first. */
let wanted = viewer.address(location.hash);

/**
 * What is done with each message.
 * @type {{[Event in import("./types").Message["event"]]?: (message: Extract<import("./types").Message, {event: Event}>) => void}}
 */
const hear = {
  hello(message) {
    renew(message.page);
    const file = message.graph.split(/[\\/]/).at(-1) ?? "";
    document.title = `${file}${message.draft ? " (draft)" : ""} - maquette`;
    isDraft = message.draft ?? false;
    by("draft").hidden = !isDraft;
    by("title").textContent = file;
    by("title").title = `${message.graph}, ${message.program}`;
  },
  graph(message) {
    graph.draw(message);
    parameters.show(message.schema);
    inside.clear();
    for (const name of nodes.keys()) putIn(graph.of(name), name);
    for (const name of graph.boxes.keys()) graph.mark(name, known(name));
    const name = wanted?.node ?? chosen;
    showNode(graph.boxes.has(name ?? "") ? name : graph.last(), wanted?.output);
    wanted = null;
    showProfile();
  },
  run(message) {
    isRunning = true;
    showRun("running ...", "running");
    viewer.at(message.run);
  },
  refused(message) {
    by("refused").textContent = message.why;
  },
  value(message) {
    viewer.hear(message);
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
    // What was begun is as it was.
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
    // Who only looks runs nothing: what was found as it was is still what the last run has made of it.
    const isAsItWas = message.state === "cached" || message.state === "equal";
    if (isRunning || !isAsItWas || nodes.get(message.node)?.reason === undefined) note(message.node, message);
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
    const said = counts.map(([state, count]) => `${count} ${state}`);
    viewer.at(message.run);
    const took = `${said.join(", ")}; ${message.seconds.toFixed(2)} s`;
    showRun(said.length > 0 || message.ok ? took : "the graph has errors: the outputs stay as they are", message.ok ? "good" : "failed");
  },
};

/**
 * @param {string} name
 * @param {import("./types").NodeState} node
 */
function note(name, node) {
  // What a run has not found out yet is what it was in the last one.
  nodes.set(name, { ...nodes.get(name), ...node });
  const box = graph.of(name);
  if (box === undefined) return;
  putIn(box, name);
  if (changed.size === 0) requestAnimationFrame(markChanged);
  changed.add(box);
}

/**
 * Boxes of which something is known that is not shown yet.
 * @type {Set<string>}
 */
const changed = new Set();

function markChanged() {
  for (const box of changed) graph.mark(box, known(box));
  if (chosen !== null && changed.has(chosen)) showFacts(chosen);
  changed.clear();
}

/**
 * @param {string | undefined} box
 * @param {string} name
 */
function putIn(box, name) {
  if (box === undefined) return;
  const names = inside.get(box) ?? new Set();
  inside.set(box, names.add(name));
}

/**
 * What is known of a box: of a graph that is used, of all nodes in it.
 * @param {string} box
 * @returns {import("./types").NodeState}
 */
function known(box) {
  const names = [...(inside.get(box) ?? [])];
  const parts = names.map((name) => nodes.get(name) ?? {});
  const state = STATES.find((state) => parts.some((part) => part.state === state));
  const which = parts.findIndex((part) => part.state === state);
  const words = parts[which]?.reason;
  const reason = words !== undefined && names[which] !== box ? `${names[which]}: ${words}` : words;
  return { state, reason, seconds: sum(parts.map((part) => part.seconds)), bytes: sum(parts.map((part) => part.bytes)) };
}

/**
 * The sum of what is known; nothing if nothing is.
 * @param {(number | undefined)[]} values
 */
function sum(values) {
  const known = values.filter((value) => value !== undefined);
  return known.length > 0 ? known.reduce((sum, value) => sum + value) : undefined;
}

/** Colors boxes by what is measured of them. */
function showProfile() {
  const boxes = [...graph.boxes.values()].filter((box) => box.node !== null);
  by("graph").dataset.profile = profile.select.value;
  graph.heat(profile.shares(boxes.map((box) => [box.name, known(box.name)])));
}

/**
 * Opens the user's editor where a node or a problem stands.
 * @param {{node: string} | {problem: import("./types").Location}} wanted
 */
function openEditor(wanted) {
  by("refused").textContent = "";
  connection.send({ ask: "open", ...wanted });
}

/**
 * A button that opens the user's editor at a place.
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
  by("run").textContent = text;
  by("run").dataset.state = state;
}

/**
 * @param {import("./types").Problem[]} problems
 * @param {number} more how many more there are
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
  by("problems").replaceChildren(...items);
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
  // A file is no value of its own: what is seen stays.
  if (!box || box.node === null) return;
  viewer.show(box.name, box.outputs, output);
  askFacts();
}

/** @param {string | null} name */
function showFacts(name) {
  const box = graph.boxes.get(name ?? "");
  if (!box) {
    by("node").replaceChildren(element("p", {}, "Choose a node in the graph."));
    return;
  }
  const { state, reason, seconds, bytes } = known(box.name);
  const drafts = box.drafts ?? [];
  const mark = (/** @type {string} */ words) => element("span", { class: "draft" }, words);
  /** @type {[string, any][]} */
  const rows = [
    ["name", box.name],
    ["type", box.node ?? "a file"],
    ["state", box.node === null ? "" : state ?? "not needed yet"],
    ["why", reason ?? ""],
    ["time", seconds === undefined ? "" : inTime(seconds)],
    ["bytes", bytes === undefined ? "" : inBytes(bytes)],
    ["takes", box.inputs.map((port) => port.name).join(", ")],
    ["gives", box.outputs.map((port) => `${port.name}: ${port.type}`).join(", ")],
    ...drafts.map(
      ({ field, final, draft }) => /** @type {[string, any]} */ ([field, mark(`final ${final}, draft ${draft}`)]),
    ),
    ["shown", isDraft ? mark("what drafts give, no final results") : ""],
  ];
  const table = tableOf(rows.filter(([, value]) => value));
  const hadFocus = by("node").contains(document.activeElement);
  by("node").replaceChildren(table);
  const { file, line, column } = box;
  if (file === undefined || line === undefined || column === undefined) return;
  const text = `${file.split(/[\\/]/).at(-1)}:${line}`;
  const button = placeButton({ file, line, column }, text, () => openEditor({ node: box.name }));
  by("node").append(button);
  if (hadFocus) button.focus();
}

/** @param {[string, any][]} rows labels and what is said of them */
function tableOf(rows) {
  const table = element("table");
  for (const [label, fact] of rows) {
    const row = element("tr");
    const cell = element("td");
    cell.append(...inPage(fact));
    row.append(element("th", { scope: "row" }, label), cell);
    table.append(row);
  }
  return table;
}

/**
 * A fact as it is read: numbers with six digits, counts as bars over what they count.
 * @param {any} fact
 * @returns {(string | HTMLElement)[]}
 */
function inPage(fact) {
  if (fact instanceof HTMLElement) return [fact];
  if (typeof fact === "number") return [String(Number(fact.toPrecision(6)))];
  if (Array.isArray(fact)) return [fact.flatMap(inPage).join(", ")];
  if (!Array.isArray(fact?.counts)) return [typeof fact === "string" ? fact : JSON.stringify(fact)];
  const { from, to, counts } = fact;
  const bars = element("canvas", { class: "counts", width: 8 * counts.length, height: 40, role: "img", "aria-label": `counts from ${from} to ${to}` });
  const pen = bars.getContext("2d");
  if (pen) pen.fillStyle = getComputedStyle(document.body).getPropertyValue("--quiet");
  const most = Math.max(1, ...counts);
  counts.forEach((/** @type {number} */ count, /** @type {number} */ k) => pen?.fillRect(8 * k, 40 - (40 * count) / most, 7, (40 * count) / most));
  return [bars, `${inPage(from)} to ${inPage(to)}`];
}

/** How long a value must stay before it is asked what is to be known of it, in milliseconds. */
const CALM = 300;

let calm = 0;

/** Shows what is to be known of the value, once it does not change any more: to find that out may take time. */
function askFacts() {
  clearTimeout(calm);
  const value = viewer.main.value;
  by("broken").replaceChildren(...listOf(value?.broken ?? [], (place) => viewer.aim(place)));
  if (value === null) {
    by("facts").replaceChildren(element("p", {}, "not there yet"));
    return;
  }
  calm = setTimeout(async () => {
    /** @type {[string, any][]} */
    const rows = await fetch(`/facts/${value.hash}`).then((answer) => (answer.ok ? answer.json() : []), () => []);
    if (viewer.main.value?.hash !== value.hash) return;
    by("facts").replaceChildren(tableOf([["type", value.type], ...rows.filter(([, fact]) => fact !== "")]));
  }, CALM);
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
  (message) => /** @type {((message: any) => void) | undefined} */ (hear[message.event])?.(message),
  (state, text) => {
    by("link").textContent = text;
    by("link").dataset.state = state;
    if (state === "live") viewer.askAgain();
  },
);
