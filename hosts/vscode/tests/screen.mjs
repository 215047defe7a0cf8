// Tests of the user interface. A test's name begins with the number of a requirement in the design of the language server.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { existsSync, rmSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { Editor, PROGRAM, until } from "./editor.mjs";

/** @type {Editor} */
let editor;
/** The original texts of the files that tests change. */
let originals;

before(async () => {
  editor = await Editor.start();
  originals = Object.fromEntries(["doll.ron", "face.ron", "lib/feature.ron"].map((name) => [name, editor.read(name)]));
});

after(async () => {
  const left = await editor.stop();
  assert.deepEqual(left, [], "no process remains");
});

/** Defines a test that starts with the original files and takes a screenshot at the end. */
function check(name, body) {
  test(name, { timeout: 60_000 }, async () => {
    await editor.closeAll();
    for (const [file, text] of Object.entries(originals)) editor.write(file, text);
    try {
      await body(editor.page);
    } finally {
      await editor.picture(name.replaceAll(" ", "-"));
    }
  });
}

/** Repeats an action until an element is visible: after a change, the editor cancels its own requests and shows no results for a while. */
function untilVisible(locator, act) {
  return until(async () => {
    await act();
    await locator.waitFor({ timeout: 2000 });
    return true;
  });
}

/** Waits until a file has this text; during a write, it may have only a part of it. */
async function waitForFile(name, text) {
  await until(() => editor.read(name) === text).catch(() => assert.equal(editor.read(name), text));
}

/** The problems that `maquette check` reports for a file. */
function problemsOfCheck(name) {
  const { stdout } = spawnSync(PROGRAM, ["check", "--json", name], { cwd: editor.project, encoding: "utf8" });
  return JSON.parse(stdout).problems;
}

/** Makes an error: changes the node's name in the link of `spots`. */
async function makeError() {
  await editor.open("doll.ron");
  await editor.command("Problems: Focus on Problems View");
  await editor.goto("doll.ron", 'red", connectivity');
  for (let k = 0; k < 3; k++) await editor.page.keyboard.press("Shift+ArrowRight");
  await editor.type("rad");
  await editor.page.locator(".squiggly-error").first().waitFor();
  // Not a problem of an earlier, partial change.
  await problems().filter({ hasText: "`rad`" }).first().waitFor();
}

/** The problems in the panel. */
const problems = () => editor.page.locator(".markers-panel .monaco-list-row .marker-message-details-container");

check("1 an error has a squiggle and the message of check", async () => {
  await makeError();
  editor.write("copy.ron", originals["doll.ron"].replace('"red", connectivity', '"rad", connectivity'));
  const [problem, ...others] = problemsOfCheck("copy.ron");
  assert.deepEqual(others, []);
  const text = (await problems().first().innerText()).replaceAll(/\s+/g, " ");
  assert.ok(text.includes(problem.message), `${text}, not ${problem.message}`);
  assert.ok(text.includes(problem.code) && text.includes(`[Ln ${problem.line}, Col ${problem.column}]`), text);
});

check("7 a quick fix is one click, and the problem is gone", async (page) => {
  await makeError();
  await page.keyboard.press("ArrowLeft");
  const fix = page.locator(".action-widget .monaco-list-row.action").filter({ hasText: "red" }).first();
  await untilVisible(fix, async () => {
    await page.keyboard.press("Escape");
    await page.keyboard.press("Control+.");
  });
  // The list ignores the mouse until it moves.
  await fix.hover({ force: true });
  await fix.click({ force: true });
  await page.locator(".squiggly-error").first().waitFor({ state: "detached" });
  await until(async () => (await problems().count()) === 0);
  await editor.save();
  await waitForFile("doll.ron", originals["doll.ron"]);
});

check("2 completion offers the missing fields of a node", async (page) => {
  await editor.open("doll.ron");
  await editor.goto("doll.ron", ", select: Near");
  await editor.type(", ");
  const list = page.locator(".suggest-widget.visible .monaco-list-row");
  const suggest = async () => {
    await page.keyboard.press("Escape");
    await page.keyboard.press("Control+Space");
  };
  await untilVisible(list.filter({ hasText: "within" }).first(), suggest);
  const offered = await list.allInnerTexts();
  const first = offered.slice(0, 5).map((it) => it.trim().split(/\W/)[0]);
  assert.ok(first.includes("within") && first.includes("invert"), offered.join("; "));
  assert.ok(!first.includes("image") && !first.includes("select"), offered.join("; "));
  await page.keyboard.press("Escape");
  await editor.goto("doll.ron", '"whole", pick', 1);
  await untilVisible(list.filter({ hasText: "scan.range" }).first(), suggest);
});

check("4 a hover over a node type shows its documentation", async (page) => {
  await editor.open("doll.ron");
  await page.locator(".view-line span", { hasText: /^Threshold$/ }).first().hover();
  await page.locator(".monaco-hover:visible", { hasText: "Selects pixels by color or brightness, and returns them as a mask." }).waitFor();
});

check("5 go to definition leads into a used graph", async (page) => {
  await editor.open("face.ron");
  await editor.goto("face.ron", "Feature(color", 2);
  await page.keyboard.press("F12");
  await page.locator('.tab.active[data-resource-name="feature.ron"]').waitFor();
});

check("6 a rename changes the name in all files and nothing else", async (page) => {
  await editor.open("lib/feature.ron");
  await editor.goto("lib/feature.ron", '"growth"', 2);
  await page.keyboard.press("F2");
  await page.locator(".rename-box input").fill("rise");
  await page.keyboard.press("Enter");
  await page.locator(".rename-box:visible").waitFor({ state: "detached" });
  await editor.command("File: Save All");
  await waitForFile("lib/feature.ron", originals["lib/feature.ron"].replaceAll('"growth"', '"rise"'));
  await waitForFile("face.ron", originals["face.ron"].replaceAll("growth:", "rise:"));
  assert.deepEqual(problemsOfCheck("face.ron"), []);
});

check("8 a node is extracted into a graph and inlined again", async (page) => {
  await editor.open("doll.ron");
  const choose = async (title) => {
    const action = page.locator(".action-widget .monaco-list-row.action").filter({ hasText: title }).first();
    await untilVisible(action, async () => {
      await editor.goto("doll.ron", '"spots":', 2);
      await page.keyboard.press("Control+Shift+R");
    });
    await action.hover({ force: true });
    await action.click({ force: true });
    await action.waitFor({ state: "detached" });
  };
  await choose("Extract `spots` into a graph");
  await until(() => existsSync(join(editor.project, "spots.ron")));
  await page.locator(".view-line", { hasText: "Spots(" }).first().waitFor();
  await editor.command("File: Save All");
  await until(() => editor.read("doll.ron").includes('"Spots": "spots.ron"') && editor.read("spots.ron").includes("Label("));
  editor.write("copy.ron", originals["doll.ron"]);
  assert.deepEqual(problemsOfCheck("doll.ron"), problemsOfCheck("copy.ron"));
  await choose("Inline `spots`");
  await page.locator(".view-line", { hasText: "Spots(" }).first().waitFor({ state: "detached" });
  await editor.command("File: Save All");
  await waitForFile("doll.ron", originals["doll.ron"]);
  rmSync(join(editor.project, "spots.ron"));
});

check("9 a color has a box, and a pick changes that one text", async (page) => {
  await editor.open("doll.ron");
  const box = page.locator(".colorpicker-color-decoration");
  await until(async () => (await box.count()) === 1);
  await box.first().click();
  const field = page.locator(".colorpicker-widget .saturation-wrap");
  await field.waitFor();
  await field.click({ position: { x: 20, y: 20 } });
  await page.keyboard.press("Escape");
  await page.locator(".tab.active.dirty").waitFor();
  await editor.save();
  const now = editor.read("doll.ron");
  const [before, behind] = originals["doll.ron"].split("#c33923");
  assert.ok(now.startsWith(before) && now.endsWith(behind), now);
  const color = now.slice(before.length, now.length - behind.length);
  assert.match(color, /^#[0-9a-f]{6}$/);
  assert.notEqual(color, "#c33923");
});

check("9 the outline names what a graph has", async (page) => {
  await editor.open("doll.ron");
  await page.keyboard.press("Control+Shift+o");
  const list = page.locator(".quick-input-list .monaco-list-row");
  for (const name of ["params", "growth", "nodes", "nose"]) {
    await list.filter({ hasText: new RegExp(`^\\s*${name}`) }).first().waitFor();
  }
});

check("9 sections fold", async (page) => {
  await editor.open("doll.ron");
  const numbers = async () => (await page.locator(".line-numbers").allInnerTexts()).map(Number).sort((a, b) => a - b);
  const begin = originals["doll.ron"].split("nodes: {")[0].split("\n").length;
  const end = originals["doll.ron"].split("outputs: {")[0].split("\n").length;
  await until(async () => (await numbers()).includes(begin + 1));
  await editor.goto("doll.ron", "nodes: {");
  await page.keyboard.press("Control+Shift+[");
  await until(async () => (await numbers()).includes(end) && !(await numbers()).some((it) => it > begin && it < end - 1));
});

check("9 the path of a scan is a link to it", async (page) => {
  await editor.open("doll.ron");
  await page.keyboard.press("Control+Home");
  const path = page.locator(".view-line .detected-link", { hasText: "doll/range.pcd" });
  await path.first().waitFor();
  await path.first().click({ modifiers: ["ControlOrMeta"] });
  await page.locator('.tab[data-resource-name="range.pcd"]').waitFor();
});

check("11 the run of a lens writes the outputs, and its text is shown", async (page) => {
  await editor.open("doll.ron");
  await lens(/run/i).click();
  await until(() => existsSync(join(editor.project, "out/doll/model.glb")), 60_000);
  await page.locator(".output-view-container, .pane-body.output-view").filter({ hasText: "model.glb" }).waitFor();
  assert.deepEqual(await page.locator(".notification-toast").allInnerTexts(), [], "nothing pops up beside it");
});

check("10 after a run, nodes have hints with their results", async (page) => {
  await editor.open("doll.ron");
  await page.locator(".view-line", { hasText: /"nose":\sExtractRegion.*\d+\s(ms|s)\b/ }).waitFor();
});

check("11 lenses show why a node would run and its results", async (page) => {
  await editor.open("doll.ron");
  await lens(/inspect/i).first().click();
  const output = page.locator(".output-view-container, .pane-body.output-view");
  await output.filter({ hasText: /red\.mask:\sMask/ }).waitFor();
  await lens(/why/i).first().click();
  await output.filter({ hasText: /`red`\sdoes\snot\srun/ }).waitFor();
});

check("11 the live page is beside the text, follows it, and stops", async (page) => {
  await editor.open("doll.ron");
  await lens(/watch|live/i).click();
  const frame = await until(async () => {
    for (const it of page.frames()) if ((await it.title().catch(() => "")) === "doll.ron - maquette") return it;
  }, 30_000);
  await until(async () => (await frame.locator("#link").innerText()) === "live");
  await until(() => frame.evaluate(() => document.querySelector(".frame canvas")?.dataset.shown), 40_000);
  await editor.focus();
  await lens(/stop/).waitFor();
  // The page follows saved changes.
  await editor.goto("doll.ron", "12.0, min");
  for (let k = 0; k < 2; k++) await page.keyboard.press("Shift+ArrowRight");
  await editor.type("30");
  await editor.save();
  await until(async () => (await frame.locator("#parameters input").first().inputValue()) === "30");
  await editor.picture("11-live-page");
  await lens(/stop/).click();
  await until(async () => (await frame.locator("#link").innerText()) !== "live");
});

/** The code lens whose text matches. */
const lens = (name) => editor.page.locator(".codelens-decoration a", { hasText: name });

check("12 a missing program is reported with a way out", async (page) => {
  await editor.open("doll.ron");
  for (const [program, words] of [["/nowhere/maquette", "Cannot find the program `/nowhere/maquette`"], ["/bin/false", "`/bin/false` is too old"]]) {
    editor.set({ "maquette.path": program });
    const message = page.locator(".notification-toast", { hasText: words });
    await message.waitFor();
    const text = await message.innerText();
    for (const part of ["`cargo install --path src/program`", "`maquette.path`", "Set path", "Try again"]) assert.ok(text.includes(part), text);
  }
  // The commands report the same reason.
  await editor.command("Notifications: Clear All Notifications");
  await editor.command("Maquette: Run graph");
  await page.locator(".notification-toast", { hasText: "`/bin/false` is too old" }).waitFor();
  assert.equal(await page.locator(".notification-toast", { hasText: "not found" }).count(), 0);
  editor.set({});
  await editor.command("Notifications: Clear All Notifications");
  await lens(/run/i).waitFor();
});

check("12 a restart ends the server and starts another one", async () => {
  await editor.open("doll.ron");
  const before = await until(() => editor.servers()[0]);
  await editor.command("Maquette: Restart server");
  await until(() => editor.servers().length === 1 && editor.servers()[0] !== before);
  await lens(/run/i).waitFor();
});
