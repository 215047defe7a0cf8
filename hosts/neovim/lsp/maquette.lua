-- The language server, from Neovim 0.11 on: `vim.lsp.enable("maquette")`.
return {
  cmd = { "maquette", "lsp" },
  filetypes = { "ron" },
  root_markers = { "maquette.toml" },
  init_options = { hints = true },
}
