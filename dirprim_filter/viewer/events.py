"""Initiation, coasting, reinitialisation and end of tracks: a diary."""

from __future__ import annotations

from dirprim_filter.estimates import TrackedFrame

COASTS, ANEW, MEASURED = "coasts", "reinitialised: its belief did not explain its measurements", "measured again"


class Events:
    """Compares each frame with the one before."""

    def __init__(self) -> None:
        self._coasting: dict[str, bool] = {}

    def of(self, frame: TrackedFrame) -> list[tuple[str, str]]:
        """Level and text of what has changed."""
        now = dict(zip(frame.names, frame.estimates.is_coasting.tolist(), strict=True))
        before, self._coasting = self._coasting, now
        found = [("INFO", f"{name} ended") for name in before if name not in now]
        found += [("INFO", f"{name} initialised") for name in now if name not in before]
        found += [
            ("INFO", f"{name} {COASTS if coasts else MEASURED}")
            for name, coasts in now.items()
            if coasts != before.get(name, False)
        ]
        return found + [("WARN", f"{name} {ANEW}") for name in frame.begun_anew if name in now]
