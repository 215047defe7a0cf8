// The contact sheet of a batch: finds, sorts, lays out, enlarges and compares its tasks.

import { cards, loadPicture, taskOf } from "./cards.js";
import { choose, chooseNone, compare, showChosen, showCompared, views } from "./compare.js";
import { WORDS, graph, size, tasks, title, varied } from "./data.js";
import { element, elementById, formatSeconds, onClick, plainText } from "./element.js";
import { makeFacets, showFacets } from "./filter.js";
import { current, goTo, layOut, makeAllCards, moveFocus, setCurrent, sheet } from "./layout.js";
import { followKey, one, showTask } from "./one.js";
import { applyFilter, readAddress, saveAddress, shown, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

function showAll() {
  return onClick(element("button", { type: "button", title: "show all (Esc)" }, "show all"), clearFilter);
}

/** Clears the filter. */
function clearFilter() {
  state.text = "";
  state.wanted.forEach((wanted) => wanted.clear());
  showTools();
  update();
}

const ratio = size[0] > 0 && size[1] > 0 ? size[0] / size[1] : 4 / 3;
const [text, slider, down] = [elementById("text", HTMLInputElement), elementById("size", HTMLInputElement), elementById("down", HTMLButtonElement)];
const [sort, rows, columns] = [elementById("sort", HTMLSelectElement), elementById("rows", HTMLSelectElement), elementById("columns", HTMLSelectElement)];
const help = elementById("help", HTMLDialogElement);

/** Updates the toolbar from the state. */
function showTools() {
  text.value = state.text;
  sort.value = state.sort;
  down.ariaPressed = String(state.isDown);
  rows.value = state.rows?.name ?? "";
  columns.value = state.columns?.name ?? "";
  slider.value = String(state.size);
}

/** Updates the page from the state. */
function update() {
  const counts = applyFilter();
  document.documentElement.style.setProperty("--size", `${state.size}px`);
  layOut();
  showFacets(counts);
  const isAll = shown.length === tasks.length;
  elementById("shown", HTMLElement).replaceChildren(isAll ? "" : `${shown.length} of ${tasks.length} shown `, ...(isAll ? [] : [showAll()]));
  saveAddress();
}

function showSummary() {
  document.title = `${title} - contact sheet`;
  document.documentElement.style.setProperty("--ratio", String(ratio));
  elementById("title", HTMLElement).append(plainText(title), " ", plainText(graph, "quiet"));
  const summary = elementById("summary", HTMLElement);
  for (const [name, word] of Object.entries(WORDS)) {
    const count = tasks.filter(({ state }) => state === name).length;
    if (count) summary.append(element("span", { class: "word", "data-state": name }, `${count} ${word}`), ", ");
  }
  summary.append(`${formatSeconds(tasks.reduce((sum, { seconds }) => sum + (seconds ?? 0), 0))} in all`);
}

/** @param {number} by */
function resize(by) {
  state.size = Math.min(480, Math.max(80, state.size + by));
  showTools();
  update();
}

function showFilter(isShown = elementById("facets", HTMLElement).hidden) {
  elementById("facets", HTMLElement).hidden = !isShown;
  elementById("filter", HTMLElement).ariaExpanded = String(isShown);
}

/** The actions of keys in the sheet. */
const SHEET = /** @type {Record<string, () => void>} */ ({
  "/": () => text.select(),
  f: () => showFilter(),
  c: () => state.chosen.size > 1 && showCompared("side"),
  "?": () => help.showModal(),
  "+": () => resize(20),
  "-": () => resize(-20),
  Escape() {
    if (state.chosen.size) chooseNone();
    else clearFilter();
  },
});

/** The actions of keys on a card. */
const CARD = /** @type {Record<string, () => void>} */ ({
  ArrowLeft: () => moveFocus(-1, 0),
  ArrowRight: () => moveFocus(1, 0),
  ArrowUp: () => moveFocus(0, -1),
  ArrowDown: () => moveFocus(0, 1),
  Home: () => goTo(shown[0]),
  End: () => goTo(shown.at(-1)),
  " ": () => current && choose(current),
});

/**
 * Performs the action of a key; returns false if it has none.
 * @param {KeyboardEvent} event
 */
function press({ key, shiftKey, target }) {
  if (one.open) return followKey(shiftKey ? `Shift+${key}` : key);
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
// The browser clicks a button when the space bar is released; space means `choose` here.
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
  else showTask(task);
  setCurrent(task);
});
sheet.addEventListener("focusin", (event) => {
  const task = event.target instanceof Element && taskOf(event.target);
  if (task) setCurrent(task);
});

one.addEventListener("close", () => {
  const task = state.one;
  state.one = undefined;
  saveAddress();
  goTo(task);
});
compare.addEventListener("close", () => {
  state.compare = "";
  saveAddress();
});

function connectTools() {
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
  onClick(elementById("filter", HTMLButtonElement), () => showFilter());
  onClick(elementById("keys", HTMLButtonElement), () => help.showModal());
  onClick(elementById("picked-compare", HTMLButtonElement), () => showCompared("side"));
  onClick(elementById("picked-none", HTMLButtonElement), chooseNone);
  for (const button of views) onClick(button, () => showCompared(button.value));
  // A printed sheet has all cards with their pictures.
  addEventListener("beforeprint", () => {
    makeAllCards();
    cards.forEach(loadPicture);
  });
  addEventListener("hashchange", show);
}

/** Updates the page from its address. */
function show() {
  readAddress();
  const { one: task, compare: view } = state;
  showTools();
  update();
  showChosen();
  if (task) showTask(task);
  else if (one.open) one.close();
  if (view) showCompared(view);
  else if (compare.open) compare.close();
}

makeFacets(update);
showSummary();
showFilter(innerWidth > 700);
connectTools();
show();
