// The large view of one task, with buttons and keys that go to its neighbors.

import { pictureOf, pictureUrl, problemsOf, timeOf } from "./cards.js";
import { WORDS, facets, tasks, varied } from "./data.js";
import { element, elementById, formatBytes, onClick, plainText, shownValue } from "./element.js";
import { saveAddress, shown, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

export const one = elementById("one", HTMLDialogElement);

/** The pairs of keys (previous, next) for the facets of `axes`, and their labels. */
const KEYS = [
  ["ArrowLeft", "ArrowRight", "← →"],
  ["ArrowUp", "ArrowDown", "↑ ↓"],
  ["Shift+ArrowLeft", "Shift+ArrowRight", "⇧ ← →"],
  ["Shift+ArrowUp", "Shift+ArrowDown", "⇧ ↑ ↓"],
];

/** The facets that `KEYS` change: columns with left and right, rows with up and down, then the others, the last first. */
function axes() {
  const rest = varied.filter((facet) => facet !== state.rows && facet !== state.columns).reverse();
  const horizontal = state.columns ?? rest.shift();
  const vertical = state.rows ?? rest.shift();
  return [horizontal, vertical, ...rest];
}

/**
 * The neighbor of a task along a facet: the task with the nearest value in this direction and otherwise equal values. If there is no such
 * task, because the sweep varies several names together, the task with the fewest different values.
 * @param {Task} task
 * @param {Facet} facet
 * @param {number} way 1 or -1
 */
function neighbor(task, facet, way) {
  const far = (/** @type {Task} */ it) => way * ((facet.rank.get(facet.value(it)) ?? 0) - (facet.rank.get(facet.value(task)) ?? 0));
  const unlike = (/** @type {Task} */ it) => facets.filter((other, k) => k > 0 && other !== facet && other.value(it) !== other.value(task)).length;
  let [found, min] = [/** @type {Task | undefined} */ (undefined), Infinity];
  for (const it of shown) {
    if (far(it) <= 0) continue;
    const others = unlike(it);
    const cost = others === 0 ? far(it) : tasks.length * (far(it) * facets.length + others);
    if (cost < min) [found, min] = [it, cost];
  }
  return found;
}

/**
 * Creates a button that goes to a neighbor.
 * @param {Task} task
 * @param {Facet} facet
 * @param {number} way
 */
function stepButton(task, facet, way) {
  const next = neighbor(task, facet, way);
  const label = `${facet.name} ${next ? facet.value(next) : "has no further value"}`;
  const attributes = { type: "button", "data-step": `${facet.key} ${way}`, "aria-label": label, title: label, "aria-disabled": String(!next) };
  return onClick(element("button", attributes, way < 0 ? "‹" : "›"), () => showTask(next));
}

/** The states of nodes, in the order in which they are listed. */
const NODE_STATES = ["computed", "equal", "cached", "failed", "skipped"];

/** The number of nodes by state, as text; states without nodes are left out. */
function countNodes(/** @type {Task} */ task) {
  const counts = NODE_STATES.map((end) => [end, task.nodes?.[end] ?? 0]).filter(([, count]) => count);
  return counts.map(([end, count], k) => `${count} ${k ? "" : count === 1 ? "node " : "nodes "}${end}`).join(", ");
}

/** The values of a task, with buttons to its neighbors. */
function valuesTable(/** @type {Task} */ task) {
  const rows = facets.slice(1).map((facet) => {
    const keys = KEYS[axes().indexOf(facet)]?.[2] ?? "";
    const steps = facet.rank.size > 1 ? [element("kbd", {}, keys), stepButton(task, facet, -1), " ", stepButton(task, facet, 1)] : [];
    const heading = element("th", { scope: "row" }, plainText(facet.name));
    return element("tr", {}, heading, element("td", {}, shownValue(facet.value(task))), element("td", {}, ...steps));
  });
  return element("table", {}, ...rows);
}

/** @param {Task | undefined} task */
export function showTask(task) {
  if (!task) return;
  state.one = task;
  const held = document.activeElement?.getAttribute("data-step");
  elementById("one-title", HTMLElement).replaceChildren(plainText(task.name));
  const place = shown.indexOf(task);
  const word = element("span", { class: "word", "data-state": task.state }, WORDS[task.state]);
  elementById("one-place", HTMLElement).replaceChildren(word, place < 0 ? "" : `, ${place + 1} of ${shown.length}`);
  const hasPicture = pictureUrl(task) !== null;
  const picture = element("div", { class: "large" }, hasPicture || !task.problems.length ? pictureOf(task) : problemsOf(task));
  elementById("one-picture", HTMLElement).replaceChildren(picture);
  const about = [/** @type {HTMLElement} */ (valuesTable(task))];
  const section = (/** @type {string} */ name, /** @type {HTMLElement} */ inside) => element("section", {}, element("h3", {}, name), inside);
  const facts = [timeOf(task), countNodes(task)].filter(Boolean).join("; ");
  if (facts) about.push(section("Run", element("p", {}, facts)));
  if (task.files.length) {
    const links = task.files.map(({ name, path, bytes }) => {
      // The link is relative to this page and encoded, so that no file name leads elsewhere.
      const href = `./${path.split("/").map(encodeURIComponent).join("/")}`;
      return element("li", {}, element("a", { href }, plainText(name)), element("span", { class: "quiet" }, formatBytes(bytes)));
    });
    about.push(section("Files", element("ul", { class: "files" }, ...links)));
  }
  if (hasPicture && task.problems.length) about.push(section("Problems", problemsOf(task)));
  elementById("one-about", HTMLElement).replaceChildren(...about);
  if (!one.open) one.showModal();
  else if (held) [...one.querySelectorAll("button")].find((button) => button.dataset.step === held)?.focus();
  saveAddress();
}

/**
 * Goes to the neighbor that a key leads to; returns false if the key has no meaning.
 * @param {string} key
 */
export function followKey(key) {
  const task = state.one;
  const at = KEYS.findIndex(([back, on]) => key === back || key === on);
  const facet = axes()[at];
  const page = ["PageUp", "", "PageDown"].indexOf(key) - 1;
  if (task && facet) showTask(neighbor(task, facet, key === KEYS[at]?.[0] ? -1 : 1));
  else if (task && page >= -1) showTask(shown[shown.indexOf(task) + page]);
  else return false;
  return true;
}
