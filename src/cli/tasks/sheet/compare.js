// The comparison of the chosen tasks: side by side, by a wipe, or by the difference of their pictures.

import { cards, describe, factsOf, pictureOf, pictureUrl, valuesOf } from "./cards.js";
import { facets } from "./data.js";
import { element, elementById, onClick, plainText } from "./element.js";
import { sheet } from "./layout.js";
import { RANGES, saveAddress, state } from "./state.js";
/** @typedef {import("./data.js").Task} Task */

export const compare = elementById("compare", HTMLDialogElement);
/** The buttons that select the kind of comparison. */
export const views = [...elementById("views", HTMLElement).querySelectorAll("button")];

/** @param {Task} task */
export function choose(task, isChosen = !state.chosen.has(task)) {
  if (isChosen) state.chosen.add(task);
  else state.chosen.delete(task);
  showChosen();
  saveAddress();
}

export function showChosen() {
  for (const [task, card] of cards) {
    const check = card.querySelector("input");
    if (check) check.checked = state.chosen.has(task);
  }
  const count = state.chosen.size;
  sheet.toggleAttribute("data-choosing", count > 0);
  elementById("picked", HTMLElement).hidden = count === 0;
  elementById("picked-count", HTMLElement).textContent = `${count} chosen`;
  elementById("picked-compare", HTMLButtonElement).ariaDisabled = String(count < 2);
}

/** Shows the comparison of the chosen tasks. */
export function showCompared(view = state.compare || "side") {
  const chosen = [...state.chosen];
  const [first, second] = chosen;
  if (!first || !second) return compare.close();
  const canOverlay = chosen.length === 2 && chosen.every((task) => pictureUrl(task) !== null);
  state.compare = canOverlay ? view : "side";
  const differing = facets.slice(1).filter((facet) => chosen.some((task) => facet.value(task) !== facet.value(first)));
  const same = facets.slice(1).filter((facet) => !differing.includes(facet));
  elementById("compare-title", HTMLElement).replaceChildren(`${chosen.length} compared`, ...(same.length ? [valuesOf(first, same)] : []));
  for (const button of views) {
    button.ariaPressed = String(button.value === state.compare);
    button.ariaDisabled = String(button.value !== "side" && !canOverlay);
    if (button.value === "side") continue;
    button.title = canOverlay ? `${button.value} (${button.value[0]})` : "needs exactly two tasks with pictures";
  }
  const caption = (/** @type {Task} */ task) => [differing.length ? valuesOf(task, differing) : plainText(task.name), factsOf(task)];
  const compared = elementById("compared", HTMLElement);
  if (state.compare === "side") {
    const figures = chosen.map((task) => {
      const label = `remove ${task.name} from the comparison`;
      const remove = onClick(element("button", { class: "remove", type: "button", title: label, "aria-label": label }, "×"), () => {
        choose(task, false);
        showCompared();
      });
      return element("figure", {}, pictureOf(task), element("figcaption", {}, ...caption(task)), ...(chosen.length > 2 ? [remove] : []));
    });
    compared.replaceChildren(element("div", { class: "beside" }, ...figures));
  } else {
    compared.replaceChildren(overlaid(first, second, caption));
  }
  if (!compare.open) compare.showModal();
  // The slider has the focus, so that the arrow keys move it at once.
  compared.querySelector("input")?.focus();
  saveAddress();
}

/**
 * @param {Task} first
 * @param {Task} second
 * @param {(task: Task) => HTMLElement[]} caption
 */
function overlaid(first, second, caption) {
  const isWipe = state.compare === "wipe";
  const key = isWipe ? "at" : "gain";
  const [, min, max] = RANGES.find(([name]) => name === key) ?? [key, 0, 1];
  const label = `${describe(first)}; ${describe(second)}`;
  const inside = isWipe ? [pictureOf(first), pictureOf(second)] : [differenceOf(first, second)];
  const pair = element("div", { class: "pair", "data-view": state.compare, role: "img", "aria-label": label }, ...inside);
  const range = element("input", { type: "range", min: min, max: max, value: state[key] });
  const show = () => {
    state[key] = Number(range.value);
    pair.style.setProperty(`--${key}`, String(state[key]));
    saveAddress();
  };
  range.addEventListener("input", show);
  const drag = (/** @type {PointerEvent} */ event) => {
    if (!isWipe || !(event.buttons & 1)) return;
    const { left, width } = pair.getBoundingClientRect();
    range.value = String((100 * (event.clientX - left)) / width);
    show();
  };
  pair.addEventListener("pointerdown", (event) => {
    pair.setPointerCapture(event.pointerId);
    drag(event);
  });
  pair.addEventListener("pointermove", drag);
  show();
  const ends = [first, second].map((task) => element("div", {}, ...caption(task)));
  const equal = first.picture === second.picture ? [element("p", {}, "Both pictures are equal, byte for byte.")] : [];
  const slider = element("label", {}, isWipe ? "wipe" : "strength", range);
  return element("div", { class: "over" }, pair, element("div", { class: "ends" }, ...ends), ...equal, slider);
}

/**
 * Draws the difference of pictures, pixel by pixel, at their own size: scaled pictures would differ even where they are equal.
 * @param {Task[]} tasks
 */
function differenceOf(...tasks) {
  const canvas = element("canvas");
  const pictures = tasks.map((task) => Object.assign(new Image(), { src: pictureUrl(task) ?? "" }));
  const draw = () => {
    const pen = canvas.getContext("2d");
    canvas.width = Math.max(...pictures.map(({ naturalWidth }) => naturalWidth));
    canvas.height = Math.max(...pictures.map(({ naturalHeight }) => naturalHeight));
    for (const picture of pictures) {
      pen?.drawImage(picture, 0, 0);
      if (pen) pen.globalCompositeOperation = "difference";
    }
  };
  Promise.all(pictures.map((picture) => picture.decode())).then(draw, () => canvas.replaceWith("one of the pictures cannot be read"));
  return canvas;
}

export function chooseNone() {
  state.chosen.clear();
  showChosen();
  saveAddress();
}
