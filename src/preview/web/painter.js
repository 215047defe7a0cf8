// Draws scenes with WebGL 2 and the same lights, colors and background as `maquette render`.

import { Column, Columns } from "./columns.js";
import { fieldOf } from "./scene.js";

/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {import("./scene.js").Look} Look */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {import("./scene.js").Shape} Shape */
/** @typedef {{low: number, high: number, isSigned: boolean}} Range */
/** @typedef {{x: number, y: number, width: number, height: number}} Rectangle in pixels, from the lower left corner */

const LIGHT = `
vec3 linear(vec3 color) {
  return mix(color / 12.92, pow((color + 0.055) / 1.055, vec3(2.4)), step(0.04045, color));
}
vec4 srgb(vec3 light) {
  vec3 c = clamp(light, 0.0, 1.0);
  return vec4(mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)), 1.0);
}
vec3 lit(vec3 color, vec3 n) {
  float key = max((dot(n, vec3(-0.4505, 0.6007, 0.6604)) + 0.05) / 1.05, 0.0);
  float fill = max((dot(n, vec3(0.7547, 0.0503, 0.6541)) + 0.4) / 1.4, 0.0);
  float rim = max(dot(n, vec3(0.2492, 0.4485, -0.8583)), 0.0);
  float shine = pow(max(dot(n, vec3(-0.2472, 0.3296, 0.9112)), 0.0), 32.0);
  vec3 sky = mix(vec3(0.095, 0.087, 0.08), vec3(0.24, 0.252, 0.28), 0.5 + 0.5 * n.y);
  vec3 light = sky + key * vec3(0.82, 0.79, 0.745) + fill * vec3(0.155, 0.165, 0.18) + rim * vec3(0.27, 0.275, 0.29);
  return color * light + 0.05 * shine;
}`;

const HEAD = `#version 300 es
precision highp float;
precision highp sampler2D;`;

/** The sources of the faces' colors. */
const PAINTS = { clay: 0, color: 1, texture: 2, field: 3, normal: 4 };

const FACES = {
  vertex: `${HEAD}
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 normal;
layout(location = 2) in vec3 color;
layout(location = 3) in vec2 uv;
layout(location = 4) in float field;
layout(location = 5) in vec2 parameter;
uniform mat4 clip;
uniform mat3 direction;
${LIGHT}
out vec3 towards;
out vec3 tint;
out vec2 place;
out vec2 grid;
out float number;
void main() {
  gl_Position = clip * vec4(position, 1.0);
  towards = direction * normal.xyz;
  tint = linear(color);
  place = uv;
  grid = parameter;
  number = field;
}`,
  fragment: `${HEAD}
in vec3 towards;
in vec3 tint;
in vec2 place;
in vec2 grid;
in float number;
uniform int paint;
uniform bool isolines;
uniform sampler2D picture;
uniform sampler2D ramp;
uniform vec2 range;
uniform float steps;
out vec4 pixel;
${LIGHT}
float line(float x) {
  float width = fwidth(x);
  float away = abs(fract(x - 0.5) - 0.5) / max(width, 1e-6);
  return width < 0.5 ? 1.0 - clamp(away, 0.0, 1.0) : 0.0;
}
void main() {
  vec3 n = length(towards) > 1e-6 ? normalize(towards) : vec3(0.0, 0.0, 1.0);
  vec3 color = vec3(0.617, 0.571, 0.515);
  float mark = 0.0;
  if (isolines && paint != ${PAINTS.field}) mark = max(line(grid.x * steps), line(grid.y * steps));
  if (!gl_FrontFacing) {
    pixel = srgb(lit(mix(vec3(0.413, 0.054, 0.042), vec3(0.02), 0.75 * mark), -n));
    return;
  }
  if (paint == ${PAINTS.color}) color = tint;
  if (paint == ${PAINTS.texture}) color = texture(picture, vec2(place.x, 1.0 - place.y)).rgb;
  if (paint == ${PAINTS.normal}) { pixel = vec4(0.5 + 0.5 * n, 1.0); return; }
  if (paint == ${PAINTS.field}) {
    float share = (number - range.x) / (range.y - range.x);
    bool known = !(isnan(number) || isinf(number));
    color = known ? linear(texture(ramp, vec2(clamp(share, 0.001, 0.999), 0.5)).rgb) : vec3(0.1);
    if (isolines && known) mark = line(share * steps);
  }
  pixel = srgb(lit(mix(color, vec3(0.02), 0.75 * mark), n));
}`,
};

const LINES = {
  vertex: `${HEAD}
layout(location = 0) in vec3 position;
uniform mat4 clip;
void main() { gl_Position = clip * vec4(position, 1.0); }`,
  fragment: `${HEAD}
uniform vec4 color;
out vec4 pixel;
void main() { pixel = color; }`,
};

const GROUND = {
  vertex: `${HEAD}
out float height;
void main() {
  vec2 at = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  height = 0.5 - 0.5 * at.y;
  gl_Position = vec4(at, 1.0, 1.0);
}`,
  fragment: `${HEAD}
in float height;
out vec4 pixel;
${LIGHT}
void main() { pixel = srgb(mix(vec3(0.060, 0.070, 0.086), vec3(0.021, 0.025, 0.031), height)); }`,
};

const PICTURE = {
  vertex: `${HEAD}
uniform vec4 box;
out vec2 place;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  place = vec2(corner.x, 1.0 - corner.y);
  gl_Position = vec4(mix(box.xy, box.zw, corner), 0.0, 1.0);
}`,
  fragment: `${HEAD}
in vec2 place;
uniform sampler2D picture;
out vec4 pixel;
${LIGHT}
void main() { pixel = srgb(texture(picture, place).rgb); }`,
};

/** Color ramps for numbers: `growing` from the minimum to the maximum, `signed` with a neutral color at zero. */
export const RAMPS = {
  growing: [[52, 24, 84], [58, 82, 139], [33, 144, 140], [94, 201, 98], [252, 231, 37]],
  signed: [[48, 76, 190], [126, 166, 240], [224, 224, 220], [238, 140, 106], [176, 22, 40]],
};

/** The color around a flat picture. */
const MARGIN_COLOR = [24, 26, 32];

/** The number of isolines over a range. */
export const STEPS = 12;

/** The width of faces in pixels at which their edges become opaque, and the minimum opacity of the fainter edges of smaller faces. */
const [FULL_WIDTH, MIN_OPACITY] = [8, 0.06];

/** The maximum number of normals that are drawn. */
const MAX_NORMALS = 6000;

/**
 * The range of the color ramp for a field: without outliers at both ends, and symmetric if zero is well inside of it.
 * @param {import("./types").ShapeField} field
 * @returns {Range}
 */
export function rangeOf({ range, usual }) {
  let [low, high] = usual[0] < usual[1] ? usual : range;
  const isSigned = low < 0 && high > 0 && Math.min(-low, high) > 0.05 * Math.max(-low, high);
  if (isSigned) [low, high] = [-Math.max(-low, high), Math.max(-low, high)];
  if (low === high) [low, high] = [low - 0.5, high + 0.5];
  return { low, high, isSigned };
}

export class Painter {
  /**
   * @param {HTMLCanvasElement} canvas
   * @returns {Painter | null} null if there is no WebGL 2
   */
  static on(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
    return gl === null ? null : new Painter(gl);
  }

  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.columns = new Columns((column) => this.#free(column));
    this.programs = this.#programs();
    this.ramps = this.#ramps();
    this.#set();
  }

  /** Creates the programs and textures again after a loss of the WebGL context. */
  restart() {
    for (const column of this.columns.all.values()) Object.assign(column, { copy: null, stale: [] });
    this.programs = this.#programs();
    this.ramps = this.#ramps();
    this.#set();
  }

  #set() {
    this.gl.enable(this.gl.DEPTH_TEST);
    this.gl.enable(this.gl.SCISSOR_TEST);
    const [r, g, b] = MARGIN_COLOR.map((channel) => channel / 255);
    this.gl.clearColor(r, g, b, 1);
  }

  #programs() {
    return { faces: this.#program(FACES), lines: this.#program(LINES), ground: this.#program(GROUND), picture: this.#program(PICTURE) };
  }

  #ramps() {
    return { growing: this.#ramp(RAMPS.growing), signed: this.#ramp(RAMPS.signed) };
  }

  /** @param {{vertex: string, fragment: string}} sources */
  #program({ vertex, fragment }) {
    const gl = this.gl;
    const program = /** @type {WebGLProgram} */ (gl.createProgram());
    for (const [kind, source] of /** @type {const} */ ([[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]])) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program) ?? "");
    /** @type {Map<string, WebGLUniformLocation | null>} */
    const places = new Map();
    return {
      program,
      at(/** @type {string} */ name) {
        if (!places.has(name)) places.set(name, gl.getUniformLocation(program, name));
        return places.get(name) ?? null;
      },
    };
  }

  /** @param {number[][]} stops */
  #ramp(stops) {
    const gl = this.gl;
    const count = 256;
    const pixels = new Uint8Array(4 * count);
    for (let k = 0; k < count; k++) pixels.set([...rampColor(stops, k / (count - 1)), 255], 4 * k);
    const ramp = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, ramp);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, count, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    return ramp;
  }

  /** @param {Column} column */
  #free(column) {
    const copy = column.copy;
    if (copy instanceof WebGLTexture) this.gl.deleteTexture(copy);
    else if (copy !== null) this.gl.deleteBuffer(copy);
    column.copy = null;
  }

  /**
   * Binds the GPU buffer of a column and uploads what has changed in the column.
   * @param {Column} column
   * @param {number} kind
   */
  buffer(column, kind) {
    const gl = this.gl;
    if (column.copy === null) {
      column.copy = gl.createBuffer();
      gl.bindBuffer(kind, column.copy);
      gl.bufferData(kind, column.bytes, gl.DYNAMIC_DRAW);
    } else {
      gl.bindBuffer(kind, /** @type {WebGLBuffer} */ (column.copy));
      for (const [start, end] of column.stale) gl.bufferSubData(kind, start, column.bytes, start, end - start);
    }
    column.stale = [];
  }

  /**
   * Binds the texture of a picture.
   * @param {Column} column
   * @param {[number, number]} size
   * @param {number} larger the filter for magnification
   * @param {import("./types").Texture["wrap"]} wrap
   */
  #texture(column, [width, height], larger, wrap = ["Clamp", "Clamp"]) {
    const gl = this.gl;
    const isNew = column.copy === null || column.stale.length > 0;
    column.copy ??= gl.createTexture();
    column.stale = [];
    gl.bindTexture(gl.TEXTURE_2D, /** @type {WebGLTexture} */ (column.copy));
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, larger);
    const wraps = { Repeat: gl.REPEAT, Mirror: gl.MIRRORED_REPEAT, Clamp: gl.CLAMP_TO_EDGE };
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, wraps[wrap[0]]);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, wraps[wrap[1]]);
    if (!isNew) return;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, column.bytes);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  }

  /**
   * Uploads the buffers of a scene, so that its first frame takes no longer than later ones.
   * @param {Scene} scene
   */
  upload(scene) {
    const gl = this.gl;
    for (const [place, column] of scene.columns) {
      if (place.endsWith("triangle") || place.endsWith("edge")) this.buffer(column, gl.ELEMENT_ARRAY_BUFFER);
      else if (!place.endsWith("picture")) this.buffer(column, gl.ARRAY_BUFFER);
    }
  }

  /**
   * Clears the `clip` part of a box of the canvas and draws the background; what is drawn next is clipped to it.
   * @param {Rectangle} box
   * @param {Rectangle} clip
   * @param {boolean} isFlat true if a flat picture follows
   */
  begin(box, clip, isFlat) {
    const gl = this.gl;
    gl.viewport(box.x, box.y, box.width, box.height);
    gl.scissor(clip.x, clip.y, clip.width, clip.height);
    gl.clear(gl.DEPTH_BUFFER_BIT | gl.COLOR_BUFFER_BIT);
    if (isFlat) return;
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.programs.ground.program);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  /**
   * Draws the shapes of a scene.
   * @param {Scene} scene
   * @param {Camera} camera
   * @param {Look} look
   * @param {Rectangle} box
   * @param {Range | null} range the range of the numbers that colors show
   */
  space(scene, camera, look, box, range) {
    const { space } = scene;
    if (space === null) return;
    const gl = this.gl;
    const { clip, direction } = camera.matrices(space, box.width, box.height);
    for (const [k, shape] of space.shapes.entries()) {
      if (shape.solid && !look.extra) continue;
      if (look.wire || look.normals) {
        gl.enable(gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(1, 1);
      }
      gl.useProgram(this.programs.faces.program);
      gl.uniformMatrix4fv(this.programs.faces.at("clip"), false, clip);
      gl.uniformMatrix3fv(this.programs.faces.at("direction"), false, direction);
      // Without culling, back faces of thin solids show at their silhouettes, where their depth equals that of the front faces.
      if (shape.solid) gl.enable(gl.CULL_FACE);
      this.#faces(shape, look, range);
      gl.disable(gl.CULL_FACE);
      gl.disable(gl.POLYGON_OFFSET_FILL);
      gl.useProgram(this.programs.lines.program);
      gl.uniformMatrix4fv(this.programs.lines.at("clip"), false, clip);
      if (look.wire && shape.edge !== null) {
        this.#attribute(0, shape.position, 3, gl.FLOAT);
        this.buffer(shape.edge, gl.ELEMENT_ARRAY_BUFFER);
        const across = Math.max(...[0, 1, 2].map((k) => space.high[k] - space.low[k])) * camera.pixels(box.width, box.height);
        const faceSize = across / Math.sqrt(shape.triangle.bytes.length / 12);
        gl.uniform4f(this.programs.lines.at("color"), 0.07, 0.09, 0.12, Math.min(1, Math.max(MIN_OPACITY, faceSize / FULL_WIDTH)));
        gl.enable(gl.BLEND);
        gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
        gl.drawElements(gl.LINES, shape.edge.bytes.length / 4, gl.UNSIGNED_INT, 0);
        gl.disable(gl.BLEND);
      }
      if (look.normals && !shape.solid) this.#normals(scene, k, shape, camera.radius / space.scale);
    }
    for (let k = 0; k < 6; k++) gl.disableVertexAttribArray(k);
  }

  /**
   * @param {number} place
   * @param {Column | null} column
   * @param {number} count
   * @param {number} kind
   */
  #attribute(place, column, count, kind) {
    const gl = this.gl;
    if (column === null) {
      gl.disableVertexAttribArray(place);
      gl.vertexAttrib4f(place, 0, 0, 0, 1);
      return;
    }
    this.buffer(column, gl.ARRAY_BUFFER);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, count, kind, kind !== gl.FLOAT, 0, 0);
  }

  /**
   * @param {Shape} shape
   * @param {Look} look
   * @param {Range | null} range
   */
  #faces(shape, look, range) {
    const gl = this.gl;
    const at = this.programs.faces.at;
    const field = shape.field === null ? undefined : fieldOf(shape, look);
    const own = shape.picture !== null ? PAINTS.texture : shape.color !== null ? PAINTS.color : PAINTS.clay;
    const chosen = look.paint === "normal" ? PAINTS.normal : look.paint === "clay" ? PAINTS.clay : own;
    // Points and lines keep their own colors.
    const paint = field !== undefined ? PAINTS.field : shape.solid ? own : chosen;
    gl.uniform1i(at("paint"), paint);
    gl.uniform1i(at("isolines"), Number(look.isolines && !shape.solid && (field !== undefined || shape.parameter !== null)));
    gl.uniform1f(at("steps"), field !== undefined ? STEPS : 10);
    gl.uniform1i(at("picture"), 0);
    gl.uniform1i(at("ramp"), 1);
    gl.activeTexture(gl.TEXTURE0);
    if (shape.picture !== null && shape.texture) this.#texture(shape.picture, shape.texture.pixels.size, gl.LINEAR, shape.texture.wrap);
    if (field !== undefined) {
      const { low, high, isSigned } = range ?? rangeOf(field);
      gl.uniform2f(at("range"), low, high);
      gl.activeTexture(gl.TEXTURE1);
      gl.bindTexture(gl.TEXTURE_2D, isSigned ? this.ramps.signed : this.ramps.growing);
      gl.activeTexture(gl.TEXTURE0);
    }
    const byCorner = field !== undefined && field.on !== "vertex";
    const spread = (/** @type {Column | null} */ column) => (byCorner && column !== null ? this.#spread(shape, column) : column);
    this.#attribute(0, spread(shape.position), 3, gl.FLOAT);
    this.#attribute(1, spread(shape.normal), 4, gl.INT_2_10_10_10_REV);
    this.#attribute(2, byCorner ? null : shape.color, 4, gl.UNSIGNED_BYTE);
    this.#attribute(3, byCorner ? null : shape.uv, 2, gl.FLOAT);
    this.#attribute(4, field === undefined ? null : shape.field, 1, gl.FLOAT);
    this.#attribute(5, byCorner ? null : shape.parameter, 2, gl.FLOAT);
    const count = shape.triangle.bytes.length / 4;
    if (byCorner) gl.drawArrays(gl.TRIANGLES, 0, count);
    else {
      this.buffer(shape.triangle, gl.ELEMENT_ARRAY_BUFFER);
      if (paint !== PAINTS.texture || shape.stretches.length === 0) gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
      else this.#stretches(shape);
    }
  }

  /**
   * Draws consecutive triangles that have different textures, or none.
   * @param {Shape} shape
   */
  #stretches(shape) {
    const gl = this.gl;
    const at = this.programs.faces.at;
    let first = 0;
    for (const [place, { count, texture }] of shape.stretches.entries()) {
      const picture = shape.pictures[place] ?? null;
      const own = picture !== null ? PAINTS.texture : shape.color !== null ? PAINTS.color : PAINTS.clay;
      gl.uniform1i(at("paint"), own);
      if (picture !== null && texture !== null) this.#texture(picture, texture.pixels.size, gl.LINEAR, texture.wrap);
      gl.drawElements(gl.TRIANGLES, 3 * count, gl.UNSIGNED_INT, 12 * first);
      first += count;
    }
  }

  /**
   * Expands a column of vertices to one entry for each corner of each triangle.
   * @param {Shape} shape
   * @param {Column} column
   */
  #spread(shape, column) {
    const name = `${column.name} by ${shape.triangle.name}`;
    let spread = this.columns.all.get(name);
    if (spread === undefined) {
      const places = shape.triangle.numbers;
      const width = column === shape.position ? 3 : 1;
      const from = column.numbers;
      const to = new Uint32Array(width * places.length);
      for (let k = 0; k < places.length; k++) for (let part = 0; part < width; part++) to[width * k + part] = from[width * places[k] + part];
      spread = new Column(name, new Uint8Array(to.buffer));
      this.columns.all.set(name, spread);
    }
    return spread;
  }

  /**
   * Draws a short line along the normal of each vertex, or of every n-th vertex if there are more than `MAX_NORMALS`.
   * @param {Scene} scene
   * @param {number} k
   * @param {Shape} shape
   * @param {number} radius
   */
  #normals(scene, k, shape, radius) {
    const gl = this.gl;
    const name = `normals of ${shape.position.name} ${shape.normal.name}`;
    let lines = this.columns.all.get(name);
    if (lines === undefined) {
      const [places, normals] = [shape.position.floats, shape.normal.numbers];
      const stride = Math.ceil(normals.length / MAX_NORMALS);
      const ends = [];
      for (let at = 0; at < normals.length; at += stride) {
        const start = [0, 1, 2].map((axis) => places[3 * at + axis]);
        const along = [0, 1, 2].map((axis) => (normals[at] << (22 - 10 * axis)) >> 22);
        ends.push(...start, ...start.map((x, axis) => x + (0.03 * radius * along[axis]) / 511));
      }
      lines = new Column(name, new Uint8Array(new Float32Array(ends).buffer));
      this.columns.all.set(name, lines);
    }
    this.#attribute(0, lines, 3, gl.FLOAT);
    gl.uniform4f(this.programs.lines.at("color"), 0.3, 0.7, 1, 1);
    gl.drawArrays(gl.LINES, 0, lines.bytes.length / 12);
  }

  /**
   * Draws a picture into a box in clip space, from -1 to 1.
   * @param {Scene} scene
   * @param {[number, number, number, number]} box left, bottom, right, top
   */
  picture(scene, box) {
    const pixels = scene.value.picture?.pixels;
    if (scene.picture === null || !pixels) return;
    const gl = this.gl;
    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.programs.picture.program);
    gl.activeTexture(gl.TEXTURE0);
    this.#texture(scene.picture, pixels.size, gl.NEAREST);
    gl.uniform1i(this.programs.picture.at("picture"), 0);
    gl.uniform4f(this.programs.picture.at("box"), ...box);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.enable(gl.DEPTH_TEST);
  }
}

/**
 * The color of a ramp at a fraction from 0 to 1.
 * @param {number[][]} stops
 * @param {number} share
 */
export function rampColor(stops, share) {
  const at = share * (stops.length - 1);
  const below = Math.min(stops.length - 2, Math.floor(at));
  return [0, 1, 2].map((k) => Math.round(stops[below][k] + (at - below) * (stops[below + 1][k] - stops[below][k])));
}
