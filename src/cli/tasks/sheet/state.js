// What is shown of the tasks, and how; the address says it, so that a link shows the same.

import { called, facets, tasks, words } from "./data.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** All that a link brings back. */
export const state = {
  text: "",
  /** Of each facet the values that are wanted; any if there is none. */
  wanted: new Map(facets.map((facet) => [facet, /** @type {Set<string>} */ (new Set())])),
  sort: "order",
  isDown: false,
  /** What the rows and the columns of a table are. */
  rows: /** @type {Facet | undefined} */ (undefined),
  columns: /** @type {Facet | undefined} */ (undefined),
  size: innerWidth <= 700 ? 150 : tasks.length > 200 ? 140 : tasks.length > 12 ? 220 : 320,
  /** In the order in which they were chosen. */
  chosen: /** @type {Set<Task>} */ (new Set()),
  one: /** @type {Task | undefined} */ (undefined),
  compare: "",
  at: 50,
  gain: 2,
};

/** The numbers of the state, with their least and largest values. */
export const RANGES = /** @type {["size" | "at" | "gain", number, number][]} */ ([["size", 80, 480], ["at", 0, 100], ["gain", 1, 32]]);

/** The address as it says all this. */
function address() {
  const said = new URLSearchParams();
  if (state.text) said.set("text", state.text);
  for (const [facet, wanted] of state.wanted) for (const value of wanted) said.append(facet.key, value);
  if (state.sort !== "order") said.set("sort", state.sort);
  if (state.isDown) said.set("down", "1");
  if (state.rows) said.set("rows", state.rows.name);
  if (state.columns) said.set("columns", state.columns.name);
  for (const [key] of RANGES) if (state[key] !== usual[key]) said.set(key, String(state[key]));
  for (const task of state.chosen) said.append("chosen", task.name);
  if (state.one) said.set("one", state.one.name);
  if (state.compare) said.set("compare", state.compare);
  return `#${said}`;
}

const usual = { ...state };

/** Takes over what an address says, as far as there is such a thing. */
export function readAddress() {
  const said = new URLSearchParams(location.hash.slice(1));
  const facet = (/** @type {string} */ key) => facets.find((facet, k) => k > 0 && facet.name === said.get(key));
  state.text = said.get("text") ?? "";
  for (const [facet, wanted] of state.wanted) {
    wanted.clear();
    for (const value of said.getAll(facet.key)) if (facet.rank.has(value)) wanted.add(value);
  }
  const sort = said.get("sort") ?? "";
  state.sort = sort === "time" || facets.some(({ key }) => key === sort) ? sort : "order";
  state.isDown = said.has("down");
  [state.rows, state.columns] = [facet("rows"), facet("columns")];
  for (const [key, least, most] of RANGES) state[key] = Math.min(most, Math.max(least, Number(said.get(key) ?? usual[key]) || usual[key]));
  state.chosen = new Set(said.getAll("chosen").flatMap((name) => called.get(name) ?? []));
  state.one = called.get(said.get("one") ?? "");
  const compare = said.get("compare") ?? "";
  state.compare = state.chosen.size > 1 && ["side", "wipe", "difference"].includes(compare) ? compare : "";
}

/** A browser takes no more than some addresses a second. */
let remembering = 0;
export function remember() {
  clearTimeout(remembering);
  remembering = setTimeout(() => history.replaceState(null, "", address()), 100);
}

/** The tasks that are shown, in order. */
export let shown = /** @type {Task[]} */ ([]);

/** Finds them, and how many there would be of each value if nothing else of its facet were wanted. */
export function sift() {
  const wantedWords = state.text.toLowerCase().split(/\s+/);
  const counts = new Map(facets.map((facet) => [facet, /** @type {Map<string, number>} */ (new Map())]));
  shown = tasks.filter((task, k) => {
    if (!wantedWords.every((word) => words[k]?.includes(word))) return false;
    const against = facets.filter((facet) => !(state.wanted.get(facet)?.size === 0 || state.wanted.get(facet)?.has(facet.of(task))));
    for (const facet of against.length === 0 ? facets : against.length === 1 ? against : []) {
      const count = counts.get(facet);
      count?.set(facet.of(task), (count.get(facet.of(task)) ?? 0) + 1);
    }
    return against.length === 0;
  });
  const facet = facets.find(({ key }) => key === state.sort);
  const by = (/** @type {Task} */ task) => (state.sort === "time" ? (task.seconds ?? -1) : facet ? (facet.rank.get(facet.of(task)) ?? 0) : 0);
  if (state.sort !== "order") shown.sort((a, b) => by(a) - by(b));
  if (state.isDown) shown.reverse();
  return counts;
}
