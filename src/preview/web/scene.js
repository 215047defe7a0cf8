// The drawable form of a value: its picture, or its shapes in space, with their columns.

/** @typedef {import("./columns.js").Column} Column */
/** @typedef {import("./camera.js").Vector} Vector */
/** @typedef {import("./types").Value} Value */
/** @typedef {import("./types").ShapeOf<Column>} Shape */

/**
 * The display options of a value. `paint` is `own`, `clay`, `normal`, or the element and name of a field. `extra` shows points and lines.
 * @typedef {{paint: string, wire: boolean, normals: boolean, isolines: boolean, extra: boolean, flat: boolean}} Look
 */

/** The columns of a shape that are always needed. */
const NEEDED = /** @type {const} */ (["position", "normal", "color", "uv", "triangle"]);

/** The shapes of a value, and its axes. */
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
     * The signs that rotate the axes of the value so that y points up.
     * @type {Vector}
     */
    this.up = about.upright ? [1, 1, 1] : [1, -1, -1];
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    for (const { position } of shapes) {
      const places = position.floats;
      for (let at = 0; at < places.length; at += 3) {
        for (let k = 0; k < 3; k++) {
          const x = places[at + k];
          if (x < min[k]) min[k] = x;
          if (x > max[k]) max[k] = x;
        }
      }
    }
    const place = (/** @type {number[]} */ corner, /** @type {number} */ k) => this.up[k] * (this.center[k] + this.scale * corner[k]);
    /**
     * The low corner of the bounding box, in mm, with y up.
     * @type {Vector}
     */
    this.low = /** @type {Vector} */ ([0, 1, 2].map((k) => place(this.up[k] > 0 ? min : max, k)));
    /**
     * The high corner of the bounding box.
     * @type {Vector}
     */
    this.high = /** @type {Vector} */ ([0, 1, 2].map((k) => place(this.up[k] > 0 ? max : min, k)));
  }

  /**
   * All positions, relative to `middle`, divided by `radius`, and rotated.
   * @param {[Vector, Vector, Vector]} turn
   * @param {Vector} middle
   * @param {number} radius
   */
  viewCoordinates(turn, middle, radius) {
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

/** A value ready to be drawn: its picture, or its shapes in space. */
export class Scene {
  /**
   * @param {Value} value
   * @param {Map<string, Column>} columns by the paths in the value that `columnsOf` gives
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
 * The field of a shape that `look.paint` names.
 * @param {{fields: import("./types").ShapeField[]}} shape
 * @param {Look} look
 */
export function fieldOf(shape, look) {
  return shape.fields.find((field) => `${field.on} ${field.name}` === look.paint);
}

/**
 * Returns true if a value is displayed as a flat picture.
 * @param {Value} value
 * @param {Look} look
 */
export function isFlat(value, look) {
  return value.picture !== null && (look.flat || value.space === null);
}

/**
 * The names of all columns that the display of a value needs, by their paths in it.
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
