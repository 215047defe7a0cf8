// One task, large, and the way to its neighbors.

import { pictureOf, pictured, problemsOf, took } from "./cards.js";
import { WORDS, facets, tasks, varied } from "./data.js";
import { element, inBytes, onClick, plain, shownValue, the } from "./element.js";
import { remember, shown, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

export const one = the("one", HTMLDialogElement);

/** The values of a large task that the keys go along, and their keys. */
const KEYS = [
  ["ArrowLeft", "ArrowRight", "← →"],
  ["ArrowUp", "ArrowDown", "↑ ↓"],
  ["Shift+ArrowLeft", "Shift+ArrowRight", "⇧ ← →"],
  ["Shift+ArrowUp", "Shift+ArrowDown", "⇧ ↑ ↓"],
];

/** The names that keys go along: columns to the side, rows up and down, then the others, the last first. */
function along() {
  const rest = varied.filter((facet) => facet !== state.rows && facet !== state.columns).reverse();
  const side = state.columns ?? rest.shift();
  const upright = state.rows ?? rest.shift();
  return [side, upright, ...rest];
}

/**
 * The neighbor of a task in the direction of a name: of the next value that has one, a task that else has the same values; if there
 * is none anywhere, as where names go hand in hand, the one that is most alike.
 * @param {Task} task
 * @param {Facet} facet
 * @param {number} way 1 or -1
 */
function neighbor(task, facet, way) {
  const far = (/** @type {Task} */ it) => way * ((facet.rank.get(facet.of(it)) ?? 0) - (facet.rank.get(facet.of(task)) ?? 0));
  const unlike = (/** @type {Task} */ it) => facets.filter((other, k) => k > 0 && other !== facet && other.of(it) !== other.of(task)).length;
  let [found, least] = [/** @type {Task | undefined} */ (undefined), Infinity];
  for (const it of shown) {
    if (far(it) <= 0) continue;
    const others = unlike(it);
    const worth = others === 0 ? far(it) : tasks.length * (far(it) * facets.length + others);
    if (worth < least) [found, least] = [it, worth];
  }
  return found;
}

/**
 * A button that goes to a neighbor.
 * @param {Task} task
 * @param {Facet} facet
 * @param {number} way
 */
function stepButton(task, facet, way) {
  const next = neighbor(task, facet, way);
  const label = `${facet.name} ${next ? facet.of(next) : "has no other value there"}`;
  const attributes = { type: "button", "data-step": `${facet.key} ${way}`, "aria-label": label, title: label, "aria-disabled": String(!next) };
  return onClick(element("button", attributes, way < 0 ? "‹" : "›"), () => look(next));
}

/** How nodes end, in the order in which that is told. */
const ENDS = ["computed", "equal", "cached", "failed", "skipped"];

/** How many nodes came to which end, in words; nothing of those that none came to. */
function nodesOf(/** @type {Task} */ task) {
  const counts = ENDS.map((end) => [end, task.nodes?.[end] ?? 0]).filter(([, count]) => count);
  return counts.map(([end, count], k) => `${count} ${k ? "" : count === 1 ? "node " : "nodes "}${end}`).join(", ");
}

/** The values of a task, and the ways to those that have others. */
function valuesTable(/** @type {Task} */ task) {
  const rows = facets.slice(1).map((facet) => {
    const keys = KEYS[along().indexOf(facet)]?.[2] ?? "";
    const steps = facet.rank.size > 1 ? [element("kbd", {}, keys), stepButton(task, facet, -1), " ", stepButton(task, facet, 1)] : [];
    const heading = element("th", { scope: "row" }, plain(facet.name));
    return element("tr", {}, heading, element("td", {}, shownValue(facet.of(task))), element("td", {}, ...steps));
  });
  return element("table", {}, ...rows);
}

/** @param {Task | undefined} task */
export function look(task) {
  if (!task) return;
  state.one = task;
  const held = document.activeElement?.getAttribute("data-step");
  the("one-title", HTMLElement).replaceChildren(plain(task.name));
  const place = shown.indexOf(task);
  const word = element("span", { class: "word", "data-state": task.state }, WORDS[task.state]);
  the("one-place", HTMLElement).replaceChildren(word, place < 0 ? "" : `, ${place + 1} of ${shown.length}`);
  const hasPicture = pictured(task) !== null;
  const picture = element("div", { class: "large" }, hasPicture || !task.problems.length ? pictureOf(task) : problemsOf(task));
  the("one-picture", HTMLElement).replaceChildren(picture);
  const about = [/** @type {HTMLElement} */ (valuesTable(task))];
  const section = (/** @type {string} */ name, /** @type {HTMLElement} */ inside) => element("section", {}, element("h3", {}, name), inside);
  const facts = [took(task), nodesOf(task)].filter(Boolean).join("; ");
  if (facts) about.push(section("Run", element("p", {}, facts)));
  if (task.files.length) {
    const links = task.files.map(({ name, path, bytes }) => {
      // The file is beside this page; no name makes it another address.
      const href = `./${path.split("/").map(encodeURIComponent).join("/")}`;
      return element("li", {}, element("a", { href }, plain(name)), element("span", { class: "quiet" }, inBytes(bytes)));
    });
    about.push(section("Files", element("ul", { class: "files" }, ...links)));
  }
  if (hasPicture && task.problems.length) about.push(section("Problems", problemsOf(task)));
  the("one-about", HTMLElement).replaceChildren(...about);
  if (!one.open) one.showModal();
  else if (held) [...one.querySelectorAll("button")].find((button) => button.dataset.step === held)?.focus();
  remember();
}

/**
 * Goes where a key leads from the task that is shown; false if it leads nowhere.
 * @param {string} key
 */
export function goAlong(key) {
  const task = state.one;
  const at = KEYS.findIndex(([back, on]) => key === back || key === on);
  const facet = along()[at];
  const page = ["PageUp", "", "PageDown"].indexOf(key) - 1;
  if (task && facet) look(neighbor(task, facet, key === KEYS[at]?.[0] ? -1 : 1));
  else if (task && page >= -1) look(shown[shown.indexOf(task) + page]);
  else return false;
  return true;
}
