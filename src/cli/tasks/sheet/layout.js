// The layout of the cards, in a grid or in a table by two names; and the keyboard focus among them.

import { cardOf, cards, pictureObserver } from "./cards.js";
import { tasks } from "./data.js";
import { element, elementById, plainText, shownValue } from "./element.js";
import { shown, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** The number of cards created at once, about a screenful, and after each further frame, so that the first ones appear at once. */
const [FIRST_CARDS, NEXT_CARDS] = [48, 200];

export const sheet = elementById("sheet", HTMLElement);

/** The tasks whose cards are not created yet, and the parent element of each. */
let rest = /** @type {[HTMLElement, Task][]} */ ([]);
let isGrowing = false;

/** @param {number} count */
function addCards(count) {
  for (const [place, task] of rest.splice(0, count)) place.append(cardOf(task));
  setCurrent(current);
  if (!rest.length || isGrowing) return;
  isGrowing = true;
  const next = () => {
    isGrowing = false;
    addCards(NEXT_CARDS);
  };
  // After the next paint.
  requestAnimationFrame(() => setTimeout(next));
}

/** Creates all cards now. */
export const makeAllCards = () => addCards(Infinity);

function grid() {
  const made = element("div", { class: "cards" });
  rest = shown.map((task) => [made, task]);
  return made;
}

/** A table with a row and a column for each value of the shown tasks; each cell has the tasks with both values. */
function table() {
  const { rows, columns } = state;
  const valueOn = (/** @type {Facet | undefined} */ facet, /** @type {Task} */ task) => (facet ? facet.value(task) : "");
  const axis = (/** @type {Facet | undefined} */ facet) => {
    const used = new Set(shown.map((task) => valueOn(facet, task)));
    return facet ? [...facet.rank.keys()].filter((value) => used.has(value)) : [""];
  };
  const key = (/** @type {string[]} */ ...values) => JSON.stringify(values);
  /** @type {Map<string, Task[]>} */
  const cells = new Map();
  for (const task of shown) {
    const cell = key(valueOn(rows, task), valueOn(columns, task));
    const inside = cells.get(cell);
    if (inside) inside.push(task);
    else cells.set(cell, [task]);
  }
  const heading = (/** @type {string} */ scope, /** @type {Facet} */ facet, /** @type {string} */ value) =>
    element("th", { scope, title: `${facet.name} ${value}` }, element("div", {}, plainText(facet.name, "quiet"), shownValue(value)));
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

/** The tasks in the page, and the facets of rows and columns. */
let layout = { key: "", shown };

export function layOut() {
  const key = `${state.rows?.key}\n${state.columns?.key}`;
  if (key === layout.key && shown.length === layout.shown.length && shown.every((task, k) => task === layout.shown[k])) return;
  if (key !== layout.key) {
    cards.clear();
    pictureObserver.disconnect();
  }
  layout = { key, shown };
  const hadFocus = sheet.contains(document.activeElement);
  rest = [];
  const nothing = () => element("p", { class: "nothing" }, tasks.length ? "No task matches." : "The sweep has no tasks.");
  if (!shown.length) sheet.replaceChildren(nothing());
  else sheet.replaceChildren(state.rows || state.columns ? table() : grid());
  addCards(FIRST_CARDS);
  const next = current && shown.includes(current) ? current : shown[0];
  if (hadFocus) goTo(next);
  else setCurrent(next);
}

/** The task whose card has the keyboard focus. */
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
  if (!lookOf(task)?.isConnected) makeAllCards();
  setCurrent(task);
  lookOf(task)?.focus();
}

/**
 * Moves the focus to the nearest card in a direction on the screen.
 * @param {number} x
 * @param {number} y
 */
export function moveFocus(x, y) {
  if (!current) return;
  if (x && !state.rows && !state.columns) return goTo(shown[shown.indexOf(current) + x]);
  makeAllCards();
  const from = cards.get(current)?.getBoundingClientRect();
  let [found, min] = [current, Infinity];
  for (const task of from ? shown : []) {
    const to = cards.get(task)?.getBoundingClientRect();
    if (!from || !to) continue;
    const [right, below] = [to.left - from.left, to.top - from.top];
    const far = right * x + below * y;
    const cost = far + 8 * Math.abs(x ? below : right);
    if (far > 1 && cost < min) [found, min] = [task, cost];
  }
  goTo(found);
}
