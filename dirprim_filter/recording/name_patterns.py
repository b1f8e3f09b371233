"""Names, such as those of topics, one by one or by a regular expression."""

from __future__ import annotations

import re
from collections.abc import Callable


def matching(text: str, *, of: str) -> Callable[[str], bool]:
    """Says whether a name is the one given, or matches the expression in full.

    Args:
        text: a name or an expression.
        of: what has such names; stands in the error.

    Raises:
        ValueError: it is no regular expression; a name may still be meant.
    """
    try:
        pattern = re.compile(text)
    except re.error as error:
        raise ValueError(f"{of}: expected a name or a regular expression, got {text!r}: {error}") from error
    return lambda name: name == text or pattern.fullmatch(name) is not None
