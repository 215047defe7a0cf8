// The page as the program joins it of its parts and of data.
import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";

const PARTS = resolve(import.meta.dirname, "../../src/cli/tasks/sheet");

/** In the order in which they may use each other from the start. */
const SCRIPTS = ["element", "data", "state", "cards", "layout", "filter", "one", "compare", "sheet"];

const read = (name) => readFileSync(join(PARTS, name), "utf8");

/** All scripts as one: what one takes from another is there already. */
function script() {
  const lines = SCRIPTS.flatMap((name) => read(`${name}.js`).split("\n"));
  return lines.filter((line) => !line.startsWith("import ")).map((line) => line.replace(/^export /, "")).join("\n");
}

/** @param {object} data what the page is to show */
export function page(data) {
  const [start, ...rest] = read("sheet.html").split(/@@(style|data|script)@@/);
  const parts = { style: read("sheet.css"), script: script(), data: JSON.stringify(data).replaceAll("<", "\\u003c") };
  return start + rest.map((text, k) => (k % 2 ? text : parts[text])).join("");
}
