// A card for each task: its picture, its values and how it went.

import { WORDS, names, number, tasks, varied } from "./data.js";
import { element, inTime, plain, shownValue } from "./element.js";
import { state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */
/** @typedef {import("./data.js").Facet} Facet */

/** How long it took, in words; nothing if it has not run. */
export const took = (/** @type {Task} */ task) => (task.seconds === null ? "" : inTime(task.seconds));

const errorOf = (/** @type {Task} */ task) => task.problems.find(({ severity }) => severity === "error")?.message;

/** The task as one would say it. */
export function said(/** @type {Task} */ task) {
  const values = names.map((name, k) => `${name} ${task.values[k] ?? ""}`).join(", ");
  const how = [WORDS[task.state], took(task), errorOf(task)].filter(Boolean).join(", ");
  return `${values || task.name}: ${how}`;
}

/** The address of its picture, which is in this page; nothing if it has none. */
export const pictured = (/** @type {Task} */ task) => (task.state === "done" && task.picture?.startsWith("data:image/") ? task.picture : null);

/**
 * Its picture, or why there is none.
 * @param {Task} task
 * @param {"sync" | "async"} decoding whether what is shown waits for it, so that nothing flickers, or not, so that nobody waits
 */
export function pictureOf(task, decoding = "sync") {
  const src = pictured(task);
  if (src) return element("img", { class: "picture", alt: "", src, draggable: "false", decoding });
  const placard = element("span", { class: "placard" });
  if (task.state === "missing") placard.append("has not run yet");
  else if (task.state === "done") placard.append("no picture");
  else placard.append(element("span", { class: "word", "data-state": "failed" }, "failed"), plain(errorOf(task) || "it does not say why"));
  return placard;
}

/** @param {Task} task */
export function factsOf(task) {
  const facts = element("p", { class: "facts" });
  if (task.state !== "done") facts.append(element("span", { class: "word", "data-state": task.state }, WORDS[task.state]));
  if (took(task)) facts.append(element("span", {}, took(task)));
  const warnings = task.problems.filter(({ severity }) => severity === "warning").length;
  if (warnings) facts.append(element("span", { class: "warned" }, warnings > 1 ? `${warnings} warnings` : "1 warning"));
  return facts;
}

/**
 * @param {Task} task
 * @param {Facet[]} facets
 */
export function valuesOf(task, facets) {
  const values = facets.map((facet) => element("span", {}, plain(facet.name, "quiet"), " ", shownValue(facet.of(task))));
  return element("p", { class: "values" }, ...values);
}

/**
 * What has been made so far for tasks, which stays as long as the same values are to be told.
 * @type {Map<Task, HTMLElement>}
 */
export const cards = new Map();

/** Gives a card its picture when it comes near: a thousand of them are not decoded at once. */
export const near = new IntersectionObserver(
  (seen) => seen.forEach(({ isIntersecting, target }) => isIntersecting && fill(target)),
  { rootMargin: "100%", scrollMargin: "100%" },
);

/** @param {Element} card */
export function fill(card) {
  near.unobserve(card);
  const task = taskOf(card);
  if (task) card.querySelector(".picture")?.replaceWith(pictureOf(task, "async"));
}

/** The task whose card this is in. */
export const taskOf = (/** @type {Element | null} */ place) => tasks[Number(place?.closest(".card")?.getAttribute("data-task") ?? -1)];

/** @param {Task} task */
export function cardOf(task) {
  const had = cards.get(task);
  if (had) return had;
  const hasPicture = pictured(task) !== null;
  const look = element("button", { class: "look", type: "button", tabindex: -1, "aria-label": said(task), title: said(task) });
  look.append(hasPicture ? element("span", { class: "picture" }) : pictureOf(task));
  const check = element("input", { type: "checkbox", tabindex: -1, "aria-label": `choose ${task.name}` });
  const told = varied.filter((facet) => facet !== state.rows && facet !== state.columns);
  const text = element("div", { class: "words" }, names.length ? valuesOf(task, told) : plain(task.name), factsOf(task));
  const card = element("article", { class: "card", "data-task": number.get(task) ?? 0 }, look, element("label", { class: "choose" }, check), text);
  check.checked = state.chosen.has(task);
  if (hasPicture) near.observe(card);
  cards.set(task, card);
  return card;
}

/** @param {Task} task */
export function problemsOf(task) {
  const list = task.problems.map(({ severity, message, place, help }) => {
    const more = [place, help].flatMap((text) => (text ? [element("span", {}, plain(text))] : []));
    return element("li", { "data-severity": severity }, element("b", {}, plain(message)), ...more);
  });
  return element("ul", { class: "problems" }, ...list);
}
