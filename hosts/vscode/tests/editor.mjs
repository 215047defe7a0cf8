// A real VS Code in a headless browser, with the extension and a copy of the project.
import { spawn, execFileSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";

const ROOT = resolve(import.meta.dirname, "../../..");
const MADE = join(ROOT, "target/vscode");

/** The timeout of waits, in milliseconds. */
export const TIMEOUT = 10_000;

/** The tested program. */
export const PROGRAM = resolve(process.env.MAQUETTE ?? join(ROOT, "target/debug/maquette"));

export class Editor {
  /**
   * Starts the editor with a copy of the files of `graphs` that the doll needs.
   * @param {{ program?: string, settings?: object }} wanted
   */
  static async start({ program = PROGRAM, settings = {} } = {}) {
    const editor = new Editor();
    editor.home = mkdtempSync(join(tmpdir(), "maquette-vscode-"));
    editor.project = join(editor.home, "project");
    mkdirSync(editor.project);
    for (const file of ["maquette.toml", "doll.ron", "face.ron", "face.test.ron", "doll", "lib"]) {
      cpSync(join(ROOT, "graphs", file), join(editor.project, file), { recursive: true });
    }
    const user = join(editor.home, "user/User");
    mkdirSync(user, { recursive: true });
    writeFileSync(join(user, "settings.json"), JSON.stringify({ ...SETTINGS, "maquette.path": program, ...settings }));
    await editor.#serve();
    await editor.#browse();
    return editor;
  }

  #words() {
    const folders = ["--user-data-dir", join(this.home, "user"), "--extensions-dir", join(this.home, "extensions")];
    return [join(MADE, "server/node_modules/code-server/out/node/entry.js"), ...folders];
  }

  /** The environment: the user's own configuration and caches are neither read nor changed. */
  #env() {
    return { ...process.env, HOME: this.home, XDG_CONFIG_HOME: this.home, XDG_DATA_HOME: this.home, XDG_CACHE_HOME: this.home };
  }

  /** Runs the editor's command line; throws if it fails. */
  #code(...words) {
    execFileSync("node", [...this.#words(), ...words], { env: this.#env(), stdio: "pipe" });
    return true;
  }

  async #serve() {
    const version = readFileSync(join(ROOT, "Cargo.toml"), "utf8").match(/^version = "(.*)"/m)[1];
    this.#code("--install-extension", join(MADE, `maquette-${version}.vsix`));
    const port = await free();
    const words = ["--auth", "none", "--bind-addr", `127.0.0.1:${port}`, "--disable-telemetry", "--disable-update-check"];
    // A separate process group, so that all of its processes can be ended.
    this.server = spawn("node", [...this.#words(), ...words, "--disable-workspace-trust", this.project], {
      env: this.#env(),
      detached: true,
      stdio: "ignore",
    });
    this.address = `http://127.0.0.1:${port}/`;
    await until(async () => (await fetch(this.address + "healthz")).ok);
  }

  async #browse() {
    const { chromium } = await import(join(MADE, "server/node_modules/playwright-core/index.mjs"));
    const args = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking", "--disable-component-update"];
    this.browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args });
    const context = await this.browser.newContext({ viewport: { width: 1600, height: 1000 }, colorScheme: "dark" });
    await context.grantPermissions(["clipboard-read", "clipboard-write"]);
    this.page = await context.newPage();
    this.page.setDefaultTimeout(TIMEOUT);
    await this.page.goto(`${this.address}?folder=${this.project}`);
    await this.page.locator(".monaco-workbench .part.statusbar").waitFor();
  }

  /** Ends everything; returns the processes that remain, as lines of `ps`. */
  async stop() {
    await this.browser?.close();
    const group = this.server?.pid;
    for (const signal of ["SIGTERM", "SIGKILL"]) {
      if (!group || alive(group).length === 0) break;
      process.kill(-group, signal);
      await until(() => alive(group).length === 0, 3000).catch(() => {});
    }
    // Processes that have left the group still have the folder in their arguments.
    const left = execFileSync("ps", ["-eo", "pid,stat,args"], { encoding: "utf8" }).split("\n").filter((line) => line.includes(this.home));
    rmSync(this.home, { recursive: true, force: true });
    return left;
  }

  /** Runs a command by its name in the palette. @param {string} name */
  async command(name) {
    const words = this.page.locator(".quick-input-widget input");
    // The focus may be about to change, so try again if that fails.
    await until(async () => {
      await this.page.keyboard.press("F1");
      await words.fill(`>${name}`, { timeout: 1000 });
      await this.page.locator(`.quick-input-list .monaco-list-row[aria-label^="${name}"]`).first().click({ timeout: 2000 });
      return true;
    });
  }

  /** Opens a file of the project. @param {string} name */
  async open(name) {
    // The editor finds a new window only after a short time.
    await until(() => this.#code("--reuse-window", join(this.project, name)));
    await this.page.locator(`.tab.active[data-resource-name="${name.split("/").at(-1)}"]`).waitFor();
    await this.page.locator(".view-lines .view-line").first().waitFor();
    // Without the focus, the editor does not request code lenses again.
    await this.focus();
  }

  /** Closes all files and discards unsaved changes. */
  async closeAll() {
    const { keyboard } = this.page;
    for (let k = 0; k < 3; k++) await keyboard.press("Escape");
    const tabs = this.page.locator(".tabs-container .tab");
    while ((await tabs.count()) > 0) {
      const many = await tabs.count();
      await tabs.first().click();
      await this.command("View: Revert and Close Editor");
      await until(async () => (await tabs.count()) < many);
    }
  }

  /** Moves the focus to the text; a web page beside it would take all keys. */
  async focus() {
    await this.page.locator(".editor-group-container .tab.active").first().click();
    await this.page.locator(".editor-group-container .monaco-editor.focused").first().waitFor();
  }

  /** Moves the cursor to the first occurrence of a text in a file, and `on` characters further. */
  async goto(name, text, on = 0) {
    const before = this.read(name).split(text)[0].split("\n");
    await this.line(before.length, before.at(-1).length + 1 + on);
  }

  async line(line, column = 1) {
    await this.focus();
    await this.page.keyboard.press("Control+g");
    await this.page.locator(".quick-input-widget input").fill(`:${line}:${column}`);
    await this.page.keyboard.press("Enter");
    await this.page.locator(".quick-input-widget").waitFor({ state: "hidden" });
  }

  type(text) {
    return this.page.keyboard.type(text, { delay: 15 });
  }

  async save() {
    await this.page.keyboard.press("Control+s");
    await this.page.locator(".tab.active.dirty").waitFor({ state: "detached" });
  }

  /** The running language servers, as lines of `ps`. */
  servers() {
    return alive(this.server.pid).filter((line) => line.includes("maquette lsp"));
  }

  /** Writes the settings of the workspace. */
  set(settings) {
    mkdirSync(join(this.project, ".vscode"), { recursive: true });
    this.write(".vscode/settings.json", JSON.stringify(settings));
  }

  read(name) {
    return readFileSync(join(this.project, name), "utf8");
  }

  /** Writes a file as another program would. */
  write(name, text) {
    writeFileSync(join(this.project, name), text);
  }

  async picture(name) {
    mkdirSync(join(MADE, "pictures"), { recursive: true });
    await this.page.screenshot({ path: join(MADE, "pictures", `${name}.png`) });
  }
}

/** Settings without notifications and automatic saves. */
const SETTINGS = {
  "chat.sendElementsToChat.enabled": false,
  "editor.minimap.enabled": false,
  "extensions.autoCheckUpdates": false,
  "extensions.ignoreRecommendations": true,
  "files.autoSave": "off",
  "git.enabled": false,
  "security.workspace.trust.enabled": false,
  "telemetry.telemetryLevel": "off",
  "update.mode": "none",
  "workbench.editor.restoreViewState": false,
  "workbench.colorTheme": "Default Dark Modern",
  "workbench.startupEditor": "none",
  "workbench.tips.enabled": false,
};

/** Waits until a function returns a truthy value, and returns it; errors count as false. */
export async function until(holds, timeout = TIMEOUT) {
  const end = Date.now() + timeout;
  for (;;) {
    let why;
    const it = await Promise.resolve().then(holds).catch((error) => void (why = error));
    if (it) return it;
    if (Date.now() > end) throw new Error(`not within ${timeout} ms: ${why ?? holds}`);
    await sleep(50);
  }
}

/** The processes of a group, as lines of `ps`. */
function alive(group) {
  const lines = execFileSync("ps", ["-eo", "pgid,stat,pid,args"], { encoding: "utf8" }).split("\n");
  return lines.filter((line) => +line.trim().split(/\s+/)[0] === group && !/^\s*\d+\s+Z/.test(line));
}

/** Finds a free port. */
function free() {
  return new Promise((tell) => {
    const server = createServer().listen(0, "127.0.0.1", () => {
      const { port } = server.address();
      server.close(() => tell(port));
    });
  });
}
