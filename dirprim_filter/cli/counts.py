"""Numbers with what they count: one cell, two cells."""


def counted(n: int, what: str) -> str:
    """A number and what it counts, in the plural unless it is one."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
