// Tests of the syntax colors, with the TextMate engine of VS Code.
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { test } from "node:test";

const ROOT = resolve(import.meta.dirname, "../../..");
const require = createRequire(join(ROOT, "target/vscode/server/node_modules/code-server/lib/vscode/package.json"));
const textmate = require("vscode-textmate");
const oniguruma = require("vscode-oniguruma");

await oniguruma.loadWASM(readFileSync(join(require.resolve("vscode-oniguruma"), "../onig.wasm")).buffer);
const raw = readFileSync(join(import.meta.dirname, "../ron.tmLanguage.json"), "utf8");
const registry = new textmate.Registry({
  onigLib: Promise.resolve({
    createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
    createOnigString: (text) => new oniguruma.OnigString(text),
  }),
  loadGrammar: async () => textmate.parseRawGrammar(raw, "ron.json"),
});
const grammar = await registry.loadGrammar("source.ron");

/** The parts of `text` with their scopes, without parts that have none. */
function parts(text) {
  let state = textmate.INITIAL;
  const found = [];
  for (const line of text.split("\n")) {
    const { tokens, ruleStack } = grammar.tokenizeLine(line, state);
    state = ruleStack;
    for (const { startIndex, endIndex, scopes } of tokens) {
      const part = line.slice(startIndex, endIndex);
      const scope = scopes.slice(1).join(" ").replaceAll(".ron", "");
      const last = found.at(-1);
      if (last?.[1] === scope) last[0] += part;
      else found.push([part, scope]);
    }
  }
  return found.filter(([, scope]) => scope && !scope.startsWith("punctuation")).map(([part, scope]) => `${part} is ${scope}`);
}

const cases = {
  "2 // b /* c": ["2 is constant.numeric", "// b /* c is comment.line.double-slash"],
  "/* a /* b */ c */ 1": [
    "/* a  is comment.block",
    "/* b */ is comment.block comment.block",
    " c */ is comment.block",
    "1 is constant.numeric",
  ],
  "/* a\n// */ true": ["/* a// */ is comment.block", "true is constant.language"],
  '"nose": Label(mask: "red")': [
    '"nose" is variable.other.constant.name',
    "Label is entity.name.type",
    "mask is variable.other.property",
    '"red" is variable.other.constant.link',
  ],
  'Expr("a\n + b"), x: 1u8': [
    "Expr is keyword.control",
    "a is variable.parameter",
    "+ is keyword.operator",
    "b is variable.parameter",
    "x is variable.other.property",
    "1u8 is constant.numeric",
  ],
  'Expr(\n    "a\n + b"), x: 1.0_f64': [
    "Expr is keyword.control",
    "a is variable.parameter",
    "+ is keyword.operator",
    "b is variable.parameter",
    "x is variable.other.property",
    "1.0_f64 is constant.numeric",
  ],
  'Expr(/* ) */ r#"max(a, 2)"#), y: 0b1010_i32': [
    "Expr is keyword.control",
    "/* ) */ is comment.block",
    "max is support.function",
    "a is variable.parameter",
    "2 is constant.numeric",
    "y is variable.other.property",
    "0b1010_i32 is constant.numeric",
  ],
  'Param(\n // "c"\n "growth"\n), x: -inf': [
    "Param is keyword.control",
    '// "c" is comment.line.double-slash',
    '"growth" is variable.parameter',
    "x is variable.other.property",
    "-inf is constant.language",
  ],
  '"x"/* c */: 1e1_0, r#type: b\'a\', z: r#kind': [
    '"x" is variable.other.constant.name',
    "/* c */ is comment.block",
    "1e1_0 is constant.numeric",
    "r#type is variable.other.property",
    "b'a' is string.quoted.single",
    "z is variable.other.property",
    "r#kind is variable.other.enummember",
  ],
  'br##"a"# // b"##, 0xFFu8': ['br##"a"# // b"## is string.quoted.other.raw', "0xFFu8 is constant.numeric"],
  'br#"raw"#, b"bytes"': ['br#"raw"# is string.quoted.other.raw', 'b"bytes" is string.quoted.double'],
  '"scan.PNG", "a.webp"': ['"scan.PNG" is string.quoted.double', '"a.webp" is string.quoted.double'],
  '"copies/2.range"': ['"copies/2.range" is variable.other.constant.link'],
  '"doll/color.png"': ['"doll/color.png" is string.quoted.double'],
  '"How far it grows"': ['"How far it grows" is string.quoted.double'],
  'unit: "mm"': ["unit is variable.other.property", '"mm" is string.quoted.double'],
  '"#c33923"': ['"#c33923" is string.quoted.double constant.other.color'],
  'Param("eye-step")': ["Param is keyword.control", '"eye-step" is variable.parameter'],
  'Expr("mm(2) * max(eye-step, 1e-3)") b': [
    "Expr is keyword.control",
    "mm is keyword.other.unit",
    "2 is constant.numeric",
    "* is keyword.operator",
    "max is support.function",
    "eye-step is variable.parameter",
    "1e-3 is constant.numeric",
    "b is variable.other.enummember",
  ],
  "(-cm(1.2), .5, -3, 1., inf)": [
    "cm is keyword.other.unit",
    "1.2 is constant.numeric",
    ".5 is constant.numeric",
    "-3 is constant.numeric",
    "1. is constant.numeric",
    "inf is constant.language",
  ],
  'r#"a "b" c"# None': ['r#"a "b" c"# is string.quoted.other.raw', "None is constant.language"],
  '"say \\"so\\"" 2': [
    '"say  is string.quoted.double',
    '\\" is string.quoted.double constant.character.escape',
    "so is string.quoted.double",
    '\\" is string.quoted.double constant.character.escape',
    '" is string.quoted.double',
    "2 is constant.numeric",
  ],
  "Graph(nodes: ForEach(over: Draft(final: Loop)))": [
    "Graph is storage.type",
    "nodes is variable.other.property",
    "ForEach is keyword.control",
    "over is variable.other.property",
    "Draft is keyword.control",
    "final is variable.other.property",
    "Loop is variable.other.enummember",
  ],
};

for (const [text, wanted] of Object.entries(cases)) {
  test(`colors of ${JSON.stringify(text)}`, () => assert.deepEqual(parts(text), wanted));
}

test("every character of every graph has a color, and no string is unterminated", () => {
  const folder = join(ROOT, "graphs");
  const graphs = readdirSync(folder, { recursive: true }).filter((it) => it.endsWith(".ron"));
  assert.ok(graphs.length > 50);
  for (const name of graphs) {
    let state = textmate.INITIAL;
    for (const line of readFileSync(join(folder, name), "utf8").split("\n")) {
      const { tokens, ruleStack } = grammar.tokenizeLine(line, state);
      state = ruleStack;
      for (const { startIndex, endIndex, scopes } of tokens) {
        const part = line.slice(startIndex, endIndex);
        assert.ok(scopes.length > 1 || /^[\s()[\]{}]*$/.test(part), `${name}: ${part} in ${line}`);
      }
    }
    assert.equal(state.depth, 1, name);
  }
});
