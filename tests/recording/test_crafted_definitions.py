"""Definitions and messages made to be deep, endless or broken: each is read or refused in one line, soon."""

import mmap
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from map_mutations import MAPS, check_map
from mcap_files import run
from mcap_protobuf.schema import build_file_descriptor_set
from payload_mutations import TABLES, broken, check_definition, check_payload, check_table, check_transforms, subjects

from dirprim_filter.recording.decoding.cdr_plan import MAX_DEPTH, CdrPlan
from dirprim_filter.recording.decoding.field_columns import Field, SchemaError
from dirprim_filter.recording.decoding.protobuf_plan import protobuf_plan

IDL = b"""module p { module msg {
  module M_Constants { const uint8 CAR = 1; };
  struct P { double x; double y; };
  struct M { p::msg::P at; sequence<p::msg::P, 4> many; uint8 id[16]; string<10> name; @default (value=3) long v; };
}; };"""


def nested(depth, members, leaf):
    """p/M within which p/A1 stands, within which p/A2, and so on; the innermost has the leaf's fields."""
    parts = ["p/A1 first\nfloat64 b"]
    for k in range(1, depth):
        inside = "\n".join(f"p/A{k + 1} {name}" for name in members) if k < depth - 1 else leaf
        parts.append(f"MSG: p/A{k}\n{inside}")
    return f"\n{'=' * 80}\n".join(parts).encode()


@pytest.mark.parametrize("leaf", ["float64 x", "float64 x\nuint8 y", "string s", ""])
def test_a_chain_of_definitions_is_followed_so_far_and_no_further(leaf):
    fields = {"b": Field(path=".b")}
    CdrPlan("p/M", "ros2msg", nested(MAX_DEPTH, "a", leaf), fields)
    for depth in (MAX_DEPTH + 2, 600):
        with pytest.raises(SchemaError, match=f"at most {MAX_DEPTH} messages within each other"):
            CdrPlan("p/M", "ros2msg", nested(depth, "a", leaf), fields)


@pytest.mark.parametrize("leaf", ["", "uint8[16777216] x", "string s"])
def test_definitions_that_double_at_each_level_are_refused_soon(leaf):
    """2^30 messages, or as many operations, where they were written out."""
    with pytest.raises(SchemaError, match="all written out"):
        CdrPlan("p/M", "ros2msg", nested(MAX_DEPTH, "ab", leaf), {"b": Field(path=".b")})


@pytest.mark.parametrize(
    ("encoding", "data", "reported"),
    [("ros2msg", b"\0\1\0\0", "a message that ends within a field"),
     ("ros1msg", b"", "more than 65536 elements of one field")],
)  # fmt: skip
def test_arrays_of_empty_messages_within_each_other_end_with_the_bytes_there_are(encoding, data, reported):
    """131072^3 of them: each takes a byte at least, or counts as if it did, so a walk of 20 bytes is short."""
    parts = ["p/A[131072] a\nfloat64 b", "MSG: p/A\np/B[131072] a", "MSG: p/B\np/C[131072] a", "MSG: p/C\n"]
    plan = CdrPlan("p/M", encoding, f"\n{'=' * 80}\n".join(parts).encode(), {"b": Field(path=".b")})
    assert run(plan, [data + bytes(16)]).failures == {0: reported}


def test_structures_that_are_not_wanted_are_skipped_however_many_there_are():
    parts = ["p/A[] a\nfloat64 b", "MSG: p/A\nfloat32 x\nfloat32 y"]
    plan = CdrPlan("p/M", "ros2msg", f"\n{'=' * 80}\n".join(parts).encode(), {"b": Field(path=".b")})
    n = 100_001
    data = b"\0\1\0\0" + n.to_bytes(4, "little") + bytes(8 * n) + bytes(4) + np.float64(7.0).tobytes()
    columns = run(plan, [data])
    assert (columns.failures, columns.read("b").tolist()) == ({}, [7.0])


def test_a_broken_idl_definition_is_read_or_refused_in_one_line():
    """Those of ROS 2 and of protobuf break below."""
    fields = {"x": Field(path=".at.x"), "y": Field(path=".many[].y"), "name": Field(path=".name", kind="name")}
    CdrPlan("p/M", "ros2idl", IDL, fields)
    reported = []
    for i in range(150):
        try:
            CdrPlan("p/M", "ros2idl", broken(IDL, np.random.default_rng(i)), fields)
        except SchemaError as error:
            reported.append(str(error))
    assert reported
    assert not any("\n" in reason for reason in reported)


@pytest.mark.parametrize("name", [b"orienta\nion", b"orienta\x0bion", b"orientat\xc2\x85on"[:11]])
def test_a_name_that_would_break_the_line_is_escaped(name):
    """The fuzzer's find: protobuf repeats a name that is none, whatever characters are in it."""
    definition = build_file_descriptor_set(SceneUpdate).SerializeToString()
    assert b"orientation" in definition
    broken_line, fields = definition.replace(b"orientation", name), {"x": Field(path=".entities[].id")}
    with pytest.raises(SchemaError, match="invalid name") as caught:
        protobuf_plan("foxglove.SceneUpdate", broken_line, fields)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "leaf",
    ["uint8[9223372036854775807] x", f"uint8[{1 << 70}] x", "uint8[16777217] x", "uint8[0] x", "float64[-1] x",
     f"string<={1 << 32} x", f"uint8[<={1 << 70}] x", "string[3][9223372036854775807] x"],
)  # fmt: skip
@pytest.mark.parametrize("name", ["x", "b"])
def test_a_length_that_no_message_can_have_is_refused_wherever_it_stands(leaf, name):
    """Compiled walks add them to places: beyond 64 bits these would lie before the buffer, or in others' memory."""
    for definition in (leaf, f"p/A[2] x\nfloat64 b\n{'=' * 80}\nMSG: p/A\n{leaf}"):
        with pytest.raises(SchemaError, match="expected"):
            CdrPlan("p/M", "ros2msg", f"{definition}\nfloat64 b".encode(), {name: Field(path=f".{name}", kind="name")})


@pytest.mark.parametrize("at", [1 << 31, 1 << 32, 3 << 32])
def test_texts_behind_byte_2_31_of_a_chunk_are_read(at):
    """A chunk that is not compressed may be of any size; of this one, of zeros, no page but the last is touched."""
    message = b"\0\1\0\0" + (4).to_bytes(4, "little") + b"car\0"
    data = np.frombuffer(mmap.mmap(-1, at + len(message)), np.uint8)
    data[at:] = np.frombuffer(message, np.uint8)
    plan = CdrPlan("p/M", "ros2msg", b"string x", {"x": Field(path=".x", kind="name")})
    columns = plan.read(data, np.array([at]), np.array([at + len(message)]))
    assert columns.read("x", "").tolist() == ["car"]


ROUNDS = 20


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return subjects(tmp_path_factory.mktemp("whole"))


@pytest.mark.parametrize("check", [check_payload, check_definition])
def test_what_is_broken_costs_itself_and_no_more(whole, check):
    """A JSON message is read without its definition."""
    refused = [
        check(subject, np.random.default_rng([i, 3]))
        for subject in whole
        if check is check_payload or subject.name != "json"
        for i in range(ROUNDS)
    ]
    assert 0 < sum(refused) < len(refused)


def test_broken_transforms_cost_themselves_and_no_more(tmp_path):
    assert check_transforms(np.random.default_rng(0), tmp_path / "tf.mcap", 100) > 0


@pytest.mark.parametrize(
    ("check", "kind"), [*((check_table, form) for form in TABLES), *((check_map, kind) for kind in MAPS)]
)
def test_a_broken_table_or_map_is_refused_or_read_each_row_counted_and_the_map_used(tmp_path, check, kind):
    refused = [check(kind, tmp_path / "broken", np.random.default_rng([i, 3])) for i in range(3 * ROUNDS)]
    assert 0 < sum(refused) < len(refused)


@pytest.mark.slow
def test_no_index_of_a_kernel_leaves_its_array(tmp_path):
    """The kernels compiled with checks of bounds, which normal ones do without: an index beyond raises."""
    command = [sys.executable, Path(__file__).parents[1] / "benchmarks/fuzz.py", "10"]
    checked = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(command, env=checked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
