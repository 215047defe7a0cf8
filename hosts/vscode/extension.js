// The extension: starts `maquette lsp`, and shows what its commands tell.
const { execFile } = require("node:child_process");
const { homedir } = require("node:os");
const { isAbsolute, join } = require("node:path");
const { commands, env, UIKind, Uri, ViewColumn, window, workspace } = require("vscode");
const { LanguageClient, RevealOutputChannelOn } = require("vscode-languageclient/node");

/** The commands of the server that are in the palette. */
const COMMANDS = ["maquette.run", "maquette.watch", "maquette.stop"];

/** How long a program may take to say that it has a language server, in milliseconds. */
const PATIENCE = 10_000;

/** What commands tell, and the server. @type {import("vscode").OutputChannel} */
let told;
/** @type {LanguageClient | undefined} */
let client;
/** Commands that say why there is no server, while there is none. @type {import("vscode").Disposable[]} */
let excuses = [];
/** One start or stop after the other. */
let turn = Promise.resolve();

/** @param {import("vscode").ExtensionContext} context */
exports.activate = (context) => {
  told = window.createOutputChannel("Maquette");
  context.subscriptions.push(
    told,
    commands.registerCommand("maquette.restart", restart),
    workspace.onDidChangeConfiguration((change) => {
      if (change.affectsConfiguration("maquette.path")) restart();
    }),
  );
  return restart();
};

exports.deactivate = () => next(stop);

/** @param {() => Promise<void>} step */
function next(step) {
  turn = turn.then(step, step);
  return turn;
}

const restart = () => next(async () => {
  await stop();
  await start();
});

async function stop() {
  excuses.splice(0).forEach((excuse) => excuse.dispose());
  const old = client;
  client = undefined;
  // A server that has ended by itself is as good as stopped.
  await old?.dispose().catch(() => {});
}

const settings = () => workspace.getConfiguration("maquette");

async function start() {
  const folder = workspace.workspaceFolders?.find((it) => it.uri.scheme === "file")?.uri.fsPath;
  const program = found(settings().get("path") || "maquette", folder);
  const why = await refusal(program, folder);
  if (why) {
    excuse(why);
    return;
  }
  client = new LanguageClient(
    "maquette",
    "Maquette Language Server",
    { command: program, args: ["lsp"], options: { cwd: folder } },
    {
      documentSelector: [{ language: "ron", scheme: "file" }],
      // What commands tell is shown here: the server need not tell it once more.
      initializationOptions: { ...settings(), shows: true },
      synchronize: { configurationSection: "maquette" },
      // What commands tell has an output of its own.
      revealOutputChannelOn: RevealOutputChannelOn.Never,
      middleware: {
        executeCommand: run,
        // The page that a command has opened is opened beside the text, by its answer.
        window: { showDocument: async (page, ask) => (page.external ? { success: true } : ask(page)) },
      },
    },
  );
  await client.start().catch((error) => excuse(`${program} did not start: ${error.message}`));
}

/** Says why there is no server, and again for each command. @param {string} why */
function excuse(why) {
  excuses = COMMANDS.map((command) => commands.registerCommand(command, () => complain(why)));
  // Nobody waits for the answer: the editor goes on without a server.
  complain(why);
}

/**
 * The file of a program, where it is named by a path.
 * @param {string} path
 * @param {string | undefined} folder what it is relative to
 */
function found(path, folder) {
  if (/^~[\\/]/.test(path)) return join(homedir(), path.slice(2));
  return /[\\/]/.test(path) && !isAbsolute(path) && folder ? join(folder, path) : path;
}

/**
 * Why a program is no language server for graphs, if it is none.
 * @param {string} program
 * @param {string | undefined} cwd
 * @returns {Promise<string | undefined>}
 */
function refusal(program, cwd) {
  return new Promise((tell) => {
    execFile(program, ["lsp", "--help"], { cwd, timeout: PATIENCE }, (error) => {
      if (!error) return tell(undefined);
      if (error.code === "ENOENT") return tell(`The program \`${program}\` is not there.`);
      if (typeof error.code !== "number") return tell(`\`${program}\` cannot be run: ${error.message}`);
      tell(`\`${program}\` is too old: it has no command \`lsp\`.`);
    });
  });
}

/** @param {string} why */
async function complain(why) {
  const [where, again] = ["Say where it is", "Try again"];
  const help = "Install it from its sources by `cargo install --path src/program`, or say in the setting `maquette.path` where it is.";
  const answer = await window.showErrorMessage(`${why} ${help}`, where, again);
  if (answer === where) await commands.executeCommand("workbench.action.openSettings", "maquette.path");
  if (answer === again) await restart();
}

/**
 * Runs a command of the server, of the graph in the active editor if none is named, and shows what comes back.
 * @param {string} command
 * @param {any[]} words
 * @param {(command: string, words: any[]) => any} ask
 */
async function run(command, words, ask) {
  const active = window.activeTextEditor?.document;
  const given = words.length > 0 || !active ? words : [active.uri.toString()];
  // What is run is what is seen.
  const graph = workspace.textDocuments.find((it) => given[0] && it.uri.toString() === Uri.parse(given[0]).toString());
  if (command !== "maquette.stop" && graph?.isDirty && !(await graph.save())) return undefined;
  const answer = await ask(command, given);
  if (answer?.text) {
    told.appendLine(answer.text.trimEnd() + "\n");
    told.show(true);
  }
  if (answer?.url) await open(answer.url);
  return answer;
}

/** Opens a page beside the text. @param {string} url */
async function open(url) {
  const page = Uri.parse(url);
  // A window on another machine reaches the page through a tunnel; a browser has none, and is on this machine.
  const reached = env.uiKind === UIKind.Desktop ? await env.asExternalUri(page) : page;
  const place = { viewColumn: ViewColumn.Beside, preserveFocus: true };
  // Not every editor of this kind has a browser of its own.
  await commands.executeCommand("simpleBrowser.api.open", reached, place).then(undefined, () => env.openExternal(reached));
}
