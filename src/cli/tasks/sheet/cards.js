// A card for each task: its picture, its values and its state.

import { WORDS, names, taskIndex, tasks, varied } from "./data.js";
import { element, formatSeconds, plainText, shownValue } from "./element.js";
import { state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** The time of a task as text; empty if it has not run. */
export const timeOf = (/** @type {Task} */ task) => (task.seconds === null ? "" : formatSeconds(task.seconds));

const errorOf = (/** @type {Task} */ task) => task.problems.find(({ severity }) => severity === "error")?.message;

/** Describes a task in one line: its values, its state, its time and its error. */
export function describe(/** @type {Task} */ task) {
  const values = names.map((name, k) => `${name} ${task.values[k] ?? ""}`).join(", ");
  const how = [WORDS[task.state], timeOf(task), errorOf(task)].filter(Boolean).join(", ");
  return `${values || task.name}: ${how}`;
}

/** The URL of a task's picture, which is part of this page; null if it has none. */
export const pictureUrl = (/** @type {Task} */ task) => (task.state === "done" && task.picture?.startsWith("data:image/") ? task.picture : null);

/**
 * The picture of a task, or the reason why there is none.
 * @param {Task} task
 * @param {"sync" | "async"} decoding `sync` blocks until the picture is decoded, without flicker; `async` does not block
 */
export function pictureOf(task, decoding = "sync") {
  const src = pictureUrl(task);
  if (src) return element("img", { class: "picture", alt: "", src, draggable: "false", decoding });
  const placard = element("span", { class: "placard" });
  if (task.state === "missing") placard.append("not run yet");
  else if (task.state === "done") placard.append("no picture");
  else placard.append(element("span", { class: "word", "data-state": "failed" }, "failed"), plainText(errorOf(task) || "no error message"));
  return placard;
}

/** @param {Task} task */
export function factsOf(task) {
  const facts = element("p", { class: "facts" });
  if (task.state !== "done") facts.append(element("span", { class: "word", "data-state": task.state }, WORDS[task.state]));
  if (timeOf(task)) facts.append(element("span", {}, timeOf(task)));
  const warnings = task.problems.filter(({ severity }) => severity === "warning").length;
  if (warnings) facts.append(element("span", { class: "warned" }, warnings > 1 ? `${warnings} warnings` : "1 warning"));
  return facts;
}

/**
 * @param {Task} task
 * @param {Facet[]} facets
 */
export function valuesOf(task, facets) {
  const values = facets.map((facet) => element("span", {}, plainText(facet.name, "quiet"), " ", shownValue(facet.value(task))));
  return element("p", { class: "values" }, ...values);
}

/**
 * The cards created so far, by task. They are cleared when rows or columns change, since cards then show other values.
 * @type {Map<Task, HTMLElement>}
 */
export const cards = new Map();

/** Loads the picture of a card when it is near the visible area: a thousand pictures are not decoded at once. */
export const pictureObserver = new IntersectionObserver(
  (entries) => entries.forEach(({ isIntersecting, target }) => isIntersecting && loadPicture(target)),
  { rootMargin: "100%", scrollMargin: "100%" },
);

/** @param {Element} card */
export function loadPicture(card) {
  pictureObserver.unobserve(card);
  const task = taskOf(card);
  if (task) card.querySelector(".picture")?.replaceWith(pictureOf(task, "async"));
}

/** The task of the card that contains an element. */
export const taskOf = (/** @type {Element | null} */ place) => tasks[Number(place?.closest(".card")?.getAttribute("data-task") ?? -1)];

/** @param {Task} task */
export function cardOf(task) {
  const known = cards.get(task);
  if (known) return known;
  const hasPicture = pictureUrl(task) !== null;
  const look = element("button", { class: "look", type: "button", tabindex: -1, "aria-label": describe(task), title: describe(task) });
  look.append(hasPicture ? element("span", { class: "picture" }) : pictureOf(task));
  const check = element("input", { type: "checkbox", tabindex: -1, "aria-label": `choose ${task.name}` });
  const otherFacets = varied.filter((facet) => facet !== state.rows && facet !== state.columns);
  const text = element("div", { class: "words" }, names.length ? valuesOf(task, otherFacets) : plainText(task.name), factsOf(task));
  const card = element("article", { class: "card", "data-task": taskIndex.get(task) ?? 0 }, look, element("label", { class: "choose" }, check), text);
  check.checked = state.chosen.has(task);
  if (hasPicture) pictureObserver.observe(card);
  cards.set(task, card);
  return card;
}

/** @param {Task} task */
export function problemsOf(task) {
  const list = task.problems.map(({ severity, message, place, help }) => {
    const more = [place, help].flatMap((text) => (text ? [element("span", {}, plainText(text))] : []));
    return element("li", { "data-severity": severity }, element("b", {}, plainText(message)), ...more);
  });
  return element("ul", { class: "problems" }, ...list);
}
