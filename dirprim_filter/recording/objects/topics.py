"""Which topics of a log are read: those that were named, or the one that says the most of moving objects."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Mapping, Sequence
from itertools import chain, islice

import numpy as np

from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.container.message_columns import MessageColumns
from dirprim_filter.recording.errors import DamagedRecordingError, NoTracksError, warn
from dirprim_filter.recording.name_patterns import matching
from dirprim_filter.recording.objects.options import ReadOptions
from dirprim_filter.recording.schemas.decoders import NOT_KNOWN, ONLY_NAMED, Decoders, batches, by_schema, schema_name
from dirprim_filter.recording.schemas.families import KINDS, MARKERS, OBSERVATIONS, SCENE_UPDATE
from dirprim_filter.recording.summary import TopicKey, key_of, summarise_by_index

_KINDS = [{name for family in kind for name in family.schemas} for kind in KINDS]
OUTPUT_PREFIX = "/dirprim/"
"""Topics that this package writes as results; never taken for input unless named."""
DRAWINGS = {*SCENE_UPDATE.schemas, *MARKERS.schemas}
SHOWN = 5
"""Of the topics that could be read too."""


def choose_topics(log: Log, options: ReadOptions, *, prefer_detections: bool = False) -> frozenset[str]:
    """The topics to read objects from.

    With `options.topics` those of that name, or else those that match it in full as a regular expression, if their
    schema is one of `FAMILIES`. Without it, one topic: of the first of `KINDS` of which some topic's messages
    hold objects the one that has most messages, and where a message of it is one body, all topics of its schema.
    Topics named `/detections...` stand back there behind others of their kind, but with `prefer_detections` ours,
    `/detections` or `/detections/SENSOR`, go before all. Topics under `/dirprim/` are not considered. With
    `options.mapping` every topic whose schema has its fields can be read.

    Raises:
        NoTracksError: there is none.
        DamagedRecordingError: strict, there is none, and the log is damaged.
        ValueError: `options.topics` is no name in the log and no regular expression.
    """
    channels, topics, mapping = log.channels(), options.topics, options.mapping
    decoders = Decoders(mapping)
    schema_of = {c.topic: schema_name(c) for c in channels if decoders.reads(c)}
    looked_for = f" (fields {mapping})" if mapping else ""
    failures = Failures()
    if topics is not None:
        is_wanted = topics.__eq__ if topics in {c.topic for c in channels} else matching(topics, of="topics")
        chosen = frozenset(filter(is_wanted, schema_of))
        wanted = f"topic {topics!r} with objects{looked_for}"
    else:
        inputs = {t: s for t, s in schema_of.items() if not t.startswith(OUTPUT_PREFIX)}
        kinds = [set(inputs.values())] if mapping else _KINDS
        chosen = _default(log, inputs, decoders, kinds, failures, prefer_detections=prefer_detections)
        wanted = f"a topic with moving objects{looked_for}"
    if not chosen:
        scan = Scan(log, waits=False)
        deque(scan.columns(), maxlen=0)  # all that is broken is known once all chunks were read
        if options.strict and scan.damage:
            raise DamagedRecordingError(log.path, scan.damage)
        asked = ((c.topic, decoders.refusal(c)) for c in channels if topics is None or is_wanted(c.topic))
        refused = [f"{topic}: {why}" for topic, why in asked if why not in ("", NOT_KNOWN)]
        last = failures.nothing_held() if mapping else ""
        why = failures.line() or min(refused, key=lambda line: line.endswith(ONLY_NAMED), default=last)
        raise NoTracksError(log.path, has=channels, wanted=wanted, damage=scan.damage, why=why)
    return chosen


class Failures:
    """Messages that cannot be decoded, by topic and reason, and how many were looked at."""

    def __init__(self) -> None:
        self._looked_at: Counter[TopicKey] = Counter()
        self._why: defaultdict[TopicKey, Counter[str]] = defaultdict(Counter)

    def take(self, messages: MessageColumns, failures: Mapping[int, str]) -> None:
        """Of messages, by number why some cannot be decoded."""
        for i, n in zip(*np.unique(messages.channel, return_counts=True), strict=True):
            self._looked_at[key_of(messages.channels[i])] += int(n)
        for i, reason in failures.items():
            self._why[key_of(messages.channels[messages.channel[i]])][reason] += 1

    def of(self, key: TopicKey) -> tuple[int, str]:
        """How many of a topic, and the most frequent reason."""
        why = self._why.get(key, Counter())
        return why.total(), max(why, key=why.__getitem__, default="")

    def line(self) -> str:
        """The most frequent reason in the topic that fails most; empty without any."""
        n, key = max(((why.total(), key) for key, why in self._why.items()), default=(0, ("", "", "")))
        topic, reason = key[0], self.of(key)[1]
        return f"{n} of {self._looked_at[key]} messages of {topic} cannot be decoded: {reason}" if n else ""

    def nothing_held(self) -> str:
        """Of the topic of which most messages were looked at, that none had an object; empty without any."""
        for key, n in self._looked_at.most_common(1):
            return f"none of {n} messages of {key[0]} holds an object with a place"
        return ""


def _default(
    log: Log, schema_of: dict[str, str], decoders: Decoders, kinds: Sequence[set[str]], failures: Failures,
    *, prefer_detections: bool,
) -> frozenset[str]:  # fmt: skip
    ours = {t for t in schema_of if t.startswith(topic_names.DETECTIONS) and schema_of[t] in OBSERVATIONS.schemas}
    ours = {t for t in ours if t.removeprefix(topic_names.DETECTIONS)[:1] in ("", "/")}  # of one sensor, or of several
    if prefer_detections and ours:
        return frozenset(ours)
    of_kind = [{topic for topic, schema in schema_of.items() if schema in names} for names in kinds]
    for number, topics in enumerate(of_kind):
        carrying = _carrying_objects(log, decoders, topics, failures)
        chosen = true = {topic for topic in carrying if not topic.startswith(topic_names.DETECTIONS)} or carrying
        if len(true) > 1:
            longest = _longest(log, true)
            same = {topic for topic in true if schema_of[topic] == schema_of[longest]}
            chosen = same if decoders.is_of_one_body(schema_of[longest]) else {longest}
        if chosen:
            others = sorted(true - chosen) + sorted(_others_of(log, set().union(*of_kind[number + 1 :]), schema_of))
            if others:
                read, more = ", ".join(sorted(chosen)), f" and {len(others) - SHOWN} more" * (len(others) > SHOWN)
                warn(log.path, f"{read} is read, not {', '.join(others[:SHOWN])}{more}; --topics chooses")
            return frozenset(chosen)
    return frozenset()


def _others_of(log: Log, topics: set[str], schema_of: Mapping[str, str]) -> set[str]:
    """Those of the topics that have messages, as far as the log's index says, but for drawings of what others say."""
    topics = {topic for topic in topics if schema_of[topic] not in DRAWINGS}
    counted = _counted(log, topics) if topics else None
    return topics if counted is None else set(counted)


def _carrying_objects(log: Log, decoders: Decoders, topics: set[str], failures: Failures) -> set[str]:
    """Those of the topics in which some message holds an object; reads no further than needed to know.

    Of a live pipe all that it began with: others might be waited for in vain.
    """
    if log.is_live:
        return topics
    carrying: set[str] = set()
    if topics:
        parts = Scan(log, topics.__contains__).columns()
        some = (batches(islice(parts, n), decoders.reads) for n in (1, None))
        for batch in chain.from_iterable(some):  # the first chunk may be enough
            for _, messages in by_schema(batch):
                rows, failed = decoders.rows(messages)
                failures.take(messages, failed)
                of = messages.channel[rows.message[np.isfinite(rows.position[:, 0])]]
                carrying |= {messages.channels[i].topic for i in np.unique(of).tolist()}
            if carrying == topics:
                break
    return carrying


def _longest(log: Log, topics: set[str]) -> str:
    n_messages = _counted(log, topics)
    if n_messages is None:
        n_messages = Counter()
        for columns in () if log.is_live else Scan(log, topics.__contains__).parts():
            n_messages.update(columns.topic.tolist())
    return min(topics, key=lambda topic: (-n_messages[topic], topic))


def _counted(log: Log, topics: set[str]) -> Counter[str] | None:
    """How many messages those of the topics have that have any, by the log's index; None where it has none."""
    if log.is_live or Scan(log).damage:
        return None
    index = summarise_by_index([(log.path, file.bytes_of) for file in log.files], from_bytes=0)
    if index is None:
        return None
    return +sum((Counter({t.name: t.messages}) for t in index.topics if t.name in topics), Counter())
