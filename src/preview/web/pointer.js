// Mouse, touch and keyboard input of the viewer: rotate, pan, zoom, wipe, pick, and ask what is under the pointer.

/** @typedef {import("./viewer.js").Viewer} Viewer */

/** The rotation in degrees by one pixel of dragging and by one press of an arrow key, and the zoom factor of one press of +. */
const [DEGREES_PER_PIXEL, DEGREES_PER_KEY, ZOOM_STEP] = [0.4, 15, 1.25];

/** A press that moves by fewer pixels is a click, not a drag. */
const MAX_CLICK_MOVE = 4;

export class Pointer {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    /**
     * The position of each pointer that is down, by its id.
     * @type {Map<number, {x: number, y: number}>}
     */
    this.down = new Map();
    this.moved = 0;
    this.wiping = false;
    this.asking = false;
    /** @type {PointerEvent | null} */
    this.next = null;
    this.isOver = false;
    for (const surface of [viewer.canvas, viewer.picture]) this.#listen(surface);
    // Listen on the document, so that keys work before the viewer has the focus.
    document.addEventListener("keydown", (event) => this.#key(event));
  }

  /**
   * The pane under the pointer, and the pointer's position in it, in pixels from its upper left corner.
   * @param {MouseEvent} event
   */
  #locate(event) {
    const { viewer } = this;
    const area = viewer.surface.getBoundingClientRect();
    const [x, y] = [event.clientX - area.left, event.clientY - area.top];
    const boxes = viewer.boxes(area.width, area.height);
    const found = boxes.find(({ clip }) => x >= clip.x && x < clip.x + clip.width) ?? boxes[boxes.length - 1];
    return { ...found, x: x - found.box.x, y, width: found.box.width, height: found.box.height };
  }

  /**
   * Moves a flat picture by pixels, or zooms it about the pointer.
   * @param {{pane: import("./viewer.js").Pane, x: number, y: number, width: number, height: number}} at
   * @param {number} right
   * @param {number} down
   */
  #moveFlat(at, right, down, nearer = 1) {
    const { viewer } = this;
    const value = at.pane.value;
    if (!value?.picture) return;
    const box = viewer.flatBox(value, at.width, at.height);
    const [w, h] = [((box[2] - box[0]) * at.width) / 2, ((box[3] - box[1]) * at.height) / 2];
    const { x, y, zoom } = viewer.flat;
    const larger = Math.max(0.1, Math.min(400, zoom * nearer)) / zoom;
    // The point under the pointer stays in its position.
    const from = [(at.x - at.width / 2) / w, (at.y - at.height / 2) / h];
    viewer.flat = { x: x - right / w + from[0] * (1 - 1 / larger), y: y - down / h + from[1] * (1 - 1 / larger), zoom: zoom * larger };
    viewer.redraw();
  }

  /** @param {HTMLElement} surface */
  #listen(surface) {
    const { viewer, down } = this;
    surface.addEventListener("pointerdown", (event) => {
      surface.setPointerCapture(event.pointerId);
      event.preventDefault();
      surface.focus();
      if (down.size === 0) this.moved = 0;
      down.set(event.pointerId, { x: event.clientX, y: event.clientY });
      this.wiping = down.size === 1 && this.#isOnWipe(event);
    });
    surface.addEventListener("pointermove", (event) => {
      if (down.has(event.pointerId)) this.#drag(event);
      else this.#probe(event);
    });
    for (const end of /** @type {const} */ (["pointerup", "pointercancel"])) {
      surface.addEventListener(end, (event) => {
        const was = down.delete(event.pointerId);
        if (was && end === "pointerup" && this.moved < MAX_CLICK_MOVE) this.#click(event);
      });
    }
    surface.addEventListener("pointerleave", () => {
      this.next = null;
      this.isOver = false;
      viewer.tools.showProbe("");
    });
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    surface.addEventListener("dblclick", (event) => this.#centerOn(event));
    surface.addEventListener("wheel", (event) => {
      event.preventDefault();
      const nearer = Math.exp(-event.deltaY / 500);
      if (viewer.isFlat) return this.#moveFlat(this.#locate(event), 0, 0, nearer);
      viewer.camera.turn(0, 0, nearer);
      viewer.redraw();
    }, { passive: false });
  }

  /** @param {PointerEvent} event */
  #drag(event) {
    const { viewer, down } = this;
    const before = [...down.values()];
    const last = /** @type {{x: number, y: number}} */ (down.get(event.pointerId));
    const [right, below] = [event.clientX - last.x, event.clientY - last.y];
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.moved += Math.abs(right) + Math.abs(below);
    const at = this.#locate(event);
    if (this.wiping) {
      const area = viewer.surface.getBoundingClientRect();
      viewer.wipe = Math.max(0, Math.min(1, (event.clientX - area.left) / area.width));
      return viewer.redraw();
    }
    let [share, nearer] = [1, 1];
    if (down.size === 2) {
      const distance = (/** @type {{x: number, y: number}[]} */ [a, b]) => Math.max(1, Math.hypot(a.x - b.x, a.y - b.y));
      nearer = distance([...down.values()]) / distance(before);
      share = 0.5;
    }
    if (viewer.isFlat) return this.#moveFlat(at, share * right, share * below, nearer);
    const isPan = down.size === 2 || event.shiftKey || (event.buttons & 6) !== 0;
    if (isPan) {
      const half = Math.min(at.width, at.height) / 2;
      viewer.camera.pan((share * right) / half, (-share * below) / half);
      viewer.camera.turn(0, 0, nearer);
    } else viewer.camera.turn(-DEGREES_PER_PIXEL * right, DEGREES_PER_PIXEL * below);
    viewer.redraw();
  }

  /** @param {PointerEvent} event */
  #isOnWipe(event) {
    const { wipe } = this.viewer;
    const area = this.viewer.surface.getBoundingClientRect();
    return wipe !== null && Math.abs(event.clientX - area.left - wipe * area.width) < 12;
  }

  /**
   * The question about the point under the pointer, or null if there is nothing to ask about.
   * @param {MouseEvent} event
   * @returns {import("./types").Question | null}
   */
  #question(event) {
    const { viewer } = this;
    const at = this.#locate(event);
    const { viewed, value, scene, held } = at.pane;
    if (viewed === null || value === null || held) return null;
    if (viewer.isFlat && value.picture) {
      const box = viewer.flatBox(value, at.width, at.height);
      const share = [((2 * at.x) / at.width - 1 - box[0]) / (box[2] - box[0]), (box[3] - 1 + (2 * at.y) / at.height) / (box[3] - box[1])];
      const pixel = value.picture.size.map((size, k) => Math.floor(size * share[k]));
      if (pixel.some((at, k) => at < 0 || at >= (value.picture?.size[k] ?? 0))) return null;
      const { capture } = value.picture;
      const seen = capture === null ? pixel : pixel.map((cell, k) => Math.round(cell * capture.scale[k] + capture.offset[k]));
      return { ask: "probe", ...viewed, at: /** @type {[number, number]} */ (seen) };
    }
    if (!scene?.space) return null;
    const place = /** @type {[number, number]} */ ([(2 * at.x) / at.width - 1, 1 - (2 * at.y) / at.height]);
    const { origin, direction, radius } = viewer.camera.ray(scene.space, place, at.width, at.height);
    return { ask: "pick", ...viewed, origin, direction, radius: 6 * radius };
  }

  /**
   * Shows what is under the pointer. Moves during a pending question are merged: only the last one is asked next.
   * @param {PointerEvent} event
   */
  async #probe(event) {
    this.isOver = true;
    if (this.asking) {
      this.next = event;
      return;
    }
    const question = this.#question(event);
    if (question === null) return this.viewer.tools.showProbe("");
    this.asking = true;
    const answer = await this.viewer.query(question);
    this.asking = false;
    this.viewer.tools.showProbe(answer === null || !this.isOver ? "" : describeAnswer(question, answer));
    const { next } = this;
    this.next = null;
    if (next !== null) this.#probe(next);
  }

  /** @param {MouseEvent} event */
  async #centerOn(event) {
    const question = this.#question(event);
    const { pane } = this.#locate(event);
    const answer = question?.ask === "pick" ? await this.viewer.query(question) : null;
    if (answer?.at) this.viewer.aim(answer.at, pane);
  }

  /**
   * Answers a pending pick (`Viewer.want`) with what is under the pointer.
   * @param {MouseEvent} event
   */
  async #click(event) {
    const { wanting } = this.viewer;
    if (!wanting) return;
    const question = this.#question(event);
    const answer = question && (await this.viewer.query(question));
    if (this.viewer.wanting !== wanting) return;
    // For a mesh, the answer contains the color and the pixel of the mesh's texture.
    const pixel = question?.ask === "probe" ? question.at : answer?.pixel;
    const color = question?.ask === "probe" ? colorOf(answer?.facts) : answer?.color;
    const found = { color, pixel, place: answer?.at }[wanting.kind];
    if (!found) return wanting.say({ color: "there is no color here: click on a picture or a colored mesh", pixel: "there is no pixel here: click on a picture or a textured mesh", place: "there is no position here: click on an object in the 3D view" }[wanting.kind]);
    this.viewer.stopWanting();
    wanting.done(found);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const { viewer } = this;
    const target = event.target instanceof Element ? event.target : document.body;
    const isTaken = event.defaultPrevented || target.matches("input, select, textarea") || document.querySelector("dialog[open]") !== null;
    if (isTaken || event.ctrlKey || event.metaKey || event.altKey) return;
    /** @type {Record<string, [number, number]>} */
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    // Outside of the viewer, arrows scroll.
    const isOutside = target !== document.body && !viewer.surface.contains(target);
    const arrow = arrows[event.key];
    if (arrow && isOutside) return;
    if (arrow) {
      const size = 40;
      const area = viewer.surface.getBoundingClientRect();
      if (viewer.isFlat) this.#moveFlat(this.#locate(new MouseEvent("key", { clientX: area.left, clientY: area.top })), -size * arrow[0], size * arrow[1]);
      else if (event.shiftKey) viewer.camera.pan(-0.2 * arrow[0], -0.2 * arrow[1]);
      else viewer.camera.turn(DEGREES_PER_KEY * arrow[0], DEGREES_PER_KEY * arrow[1]);
      event.preventDefault();
      return viewer.redraw();
    }
    const nearer = (/** @type {number} */ share) => {
      if (viewer.isFlat) viewer.flat.zoom *= share;
      else viewer.camera.turn(0, 0, share);
      viewer.redraw();
    };
    /** @type {Record<string, () => void>} */
    const keys = {
      "+": () => nearer(ZOOM_STEP),
      "-": () => nearer(1 / ZOOM_STEP),
      "0": () => viewer.front(),
      f: () => viewer.fit(),
      p: () => viewer.pin(false),
      h: () => viewer.pin(true),
      x: () => viewer.toggleWipe(),
      u: () => viewer.unpin(),
      ...viewer.tools.keys(),
    };
    const act = keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}

/**
 * @param {Record<string, any>} [facts]
 * @returns {string | undefined} the color among them
 */
function colorOf(facts = {}) {
  return Object.values(facts).find((fact) => /^#[0-9a-f]{6}$/i.test(String(fact)));
}

const number = (/** @type {any} */ x) => (typeof x === "number" ? String(Number(x.toPrecision(6))) : String(x));
const numbers = (/** @type {any} */ list) => [list].flat().map(number).join(", ");

/**
 * @param {import("./types").Question} question
 * @param {any} answer
 */
function describeAnswer(question, answer) {
  const formatFacts = (/** @type {Record<string, any>} */ facts = {}) => Object.entries(facts).map(([name, fact]) => `${name} ${numbers(fact)}`);
  if (question.ask === "probe") return answer.why ?? [`pixel ${question.at.join(", ")}`, ...formatFacts(answer.facts)].join("   ");
  if (answer.nothing) return "";
  const { at, face, vertex, pixel } = answer;
  const parts = [`at ${numbers(at)} mm`, ...(face === undefined ? [] : [`face ${face}`]), `vertex ${vertex}`, ...(pixel ? [`pixel ${numbers(pixel)}`] : [])];
  return [...parts, ...formatFacts(answer.attributes), ...formatFacts(answer.corner_attributes), ...formatFacts(answer.face_attributes)].join("   ");
}
