//! What an editor can do, and what we can.

use serde_json::{Value as Json, json};

use super::Client;
use super::commands::COMMANDS;
use super::outline::MEANINGS;
use super::place::Columns;

/// What an editor says that it can do. Fields of other types than the protocol's are as good as none.
pub(super) fn of_client(told: &Json) -> Client {
    let can = |way: &str| told.pointer(way) == Some(&Json::Bool(true));
    fn has(way: &str, wanted: &str, told: &Json) -> bool {
        told.pointer(way)
            .and_then(Json::as_array)
            .is_some_and(|all| all.iter().any(|it| it == wanted))
    }
    let offered = told.pointer("/general/positionEncodings").and_then(Json::as_array);
    let offered = offered.map(|all| all.iter().filter_map(Json::as_str).collect::<Vec<_>>());
    Client {
        columns: Columns::agreed(&offered.unwrap_or_default()),
        snippets: can("/textDocument/completion/completionItem/snippetSupport"),
        related: can("/textDocument/publishDiagnostics/relatedInformation"),
        refreshes_hints: can("/workspace/inlayHint/refreshSupport"),
        refreshes_lenses: can("/workspace/codeLens/refreshSupport"),
        shows_documents: can("/window/showDocument/support"),
        progress: can("/window/workDoneProgress"),
        creates_files: can("/workspace/workspaceEdit/documentChanges")
            && has("/workspace/workspaceEdit/resourceOperations", "create", told),
        resolves: has("/textDocument/codeAction/resolveSupport/properties", "edit", told)
            && can("/textDocument/codeAction/dataSupport"),
        has_action_literals: told
            .pointer("/textDocument/codeAction/codeActionLiteralSupport")
            .is_some_and(Json::is_object)
            // Only literals are asked for their edits, and edits that make files are younger than literals.
            || has("/textDocument/codeAction/resolveSupport/properties", "edit", told)
            || has("/workspace/workspaceEdit/resourceOperations", "create", told),
        has_symbol_trees: can("/textDocument/documentSymbol/hierarchicalDocumentSymbolSupport"),
        hovers_markdown: has("/textDocument/hover/contentFormat", "markdown", told),
        completes_markdown: has(
            "/textDocument/completion/completionItem/documentationFormat",
            "markdown",
            told,
        ),
        has_configuration: can("/workspace/configuration"),
        watches_files: can("/workspace/didChangeWatchedFiles/dynamicRegistration"),
    }
}

pub(super) fn of_server(client: Client) -> Json {
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
