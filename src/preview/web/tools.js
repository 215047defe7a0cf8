// The toolbar of display options, the legend of colors, and the label of the pinned output.

import { element, find } from "./element.js";
import { RAMPS, rampColor } from "./painter.js";

/** @typedef {import("./viewer.js").Viewer} Viewer */

const number = (/** @type {number} */ x) => String(Number(x.toPrecision(3)));

export class Tools {
  /**
   * @param {HTMLElement} place
   * @param {Viewer} viewer
   */
  constructor(place, viewer) {
    this.viewer = viewer;
    this.bar = find(place, ".tools", HTMLElement);
    this.legend = find(place, ".legend", HTMLElement);
    this.pin = find(place, ".pin", HTMLElement);
    this.line = find(place, ".wipe", HTMLElement);
    this.probe = find(place, ".probe", HTMLElement);
    this.drawn = "";
    this.explained = "";
    this.pins = "";
  }

  /**
   * Shows a text about the point under the pointer.
   * @param {string} text
   */
  showProbe(text) {
    this.probe.textContent = text;
  }

  /** The buttons that apply to the value: label, key, whether it is on, and action. */
  #choices() {
    const { viewer } = this;
    const { look } = viewer;
    const value = viewer.main.value;
    /** @type {{label: string, key: string, on: boolean, act: () => void, title: string}[]} */
    const choices = [];
    const toggle = (/** @type {"wire" | "normals" | "isolines" | "extra"} */ what, /** @type {string} */ key, /** @type {string} */ label, /** @type {string} */ title) =>
      choices.push({ label, key, on: look[what], act: () => viewer.restyle({ [what]: !look[what] }), title });
    if (viewer.painter === null || value === null) return choices;
    const shapes = value.space?.shapes ?? [];
    if (value.picture && value.space) choices.push({ label: "3D", key: "m", on: !look.flat, act: () => viewer.restyle({ flat: !look.flat }), title: "switch between picture and 3D view" });
    if (!viewer.isFlat) {
      if (shapes.some((shape) => shape.edge)) {
        toggle("wire", "w", "edges", "show the edges of faces");
        toggle("normals", "n", "normals", "show the normal at each vertex");
      }
      if (shapes.some((shape) => shape.parameter) || viewer.range() !== null) toggle("isolines", "i", "isolines", "show lines of equal numbers");
      if (shapes.some((shape) => shape.solid) && shapes.some((shape) => !shape.solid)) toggle("extra", "l", "lines", "show what is drawn with the faces: nets, points, arrows");
    }
    const isPinned = viewer.pinned !== null;
    choices.push({ label: "fit", key: "f", on: false, act: () => viewer.fit(), title: "fit the value into the view" });
    choices.push({ label: "pin", key: "p", on: isPinned && !viewer.pinned?.held, act: () => (isPinned ? viewer.unpin() : viewer.pin(false)), title: "keep this output beside the next one" });
    choices.push({ label: "hold", key: "h", on: Boolean(viewer.pinned?.held), act: () => (isPinned ? viewer.unpin() : viewer.pin(true)), title: "keep this result, to compare later runs with it" });
    if (isPinned) choices.push({ label: "wipe", key: "x", on: viewer.wipe !== null, act: () => viewer.toggleWipe(), title: "switch between wipe and side by side" });
    return choices;
  }

  /** The actions of the keys that apply only to some values. */
  keys() {
    const own = this.#choices().filter(({ key }) => "mwnil".includes(key));
    return Object.fromEntries(own.map(({ key, act }) => [key, act]));
  }

  /** Updates the toolbar, the legend and the label for the current value. */
  show() {
    const { viewer } = this;
    const choices = this.#choices();
    const paints = this.#paints();
    const drawn = JSON.stringify([choices, paints, viewer.look.paint]);
    if (drawn !== this.drawn) {
      this.drawn = drawn;
      const active = this.bar.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
      const buttons = choices.map(({ label, key, on, act, title }) => {
        const button = element("button", { "data-key": key, "aria-pressed": String(on), title: `${title} (${key})` }, label);
        button.addEventListener("click", act);
        return button;
      });
      this.bar.replaceChildren(...(paints.length > 1 ? [this.#select(paints)] : []), ...buttons);
      if (active) find(this.bar, `[data-key="${active}"]`, HTMLElement).focus();
    }
    this.#explain();
    this.#showPin();
  }

  /** The sources of color that the faces have: the value of `look.paint`, and the label of each. */
  #paints() {
    const { viewer } = this;
    const shapes = (viewer.main.value?.space?.shapes ?? []).filter((shape) => !shape.solid);
    if (viewer.painter === null || viewer.isFlat || shapes.length === 0) return [];
    const own = shapes.some((shape) => shape.texture) ? "texture" : shapes.some((shape) => shape.color) ? "colors" : "clay";
    /** @type {[string, string][]} */
    const paints = [["own", own], ...(own === "clay" ? [] : /** @type {[string, string][]} */ ([["clay", "clay"]])), ["normal", "normals"]];
    for (const { name, on } of shapes.flatMap((shape) => shape.fields)) paints.push([`${on} ${name}`, on === "vertex" ? name : `${name} (${on})`]);
    return paints;
  }

  /** @param {[string, string][]} paints */
  #select(paints) {
    const select = element("select", { "aria-label": "colors of faces", "data-key": "paint" });
    for (const [name, word] of paints) select.append(element("option", { value: name }, word));
    select.value = paints.some(([name]) => name === this.viewer.look.paint) ? this.viewer.look.paint : "own";
    select.addEventListener("change", () => this.viewer.restyle({ paint: select.value }));
    return select;
  }

  /** Shows the legend of the colors. */
  #explain() {
    const { viewer } = this;
    const range = viewer.painter === null || viewer.isFlat ? null : viewer.range();
    const explained = JSON.stringify(range);
    if (explained === this.explained) return;
    this.explained = explained;
    const parts = [];
    if (range !== null) {
      const { field, low, high, isSigned } = range;
      const bar = element("canvas", { width: 160, height: 10, role: "img", "aria-label": `${field.name} from ${number(low)} to ${number(high)}` });
      const pen = bar.getContext("2d");
      for (let x = 0; x < 160 && pen; x++) {
        pen.fillStyle = `rgb(${rampColor(isSigned ? RAMPS.signed : RAMPS.growing, x / 159).join()})`;
        pen.fillRect(x, 0, 1, 10);
      }
      const [min, max] = field.range;
      const ends = element("p", { class: "ends" });
      ends.append(element("span", {}, min < low ? `≤ ${number(low)}` : number(low)), element("span", {}, max > high ? `≥ ${number(high)}` : number(high)));
      parts.push(element("p", {}, field.name), bar, ends);
    }
    this.legend.hidden = parts.length === 0;
    this.legend.replaceChildren(...parts);
  }

  /** Shows the label of the pinned output and the line of the wipe. */
  #showPin() {
    const { pinned, wipe } = this.viewer;
    const viewed = pinned?.viewed;
    const text = !viewed ? "" : pinned.value === null ? `${viewed.node}.${viewed.output}` : `${viewed.node}.${viewed.output} of run ${pinned.value.run}${pinned.held ? ", held" : ""}`;
    this.line.hidden = pinned === null || Boolean(this.viewer.main.value?.series);
    this.line.style.left = `${100 * (wipe ?? 0.5)}%`;
    if (this.pins === text) return;
    this.pins = text;
    this.pin.hidden = text === "";
    const close = element("button", { "aria-label": "unpin", title: "unpin (u)" }, "×");
    close.addEventListener("click", () => this.viewer.unpin());
    this.pin.replaceChildren(element("span", {}, text), close);
  }
}
