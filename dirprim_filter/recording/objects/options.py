"""How the objects of a log are read: what the command line and Python have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypedDict

from dirprim_filter.recording.schemas.field_mapping import FieldMapping
from dirprim_filter.recording.transforms.geodesy import Origin

TimeSource = Literal["log", "publish", "header"]
"""Which of a message's times counts: of logging, of publishing, or the one its contents carry."""


class Reading(TypedDict, total=False):
    """The fields of `ReadOptions` as keywords; what they mean is said by `read_tracks`."""

    time_source: TimeSource
    start_ns: int | None
    end_ns: int | None
    strict: bool
    frame: str | None
    mapping: FieldMapping | None
    origin: Origin | None
    labels: str | None
    group: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """How the objects of a log are read; what its fields mean is said by `read_tracks`."""

    time_source: TimeSource = "log"
    start_ns: int | None = None
    end_ns: int | None = None
    strict: bool = False
    frame: str | None = None
    mapping: FieldMapping | None = None
    origin: Origin | None = None
    labels: str | None = None
    group: int | None = None
