// The extension where there is no machine behind the editor, as on vscode.dev: colors and snippets work there, and commands say why they do not.
const { commands, window } = require("vscode");

const WHY = "Graphs are checked and run by the program `maquette`, which needs a machine: open this folder in Visual Studio Code, or in code-server on one.";

/** @param {import("vscode").ExtensionContext} context */
exports.activate = (context) => {
  for (const command of ["run", "watch", "stop", "restart"]) {
    context.subscriptions.push(commands.registerCommand(`maquette.${command}`, () => window.showInformationMessage(WHY)));
  }
};

exports.deactivate = () => {};
