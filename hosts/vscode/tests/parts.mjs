// Tests of snippets and problem matchers with the program.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { after, test } from "node:test";

const HERE = resolve(import.meta.dirname, "..");
const PROGRAM = resolve(process.env.MAQUETTE ?? join(HERE, "../../target/debug/maquette"));
const read = (name) => JSON.parse(readFileSync(join(HERE, name), "utf8"));
const { contributes, browser } = read("package.json");
const snippets = read("snippets.json");

const folder = mkdtempSync(join(tmpdir(), "maquette-snippets-"));
after(() => rmSync(folder, { recursive: true }));
const write = (name, text) => writeFileSync(join(folder, name), text);
const check = (name, ...words) => spawnSync(PROGRAM, ["check", name, ...words], { cwd: folder, encoding: "utf8" });

/** The text of a snippet with its default values. */
function plain(name) {
  const body = [snippets[name].body].flat().join("\n");
  const text = body.replaceAll(/\$\{\d+\|([^,|]*)[^|]*\|\}/g, "$1").replaceAll(/\$\{\d+:([^}]*)\}/g, "$1");
  return text.replaceAll(/\$\d+/g, "");
}

const MESH = "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
for (const [name, text] of [["maquette.toml", ""], ["scan.obj", MESH], ["graph.ron", plain("Graph") + "\n"]]) write(name, text);

/** A file for each snippet; parts of a graph are embedded in a graph. */
const files = {
  Graph: ["whole.ron", plain("Graph")],
  "Graph with inputs": ["part.ron", plain("Graph with inputs")],
  Patch: ["patch.ron", plain("Patch")],
  Test: ["graph.test.ron", plain("Test")],
  Sweep: ["graph.sweep.ron", plain("Sweep")],
  ForEach: ["each.ron", graph(`"scan": ReadMesh(path: "scan.obj"), ${plain("ForEach")}`)],
  Switch: ["switch.ron", graph(`"scan": ReadMesh(path: "scan.obj"), "lifted": Transform(mesh: "scan"), ${plain("Switch")}`)],
  Number: ["number.ron", graph(`"scan": ReadMesh(path: "scan.obj")`, plain("Number"))],
  Choice: ["choice.ron", graph(`"scan": ReadMesh(path: "scan.obj")`, plain("Choice"))],
  Expr: ["expr.ron", graph(`"scan": Primitive(shape: Sphere(radius: ${plain("Expr")}))`)],
  Draft: ["draft.ron", graph(`"ball": ReadMesh(path: "scan.obj"), "scan": Subdivide(mesh: "ball", scheme: Loop, levels: ${plain("Draft")})`)],
};
write("lifted.ron", 'Graph(format: 1, params: { "lift": Number(default: 1.0) }, nodes: { "it": Primitive(shape: Sphere(radius: Param("lift"))) }, outputs: { "mesh": "it" }, inputs: {})\n');

function graph(nodes, params = "") {
  const all = params || `"lift": Number(default: 1.0), ${plain("Choice")}`;
  return `Graph(format: 1, use: { "Part": "lifted.ron" }, params: { ${all} }, nodes: { ${nodes} }, outputs: { "scan.ply": "scan" })`;
}

test("each snippet is tested", () => assert.deepEqual(Object.keys(files).sort(), Object.keys(snippets).sort()));

for (const [name, [file, text]] of Object.entries(files)) {
  test(`the snippet ${name} has no errors with its default values`, () => {
    write(file, text + "\n");
    const { problems } = JSON.parse(check(file, "--json").stdout);
    assert.deepEqual(problems.filter((it) => it.severity === "error").map((it) => it.message), [], text);
  });
}

/** The problems that a matcher finds in lines. Like the editor, applies each of its patterns to one line. */
function applyMatcher(name, lines) {
  const patterns = [contributes.problemMatchers.find((it) => it.name === name).pattern].flat();
  const found = [];
  for (let at = 0; at + patterns.length <= lines.length; at++) {
    const parts = patterns.map((pattern, k) => new RegExp(pattern.regexp).exec(lines[at + k]));
    if (parts.includes(null)) continue;
    const problem = {};
    patterns.forEach(({ regexp, ...fields }, k) => Object.entries(fields).forEach(([field, group]) => (problem[field] = parts[k][group])));
    found.push(problem);
  }
  return found;
}

test("the problem matcher finds the problems of check", () => {
  write("bad.ron", 'Graph(\n    format: 1,\n    nodes: { "a": Foo(), "b": ReadMesh(path: "scan.obj", x: 1) },\n    outputs: {},\n)\n');
  const { problems } = JSON.parse(check("bad.ron", "--json").stdout);
  const wanted = problems.map(({ severity, code, message, file, line, column }) => ({ severity, code, message, file, line: `${line}`, column: `${column}` }));
  assert.ok(wanted.length > 1);
  assert.deepEqual(applyMatcher("maquette", check("bad.ron").stderr.split("\n")), wanted);
});

test("the problem matcher of batches finds failed tasks", () => {
  write("none.obj", "no mesh\n");
  const { stderr } = spawnSync(PROGRAM, ["batch", "graph.ron", "--sweep", "scan.path=none.obj,scan.obj", "--no-cache"], { cwd: folder, encoding: "utf8" });
  const [first] = applyMatcher("maquette-batch", stderr.split("\n"));
  assert.equal(first?.severity, "error", stderr);
  assert.ok(first.file.endsWith("graph.ron") && Number(first.line) > 0, stderr);
});

test("the extension has an entry point for editors without a machine", () => assert.equal(browser, "web.js"));
