// Where the cards are: in a grid, or in a table of two names; and where the keyboard is among them.

import { cardOf, cards, near } from "./cards.js";
import { tasks } from "./data.js";
import { element, plain, shownValue, the } from "./element.js";
import { shown, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** So many cards are made at once, about what is seen, and so many after each frame: nobody waits for those below. */
const [FIRST, NEXT] = [48, 200];

export const sheet = the("sheet", HTMLElement);

/** The cards that are still to come, and where they go. */
let rest = /** @type {[HTMLElement, Task][]} */ ([]);
let isGrowing = false;

/** @param {number} count */
function grow(count) {
  for (const [place, task] of rest.splice(0, count)) place.append(cardOf(task));
  setCurrent(current);
  if (!rest.length || isGrowing) return;
  isGrowing = true;
  const next = () => {
    isGrowing = false;
    grow(NEXT);
  };
  // After what is there has been painted.
  requestAnimationFrame(() => setTimeout(next));
}

/** Makes all cards now. */
export const finish = () => grow(Infinity);

function grid() {
  const made = element("div", { class: "cards" });
  rest = shown.map((task) => [made, task]);
  return made;
}

/** A table: a row and a column for each value that a task shown has, and in each cell all that have both. */
function table() {
  const { rows, columns } = state;
  const of = (/** @type {Facet | undefined} */ facet, /** @type {Task} */ task) => (facet ? facet.of(task) : "");
  const axis = (/** @type {Facet | undefined} */ facet) => {
    const used = new Set(shown.map((task) => of(facet, task)));
    return facet ? [...facet.rank.keys()].filter((value) => used.has(value)) : [""];
  };
  const key = (/** @type {string[]} */ ...values) => JSON.stringify(values);
  /** @type {Map<string, Task[]>} */
  const cells = new Map();
  for (const task of shown) {
    const cell = key(of(rows, task), of(columns, task));
    const inside = cells.get(cell);
    if (inside) inside.push(task);
    else cells.set(cell, [task]);
  }
  const heading = (/** @type {string} */ scope, /** @type {Facet} */ facet, /** @type {string} */ value) =>
    element("th", { scope, title: `${facet.name} ${value}` }, element("div", {}, plain(facet.name, "quiet"), shownValue(value)));
  const across = axis(columns);
  const made = element("table", { class: columns ? "plot" : "plot one" });
  if (columns) {
    const corner = rows ? [element("td")] : [];
    made.append(element("thead", {}, element("tr", {}, ...corner, ...across.map((value) => heading("col", columns, value)))));
  }
  const body = element("tbody");
  rest = [];
  for (const value of axis(rows)) {
    const line = element("tr", {}, ...(rows ? [heading("row", rows, value)] : []));
    for (const other of across) {
      const cell = element("td");
      const place = element("div", { class: "cards" });
      const inside = cells.get(key(value, other)) ?? [];
      if (inside.length) cell.append(place);
      for (const task of inside) rest.push([place, task]);
      line.append(cell);
    }
    body.append(line);
  }
  made.append(body);
  return made;
}

/** What is laid out now. */
let laid = { key: "", shown };

export function layOut() {
  const key = `${state.rows?.key}\n${state.columns?.key}`;
  if (key === laid.key && shown.length === laid.shown.length && shown.every((task, k) => task === laid.shown[k])) return;
  if (key !== laid.key) {
    cards.clear();
    near.disconnect();
  }
  laid = { key, shown };
  const hadFocus = sheet.contains(document.activeElement);
  rest = [];
  const nothing = () => element("p", { class: "nothing" }, tasks.length ? "No task is like this." : "The sweep has no tasks.");
  if (!shown.length) sheet.replaceChildren(nothing());
  else sheet.replaceChildren(state.rows || state.columns ? table() : grid());
  grow(FIRST);
  const next = current && shown.includes(current) ? current : shown[0];
  if (hadFocus) goTo(next);
  else setCurrent(next);
}

/** The task whose card the keyboard is at. */
export let current = /** @type {Task | undefined} */ (undefined);

const lookOf = (/** @type {Task | undefined} */ task) => task && cards.get(task)?.querySelector("button");

/** @param {Task | undefined} task */
export function setCurrent(task) {
  lookOf(current)?.setAttribute("tabindex", "-1");
  current = task;
  lookOf(task)?.setAttribute("tabindex", "0");
}

/** @param {Task | undefined} task */
export function goTo(task) {
  if (!task || !shown.includes(task)) return;
  if (!lookOf(task)?.isConnected) finish();
  setCurrent(task);
  lookOf(task)?.focus();
}

/**
 * Goes to the card that is next in a direction on the screen.
 * @param {number} x
 * @param {number} y
 */
export function go(x, y) {
  if (!current) return;
  if (x && !state.rows && !state.columns) return goTo(shown[shown.indexOf(current) + x]);
  finish();
  const from = cards.get(current)?.getBoundingClientRect();
  let [found, least] = [current, Infinity];
  for (const task of from ? shown : []) {
    const to = cards.get(task)?.getBoundingClientRect();
    if (!from || !to) continue;
    const [right, below] = [to.left - from.left, to.top - from.top];
    const far = right * x + below * y;
    const way = far + 8 * Math.abs(x ? below : right);
    if (far > 1 && way < least) [found, least] = [task, way];
  }
  goTo(found);
}
