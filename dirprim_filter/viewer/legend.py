"""What the colours and marks mean: a colour bar under the map, and a text beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing.colors import speed_color
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.focus import CROWD, DRAWN_IN_FULL

N_STEPS = 48
TICK_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""m/s between ticks: the smallest that leaves at most six."""

BAR_WIDTH = 0.3
"""As a share of the view's width; in the southern corner where there are fewer cells."""
BAR_HEIGHT = 0.02
"""Of the view's."""
CORNER = (0.35, 0.1)
"""Width and height of what the bar and its numbers hide, as shares of the view's."""

TEXT = """\
**Roses**: how vehicles move in a cell. A petal points and bends in their direction; its area is their probability; its
colour is their mean speed, from violet (0 m/s) to yellow ({fastest:g} m/s and more). A violet disc: standing vehicles.

**Orange arrows**: transitions from cell to cell: thickness is the count, brightness the share of the cell.

**White dots**: detections. **White outlines**: true vehicles, where known.

**Large dots, arrows, ellipses**: estimates, where they will be in one second, and the region that holds the vehicle
with 90 % probability. Dark: coasting. **Lines behind**: the last five seconds. With `--smooth`, bold lines with
ellipses: the smoothed estimates.

**Fans, thin lines**: forecast regions of 90 and 50 % probability, and some rollouts.

**Small dots**: particles of the ringed vehicle, with `--particles-out` of all. By direction: amber east, green north,
blue west, magenta south.

**White ring**: the vehicle with the largest innovations, or the one asked for. Its speed and its direction are
plotted: the prior of its place, the cue (its course of the last second), and the posterior, Eq. 4.

**Dense traffic**: of more than {crowd} vehicles only {few} have a name, particles, an
ellipse and a fan: those with the largest innovations. The others are small.

Layers are switched on and off in the panel on the left.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Legend:
    """The legend of one map.

    Attributes:
        extent: (2, 2) metres, the view's south-west and north-east corner.
        fastest: m/s, the speed of the last colour.
        is_east: the bar lies in the south-east corner, not in the south-west one.
    """

    extent: FloatArray
    fastest: float
    is_east: bool = False

    @classmethod
    def of(cls, primitives: PrimitiveMap, *, extent: FloatArray, fastest: float) -> Self:
        """The legend of a map, where it hides the fewest cells that hold data."""
        centers = primitives.tessellation.centers[primitives.n_rows[:-1] > 0]
        share = (centers - extent[0]) / (extent[1] - extent[0])
        low = share[(share[:, 1] >= 0) & (share[:, 1] < CORNER[1]), 0]
        west, east = ((low >= 0) & (low < CORNER[0])).sum(), ((low <= 1) & (low > 1 - CORNER[0])).sum()
        return cls(extent=extent, fastest=fastest, is_east=bool(east < west))

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
        return rr.TextDocument(
            TEXT.format(fastest=self.fastest, crowd=CROWD, few=DRAWN_IN_FULL), media_type="text/markdown"
        )

    def _x(self, speed: FloatArray) -> FloatArray:
        (west, _), (east, _) = self.extent
        width = BAR_WIDTH * (east - west)
        x: FloatArray = (east - width if self.is_east else west) + width * speed / self.fastest
        return x

    def _y(self) -> tuple[float, float]:
        (_, south), (_, north) = self.extent
        return float(south), float(south + BAR_HEIGHT * (north - south))
