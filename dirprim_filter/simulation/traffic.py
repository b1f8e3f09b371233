"""Traffic: Eclipse SUMO drives vehicles through a scene, and what moved comes back as `Tracks`.

A scene is a folder of `scenes/` with the files that SUMO reads: nodes, edges, connections where they are not the usual
ones, and the flows that arrive as Poisson processes (https://sumo.dlr.de/docs/Networks/PlainXML.html). Its drivers are
those of `scenes/drivers.add.xml`. `netconvert` builds the network by `scenes/build.netccfg` and `sumo` drives on it by
`scenes/drive.sumocfg`, each a child process in a temporary folder. What comes back:
https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html.
"""

from __future__ import annotations

import importlib.util
import logging
import math
import os
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from array import array
from pathlib import Path

import numpy as np

from dirprim_filter.tracks import Tracks

logger = logging.getLogger(__name__)

SCENES = ("roundabout", "intersection", "highway")
FOLDER = Path(__file__).parent / "scenes"
DRIVERS = FOLDER / "drivers.add.xml"
STEP_MS = 100
"""Time step of the simulation: 10 Hz."""
WARM_UP_S = 90
"""The network is empty at first; the log begins when traffic has filled it."""


class SimulationError(RuntimeError):
    """SUMO is not installed, or it failed; the message is one line."""


def simulate(scene: str, *, duration_s: float, seed: int, rate_hz: float = 10.0, demand: float = 1.0) -> Tracks:
    """Drive a scene's traffic, and observe each vehicle's centre, direction and speed at a fixed rate.

    SUMO gives the middle of the front bumper and the body's yaw; the position is moved back by half a length.
    The yaw is the heading; the direction is the course of that centre, from its positions: on an arc they are the
    same, as the chord from bumper to bumper is parallel to the tangent at its middle, and where the bend changes they
    differ by degrees. Who never moves has the yaw for a direction.

    Args:
        scene: one of `SCENES`.
        duration_s: how long to observe, s; the log begins at time 0, when traffic has filled the roads.
        seed: decides all that is random: arrivals, drivers, their lapses. The same seed and the same version
            of SUMO give the same tracks.
        rate_hz: rows per second for each vehicle; 10 divided by a whole number.
        demand: how many vehicles arrive, in units of the scene's own; from about 2 on queues fill the roads.

    Returns:
        Tracks with the vehicles numbered from 0 in the order in which they appear.

    Raises:
        ValueError: a scene, duration, seed, rate or demand that does not exist.
        SimulationError: SUMO is not installed, or it failed.
    """
    period_ms = _check(scene, duration_s, seed, rate_hz, demand)
    netconvert, sumo = _program("netconvert"), _program("sumo")
    driven = {
        "--configuration-file": str(FOLDER / "drive.sumocfg"), "--net-file": "scene.net.xml",
        "--route-files": "scene.rou.xml", "--fcd-output": "fcd.xml",
        "--step-length": str(STEP_MS / 1000), "--seed": str(seed), "--end": f"{WARM_UP_S + duration_s:.3f}",
        "--device.fcd.begin": str(WARM_UP_S), "--device.fcd.period": f"{period_ms / 1000:.3f}",
    }  # fmt: skip
    plain = {"--node-files": "nod", "--edge-files": "edg", "--connection-files": "con"}
    paths = {option: FOLDER / scene / f"scene.{kind}.xml" for option, kind in plain.items()}
    network = {option: str(path) for option, path in paths.items() if path.exists()}
    network |= {"--configuration-file": str(FOLDER / "build.netccfg"), "--output-file": "scene.net.xml"}
    with tempfile.TemporaryDirectory(prefix="dirprim-sumo-") as name:
        folder = Path(name)
        _write_flows(FOLDER / scene / "scene.rou.xml", folder / "scene.rou.xml", demand)
        _run(netconvert, network, folder)
        _run(sumo, driven, folder)
        return _read_tracks(folder / "fcd.xml")


def _check(scene: str, duration_s: float, seed: int, rate_hz: float, demand: float) -> int:
    """The observation period in milliseconds.

    Raises:
        ValueError: an argument of `simulate` is out of range.
    """
    if scene not in SCENES:
        raise ValueError(f"scene: expected one of {', '.join(SCENES)}, got {scene!r}")
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise ValueError(f"duration_s: expected a positive number of seconds, got {duration_s}")
    if not 0 <= seed < 2**31:
        raise ValueError(f"seed: expected 0 to {2**31 - 1}, got {seed}")
    steps = 1000 / STEP_MS / rate_hz if rate_hz > 0 else 0.0
    if not (steps >= 1 and math.isclose(steps, round(steps))):
        raise ValueError(f"rate_hz: expected 10 divided by a whole number (10, 5, 2.5, 2, 1, ...), got {rate_hz}")
    if not (math.isfinite(demand) and demand > 0):
        raise ValueError(f"demand: expected a positive factor, got {demand}")
    return round(steps) * STEP_MS


def _program(name: str) -> Path:
    """The path of a program of the `eclipse-sumo` package.

    Raises:
        SimulationError: the package is not installed.
    """
    package = importlib.util.find_spec("sumo")
    places = (package.submodule_search_locations or []) if package else []
    for place in places:
        for suffix in ("", ".exe"):
            path = Path(place) / "bin" / (name + suffix)
            if path.is_file():
                return path
    raise SimulationError(f'{name} of Eclipse SUMO is not installed; pip install "dirprim-filter[sim]"')


def _write_flows(source: Path, target: Path, demand: float) -> None:
    """The scene's flows as Poisson processes of so many times their vehicles an hour."""
    routes = ET.parse(source)  # noqa: S314  shipped with this module
    for flow in routes.iter("flow"):
        flow.set("period", f"exp({demand * float(flow.attrib.pop('vehsPerHour')) / 3600:.6f})")
    routes.write(target, encoding="utf-8", xml_declaration=True)


def _run(program: Path, settings: dict[str, str], folder: Path) -> None:
    """Run a program of SUMO in `folder`, where it writes.

    Raises:
        SimulationError: it reported failure.
    """
    environment = {**os.environ, "SUMO_HOME": str(program.parents[1])}
    done = subprocess.run(  # noqa: S603  a list, no shell; nothing in it comes from outside but checked numbers
        [str(program), *(word for setting in settings.items() for word in setting)],
        cwd=folder, env=environment, capture_output=True, text=True, errors="replace", check=False,
    )  # fmt: skip
    for line in done.stderr.splitlines():
        logger.debug("%s: %s", program.name, line)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if line.startswith("Error")] or [done.stderr.strip()]
        raise SimulationError(f"{program.name} failed with status {done.returncode}: {errors[0]}")


def _read_tracks(path: Path) -> Tracks:
    """Tracks of a floating car data file, moved from the front bumper to the centre."""
    length = {of.attrib["id"]: float(of.attrib["length"]) for of in ET.parse(DRIVERS).iter("vType")}  # noqa: S314  ours
    number: dict[str, int] = {}
    vehicle, time_step = array("q"), array("q")
    states = array("d")
    events = ET.iterparse(path, events=("start", "end"))  # noqa: S314  written by the child process
    _, root = next(events)
    now = 0
    for event, element in events:
        a = element.attrib
        if event == "start" and element.tag == "timestep":
            now = round((float(a["time"]) - WARM_UP_S) * 1000 / STEP_MS)
        elif event == "end" and element.tag == "vehicle":
            vehicle.append(number.setdefault(a["id"], len(number)))
            time_step.append(now)
            states.extend((float(a["x"]), float(a["y"]), float(a["angle"]), float(a["speed"]), length[a["type"]]))
        elif event == "end":
            root.clear()  # the file is far larger than what is kept of it
    x, y, compass_deg, speed, body = np.array(states).reshape(-1, 5).T
    heading = np.radians(90.0 - compass_deg)
    return Tracks.from_positions(
        track_id=np.array(vehicle, np.int64),
        time_ns=np.array(time_step, np.int64) * (STEP_MS * 1_000_000),
        position=np.column_stack([x - body / 2 * np.cos(heading), y - body / 2 * np.sin(heading)]),
        heading=heading,
        speed=speed,
    )
