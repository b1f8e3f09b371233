"""Which topics of a log are read: those that were named, or the one that tells the most of moving objects."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.damage import Damage
from dirprim_filter.recording.container.log import Scan
from dirprim_filter.recording.errors import DamagedRecordingError, NoTracksError
from dirprim_filter.recording.name_patterns import matching
from dirprim_filter.recording.schemas import KINDS
from dirprim_filter.recording.schemas.decoders import Decoders, batches, by_schema, schema_name
from dirprim_filter.recording.schemas.field_mapping import FieldMapping

logger = logging.getLogger(__name__)

_KINDS = [{name for family in kind for name in family.schemas} for kind in KINDS]
OUTPUT_PREFIX = "/dirprim/"
"""Topics that this package writes as results; never taken for input unless named."""


def choose_topics(
    path: Path,
    topics: str | None,
    *,
    prefer_detections: bool = False,
    strict: bool = False,
    mapping: FieldMapping | None = None,
) -> frozenset[str]:
    """The topics to read objects from.

    With `topics` those of that name, or else those that match it in full as a regular expression, if their
    schema is one of `FAMILIES`. Without it, one topic: of the first of `KINDS` of which some topic's messages
    hold objects the one that has most messages. Topics named `/detections...` stand back there behind others
    of their kind, but with `prefer_detections` the topic `/detections` goes before all. Topics under
    `/dirprim/` are not considered. With `mapping` every topic whose schema has its fields can be read.

    Raises:
        NoTracksError: there is none.
        DamagedRecordingError: strict, there is none, and the log is damaged.
        ValueError: `topics` is no name in the log and no regular expression.
    """
    with Scan(path) as log:
        channels = log.channels()
    decoders = Decoders(mapping)
    schema_of = {c.topic: schema_name(c) for c in channels if decoders.reads(c)}
    looked_for = f" (fields {mapping})" if mapping else ""
    why = "".join(f"; {reason}" for reason in decoders.unreadable()[:1]) if mapping else ""
    if topics is not None:
        chosen = frozenset(_named(topics, schema_of))
        wanted = f"topic {topics!r} with objects{looked_for}"
    else:
        inputs = {t: s for t, s in schema_of.items() if not t.startswith(OUTPUT_PREFIX)}
        kinds = [set(inputs.values())] if mapping else _KINDS
        chosen = _default(path, inputs, decoders, kinds, prefer_detections=prefer_detections)
        wanted = f"a topic with moving objects{looked_for}"
    if not chosen:
        damage = _damage(path)
        if strict and damage:
            raise DamagedRecordingError(path, damage)
        raise NoTracksError(path, has=channels, wanted=wanted + why, damage=damage)
    return chosen


def _named(topics: str, schema_of: dict[str, str]) -> list[str]:
    if topics in schema_of:
        return [topics]
    return list(filter(matching(topics, of="topics"), schema_of))


def _default(
    path: Path,
    schema_of: dict[str, str],
    decoders: Decoders,
    kinds: Sequence[set[str]],
    *,
    prefer_detections: bool,
) -> frozenset[str]:
    if prefer_detections and topic_names.DETECTIONS in schema_of:
        return frozenset({topic_names.DETECTIONS})
    for names in kinds:
        carrying = _carrying_objects(path, decoders, {topic for topic, schema in schema_of.items() if schema in names})
        true = {topic for topic in carrying if not topic.startswith(topic_names.DETECTIONS)} or carrying
        if len(true) > 1:
            return frozenset({_longest(path, true)})
        if true:
            return frozenset(true)
    return frozenset()


def _carrying_objects(path: Path, decoders: Decoders, topics: set[str]) -> set[str]:
    """Those of the topics in which some message holds an object; reads no further than needed to know."""
    carrying: set[str] = set()
    if topics:
        with Scan(path, topics.__contains__) as log:
            for batch in batches(log, decoders):
                for _, messages in by_schema(batch):
                    rows, _ = decoders.rows(messages)
                    carrying |= {
                        messages[i].topic for i in np.unique(rows.message[np.isfinite(rows.position[:, 0])]).tolist()
                    }
                if carrying == topics:
                    break
    return carrying


def _damage(path: Path) -> list[Damage]:
    """All that is broken, which is known once all chunks were read."""
    with Scan(path) as log:
        deque(log, maxlen=0)
        return log.damage


def _longest(path: Path, topics: set[str]) -> str:
    with Scan(path, topics.__contains__) as log:
        n_messages = Counter(message.topic for message in log)
    chosen = min(topics, key=lambda topic: (-n_messages[topic], topic))
    logger.info("%s: of the topics %s, %s is read", path, ", ".join(sorted(topics)), chosen)
    return chosen
