//! What an editor can do, and what we can.

use gen_lsp_types::ClientCapabilities;
use serde_json::{Value as Json, json};

use super::Client;
use super::commands::COMMANDS;
use super::outline::MEANINGS;
use super::place::Columns;

pub(super) fn of_client(told: &ClientCapabilities) -> Client {
    // Few of many fields are of interest, all of them optional.
    let told = serde_json::to_value(told).unwrap_or_default();
    let can = |way: &str| told.pointer(way) == Some(&Json::Bool(true));
    let has = |way: &str, wanted: &str| {
        told.pointer(way)
            .and_then(Json::as_array)
            .is_some_and(|all| all.iter().any(|it| it == wanted))
    };
    let offered = told.pointer("/general/positionEncodings").cloned().unwrap_or_default();
    let offered = serde_json::from_value::<Vec<_>>(offered).ok();
    Client {
        columns: Columns::agreed(offered.as_deref()),
        snippets: can("/textDocument/completion/completionItem/snippetSupport"),
        related: can("/textDocument/publishDiagnostics/relatedInformation"),
        refreshes: can("/workspace/inlayHint/refreshSupport"),
        shows_documents: can("/window/showDocument/support"),
        progress: can("/window/workDoneProgress"),
        creates_files: can("/workspace/workspaceEdit/documentChanges")
            && has("/workspace/workspaceEdit/resourceOperations", "create"),
        resolves: has("/textDocument/codeAction/resolveSupport/properties", "edit")
            && can("/textDocument/codeAction/dataSupport"),
    }
}

pub(super) fn of_server(columns: Columns) -> Json {
    let meanings = Vec::from_iter(MEANINGS.iter().map(|(_, name)| name));
    json!({
        "capabilities": {
            "positionEncoding": columns.kind(),
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
            "renameProvider": { "prepareProvider": true },
            "foldingRangeProvider": true,
            "inlayHintProvider": true,
            "semanticTokensProvider": {
                "legend": { "tokenTypes": meanings, "tokenModifiers": ["declaration"] },
                "full": true,
            },
            "executeCommandProvider": { "commands": COMMANDS },
        },
        "serverInfo": { "name": "maquette", "version": env!("CARGO_PKG_VERSION") },
    })
}
