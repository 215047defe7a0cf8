// Values as they are seen: drawn here, or, without WebGL, by the watch. One value is shown, and another may be pinned beside it.

import { Camera } from "./camera.js";
import { find } from "./element.js";
import { Painter, rangeOf } from "./painter.js";
import { Plot } from "./plot.js";
import { Pointer } from "./pointer.js";
import { Scene, columnsOf, fieldOf, isFlat } from "./scene.js";
import { Tools } from "./tools.js";

/** @typedef {import("./types").Viewed} Viewed */
/** @typedef {import("./types").Value} Value */

/** One value: the last that was told, and the last that can be drawn. */
export class Pane {
  /** @param {Viewed | null} viewed */
  constructor(viewed) {
    this.viewed = viewed;
    /** @type {Value | null} */
    this.value = null;
    /** @type {Scene | null} */
    this.scene = null;
    this.loading = false;
    /** Whether the camera was where it is when this was first seen. */
    this.isFramed = false;
    /** When the value was told, in milliseconds. */
    this.told = 0;
    /** Whether it stays as it is while the value changes. */
    this.held = false;
  }

  /** @param {Viewed | null} other */
  shows(other) {
    return this.viewed?.node === other?.node && this.viewed?.output === other?.output;
  }
}

/** Nothing but what is seen of a value by itself. */
const PLAIN = { paint: "own", wire: false, normals: false, isolines: false, extra: true, flat: true };

export class Viewer {
  /**
   * @param {HTMLElement} place where values are shown
   * @param {(views: Viewed[]) => void} ask says what is looked at
   * @param {(question: import("./types").Question) => Promise<any>} query asks what is under the pointer
   */
  constructor(place, ask, query) {
    this.ask = ask;
    this.query = query;
    this.main = new Pane(null);
    /** @type {Pane | null} */
    this.pinned = null;
    /** Where the wipe between both lies, from left to right; side by side without it. @type {number | null} */
    this.wipe = null;
    this.run = 0;
    this.camera = new Camera();
    /** The middle of a flat picture in shares of it, and how much larger than what just fits it is. */
    this.flat = { x: 0.5, y: 0.5, zoom: 1 };
    /** @type {import("./scene.js").Look} */
    this.look = { ...PLAIN };
    /** What the next click is for. @type {{kind: "color" | "pixel" | "place", done: (found: any) => void, say: (why: string) => void} | null} */
    this.wanting = null;
    this.asked = "";
    this.loadingPicture = false;
    /** @type {number | undefined} */
    this.frameId = undefined;
    this.tabs = find(place, ".tabs", HTMLElement);
    this.caption = find(place, ".caption", HTMLElement);
    this.side = find(place, ".side", HTMLElement);
    this.frame = find(place, ".frame", HTMLElement);
    this.picture = find(place, "img", HTMLImageElement);
    this.canvas = find(place, "canvas", HTMLCanvasElement);
    this.painter = Painter.on(this.canvas);
    this.canvas.hidden = this.painter === null;
    this.plot = new Plot(find(place, ".plot", HTMLElement));
    this.tools = new Tools(place, this);
    this.pointer = new Pointer(this);
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.painter?.restart();
      this.redraw();
    });
    new ResizeObserver(() => this.#resized()).observe(this.frame);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }

  /** What takes the keys. */
  get surface() {
    return this.painter === null ? this.picture : this.canvas;
  }

  get panes() {
    return this.pinned === null ? [this.main] : [this.pinned, this.main];
  }

  /** Whether what is shown now is a flat picture. */
  get isFlat() {
    const value = this.main.value;
    return value !== null && isFlat(value, this.look);
  }

  /**
   * Shows an output of a node; the others are one click away.
   * @param {string} node
   * @param {{name: string, type: string}[]} outputs
   * @param {string} [wanted] the output; the one that was shown before, or the first, if it has no such
   */
  show(node, outputs, wanted) {
    const old = this.main.viewed?.node === node ? this.main.viewed.output : undefined;
    const names = outputs.map((port) => port.name);
    const output = [wanted, old, names[0]].find((name) => name !== undefined && names.includes(name));
    this.tabs.replaceChildren(...outputs.map((port) => {
      const tab = document.createElement("button");
      tab.textContent = `${port.name}: ${port.type}`;
      tab.setAttribute("aria-pressed", String(port.name === output));
      tab.addEventListener("click", () => this.show(node, outputs, port.name));
      return tab;
    }));
    const viewed = output === undefined ? null : { node, output };
    if (!this.main.shows(viewed)) {
      this.#drop(this.main);
      this.main = new Pane(viewed);
      this.flat = { x: 0.5, y: 0.5, zoom: 1 };
      this.askAgain();
    }
    this.redraw();
  }

  /**
   * What an address names, whose camera is taken over; null if it names nothing.
   * @param {string} hash
   * @returns {Viewed | null}
   */
  address(hash) {
    const words = new URLSearchParams(hash.slice(1));
    const [node, output] = [words.get("view"), words.get("output")];
    if (node === null || output === null) return null;
    this.camera.take((words.get("camera") ?? "").split(",").map(Number));
    const [x, y, zoom] = (words.get("flat") ?? "").split(",").map(Number);
    if (zoom > 0 && Number.isFinite(x + y + zoom)) this.flat = { x, y, zoom };
    const paint = words.get("paint");
    const on = (words.get("look") ?? "").split(",");
    this.look = { paint: paint ?? "own", wire: on.includes("wire"), normals: on.includes("normals"), isolines: on.includes("isolines"), extra: !on.includes("bare"), flat: !on.includes("space") };
    const [pin, pinOutput] = [words.get("pin"), words.get("pinned")];
    if (pin !== null && pinOutput !== null) {
      this.pinned = new Pane({ node: pin, output: pinOutput });
      const wipe = Number(words.get("wipe") ?? NaN);
      if (wipe >= 0 && wipe <= 1) this.wipe = wipe;
    }
    return { node, output };
  }

  // Whoever opens the address again sees the same.
  #keepAddress() {
    const { viewed } = this.main;
    if (viewed === null) return;
    const put = (/** @type {string} */ name, /** @type {string} */ value) => `&${name}=${encodeURIComponent(value).replaceAll("%2C", ",")}`;
    let hash = `#view=${encodeURIComponent(viewed.node)}${put("output", viewed.output)}`;
    const on = Object.entries({ wire: this.look.wire, normals: this.look.normals, isolines: this.look.isolines, bare: !this.look.extra, space: !this.look.flat });
    const words = on.filter(([, is]) => is).map(([word]) => word);
    if (words.length > 0) hash += put("look", words.join());
    if (this.look.paint !== "own") hash += put("paint", this.look.paint);
    if (this.pinned?.viewed && !this.pinned.held) {
      hash += put("pin", this.pinned.viewed.node) + put("pinned", this.pinned.viewed.output);
      if (this.wipe !== null) hash += put("wipe", String(Number(this.wipe.toPrecision(3))));
    }
    const { x, y, zoom } = this.flat;
    if (x !== 0.5 || y !== 0.5 || zoom !== 1) hash += put("flat", [x, y, zoom].map((number) => Number(number.toPrecision(6))).join());
    hash += put("camera", this.camera.numbers().join());
    if (hash !== location.hash) history.replaceState(null, "", hash);
  }

  /** Says again what is looked at, to a watch that may not know it. */
  askAgain() {
    this.ask(this.panes.filter((pane) => !pane.held).flatMap((pane) => pane.viewed ?? []));
  }

  /**
   * A value that is looked at has changed.
   * @param {Value} value
   */
  hear(value) {
    for (const pane of this.panes.filter((pane) => pane.shows(value) && !pane.held)) {
      pane.value = value;
      pane.told = performance.now();
      this.#load(pane);
    }
    this.redraw();
  }

  /**
   * Another run has begun or ended: what is seen may be of an earlier one.
   * @param {number} run
   */
  at(run) {
    this.run = run;
    this.#caption();
  }

  /**
   * Gets what is missing of a pane's value, and then shows it at once; the last value, if there have been several meanwhile.
   * @param {Pane} pane
   */
  async #load(pane) {
    if (this.painter === null || pane.loading || pane.value === null) return;
    pane.loading = true;
    try {
      for (let again = true; again;) {
        const value = pane.value;
        const look = { ...this.look };
        const names = columnsOf(value, look);
        const old = pane.scene?.columns;
        const wanted = [...names].map(([place, name]) => ({ name, old: old?.get(place) ?? null }));
        const received = this.painter.columns.received;
        const take = await this.painter.columns.find(wanted);
        if (!this.panes.includes(pane)) return;
        const columns = take();
        again = columns === null || pane.value !== value || JSON.stringify(look) !== JSON.stringify(this.look);
        if (columns === null) {
          // What it was to be made of is gone: all of it then.
          pane.scene = null;
          continue;
        }
        const scene = new Scene(value, new Map([...names.keys()].map((place, at) => [place, columns[at]])));
        this.painter.columns.use(columns, [...(old?.values() ?? [])]);
        this.painter.upload(scene);
        // What the browser's own tools show of it, the last one alone.
        performance.clearMeasures("value");
        performance.measure("value", { start: pane.told, detail: { bytes: this.painter.columns.received - received } });
        pane.scene = scene;
        if (pane === this.main) this.#frame(scene, !pane.isFramed);
        pane.isFramed ||= scene.space !== null;
        this.redraw();
      }
    } catch {
      // The watch is gone, or has another value by now: it says so then.
    } finally {
      pane.loading = false;
    }
  }

  /**
   * A camera that does not see something else well goes where it does; while that changes it stays.
   * @param {Scene} scene
   * @param {boolean} isNew whether it is something else
   */
  #frame({ space }, isNew) {
    if (space === null) return;
    if (!isNew || this.camera.suits(space)) this.camera.stay(space);
    else this.camera.fit(space, ...this.room);
  }

  /** Shows all of it, from where the camera is. */
  fit() {
    this.flat = { x: 0.5, y: 0.5, zoom: 1 };
    this.camera.zoom = 1;
    const space = this.main.scene?.space;
    if (space) this.camera.fit(space, ...this.room);
    this.redraw();
  }

  /**
   * Turns about a place of a pane's value from now on.
   * @param {[number, number, number]} place
   */
  aim(place, pane = this.main) {
    const space = pane.scene?.space;
    if (!space) return;
    this.camera.aim(/** @type {[number, number, number]} */ (place.map((x, k) => space.up[k] * x)));
    this.redraw();
  }

  /** From the front. */
  front() {
    this.camera.reset();
    this.fit();
  }

  /**
   * Looks at values in another way.
   * @param {Partial<import("./scene.js").Look>} change
   */
  restyle(change) {
    Object.assign(this.look, change);
    for (const pane of this.panes) this.#load(pane);
    this.redraw();
  }

  /** @param {Pane} pane */
  #drop(pane) {
    this.painter?.columns.use([], [...(pane.scene?.columns.values() ?? [])]);
    pane.scene = null;
  }

  /**
   * Keeps what is shown beside what will be: it follows its value, or, `held`, stays as it is.
   * @param {boolean} held
   */
  pin(held) {
    if (this.pinned !== null) this.#drop(this.pinned);
    const { viewed, value, scene } = this.main;
    const pinned = Object.assign(new Pane(viewed), { value, scene, held });
    this.painter?.columns.use([...(scene?.columns.values() ?? [])], []);
    this.pinned = pinned;
    this.wipe = held ? 0.5 : null;
    this.#refit();
    this.askAgain();
    this.redraw();
  }

  unpin() {
    if (this.pinned === null) return;
    this.#drop(this.pinned);
    this.pinned = null;
    this.wipe = null;
    this.#refit();
    this.askAgain();
    this.redraw();
  }

  /** Puts both over each other, or beside each other. */
  toggleWipe() {
    if (this.pinned === null) this.pin(true);
    else this.wipe = this.wipe === null ? 0.5 : null;
    this.#refit();
    this.redraw();
  }

  /** Draws everything again, soon. */
  redraw() {
    this.#keepAddress();
    this.#caption();
    this.tools.show();
    this.plot.show(this.main.value?.series ?? null, this.pinned?.value?.series ?? []);
    if (this.painter === null) this.#askPicture();
    else this.frameId ??= requestAnimationFrame(() => this.#draw());
  }

  /**
   * The width and height in which the value is seen.
   * @returns {[number, number]}
   */
  get room() {
    const { width, height } = this.boxes(this.canvas.clientWidth, this.canvas.clientHeight).slice(-1)[0].box;
    return [width, height];
  }

  /** A camera that sees all of something still does when there is more or less room. */
  #refit() {
    const space = this.main.scene?.space;
    if (space && this.camera.fits) this.camera.fit(space, ...this.room);
  }

  #resized() {
    this.#refit();
    // A canvas of another size is empty until it is drawn.
    if (this.painter !== null) this.#draw();
    this.redraw();
  }

  /**
   * The parts of a surface of this size in which panes are drawn, and those in which they are seen.
   * @param {number} width
   * @param {number} height
   */
  boxes(width, height) {
    const all = { x: 0, y: 0, width, height };
    if (this.pinned === null) return [{ pane: this.main, box: all, clip: all }];
    const middle = Math.round(width * (this.wipe ?? 0.5));
    const left = { ...all, width: middle };
    const right = { ...all, x: middle, width: width - middle };
    if (this.wipe === null) return [{ pane: this.pinned, box: left, clip: left }, { pane: this.main, box: right, clip: right }];
    return [{ pane: this.pinned, box: all, clip: left }, { pane: this.main, box: all, clip: right }];
  }

  #draw() {
    if (this.frameId !== undefined) cancelAnimationFrame(this.frameId);
    this.frameId = undefined;
    const { painter, canvas } = this;
    if (painter === null || painter.gl.isContextLost()) return;
    const scale = Math.min(devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((size) => Math.max(1, Math.round(scale * size)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const range = this.range();
    for (const { pane, box, clip } of this.boxes(width, height)) {
      const scene = pane.scene;
      painter.begin(box, clip, scene !== null && scene.picture !== null);
      if (scene === null) continue;
      if (scene.picture !== null) painter.picture(scene, this.flatBox(scene.value, box.width, box.height));
      else painter.space(scene, this.camera, this.look, box, range);
    }
    canvas.dataset.shown = this.main.scene?.value.hash ?? "";
    canvas.dataset.run = String(this.main.scene?.value.run ?? "");
  }

  /** The range that colors stand for: that of the first shape which has the field. */
  range() {
    const fields = (this.main.value?.space?.shapes ?? []).flatMap((shape) => fieldOf(shape, this.look) ?? []);
    return fields.length > 0 ? { field: fields[0], ...rangeOf(fields[0]) } : null;
  }

  /**
   * Where a flat picture lies in a part of this size, in shares from -1 to 1: left, bottom, right, top.
   * @param {Value} value
   * @param {number} width
   * @param {number} height
   * @returns {[number, number, number, number]}
   */
  flatBox(value, width, height) {
    const size = value.picture?.size ?? [1, 1];
    const { x, y, zoom } = this.flat;
    const fit = Math.min(width / size[0], height / size[1]) * zoom;
    // As `render` puts it: whole pixels, a bar at the left not wider than that at the right.
    const [w, h] = size.map((side) => Math.max(1, Math.round(side * fit)));
    const left = x === 0.5 ? Math.floor((width - w) / 2) : Math.round(width / 2 - x * w);
    const top = y === 0.5 ? Math.floor((height - h) / 2) : Math.round(height / 2 - y * h);
    return [(2 * left) / width - 1, 1 - (2 * (top + h)) / height, (2 * (left + w)) / width - 1, 1 - (2 * top) / height];
  }

  /** Without WebGL the watch draws. */
  #askPicture() {
    const value = this.main.value;
    this.picture.hidden = value === null || !(value.picture || value.space);
    if (value === null || this.picture.hidden) return;
    const { clientWidth, clientHeight } = this.frame;
    const scale = Math.min(devicePixelRatio, 2);
    const [width, height] = [clientWidth, clientHeight].map((size) => Math.max(1, Math.round(scale * size)));
    const { yaw, pitch, zoom } = this.camera;
    const asked = { width, height, yaw, pitch, zoom, flat: this.isFlat };
    const words = Object.entries(asked).map(([name, word]) => `${name}=${word}`);
    this.asked = `/picture/${value.hash}?${words.join("&")}`;
    if (!this.loadingPicture) this.#loadPicture(this.asked);
  }

  /**
   * One picture at a time, and then the last that was asked for.
   * @param {string} source
   */
  #loadPicture(source) {
    this.loadingPicture = true;
    const next = new Image();
    const end = () => {
      this.loadingPicture = false;
      if (next.naturalWidth > 0) this.picture.src = next.src;
      if (this.asked !== source) this.#loadPicture(this.asked);
    };
    next.addEventListener("load", end);
    next.addEventListener("error", end);
    next.src = source;
  }

  /** From where what lies in space is seen, in words. */
  get direction() {
    const { yaw, pitch } = this.camera;
    const around = ((((Math.round(yaw) + 180) % 360) + 360) % 360) - 180;
    const sides = { 0: "from the front", 90: "from the right", "-90": "from the left", "-180": "from behind" };
    const side = sides[/** @type {keyof typeof sides} */ (around)] ?? `${Math.abs(around)}° to the ${around > 0 ? "right" : "left"}`;
    const above = Math.round(pitch);
    return above === 0 ? side : `${side}, ${Math.abs(above)}° ${above > 0 ? "above" : "below"}`;
  }

  #caption() {
    const { viewed, value } = this.main;
    let text = "";
    if (viewed !== null && value === null) text = `${viewed.node}.${viewed.output}: not there yet`;
    if (viewed !== null && value !== null) {
      const behind = Math.max(0, this.run - value.run);
      const age = value.live ? ", not in the file yet" : behind > 0 ? `, ${behind} ${behind === 1 ? "run" : "runs"} behind` : "";
      const seen = value.picture || value.space || value.series ? "" : ": nothing of it can be seen";
      text = `${viewed.node}.${viewed.output} of run ${value.run}${age}${seen}`;
      this.caption.dataset.behind = String(behind);
    }
    if (this.caption.textContent !== text) this.caption.textContent = text;
    const side = value === null || this.isFlat || !value.space ? "" : this.direction;
    if (this.side.textContent !== side) this.side.textContent = side;
    this.surface.setAttribute("aria-label", side === "" ? text : `${text}, ${side}`);
    this.picture.alt = text;
  }

  /**
   * What the next click on what is seen is for: a color, a pixel, or a place in mm.
   * @param {"color" | "pixel" | "place"} kind
   * @param {(found: any) => void} done
   * @param {(why: string) => void} say is told why a click has found nothing, and nothing once that does not matter any more
   */
  want(kind, done, say) {
    this.wanting = { kind, done, say };
    this.frame.dataset.wanting = kind;
    this.surface.focus();
  }

  stopWanting() {
    this.wanting?.say("");
    this.wanting = null;
    delete this.frame.dataset.wanting;
  }
}
