// The state of the page: filter, order, layout and comparison. It is part of the address, so that a link restores it.

import { facets, searchTexts, tasks, tasksByName } from "./data.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** The state that a link restores. */
export const state = {
  text: "",
  /** The values of each facet that the filter accepts; an empty set accepts all. */
  wanted: new Map(facets.map((facet) => [facet, /** @type {Set<string>} */ (new Set())])),
  sort: "order",
  isDown: false,
  /** The facets of the rows and the columns of a table. */
  rows: /** @type {Facet | undefined} */ (undefined),
  columns: /** @type {Facet | undefined} */ (undefined),
  size: innerWidth <= 700 ? 150 : tasks.length > 200 ? 140 : tasks.length > 12 ? 220 : 320,
  /** The chosen tasks, in the order in which they were chosen. */
  chosen: /** @type {Set<Task>} */ (new Set()),
  one: /** @type {Task | undefined} */ (undefined),
  compare: "",
  at: 50,
  gain: 2,
};

/** The numbers of the state, with their minimum and maximum. */
export const RANGES = /** @type {["size" | "at" | "gain", number, number][]} */ ([["size", 80, 480], ["at", 0, 100], ["gain", 1, 32]]);

/** Formats the state as the fragment of the address. */
function address() {
  const query = new URLSearchParams();
  if (state.text) query.set("text", state.text);
  for (const [facet, wanted] of state.wanted) for (const value of wanted) query.append(facet.key, value);
  if (state.sort !== "order") query.set("sort", state.sort);
  if (state.isDown) query.set("down", "1");
  if (state.rows) query.set("rows", state.rows.name);
  if (state.columns) query.set("columns", state.columns.name);
  for (const [key] of RANGES) if (state[key] !== defaults[key]) query.set(key, String(state[key]));
  for (const task of state.chosen) query.append("chosen", task.name);
  if (state.one) query.set("one", state.one.name);
  if (state.compare) query.set("compare", state.compare);
  return `#${query}`;
}

const defaults = { ...state };

/** Restores the state from the address; ignores unknown names and values. */
export function readAddress() {
  const query = new URLSearchParams(location.hash.slice(1));
  const facet = (/** @type {string} */ key) => facets.find((facet, k) => k > 0 && facet.name === query.get(key));
  state.text = query.get("text") ?? "";
  for (const [facet, wanted] of state.wanted) {
    wanted.clear();
    for (const value of query.getAll(facet.key)) if (facet.rank.has(value)) wanted.add(value);
  }
  const sort = query.get("sort") ?? "";
  state.sort = sort === "time" || facets.some(({ key }) => key === sort) ? sort : "order";
  state.isDown = query.has("down");
  [state.rows, state.columns] = [facet("rows"), facet("columns")];
  for (const [key, min, max] of RANGES) state[key] = Math.min(max, Math.max(min, Number(query.get(key) ?? defaults[key]) || defaults[key]));
  state.chosen = new Set(query.getAll("chosen").flatMap((name) => tasksByName.get(name) ?? []));
  state.one = tasksByName.get(query.get("one") ?? "");
  const compare = query.get("compare") ?? "";
  state.compare = state.chosen.size > 1 && ["side", "wipe", "difference"].includes(compare) ? compare : "";
}

/** Writes the state into the address, with a delay: browsers limit the rate of such changes. */
let saveTimer = 0;
export function saveAddress() {
  clearTimeout(saveTimer);
  saveTimer = setTimeout(() => history.replaceState(null, "", address()), 100);
}

/** The tasks that are shown, in order. */
export let shown = /** @type {Task[]} */ ([]);

/** Updates `shown`. Returns the number of tasks for each value if the filter accepted only that value of its facet. */
export function applyFilter() {
  const wantedWords = state.text.toLowerCase().split(/\s+/);
  const counts = new Map(facets.map((facet) => [facet, /** @type {Map<string, number>} */ (new Map())]));
  shown = tasks.filter((task, k) => {
    if (!wantedWords.every((word) => searchTexts[k]?.includes(word))) return false;
    const against = facets.filter((facet) => !(state.wanted.get(facet)?.size === 0 || state.wanted.get(facet)?.has(facet.value(task))));
    for (const facet of against.length === 0 ? facets : against.length === 1 ? against : []) {
      const count = counts.get(facet);
      count?.set(facet.value(task), (count.get(facet.value(task)) ?? 0) + 1);
    }
    return against.length === 0;
  });
  const facet = facets.find(({ key }) => key === state.sort);
  const by = (/** @type {Task} */ task) => (state.sort === "time" ? (task.seconds ?? -1) : facet ? (facet.rank.get(facet.value(task)) ?? 0) : 0);
  if (state.sort !== "order") shown.sort((a, b) => by(a) - by(b));
  if (state.isDown) shown.reverse();
  return counts;
}
