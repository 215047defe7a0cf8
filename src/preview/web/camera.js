// The camera, with the same projection as `maquette render`: positions in mm, y up, z towards the viewer.

/** The tangent of half the field of view, the fraction of the view that a fitted value fills, and the minimum distance to the viewer. */
const [HALF_FOV_TAN, FILL, MIN_DISTANCE] = [0.230868191125563, 0.92, 0.1];

/** @typedef {[number, number, number]} Vector */

const START = { yaw: 0, pitch: 0, zoom: 1 };

/**
 * The rows of the rotation matrix from upright axes to the viewer's axes.
 * @param {number} yaw
 * @param {number} pitch
 * @returns {[Vector, Vector, Vector]}
 */
function rotation(yaw, pitch) {
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
     * The point that the camera rotates about, in mm.
     * @type {Vector}
     */
    this.target = [0, 0, 0];
    /** Half the size of the viewed value, in mm, and the distance from the viewer to the target, in multiples of `radius`. */
    this.radius = 0;
    this.distance = 1;
    /** True as long as the camera is where `fit` has put it. */
    this.fits = true;
    /**
     * The bounding box that `fit` has fitted: the low corner, then the high one.
     * @type {number[]}
     */
    this.box = [];
  }

  /** Sets the direction to the front and the zoom to 1. */
  reset() {
    Object.assign(this, START);
  }

  /**
   * Moves the camera so that all positions are visible in a view of this width and height.
   * @param {import("./scene.js").Space} space
   * @param {number} width
   * @param {number} height
   */
  fit(space, width, height) {
    const { low, high } = space;
    const middle = /** @type {Vector} */ ([0, 1, 2].map((k) => (low[k] + high[k]) / 2));
    const half = Math.max(...[0, 1, 2].map((k) => (high[k] - low[k]) / 2));
    this.radius = half > 0 ? half : 1;
    const turn = rotation(this.yaw, this.pitch);
    const shorter = Math.min(width, height);
    const [right, top] = [width, height].map((side) => (FILL * side) / shorter);
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    const seen = space.viewCoordinates(turn, middle, this.radius);
    for (let at = 0; at < seen.length; at += 3) {
      for (let k = 0; k < 3; k++) {
        const x = seen[at + k];
        if (x < min[k]) min[k] = x;
        if (x > max[k]) max[k] = x;
      }
    }
    const aim = [0, 1, 2].map((k) => (seen.length > 0 ? (min[k] + max[k]) / 2 : 0));
    let distance = MIN_DISTANCE;
    for (let at = 0; at < seen.length; at += 3) {
      const reach = Math.max(Math.abs(seen[at] - aim[0]) / right, Math.abs(seen[at + 1] - aim[1]) / top);
      distance = Math.max(distance, seen[at + 2] - aim[2] + Math.max(reach / HALF_FOV_TAN, MIN_DISTANCE));
    }
    this.distance = distance;
    this.target = /** @type {Vector} */ ([0, 1, 2].map((k) => middle[k] + this.radius * (turn[0][k] * aim[0] + turn[1][k] * aim[1] + turn[2][k] * aim[2])));
    this.fits = true;
    this.box = [...low, ...high];
  }

  /**
   * Keeps the camera in its position for another value, whose bounding box may differ from the fitted one.
   * @param {import("./scene.js").Space} space
   */
  stay({ low, high }) {
    if ([...low, ...high].some((x, k) => x !== this.box[k])) this.fits = false;
  }

  /**
   * Returns true if a value of this size and position is seen about as well as the one that the camera was fitted to.
   * @param {import("./scene.js").Space} space
   */
  fitsWell({ low, high }) {
    const half = Math.max(...[0, 1, 2].map((k) => (high[k] - low[k]) / 2));
    const away = Math.hypot(...[0, 1, 2].map((k) => (low[k] + high[k]) / 2 - this.target[k]));
    return this.radius > 0 && half > this.radius / 4 && half < this.radius * 1.5 && away < this.radius * 1.5;
  }

  /**
   * Rotates the camera about the target, in degrees, and zooms by the factor `nearer`.
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
   * Moves the viewed value parallel to the view plane, in fractions of half the shorter side of the view.
   * @param {number} right
   * @param {number} up
   */
  pan(right, up) {
    const turn = rotation(this.yaw, this.pitch);
    const length = (this.radius * this.distance * HALF_FOV_TAN) / this.zoom;
    this.target = /** @type {Vector} */ (this.target.map((x, k) => x - length * (right * turn[0][k] + up * turn[1][k])));
    this.fits = false;
  }

  /**
   * The length of one mm in pixels, at the distance of the target.
   * @param {number} width
   * @param {number} height
   */
  pixels(width, height) {
    return (Math.min(width, height) * this.zoom) / (2 * HALF_FOV_TAN * this.distance * this.radius);
  }

  /**
   * Sets the target: the center of rotation and of the view. The viewer does not move along the viewing direction.
   * @param {Vector} position
   */
  aim(position) {
    const away = /** @type {Vector} */ (position.map((x, k) => (x - this.target[k]) / this.radius));
    this.distance = Math.max(MIN_DISTANCE, this.distance - dot(rotation(this.yaw, this.pitch)[2], away));
    this.target = position;
    this.fits = false;
  }

  /**
   * The matrices that draw a value, by columns: `clip` (4 x 4) from its positions to clip space, `direction` (3 x 3) from its normals to
   * the viewer's axes.
   * @param {import("./scene.js").Space} space
   * @param {number} width
   * @param {number} height
   */
  matrices(space, width, height) {
    const { center, scale, up } = space;
    const turn = rotation(this.yaw, this.pitch).map((row) => row.map((x, k) => x * up[k]));
    const from = /** @type {Vector} */ (center.map((x, k) => (x - up[k] * this.target[k]) / this.radius));
    const shorter = Math.min(width, height);
    const wide = [width, height].map((side) => ((shorter / side) * this.zoom) / HALF_FOV_TAN);
    // The depth range covers the bounding sphere of the value.
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
   * The ray through a position of the view, -1 to 1 to the right and upwards, in the axes of the value; `radius` is the distance
   * between neighboring pixels at a distance of 1.
   * @param {import("./scene.js").Space} space
   * @param {[number, number]} at
   * @param {number} width
   * @param {number} height
   */
  ray({ up }, at, width, height) {
    const turn = rotation(this.yaw, this.pitch);
    const shorter = Math.min(width, height);
    const [x, y] = [width, height].map((side, k) => (at[k] * side * HALF_FOV_TAN) / shorter / this.zoom);
    const own = (/** @type {Vector} */ v) => /** @type {Vector} */ ([0, 1, 2].map((k) => up[k] * (turn[0][k] * v[0] + turn[1][k] * v[1] + turn[2][k] * v[2])));
    const viewer = own([0, 0, this.distance * this.radius]);
    const origin = viewer.map((x, k) => x + up[k] * this.target[k]);
    const direction = own([x, y, -1]);
    const length = Math.hypot(...direction);
    return { origin, direction: direction.map((x) => x / length), radius: (2 * HALF_FOV_TAN) / shorter / this.zoom };
  }

  /**
   * The camera as numbers for the page's URL: yaw, pitch and zoom, and also its position unless that follows from the viewed value.
   * @returns {number[]}
   */
  numbers() {
    const angles = [this.yaw, this.pitch, this.zoom];
    const all = this.fits || this.radius === 0 ? angles : [...angles, ...this.target, this.radius, this.distance];
    return all.map((number) => Number(number.toPrecision(6)));
  }

  /**
   * Restores the camera from the numbers of an address (see `numbers`); ignores malformed ones.
   * @param {number[]} numbers
   */
  take(numbers) {
    if (![3, 8].includes(numbers.length) || !numbers.every(Number.isFinite)) return;
    const [yaw, pitch, zoom, x, y, z, radius, distance] = numbers;
    Object.assign(this, { yaw, pitch: Math.max(-90, Math.min(90, pitch)), zoom: Math.max(0.001, Math.min(1000, zoom)) });
    if (radius > 0 && distance > 0) Object.assign(this, { target: [x, y, z], radius, distance, fits: false });
  }
}
