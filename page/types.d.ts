// What the watch says and what the page asks, for the checker of types (`just page`). The browser never sees this file.

export type Port = { name: string; type?: string; y: number };

/** A node, or a file of an output, which has no `node` and no `pack`. */
export type Box = {
  name: string;
  node: string | null;
  pack: number | null;
  /** Left, top, width, height. */
  place: [number, number, number, number];
  inputs: Port[];
  outputs: (Port & { type: string })[];
};

export type Drawing = {
  doc: string;
  size: [number, number];
  packs: { name: string; color: string }[];
  boxes: Box[];
  links: { from: number; path: string }[];
  schema: { properties?: Record<string, Field> };
};

/** A parameter, as a JSON schema describes it. */
export type Field = {
  type?: string;
  default?: any;
  minimum?: number;
  maximum?: number;
  unit?: string;
  enum?: string[];
  format?: string;
  description?: string;
};

export type NodeState = { state?: string; seconds?: number };

export type Problem = {
  severity: string;
  code: string;
  file: string;
  line: number;
  column: number;
  message: string;
  help: string;
};

export type Viewed = { node: string; output: string };

export type Value = Viewed & { run: number; type: string; hash: string; flat: boolean; lies: boolean };

/** What is said, by its `event`. */
export type Message =
  | { event: "hello"; program: string; graph: string }
  | ({ event: "graph" } & Drawing)
  | ({ event: "value" } & Value)
  | { event: "run"; run: number }
  | { event: "started"; node: string }
  | { event: "progress"; node: string; share: number }
  | ({ event: "finished"; node: string } & NodeState)
  | { event: "cancelled"; run: number }
  | { event: "problems"; problems: Problem[]; more_problems?: number }
  | { event: "refused"; why: string }
  | Done;

export type Done = {
  event: "done";
  run: number;
  ok: boolean;
  failed: number;
  skipped: number;
  computed: number;
  cached: number;
  seconds: number;
  nodes: ({ name: string } & NodeState)[];
};

/** What is asked. */
export type Wish =
  | { ask: "views"; views: Viewed[] }
  | { ask: "set"; values: [string, string][] }
  | { ask: "undo" };
