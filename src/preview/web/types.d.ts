// The messages between `maquette watch` and the page, for the type checker (`just page`). The browser does not load this file.

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
  /** The fields that are or contain a `Draft(..)`, with both values as text. */
  drafts?: { field: string; final: string; draft: string }[];
} & Partial<Location>;

/** A position in a file; lines and columns count from 1. */
export type Location = { file: string; line: number; column: number };

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
  /** Both values of a `Draft(..)`; null for a value that is computed. */
  draft?: { final: any; draft: any };
  minimum?: number;
  maximum?: number;
  unit?: string;
  enum?: string[];
  minItems?: number;
  format?: string;
  description?: string;
};

export type NodeState = { state?: string; reason?: string; seconds?: number; bytes?: number };

export type Problem = {
  severity: string;
  code: string;
  file: string;
  line: number;
  column: number;
  message: string;
  help: string;
  /** Another position that explains the problem. */
  note?: Location & { message: string };
};

export type Viewed = { node: string; output: string };

/** Pixels, four bytes each. */
export type Pixels = { column: string; size: [number, number] };

/** An attribute of a shape: a number for each `vertex`, `corner` or `face`, with its full range and the range without outliers. */
export type ShapeField = { name: string; on: string; range: [number, number]; usual: [number, number]; column: string };

/** Faces, or the solids that points and lines are drawn as; `Column` is a column or its name. */
export type ShapeOf<Column> = {
  solid: boolean;
  position: Column;
  normal: Column;
  triangle: Column;
  color: Column | null;
  uv: Column | null;
  edge: Column | null;
  parameter: Column | null;
  texture: Texture | null;
  /** If triangles have different textures: the runs of consecutive triangles with the same one. */
  stretches: Stretch[];
  fields: ShapeField[];
  picture: Column | null;
  /** The pictures of `stretches`, in the same order. */
  pictures: (Column | null)[];
  field: Column | null;
};

export type Wrap = "Repeat" | "Mirror" | "Clamp";

/** A texture, and its wrap modes in u and v. */
export type Texture = { size: [number, number]; pixels: Pixels; wrap: [Wrap, Wrap] };

export type Stretch = { count: number; texture: Texture | null };

/** Positions are relative to `center`, in units of `scale`, which is in mm. */
export type Space = {
  upright: boolean;
  center: [number, number, number];
  scale: number;
  shapes: Omit<ShapeOf<string>, "picture" | "field">[];
};

/** Numbers over an axis; a number that is not finite is `null`. */
export type Series = { name: string; at: number[]; numbers: number[] };

/** A property that a value lacks although nodes require it: the number of elements that violate it, and the first of them. */
export type Broken = { property: string; asked_by: string[]; words: string; count: number; elements: { name: string; at: [number, number, number] }[] };

/** The viewed value of an output. */
export type Value = Viewed & {
  run: number;
  live?: boolean;
  type: string;
  hash: string;
  picture: { size: [number, number]; pixels: Pixels; capture: { scale: [number, number]; offset: [number, number] } | null } | null;
  space: Space | null;
  series: Series[] | null;
  broken: Broken[];
};

/** A question about the point under the pointer. */
export type Question =
  | ({ ask: "probe"; at: [number, number] } & Viewed)
  | ({ ask: "pick"; origin: number[]; direction: number[]; radius: number } & Viewed);

/** A message from `maquette watch`, by its `event`. */
export type Message =
  | { event: "hello"; program: string; graph: string; page?: string; draft?: boolean }
  | ({ event: "graph" } & Drawing)
  | ({ event: "value" } & Value)
  | { event: "run"; run: number }
  | { event: "started"; node: string }
  | { event: "progress"; node: string; share: number }
  | ({ event: "finished"; node: string } & NodeState)
  | { event: "cancelled"; run: number }
  | { event: "problems"; problems: Problem[]; more_problems?: number }
  | { event: "refused"; why: string }
  | { event: "stubborn"; node: string; why: string }
  | { event: "probe"; id: number; facts?: Record<string, any>; why?: string }
  | { event: "pick"; id: number; nothing?: boolean; at?: [number, number, number]; face?: number; vertex?: number; attributes?: Record<string, any> }
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

/** A message from the page. */
export type Request =
  | { ask: "views"; views: Viewed[] }
  | { ask: "set"; values: [string, string][] }
  | { ask: "drag"; values: [string, string][] }
  | { ask: "drop" }
  | (Question & { id: number })
  | { ask: "undo" }
  | { ask: "open"; node: string }
  | { ask: "open"; problem: Location };
