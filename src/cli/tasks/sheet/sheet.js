// The contact sheet of a batch: each task with its picture and its values, to find, to lay out, to look at and to compare.

import { cards, fill, taskOf } from "./cards.js";
import { choose, chooseNone, compare, showChosen, showCompared, views } from "./compare.js";
import { WORDS, graph, size, tasks, title, varied } from "./data.js";
import { element, inTime, onClick, plain, the } from "./element.js";
import { makeFacets, showFacets } from "./filter.js";
import { current, finish, go, goTo, layOut, setCurrent, sheet } from "./layout.js";
import { goAlong, look, one } from "./one.js";
import { readAddress, remember, shown, sift, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

function showAll() {
  return onClick(element("button", { type: "button", title: "show all (Esc)" }, "show all"), forget);
}

/** Wants nothing in particular any more. */
function forget() {
  state.text = "";
  state.wanted.forEach((wanted) => wanted.clear());
  showTools();
  update();
}

const ratio = size[0] > 0 && size[1] > 0 ? size[0] / size[1] : 4 / 3;
const [text, slider, down] = [the("text", HTMLInputElement), the("size", HTMLInputElement), the("down", HTMLButtonElement)];
const [sort, rows, columns] = [the("sort", HTMLSelectElement), the("rows", HTMLSelectElement), the("columns", HTMLSelectElement)];
const help = the("help", HTMLDialogElement);

/** Brings the tools to what the state says. */
function showTools() {
  text.value = state.text;
  sort.value = state.sort;
  down.ariaPressed = String(state.isDown);
  rows.value = state.rows?.name ?? "";
  columns.value = state.columns?.name ?? "";
  slider.value = String(state.size);
}

/** Shows what is to be shown. */
function update() {
  const counts = sift();
  document.documentElement.style.setProperty("--size", `${state.size}px`);
  layOut();
  showFacets(counts);
  const isAll = shown.length === tasks.length;
  the("shown", HTMLElement).replaceChildren(isAll ? "" : `${shown.length} of ${tasks.length} shown `, ...(isAll ? [] : [showAll()]));
  remember();
}

function showSummary() {
  document.title = `${title} - contact sheet`;
  document.documentElement.style.setProperty("--ratio", String(ratio));
  the("title", HTMLElement).append(plain(title), " ", plain(graph, "quiet"));
  const summary = the("summary", HTMLElement);
  for (const [name, word] of Object.entries(WORDS)) {
    const count = tasks.filter(({ state }) => state === name).length;
    if (count) summary.append(element("span", { class: "word", "data-state": name }, `${count} ${word}`), ", ");
  }
  summary.append(`${inTime(tasks.reduce((sum, { seconds }) => sum + (seconds ?? 0), 0))} in all`);
}

/** @param {number} by */
function resize(by) {
  state.size = Math.min(480, Math.max(80, state.size + by));
  showTools();
  update();
}

function showFilter(isShown = the("facets", HTMLElement).hidden) {
  the("facets", HTMLElement).hidden = !isShown;
  the("filter", HTMLElement).ariaExpanded = String(isShown);
}

/** What keys do in the sheet. */
const SHEET = /** @type {Record<string, () => void>} */ ({
  "/": () => text.select(),
  f: () => showFilter(),
  c: () => state.chosen.size > 1 && showCompared("side"),
  "?": () => help.showModal(),
  "+": () => resize(20),
  "-": () => resize(-20),
  Escape() {
    if (state.chosen.size) chooseNone();
    else forget();
  },
});

/** What keys do at a card. */
const CARD = /** @type {Record<string, () => void>} */ ({
  ArrowLeft: () => go(-1, 0),
  ArrowRight: () => go(1, 0),
  ArrowUp: () => go(0, -1),
  ArrowDown: () => go(0, 1),
  Home: () => goTo(shown[0]),
  End: () => goTo(shown.at(-1)),
  " ": () => current && choose(current),
});

/**
 * Does what a key is for; false if it is for nothing.
 * @param {KeyboardEvent} event
 */
function press({ key, shiftKey, target }) {
  if (one.open) return goAlong(shiftKey ? `Shift+${key}` : key);
  if (compare.open) {
    const view = views.find(({ value }) => value[0] === key);
    view?.click();
    return view !== undefined;
  }
  if (help.open) return false;
  const isCard = target instanceof HTMLElement && target.matches(".look");
  const isTyping = target === text || target instanceof HTMLSelectElement;
  const act = isTyping && key !== "Escape" ? undefined : ((isCard && CARD[key]) || SHEET[key]);
  act?.();
  return act !== undefined;
}

document.addEventListener("keydown", (event) => {
  if (!event.ctrlKey && !event.metaKey && !event.altKey && press(event)) event.preventDefault();
});
// A button is clicked as the space bar goes up.
sheet.addEventListener("keyup", (event) => event.key === " " && event.preventDefault());

sheet.addEventListener("click", (event) => {
  const target = event.target instanceof Element ? event.target : null;
  const task = taskOf(target);
  if (!task) return;
  const last = [...state.chosen].at(-1);
  if (target instanceof HTMLInputElement) choose(task, target.checked);
  else if (!target?.closest(".look")) return;
  else if (event.shiftKey && last) {
    const [from = 0, to = 0] = [shown.indexOf(last), shown.indexOf(task)].sort((a, b) => a - b);
    for (const it of shown.slice(Math.max(0, from), to + 1)) choose(it, true);
  } else if (event.shiftKey || event.ctrlKey || event.metaKey) choose(task);
  else look(task);
  setCurrent(task);
});
sheet.addEventListener("focusin", (event) => {
  const task = event.target instanceof Element && taskOf(event.target);
  if (task) setCurrent(task);
});

one.addEventListener("close", () => {
  const task = state.one;
  state.one = undefined;
  remember();
  goTo(task);
});
compare.addEventListener("close", () => {
  state.compare = "";
  remember();
});

function wire() {
  const orders = ["order", "state", "time"].map((name) => new Option(name));
  sort.append(...orders, ...varied.map(({ name, key }) => new Option(name, key)));
  for (const select of [rows, columns]) select.append(new Option("none", ""), ...varied.map(({ name }) => new Option(name)));
  const change = (/** @type {HTMLElement} */ made, /** @type {() => void} */ act) =>
    made.addEventListener("input", () => {
      act();
      update();
    });
  change(text, () => (state.text = text.value));
  change(sort, () => (state.sort = sort.value));
  change(slider, () => (state.size = Number(slider.value)));
  const lay = (/** @type {"rows" | "columns"} */ axis, /** @type {"rows" | "columns"} */ other, /** @type {string} */ wanted) => {
    state[axis] = varied.find(({ name }) => name === wanted);
    if (state[other] === state[axis]) state[other] = undefined;
    showTools();
  };
  change(rows, () => lay("rows", "columns", rows.value));
  change(columns, () => lay("columns", "rows", columns.value));
  onClick(down, () => {
    state.isDown = !state.isDown;
    showTools();
    update();
  });
  onClick(the("filter", HTMLButtonElement), () => showFilter());
  onClick(the("keys", HTMLButtonElement), () => help.showModal());
  onClick(the("picked-compare", HTMLButtonElement), () => showCompared("side"));
  onClick(the("picked-none", HTMLButtonElement), chooseNone);
  for (const button of views) onClick(button, () => showCompared(button.value));
  // Who prints wants all of them.
  addEventListener("beforeprint", () => {
    finish();
    cards.forEach(fill);
  });
  addEventListener("hashchange", show);
}

/** Shows what the address says. */
function show() {
  readAddress();
  const { one: task, compare: view } = state;
  showTools();
  update();
  showChosen();
  if (task) look(task);
  else if (one.open) one.close();
  if (view) showCompared(view);
  else if (compare.open) compare.close();
}

makeFacets(update);
showSummary();
showFilter(innerWidth > 700);
wire();
show();
