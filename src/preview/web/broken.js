// What of a value is not as it is asked to be: a sentence for each property, and the elements that offend, which are marked.

import { element } from "./element.js";

const number = (/** @type {number} */ x) => String(Number(x.toPrecision(6)));

/**
 * @param {import("./types").Broken[]} broken
 * @param {(place: [number, number, number]) => void} aim looks at a place
 */
export function listOf(broken, aim) {
  return broken.map(({ words, count, elements }) => {
    const list = element("ul");
    for (const { name, at } of elements) {
      const item = element("li");
      const button = element("button", { class: "place", type: "button", title: "look at it" }, `${name} at ${at.map(number).join(", ")}`);
      button.addEventListener("click", () => aim(at));
      item.append(button);
      list.append(item);
    }
    if (count > elements.length) list.append(element("li", {}, `and ${count - elements.length} more`));
    const item = element("li");
    item.append(element("b", {}, words), list);
    return item;
  });
}
