"""The definitions of messages of ROS and DDS that a log carries, parsed by `rosbags`.

Source: ROS 2 interface definitions, https://design.ros2.org/articles/legacy_interface_definition.html.
"""

from __future__ import annotations

import re
from typing import Any

from dirprim_filter.recording.decoding.field_columns import SchemaError

MAX_FIXED = 1 << 24
"""More elements of a fixed array than this are no message, but would overflow offsets."""
MAX_BOUND = (1 << 32) - 1
"""Lengths in messages have 32 bits."""
DEFINITIONS = ("ros2msg", "ros2idl", "omgidl", "ros1msg")
_UNREAD = re.compile(r"//.*|/\*(?s:.*?)\*/|^\s*#.*|@\w+(?:\s*\((?:[^()\"]|\"[^\"]*\")*\))?", re.MULTILINE)
"""Of omgidl: comments, directives and annotations."""
_ENUM = re.compile(r"\benum\s+(\w+)\s*\{[^}]*\}")
Description = tuple[Any, Any]
"""rosbags' description of a field: (Nodetype, its arguments)."""


def full_name(schema: str) -> str:
    """package/msg/Name, also of what leaves out "msg", and of modules of IDL, with what DDS adds to names of ROS."""
    name = re.sub(r"/dds_/(\w+)_$", r"/\1", schema.replace("::", "/"))
    return name.replace("/", "/msg/") if name.count("/") == 1 else name


def types_of(schema: str, encoding: str, definition: bytes) -> dict[str, list[tuple[str, Description]]]:
    """By type, names and descriptions of its fields."""
    from rosbags.interfaces import Nodetype  # noqa: PLC0415  (0.2 s)
    from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg  # noqa: PLC0415

    types: dict[str, Any] = {}
    try:
        text = definition.decode()
        if encoding in ("ros2msg", "ros1msg"):
            types = dict(get_types_from_msg(text, full_name(schema)))
        elif encoding == "ros2idl":
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                if part.strip():
                    types.update(get_types_from_idl(re.sub(r"^\s*#.*$", "", part, flags=re.MULTILINE)))
        elif encoding == "omgidl":
            types = dict(get_types_from_idl(_ENUM.sub(r"typedef unsigned long \1", _UNREAD.sub(" ", text))))
        else:
            raise SchemaError(f"{schema}: expected a definition in {', '.join(DEFINITIONS)}, got {encoding!r}")
    except (UnicodeDecodeError, TypesysError, RecursionError) as error:
        reason = str(error).split("\n", 1)[0]
        raise SchemaError(
            f"{schema}: expected a definition in {encoding}, got one that does not parse: {reason}"
        ) from error
    for name, (_, members) in types.items():
        for member, description in members:
            _check_lengths(f"{schema}: {name}.{member}", description)
    halves = [(half, (Nodetype.BASE, ("uint32", 0))) for half in ("sec", "nanosec")]
    built_in = {f"builtin_interfaces/msg/{name}": halves for name in ("Time", "Duration")} if "1" in encoding else {}
    return built_in | {full_name(name): members for name, (_, members) in types.items()}


def _check_lengths(what: str, description: Description) -> None:
    """Every element then takes a byte at least, and walks of a message no more turns than it has bytes.

    Raises:
        SchemaError: a fixed array that is empty or too long, or a bound that no length can reach.
    """
    from rosbags.interfaces import Nodetype  # noqa: PLC0415

    node, arguments = description
    if node == Nodetype.NAME:
        return
    least, most = (1, MAX_FIXED) if node == Nodetype.ARRAY else (0, MAX_BOUND)
    if not least <= arguments[1] <= most:
        raise SchemaError(f"{what}: expected a length from {least} to {most}, got {arguments[1]}")
    if node != Nodetype.BASE:
        _check_lengths(what, arguments[0])
