// What of a value is seen: its columns, ready to be drawn.

/** @typedef {import("./columns.js").Column} Column */
/** @typedef {import("./camera.js").Vector} Vector */
/** @typedef {import("./types").Value} Value */
/** @typedef {import("./types").ShapeOf<Column>} Shape */

/**
 * How a value is looked at: `paint` is `own`, `clay`, `normal`, or the name of a field.
 * @typedef {{paint: string, wire: boolean, normals: boolean, isolines: boolean, extra: boolean, flat: boolean}} Look
 */

/** The columns of a shape that are always needed. */
const NEEDED = /** @type {const} */ (["position", "normal", "color", "uv", "triangle"]);

/** What lies in space of a value. */
export class Space {
  /**
   * @param {import("./types").Space} about
   * @param {Shape[]} shapes
   */
  constructor(about, shapes) {
    this.shapes = shapes;
    /** @type {Vector} */
    this.center = about.center;
    this.scale = about.scale;
    /**
     * What turns the value's own axes so that y points up.
     * @type {Vector}
     */
    this.up = about.upright ? [1, 1, 1] : [1, -1, -1];
    const least = [Infinity, Infinity, Infinity];
    const most = [-Infinity, -Infinity, -Infinity];
    for (const { position } of shapes) {
      const places = position.floats;
      for (let at = 0; at < places.length; at += 3) {
        for (let k = 0; k < 3; k++) {
          const x = places[at + k];
          if (x < least[k]) least[k] = x;
          if (x > most[k]) most[k] = x;
        }
      }
    }
    const place = (/** @type {number[]} */ corner, /** @type {number} */ k) => this.up[k] * (this.center[k] + this.scale * corner[k]);
    /**
     * The box around all of it, in mm, with y up.
     * @type {Vector}
     */
    this.low = /** @type {Vector} */ ([0, 1, 2].map((k) => place(this.up[k] > 0 ? least : most, k)));
    /** @type {Vector} */
    this.high = /** @type {Vector} */ ([0, 1, 2].map((k) => place(this.up[k] > 0 ? most : least, k)));
  }

  /**
   * All places, turned, measured from a middle in units of a radius.
   * @param {[Vector, Vector, Vector]} turn
   * @param {Vector} middle
   * @param {number} radius
   */
  each(turn, middle, radius) {
    const count = this.shapes.reduce((sum, { position }) => sum + position.floats.length, 0);
    const seen = new Float32Array(count);
    const from = this.center.map((x, k) => (this.up[k] * x - middle[k]) / radius);
    const size = this.up.map((sign) => (sign * this.scale) / radius);
    let at = 0;
    for (const { position } of this.shapes) {
      const places = position.floats;
      for (let k = 0; k < places.length; k += 3, at += 3) {
        const x = from[0] + size[0] * places[k];
        const y = from[1] + size[1] * places[k + 1];
        const z = from[2] + size[2] * places[k + 2];
        seen[at] = turn[0][0] * x + turn[0][1] * y + turn[0][2] * z;
        seen[at + 1] = turn[1][0] * x + turn[1][1] * y + turn[1][2] * z;
        seen[at + 2] = turn[2][0] * x + turn[2][1] * y + turn[2][2] * z;
      }
    }
    return seen;
  }
}

/** Of a value what is looked at: its picture, or what lies in space. */
export class Scene {
  /**
   * @param {Value} value
   * @param {Map<string, Column>} columns by their places in the value
   */
  constructor(value, columns) {
    this.value = value;
    this.columns = columns;
    const at = (/** @type {string} */ place) => columns.get(place) ?? null;
    const shapes = (value.space?.shapes ?? []).map((shape, k) => ({
      ...shape,
      position: /** @type {Column} */ (at(`${k}.position`)),
      normal: /** @type {Column} */ (at(`${k}.normal`)),
      triangle: /** @type {Column} */ (at(`${k}.triangle`)),
      color: at(`${k}.color`),
      uv: at(`${k}.uv`),
      edge: at(`${k}.edge`),
      parameter: at(`${k}.parameter`),
      picture: at(`${k}.picture`),
      pictures: shape.stretches.map((_, place) => at(`${k}.${place}.picture`)),
      field: at(`${k}.field`),
    }));
    this.picture = at("picture");
    this.space = value.space === null || this.picture !== null ? null : new Space(value.space, shapes);
  }
}

/**
 * The field of a shape that a look names.
 * @param {{fields: import("./types").ShapeField[]}} shape
 * @param {Look} look
 */
export function fieldOf(shape, look) {
  return shape.fields.find((field) => `${field.on} ${field.name}` === look.paint);
}

/**
 * Whether a value is looked at as a picture.
 * @param {Value} value
 * @param {Look} look
 */
export function isFlat(value, look) {
  return value.picture !== null && (look.flat || value.space === null);
}

/**
 * The names of all columns that a look at a value needs, by their places in it.
 * @param {Value} value
 * @param {Look} look
 */
export function columnsOf(value, look) {
  /** @type {Map<string, string>} */
  const names = new Map();
  const put = (/** @type {string} */ place, /** @type {string | null | undefined} */ name) => name && names.set(place, name);
  if (isFlat(value, look)) {
    put("picture", value.picture?.pixels.column);
    return names;
  }
  for (const [k, shape] of (value.space?.shapes ?? []).entries()) {
    for (const column of NEEDED) put(`${k}.${column}`, shape[column]);
    put(`${k}.picture`, shape.texture?.pixels.column);
    for (const [place, { texture }] of shape.stretches.entries()) put(`${k}.${place}.picture`, texture?.pixels.column);
    if (look.wire) put(`${k}.edge`, shape.edge);
    if (look.isolines) put(`${k}.parameter`, shape.parameter);
    put(`${k}.field`, fieldOf(shape, look)?.column);
  }
  return names;
}
