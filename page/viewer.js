// Values as they are seen: a picture from the watch, turned by dragging.

/** Degrees that one pixel of dragging turns, and one press of an arrow key. */
const [DRAG, KEY] = [0.4, 15];

import { find } from "./element.js";

/** @typedef {import("./types").Viewed} Viewed */

export class Viewer {
  /**
   * @param {HTMLElement} place where the picture is shown
   * @param {(views: Viewed[]) => void} ask says what is looked at
   */
  constructor(place, ask) {
    this.ask = ask;
    /** @type {Viewed | null} */
    this.viewed = null;
    /** @type {import("./types").Value | null} */
    this.value = null;
    this.run = 0;
    this.wanted = "";
    this.loading = false;
    this.camera = { yaw: 0, pitch: 0, zoom: 1 };
    this.tabs = find(place, ".tabs", HTMLElement);
    this.caption = find(place, ".caption", HTMLElement);
    this.frame = find(place, ".frame", HTMLElement);
    this.picture = find(place, "img", HTMLImageElement);
    this.#listen();
  }

  /**
   * Shows an output of a node; the others are one click away.
   * @param {string} node
   * @param {{name: string, type: string}[]} outputs
   * @param {string} [wanted] the output; the one that was shown before, or the first, if it has no such
   */
  show(node, outputs, wanted) {
    const old = this.viewed?.node === node ? this.viewed.output : undefined;
    const names = outputs.map((port) => port.name);
    const output = [wanted, old, names[0]].find((name) => name !== undefined && names.includes(name));
    this.tabs.replaceChildren(...outputs.map((port) => {
      const tab = document.createElement("button");
      tab.textContent = `${port.name}: ${port.type}`;
      tab.setAttribute("aria-pressed", String(port.name === output));
      tab.addEventListener("click", () => this.show(node, outputs, port.name));
      return tab;
    }));
    const isNew = this.viewed?.node !== node || this.viewed?.output !== output;
    this.viewed = output === undefined ? null : { node, output };
    if (isNew) {
      this.value = null;
      this.ask(this.viewed === null ? [] : [this.viewed]);
    }
    this.#draw();
  }

  /**
   * What an address names, whose camera is taken over; null if it names nothing.
   * @param {string} hash
   * @returns {Viewed | null}
   */
  address(hash) {
    const [, node, output, camera] = /^#view=([^&]*)&output=([^&]*)&camera=([^&]*)$/.exec(hash) ?? [];
    if (node === undefined) return null;
    const [yaw, pitch, zoom] = camera.split(",").map(Number);
    if ([yaw, pitch, zoom].every(Number.isFinite)) this.camera = { yaw, pitch, zoom };
    return { node: decodeURIComponent(node), output: decodeURIComponent(output) };
  }

  // Whoever opens the address again sees the same.
  #keepAddress() {
    if (this.viewed === null) return;
    const [node, output] = [this.viewed.node, this.viewed.output].map(encodeURIComponent);
    const camera = Object.values(this.camera).map((number) => Number(number.toFixed(3)));
    history.replaceState(null, "", `#view=${node}&output=${output}&camera=${camera}`);
  }

  /** Says again what is looked at, to a watch that may not know it. */
  askAgain() {
    this.ask(this.viewed === null ? [] : [this.viewed]);
  }

  /**
   * A value that is looked at has changed.
   * @param {import("./types").Value} value
   */
  hear(value) {
    if (value.node !== this.viewed?.node || value.output !== this.viewed?.output) return;
    this.value = value;
    this.#draw();
  }

  /**
   * Another run has begun or ended: what is seen may be of an earlier one.
   * @param {number} run
   */
  at(run) {
    this.run = run;
    this.#caption();
  }

  #draw() {
    this.#keepAddress();
    this.#caption();
    const value = this.value;
    this.picture.hidden = value === null || !(value.flat || value.lies);
    if (value === null || this.picture.hidden) return;
    const { clientWidth, clientHeight } = this.frame;
    const scale = Math.min(devicePixelRatio, 2);
    const [width, height] = [clientWidth, clientHeight].map((size) => Math.max(1, Math.round(scale * size)));
    const { yaw, pitch, zoom } = this.camera;
    const asked = { width, height, yaw, pitch, zoom, flat: value.flat };
    const words = Object.entries(asked).map(([name, word]) => `${name}=${word}`);
    const source = `/picture/${value.hash}?${words.join("&")}`;
    this.wanted = source;
    if (this.loading) return;
    this.#load(source);
  }

  /**
   * One picture at a time, and then the last that was asked for.
   * @param {string} source
   */
  #load(source) {
    this.loading = true;
    const next = new Image();
    const end = () => {
      this.loading = false;
      if (next.naturalWidth > 0) this.picture.src = next.src;
      if (this.wanted !== source) this.#load(this.wanted);
    };
    next.addEventListener("load", end);
    next.addEventListener("error", end);
    next.src = source;
  }

  #caption() {
    const { viewed, value } = this;
    if (viewed === null) this.caption.textContent = "";
    else if (value === null) this.caption.textContent = `${viewed.node}.${viewed.output}: not there yet`;
    else {
      const behind = this.run - value.run;
      const age = behind > 0 ? `, ${behind} ${behind === 1 ? "run" : "runs"} behind` : "";
      const seen = value.flat || value.lies ? "" : ": nothing of it can be seen";
      this.caption.textContent = `${viewed.node}.${viewed.output} of run ${value.run}${age}${seen}`;
      this.caption.dataset.behind = String(behind);
    }
    this.picture.alt = this.caption.textContent;
  }

  /**
   * Walks around what is seen, in degrees, and nearer to it.
   * @param {number} right
   * @param {number} up
   */
  #turn(right, up, nearer = 1) {
    if (this.value === null || this.value.flat) return;
    const { yaw, pitch, zoom } = this.camera;
    this.camera = {
      yaw: yaw + right,
      pitch: Math.max(-90, Math.min(90, pitch + up)),
      zoom: Math.max(0.1, Math.min(100, zoom * nearer)),
    };
    this.#draw();
  }

  #listen() {
    const { picture } = this;
    picture.addEventListener("pointerdown", (event) => {
      picture.setPointerCapture(event.pointerId);
      event.preventDefault();
      picture.focus();
    });
    picture.addEventListener("pointermove", (event) => {
      if (picture.hasPointerCapture(event.pointerId)) this.#turn(-DRAG * event.movementX, DRAG * event.movementY);
    });
    picture.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#turn(0, 0, Math.exp(-event.deltaY / 500));
    });
    picture.addEventListener("keydown", (event) => {
      /** @type {Record<string, [number, number, number?] | null>} */
      const turns = { ArrowLeft: [-KEY, 0], ArrowRight: [KEY, 0], ArrowUp: [0, KEY], ArrowDown: [0, -KEY], "+": [0, 0, 1.25], "-": [0, 0, 0.8], "0": null };
      if (!(event.key in turns)) return;
      event.preventDefault();
      const turn = turns[event.key];
      if (turn === null) this.camera = { yaw: 0, pitch: 0, zoom: 1 };
      this.#turn(...(turn ?? [0, 0]));
    });
    new ResizeObserver(() => this.#draw()).observe(this.frame);
  }
}
