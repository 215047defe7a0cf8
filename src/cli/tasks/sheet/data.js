// What the batch wrote into the page. Names and messages in it may be anything: they only ever become text.

import { the } from "./element.js";

/** @typedef {{severity: "error" | "warning", message: string, place?: string | null, help?: string | null}} Problem */
/** @typedef {{name: string, path: string, bytes: number}} Written */
/**
 * @typedef {object} Task
 * @property {string} name
 * @property {"done" | "failed" | "missing"} state
 * @property {string[]} values one for each name of the sheet, as an author writes it
 * @property {number | null} seconds
 * @property {Record<string, number> | null} nodes how many nodes came to which end; ends that none came to are left out
 * @property {string | null} picture
 * @property {Written[]} files
 * @property {Problem[]} problems
 */
/** @typedef {{title: string, graph: string, names: string[], size: [number, number], tasks: Task[]}} Sheet */
/**
 * What tasks can be told apart by: their state, which is the first, or what they have for a name.
 * @typedef {object} Facet
 * @property {string} name
 * @property {string} key its word in the address
 * @property {(task: Task) => string} of
 * @property {Map<string, number>} rank its values and their places: numbers by what they are worth, then texts as they come in the sweep
 */

export const WORDS = { done: "done", failed: "failed", missing: "not run" };

/** What one of a unit is in mm, degrees or pixels. A bare number counts as one of these. */
const UNITS = new Map([["mm", 1], ["cm", 10], ["m", 1000], ["inch", 25.4], ["deg", 1], ["rad", 180 / Math.PI], ["px", 1]]);

/**
 * The numbers of a value; none of a text.
 * @param {string} text
 */
function numbersOf(text) {
  const [, unit = "mm", inside = ""] = /^\s*([a-z]+)?\s*\(?([-+\d.,\se_]+)\)?\s*$/i.exec(text) ?? [];
  const numbers = inside.replace(/,\s*$/, "").split(",").map((part) => (/\d/.test(part) ? Number(part.replaceAll("_", "")) : NaN));
  const factor = UNITS.get(unit);
  return factor && numbers.every(Number.isFinite) ? numbers.map((number) => number * factor) : [];
}

/**
 * @param {string} name
 * @param {string} key
 * @param {(task: Task) => string} of
 * @param {string[]} values
 * @returns {Facet}
 */
function facetOf(name, key, of, values) {
  const sorted = values.map((text) => ({ text, numbers: numbersOf(text) })).sort((a, b) => {
    if (!a.numbers.length || !b.numbers.length) return Number(!a.numbers.length) - Number(!b.numbers.length);
    const k = a.numbers.findIndex((number, k) => number !== b.numbers[k]);
    return k < 0 ? a.numbers.length - b.numbers.length : (a.numbers[k] ?? 0) - (b.numbers[k] ?? -Infinity);
  });
  return { name, key, of, rank: new Map(sorted.map(({ text }, place) => [text, place])) };
}

/** @type {Sheet} */
export const { title, graph, names, size, tasks } = JSON.parse(the("data", HTMLScriptElement).text);
export const number = new Map(tasks.map((task, k) => [task, k]));
export const called = new Map(tasks.map((task) => [task.name, task]));
const states = Object.keys(WORDS).filter((state) => tasks.some((task) => task.state === state));
export const facets = [
  facetOf("state", "state", (task) => task.state, states),
  ...names.map((name, k) => {
    const of = (/** @type {Task} */ task) => task.values[k] ?? "";
    return facetOf(name, `is.${name}`, of, [...new Set(tasks.map(of))]);
  }),
];
const several = facets.slice(1).filter(({ rank }) => rank.size > 1);
/** The names that have several values; all of them if none has. */
export const varied = several.length ? several : facets.slice(1);
/** Where words are searched for, one of them being `growth=5`. */
export const words = tasks.map((task) => {
  const values = names.map((name, k) => `${name}=${task.values[k] ?? ""}`);
  return [task.name, WORDS[task.state], ...values, ...task.problems.map(({ message }) => message)].join("\n").toLowerCase();
});
