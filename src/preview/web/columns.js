// A cache of columns (byte arrays) from the server. A cached column is not requested again. Of a column that has changed, only the changed
// parts are requested.

/** The maximum size of unused columns: this multiple of the bytes in use, or this number of bytes if that is larger. */
const [KEPT_RATIO, MIN_KEPT] = [2, 16 * 2 ** 20];

/** Changed parts with a gap of at most this many bytes are uploaded as one: many small uploads are slow. */
const MERGE_GAP = 2 ** 16;

/** The content type of an answer that has only the changed parts. */
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
     * Byte ranges that are newer than the copy: start and end of each.
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
 * @param {Column | null} old the column that the new one replaces
 * @returns {Promise<Answer>}
 */
function request(name, old) {
  // Use `XMLHttpRequest`, which is several times as fast as `fetch` for large answers.
  const xhr = new XMLHttpRequest();
  const from = old?.name ?? "";
  return new Promise((done, fail) => {
    xhr.open("GET", `/column/${name}${from && `?from=${from}`}`);
    xhr.responseType = "arraybuffer";
    xhr.addEventListener("load", () => {
      if (xhr.status !== 200) fail(new Error(`there is no column ${name}`));
      else done({ name, bytes: xhr.response, isChange: xhr.getResponseHeader("content-type") === CHANGES, from, old });
    });
    xhr.addEventListener("error", () => fail(new Error("cannot reach maquette watch")));
    xhr.send();
  });
}

export class Columns {
  /** @param {(column: Column) => void} free is called with each column that is evicted */
  constructor(free) {
    this.free = free;
    /**
     * The columns by name, the most recently used one last.
     * @type {Map<string, Column>}
     */
    this.all = new Map();
    /** The number of bytes received from the server. */
    this.received = 0;
  }

  /**
   * Requests the columns that are missing. The result is a function that returns all columns, in the order of the names, or null if one of
   * them is a change of a column that has changed since. Nothing that is displayed changes until that function is called.
   * @param {{name: string, old: Column | null}[]} wanted
   * @returns {Promise<() => Column[] | null>}
   */
  async find(wanted) {
    const missing = wanted.filter(({ name }, at) => !this.all.has(name) && wanted.findIndex((other) => other.name === name) === at);
    const answers = await Promise.all(missing.map(({ name, old }) => request(name, old)));
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
    const blocks = new Uint32Array(bytes, 8, count);
    // An old column that has no other user is changed in place.
    let column = old;
    if (old.users > 1) column = new Column(name, old.bytes.slice());
    else this.all.delete(old.name);
    column.name = name;
    this.all.set(name, column);
    let from = 8 + 4 * count;
    for (const block of blocks) {
      const start = size * block;
      const part = new Uint8Array(bytes, from, Math.min(size, column.bytes.length - start));
      column.bytes.set(part, start);
      from += part.length;
      const last = column.stale.at(-1);
      if (last && last[1] <= start && start - last[1] <= MERGE_GAP) last[1] = start + part.length;
      else column.stale.push([start, start + part.length]);
    }
  }

  /**
   * Counts one use more of some columns and one less of others; then evicts unused columns beyond the limit.
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
    const kept = Math.max(MIN_KEPT, KEPT_RATIO * (sizeOf(all) - size));
    for (const column of unused) {
      if (size <= kept) break;
      size -= column.bytes.length;
      this.all.delete(column.name);
      this.free(column);
    }
  }
}
