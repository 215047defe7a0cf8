// The list of properties that a value is required to have and lacks: a sentence for each, and the elements that violate it.

import { element } from "./element.js";

const number = (/** @type {number} */ x) => String(Number(x.toPrecision(6)));

/**
 * @param {import("./types").Broken[]} broken
 * @param {(position: [number, number, number]) => void} aim centers the view on a position
 */
export function brokenItems(broken, aim) {
  return broken.map(({ words, count, elements }) => {
    const list = element("ul");
    for (const { name, at } of elements) {
      const item = element("li");
      const button = element("button", { class: "place", type: "button", title: "center the view on it" }, `${name} at ${at.map(number).join(", ")}`);
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
