// The graph's parameters as sliders and fields; what is chosen is written into the file of the graph.

/** @typedef {{type: string, default: any, minimum?: number, maximum?: number, unit?: string, enum?: string[], format?: string, description?: string}} Schema */

function element(name, attributes = {}, text = "") {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

/** A value as RON. */
function ron(value) {
  if (typeof value === "string") return JSON.stringify(value);
  if (Array.isArray(value)) return `(${value.map(ron).join(", ")})`;
  return String(value);
}

export class Parameters {
  /**
   * @param {HTMLElement} place
   * @param {(name: string, value: string) => void} set puts a value, as RON, into the file
   */
  constructor(place, set) {
    this.place = place;
    this.set = set;
    /** By name: its schema as text, and what shows another value. */
    this.fields = new Map();
  }

  /** Shows the parameters of a graph. A field that somebody is in stays as it is. */
  show(schema) {
    const found = Object.entries(schema.properties ?? {}).filter(([, field]) => field.default !== undefined);
    const shape = JSON.stringify(found.map(([name, field]) => [name, { ...field, default: null }]));
    if (shape !== this.shape) {
      this.shape = shape;
      this.fields.clear();
      this.place.replaceChildren(...found.map(([name, field]) => this.#row(name, field)));
      if (found.length === 0) this.place.replaceChildren(element("p", {}, "none"));
    }
    for (const [name, field] of found) this.fields.get(name)(field.default);
  }

  #row(name, field) {
    const row = element("div", { class: "parameter" });
    const id = `parameter-${name}`;
    const label = element("label", { for: id }, name);
    label.title = field.description ?? "";
    row.append(label);
    const commit = (value) => this.set(name, ron(value));
    const put = this.#input(row, id, field, commit);
    this.fields.set(name, put);
    if (field.unit) row.append(element("span", { class: "unit" }, field.unit));
    return row;
  }

  // Adds what a value is chosen with; gives what shows another value.
  #input(row, id, field, commit) {
    const { type, minimum, maximum } = field;
    if (type === "boolean") return this.#simple(row, element("input", { id, type: "checkbox" }), "checked", commit);
    if (field.enum) {
      const choice = element("select", { id });
      choice.append(...field.enum.map((word) => element("option", {}, word)));
      return this.#simple(row, choice, "value", (word) => this.set(id.slice("parameter-".length), word));
    }
    if (field.format === "color") return this.#simple(row, element("input", { id, type: "color" }), "value", commit);
    if (type !== "number" && type !== "integer") {
      const isList = type === "array";
      const text = element("input", { id, type: "text", spellcheck: "false" });
      const put = this.#simple(row, text, "value", (value) => commit(isList ? value.split(",").map(Number) : value));
      return (value) => put(isList ? value.join(", ") : value);
    }
    const isWhole = type === "integer";
    const step = isWhole ? 1 : "any";
    const number = element("input", { id, type: "number", step, ...(minimum === undefined ? {} : { min: minimum }), ...(maximum === undefined ? {} : { max: maximum }) });
    // The wheel scrolls; it does not change what the pointer happens to be over.
    number.addEventListener("wheel", (event) => event.preventDefault(), { passive: false });
    const put = this.#simple(row, number, "value", (text) => {
      if (text !== "" && number.checkValidity()) commit(Number(text));
    });
    if (minimum === undefined || maximum === undefined) return put;
    const slider = element("input", { type: "range", min: minimum, max: maximum, step: isWhole ? 1 : (maximum - minimum) / 200, "aria-label": id.slice("parameter-".length) });
    slider.addEventListener("input", () => {
      number.value = String(Number(Number(slider.value).toPrecision(6)));
    });
    slider.addEventListener("change", () => commit(Number(number.value)));
    number.addEventListener("input", () => {
      slider.value = number.value;
    });
    row.append(slider);
    return (value) => {
      put(value);
      if (document.activeElement !== number && document.activeElement !== slider) slider.value = String(value);
    };
  }

  #simple(row, input, property, commit) {
    let last = null;
    input.addEventListener("change", () => {
      if (input[property] === last) return;
      last = input[property];
      commit(last);
    });
    // What was being typed when another value came is not lost; what was not changed shows the value when it is left.
    input.addEventListener("keydown", (event) => {
      if (event.key === "Escape") input[property] = last;
    });
    row.append(input);
    return (value) => {
      const isTyped = document.activeElement === input && input[property] !== last && last !== null;
      last = property === "checked" ? value : String(value);
      if (!isTyped) input[property] = last;
    };
  }
}
