// three.js in a real Chromium, with its own loaders. Prints records as `record.py` describes them.
//
// Usage: node with_three.mjs FOLDER FILE...; the folder has `node_modules`.
import { readFileSync } from "node:fs";
import { basename, dirname, join, resolve } from "node:path";

const [made, ...files] = process.argv.slice(2);
const { chromium } = await import(join(resolve(made), "node_modules/playwright-core/index.mjs"));

const PAGE = `<!doctype html><script type="importmap">{"imports": {"three": "/module/build/three.module.js", "three/addons/": "/module/examples/jsm/"}}</script>`;
const TYPES = { js: "text/javascript", html: "text/html", png: "image/png" };

/** Reads a file by its address; runs in the page. */
async function find(name) {
  const THREE = await import("three");
  const addon = async (path) => import(`three/addons/loaders/${path}.js`);
  const address = `/file/${encodeURIComponent(name)}`;
  const ending = name.split(".").pop();
  const found = { points: [], faces: [], lines: [], colors: [], normals: [], uv: [], picture: null, materials: {} };
  if (ending === "png") return { picture: await pixels(await new THREE.ImageLoader().loadAsync(address)) };
  let root;
  if (ending === "ply") {
    // The loader's geometry does not distinguish meshes from point clouds.
    const faces = /element face [1-9]/.test(await (await fetch(address)).text());
    const geometry = await new (await addon("PLYLoader")).PLYLoader().loadAsync(address);
    root = faces ? new THREE.Mesh(geometry) : new THREE.Points(geometry);
  }
  else if (ending === "stl") root = new THREE.Mesh(await new (await addon("STLLoader")).STLLoader().loadAsync(address));
  else if (ending === "xyz") root = new THREE.Points(await new (await addon("XYZLoader")).XYZLoader().loadAsync(address));
  else if (ending === "pcd") root = await new (await addon("PCDLoader")).PCDLoader().loadAsync(address);
  else if (ending === "glb") root = (await new (await addon("GLTFLoader")).GLTFLoader().loadAsync(address)).scene;
  else if (ending === "3mf") root = await new (await addon("3MFLoader")).ThreeMFLoader().loadAsync(address);
  else if (ending === "obj") {
    const loader = new (await addon("OBJLoader")).OBJLoader();
    const library = /^mtllib (.*)$/m.exec(await (await fetch(address)).text())?.[1];
    if (library) {
      const materials = new (await addon("MTLLoader")).MTLLoader().setPath("/file/");
      loader.setMaterials(await new Promise((done, fail) => materials.load(library, done, undefined, () => fail(new Error(`no file ${library}`)))));
    }
    root = await loader.loadAsync(address);
  }
  // Textures of materials are loaded asynchronously.
  await new Promise((done) => setTimeout(done, 300));
  root.updateMatrixWorld(true);
  const parts = [];
  root.traverse((part) => part.geometry && parts.push(part));
  for (const part of parts) await add(part);
  // Invalid cells remain in the geometry as NaN.
  if (ending === "pcd") for (const key of ["colors", "points"]) found[key] = found[key].filter((_, k) => Number.isFinite(found.points[k][0]));
  if (ending === "glb") found.points = found.points.map((point) => point.map((x) => 1000 * x));
  return found;

  async function add(part) {
    const { position, normal, color, uv } = part.geometry.attributes;
    const first = found.points.length;
    const entries = (attribute, width, change) => Array.from({ length: attribute?.count ?? 0 }, (_, k) => change([attribute.getX(k), attribute.getY(k), width > 2 ? attribute.getZ(k) : 0].slice(0, width)));
    found.points.push(...entries(position, 3, (p) => new THREE.Vector3(...p).applyMatrix4(part.matrixWorld).toArray()));
    found.normals.push(...entries(normal, 3, (n) => new THREE.Vector3(...n).transformDirection(part.matrixWorld).toArray()));
    // three.js stores linear colors.
    found.colors.push(...entries(color, 3, (c) => new THREE.Color(...c).convertLinearToSRGB().toArray().map((x) => 255 * x)));
    // In glTF, texture coordinates begin at the top.
    found.uv.push(...entries(uv, 2, ([u, v]) => [u, ending === "glb" ? 1 - v : v]));
    const index = part.geometry.index?.array ?? Array.from({ length: position?.count ?? 0 }, (_, k) => k);
    if (part.isMesh) for (let k = 0; k < index.length; k += 3) found.faces.push([0, 1, 2].map((it) => first + index[k + it]));
    if (part.isLineSegments) for (let k = 0; k < index.length; k += 2) found.lines.push([first + index[k], first + index[k + 1]]);
    else if (part.isLine) found.lines.push(Array.from(index, (k) => first + k));
    if (part.isMesh) for (const [k, material] of [part.material].flat().entries()) {
      const groups = part.geometry.groups.filter((group) => Array.isArray(part.material) && group.materialIndex === k);
      const corners = groups.length > 0 ? groups.reduce((sum, group) => sum + group.count, 0) : index.length;
      const kinds = { color: "map", emission: "emissiveMap", normals: "normalMap", roughness: "roughnessMap" };
      const maps = Object.entries(kinds).filter(([, key]) => material[key]).map(([kind]) => kind);
      found.materials[material.name] = { triangles: corners / 3, maps, color: material.color?.toArray() };
    }
    for (const material of [part.material].flat()) if (material?.map?.image) found.picture = await pixels(material.map.image);
  }

  async function pixels(image) {
    const canvas = new OffscreenCanvas(image.width, image.height);
    const pen = canvas.getContext("2d");
    pen.drawImage(image, 0, 0);
    const { data, width, height } = pen.getImageData(0, 0, canvas.width, canvas.height);
    // The same subsampling as in `record.thinned`.
    const step = Math.ceil(Math.max(width, height) / 64);
    const every = (count) => Array.from({ length: Math.ceil(count / step) }, (_, k) => k * step);
    return { size: [width, height], rows: every(height).map((y) => every(width).map((x) => Array.from(data.slice(4 * (y * width + x), 4 * (y * width + x) + 3)))) };
  }
}

const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });
const page = await browser.newPage();
let folder = ".";
await page.route("http://three/**", (route) => {
  const [, kind, ...rest] = new URL(route.request().url()).pathname.split("/").map(decodeURIComponent);
  const path = kind === "module" ? join(made, "node_modules/three", ...rest) : join(folder, ...rest);
  try {
    const [body, ending] = kind === "page" ? [PAGE, "html"] : [readFileSync(path), path.split(".").pop()];
    return route.fulfill({ body, contentType: TYPES[ending] ?? "application/octet-stream" });
  } catch {
    return route.fulfill({ status: 404 });
  }
});
await page.goto("http://three/page");
for (const file of files) {
  folder = dirname(file);
  const record = await page.evaluate(find, basename(file)).catch((error) => ({ error: error.message.split("\n")[0] }));
  process.stdout.write(JSON.stringify({ file, ...record }) + "\n");
}
await browser.close();
