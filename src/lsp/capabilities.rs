//! The capabilities of the editor and of the server.

use serde_json::{Value as Json, json};

use super::ClientCapabilities;
use super::commands::COMMANDS;
use super::outline::MEANINGS;
use super::position::Columns;

/// Reads the capabilities that an editor declares. A capability with a value of the wrong type counts as missing.
pub(super) fn of_client(capabilities: &Json) -> ClientCapabilities {
    let can = |way: &str| capabilities.pointer(way) == Some(&Json::Bool(true));
    fn has(way: &str, wanted: &str, capabilities: &Json) -> bool {
        capabilities
            .pointer(way)
            .and_then(Json::as_array)
            .is_some_and(|all| all.iter().any(|it| it == wanted))
    }
    let offered = capabilities.pointer("/general/positionEncodings").and_then(Json::as_array);
    let offered = offered.map(|all| all.iter().filter_map(Json::as_str).collect::<Vec<_>>());
    ClientCapabilities {
        columns: Columns::negotiate(&offered.unwrap_or_default()),
        snippets: can("/textDocument/completion/completionItem/snippetSupport"),
        related: can("/textDocument/publishDiagnostics/relatedInformation"),
        refreshes_hints: can("/workspace/inlayHint/refreshSupport"),
        refreshes_lenses: can("/workspace/codeLens/refreshSupport"),
        shows_documents: can("/window/showDocument/support"),
        progress: can("/window/workDoneProgress"),
        creates_files: can("/workspace/workspaceEdit/documentChanges")
            && has("/workspace/workspaceEdit/resourceOperations", "create", capabilities),
        resolves_actions: has(
            "/textDocument/codeAction/resolveSupport/properties",
            "edit",
            capabilities,
        ) && can("/textDocument/codeAction/dataSupport"),
        has_action_literals: capabilities
            .pointer("/textDocument/codeAction/codeActionLiteralSupport")
            .is_some_and(Json::is_object)
            // Each of the following two capabilities implies literal code actions. Only literal actions can be resolved later, and edits
            // that create files are newer in the protocol than literal actions.
            || has("/textDocument/codeAction/resolveSupport/properties", "edit", capabilities)
            || has("/workspace/workspaceEdit/resourceOperations", "create", capabilities),
        has_symbol_trees: can("/textDocument/documentSymbol/hierarchicalDocumentSymbolSupport"),
        hovers_markdown: has("/textDocument/hover/contentFormat", "markdown", capabilities),
        completes_markdown: has(
            "/textDocument/completion/completionItem/documentationFormat",
            "markdown",
            capabilities,
        ),
        has_configuration: can("/workspace/configuration"),
        watches_files: can("/workspace/didChangeWatchedFiles/dynamicRegistration"),
    }
}

pub(super) fn of_server(client: ClientCapabilities) -> Json {
    let meanings: Vec<_> = MEANINGS.iter().map(|(_, name)| name).collect();
    json!({
        "capabilities": {
            "positionEncoding": client.columns.kind(),
            "textDocumentSync": { "openClose": true, "change": 1, "save": { "includeText": false } },
            "completionProvider": { "triggerCharacters": ["\"", "(", ".", "/", ":", " "] },
            "hoverProvider": true,
            "definitionProvider": true,
            "referencesProvider": true,
            "documentHighlightProvider": true,
            "documentSymbolProvider": true,
            "codeActionProvider": {
                "codeActionKinds": ["quickfix", "refactor.extract", "refactor.inline", "source.fixAll"],
                "resolveProvider": true,
            },
            "codeLensProvider": {},
            "documentLinkProvider": {},
            "colorProvider": true,
            "documentFormattingProvider": true,
            "documentRangeFormattingProvider": true,
            "selectionRangeProvider": true,
            "signatureHelpProvider": { "triggerCharacters": ["(", ","] },
            "workspaceSymbolProvider": true,
            "workspace": { "workspaceFolders": { "supported": true, "changeNotifications": true } },
            "renameProvider": { "prepareProvider": true },
            "foldingRangeProvider": true,
            "inlayHintProvider": true,
            "semanticTokensProvider": {
                "legend": { "tokenTypes": meanings, "tokenModifiers": ["declaration"] },
                "full": true,
                "range": true,
            },
            "executeCommandProvider": { "commands": COMMANDS },
        },
        "serverInfo": { "name": "maquette", "version": env!("CARGO_PKG_VERSION") },
    })
}
