"""JSON messages: times and numbers as protobuf's own JSON mapping writes them; whatever is wrong costs its message."""

import json
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_files import columns_of, run

from dirprim_filter.recording.container.records import Channel, Schema
from dirprim_filter.recording.decoding.field_columns import EACH, MAX_NAME_LENGTH, NO_TIME, Field, wanted
from dirprim_filter.recording.decoding.json_plan import JsonPlan
from dirprim_filter.recording.schemas.decoders import Decoders
from dirprim_filter.recording.schemas.families import FAMILIES

S = 10**9
HUGE = int("9" * 400)
NASTY = [
    None, True, False, 0, -1, 2**53 + 1, 2**63, -(2**63) - 1, HUGE, -HUGE, 1e308, 5e-324, float("nan"), float("inf"),
    "", "NaN", "Infinity", "1e999", "5", "0001-01-01T00:00:00Z", "9999-12-31T23:59:59.999999999Z",
    "2024-02-30T00:00:00Z", "0000-00-00T00:00:00Z", "2024-01-01T00:00:00+99:99", "\ud800", "x" * 5000, "\0",
    "\N{FULLWIDTH DIGIT FIVE}", [], [[]], [None] * 7, {}, {"sec": HUGE}, {"sec": 1, "nsec": "x"}, {"nanos": True},
]  # fmt: skip


def read(kind, *values):
    """The column of the values, and the numbers of the messages that failed."""
    payloads = [json.dumps({"v": value}).encode() for value in values]
    columns = run(JsonPlan({"v": Field(path=".v", kind=kind)}), payloads)
    column = columns.read("v", {"time": NO_TIME, "number": np.nan, "name": ""}[kind])
    return column.tolist(), sorted(columns.failures)


@settings(max_examples=300, deadline=None)
@given(ns=st.integers(-62_135_596_800 * S, 253_402_300_800 * S - 1))  # the years 1 to 9999, all that protobuf allows
def test_timestamps_read_as_protobuf_wrote_them(ns):
    stamp = Timestamp()
    stamp.FromNanoseconds(ns)
    assert read("time", stamp.ToJsonString()) == ([ns if -(2**63) <= ns < 2**63 else NO_TIME], [])


@settings(max_examples=100, deadline=None)
@given(
    when=st.datetimes(datetime(1970, 1, 2), datetime(2200, 1, 1)),
    minutes=st.integers(-14 * 60, 14 * 60),
    is_fractional=st.booleans(),
)
def test_times_of_other_zones_read_with_and_without_a_fraction(when, minutes, is_fractional):
    when = when.replace(
        microsecond=when.microsecond if is_fractional else 0, tzinfo=timezone(timedelta(minutes=minutes))
    )
    exact = (when - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
    assert read("time", when.isoformat()) == ([exact], [])


def test_times_in_every_shape_that_writers_give_them_and_what_is_none_costs_its_message():
    times = {
        '{"sec": 5, "nsec": 7}': 5 * S + 7, '{"sec": 5, "nanosec": 7}': 5 * S + 7, '{"secs": 5, "nsecs": 7}': 5 * S + 7,
        '{"seconds": "5", "nanos": 7}': 5 * S + 7, '{"seconds": "5"}': 5 * S, '{"nanos": 7}': 7, "{}": 0,
        '{"seconds": "-5", "nanos": null}': -5 * S, "12": 12, '"1700000000000000001"': 1_700_000_000_000_000_001,
        '"0001-01-01T00:00:00Z"': NO_TIME, '"2024-06-01T00:00:00+02:00"': 1_717_192_800 * S, f"{HUGE}": NO_TIME,
        '"2024-06-01T00:00:00.1234567899Z"': 1_717_200_000 * S + 123_456_789, '{"seconds": "99999999999"}': NO_TIME,
    }  # fmt: skip
    assert read("time", *map(json.loads, times)) == (list(times.values()), [])
    none = [
        True, 1.5, [], {"second": 1}, {"sec": "1_0"}, {"sec": "\N{FULLWIDTH DIGIT FIVE}"}, {"sec": 1.5}, "", "now",
        "2024-02-30T00:00:00Z", "2024-06-01", "2024-06-01T00:00:00+99:99", "2024-06-01T00:00:00.Z",
    ]  # fmt: skip
    assert read("time", *none)[1] == list(range(len(none)))


def test_numbers_and_names_of_any_length_and_an_id_is_the_same_as_a_whole_number():
    assert read("name", 5, 5.0, "5", 1e15, -0.0, 5.5, float("nan"), float("inf"), 2.0**60) == (
        ["5", "5", "5", "1000000000000000", "0", "", "", "", ""], [5, 7, 8],
    )  # fmt: skip
    numbers = [1, -2.5, True, "12345678901234567890", "-1.5e3", "NaN", "-Infinity", None, HUGE, "1_0", " 1", "0x1", []]
    column, failed = read("number", *numbers)
    np.testing.assert_array_equal(column[:8], [1, -2.5, 1, 12345678901234567890, -1500, np.nan, -np.inf, np.nan])
    assert failed == [8, 9, 10, 11, 12]
    names, failed = read("name", "a", 7, "x" * 5000, "\ud800", 1.5)
    assert ([len(name) for name in names], failed) == ([1, 1, MAX_NAME_LENGTH + 1, 0, 0], [3, 4])
    assert read("name", "a", "a\0", "a\0b") == (["a", "", "a\0b"], [1])  # NUL at the end makes no other name


def test_json_reads_what_is_there_and_says_what_is_not():
    fields = {
        "id": Field(path=".objects[].id", kind="name"), "x": Field(path=".objects[].at[0]"),
        "t": Field(path=".stamp", kind="time"), "set": Field(path=".more", kind="presence"),
        "deep": Field(path=".objects[].parts[].y"),
    }  # fmt: skip
    reported = [
        {"stamp": 5, "more": {}, "objects": [{"id": 7, "at": [1.5]}, {"id": "b", "parts": [{"y": 2}]}]},
        {"objects": None},
        {"objects": [{"id": None, "at": [3, 4], "parts": [{"y": 5}, {}]}]},
        {"objects": 5},
        [],
        {"objects": [{"id": {}}]},
    ]
    read = run(JsonPlan(fields), [*(json.dumps(one).encode() for one in reported), b"{", b"\xff"])
    assert sorted(read.failures) == [3, 4, 5, 6, 7]
    assert read.read("id", "").tolist() == ["7", "b", ""]
    np.testing.assert_array_equal(read.read("x"), [1.5, np.nan, 3.0])
    np.testing.assert_array_equal(read.read("deep"), [2.0, 5.0, np.nan])
    assert read.parent_of(".objects[].parts[]").tolist() == [1, 2, 2]
    assert read.read("t", NO_TIME).tolist()[:3] == [5, NO_TIME, NO_TIME]
    assert read.is_set("set").tolist()[:3] == [True, False, False]
    assert read.message_of("").tolist() == list(range(8))


def test_a_message_nested_without_end_costs_itself():
    deep = [b"[" * 100_000, b'{"v":' * 100_000, b'{"v": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", b'{"v": 1}']
    columns = run(JsonPlan({"v": Field(path=".v")}), deep)
    assert sorted(columns.failures) == [0, 1, 2]
    assert columns.read("v").tolist()[3] == 1


@pytest.mark.parametrize("schema", sorted(FAMILIES))
def test_nasty_messages_of_every_schema_never_end_the_read(schema):
    rng = np.random.default_rng(0)
    family = FAMILIES[schema]
    channel = Channel(
        topic="/t", message_encoding="json", schema=Schema(name=schema, encoding="", data=b""), metadata=()
    )
    tree = wanted(family.fields)
    payloads = [json.dumps(nasty(tree, rng)).encode() for _ in range(80)]
    messages, decoders = columns_of(channel, payloads), Decoders()
    rows, failures = decoders.rows(messages)
    assert 0 < len(failures) < len(messages)
    alone = [decoders.rows(messages[i : i + 1]) for i in range(len(messages))]
    assert [i for i, (_, failed) in enumerate(alone) if failed] == sorted(failures)
    assert len(rows) == sum(len(one) for one, _ in alone)


def nasty(want, rng):
    """A message that has what is wanted, but for a few values."""
    if rng.random() < 0.02:
        return NASTY[rng.integers(len(NASTY))]
    if not want.below:
        kind = want.labels[0][1]
        return {"number": 1.5, "name": "car", "presence": {}, "time": {"sec": 1, "nsec": 2}}[kind]
    value = {}
    for name, selected in want.below.items():
        for selector, one in selected.items():
            if selector is None:
                value[name] = nasty(one, rng)
            else:
                n = int(rng.integers(3)) if selector == EACH else selector + 1
                value[name] = [nasty(one, rng) for _ in range(n)]
    return value
