"""Drivers and their vehicles: the spread in speed, in temper and in place across the lane.

Attributes are SUMO's: https://sumo.dlr.de/docs/Definition_of_Vehicles,_Vehicle_Types,_and_Routes.html and,
for the place across the lane, https://sumo.dlr.de/docs/Simulation/SublaneModel.html.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """A kind of driver in a kind of vehicle.

    Attributes:
        share: part of all traffic; the shares sum to one.
        length: of the vehicle, m.
        width: of the vehicle, m.
        accel: highest acceleration, m/s^2.
        decel: comfortable braking, m/s^2.
        imperfection: SUMO's sigma in [0, 1], how unevenly the driver follows.
        headway_s: the gap the driver wants, s.
        speed_factor: mean of the wanted speed over the limit.
        speed_factor_deviation: its standard deviation; cut off at three of them.
    """

    name: str
    share: float
    length: float = 4.6
    width: float = 1.8
    accel: float
    decel: float
    imperfection: float
    headway_s: float
    speed_factor: float
    speed_factor_deviation: float


DRIVERS = (
    Driver(
        name="calm", share=0.25, accel=1.7, decel=3.5,
        imperfection=0.3, headway_s=1.5, speed_factor=0.88, speed_factor_deviation=0.07,
    ),
    Driver(
        name="typical", share=0.45, accel=2.3, decel=4.0,
        imperfection=0.5, headway_s=1.2, speed_factor=1.0, speed_factor_deviation=0.08,
    ),
    Driver(
        name="brisk", share=0.18, accel=3.0, decel=4.5,
        imperfection=0.4, headway_s=1.0, speed_factor=1.12, speed_factor_deviation=0.08,
    ),
    Driver(
        name="van", share=0.08, length=6.2, width=2.1, accel=1.9, decel=4.0,
        imperfection=0.5, headway_s=1.3, speed_factor=0.97, speed_factor_deviation=0.07,
    ),
    Driver(
        name="truck", share=0.04, length=9.0, width=2.4, accel=1.2, decel=3.5,
        imperfection=0.4, headway_s=1.6, speed_factor=0.85, speed_factor_deviation=0.05,
    ),
)  # fmt: skip

OFFSETS_M = {-0.5: 0.12, -0.25: 0.24, 0.0: 0.28, 0.25: 0.24, 0.5: 0.12}
"""Where drivers like to drive, metres to the side of the lane's middle, and the share that does."""
WANDER = 0.1
"""SUMO's `lcSigma`: how much a driver strays from there."""


def vehicle_types() -> ET.Element:
    """SUMO's `vTypeDistribution` named `drivers`, of which every flow draws its vehicles."""
    distribution = ET.Element("vTypeDistribution", id="drivers")
    for driver in DRIVERS:
        mean, deviation = driver.speed_factor, driver.speed_factor_deviation
        slowest, fastest = mean - 3 * deviation, mean + 3 * deviation
        for offset, share in OFFSETS_M.items():
            attributes = {
                "id": _type_name(driver, offset),
                "probability": f"{driver.share * share:.4f}",
                "length": str(driver.length),
                "width": str(driver.width),
                "accel": str(driver.accel),
                "decel": str(driver.decel),
                "sigma": str(driver.imperfection),
                "tau": str(driver.headway_s),
                "speedFactor": f"normc({mean:.3f},{deviation:.3f},{slowest:.3f},{fastest:.3f})",
                "latAlignment": str(offset),
                "lcSigma": str(WANDER),
            }
            ET.SubElement(distribution, "vType", attributes)
    return distribution


def vehicle_lengths() -> dict[str, float]:
    """The length in metres of each of the vehicle types."""
    return {_type_name(driver, offset): driver.length for driver in DRIVERS for offset in OFFSETS_M}


def _type_name(driver: Driver, offset: float) -> str:
    return f"{driver.name}{offset:+.2f}"
