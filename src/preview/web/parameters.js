// The graph's parameters as sliders and fields. Chosen values are written into the graph file.

import { element } from "./element.js";

/** @typedef {import("./types").Field} Field */

/**
 * The actions on values, which are given as RON: `set` writes a value into the file, `drag` previews the result of a value, `drop` cancels
 * the preview. `want` starts picking a value by a click into the view.
 * @typedef {{
 *   set: (name: string, value: string) => void,
 *   drag: (name: string, value: string) => void,
 *   drop: () => void,
 *   want: (kind: "color" | "pixel" | "place", done: (found: any) => void) => void,
 * }} Actions
 */

/**
 * Formats a value as RON.
 * @param {any} value
 * @returns {string}
 */
function ron(value) {
  if (typeof value === "string") return JSON.stringify(value);
  if (Array.isArray(value)) return `(${value.map(ron).join(", ")})`;
  return String(value);
}

/**
 * Creates the note of a parameter that has a value for drafts.
 * @param {{final: any, draft: any}} values
 */
function mark({ final, draft }) {
  const words = (/** @type {any} */ value) => (value === null ? "computed" : ron(value));
  return element("small", { class: "draft", title: "the value in final runs, and the value in draft runs" }, `final ${words(final)}, draft ${words(draft)}`);
}

export class Parameters {
  /**
   * @param {HTMLElement} place
   * @param {Actions} actions
   */
  constructor(place, actions) {
    this.place = place;
    this.actions = actions;
    /**
     * The function that displays a new value, by parameter name.
     * @type {Map<string, (value: any) => void>}
     */
    this.fields = new Map();
    this.shape = "";
  }

  /**
   * Shows the parameters of a graph. Unfinished input stays.
   * @param {import("./types").Drawing["schema"]} schema
   */
  show(schema) {
    const found = Object.entries(schema.properties ?? {}).filter(([, field]) => field.default !== undefined);
    const shape = JSON.stringify(found.map(([name, field]) => [name, { ...field, default: null }]));
    if (shape !== this.shape) {
      this.shape = shape;
      this.fields.clear();
      this.place.replaceChildren(...found.map(([name, field]) => this.#row(name, field)));
      if (found.length === 0) this.place.replaceChildren(element("p", {}, "none"));
    }
    for (const [name, field] of found) this.fields.get(name)?.(field.default);
  }

  /**
   * @param {string} name
   * @param {Field} field
   */
  #row(name, field) {
    const row = element("div", { class: "parameter" });
    const label = element("label", { for: `parameter-${name}` }, name);
    label.title = field.description ?? "";
    if (field.draft) label.append(mark(field.draft));
    row.append(label);
    this.fields.set(name, this.#input(row, name, field));
    if (field.unit) row.append(element("span", { class: "unit" }, field.unit));
    return row;
  }

  /**
   * Adds the input of a parameter; returns the function that displays a new value.
   * @param {HTMLElement} row
   * @param {string} name
   * @param {Field} field
   * @returns {(value: any) => void}
   */
  #input(row, name, field) {
    const { type, minimum, maximum } = field;
    const id = `parameter-${name}`;
    const commit = (/** @type {any} */ value) => this.actions.set(name, ron(value));
    if (type === "boolean") return this.#simple(row, element("input", { id, type: "checkbox" }), "checked", commit);
    if (field.enum) {
      const choice = element("select", { id });
      choice.append(...field.enum.map((word) => element("option", {}, word)));
      return this.#simple(row, choice, "value", (word) => this.actions.set(name, word));
    }
    if (field.format === "color") {
      const color = element("input", { id, type: "color" });
      const put = this.#simple(row, color, "value", commit);
      this.#dropper(row, name, "color", commit);
      return put;
    }
    if (type !== "number" && type !== "integer") {
      const isList = type === "array";
      const text = element("input", { id, type: "text", spellcheck: "false" });
      const put = this.#simple(row, text, "value", (value) => commit(isList ? String(value).split(",").map(Number) : value));
      if (isList && field.minItems === 2) this.#dropper(row, name, "pixel", commit);
      if (isList && field.minItems === 3) this.#dropper(row, name, "place", commit);
      return (value) => put(isList ? value.join(", ") : value);
    }
    const isWhole = type === "integer";
    const step = isWhole ? 1 : "any";
    const number = element("input", { id, type: "number", step, ...(minimum === undefined ? {} : { min: minimum }), ...(maximum === undefined ? {} : { max: maximum }) });
    // The wheel scrolls the page and does not change the number under the pointer.
    number.addEventListener("wheel", (event) => event.preventDefault(), { passive: false });
    const put = this.#simple(row, number, "value", (text) => {
      if (text !== "") commit(Number(text));
    });
    if (minimum === undefined || maximum === undefined) return put;
    const slider = element("input", { type: "range", min: minimum, max: maximum, step: isWhole ? 1 : (maximum - minimum) / 200, "aria-label": name });
    let isDragged = false;
    // True after Escape while the mouse button is still down.
    let isGivenUp = false;
    /** @type {any} */
    let last = null;
    const chosen = () => Number(Number(slider.value).toPrecision(6));
    slider.addEventListener("input", () => {
      if (isGivenUp) {
        slider.value = String(last);
        return;
      }
      number.value = String(chosen());
      isDragged = true;
      this.actions.drag(name, ron(chosen()));
    });
    slider.addEventListener("change", () => {
      if (!isDragged) return;
      isDragged = false;
      commit(chosen());
    });
    const drop = () => {
      if (!isDragged) return;
      isDragged = false;
      this.actions.drop();
      show(last);
    };
    slider.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      isGivenUp = isDragged;
      drop();
    });
    let ending = 0;
    const finish = () => {
      clearTimeout(ending);
      drop();
      isGivenUp = false;
    };
    // A slider that returns to its old value sends no `change`, so the end of a drag is detected here, after the events of this drag.
    const end = () => {
      clearTimeout(ending);
      ending = setTimeout(finish);
    };
    for (const event of ["lostpointercapture", "pointerup", "pointercancel"]) slider.addEventListener(event, end);
    slider.addEventListener("pointerdown", finish);
    slider.addEventListener("blur", drop);
    const follow = () => {
      if (number.value !== "") slider.value = number.value;
    };
    number.addEventListener("input", follow);
    number.addEventListener("keydown", follow);
    row.append(slider);
    const show = (/** @type {any} */ value) => {
      last = value;
      if (isDragged) return;
      put(value);
      follow();
    };
    return show;
  }

  /**
   * Adds the button that picks a value by a click into the view.
   * @param {HTMLElement} row
   * @param {string} name
   * @param {"color" | "pixel" | "place"} kind
   * @param {(value: any) => void} commit
   */
  #dropper(row, name, kind, commit) {
    const what = { color: "a color of a picture or mesh", pixel: "a pixel of a picture or texture", place: "a position in space" }[kind];
    const button = element("button", { class: "dropper", title: `pick ${what}: click on it in the view`, "aria-label": `pick ${name} in the view` }, "pick");
    button.addEventListener("click", () => {
      this.actions.want(kind, (found) => commit(kind === "place" ? found.map((/** @type {number} */ x) => Number(x.toPrecision(6))) : found));
    });
    row.append(button);
  }

  /**
   * @template {HTMLInputElement | HTMLSelectElement} Input
   * @param {HTMLElement} row
   * @param {Input} input
   * @param {"value" | "checked"} property the property of the input that has the value
   * @param {(value: any) => void} commit
   * @returns {(value: any) => void}
   */
  #simple(row, input, property, commit) {
    const read = () => (property === "checked" ? /** @type {HTMLInputElement} */ (input).checked : input.value);
    const write = (/** @type {any} */ value) => Object.assign(input, { [property]: value });
    /** The value in the file. @type {string | boolean | null} */
    let last = null;
    /** The value that has been sent and is not in the file yet. @type {string | boolean | null} */
    let wanted = null;
    input.addEventListener("change", () => {
      if (read() === (wanted ?? last)) return;
      wanted = read();
      commit(wanted);
    });
    // Unfinished input stays when another value arrives; Escape discards it.
    input.addEventListener("keydown", (event) => {
      if (/** @type {KeyboardEvent} */ (event).key !== "Escape") return;
      wanted = null;
      write(last);
    });
    row.append(input);
    return (value) => {
      const isTyped = document.activeElement === input && read() !== last && read() !== wanted && last !== null;
      wanted = null;
      last = property === "checked" ? value : String(value);
      if (!isTyped) write(last);
    };
  }
}
