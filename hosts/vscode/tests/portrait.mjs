// Takes the screenshot of the README: `node hosts/vscode/tests/portrait.mjs FILE.png`, after `bash hosts/vscode/test`.
import { execFileSync } from "node:child_process";
import { Editor, until } from "./editor.mjs";

const editor = await Editor.start({
  settings: {
    "breadcrumbs.enabled": false,
    "editor.fontSize": 13,
    "editor.guides.indentation": false,
    "editor.hideCursorInOverviewRuler": true,
    "editor.overviewRulerBorder": false,
    "editor.renderLineHighlight": "none",
    "editor.scrollbar.horizontal": "hidden",
    "editor.scrollbar.vertical": "hidden",
    "window.commandCenter": false,
    "window.title": "maquette",
    "workbench.activityBar.location": "hidden",
    "workbench.editor.editorActionsLocation": "hidden",
    "workbench.layoutControl.enabled": false,
    "window.menuBarVisibility": "hidden",
  },
});
const { page } = editor;

/** Drags the mouse from one point to another. */
async function drag(from, to) {
  await page.mouse.move(...from);
  await page.mouse.down();
  await page.mouse.move(...to, { steps: 12 });
  await page.mouse.up();
}

try {
  await editor.open("doll.ron");
  await editor.command("View: Close Primary Side Bar");
  await editor.command("Problems: Focus on Problems View");
  const panel = await page.locator(".part.panel").boundingBox();
  await drag([400, panel.y], [400, 880]);
  await editor.focus();
  await page.locator(".codelens-decoration a", { hasText: /live|watch/i }).click();
  const frame = await until(async () => {
    for (const it of page.frames()) if ((await it.title().catch(() => "")) === "doll.ron - maquette") return it;
  });
  await until(() => frame.evaluate(() => document.querySelector(".frame canvas")?.dataset.shown));

  const group = await page.locator(".editor-group-container").nth(1).boundingBox();
  await drag([group.x, 400], [940, 400]);
  // Make room for the doll: the graph needs less than its default height.
  const graph = await frame.locator("#graph").boundingBox();
  await drag([graph.x + graph.width - 4, graph.y + graph.height - 4], [graph.x + graph.width - 4, graph.y + 130]);
  const canvas = await frame.locator(".frame canvas").first().boundingBox();
  const middle = [canvas.x + canvas.width / 2, canvas.y + canvas.height / 2];
  await drag(middle, [middle[0] + 70, middle[1] + 30]);

  await editor.goto("doll.ron", 'red", connectivity');
  for (let k = 0; k < 3; k++) await page.keyboard.press("Shift+ArrowRight");
  await editor.type("rad");
  await page.keyboard.press("Escape");
  await page.locator(".squiggly-error").first().waitFor();
  await page.locator(".view-line", { hasText: "Subdivide" }).locator("span", { hasText: /^scheme$/ }).first().hover();
  await page.locator(".monaco-hover:visible").first().waitFor();
  await page.waitForTimeout(1500);
  await page.screenshot({ path: process.argv[2] });
  // 256 colors are enough, with a third of the bytes.
  execFileSync("convert", [process.argv[2], "-dither", "FloydSteinberg", "-colors", "256", "-strip", `PNG8:${process.argv[2]}`]);
} finally {
  await editor.stop();
}
