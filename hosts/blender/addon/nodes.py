"""The classes of nodes, sockets and trees: one for each type of the engine's catalog, created once the catalog has arrived.

A node stores its fields as custom properties, which hold numbers exactly. Fields are numbers, flags, words or paths where possible, and
otherwise texts of RON.
"""

from __future__ import annotations

import colorsys
import hashlib
import json
import textwrap
from typing import Any, Callable

import bpy

from . import compound, engine, panel

# The prefix of the custom properties of fields.
FIELD = "field "

# The prefix of the custom properties of a field's parts: `part FIELD PART`. `part FIELD` is the text that the parts were made of.
PART = "part "

# The maximum length in bytes: Blender truncates longer names of nodes and refuses longer names of classes.
MAX_NAME = 63

# The registered classes, by name.
_registered: dict[str, type] = {}
# The types of nodes: those of the catalog by name, used graphs by file.
kinds: dict[str, dict[str, Any]] = {}
_controls: dict[str, dict[str, panel.Control]] = {}
# The fields with parts (see `compound`) of each type.
_compounds: dict[str, dict[str, compound.Variants]] = {}

# Called with a tree that may have changed.
listeners: list[Callable[[Any], None]] = []


class MaquetteTree(bpy.types.NodeTree):
    """A graph of maquette, as its file has it"""

    bl_idname = "MaquetteTree"
    bl_label = "Maquette Graph"
    bl_icon = "NODETREE"

    maquette_graph: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Graph", description="The file of the graph", subtype="FILE_PATH", options=engine.RELATIVE
    )
    maquette_folder: bpy.props.StringProperty(description="The folder that `//` at the start of the graph's path refers to")  # type: ignore[valid-type]
    maquette_beside: bpy.props.StringProperty(description="The graph's path relative to the Blender file when that was last saved")  # type: ignore[valid-type]
    maquette_text: bpy.props.StringProperty(description="The text that the tree shows")  # type: ignore[valid-type]
    maquette_changes: bpy.props.IntProperty(description="The number of external changes that the text contains")  # type: ignore[valid-type]

    def update(self) -> None:
        """Called by Blender when the tree may have changed."""
        for listener in listeners:
            listener(self)


class SocketBase:
    """A port or an output."""

    maquette_port: bpy.props.StringProperty()  # type: ignore[valid-type]

    def draw(self, _context: Any, layout: Any, _node: Any, text: str) -> None:
        """Draws the name of the socket."""
        layout.label(text=text)

    def draw_color(self, _context: Any, _node: Any) -> tuple[float, float, float, float]:
        """The color of its type."""
        return color(self.bl_label)

    @classmethod
    def draw_color_simple(cls) -> tuple[float, float, float, float]:
        """The color of its type."""
        return color(cls.bl_label)


def color(kind: str) -> tuple[float, float, float, float]:
    """The color of a type of values, derived from its name."""
    hue = hashlib.md5(kind.encode(), usedforsecurity=False).digest()[0] / 256
    return (*colorsys.hsv_to_rgb(hue, 0.55 if kind else 0.0, 0.8), 1.0)


class NodeBase:
    """A node of a graph."""

    bl_width_default = 190
    # Its name in the text; empty while it is not in the text.
    maquette_name: bpy.props.StringProperty()  # type: ignore[valid-type]
    maquette_kind: bpy.props.StringProperty()  # type: ignore[valid-type]
    # The file of the used graph, if any.
    maquette_graph: bpy.props.StringProperty()  # type: ignore[valid-type]
    # The fields that are shown on the node; the others are in the sidebar.
    maquette_written: bpy.props.StringProperty()  # type: ignore[valid-type]
    maquette_problem: bpy.props.StringProperty()  # type: ignore[valid-type]

    @classmethod
    def poll(cls, tree: bpy.types.NodeTree) -> bool:
        """Returns true if such nodes can be in a tree."""
        return tree.bl_idname == MaquetteTree.bl_idname

    def init(self, _context: Any) -> None:
        """Gives a new node the ports of its type, and values for required fields."""
        kind = kinds.get(getattr(self, "maquette_type", ""))
        if kind:
            init_node(self, kind)

    def copy(self, other: Any) -> None:
        """A copy within the tree is a new node, which is not in the text yet; a copy of the whole tree keeps the names."""
        if self.name != other.name:
            self.maquette_name = ""

    def draw_buttons(self, _context: Any, layout: Any) -> None:
        """Draws the problem of the node and its written fields."""
        if self.maquette_problem:
            column = layout.column()
            column.alert = True
            # A label has only one line, which is cut at the edge of the node.
            for place, line in enumerate(textwrap.wrap(self.maquette_problem, 28)):
                column.label(text=line, icon="BLANK1" if place else "ERROR")
        if self.mute:
            layout.label(text=MUTED, icon="INFO")
        if self.maquette_graph:
            layout.operator("maquette.open_used", icon="NODETREE").graph = self.maquette_graph
        for field in self.maquette_written.split():
            _draw(self, layout, field)

    def draw_buttons_ext(self, _context: Any, layout: Any) -> None:
        """Draws all fields."""
        kind = kinds.get(kind_of(self))
        if kind:
            layout.label(text=kind["doc"].split("\n")[0])
        if self.maquette_name:
            layout.operator("maquette.show_node", icon="HIDE_OFF").node = self.maquette_name
        for name in [it for it in self.keys() if it.startswith(FIELD)]:
            _draw(self, layout, name[len(FIELD) :])
            if _variants_of(self, name[len(FIELD) :]):
                # Also as text, since it may be `Param(..)`.
                layout.prop(self, f'["{name}"]', text="")


# Graphs cannot mute nodes.
MUTED = "muted in Blender only: the graph still computes this node"


def _draw(node: bpy.types.Node, layout: Any, field: str) -> None:
    if FIELD + field not in node.keys():
        return
    if _has_parts(node, field):
        column = layout.column(align=True)
        column.prop(node, _choice(field), text=field)
        start = f"{PART}{field} "
        for name in [it for it in node.keys() if it.startswith(start)]:
            column.prop(node, f'["{name}"]', text=name[len(start) :] or field)
        return
    control = controls(kind_of(node)).get(field)
    if control and control.kind == "choice" and node[FIELD + field] in control.choices and hasattr(node, _choice(field)):
        layout.prop(node, _choice(field), text=field)
        return
    is_slider = control is not None and control.is_ranged and not isinstance(node[FIELD + field], str)
    layout.prop(node, f'["{FIELD}{field}"]', text=field, slider=is_slider)


class PackMenu:
    """The nodes of a pack."""

    def draw(self, _context: Any) -> None:
        """Draws an entry for each node; the search of menus finds the terms of other programs, too."""
        for it in nodes_of_pack(self.maquette_pack):
            made = self.layout.operator("node.add_node", text=entry(it))
            made.type, made.use_transform = class_of(it["name"]), True


def menu_of(pack: str) -> str:
    """The name of the menu of a pack."""
    return f"MAQUETTE_MT_pack_{pack.replace('-', '_')}"


# The beginning of the last line of a node's documentation, before the terms of other programs.
ALIASES_PREFIX = "In other programs: "


def entry(kind: dict[str, Any]) -> str:
    """The menu entry of a type: its name, and the terms of other programs."""
    last = kind["doc"].rstrip().split("\n")[-1]
    return f"{kind['name']} ({last.removeprefix(ALIASES_PREFIX).rstrip('.')})" if last.startswith(ALIASES_PREFIX) else str(kind["name"])


class MaquetteNodeOther(NodeBase, bpy.types.Node):
    """A node that is not in the catalog: a used graph, a `ForEach`, a `Switch`, or a node of an unknown type."""

    bl_idname = "MaquetteNodeOther"
    bl_label = "Maquette Node"


class MaquetteNodeInputs(NodeBase, bpy.types.Node):
    """All inputs of a graph."""

    bl_idname = "MaquetteNodeInputs"
    bl_label = "Inputs"


class MaquetteNodeOutputs(NodeBase, bpy.types.Node):
    """All outputs of a graph."""

    bl_idname = "MaquetteNodeOutputs"
    bl_label = "Outputs"


class MaquetteSocket(SocketBase, bpy.types.NodeSocket):
    """A port without a single known type."""

    bl_idname = "MaquetteSocket"
    bl_label = ""


def idname(prefix: str, kind: str) -> str:
    """The class name of a type, shortened to the length that Blender allows."""
    name = prefix + kind
    return name if len(name) <= MAX_NAME else name[: MAX_NAME - 8] + hashlib.md5(kind.encode(), usedforsecurity=False).hexdigest()[:8]


def class_of(kind: str) -> str:
    """The class name of the nodes of a type."""
    name = idname("MaquetteNode", kind)
    return name if name in _registered else MaquetteNodeOther.bl_idname


def kind_of(node: bpy.types.Node) -> str:
    """The key of a node's type in `kinds`."""
    return str(node.maquette_graph or node.maquette_kind)


def controls(kind: str) -> dict[str, panel.Control]:
    """The controls of a type's fields, by name."""
    return _controls.get(kind, {})


def add_types(types: list[dict[str, Any]], by: str) -> None:
    """Adds types of nodes: those of the catalog by `name`, used graphs by `pack`, which is their file."""
    for it in types:
        if kinds.get(it[by]) != it:
            kinds[it[by]] = it
            _controls[it[by]] = {control.name: control for control in panel.controls(it["parameters"])}
            _compounds[it[by]] = compound.variants(it["parameters"])


def register_classes(nodes: list[dict[str, Any]]) -> None:
    """Registers a class for each type of nodes and of values of the engine."""
    add_types(nodes, "name")
    types = {kind for it in nodes for port in [*it["inputs"], *it["outputs"]] for kind in port["types"]}
    wanted: list[tuple[str, tuple[type, ...], dict[str, Any]]] = []
    for kind in sorted(types):
        wanted.append((idname("MaquetteSocket", kind), (SocketBase, bpy.types.NodeSocket), {"bl_label": kind}))
    for it in nodes:
        choices = {_choice(name): _enum(control) for name, control in controls(it["name"]).items() if control.kind == "choice"}
        choices |= {_choice(name): _words(name, known) for name, known in _compounds[it["name"]].items()}
        own = {"bl_label": it["name"], "maquette_type": it["name"], "__doc__": it["doc"] or it["name"], "__annotations__": choices}
        wanted.append((idname("MaquetteNode", it["name"]), (NodeBase, bpy.types.Node), own))
    for pack in packs():
        wanted.append((menu_of(pack), (PackMenu, bpy.types.Menu), {"bl_label": pack.capitalize(), "maquette_pack": pack}))
    for name, bases, fields in wanted:
        if name not in _registered:
            made = type(name, bases, {"bl_idname": name, "__module__": __name__, **fields})
            bpy.utils.register_class(made)
            _registered[name] = made


def _choice(field: str) -> str:
    return f"maquette_choice_{field}"


def _enum(control: panel.Control) -> Any:
    """Creates an enum property for a field's choices; the value is stored in the field's custom property."""
    name = FIELD + control.name

    def get(node: Any) -> int:
        value = node.get(name)
        return control.choices.index(value) if value in control.choices else 0

    def put(node: Any, index: int) -> None:
        node[name] = control.choices[index]

    items = [(it, it, "") for it in control.choices]
    return bpy.props.EnumProperty(name=control.name, description=control.doc, items=items, get=get, set=put)


def _words(field: str, known: compound.Variants) -> Any:
    """Creates an enum property for the words of a field with parts; the value is stored in the field's custom property."""
    words = list(known)

    def get(node: Any) -> int:
        try:
            return words.index(compound.parse(_text_or_default(node, field), known)[0])
        except ValueError:
            return 0

    def put(node: Any, index: int) -> None:
        try:
            word, parts = compound.parse(field_text(node, field), known)
        except ValueError:
            word, parts = "", {}
        if word != words[index]:
            node[FIELD + field] = compound.change_word(words[index], parts, known)
            _put_parts(node, field)

    return bpy.props.EnumProperty(name=field, items=[(it, it, "") for it in words], get=get, set=put)


def _variants_of(node: bpy.types.Node, field: str) -> compound.Variants:
    return _compounds.get(kind_of(node), {}).get(field, {})


def _has_parts(node: bpy.types.Node, field: str) -> bool:
    """Returns true if the widgets of a field's parts can show its text."""
    try:
        compound.parse(str(node.get(f"{PART}{field}", "")), _variants_of(node, field))
    except ValueError:
        return False
    return True


def _text_or_default(node: bpy.types.Node, field: str) -> str:
    """The text of a field with parts, or the text of its default."""
    control = controls(kind_of(node)).get(field)
    return str(node.get(FIELD + field, "")) or compound.default_of(control.default if control else None, _variants_of(node, field))


def _put_parts(node: bpy.types.Node, field: str) -> None:
    """Updates the widgets of a field's parts; removes them if they cannot show the text."""
    start = f"{PART}{field} "
    known, text = _variants_of(node, field), _text_or_default(node, field)
    found: dict[str, Any] = {}
    try:
        word, parts = compound.parse(text, known)
    except ValueError:
        word, parts = "", {}
    for control in known.get(word, ()):
        if control.kind == "color" or not compound.can_show(control, parts.get(control.name, "")) and control.name in parts:
            value = _part_color(parts.get(control.name)) if control.kind == "color" else None
        else:
            value = _value(control, parts.get(control.name))
        if value is None or value == "" and control.kind not in ("text", "file"):
            continue
        found[start + control.name] = value
        node[start + control.name] = value
        if control.kind == "color":
            node.id_properties_ui(start + control.name).update(subtype="COLOR_GAMMA", min=0.0, max=1.0, soft_min=0.0, soft_max=1.0)
        else:
            _set_ui(node, start + control.name, control, value)
    for gone in [it for it in node.keys() if it.startswith(start) and it not in found]:
        del node[gone]
    node[f"{PART}{field}"] = text


def _part_color(text: str | None) -> list[float] | None:
    try:
        return panel.rgb(json.loads(text or '""'))
    except ValueError:
        return None


def field_text(node: bpy.types.Node, field: str) -> str:
    """The text of a field with parts, including changes of the parts by the user."""
    text = str(node.get(FIELD + field, ""))
    known, made_of = _variants_of(node, field), node.get(f"{PART}{field}")
    if made_of != _text_or_default(node, field) or not _has_parts(node, field):
        # The user has edited the text itself.
        return text
    word, parts = compound.parse(made_of, known)
    changed = set()
    for control in known[word]:
        value = node.get(f"{PART}{field} {control.name}")
        if value is None:
            continue
        was = _part_color(parts.get(control.name)) if control.kind == "color" else _value(control, parts.get(control.name))
        if _is_same(control, value, was):
            continue
        said = panel.try_ron(control, value)
        if said is not None:
            parts[control.name] = said
            changed.add(control.name)
    if not text:
        # The field had its default: write only changed and required parts.
        parts = {it.name: parts[it.name] for it in known[word] if it.name in changed or it.is_required and it.name in parts}
    return compound.compose(word, parts, known) if changed else text


def packs() -> list[str]:
    """The packs of nodes, in the order of the engine."""
    return list(dict.fromkeys(it["pack"] for key, it in kinds.items() if key != it["pack"]))


def nodes_of_pack(pack: str) -> list[dict[str, Any]]:
    """The nodes of a pack."""
    return [it for key, it in kinds.items() if it["pack"] == pack != key]


def socket_class(types: list[str]) -> str:
    """The class name of the sockets for values of these types."""
    name = idname("MaquetteSocket", types[0]) if len(types) == 1 else ""
    return name if name in _registered else MaquetteSocket.bl_idname


def socket(sockets: Any, types: list[str], name: str, port: str, many: bool = False) -> Any:
    """Adds a socket to a node."""
    kind = socket_class(types)
    if many and bpy.app.version >= (4, 0):
        made = sockets.new(kind, name, use_multi_input=True)
    else:
        made = sockets.new(kind, name)
        if many:
            made.link_limit = 0
    made.maquette_port = port
    return made


def init_node(node: bpy.types.Node, kind: dict[str, Any], graph: str = "") -> None:
    """Sets the type of a new node, which may be a graph in a file, and creates its sockets and required fields."""
    node.maquette_kind, node.maquette_graph = kind["name"], graph
    for port in kind["inputs"]:
        socket(node.inputs, port["types"], port["name"], port["name"], port["many"])
    for output in kind["outputs"]:
        socket(node.outputs, output["types"], output["name"], output["name"])
    # Choices and words get their first value, so that the user sees something to change.
    put_fields(node, {it.name: it.choices[0] if it.choices else _first_word(node, it.name) for it in needed(node)})


def _first_word(node: bpy.types.Node, field: str) -> str:
    known = _variants_of(node, field)
    return compound.change_word(next(iter(known)), {}, known) if known else ""


def needed(node: bpy.types.Node) -> list[panel.Control]:
    """The required fields of a node."""
    required = kinds.get(kind_of(node), {}).get("parameters", {}).get("required", ())
    return [it for it in controls(kind_of(node)).values() if it.name in required]


def put_fields(node: bpy.types.Node, written: dict[str, str]) -> None:
    """Updates the fields of a node to the written ones; all others show their defaults."""
    own = controls(kind_of(node))
    have = {it for it in node.keys() if it.startswith(FIELD)}
    for gone in have - {FIELD + it for it in (*own, *written)}:
        del node[gone]
    now = fields(node, written)
    for field in (*written, *(it for it in own if it not in written)):
        name, control, text = FIELD + field, own.get(field), written.get(field)
        is_whole = not _variants_of(node, field) or (node.get(name) == (text or "") and node.get(f"{PART}{field}") == _text_or_default(node, field))
        if name in have and now.get(field) == text and is_whole and not node.maquette_graph:
            continue
        value = _value(control, text)
        node[name] = value
        if _variants_of(node, field):
            _put_parts(node, field)
        if control:
            _set_ui(node, name, control, value)
    shown = " ".join(written)
    if node.maquette_written != shown:
        node.maquette_written = shown


def _value(control: panel.Control | None, text: str | None) -> Any:
    """The value of a custom property for the text of a field, or for its default if `text` is None."""
    if control is None or control.kind in ("ron", "color"):
        return text or ""
    try:
        value = panel.widget_value(control, text)
    except ValueError:
        return text or ""
    if control.kind == "vector" and value is not None:
        return [int(it) if control.is_whole else float(it) for it in value]
    return "" if value is None else float(value) if control.kind == "number" else value


def _set_ui(node: bpy.types.Node, name: str, control: panel.Control, value: Any) -> None:
    """Sets range, default and description of a custom property from its control."""
    shape: dict[str, Any] = {} if isinstance(value, (str, bool)) else control.limits()
    default = _value(control, None)
    if type(default) is type(value) and default != "":
        # Backspace resets to it.
        shape["default"] = default
    if isinstance(value, list) and not control.is_whole:
        shape["subtype"] = "XYZ"
    if control.kind == "file":
        shape["subtype"] = "FILE_PATH"
    node.id_properties_ui(name).update(description=control.doc, **shape)


def fields(node: bpy.types.Node, written: dict[str, str]) -> dict[str, str]:
    """The fields of a node as RON: the written ones, and others that differ from their defaults. Unchanged fields keep their text."""
    own, found = controls(kind_of(node)), {}
    for name, value in node.items():
        if not name.startswith(FIELD):
            continue
        field = name[len(FIELD) :]
        text = written.get(field)
        if _variants_of(node, field):
            value = field_text(node, field)
        control = own.get(field)
        said = panel.try_ron(control, value) if control else None
        is_ron = isinstance(value, str) and (control is None or control.kind not in ("file", "text") or _is_ron(control, text))
        if (said is None and not is_ron) or _is_same(control, value, _value(control, text)):
            if text is not None:
                found[field] = text
        elif not is_ron:
            found[field] = said or ""
        elif value:
            found[field] = value
    return found


def _is_ron(control: panel.Control, text: str | None) -> bool:
    """Returns true if a field is shown as RON text, since no widget can show it."""
    try:
        panel.widget_value(control, text)
    except ValueError:
        return True
    return False


def _is_same(control: panel.Control | None, value: Any, known: Any) -> bool:
    if isinstance(value, str) or isinstance(known, str) or control is None or known is None:
        return bool(value == known)
    if control.kind == "color":
        return panel.hexadecimal(value) == panel.hexadecimal(known)
    return panel.is_same(control, value, known)


def title(node: bpy.types.Node) -> str:
    """The name of a node in the editor."""
    name = str(node.maquette_name)
    return name if node.label in ("", truncate(name)) else str(node.label)


def truncate(name: str) -> str:
    """Truncates a name to the length that Blender allows."""
    return name.encode()[:MAX_NAME].decode(errors="ignore")


CLASSES = (MaquetteSocket, MaquetteTree, MaquetteNodeOther, MaquetteNodeInputs, MaquetteNodeOutputs)


def register() -> None:
    """Registers the classes that do not depend on the catalog."""
    for it in CLASSES:
        bpy.utils.register_class(it)


def unregister() -> None:
    """Unregisters all classes; their data stays in Blender files."""
    for it in [*reversed(_registered.values()), *reversed(CLASSES)]:
        bpy.utils.unregister_class(it)
    _registered.clear()
    kinds.clear()
    _controls.clear()
    _compounds.clear()
