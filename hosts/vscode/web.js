// The extension in editors without a machine, such as vscode.dev: syntax colors and snippets work; commands report why they do not.
const { commands, window } = require("vscode");

const WHY = "Checking and running graphs needs the program `maquette`, which cannot run here: open this folder in Visual Studio Code or code-server.";

/** @param {import("vscode").ExtensionContext} context */
exports.activate = (context) => {
  for (const command of ["run", "watch", "stop", "restart"]) {
    context.subscriptions.push(commands.registerCommand(`maquette.${command}`, () => window.showInformationMessage(WHY)));
  }
};

exports.deactivate = () => {};
