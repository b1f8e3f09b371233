"""What is read beside the map: the legend, and what happened to tracks."""

from __future__ import annotations

from dirprim_filter.estimates import TrackedFrame

COASTS, ANEW, MEASURED = "coasts", "reinitialised: its belief did not explain its measurements", "measured again"

LEGEND = """\
**Roses**: how vehicles move in a cell. A petal points and bends in their direction; its area is their share of those
that move; its colour is their mean speed, from violet (0 m/s) by green ({half:g} m/s) to yellow ({fastest:g} m/s and
more). A violet disc: the share of those that stand.

**White dots**: detections. **White outlines**: true vehicles, where known.

**Large dots, arrows, ellipses**: estimates, where they will be in one second, and the region that holds the vehicle
with 90 % probability. Dark: coasting. **Small dots behind**: the last five seconds. With `--smooth`, bold dots with
ellipses: the smoothed estimates.

**Fans, thin lines**: forecast regions of 90 and 50 % probability, and some rollouts.

**Particles**: of the ringed vehicle, with `--set particles_out=N` of all. By direction: amber east, green north,
blue west, magenta south.

**White ring**: the vehicle that was least expected, or the one asked for. Its direction is plotted: the prior of its
place, the cue (its turn signal, a circle without one), the posterior (Eq. 4), and its particles.

Layers are switched on and off in the panel on the left.
"""


def legend(fastest: float) -> str:
    """Markdown; `fastest` is the speed of the last colour, m/s."""
    return LEGEND.format(half=0.6 * fastest, fastest=fastest)


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
        return found + [("WARN", f"{name} {ANEW}") for name in frame.reinitialised if name in now]
