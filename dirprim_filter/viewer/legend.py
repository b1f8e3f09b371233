"""What the colours and marks mean: a colour bar under the map, and a text beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from dirprim_filter.viewer.colors import speed_color
from tessellation.arrays import FloatArray

N_STEPS = 48
TICK_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""m/s between ticks: the smallest that leaves at most six."""

BAR_WIDTH = 0.3
"""As a share of the view's width; in the corner, where there are fewest roads."""

TEXT = """\
**Roses**: how vehicles move in a cell. A petal points where they go and bends as they do; its area is their share; its
colour is their mean speed, from violet (0 m/s) to yellow ({fastest:g} m/s and more). A violet disc: they stand there.

**Orange arrows**: ways from cell to cell, as thick as vehicles took them, as bright as their share of all who left.

**White dots**: detections. **White outlines**: true vehicles, where known.

**Large dots, arrows, ellipses**: estimates, where they will be in one second, and the region that holds the vehicle
with 90 % probability. Dark: out of sight. **Lines behind**: the last five seconds.

**Fans, thin lines**: where it may be next, with 90 and 50 % probability, and some sampled futures.

**Small dots**: particles. By direction: amber east, green north, blue west, magenta south.

**White ring**: the vehicle that the filter understands least, or the one asked for. Its speed and its direction are
plotted: the prior of its place, the cue (its course of the last second), and both together, Eq. 4.

Layers are switched on and off in the panel on the left.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Legend:
    """The legend of one map.

    Attributes:
        extent: (2, 2) metres, the view's south-west and north-east corner; the bar lies in the former.
        fastest: m/s, the speed of the last colour.
    """

    extent: FloatArray
    fastest: float

    def bar(self) -> rr.Mesh3D:
        """The colour bar: a strip of quads from slow to fast."""
        x = np.repeat(self._x(np.linspace(0.0, self.fastest, N_STEPS + 1)), 2)
        low, high = self._y()
        y = np.tile([low, high], N_STEPS + 1)
        corner = 2 * np.arange(N_STEPS)[:, None]
        triangles = np.concatenate([corner + np.array([0, 2, 1]), corner + np.array([1, 2, 3])])
        color = speed_color(np.repeat(np.linspace(0.0, self.fastest, N_STEPS + 1), 2), fastest=self.fastest)
        return rr.Mesh3D(
            vertex_positions=np.stack([x, y, np.zeros_like(x)], axis=-1),
            triangle_indices=triangles,
            vertex_colors=color,
        )

    def ticks(self) -> rr.Points3D:
        """The speeds under the bar."""
        step = next((step for step in TICK_STEPS if self.fastest <= 5.0 * step), TICK_STEPS[-1])
        speed = np.append(np.arange(0.0, self.fastest - 0.4 * step, step), self.fastest)
        low, _ = self._y()
        place = np.stack([self._x(speed), np.full_like(speed, low), np.zeros_like(speed)], axis=-1)
        labels = [f"{s:g}" for s in speed[:-1]] + [f"{self.fastest:g} m/s"]
        return rr.Points3D(
            place, colors=(200, 200, 200), radii=rr.Radius.ui_points(1.0), labels=labels, show_labels=True
        )

    def text(self) -> rr.TextDocument:
        """The text beside the map."""
        return rr.TextDocument(TEXT.format(fastest=self.fastest), media_type="text/markdown")

    def _x(self, speed: FloatArray) -> FloatArray:
        (west, _), (east, _) = self.extent
        x: FloatArray = west + BAR_WIDTH * (east - west) * speed / self.fastest
        return x

    def _y(self) -> tuple[float, float]:
        (_, south), (_, north) = self.extent
        return float(south), float(south + 0.02 * (north - south))
