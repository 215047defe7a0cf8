// Builds the page from its parts and from data, as the program does.
import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";

const PARTS = resolve(import.meta.dirname, "../../src/cli/tasks/sheet");

/** The scripts in an order in which each uses only earlier ones at load time. */
const SCRIPTS = ["element", "data", "state", "cards", "layout", "filter", "one", "compare", "sheet"];

const read = (name) => readFileSync(join(PARTS, name), "utf8");

/** Joins all scripts into one, without imports and exports. */
function script() {
  const lines = SCRIPTS.flatMap((name) => read(`${name}.js`).split("\n"));
  return lines.filter((line) => !line.startsWith("import ")).map((line) => line.replace(/^export /, "")).join("\n");
}

/** @param {object} data the data of the batch */
export function page(data) {
  const [start, ...rest] = read("sheet.html").split(/@@(style|data|script)@@/);
  const parts = { style: read("sheet.css"), script: script(), data: JSON.stringify(data).replaceAll("<", "\\u003c") };
  return start + rest.map((text, k) => (k % 2 ? text : parts[text])).join("");
}
