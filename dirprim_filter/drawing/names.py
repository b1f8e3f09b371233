"""Short names for long ids: labels of 36 characters bury what they name."""

LONGEST = 12
"""Characters of a name that is shown in full."""
KEPT = 4
"""Characters of a longer one's start and of its end: some ids differ in the one, some in the other."""


def short_name(name: str) -> str:
    """A name of at most `LONGEST` characters as it is, of a longer one its start and end, after its group.

    The same id has the same short name in every frame and picture. It is for the eye: two ids may share one.
    """
    group, slash, own = name.rpartition("/")
    return name if len(own) <= LONGEST else f"{group}{slash}{own[:KEPT]}…{own[-KEPT:]}"
