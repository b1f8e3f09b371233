"""Any definition, any values, any wanted fields: a plan reads what an independent library wrote."""

import math
import re
import struct

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_files import run
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dirprim_filter.recording.decoding.cdr_plan import CdrPlan
from dirprim_filter.recording.decoding.field_columns import NO_TIME, Field, SchemaError, steps_of
from dirprim_filter.recording.decoding.protobuf_plan import protobuf_plan

INTEGERS = {f"{sign}int{bits}": bits for bits in (8, 16, 32, 64) for sign in ("", "u")}
NUMBERS = (*INTEGERS, "float32", "float64", "bool")


def values_of(kind):
    if kind in INTEGERS:
        bits = INTEGERS[kind]
        return st.integers(0, 2**bits - 1) if kind[0] == "u" else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if kind == "bool":
        return st.booleans()
    if kind == "string":
        return st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=6)
    return st.floats(width=int(kind[5:]), allow_nan=False)


def found(messages, path, none=math.nan):
    """What stands at a path, by Python's attributes alone."""
    for name, is_repeated, k in re.findall(r"\.(\w+)(\[(\d*)\])?", path):
        messages = [getattr(one, name) for one in messages]
        if k:
            messages = [([*many] + [none] * (int(k) + 1))[int(k)] for many in messages]
        elif is_repeated:
            messages = [one for many in messages for one in many]
    return messages


@st.composite
def definitions(draw):
    """Inner and outer message: names and types of fields; the outer holds the inner bare, fixed and repeated."""
    inner = draw(st.lists(st.sampled_from([*NUMBERS, "string"]), min_size=1, max_size=4))
    kinds = st.sampled_from(
        [*NUMBERS, "string", "Inner", "Inner[]", "Inner[2]", "Inner[<=3]", "float64[]", "int16[3]", "string[]"]
    )
    return inner, [*draw(st.lists(kinds, max_size=6)), "Inner[]", *draw(st.lists(kinds, max_size=3))]


def value_strategy(kind, inner):
    base = kind.partition("[")[0]
    one = st.tuples(*[values_of(k) for k in inner]) if base == "Inner" else values_of(base)
    if "[" not in kind:
        return one
    inside = kind[kind.index("[") + 1 : -1]
    if inside.isdigit():
        return st.lists(one, min_size=int(inside), max_size=int(inside))
    return st.lists(one, max_size=3)


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_cdr_of_any_definition_reads_as_rosbags_wrote_it(data):
    inner, outer = data.draw(definitions())
    text = "\n".join(f"{kind.replace('Inner', 'pkg/Inner')} f{i}" for i, kind in enumerate(outer))
    text += f"\n{'=' * 80}\nMSG: pkg/Inner\n" + "\n".join(f"{kind} g{i}" for i, kind in enumerate(inner))
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "pkg/msg/Outer"))
    make_inner, make_outer = store.types["pkg/msg/Inner"], store.types["pkg/msg/Outer"]
    written = [data.draw(st.tuples(*[value_strategy(kind, inner) for kind in outer])) for _ in range(2)]

    def built(kind, value):
        base = kind.partition("[")[0]
        if base == "Inner":
            return [make_inner(*v) for v in value] if "[" in kind else make_inner(*value)
        return np.array(value, np.dtype(base)) if "[" in kind and base != "string" else value

    messages = [make_outer(*[built(k, v) for k, v in zip(outer, row, strict=True)]) for row in written]
    kinds = {}
    for i, kind in enumerate(outer):
        path, base = f".f{i}" + "[]" * ("[" in kind), kind.partition("[")[0]
        kinds |= {f"{path}.g{j}": k for j, k in enumerate(inner)} if base == "Inner" else {path: base}
    kinds = {path: kind for path, kind in kinds.items() if data.draw(st.booleans())}
    fields = {path: Field(path=path, kind="name" if kind == "string" else "number") for path, kind in kinds.items()}
    for little in (True, False):
        payloads = [bytes(store.serialize_cdr(m, "pkg/msg/Outer", little_endian=little)) for m in messages]
        read = run(CdrPlan("pkg/Outer", "ros2msg", text.encode(), fields), payloads)
        assert read.failures == {}
        for path, kind in kinds.items():
            values = found(messages, path)
            if kind == "string":
                assert read.read(path, "").tolist() == values
            elif kind in INTEGERS:
                assert read.columns[path].values.tolist() == values
            else:
                assert read.read(path).tolist() == values


IDL = """================================================================================
IDL: pkg/msg/Outer
#include "pkg/msg/Inner.idl"
module pkg { module msg {
  typedef double double__3[3];
  struct Outer { boolean ok; sequence<pkg::msg::Inner, 4> items; double__3 fixed; string name; uint16 last; };
}; };

================================================================================
IDL: pkg/msg/Inner
module pkg { module msg { struct Inner { int8 small; double x; string<9> name; }; }; };
"""


def test_an_idl_definition_reads_as_its_msg_twin():
    text = "bool ok\npkg/Inner[<=4] items\nfloat64[3] fixed\nstring name\nuint16 last\n" + "=" * 80
    text += "\nMSG: pkg/Inner\nint8 small\nfloat64 x\nstring<=9 name"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "pkg/msg/Outer"))
    items = [store.types["pkg/msg/Inner"](-3, 2.5, "ä"), store.types["pkg/msg/Inner"](4, -1.0, "")]
    whole = store.types["pkg/msg/Outer"](True, items, np.array([1.0, 2.0, 3.0]), "end", 65535)
    payload = bytes(store.serialize_cdr(whole, "pkg/msg/Outer"))
    fields = {
        "x": Field(path=".items[].x"), "name": Field(path=".items[].name", kind="name"),
        "second": Field(path=".fixed[1]"), "last": Field(path=".last"), "other": Field(path=".missing", optional=True),
    }  # fmt: skip
    for encoding, definition in (("ros2msg", text), ("ros2idl", IDL)):
        read = run(CdrPlan("pkg/msg/Outer", encoding, definition.encode(), fields), [payload, payload[:9]])
        assert read.read("x").tolist() == [2.5, -1.0]
        assert read.read("name", "").tolist() == ["ä", ""]
        assert read.read("second")[0] == 2.0
        assert read.read("last")[0] == 65535
        assert np.isnan(read.read("other")).all()
        assert list(read.failures) == [1]
        third = CdrPlan("pkg/msg/Outer", encoding, definition.encode(), {"x": Field(path=".items[2].x")})
        assert math.isnan(run(third, [payload]).read("x")[0])


def test_what_is_neither_cdr_nor_cdr2_is_not_read_and_a_length_that_a_message_claims_is_not_allocated():
    plan = CdrPlan("p/M", "ros2msg", b"p/I[] a\n" + b"=" * 80 + b"\nMSG: p/I\nuint8 x", {"x": Field(path=".a[].x")})
    assert run(plan, [b"\0\x07\0\0\6\0\0\0\2\0\0\0ab"]).read("x").tolist() == [97.0, 98.0]  # CDR2 before it
    head, many = b"\x00\x01\x00\x00", 1 << 18
    claims = [head + b"\xff\xff\xff\x7f" + bytes(8), head + struct.pack("<I", many) + bytes(many)]
    read = run(plan, [*claims, b"\x00\x03\0\0", b"\x00\x0b\0\0", head + b"\x02\0\0\0ab"])
    assert sorted(read.failures) == [0, 1, 2, 3]
    assert read.failures[2] == "encapsulation 0x0003 (PL_CDR), which is not read"
    assert read.failures[3] == "encapsulation 0x000b (PL_CDR2), which is not read"
    assert read.read("x").tolist() == [97.0, 98.0]
    assert read.message_of(".a[]").tolist() == [4, 4]


# ------------------------------------------------------------------------------------------ protobuf

_F = descriptor_pb2.FieldDescriptorProto
KINDS = {
    "double": st.floats(allow_nan=False), "float": st.floats(width=32, allow_nan=False),
    "int32": values_of("int32"), "int64": values_of("int64"), "uint32": values_of("uint32"),
    "uint64": values_of("uint64"), "sint32": values_of("int32"), "sint64": values_of("int64"),
    "fixed32": values_of("uint32"), "fixed64": values_of("uint64"), "sfixed32": values_of("int32"),
    "sfixed64": values_of("int64"), "bool": st.booleans(), "string": values_of("string"),
}  # fmt: skip


def protobuf_class():
    """A proto2 message of every kind of field, single, repeated and packed, and of itself within itself."""
    file = descriptor_pb2.FileDescriptorProto(name="all.proto", package="p")
    message = file.message_type.add(name="M")
    for i, kind in enumerate(KINDS):
        code = getattr(_F, f"TYPE_{kind.upper()}")
        message.field.add(name=kind, number=3 * i + 1, type=code, label=_F.LABEL_OPTIONAL)
        message.field.add(name=f"many_{kind}", number=3 * i + 2, type=code, label=_F.LABEL_REPEATED)
        if kind != "string":
            packed = message.field.add(name=f"packed_{kind}", number=3 * i + 3, type=code, label=_F.LABEL_REPEATED)
            packed.options.packed = True
    for name, number, label in (("one", 200, _F.LABEL_OPTIONAL), ("items", 201, _F.LABEL_REPEATED)):
        message.field.add(name=name, number=number, type=_F.TYPE_MESSAGE, type_name=".p.M", label=label)
    files = descriptor_pb2.FileDescriptorSet(file=[file])
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("p.M")), files.SerializeToString()


CLASS, DEFINITION = protobuf_class()


@st.composite
def messages(draw, kinds=("double", "string"), depth=2):
    message = CLASS()
    for kind in kinds:
        values = KINDS[kind]
        if draw(st.booleans()):
            setattr(message, kind, draw(values))
        getattr(message, f"many_{kind}").extend(draw(st.lists(values, max_size=2)))
        if kind != "string":
            getattr(message, f"packed_{kind}").extend(draw(st.lists(values, max_size=2)))
    if depth:
        if draw(st.booleans()):
            message.one.CopyFrom(draw(messages(kinds, depth=0)))
        message.items.extend(draw(st.lists(messages(kinds, depth=depth - 1), max_size=2)))
    return message


@settings(max_examples=60, deadline=None)
@given(kind=st.sampled_from(sorted(KINDS)), data=st.data())
def test_protobuf_of_any_kind_reads_as_the_stock_parser_reads_it(kind, data):
    written = data.draw(st.lists(messages((kind, "int32")), min_size=1, max_size=2))
    form = "name" if kind == "string" else "number"
    paths = [
        f".{kind}", f".many_{kind}[]", f".many_{kind}[0]", f".many_{kind}[1]", f".one.{kind}", f".one.many_{kind}[]",
        f".items[].{kind}", f".items[].items[].{kind}", *[f".packed_{kind}[]"] * (kind != "string"),
    ]  # fmt: skip
    paths = [path for path in paths if data.draw(st.booleans())]
    fields = {path: Field(path=path, kind=form) for path in paths} | {"one": Field(path=".one", kind="presence")}
    read = run(protobuf_plan("p.M", DEFINITION, fields), [m.SerializeToString() for m in written])
    assert read.failures == {}
    assert read.is_set("one").tolist() == [m.HasField("one") for m in written]
    none = "" if form == "name" else math.nan
    for path in paths:
        got = read.read(path, none)
        np.testing.assert_array_equal(got, np.array(found(written, path, none), dtype=got.dtype))
    items, deep = ".items[]", ".items[].items[]"
    if f"{deep}.{kind}" in paths and items in read.rows and found(written, deep):
        np.testing.assert_array_equal(read.parent_of(items)[read.parent_of(deep)], read.message_of(deep))


@pytest.mark.parametrize("lengths", [[100] * 200, [1] * 500 + [20_000], [20_000] + [0] * 500, [0] * 100 + [3, 5000]])
def test_columns_of_many_numbers_are_whole(lengths):
    """Five columns that fill at once, in messages alike and not."""
    columns = [f"packed_{kind}" for kind in ("double", "float", "int32", "uint64", "sint32")]
    payloads = [CLASS(**{name: range(n) for name in columns}).SerializeToString() for n in lengths]
    fields = {name: Field(path=f".{name}[]", kind="number") for name in columns}
    read = run(protobuf_plan("p.M", DEFINITION, fields), payloads)
    for name in columns:
        np.testing.assert_array_equal(read.read(name), np.concatenate([np.arange(n) for n in lengths]))


CLOCK = b"p/T b\n" + b"=" * 80 + b"\nMSG: p/T\n%b sec\nuint32 nanosec"


def of_ros(data):
    return lambda field: CdrPlan("p/M", "ros2msg", data, {"x": field})


def of_protobuf(data=DEFINITION):
    return lambda field: protobuf_plan("p.M", data, {"x": field})


@pytest.mark.parametrize(
    ("plan", "path", "reported"),
    [
        (of_ros(b"uint8 a"), ".b", "expected the fields .b, which its definition lacks"),
        (of_ros(b"p/Lost a\nfloat64 b"), ".b", "expected a definition of p/msg/Lost"),
        (of_ros(b"wstring a\nfloat64 b"), ".b", "wstring"),
        (of_ros(b"p/M a\nfloat64 b"), ".b", "messages within each other"),
        (of_ros(b"string b"), ".b", "expected a number at .b, got text"),
        (of_ros(b"float64[2000000000] a\nstring[99999999] c\nfloat64 b"), ".b", "a length from 1 to"),
        (of_ros(b"\xff\xfe"), ".b", "does not parse"),
        (of_ros(b"float64[] b"), ".b", "behind the repeated .b"),
        (of_ros(CLOCK % b"string"), ".b time", "expected a number at .b.sec"),
        (of_ros(CLOCK % b"p/T"), ".b time", "expected a time at .b.sec, got another"),
        (of_protobuf(b"\xff\xff"), ".double", "FileDescriptorSet"),
        (of_protobuf(b""), ".double", "defines it"),
        (of_protobuf(), ".nothing", "lacks"),
        (of_protobuf(), ".items.double", "repeated"),
        (of_protobuf(), ".one[].double", "single"),
        (of_protobuf(), ".many_double", "repeated"),
        (of_protobuf(), ".one", "expected a time at .one"),
        (of_protobuf(), ".string", "got text"),
        (of_protobuf(), ".double.x", "expected a message at p.M.double, got a value"),
        (of_protobuf(), ".double time", "expected a time at .double, got a double"),
        (of_protobuf(), ".double presence", "expected a message at .double, got a double"),
    ],
)
def test_a_schema_that_cannot_be_read_says_why(plan, path, reported):
    path, _, kind = path.partition(" ")
    with pytest.raises(SchemaError, match=r"p\WM: ") as error:
        plan(Field(path=path, kind=kind or "number"))
    assert reported in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("path", ["", "x", ".x[", ".x[-1]", ".x..y", ".x[99999999]", ".9"])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(ValueError, match="field path"):
        steps_of(path)


# ------------------------------------------------------------------------- other encapsulations, other definitions

OBJECTS = """
#include <orb.idl>
@extensibility(APPENDABLE) module demo {
  enum Kind { CAR, @value(7) TRUCK };  // of vehicles
  typedef double Pair[2];
  struct Point { double x; @unit("m (metres)") double y; };
  struct Object { @key string id; Kind kind; Point at; /* twice */ Point corners[2]; sequence<Point> path; Pair size; };
  struct Objects { unsigned long long stamp; octet flag; sequence<string> names; sequence<Object> objects; long last; };
};
"""


PLACE = ("d", "d")
OBJECT = ("text", "I", PLACE, [PLACE, 2], [PLACE], "d", "d")
MESSAGE = ("Q", "B", ["text"], [OBJECT], "i")
"""`OBJECTS` as `Xcdr2` takes it: a number's form, a tuple for a structure, a list for an array (with its length) or a
sequence; arrays of plain numbers are written out."""
FEW = [("a" * n, 1, at, [at] * 2, [at] * n, 4.0, 2.0) for n, at in enumerate([(0.5, 0.0), (1.5, -2.0), (2.5, -4.0)], 1)]
SENT = (1_700_000_000_000_000_000, 1, ["", "abc"], FEW, -5)


class Xcdr2:
    """Writes by the rules of DDS-XTypes 1.3, 7.4.3.5, in one byte order; slowly.

    A structure that begins before the byte `delimited_to` has its size in front.
    """

    def __init__(self, order, delimited_to):
        self.data, self.order, self.delimited_to = b"", order, delimited_to

    def write(self, kind, value):
        if kind == "text":
            self.write("I", len(value) + 1)
            self.data += value.encode() + b"\0"
        elif isinstance(kind, str):
            self.data += bytes(-len(self.data) % min(struct.calcsize(kind), 4)) + struct.pack(self.order + kind, value)
        elif isinstance(kind, list) or len(self.data) < self.delimited_to:
            self.write("I", 0)
            start = len(self.data)
            self.members(kind, value)
            size = struct.pack(self.order + "I", len(self.data) - start)
            self.data = self.data[: start - 4] + size + self.data[start:]
        else:
            self.members(kind, value)
        return self.data

    def members(self, kind, values):
        if len(kind) == 1:
            self.write("I", len(values))
        for one, value in zip([kind[0]] * len(values) if isinstance(kind, list) else kind, values, strict=True):
            self.write(one, value)


def read_objects(payloads, text=OBJECTS, **paths):
    fields = {name: Field(path=path, kind=KIND_OF.get(name, "number")) for name, path in paths.items()}
    return run(CdrPlan("demo::Objects", "omgidl", text.encode(), fields), payloads)


KIND_OF = {"id": "name", "time": "time"}
AT = {"id": "id", "x": "at.x", "kind": "kind", "width": "size[1]", "corner": "corners[1].y"}


@pytest.mark.parametrize("number", [0x06, 0x07, 0x08, 0x09, 0x10, 0x11, 0x14, 0x15])
def test_cdr2_has_sizes_in_front_of_arrays_and_where_it_is_delimited_of_messages(number):
    """The same messages in plain CDR beside them, in one batch: each is read by its own encapsulation."""
    order, delimited_to = "<" if number & 1 else ">", math.inf if number & ~1 in (0x08, 0x14) else 0
    payload = bytes([0, number, 0, 0]) + Xcdr2(order, delimited_to).write(MESSAGE, SENT)
    paths = {name: f".objects[].{path}" for name, path in AT.items()}
    read = read_objects([payload, payload[:90], payload], last=".last", time=".stamp", **paths)
    assert read.read("id", "").tolist() == ["a", "aa", "aaa"] * 2
    assert read.read("x").tolist() == [0.5, 1.5, 2.5] * 2
    assert (read.read("kind").tolist(), read.read("width").tolist()) == ([1.0] * 6, [2.0] * 6)
    assert read.read("corner").tolist() == [0.0, -2.0, -4.0] * 2
    assert read.read("last")[[0, 2]].tolist() == [-5.0, -5.0]
    assert read.read("time", NO_TIME)[0] == SENT[0]
    assert f"encapsulation {number & ~1:#06x}" in read.failures[1]
    assert read_objects([payload], last=".last").read("last").tolist() == [-5.0]
    assert read_objects([payload], y=".objects[].path[].y").read("y").tolist() == [0.0, -2.0, -2.0, -4.0, -4.0, -4.0]


def test_structures_that_have_no_size_in_front_in_a_delimited_message_are_noticed():
    text = OBJECTS.replace("struct Point", "@final struct Point").replace("struct Object ", "@final struct Object ")
    payload = b"\0\x09\0\0" + Xcdr2("<", 1).write(MESSAGE, SENT)
    for path in (".objects[].at.x", ".objects[].id"):
        assert "delimited CDR2" in read_objects([payload], text, id=path).failures[0]
    last = read_objects([payload], text, last=".last")  # their array has a size all the same
    assert last.read("last").tolist() == [-5.0]


def test_messages_of_ros_1_are_read_as_rosbags_writes_them():
    text = "Header header\nuint8 flag\npkg/Inner[] items\nempty/Nothing no\nfloat64 last\ntime until\n" + "=" * 80
    text += "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n" + "=" * 80
    text += "\nMSG: pkg/Inner\nstring name\nfloat64 x\n" + "=" * 80 + "\nMSG: empty/Nothing\n"
    inner = struct.pack("<I1sdI3sd", 1, b"a", 0.5, 3, b"bcd", 1.5)
    header = struct.pack("<IIII", 9, 1_700_000_000, 5, 3) + b"map"
    payload = header + b"\1" + struct.pack("<I", 2) + inner + struct.pack("<dII", 7.5, 1_700_000_001, 6)
    fields = {
        "time": Field(path=".header.stamp", kind="time"), "frame": Field(path=".header.frame_id", kind="name"),
        "name": Field(path=".items[].name", kind="name"), "x": Field(path=".items[].x"), "last": Field(path=".last"),
        "until": Field(path=".until", kind="time"),
    }  # fmt: skip
    read = run(CdrPlan("pkg/Outer", "ros1msg", text.encode(), fields), [payload, payload[:-1]])
    assert read.read("time", NO_TIME)[0] == 1_700_000_000_000_000_005
    assert read.read("until", NO_TIME)[0] == 1_700_000_001_000_000_006
    assert (read.read("frame", "")[0], read.read("name", "").tolist()) == ("map", ["a", "bcd"])
    assert (read.read("x").tolist(), read.read("last")[0]) == ([0.5, 1.5], 7.5)
    assert list(read.failures) == [1]
