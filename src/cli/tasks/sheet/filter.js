// The filter: a button for each value of each facet, with the number of tasks that have it.

import { WORDS, facets } from "./data.js";
import { element, elementById, onClick, plainText, shownValue } from "./element.js";
import { state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** The number of values of a facet that are shown at first; `sheet.css` has it, too. */
const MAX_CHIPS = 16;

/**
 * The chip of each value of each facet.
 * @type {Map<Facet, Map<string, HTMLElement>>}
 */
const chips = new Map();

/** @param {() => void} update is called when the filter has changed */
export function makeFacets(update) {
  for (const facet of facets) {
    const heading = element("h3", {}, plainText(facet.name));
    if (facet.rank.size < 2) {
      if (facet.key !== "state") elementById("facets", HTMLElement).append(element("section", {}, heading, ...[...facet.rank.keys()].map(shownValue)));
      continue;
    }
    const made = new Map([...facet.rank.keys()].map((value) => {
      const text = facet.key === "state" ? WORDS[/** @type {Task["state"]} */ (value)] : value;
      const chip = element("button", { class: "chip", type: "button", title: text }, shownValue(text), element("span", { class: "count" }));
      onClick(chip, () => {
        const wanted = state.wanted.get(facet);
        if (!wanted?.delete(value)) wanted?.add(value);
        update();
      });
      return /** @type {const} */ ([value, chip]);
    }));
    chips.set(facet, made);
    const list = element("div", { class: "chips", role: "group" }, ...made.values());
    list.ariaLabel = facet.name;
    if (made.size > MAX_CHIPS) {
      const more = onClick(element("button", { class: "chip more", type: "button" }, `${made.size - MAX_CHIPS} more`), () => {
        list.toggleAttribute("data-all", true);
        [...made.values()][MAX_CHIPS]?.focus();
      });
      list.append(more);
    }
    elementById("facets", HTMLElement).append(element("section", {}, heading, list));
  }
}

/** @param {Map<Facet, Map<string, number>>} counts */
export function showFacets(counts) {
  for (const [facet, made] of chips) {
    for (const [value, chip] of made) {
      const count = String(counts.get(facet)?.get(value) ?? 0);
      const isWanted = state.wanted.get(facet)?.has(value) ?? false;
      if (chip.dataset.count === count && chip.ariaPressed === String(isWanted)) continue;
      chip.dataset.count = count;
      chip.ariaPressed = String(isWanted);
      if (chip.lastChild) chip.lastChild.textContent = count;
    }
  }
}
