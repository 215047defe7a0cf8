// The data of the batch, which is part of the page. Names and messages may contain anything and are only ever inserted as text.

import { elementById } from "./element.js";

/** @typedef {{severity: "error" | "warning", message: string, place?: string | null, help?: string | null}} Problem */
/** @typedef {{name: string, path: string, bytes: number}} Written */
/**
 * @typedef {object} Task
 * @property {string} name
 * @property {"done" | "failed" | "missing"} state
 * @property {string[]} values one for each name of the sheet, as RON
 * @property {number | null} seconds
 * @property {Record<string, number> | null} nodes the number of nodes by state; states without nodes are left out
 * @property {string | null} picture
 * @property {Written[]} files
 * @property {Problem[]} problems
 */
/** @typedef {{title: string, graph: string, names: string[], size: [number, number], tasks: Task[]}} Sheet */
/**
 * A property by which tasks are filtered, sorted and laid out: their state (the first facet), or their value of a name of the sweep.
 * @typedef {object} Facet
 * @property {string} name
 * @property {string} key its name in the page's address
 * @property {(task: Task) => string} value
 * @property {Map<string, number>} rank its values and their sort order: numbers with units by size, then texts in the order of the sweep
 */

export const WORDS = { done: "done", failed: "failed", missing: "not run" };

/** Units in mm, degrees or pixels. A number without a unit counts as mm, degrees or pixels. */
const UNITS = new Map([["mm", 1], ["cm", 10], ["m", 1000], ["inch", 25.4], ["deg", 1], ["rad", 180 / Math.PI], ["px", 1]]);

/**
 * The numbers of a value, in the units of `UNITS`; empty for other texts.
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
 * @param {(task: Task) => string} value
 * @param {string[]} values
 * @returns {Facet}
 */
function makeFacet(name, key, value, values) {
  const sorted = values.map((text) => ({ text, numbers: numbersOf(text) })).sort((a, b) => {
    if (!a.numbers.length || !b.numbers.length) return Number(!a.numbers.length) - Number(!b.numbers.length);
    const k = a.numbers.findIndex((number, k) => number !== b.numbers[k]);
    return k < 0 ? a.numbers.length - b.numbers.length : (a.numbers[k] ?? 0) - (b.numbers[k] ?? -Infinity);
  });
  return { name, key, value, rank: new Map(sorted.map(({ text }, place) => [text, place])) };
}

/** @type {Sheet} */
export const { title, graph, names, size, tasks } = JSON.parse(elementById("data", HTMLScriptElement).text);
export const taskIndex = new Map(tasks.map((task, k) => [task, k]));
export const tasksByName = new Map(tasks.map((task) => [task.name, task]));
const states = Object.keys(WORDS).filter((state) => tasks.some((task) => task.state === state));
export const facets = [
  makeFacet("state", "state", (task) => task.state, states),
  ...names.map((name, k) => {
    const value = (/** @type {Task} */ task) => task.values[k] ?? "";
    return makeFacet(name, `is.${name}`, value, [...new Set(tasks.map(value))]);
  }),
];
const several = facets.slice(1).filter(({ rank }) => rank.size > 1);
/** The facets with several values, or all facets if there are none. */
export const varied = several.length ? several : facets.slice(1);
/** The text of each task in which words are searched; values are in it as `growth=5`. */
export const searchTexts = tasks.map((task) => {
  const values = names.map((name, k) => `${name}=${task.values[k] ?? ""}`);
  return [task.name, WORDS[task.state], ...values, ...task.problems.map(({ message }) => message)].join("\n").toLowerCase();
});
