// The graph as an SVG: boxes for nodes and files, links between them, and the state of each node.

import { shape } from "./element.js";

/** The height of a box's head, and the distance of a text's baseline below its center. */
const [HEAD, BASE] = [38, 4];

/** The minimum scale of a wide graph. If the graph does not fit at this scale, the view scrolls. */
const MIN_SCALE = 0.7;

/** @typedef {import("./types").Box} Box */

export class Graph {
  /**
   * @param {HTMLElement} place where the graph is drawn
   * @param {(name: string) => void} choose is called with the node that is clicked
   * @param {(name: string) => void} open is called with the node to open in the editor
   */
  constructor(place, choose, open) {
    this.place = place;
    this.onChoose = choose;
    this.open = open;
    /** @type {Map<string, Box>} */
    this.boxes = new Map();
    /** @type {Map<string, SVGGElement>} */
    this.parts = new Map();
    /**
     * The names of the boxes that have a link to another box.
     * @type {Set<string>}
     */
    this.used = new Set();
    this.drawn = "";
  }

  /**
   * Draws the graph of a message. An unchanged graph is not drawn again, so that focus and scroll position stay.
   * @param {import("./types").Drawing} message
   */
  draw(message) {
    const drawn = JSON.stringify([message.boxes, message.links, message.packs]);
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    const active = document.activeElement;
    const focused = (this.place.contains(active) && active?.getAttribute("data-name")) || "";
    const [width, height] = message.size;
    const picture = shape("svg", { width, height, viewBox: `0 0 ${width} ${height}` });
    picture.setAttribute("aria-label", message.doc || "graph");
    // A wide graph is scaled down, as long as its text is readable.
    picture.style.minWidth = `${MIN_SCALE * width}px`;
    const color = (/** @type {number | null} */ pack) => message.packs[pack ?? -1]?.color ?? "#767676";
    for (const link of message.links) {
      const pack = message.boxes[link.from].pack;
      picture.append(shape("path", { class: "link", d: link.path, stroke: color(pack) }));
    }
    this.used = new Set(message.links.map((link) => message.boxes[link.from].name));
    this.boxes.clear();
    this.parts.clear();
    for (const box of message.boxes) {
      const part = this.#part(box, color(box.pack));
      this.boxes.set(box.name, box);
      this.parts.set(box.name, part);
      picture.append(part);
    }
    this.place.replaceChildren(picture);
    this.parts.get(focused)?.focus();
  }

  /**
   * @param {Box} box
   * @param {string} color
   */
  #part(box, color) {
    const [x, y, width, height] = box.place;
    const part = shape("g", { class: "node", "data-name": box.name, tabindex: 0, role: "button", "aria-label": `${box.name}, ${box.node ?? "file"}` });
    part.append(shape("rect", { class: "body", x, y, width, height, rx: 5 }));
    if (box.node === null) {
      part.append(shape("text", { x: x + 10, y: y + height / 2 + BASE }, box.name));
    } else {
      part.append(shape("rect", { x, y, width: 5, height, rx: 2, fill: color }));
      part.append(shape("text", { class: "name", x: x + 11, y: y + 16 }, box.name));
      part.append(shape("text", { class: "kind", x: x + 11, y: y + 30 }, box.node));
      part.append(shape("circle", { class: "state", cx: x + width - 1, cy: y + 1, r: 5.5 }));
      part.append(shape("text", { class: "time", x: x + width - 2, y: y + height + 11, "text-anchor": "end" }));
      part.append(shape("line", { x1: x + 5, y1: y + HEAD - 2, x2: x + width, y2: y + HEAD - 2, stroke: color, "stroke-opacity": 0.4 }));
    }
    for (const port of box.inputs) {
      part.append(shape("circle", { cx: x, cy: port.y, r: 3.4, fill: color }));
      part.append(shape("text", { class: "port", x: x + 10, y: port.y + BASE }, port.name));
    }
    for (const port of box.outputs) {
      part.append(shape("circle", { cx: x + width, cy: port.y, r: 3.4, fill: color }));
      part.append(shape("text", { class: "port", x: x + width - 10, y: port.y + BASE, "text-anchor": "end" }, port.name));
    }
    const choose = () => this.onChoose(box.name);
    part.addEventListener("click", choose);
    part.addEventListener("keydown", (event) => {
      if (event.key === "e" && !event.ctrlKey && !event.metaKey && !event.altKey) this.open(box.name);
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      choose();
    });
    return part;
  }

  /**
   * The name of the box of a node: its own, or that of the node whose graph contains it.
   * @param {string} name
   */
  boxOf(name) {
    let at = name.length;
    while (at > 0 && !this.parts.has(name.slice(0, at))) at = name.lastIndexOf("/", at - 1);
    return at > 0 ? name.slice(0, at) : undefined;
  }

  /** The last node that has an outgoing link, usually to an output file; the last node if there are no links. */
  last() {
    const nodes = [...this.boxes.values()].filter((box) => box.node !== null);
    return (nodes.findLast((box) => this.used.has(box.name)) ?? nodes.at(-1))?.name ?? null;
  }

  /**
   * Shows the state of a box and its time.
   * @param {string} name
   * @param {import("./types").NodeState} known
   */
  mark(name, { state = "", seconds = 0 }) {
    const part = this.parts.get(name);
    if (part === undefined) return;
    part.setAttribute("data-state", state);
    const time = part.querySelector(".time");
    if (time !== null) time.textContent = seconds > 0 ? `${(1000 * seconds).toFixed(seconds < 0.01 ? 1 : 0)} ms` : "";
  }

  /**
   * Colors boxes, each by a fraction from 0 to 1.
   * @param {Map<string, number>} shares
   */
  heat(shares) {
    for (const [name, share] of shares) this.parts.get(name)?.style.setProperty("--share", `${(100 * share).toFixed(1)}%`);
  }

  /**
   * Marks the chosen node.
   * @param {string | null} name
   */
  choose(name) {
    for (const [other, part] of this.parts) part.setAttribute("aria-current", String(other === name));
    this.parts.get(name ?? "")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
}
