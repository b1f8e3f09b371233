"""Topics by name, or by a regular expression."""

from __future__ import annotations

import re
from collections.abc import Callable


def matching(topics: str) -> Callable[[str], bool]:
    """Says whether a topic is the one named, or matches the expression in full.

    Raises:
        ValueError: it is no regular expression; a name may still be meant.
    """
    try:
        pattern = re.compile(topics)
    except re.error as error:
        raise ValueError(f"topics: expected a topic or a regular expression, got {topics!r}: {error}") from error
    return lambda topic: topic == topics or pattern.fullmatch(topic) is not None
