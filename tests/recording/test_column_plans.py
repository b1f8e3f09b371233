"""Any definition, any values, any wanted fields: a plan reads what an independent library wrote."""

import json
import math
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
from dirprim_filter.recording.decoding.json_plan import JsonPlan
from dirprim_filter.recording.decoding.protobuf_plan import protobuf_plan

INTEGERS = {"int8": 8, "uint8": 8, "int16": 16, "uint16": 16, "int32": 32, "uint32": 32, "int64": 64, "uint64": 64}
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
    fields, expected = {}, {}
    for i, kind in enumerate(outer):
        if not data.draw(st.booleans()):
            continue
        base, steps = kind.partition("[")[0], "[]" if "[" in kind else ""
        parts = [(f".g{j}", k, j) for j, k in enumerate(inner)] if base == "Inner" else [("", base, None)]
        for suffix, k, j in parts:
            label = f"f{i}{suffix}"
            fields[label] = Field(path=f".f{i}{steps}{suffix}", kind="name" if k == "string" else "number")
            flat = [v for row in written for v in (row[i] if steps else [row[i]])]
            expected[label] = [v if j is None else v[j] for v in flat]
    for little in (True, False):
        payloads = [bytes(store.serialize_cdr(m, "pkg/msg/Outer", little_endian=little)) for m in messages]
        read = run(CdrPlan("pkg/Outer", "ros2msg", text.encode(), fields), payloads)
        assert read.failures == {}
        for label, values in expected.items():
            if fields[label].kind == "name":
                assert read.read(label, "").tolist() == values
            elif isinstance(values[0] if values else 0, float):
                assert read.read(label).tolist() == values
            else:
                assert read.columns[label].values.tolist() == [int(v) for v in values]


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
        "second": Field(path=".fixed[1]"), "last": Field(path=".last"), "third": Field(path=".items[2].x"),
        "other": Field(path=".missing", optional=True),
    }  # fmt: skip
    third = fields.pop("third")
    for encoding, definition in (("ros2msg", text), ("ros2idl", IDL)):
        read = run(CdrPlan("pkg/msg/Outer", encoding, definition.encode(), fields), [payload, payload[:9]])
        assert read.read("x").tolist() == [2.5, -1.0]
        assert read.read("name", "").tolist() == ["ä", ""]
        assert read.read("second")[0] == 2.0
        assert read.read("last")[0] == 65535
        assert np.isnan(read.read("other")).all()
        assert list(read.failures) == [1]
        alone = run(CdrPlan("pkg/msg/Outer", encoding, definition.encode(), {"third": third}), [payload])
        assert math.isnan(alone.read("third")[0])


def test_cdr2_aligns_to_four_bytes_and_a_length_that_a_message_claims_is_not_allocated():
    plan = CdrPlan("p/M", "ros2msg", b"uint8 a\nfloat64 b", {"b": Field(path=".b")})
    packed = struct.pack("<BxxxI", 7, 0)[:4] + struct.pack("<d", 2.5)
    assert run(plan, [b"\x00\x07\x00\x00" + packed]).read("b").tolist() == [2.5]
    read = run(plan, [b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<d", 3.5), b"\x00\x03\0\0", b"\x00\x0b\0\0"])
    assert read.read("b")[:1].tolist() == [3.5]
    unread = {
        1: "encapsulation 0x0003 (PL_CDR), which is not read",
        2: "encapsulation 0x000b (PL_CDR2), which is not read",
    }
    assert read.failures == unread
    plan = CdrPlan("p/M", "ros2msg", b"p/I[] a\n" + b"=" * 80 + b"\nMSG: p/I\nuint8 x", {"x": Field(path=".a[].x")})
    head = b"\x00\x01\x00\x00"
    read = run(
        plan,
        [
            head + b"\xff\xff\xff\x7f" + bytes(8),
            head + struct.pack("<I", 1 << 18) + bytes(1 << 18),
            head + b"\x02\0\0\0ab",
        ],
    )
    assert sorted(read.failures) == [0, 1]
    assert read.read("x").tolist() == [97.0, 98.0]
    assert read.message_of(".a[]").tolist() == [2, 2]


@pytest.mark.parametrize(
    ("definition", "path", "reported"),
    [
        (b"uint8 a", ".b", "expected the fields .b, which its definition lacks"),
        (b"p/Lost a\nfloat64 b", ".b", "expected a definition of p/msg/Lost"),
        (b"wstring a\nfloat64 b", ".b", "wstring"),
        (b"p/M a\nfloat64 b", ".b", "messages within each other"),
        (b"string b", ".b", "expected a number at .b, got text"),
        (b"float64[2000000000] a\nstring[99999999] c\nfloat64 b", ".b", "a length from 1 to"),
        (b"\xff\xfe", ".b", "does not parse"),
        (b"float64[] b", ".b", "behind the repeated .b"),
    ],
)  # fmt: skip
def test_a_ros2_schema_that_cannot_be_read_says_why(definition, path, reported):
    with pytest.raises(SchemaError, match="p/M: ") as error:
        CdrPlan("p/M", "ros2msg", definition, {"b": Field(path=path)})
    assert reported in str(error.value)
    assert "\n" not in str(error.value)


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
    paths = {
        "top": f".{kind}", "many": f".many_{kind}[]", "first": f".many_{kind}[0]", "second": f".many_{kind}[1]",
        "one": f".one.{kind}", "item": f".items[].{kind}", "deep": f".items[].items[].{kind}",
        "of_one": f".one.many_{kind}[]",
    }  # fmt: skip
    if kind != "string":
        paths["packed"] = f".packed_{kind}[]"
    paths = {label: path for label, path in paths.items() if data.draw(st.booleans())}
    fields = {label: Field(path=path, kind=form) for label, path in paths.items()}
    fields["is_set"] = Field(path=".one", kind="presence")
    expected = {
        "top": [getattr(m, kind) for m in written],
        "many": [v for m in written for v in getattr(m, f"many_{kind}")],
        "packed": [v for m in written for v in getattr(m, f"packed_{kind}", ())],
        "one": [getattr(m.one, kind) for m in written],
        "item": [getattr(i, kind) for m in written for i in m.items],
        "deep": [getattr(j, kind) for m in written for i in m.items for j in i.items],
        "of_one": [v for m in written for v in getattr(m.one, f"many_{kind}")],
    }
    none = "" if form == "name" else math.nan
    for k, label in enumerate(("first", "second")):
        expected[label] = [([*getattr(m, f"many_{kind}"), none, none])[k] for m in written]
    read = run(protobuf_plan("p.M", DEFINITION, fields), [m.SerializeToString() for m in written])
    assert read.failures == {}
    assert read.is_set("is_set").tolist() == [m.HasField("one") for m in written]
    for label in paths:
        got = read.read(label, "") if form == "name" else read.read(label)
        np.testing.assert_array_equal(got, np.array(expected[label], dtype=got.dtype))
    if "deep" in paths and len(read.message_of(".items[].items[]")):
        parents = read.parent_of(".items[].items[]")
        of_item = read.parent_of(".items[]") if ".items[]" in read.rows else None
        if of_item is not None and of_item.size:
            np.testing.assert_array_equal(of_item[parents], read.message_of(".items[].items[]"))


@pytest.mark.parametrize("lengths", [[100] * 200, [1] * 500 + [20_000], [20_000] + [0] * 500, [0] * 100 + [3, 5000]])
def test_columns_of_many_numbers_are_whole(lengths):
    """Five columns that fill at once, in messages alike and not."""
    columns = [f"packed_{kind}" for kind in ("double", "float", "int32", "uint64", "sint32")]
    payloads = [CLASS(**{name: range(n) for name in columns}).SerializeToString() for n in lengths]
    fields = {name: Field(path=f".{name}[]", kind="number") for name in columns}
    read = run(protobuf_plan("p.M", DEFINITION, fields), payloads)
    for name in columns:
        np.testing.assert_array_equal(read.read(name), np.concatenate([np.arange(n) for n in lengths]))


def test_a_protobuf_schema_that_cannot_be_read_says_why():
    for definition, path, reported, *kind in (
        (b"\xff\xff", ".double", "FileDescriptorSet"),
        (b"", ".double", "defines it"),
        (DEFINITION, ".nothing", "lacks"),
        (DEFINITION, ".items.double", "repeated"),
        (DEFINITION, ".one[].double", "single"),
        (DEFINITION, ".many_double", "repeated"),
        (DEFINITION, ".one", "expected a time at .one"),
        (DEFINITION, ".string", "got text"),
        (DEFINITION, ".double.x", "expected a message at p.M.double, got a value"),
        (DEFINITION, ".double", "expected a time at .double, got a double", "time"),
        (DEFINITION, ".double", "expected a message at .double, got a double", "presence"),
    ):
        with pytest.raises(SchemaError, match=r"p\.M: ") as error:
            protobuf_plan("p.M", definition, {"x": Field(path=path, kind=(*kind, "number")[0])})
        assert reported in str(error.value)


# ---------------------------------------------------------------------------------------------- JSON


def test_json_reads_what_is_there_and_says_what_is_not():
    fields = {
        "id": Field(path=".objects[].id", kind="name"), "x": Field(path=".objects[].at[0]"),
        "t": Field(path=".stamp", kind="time"), "set": Field(path=".more", kind="presence"),
        "deep": Field(path=".objects[].parts[].y"),
    }  # fmt: skip
    reported = [
        {
            "stamp": {"sec": 1, "nsec": 5},
            "more": {},
            "objects": [{"id": 7, "at": [1.5]}, {"id": "b", "parts": [{"y": 2}]}],
        },
        {"stamp": "2020-01-01T00:00:00.000000001Z", "objects": None},
        {"stamp": 12, "objects": [{"id": None, "at": [3, 4], "parts": [{"y": 5}, {}]}]},
        {"objects": 5},
        [],
        {"objects": [{"id": {}}]},
    ]
    payloads = [json.dumps(one).encode() for one in reported] + [b"{", b"\xff", b"[" * 100_000]
    read = run(JsonPlan(fields), payloads)
    assert sorted(read.failures) == [3, 4, 5, 6, 7, 8]
    assert read.read("id", "").tolist() == ["7", "b", ""]
    np.testing.assert_array_equal(read.read("x"), [1.5, math.nan, 3.0])
    np.testing.assert_array_equal(read.read("deep"), [2.0, 5.0, math.nan])
    assert read.parent_of(".objects[].parts[]").tolist() == [1, 2, 2]
    assert read.read("t", NO_TIME).tolist()[:4] == [10**9 + 5, 1_577_836_800_000_000_001, 12, NO_TIME]
    assert read.is_set("set").tolist()[:3] == [True, False, False]
    assert read.message_of("").tolist() == list(range(9))


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


class Xcdr2:
    """Writes objects of `OBJECTS` by the rules of DDS-XTypes 1.3, 7.4.3.5, in one byte order; slowly."""

    def __init__(self, order, *, is_delimited):
        self.data, self.order, self.is_delimited = b"", order, is_delimited

    def number(self, form, value):
        size = struct.calcsize(form)
        self.data += bytes(-len(self.data) % min(size, 4)) + struct.pack(self.order + form, value)

    def text(self, value):
        self.number("I", len(value) + 1)
        self.data += value.encode() + b"\0"

    def sized(self, write, *, is_array):
        """What is written, behind its size."""
        if not (is_array or self.is_delimited):
            return write()
        self.number("I", 0)
        start = len(self.data)
        write()
        size = struct.pack(self.order + "I", len(self.data) - start)
        self.data = self.data[: start - 4] + size + self.data[start:]
        return None

    def array(self, values, write, *, is_sequence=True):
        def all_of_them():
            if is_sequence:
                self.number("I", len(values))
            for value in values:
                write(value)

        self.sized(all_of_them, is_array=True)

    def point(self, place):
        self.sized(lambda: [self.number("d", value) for value in place], is_array=False)

    def object(self, one):
        def members():
            self.text(one["id"])
            self.number("I", 1)
            self.point(one["at"])
            self.array([one["at"]] * 2, self.point, is_sequence=False)
            self.array([one["at"]] * len(one["id"]), self.point)
            self.number("d", 4.0), self.number("d", 2.0)

        self.sized(members, is_array=False)

    def message(self, objects):
        def members():
            self.number("Q", 1_700_000_000_000_000_000)
            self.number("B", 1)
            self.array(["", "abc"], self.text)
            self.array(objects, self.object)
            self.number("i", -5)

        self.sized(members, is_array=False)
        return self.data


FEW = [{"id": "a" * (i + 1), "at": (i + 0.5, -2.0 * i)} for i in range(3)]


@pytest.mark.parametrize("number", [0x06, 0x07, 0x08, 0x09, 0x10, 0x11, 0x14, 0x15])
def test_cdr2_has_sizes_in_front_of_arrays_and_where_it_is_delimited_of_messages(number):
    """The same messages in plain CDR beside them, in one batch: each is read by its own encapsulation."""
    order, is_delimited = "<" if number & 1 else ">", number & ~1 in (0x08, 0x14)
    payload = bytes([0, number, 0, 0]) + Xcdr2(order, is_delimited=is_delimited).message(FEW)
    fields = {
        "id": Field(path=".objects[].id", kind="name"), "x": Field(path=".objects[].at.x"),
        "kind": Field(path=".objects[].kind"), "width": Field(path=".objects[].size[1]"),
        "corner": Field(path=".objects[].corners[1].y"), "last": Field(path=".last"),
        "time": Field(path=".stamp", kind="time"),
    }  # fmt: skip
    plan = CdrPlan("demo::Objects", "omgidl", OBJECTS.encode(), fields)
    read = run(plan, [payload, payload[:90], payload])
    assert read.read("id", "").tolist() == ["a", "aa", "aaa"] * 2
    assert read.read("x").tolist() == [0.5, 1.5, 2.5] * 2
    assert (read.read("kind").tolist(), read.read("width").tolist()) == ([1.0] * 6, [2.0] * 6)
    assert read.read("corner").tolist() == [0.0, -2.0, -4.0] * 2
    assert read.read("last")[[0, 2]].tolist() == [-5.0, -5.0]
    assert read.read("time", NO_TIME)[0] == 1_700_000_000_000_000_000
    assert f"encapsulation {number & ~1:#06x}" in read.failures[1]
    last = run(CdrPlan("demo::Objects", "omgidl", OBJECTS.encode(), {"last": Field(path=".last")}), [payload])
    assert last.read("last").tolist() == [-5.0]
    path = run(
        CdrPlan("demo::Objects", "omgidl", OBJECTS.encode(), {"y": Field(path=".objects[].path[].y")}), [payload]
    )
    assert path.read("y").tolist() == [0.0, -2.0, -2.0, -4.0, -4.0, -4.0]


def test_structures_that_have_no_size_in_front_in_a_delimited_message_are_noticed():
    class Final(Xcdr2):
        def sized(self, write, *, is_array):
            return super().sized(write, is_array=True) if is_array or not self.data else write()

    text = OBJECTS.replace("struct Point", "@final struct Point").replace("struct Object ", "@final struct Object ")
    payload = b"\0\x09\0\0" + Final("<", is_delimited=True).message(FEW)
    for path in (".objects[].at.x", ".objects[].id"):
        plan = CdrPlan("demo::Objects", "omgidl", text.encode(), {"value": Field(path=path, kind="name")})
        assert "delimited CDR2" in run(plan, [payload]).failures[0]
    last = CdrPlan("demo::Objects", "omgidl", text.encode(), {"last": Field(path=".last")})
    assert run(last, [payload]).read("last").tolist() == [-5.0]  # their array has a size all the same


def test_messages_of_ros_1_are_read_as_rosbags_writes_them():
    text = "Header header\nuint8 flag\npkg/Inner[] items\nempty/Nothing no\nfloat64 last\ntime until\n" + "=" * 80
    text += "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n" + "=" * 80
    text += "\nMSG: pkg/Inner\nstring name\nfloat64 x\n" + "=" * 80 + "\nMSG: empty/Nothing\n"
    inner = b"".join(
        struct.pack("<I", len(name)) + name + struct.pack("<d", x) for name, x in ((b"a", 0.5), (b"bcd", 1.5))
    )
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
