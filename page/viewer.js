// Values as they are seen: a picture from the watch, turned by dragging.

/** Degrees that one pixel of dragging turns, and one press of an arrow key. */
const [DRAG, KEY] = [0.4, 15];

export class Viewer {
  /**
   * @param {HTMLElement} place where the picture is shown
   * @param {(views: {node: string, output: string}[]) => void} ask says what is looked at
   */
  constructor(place, ask) {
    this.ask = ask;
    this.viewed = null;
    this.value = null;
    this.run = 0;
    this.camera = { yaw: 0, pitch: 0, zoom: 1 };
    this.tabs = place.querySelector(".tabs");
    this.caption = place.querySelector(".caption");
    this.picture = place.querySelector("img");
    this.#listen();
  }

  /** Shows an output of a node; the others are one click away. */
  show(node, outputs, wanted) {
    const old = this.viewed?.node === node ? this.viewed.output : undefined;
    const names = outputs.map((port) => port.name);
    const output = [wanted, old, names[0]].find((name) => names.includes(name));
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

  /** What an address names, whose camera is taken over; null if it names nothing. */
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

  /** A value that is looked at has changed. */
  hear(value) {
    if (value.node !== this.viewed?.node || value.output !== this.viewed?.output) return;
    this.value = value;
    this.#draw();
  }

  /** Another run has begun or ended: what is seen may be of an earlier one. */
  at(run) {
    this.run = run;
    this.#caption();
  }

  #draw() {
    this.#keepAddress();
    this.#caption();
    const value = this.value;
    const isSeen = value !== null && (value.flat || value.lies);
    this.picture.hidden = !isSeen;
    if (!isSeen) return;
    const { clientWidth, clientHeight } = this.picture.parentElement;
    const scale = Math.min(devicePixelRatio, 2);
    const [width, height] = [clientWidth, clientHeight].map((size) => Math.max(1, Math.round(scale * size)));
    const asked = new URLSearchParams({ width, height, ...this.camera, flat: value.flat });
    const source = `/picture/${value.hash}?${asked}`;
    this.wanted = source;
    if (this.loading) return;
    this.#load(source);
  }

  // One picture at a time, and then the last that was asked for.
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
      const turns = { ArrowLeft: [-KEY, 0], ArrowRight: [KEY, 0], ArrowUp: [0, KEY], ArrowDown: [0, -KEY], "+": [0, 0, 1.25], "-": [0, 0, 0.8], "0": null };
      if (!(event.key in turns)) return;
      event.preventDefault();
      if (turns[event.key] === null) this.camera = { yaw: 0, pitch: 0, zoom: 1 };
      this.#turn(...(turns[event.key] ?? [0, 0]));
    });
    new ResizeObserver(() => this.#draw()).observe(picture.parentElement);
  }
}
