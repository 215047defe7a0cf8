// The camera, which sees what `maquette render` sees: places in mm, y up, z towards the viewer.

/** The tangent of half the lens's angle, the share of the picture that is filled, and how near to the viewer anything may be. */
const [LENS, FILLED, NEAREST] = [0.230868191125563, 0.92, 0.1];

/** @typedef {[number, number, number]} Vector */

const START = { yaw: 0, pitch: 0, zoom: 1 };

/**
 * The rows of the turn from upright axes to the viewer's.
 * @param {number} yaw
 * @param {number} pitch
 * @returns {[Vector, Vector, Vector]}
 */
function rows(yaw, pitch) {
  const [sy, cy, sp, cp] = [yaw, pitch].flatMap((degrees) => [Math.sin, Math.cos].map((f) => f((degrees * Math.PI) / 180)));
  return [
    [cy, 0, -sy],
    [-sp * sy, cp, -sp * cy],
    [cp * sy, sp, cp * cy],
  ];
}

/**
 * @param {Vector} a
 * @param {Vector} b
 */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export class Camera {
  constructor() {
    Object.assign(this, START);
    this.yaw = START.yaw;
    this.pitch = START.pitch;
    this.zoom = START.zoom;
    /**
     * What it turns about, in mm.
     * @type {Vector}
     */
    this.target = [0, 0, 0];
    /** The size of what is seen, in mm, and how far away the viewer is, in these. */
    this.radius = 0;
    this.distance = 1;
    /** Whether it is still where it was put to see all of something. */
    this.fits = true;
    /**
     * The box around that.
     * @type {number[]}
     */
    this.box = [];
  }

  /** From the front again. */
  reset() {
    Object.assign(this, START);
  }

  /**
   * Goes where all places are seen in a picture of this shape.
   * @param {import("./scene.js").Space} space
   * @param {number} width
   * @param {number} height
   */
  fit(space, width, height) {
    const { low, high } = space;
    const middle = /** @type {Vector} */ ([0, 1, 2].map((k) => (low[k] + high[k]) / 2));
    const half = Math.max(...[0, 1, 2].map((k) => (high[k] - low[k]) / 2));
    this.radius = half > 0 ? half : 1;
    const turn = rows(this.yaw, this.pitch);
    const shorter = Math.min(width, height);
    const [right, top] = [width, height].map((side) => (FILLED * side) / shorter);
    const least = [Infinity, Infinity, Infinity];
    const most = [-Infinity, -Infinity, -Infinity];
    const seen = space.each(turn, middle, this.radius);
    for (let at = 0; at < seen.length; at += 3) {
      for (let k = 0; k < 3; k++) {
        const x = seen[at + k];
        if (x < least[k]) least[k] = x;
        if (x > most[k]) most[k] = x;
      }
    }
    const aim = [0, 1, 2].map((k) => (seen.length > 0 ? (least[k] + most[k]) / 2 : 0));
    let distance = NEAREST;
    for (let at = 0; at < seen.length; at += 3) {
      const reach = Math.max(Math.abs(seen[at] - aim[0]) / right, Math.abs(seen[at + 1] - aim[1]) / top);
      distance = Math.max(distance, seen[at + 2] - aim[2] + Math.max(reach / LENS, NEAREST));
    }
    this.distance = distance;
    this.target = /** @type {Vector} */ ([0, 1, 2].map((k) => middle[k] + this.radius * (turn[0][k] * aim[0] + turn[1][k] * aim[1] + turn[2][k] * aim[2])));
    this.fits = true;
    this.box = [...low, ...high];
  }

  /**
   * Stays where it is while something else is seen: that is not what it was put there for.
   * @param {import("./scene.js").Space} space
   */
  stay({ low, high }) {
    if ([...low, ...high].some((x, k) => x !== this.box[k])) this.fits = false;
  }

  /**
   * Whether it sees something of this size at this place about as well as what it was fitted to.
   * @param {import("./scene.js").Space} space
   */
  suits({ low, high }) {
    const half = Math.max(...[0, 1, 2].map((k) => (high[k] - low[k]) / 2));
    const away = Math.hypot(...[0, 1, 2].map((k) => (low[k] + high[k]) / 2 - this.target[k]));
    return this.radius > 0 && half > this.radius / 4 && half < this.radius * 1.5 && away < this.radius * 1.5;
  }

  /**
   * Walks around what is seen, in degrees, and nearer to it.
   * @param {number} right
   * @param {number} up
   */
  turn(right, up, nearer = 1) {
    this.yaw += right;
    this.pitch = Math.max(-90, Math.min(90, this.pitch + up));
    this.zoom = Math.max(0.001, Math.min(1000, this.zoom * nearer));
    if (right !== 0 || up !== 0) this.fits = false;
  }

  /**
   * Moves what is seen, in shares of half the shorter side of the picture.
   * @param {number} right
   * @param {number} up
   */
  pan(right, up) {
    const turn = rows(this.yaw, this.pitch);
    const length = (this.radius * this.distance * LENS) / this.zoom;
    this.target = /** @type {Vector} */ (this.target.map((x, k) => x - length * (right * turn[0][k] + up * turn[1][k])));
    this.fits = false;
  }

  /**
   * How many pixels a mm is long at the distance of what it turns about.
   * @param {number} width
   * @param {number} height
   */
  pixels(width, height) {
    return (Math.min(width, height) * this.zoom) / (2 * LENS * this.distance * this.radius);
  }

  /**
   * Turns about this place from now on, which comes into the middle; the viewer comes no nearer.
   * @param {Vector} place
   */
  aim(place) {
    const away = /** @type {Vector} */ (place.map((x, k) => (x - this.target[k]) / this.radius));
    this.distance = Math.max(NEAREST, this.distance - dot(rows(this.yaw, this.pitch)[2], away));
    this.target = place;
    this.fits = false;
  }

  /**
   * What a graphics card needs to draw places of a value: from them to the picture (columns of 4 x 4), and from directions to the
   * viewer's axes (columns of 3 x 3).
   * @param {import("./scene.js").Space} space
   * @param {number} width
   * @param {number} height
   */
  matrices(space, width, height) {
    const { center, scale, up } = space;
    const turn = rows(this.yaw, this.pitch).map((row) => row.map((x, k) => x * up[k]));
    const from = /** @type {Vector} */ (center.map((x, k) => (x - up[k] * this.target[k]) / this.radius));
    const shorter = Math.min(width, height);
    const wide = [width, height].map((side) => ((shorter / side) * this.zoom) / LENS);
    // What is seen lies in a ball about the middle.
    const [low, high] = [space.low, space.high];
    const ball = Math.hypot(...[0, 1, 2].map((k) => high[k] - low[k])) / 2 / this.radius;
    const away = Math.hypot(...[0, 1, 2].map((k) => (low[k] + high[k]) / 2 - this.target[k])) / this.radius;
    const reach = 1.01 * (ball + away) + 1e-3;
    const near = Math.max(this.distance * 1e-3, this.distance - reach);
    const far = Math.max(this.distance + reach, 2 * near);
    const size = scale / this.radius;
    const clip = new Float32Array(16);
    const direction = new Float32Array(9);
    const offset = turn.map((row) => dot(/** @type {Vector} */ (row), from));
    const depth = [-(far + near) / (far - near), this.distance * ((far + near) / (far - near)) - (2 * far * near) / (far - near)];
    for (let k = 0; k < 3; k++) {
      clip[4 * k] = wide[0] * turn[0][k] * size;
      clip[4 * k + 1] = wide[1] * turn[1][k] * size;
      clip[4 * k + 2] = depth[0] * turn[2][k] * size;
      clip[4 * k + 3] = -turn[2][k] * size;
      for (let row = 0; row < 3; row++) direction[3 * k + row] = turn[row][k];
    }
    clip[12] = wide[0] * offset[0];
    clip[13] = wide[1] * offset[1];
    clip[14] = depth[0] * offset[2] + depth[1];
    clip[15] = this.distance - offset[2];
    return { clip, direction };
  }

  /**
   * The ray through a place of the picture, -1 to 1 to the right and upwards, in a value's own axes; `radius` is how far a pixel is
   * from the next one at a distance of 1.
   * @param {import("./scene.js").Space} space
   * @param {[number, number]} at
   * @param {number} width
   * @param {number} height
   */
  ray({ up }, at, width, height) {
    const turn = rows(this.yaw, this.pitch);
    const shorter = Math.min(width, height);
    const [x, y] = [width, height].map((side, k) => (at[k] * side * LENS) / shorter / this.zoom);
    const own = (/** @type {Vector} */ v) => /** @type {Vector} */ ([0, 1, 2].map((k) => up[k] * (turn[0][k] * v[0] + turn[1][k] * v[1] + turn[2][k] * v[2])));
    const viewer = own([0, 0, this.distance * this.radius]);
    const origin = viewer.map((place, k) => place + up[k] * this.target[k]);
    const direction = own([x, y, -1]);
    const length = Math.hypot(...direction);
    return { origin, direction: direction.map((x) => x / length), radius: (2 * LENS) / shorter / this.zoom };
  }

  /**
   * As words of an address: three numbers where the rest follows from what is seen.
   * @returns {number[]}
   */
  numbers() {
    const angles = [this.yaw, this.pitch, this.zoom];
    const all = this.fits || this.radius === 0 ? angles : [...angles, ...this.target, this.radius, this.distance];
    return all.map((number) => Number(number.toPrecision(6)));
  }

  /**
   * Takes over what an address says; whether it says where the camera is, and not only its direction.
   * @param {number[]} numbers
   */
  take(numbers) {
    if (![3, 8].includes(numbers.length) || !numbers.every(Number.isFinite)) return;
    const [yaw, pitch, zoom, x, y, z, radius, distance] = numbers;
    Object.assign(this, { yaw, pitch: Math.max(-90, Math.min(90, pitch)), zoom: Math.max(0.001, Math.min(1000, zoom)) });
    if (radius > 0 && distance > 0) Object.assign(this, { target: [x, y, z], radius, distance, fits: false });
  }
}
