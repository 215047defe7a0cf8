// Data of contact sheets for the tests, with pictures that the browser derives from that of the doll.
import { readFileSync } from "node:fs";
import { resolve } from "node:path";

const DOLL = readFileSync(resolve(import.meta.dirname, "../../docs/doll.png"));

/** Draws a number of different pictures: the doll in other colors and sizes. */
export async function pictures(page, count) {
  return page.evaluate(async ([doll, count]) => {
    const image = await createImageBitmap(await (await fetch(doll)).blob());
    const canvas = Object.assign(document.createElement("canvas"), { width: 320, height: 240 });
    const pen = canvas.getContext("2d");
    const draw = (k) => {
      pen.filter = `hue-rotate(${(k * 47) % 360}deg) brightness(${1 + 0.03 * (k % 7)})`;
      const width = 800 - 40 * (k % 9);
      pen.drawImage(image, (800 - width) / 2 - 12 * (k % 5), (800 - width) / 4, width, 0.75 * width, 0, 0, 320, 240);
      return canvas.toDataURL("image/jpeg", 0.86);
    };
    return Array.from({ length: count }, (_, k) => draw(k));
  }, [`data:image/png;base64,${DOLL.toString("base64")}`, count]);
}

const product = (lists) => lists.reduce((all, list) => all.flatMap((some) => list.map((one) => [...some, one])), [[]]);

/** A sheet with a task for each combination of values; `values` has the list of each name. */
function sheet(title, values, drawn, change = () => ({})) {
  const names = Object.keys(values);
  const tasks = product(Object.values(values)).map((values, k) => {
    const name = values.map((value) => value.replaceAll(/\W/g, "")).join("/");
    const files = ["model.glb", "grid.npz"].map((file, n) => ({ name: file, path: `${name}/${file}`, bytes: 1234567 + 4321 * k - n * 1200000 }));
    const task = { name, state: "done", values, seconds: 0.05 + ((k * 37) % 100) / 130, nodes: { computed: 3, cached: 11 }, picture: drawn[k % drawn.length], files, problems: [] };
    return { ...task, ...change(k, task) };
  });
  return { title, graph: "doll.ron", names, size: [320, 240], tasks };
}

const failed = (message, place, help) => ({ state: "failed", picture: null, files: [], problems: [{ severity: "error", message, place, help }] });

export const three = (drawn) => sheet("doll.sweep.ron", { scan: ["doll"], growth: ["5", "12", "20"] }, drawn);

export const sixty = (drawn) =>
  sheet("doll.sweep.ron", { scan: ["doll", "mug", "vase"], growth: ["5", "cm(1.2)", "20", "mm(0.4)"], "nose color": ['"#c33923"', '"#3f7ad1"', '"#e0b03a"', '"#6a4c93"', '"#2e8b57"'] }, drawn, (k) => {
    if (k === 17) return failed("field `select` of Threshold has no color that is near", "doll.ron:12:45", "take a larger `distance`: the nearest color is 41.3 away");
    if (k === 43) return failed("growth must be at least 1 mm, and is 0.4 mm\nwhich is less than the scan's own noise, so that what is offset would touch what it is offset from", "doll.ron:7:3", null);
    if (k === 59) return { state: "missing", picture: null, files: [], seconds: null, nodes: null };
    if (k === 3) return { picture: drawn[2] };
    if (k === 8) return { problems: [{ severity: "warning", message: "3 faces of `skin` are folded", place: "doll.ron:21:9", help: "a smaller `growth` does not fold them" }] };
    return {};
  });

export const thousand = (drawn) =>
  sheet("heads.sweep.ron", { scan: Array.from({ length: 20 }, (_, k) => `head-${k + 1}`), growth: Array.from({ length: 10 }, (_, k) => `${2 * k + 1}`), levels: ["0", "1", "2", "3", "4"] }, drawn, (k) =>
    k % 97 === 5 ? failed("the mesh is not closed", "heads.ron:31:7", "fill its holes first") : {},
  );

/** A sheet whose names `growth` and `levels` vary together. */
export const zipped = (drawn) => {
  const made = sheet("zip.sweep.ron", { scan: ["a", "b"], growth: ["5", "12", "20"], levels: ["-"] }, drawn);
  for (const task of made.tasks) task.values[2] = { 5: "0", 12: "1", 20: "1" }[task.values[1]];
  return made;
};

/** A sheet with tasks in all states; missing facts are left out or null, as in records. */
export const partial = (drawn) => {
  const none = { state: "missing", seconds: null, nodes: null, picture: null, files: [] };
  const changes = [
    { nodes: { cached: 7 } },
    { nodes: { computed: 1 }, picture: null },
    { nodes: { computed: 2, equal: 1, cached: 3, failed: 1, skipped: 4 }, ...failed("it did not converge", null, null) },
    { nodes: {}, ...failed("", null, "") },
    { ...none, nodes: {}, state: "failed", seconds: 0 },
    none,
    { seconds: 90.5 },
    { seconds: 59.96 },
    { seconds: 7199 },
  ];
  return sheet("partial.sweep.ron", { k: changes.map((_, k) => `${k}`) }, drawn, (k) => changes[k]);
};

const LONG = "x".repeat(2000);
export const HOSTILE = [
  '<img src=x onerror="window.broken = 1">',
  "</script><script>window.broken = 1</script>",
  '"onmouseover="window.broken = 1" ',
  "@@script@@ @@data@@ $& ${broken}",
  "\u202Eright to left\u202C \u05E9\u05DC\u05D5\u05DD",
  LONG,
  "__proto__",
  "toString(1)",
  "line\nbreak\ttab\0nul",
  "",
];

/** A sheet whose names, paths and messages try to inject scripts or to break the layout. */
export const hostile = (drawn) => {
  const names = ["<b>bold</b>", "__proto__", "constructor", LONG];
  const tasks = HOSTILE.flatMap((text, k) => ["one", "two"].map((other, n) => ({
    name: `${text}${other}`, state: ["done", "failed", "missing"][(k + n) % 3], values: [text, other, String(k), text], seconds: n ? null : 1e6 * k, nodes: null,
    picture: n ? "javascript:window.broken = 1" : drawn[k % drawn.length],
    files: [{ name: text, path: n ? "javascript:window.broken=1" : `../${text}/#?%&.glb`, bytes: 1e12 }],
    problems: [{ severity: "error", message: text, place: text, help: text }, { severity: "warning", message: LONG, place: null }],
  })));
  return { title: HOSTILE[0], graph: HOSTILE[1], names, size: [0, 0], tasks };
};

export const empty = () => ({ title: "empty.sweep.ron", graph: "doll.ron", names: [], size: [320, 240], tasks: [] });
