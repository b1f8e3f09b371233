"""The scenes' road networks and demand, as data: a roundabout, a signalised intersection, a highway weave.

The nouns are those of SUMO's plain network format, which `netconvert` reads:
https://sumo.dlr.de/docs/Networks/PlainXML.html. Metres, x east, y north, (0, 0) in the middle of the scene;
traffic keeps to the right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

Point: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A place where edges end; `kind` is SUMO's node type, such as `traffic_light`."""

    name: str
    at: Point
    kind: str = "priority"


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """A one-way road from node `start` to node `end`.

    Attributes:
        n_lanes: number of lanes; lane 0 is the rightmost.
        speed: limit in m/s.
        shape: the line from end to end; none for a straight road from node to node.
        lane_width: m.
        spread: `right` lays the lanes to the right of the line, `center` on both sides of it.
        priority: the edge of higher priority has the right of way at an unsignalised node.
    """

    name: str
    start: str
    end: str
    n_lanes: int
    speed: float
    shape: tuple[Point, ...] = ()
    lane_width: float = 3.3
    spread: str = "right"
    priority: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A lane that leads to a lane; where an edge has none, `netconvert` works out the usual ones."""

    origin: str
    destination: str
    origin_lane: int
    destination_lane: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Flow:
    """Vehicles that arrive on edge `origin` as a Poisson process and leave by edge `destination`."""

    origin: str
    destination: str
    vehicles_per_hour: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A network and its demand."""

    name: str
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    connections: tuple[Connection, ...] = ()
    flows: tuple[Flow, ...]

    def with_demand(self, factor: float) -> Scene:
        """The same roads with so many times the vehicles an hour."""
        flows = (replace(flow, vehicles_per_hour=factor * flow.vehicles_per_hour) for flow in self.flows)
        return replace(self, flows=tuple(flows))


ARMS = ("east", "north", "west", "south")
"""Arm k leaves the junction at k quarter turns counter-clockwise from east."""

URBAN_SPEED = 50 / 3.6
RING_SPEED = 28 / 3.6
HIGHWAY_SPEED = 100 / 3.6
RAMP_SPEED = 80 / 3.6

RING_RADIUS = 20.0
RING_LANE_WIDTH = 5.0
SPLITTER_ANGLE = math.radians(20.0)
"""Half the angle between an arm's exit from the ring and its entry; the splitter island stands between."""
ENTRY_ANGLE = math.radians(25.0)
"""Between the ring's tangent and a vehicle that enters or leaves."""
ROUNDABOUT_REACH = 100.0
"""From the centre to the end of an arm: 80 m of approach and the ring."""
INTERSECTION_REACH = 95.0
"""From the centre to the end of an arm: 80 m of approach and half the junction."""


def roundabout() -> Scene:
    """Four arms on a ring of one wide lane that is driven counter-clockwise."""
    nodes: list[Node] = []
    edges: list[Edge] = []
    approach = _approach()
    for k, arm in enumerate(ARMS):
        angle = k * math.pi / 2
        nodes += [
            Node(name=f"end_{arm}", at=_polar(ROUNDABOUT_REACH, angle)),
            Node(name=f"exit_{arm}", at=_polar(RING_RADIUS, angle - SPLITTER_ANGLE)),
            Node(name=f"entry_{arm}", at=_polar(RING_RADIUS, angle + SPLITTER_ANGLE)),
        ]
        edges += [
            Edge(
                name=f"in_{arm}", start=f"end_{arm}", end=f"entry_{arm}", n_lanes=1, speed=URBAN_SPEED,
                shape=tuple(_turned(point, angle) for point in approach),
            ),
            Edge(
                name=f"out_{arm}", start=f"exit_{arm}", end=f"end_{arm}", n_lanes=1, speed=URBAN_SPEED,
                shape=tuple(_turned((x, -y), angle) for x, y in reversed(approach)),
            ),
            _arc(
                f"pass_{arm}", f"exit_{arm}", f"entry_{arm}",
                angle - SPLITTER_ANGLE, angle + SPLITTER_ANGLE,
            ),
            _arc(
                f"ring_{arm}", f"entry_{arm}", f"exit_{ARMS[(k + 1) % 4]}",
                angle + SPLITTER_ANGLE, angle + math.pi / 2 - SPLITTER_ANGLE,
            ),
        ]  # fmt: skip
    arrivals = {"east": 330.0, "north": 250.0, "west": 330.0, "south": 250.0}
    shares = {1: 0.25, 2: 0.42, 3: 0.28, 0: 0.05}
    return Scene(
        name="roundabout",
        nodes=tuple(nodes),
        edges=tuple(edges),
        flows=tuple(_turning_flows(arrivals, shares)),
    )


def intersection() -> Scene:
    """Four arms at traffic lights; the road from east to west has two lanes each way, the other one."""
    lanes = {"east": 2, "north": 1, "west": 2, "south": 1}
    nodes = [Node(name="centre", at=(0.0, 0.0), kind="traffic_light")]
    edges: list[Edge] = []
    for k, arm in enumerate(ARMS):
        nodes.append(Node(name=f"end_{arm}", at=_polar(INTERSECTION_REACH, k * math.pi / 2)))
        edges += [
            Edge(name=f"in_{arm}", start=f"end_{arm}", end="centre", n_lanes=lanes[arm], speed=URBAN_SPEED),
            Edge(name=f"out_{arm}", start="centre", end=f"end_{arm}", n_lanes=lanes[arm], speed=URBAN_SPEED),
        ]
    arrivals = {"east": 420.0, "north": 240.0, "west": 420.0, "south": 240.0}
    shares = {1: 0.22, 2: 0.53, 3: 0.25}
    return Scene(
        name="intersection",
        nodes=tuple(nodes),
        edges=tuple(edges),
        flows=tuple(_turning_flows(arrivals, shares)),
    )


def highway() -> Scene:
    """Two carriageways of 400 m; the eastbound one has an on-ramp, 240 m of weaving lane, and an exit."""
    nodes = (
        Node(name="west", at=(-200.0, 0.0)),
        Node(name="merge", at=(-120.0, 0.0)),
        Node(name="diverge", at=(120.0, 0.0)),
        Node(name="east", at=(200.0, 0.0)),
        Node(name="ramp_start", at=(-200.0, -24.0)),
        Node(name="ramp_end", at=(200.0, -24.0)),
        Node(name="back_start", at=(200.0, 6.0)),
        Node(name="back_end", at=(-200.0, 6.0)),
    )
    up = ((-200.0, -24.0), (-180.0, -19.6), (-160.0, -14.4), (-145.0, -10.6), (-133.0, -8.0), (-120.0, -6.6))
    down = tuple((-x, y) for x, y in reversed(up))
    edges = (
        Edge(name="main_in", start="west", end="merge", n_lanes=2, speed=HIGHWAY_SPEED, priority=3),
        Edge(name="weave", start="merge", end="diverge", n_lanes=3, speed=HIGHWAY_SPEED, priority=3),
        Edge(name="main_out", start="diverge", end="east", n_lanes=2, speed=HIGHWAY_SPEED, priority=3),
        Edge(name="ramp_in", start="ramp_start", end="merge", n_lanes=1, speed=RAMP_SPEED, shape=up),
        Edge(name="ramp_out", start="diverge", end="ramp_end", n_lanes=1, speed=RAMP_SPEED, shape=down),
        Edge(name="back", start="back_start", end="back_end", n_lanes=2, speed=HIGHWAY_SPEED, priority=3),
    )
    connections = (
        Connection(origin="main_in", destination="weave", origin_lane=0, destination_lane=1),
        Connection(origin="main_in", destination="weave", origin_lane=1, destination_lane=2),
        Connection(origin="ramp_in", destination="weave", origin_lane=0, destination_lane=0),
        Connection(origin="weave", destination="ramp_out", origin_lane=0, destination_lane=0),
        Connection(origin="weave", destination="main_out", origin_lane=1, destination_lane=0),
        Connection(origin="weave", destination="main_out", origin_lane=2, destination_lane=1),
    )
    flows = (
        Flow(origin="main_in", destination="main_out", vehicles_per_hour=1300.0),
        Flow(origin="main_in", destination="ramp_out", vehicles_per_hour=200.0),
        Flow(origin="ramp_in", destination="main_out", vehicles_per_hour=280.0),
        Flow(origin="ramp_in", destination="ramp_out", vehicles_per_hour=40.0),
        Flow(origin="back", destination="back", vehicles_per_hour=1300.0),
    )
    return Scene(name="highway", nodes=nodes, edges=edges, connections=connections, flows=flows)


SCENES: Mapping[str, Callable[[], Scene]] = {
    "roundabout": roundabout,
    "intersection": intersection,
    "highway": highway,
}


def _polar(radius: float, angle: float) -> Point:
    return radius * math.cos(angle), radius * math.sin(angle)


def _turned(point: Point, angle: float) -> Point:
    x, y = point
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)


def _approach() -> list[Point]:
    """The line of the east arm from its end to the ring: straight, then a Bezier curve to the right.

    It meets the ring at `ENTRY_ANGLE`.
    """
    meet = _polar(RING_RADIUS, SPLITTER_ANGLE)
    back_x, back_y = _polar(10.0, SPLITTER_ANGLE + ENTRY_ANGLE - math.pi / 2)
    a, b, c, d = (60.0, 0.0), (40.0, 0.0), (meet[0] + back_x, meet[1] + back_y), meet
    line: list[Point] = [(ROUNDABOUT_REACH, 0.0)]
    for i in range(13):
        t = i / 12
        weight = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3)
        x, y = (sum(w * p[axis] for w, p in zip(weight, (a, b, c, d), strict=True)) for axis in (0, 1))
        line.append((x, y))
    return line


def _arc(name: str, start: str, end: str, first: float, last: float) -> Edge:
    """A piece of the ring, counter-clockwise from angle `first` to angle `last`."""
    n = 8
    shape = tuple(_polar(RING_RADIUS, first + (last - first) * i / n) for i in range(n + 1))
    return Edge(
        name=name, start=start, end=end, n_lanes=1, speed=RING_SPEED, shape=shape,
        lane_width=RING_LANE_WIDTH, spread="center", priority=3,
    )  # fmt: skip


def _turning_flows(arrivals: Mapping[str, float], shares: Mapping[int, float]) -> Iterator[Flow]:
    """Arrivals per hour on each arm, split by the quarter turns (counter-clockwise) from arm to arm."""
    for k, arm in enumerate(ARMS):
        for quarters, share in shares.items():
            yield Flow(
                origin=f"in_{arm}",
                destination=f"out_{ARMS[(k + quarters) % 4]}",
                vehicles_per_hour=share * arrivals[arm],
            )
