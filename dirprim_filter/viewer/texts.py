"""What is read beside the map: the legend, and what happened to tracks and to true vehicles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.viewer.matching import Matched

ROSES = """\
**Roses**: how vehicles move in a cell. A petal points and bends in their direction; its area is their share of those
that move; its colour is their mean speed, from violet (0 m/s) by green ({half:g} m/s) to yellow ({fastest:g} m/s and
more). A violet disc: the share of those that stand.

"""
LEGEND = """\
**White outlines**: true vehicles, where known. **Small dots**: detections, a colour for each sensor; arrows lead
there from where the track that they were assigned to was expected: innovations.

**Large dots, arrows, ellipses, trails**: estimates, where they will be in one second, the region that holds the
vehicle with 90 % probability, the last five seconds. Dark: coasting. With `--smooth`, bold: the smoothed estimates.

**Fans, thin lines**: forecast regions of 90 and 50 % probability, and some rollouts.

**Red**: an exchange of ids, a vehicle that is lost, a ghost; the tab *Events* says when.

**Particles**: some of each vehicle, with `--set particles_out=N`. By direction: amber east, green north, blue west,
magenta south.

A click selects a vehicle; the panel on the left hides it, or whole layers. The first {most} vehicles have an entity
and curves each, those after share one.
"""


class Event(NamedTuple):
    """What has happened: a line; and on the map a word at a place, (2,) metres, None for what the map does not show."""

    level: str
    text: str
    word: str = ""
    place: FloatArray | None = None


class Events:
    """Compares each frame with those before."""

    def __init__(self) -> None:
        self._coasting: dict[str, bool] = {}
        self._track_of: dict[str, str] = {}
        self._alone_since: dict[tuple[str, str], int] = {}

    def of(self, frame: TrackedFrame, matched: Matched | None) -> list[Event]:
        """What has changed."""
        now = dict(zip(frame.names, frame.estimates.is_coasting.tolist(), strict=True))
        before, self._coasting = self._coasting, now
        said = [f"{name} ended" for name in before if name not in now]
        said += [f"{name} initialised" for name in now if name not in before]
        changed = (name for name, coasts in now.items() if coasts != before.get(name, False))
        said += [f"{name} {'coasts' if now[name] else 'measured again'}" for name in changed]
        found = [Event("INFO", text) for text in said]
        anew = "reinitialised: its belief did not explain its measurements"
        found += [Event("WARN", f"{name} {anew}") for name in frame.reinitialised if name in now]
        return found if matched is None else found + self._against(frame, matched)

    def _against(self, frame: TrackedFrame, matched: Matched) -> list[Event]:
        """Exchanges of ids; vehicles without a track for 1 s, which are lost, tracks without a vehicle, ghosts."""
        found, alone = [], dict[tuple[str, str], FloatArray]()
        vehicle_of = {frame.names[row]: name for name, row in zip(matched.names, matched.row, strict=True) if row >= 0}
        for name, row, place in zip(matched.names, matched.row.tolist(), matched.position, strict=True):
            if row < 0:
                alone["lost", f"vehicle {name}: lost, no track near it for 1 s"] = place
                continue
            own, last = frame.names[row], self._track_of.get(name, frame.names[row])
            self._track_of[name] = own
            if own != last:
                other = f"; {last} now follows {vehicle_of[last]}" if last in vehicle_of else ""
                found.append(Event("WARN", f"vehicle {name}: exchange, {last} was its track, now {own}{other}",
                                   "exchange", place))  # fmt: skip
        places = dict(zip(frame.names, frame.estimates.position, strict=True))
        alone |= {
            ("ghost", f"{name}: ghost, no vehicle near it for 1 s"): place
            for name, place in places.items()
            if name not in vehicle_of
        }
        self._alone_since = {who: self._alone_since.get(who, frame.time_ns) for who in alone}
        for (word, text), since_ns in self._alone_since.items():
            if frame.time_ns - since_ns >= 1_000_000_000:
                self._alone_since[word, text] = np.iinfo(np.int64).max  # once
                found.append(Event("WARN", text, word, alone[word, text]))
        return found


def legend(fastest: float | None, *, most: int) -> str:
    """Markdown; `fastest`: speed of a map's last colour, m/s; `most`: how many vehicles have an entity each."""
    roses = "" if fastest is None else ROSES.format(half=0.6 * fastest, fastest=fastest)
    return roses + LEGEND.format(most=most)
