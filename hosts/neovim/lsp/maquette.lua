-- The configuration of the language server for Neovim 0.11 and newer: `vim.lsp.enable("maquette")`.
return {
  cmd = { "maquette", "lsp" },
  filetypes = { "ron" },
  root_markers = { "maquette.toml" },
  init_options = { hints = true },
}
