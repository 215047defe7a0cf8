// The view of values, drawn here or, without WebGL, by `maquette watch`. One value is shown, and another one may be pinned beside it.

import { Camera } from "./camera.js";
import { find } from "./element.js";
import { Painter, rangeOf } from "./painter.js";
import { Plot } from "./plot.js";
import { Pointer } from "./pointer.js";
import { Scene, columnsOf, fieldOf, isFlat } from "./scene.js";
import { Tools } from "./tools.js";

/** @typedef {import("./types").Viewed} Viewed */
/** @typedef {import("./types").Value} Value */

/** The view of one output: its latest value, and its latest value that is ready to be drawn. */
export class Pane {
  /** @param {Viewed | null} viewed */
  constructor(viewed) {
    this.viewed = viewed;
    /** @type {Value | null} */
    this.value = null;
    /** @type {Scene | null} */
    this.scene = null;
    this.loading = false;
    /** True once the camera has been adjusted to the first scene of this pane. */
    this.isFramed = false;
    /** The time at which the value was received, in milliseconds. */
    this.receivedAt = 0;
    /** True if the pane keeps its value when the output changes. */
    this.held = false;
  }

  /** @param {Viewed | null} other */
  shows(other) {
    return this.viewed?.node === other?.node && this.viewed?.output === other?.output;
  }
}

/** The display options at the start. */
const DEFAULT_LOOK = { paint: "own", wire: false, normals: false, isolines: false, extra: true, flat: true };

export class Viewer {
  /**
   * @param {HTMLElement} place the section of the viewer
   * @param {(views: Viewed[]) => void} ask sends the outputs that are viewed
   * @param {(question: import("./types").Question) => Promise<any>} query sends a question about the point under the pointer
   */
  constructor(place, ask, query) {
    this.ask = ask;
    this.query = query;
    this.main = new Pane(null);
    /** @type {Pane | null} */
    this.pinned = null;
    /** The position of the wipe between both panes, from 0 (left) to 1; null if the panes are side by side. @type {number | null} */
    this.wipe = null;
    this.run = 0;
    this.camera = new Camera();
    /** The point of a flat picture in the middle of the view, in fractions of the picture, and its zoom relative to the fitted size. */
    this.flat = { x: 0.5, y: 0.5, zoom: 1 };
    /** @type {import("./scene.js").Look} */
    this.look = { ...DEFAULT_LOOK };
    /**
     * The pending pick that the next click answers.
     * @type {{kind: "color" | "pixel" | "place", done: (found: any) => void, say: (why: string) => void} | null}
     */
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

  /** The element that receives mouse, touch and keyboard input. */
  get surface() {
    return this.painter === null ? this.picture : this.canvas;
  }

  get panes() {
    return this.pinned === null ? [this.main] : [this.pinned, this.main];
  }

  /** True if the value is displayed as a flat picture. */
  get isFlat() {
    const value = this.main.value;
    return value !== null && isFlat(value, this.look);
  }

  /**
   * Shows an output of a node, and a tab for each output.
   * @param {string} node
   * @param {{name: string, type: string}[]} outputs
   * @param {string} [wanted] the output; if the node has no such output, the one shown before, or the first one
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
   * Restores the view from the page's address; returns the output that it names, or null.
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

  // Writes the view into the page's address, so that reloading restores it.
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

  /** Tells the server which outputs are viewed. Called after these have changed, and after the server was restarted. */
  askAgain() {
    this.ask(this.panes.filter((pane) => !pane.held).flatMap((pane) => pane.viewed ?? []));
  }

  /**
   * Takes a new value of a viewed output.
   * @param {Value} value
   */
  receive(value) {
    for (const pane of this.panes.filter((pane) => pane.shows(value) && !pane.held)) {
      pane.value = value;
      pane.receivedAt = performance.now();
      this.#load(pane);
    }
    this.redraw();
  }

  /**
   * Sets the number of the current run; the caption says if the displayed value is older.
   * @param {number} run
   */
  setRun(run) {
    this.run = run;
    this.#caption();
  }

  /**
   * Requests the missing columns of a pane's value and then displays it. If newer values arrive meanwhile, only the last one follows.
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
          // The old column to which a change applies is gone: request whole columns.
          pane.scene = null;
          continue;
        }
        const scene = new Scene(value, new Map([...names.keys()].map((place, at) => [place, columns[at]])));
        this.painter.columns.use(columns, [...(old?.values() ?? [])]);
        this.painter.upload(scene);
        // For the browser's developer tools and the benchmarks; only the last measure is kept.
        performance.clearMeasures("value");
        performance.measure("value", { start: pane.receivedAt, detail: { bytes: this.painter.columns.received - received } });
        pane.scene = scene;
        if (pane === this.main) this.#frame(scene, !pane.isFramed);
        pane.isFramed ||= scene.space !== null;
        this.redraw();
      }
    } catch {
      // Ignore the error: the server is gone, or it has a newer value and will send a message about that.
    } finally {
      pane.loading = false;
    }
  }

  /**
   * Fits the camera to a new value unless the value is well visible already. The camera stays when the same output changes.
   * @param {Scene} scene
   * @param {boolean} isNew true for the first scene of a pane
   */
  #frame({ space }, isNew) {
    if (space === null) return;
    if (!isNew || this.camera.fitsWell(space)) this.camera.stay(space);
    else this.camera.fit(space, ...this.room);
  }

  /** Fits the value into the view, without a change of direction. */
  fit() {
    this.flat = { x: 0.5, y: 0.5, zoom: 1 };
    this.camera.zoom = 1;
    const space = this.main.scene?.space;
    if (space) this.camera.fit(space, ...this.room);
    this.redraw();
  }

  /**
   * Makes a point of a pane's value the center of the view and of rotation.
   * @param {[number, number, number]} position
   */
  aim(position, pane = this.main) {
    const space = pane.scene?.space;
    if (!space) return;
    this.camera.aim(/** @type {[number, number, number]} */ (position.map((x, k) => space.up[k] * x)));
    this.redraw();
  }

  /** Fits the value into the view, seen from the front. */
  front() {
    this.camera.reset();
    this.fit();
  }

  /**
   * Changes display options.
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
   * Pins the shown output beside the main pane. The pinned pane follows its output, or keeps its value if `held`.
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

  /** Switches between wipe and side by side; pins the shown value first if nothing is pinned. */
  toggleWipe() {
    if (this.pinned === null) this.pin(true);
    else this.wipe = this.wipe === null ? 0.5 : null;
    this.#refit();
    this.redraw();
  }

  /** Updates the page around the view, and draws the view in the next frame. */
  redraw() {
    this.#keepAddress();
    this.#caption();
    this.tools.show();
    this.plot.show(this.main.value?.series ?? null, this.pinned?.value?.series ?? []);
    if (this.painter === null) this.#askPicture();
    else this.frameId ??= requestAnimationFrame(() => this.#draw());
  }

  /**
   * The width and height of the main pane.
   * @returns {[number, number]}
   */
  get room() {
    const { width, height } = this.boxes(this.canvas.clientWidth, this.canvas.clientHeight).slice(-1)[0].box;
    return [width, height];
  }

  /** Called after the size of the view has changed. If the camera was fitted to the value, fits it again. */
  #refit() {
    const space = this.main.scene?.space;
    if (space && this.camera.fits) this.camera.fit(space, ...this.room);
  }

  #resized() {
    this.#refit();
    // Draw at once, because a canvas is cleared when its size changes.
    if (this.painter !== null) this.#draw();
    this.redraw();
  }

  /**
   * The `box` in which each pane is drawn in a view of this size, and the visible part `clip` of each box.
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

  /** The range of the legend: that of the first shape with the displayed field; null if no field is displayed. */
  range() {
    const fields = (this.main.value?.space?.shapes ?? []).flatMap((shape) => fieldOf(shape, this.look) ?? []);
    return fields.length > 0 ? { field: fields[0], ...rangeOf(fields[0]) } : null;
  }

  /**
   * The box of a flat picture in a view of this size, in clip space from -1 to 1: left, bottom, right, top.
   * @param {Value} value
   * @param {number} width
   * @param {number} height
   * @returns {[number, number, number, number]}
   */
  flatBox(value, width, height) {
    const size = value.picture?.size ?? [1, 1];
    const { x, y, zoom } = this.flat;
    const fit = Math.min(width / size[0], height / size[1]) * zoom;
    // The same position as in `maquette render`: whole pixels, and the left margin is not wider than the right one.
    const [w, h] = size.map((side) => Math.max(1, Math.round(side * fit)));
    const left = x === 0.5 ? Math.floor((width - w) / 2) : Math.round(width / 2 - x * w);
    const top = y === 0.5 ? Math.floor((height - h) / 2) : Math.round(height / 2 - y * h);
    return [(2 * left) / width - 1, 1 - (2 * (top + h)) / height, (2 * (left + w)) / width - 1, 1 - (2 * top) / height];
  }

  /** Without WebGL, requests a picture that `maquette watch` draws. */
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
   * Loads a picture. Of the pictures that are requested during the loading, only the last one is loaded next.
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

  /** The direction of the camera, in words. */
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
    if (viewed !== null && value === null) text = `${viewed.node}.${viewed.output}: not computed yet`;
    if (viewed !== null && value !== null) {
      const behind = Math.max(0, this.run - value.run);
      const age = value.live ? ", not in the file yet" : behind > 0 ? `, ${behind} ${behind === 1 ? "run" : "runs"} behind` : "";
      const seen = value.picture || value.space || value.series ? "" : ": this type of value has no picture";
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
   * Starts picking: the next click into the view gives a color, a pixel, or a position in mm.
   * @param {"color" | "pixel" | "place"} kind
   * @param {(found: any) => void} done
   * @param {(why: string) => void} say is called with the reason why a click has found nothing, and with "" at the end
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
