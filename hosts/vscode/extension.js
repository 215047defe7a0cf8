// The extension: starts `maquette lsp`, and shows the results of its commands.
const { execFile } = require("node:child_process");
const { homedir } = require("node:os");
const { isAbsolute, join } = require("node:path");
const { commands, env, UIKind, Uri, ViewColumn, window, workspace } = require("vscode");
const { LanguageClient, RevealOutputChannelOn } = require("vscode-languageclient/node");

/** The commands of the server in the command palette. */
const COMMANDS = ["maquette.run", "maquette.watch", "maquette.stop"];

/** The timeout of the check that a program has a language server, in milliseconds. */
const CHECK_TIMEOUT = 10_000;

/** The output of commands. @type {import("vscode").OutputChannel} */
let output;
/** @type {LanguageClient | undefined} */
let client;
/** While there is no server: replacements of its commands, which report the reason. @type {import("vscode").Disposable[]} */
let standIns = [];
/** The pending starts and stops, which run one after the other. */
let pending = Promise.resolve();

/** @param {import("vscode").ExtensionContext} context */
exports.activate = (context) => {
  output = window.createOutputChannel("Maquette");
  context.subscriptions.push(
    output,
    commands.registerCommand("maquette.restart", restart),
    workspace.onDidChangeConfiguration((change) => {
      if (change.affectsConfiguration("maquette.path")) restart();
    }),
  );
  return restart();
};

exports.deactivate = () => enqueue(stop);

/** @param {() => Promise<void>} step */
function enqueue(step) {
  pending = pending.then(step, step);
  return pending;
}

const restart = () => enqueue(async () => {
  await stop();
  await start();
});

async function stop() {
  standIns.splice(0).forEach((standIn) => standIn.dispose());
  const old = client;
  client = undefined;
  // An error means that the server has ended already.
  await old?.dispose().catch(() => {});
}

const settings = () => workspace.getConfiguration("maquette");

async function start() {
  const folder = workspace.workspaceFolders?.find((it) => it.uri.scheme === "file")?.uri.fsPath;
  const program = resolvePath(settings().get("path") || "maquette", folder);
  const why = await refusal(program, folder);
  if (why) {
    reportNoServer(why);
    return;
  }
  client = new LanguageClient(
    "maquette",
    "Maquette Language Server",
    { command: program, args: ["lsp"], options: { cwd: folder } },
    {
      documentSelector: [{ language: "ron", scheme: "file" }],
      // The extension shows the results of commands, so the server must not show them, too.
      initializationOptions: { ...settings(), shows: true },
      synchronize: { configurationSection: "maquette" },
      // The results of commands have another output channel.
      revealOutputChannelOn: RevealOutputChannelOn.Never,
      middleware: {
        executeCommand: run,
        // The live page is opened beside the text, by the answer of the command.
        window: { showDocument: async (page, ask) => (page.external ? { success: true } : ask(page)) },
      },
    },
  );
  await client.start().catch((error) => reportNoServer(`${program} did not start: ${error.message}`));
}

/** Reports why there is no server, now and on each command. @param {string} why */
function reportNoServer(why) {
  standIns = COMMANDS.map((command) => commands.registerCommand(command, () => showReason(why)));
  // Not awaited: the editor continues without a server.
  showReason(why);
}

/**
 * Resolves the path of a program; a name without a folder is unchanged.
 * @param {string} path
 * @param {string | undefined} folder the base of relative paths
 */
function resolvePath(path, folder) {
  if (/^~[\\/]/.test(path)) return join(homedir(), path.slice(2));
  return /[\\/]/.test(path) && !isAbsolute(path) && folder ? join(folder, path) : path;
}

/**
 * The reason why a program is not a language server for graphs; undefined if it is one.
 * @param {string} program
 * @param {string | undefined} cwd
 * @returns {Promise<string | undefined>}
 */
function refusal(program, cwd) {
  return new Promise((resolve) => {
    execFile(program, ["lsp", "--help"], { cwd, timeout: CHECK_TIMEOUT }, (error) => {
      if (!error) return resolve(undefined);
      if (error.code === "ENOENT") return resolve(`Cannot find the program \`${program}\`.`);
      if (typeof error.code !== "number") return resolve(`Cannot run \`${program}\`: ${error.message}`);
      resolve(`\`${program}\` is too old: it has no command \`lsp\`.`);
    });
  });
}

/** @param {string} why */
async function showReason(why) {
  const [where, again] = ["Set path", "Try again"];
  const help = "Install it from its sources with `cargo install --path src/program`, or set its path in the setting `maquette.path`.";
  const answer = await window.showErrorMessage(`${why} ${help}`, where, again);
  if (answer === where) await commands.executeCommand("workbench.action.openSettings", "maquette.path");
  if (answer === again) await restart();
}

/**
 * Runs a command of the server and shows its result. The default argument is the graph in the active editor.
 * @param {string} command
 * @param {any[]} words
 * @param {(command: string, words: any[]) => any} ask
 */
async function run(command, words, ask) {
  const active = window.activeTextEditor?.document;
  const given = words.length > 0 || !active ? words : [active.uri.toString()];
  // Save first, so that the graph runs as it is shown.
  const graph = workspace.textDocuments.find((it) => given[0] && it.uri.toString() === Uri.parse(given[0]).toString());
  if (command !== "maquette.stop" && graph?.isDirty && !(await graph.save())) return undefined;
  const answer = await ask(command, given);
  if (answer?.text) {
    output.appendLine(answer.text.trimEnd() + "\n");
    output.show(true);
  }
  if (answer?.url) await open(answer.url);
  return answer;
}

/** Opens a page beside the text. @param {string} url */
async function open(url) {
  const page = Uri.parse(url);
  // A desktop window connected to another machine needs a tunnel to the page. A browser has no tunnel, and is on this machine.
  const reached = env.uiKind === UIKind.Desktop ? await env.asExternalUri(page) : page;
  const place = { viewColumn: ViewColumn.Beside, preserveFocus: true };
  // Some editors have no built-in browser.
  await commands.executeCommand("simpleBrowser.api.open", reached, place).then(undefined, () => env.openExternal(reached));
}
