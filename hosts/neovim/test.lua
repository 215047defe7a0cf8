-- Tests of the language server in Neovim: its answers are compared with the output of the program.
local is_new = vim.fn.has("nvim-0.11") == 1
local TIMEOUT = 10000

-- The settings are those of the README: the first block for Neovim 0.11, the second one for older versions.
local file = assert(io.open(vim.env.README))
local blocks = {}
for block in file:read("*a"):gmatch("```lua\n(.-)```") do
  table.insert(blocks, block)
end
file:close()
vim.cmd("filetype on")
assert(loadstring(blocks[is_new and 1 or 2]))()
-- The folder that the first block names.
vim.opt.runtimepath:append(vim.env.HERE)
vim.cmd("syntax on | runtime! ftdetect/ron.vim | filetype plugin on")

local function read(name)
  local opened = assert(io.open(name, "rb"))
  local text = opened:read("*a")
  opened:close()
  return text
end

local function write(name, text)
  local opened = assert(io.open(name, "wb"))
  opened:write(text)
  opened:close()
end

local function run(words)
  return vim.fn.system("maquette " .. words)
end

local function wait(what, holds)
  if not vim.wait(TIMEOUT, holds, 20) then
    error("not within " .. TIMEOUT .. " ms: " .. what, 0)
  end
end

local client

-- Opens a file, optionally with content that differs from that on disk.
local function open(name, text)
  vim.cmd("edit! " .. name)
  local buffer = vim.api.nvim_get_current_buf()
  wait("a client", function()
    for _, it in pairs((vim.lsp.get_clients or vim.lsp.get_active_clients)()) do
      client = it
    end
    return client and vim.lsp.buf_is_attached(buffer, client.id)
  end)
  if text then
    vim.api.nvim_buf_set_lines(buffer, 0, -1, true, vim.split(text, "\n"))
  end
  return buffer
end

-- Moves the cursor to the first occurrence of a text and `on` bytes further; returns the position for a request.
local function place(text, on)
  for row, line in ipairs(vim.api.nvim_buf_get_lines(0, 0, -1, true)) do
    local column = line:find(text, 1, true)
    if column then
      vim.api.nvim_win_set_cursor(0, { row, column - 1 + (on or 0) })
      return vim.lsp.util.make_position_params(0, client.offset_encoding)
    end
  end
  error("there is no " .. text)
end

local function ask(method, params)
  local reply, why = client.request_sync(method, params, TIMEOUT, vim.api.nvim_get_current_buf())
  assert(reply, why)
  assert(not reply.err, vim.inspect(reply.err))
  return reply.result
end

local function apply(edit)
  vim.lsp.util.apply_workspace_edit(edit, client.offset_encoding)
end

-- The number of characters in the first bytes of a line.
local function characters(row, bytes)
  local line = vim.api.nvim_buf_get_lines(0, row, row + 1, true)[1]
  local _, count = line:sub(1, bytes):gsub("[^\128-\191]", "")
  return count
end

-- The diagnostics in the editor, as sorted lines `line:column-end code message`.
local function shown_diagnostics()
  local lines = {}
  for _, it in ipairs(vim.diagnostic.get(0)) do
    local first, last = characters(it.lnum, it.col), characters(it.end_lnum, it.end_col)
    table.insert(lines, ("%d:%d-%d:%d %s %s"):format(it.lnum + 1, first + 1, it.end_lnum + 1, last + 1, it.code or it.user_data.lsp.code, it.message))
  end
  table.sort(lines)
  return lines
end

-- The problems that `maquette check` reports for a file on disk, in the same format.
local function problems_of_check(name)
  local lines = {}
  for _, it in ipairs(vim.fn.json_decode(run("check --json " .. name)).problems) do
    if it.file == name then
      table.insert(lines, ("%d:%d-%d:%d %s %s"):format(it.line, it.column, it.end_line, it.end_column, it.code, it.message))
    end
  end
  table.sort(lines)
  return lines
end

local function same(got, wanted)
  if not vim.deep_equal(got, wanted) then
    error(("got %s\nwanted %s"):format(vim.inspect(got), vim.inspect(wanted)), 0)
  end
end

local passed, failed = 0, 0

local function test(name, body)
  local originals = { ["doll.ron"] = read("doll.ron"), ["face.ron"] = read("face.ron"), ["lib/feature.ron"] = read("lib/feature.ron") }
  local good, why = xpcall(body, debug.traceback)
  passed, failed = passed + (good and 1 or 0), failed + (good and 0 or 1)
  io.stdout:write(good and ("ok " .. name .. "\n") or ("FAILED " .. name .. "\n" .. why .. "\n"))
  for path, text in pairs(originals) do
    write(path, text)
  end
  vim.cmd("silent! %bwipeout!")
end

if LINGER then
  open("doll.ron")
  io.stdout:write("ready\n")
  vim.wait(60000)
end

-- Two errors in one line, after characters of one, two, three and four bytes.
local BROKEN = read("doll.ron"):gsub('Label%(mask: "red", connectivity: Eight%)', 'Label(/* größer – 😀 */ mask: "rad", connectivity: Eigth)')

test("1 diagnostics are those of check, also after multi-byte characters", function()
  write("doll.ron", BROKEN)
  local wanted = problems_of_check("doll.ron")
  assert(#wanted >= 2, vim.inspect(wanted))
  open("doll.ron")
  wait("diagnostics", function() return #vim.diagnostic.get(0) == #wanted end)
  same(shown_diagnostics(), wanted)
end)

test("1 diagnostics follow what is typed and not saved", function()
  write("copy.ron", BROKEN)
  local wanted = problems_of_check("copy.ron")
  open("doll.ron", BROKEN)
  wait("diagnostics", function() return #vim.diagnostic.get(0) == #wanted end)
  same(shown_diagnostics(), wanted)
  vim.api.nvim_buf_set_lines(0, 0, -1, true, vim.split(read("doll.ron"), "\n"))
  wait("no diagnostics", function() return #vim.diagnostic.get(0) == 0 end)
end)

test("1 a used file that is not saved counts", function()
  open("face.ron")
  local face = vim.api.nvim_get_current_buf()
  open("lib/feature.ron", (read("lib/feature.ron"):gsub('"growth"', '"rise"')))
  wait("diagnostics of the graph that uses it", function() return #vim.diagnostic.get(face) > 0 end)
end)

local function labels(position)
  local list = ask("textDocument/completion", position)
  local names = {}
  local items = list.items or list
  table.sort(items, function(a, b) return (a.sortText or a.label) < (b.sortText or b.label) end)
  for _, it in ipairs(items) do
    table.insert(names, it.label)
  end
  return names
end

test("2 completion in a file that is cut off", function()
  local cut = read("doll.ron"):match('^(.-"red": Threshold%(image: "scan.color", )') .. "/* größer 😀 */ "
  open("doll.ron", cut)
  local names = labels(place("😀 */ ", 8))
  assert(vim.tbl_contains(names, "select"), vim.inspect(names))
  assert(not vim.tbl_contains(names, "image"), vim.inspect(names))
end)

test("4 hovers describe a node type and a field", function()
  open("doll.ron", BROKEN)
  local hover = ask("textDocument/hover", place("Threshold"))
  assert(hover.contents.value:find("Selects pixels", 1, true), vim.inspect(hover))
  local field = ask("textDocument/hover", place("connectivity"))
  assert(field.contents.value:find("connectivity", 1, true), vim.inspect(field))
end)

local function target(method)
  local found = method[1] or method
  return vim.uri_to_fname(found.uri or found.targetUri), (found.range or found.targetSelectionRange).start
end

test("5 definitions of a link, a parameter and a used graph", function()
  open("face.ron", (read("face.ron"):gsub('"model": Skin%(', '"model": Skin(/* größer 😀 */ ')))
  local path, start = target(ask("textDocument/definition", place('"eyes.range"', 2)))
  assert(path:match("face.ron$"), path)
  same(vim.api.nvim_buf_get_lines(0, start.line, start.line + 1, true)[1]:match("eyes"), "eyes")
  path, start = target(ask("textDocument/definition", place('Param("nose")', 8)))
  assert(vim.api.nvim_buf_get_lines(0, start.line, start.line + 1, true)[1]:find('"nose": Number'), start.line)
  path = target(ask("textDocument/definition", place(': Feature(', 3)))
  assert(path:match("lib/feature.ron$"), path)
end)

test("6 a rename changes the names in all files and nothing else", function()
  local feature, face = read("lib/feature.ron"), read("face.ron")
  open("lib/feature.ron")
  local params = place('"growth"', 2)
  params.newName = "rise"
  apply(ask("textDocument/rename", params))
  vim.cmd("silent wall")
  same(read("lib/feature.ron"), (feature:gsub('"growth"', '"rise"')))
  same(read("face.ron"), (face:gsub("growth:", "rise:")))
  same(vim.fn.json_decode(run("check --json face.ron")).problems, {})
end)

test("7 a fix is applied, and its problem is gone", function()
  open("doll.ron", BROKEN)
  wait("diagnostics", function() return #vim.diagnostic.get(0) > 0 end)
  while #vim.diagnostic.get(0) > 0 do
    local before = #vim.diagnostic.get(0)
    local worst = vim.diagnostic.get(0)[1]
    local params = {
      textDocument = vim.lsp.util.make_text_document_params(),
      range = worst.user_data.lsp.range or vim.lsp.util.make_range_params(0, client.offset_encoding).range,
      context = { diagnostics = {} },
    }
    vim.api.nvim_win_set_cursor(0, { worst.lnum + 1, worst.col })
    params.range = vim.lsp.util.make_range_params(0, client.offset_encoding).range
    local fix
    for _, action in ipairs(ask("textDocument/codeAction", params)) do
      if (action.kind or ""):match("^quickfix") then fix = fix or action end
    end
    assert(fix, "there is no fix of " .. worst.message)
    apply(fix.edit or ask("codeAction/resolve", fix).edit)
    wait("one problem less", function() return #vim.diagnostic.get(0) < before end)
  end
  local text = table.concat(vim.api.nvim_buf_get_lines(0, 0, -1, true), "\n")
  assert(text:find('Label(/* größer – 😀 */ mask: "red", connectivity: Eight)', 1, true), text)
end)

test("formatting is that of fmt", function()
  local provider = client.server_capabilities and client.server_capabilities.documentFormattingProvider
  if not (provider or (client.resolved_capabilities or {}).document_formatting) then return end
  local crooked = read("doll.ron"):gsub("\n        ", "\n   ")
  write("crooked.ron", crooked)
  run("fmt crooked.ron")
  open("doll.ron", crooked)
  local edits = ask("textDocument/formatting", { textDocument = vim.lsp.util.make_text_document_params(), options = { tabSize = 4, insertSpaces = true } })
  vim.lsp.util.apply_text_edits(edits, vim.api.nvim_get_current_buf(), client.offset_encoding)
  local got = table.concat(vim.api.nvim_buf_get_lines(0, 0, -1, true), "\n")
  same(vim.trim(got), vim.trim(read("crooked.ron")))
end)

-- The syntax group at the first character of a text.
local function color(text)
  for row, line in ipairs(vim.api.nvim_buf_get_lines(0, 0, -1, true)) do
    local column = line:find(text, 1, true)
    if column then return vim.fn.synIDattr(vim.fn.synID(row, column, 1), "name") end
  end
  error("there is no " .. text)
end

test("comments and colors are those of RON", function()
  open("doll.ron", table.concat({
    "Graph(",
    "    // One.",
    '    nodes: { "nose"/* c */: Label(mask: "red", within: -inf, /* a /* b */ two */ at: 1.5_f32, is: true) },',
    "    lift: Expr(",
    '        "growth * 2',
    '         + max(mm(3), 1e1_0)"), side: Left, of: br##"raw"# // no"##, last: mm(0xFFu8), key: Param("x"),',
    ")",
  }, "\n"))
  same(vim.bo.commentstring, "// %s")
  same(vim.bo.syntax, "ron")
  local wanted = {
    ["Graph"] = "ronFile", ["// One"] = "ronComment", ["nodes"] = "ronField", ['"nose"'] = "ronKey", ["Label"] = "ronType",
    ['"red"'] = "ronText", ["-inf"] = "ronConstant", ["two */"] = "ronBlock", ["1.5_f32"] = "ronNumber", ["true"] = "ronConstant",
    ["Expr"] = "ronKeyword", ["growth"] = "ronVariable", ["* 2"] = "ronOperator", ["max"] = "ronFunction", ["mm(3"] = "ronUnit",
    ["1e1_0"] = "ronNumber", ["side"] = "ronField", ["Left"] = "ronChoice", ["br##"] = "ronRaw", ["// no"] = "ronRaw", ["last"] = "ronField",
    ["0xFFu8"] = "ronNumber", ["Param"] = "ronKeyword",
  }
  local got = {}
  for text in pairs(wanted) do got[text] = color(text) end
  same(got, wanted)
end)

local function median(body)
  local times = {}
  for _ = 1, 51 do
    local start = vim.loop.hrtime()
    body()
    table.insert(times, (vim.loop.hrtime() - start) / 1e6)
  end
  table.sort(times)
  return times[26]
end

test("3 hover and completion take no more than 50 ms", function()
  open("doll.ron", BROKEN)
  local position = place("Threshold")
  local hover = median(function() ask("textDocument/hover", position) end)
  position = place('"scan.color"', 6)
  local completion = median(function() ask("textDocument/completion", position) end)
  io.stdout:write(("   hover %.1f ms, completion %.1f ms, positions in %s\n"):format(hover, completion, client.offset_encoding))
  assert(hover <= 50 and completion <= 50)
end)

io.stdout:write(("%d passed, %d failed\n"):format(passed, failed))
vim.cmd(failed > 0 and "cquit" or "qall!")
