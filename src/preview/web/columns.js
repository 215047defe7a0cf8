// Columns of bytes from the watch. What is here is not asked for again, and of what has changed only the parts that did.

/** Of columns that nobody uses any more so many times the bytes of those in use are kept, and so many bytes in any case. */
const [TIMES, LEAST] = [2, 16 * 2 ** 20];

/** Changed parts so near to each other are copied as one: a graphics card takes long for many. */
const NEAR = 2 ** 16;

/** The type of an answer that says what has changed. */
const CHANGES = "application/x-maquette-changes";

/** A column: its bytes, and the graphics card's copy of them. */
export class Column {
  /**
   * @param {string} name
   * @param {Uint8Array} bytes
   */
  constructor(name, bytes) {
    this.name = name;
    this.bytes = bytes;
    this.users = 0;
    /** @type {WebGLBuffer | WebGLTexture | null} */
    this.copy = null;
    /**
     * Parts that the copy does not have yet: from where to where.
     * @type {[number, number][]}
     */
    this.stale = [];
  }

  get floats() {
    return new Float32Array(this.bytes.buffer);
  }

  get numbers() {
    return new Uint32Array(this.bytes.buffer);
  }
}

/**
 * @typedef {{name: string, bytes: ArrayBuffer, isChange: boolean, from: string, old: Column | null}} Answer
 */

/**
 * @param {string} name
 * @param {Column | null} old what is shown in its place
 * @returns {Promise<Answer>}
 */
function ask(name, old) {
  // Several times as fast as `fetch` with large answers.
  const request = new XMLHttpRequest();
  const from = old?.name ?? "";
  return new Promise((done, fail) => {
    request.open("GET", `/column/${name}${from && `?from=${from}`}`);
    request.responseType = "arraybuffer";
    request.addEventListener("load", () => {
      if (request.status !== 200) fail(new Error(`there is no column ${name}`));
      else done({ name, bytes: request.response, isChange: request.getResponseHeader("content-type") === CHANGES, from, old });
    });
    request.addEventListener("error", () => fail(new Error("the watch is gone")));
    request.send();
  });
}

export class Columns {
  /** @param {(column: Column) => void} free is called with those that go */
  constructor(free) {
    this.free = free;
    /**
     * By name, the one that was used last at the end.
     * @type {Map<string, Column>}
     */
    this.all = new Map();
    /** Bytes that came from the watch. */
    this.received = 0;
  }

  /**
   * Finds columns. Calling the result gives them, in the order of the names, or nothing if what one of them is to be made of is not
   * there any more; till then nothing that is shown changes.
   * @param {{name: string, old: Column | null}[]} wanted
   * @returns {Promise<() => Column[] | null>}
   */
  async find(wanted) {
    const missing = wanted.filter(({ name }, at) => !this.all.has(name) && wanted.findIndex((other) => other.name === name) === at);
    const answers = await Promise.all(missing.map(({ name, old }) => ask(name, old)));
    return () => {
      if (answers.some(({ isChange, from, old }) => isChange && old?.name !== from)) return null;
      for (const answer of answers) this.#take(answer);
      return wanted.map(({ name }) => {
        const column = this.all.get(name);
        if (column === undefined) throw new Error(`there is no column ${name}`);
        this.all.delete(name);
        this.all.set(name, column);
        return column;
      });
    };
  }

  /** @param {Answer} answer */
  #take({ name, bytes, isChange, old }) {
    this.received += bytes.byteLength;
    if (this.all.has(name)) return;
    if (!isChange || old === null) {
      this.all.set(name, new Column(name, new Uint8Array(bytes)));
      return;
    }
    const [size, count] = new Uint32Array(bytes, 0, 2);
    const places = new Uint32Array(bytes, 8, count);
    // Where nobody else shows it the old column becomes the new one.
    let column = old;
    if (old.users > 1) column = new Column(name, old.bytes.slice());
    else this.all.delete(old.name);
    column.name = name;
    this.all.set(name, column);
    let from = 8 + 4 * count;
    for (const place of places) {
      const start = size * place;
      const part = new Uint8Array(bytes, from, Math.min(size, column.bytes.length - start));
      column.bytes.set(part, start);
      from += part.length;
      const last = column.stale.at(-1);
      if (last && last[1] <= start && start - last[1] <= NEAR) last[1] = start + part.length;
      else column.stale.push([start, start + part.length]);
    }
  }

  /**
   * These are used once more, those once less.
   * @param {Column[]} more
   * @param {Column[]} less
   */
  use(more, less) {
    for (const column of more) column.users += 1;
    for (const column of less) column.users -= 1;
    const all = [...this.all.values()];
    const unused = all.filter((column) => column.users === 0);
    const sizeOf = (/** @type {Column[]} */ columns) => columns.reduce((sum, column) => sum + column.bytes.length, 0);
    let size = sizeOf(unused);
    const kept = Math.max(LEAST, TIMES * (sizeOf(all) - size));
    for (const column of unused) {
      if (size <= kept) break;
      size -= column.bytes.length;
      this.all.delete(column.name);
      this.free(column);
    }
  }
}
