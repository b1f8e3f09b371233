"""Scenes and demand as the XML files that SUMO reads.

Formats: https://sumo.dlr.de/docs/Networks/PlainXML.html (`.nod.xml`, `.edg.xml`, `.con.xml`), and for the
demand (`.rou.xml`) https://sumo.dlr.de/docs/Definition_of_Vehicles,_Vehicle_Types,_and_Routes.html.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from dirprim_filter.simulation.drivers import vehicle_types
from dirprim_filter.simulation.scenes import Scene


def write_plain_xml(scene: Scene, folder: Path) -> None:
    """Write `scene.nod.xml`, `scene.edg.xml`, `scene.con.xml` and `scene.rou.xml` into a folder.

    Raises:
        OSError: a file cannot be written.
    """
    roots = {"nod": _nodes(scene), "edg": _edges(scene), "con": _connections(scene), "rou": _routes(scene)}
    for kind, root in roots.items():
        ET.ElementTree(root).write(folder / f"scene.{kind}.xml", encoding="utf-8", xml_declaration=True)


def _nodes(scene: Scene) -> ET.Element:
    root = ET.Element("nodes")
    for node in scene.nodes:
        x, y = node.at
        ET.SubElement(root, "node", id=node.name, x=f"{x:.3f}", y=f"{y:.3f}", type=node.kind)
    return root


def _edges(scene: Scene) -> ET.Element:
    root = ET.Element("edges")
    for edge in scene.edges:
        attributes = {
            "id": edge.name,
            "from": edge.start,
            "to": edge.end,
            "numLanes": str(edge.n_lanes),
            "speed": f"{edge.speed:.3f}",
            "width": f"{edge.lane_width:.3f}",
            "spreadType": edge.spread,
            "priority": str(edge.priority),
        }
        if edge.shape:
            attributes["shape"] = " ".join(f"{x:.3f},{y:.3f}" for x, y in edge.shape)
        ET.SubElement(root, "edge", attributes)
    return root


def _connections(scene: Scene) -> ET.Element:
    root = ET.Element("connections")
    for link in scene.connections:
        attributes = {
            "from": link.origin,
            "to": link.destination,
            "fromLane": str(link.origin_lane),
            "toLane": str(link.destination_lane),
        }
        ET.SubElement(root, "connection", attributes)
    return root


def _routes(scene: Scene) -> ET.Element:
    root = ET.Element("routes")
    root.append(vehicle_types())
    for flow in scene.flows:
        attributes = {
            "id": f"{flow.origin}-{flow.destination}",
            "type": "drivers",
            "from": flow.origin,
            "to": flow.destination,
            "begin": "0",
            "period": f"exp({flow.vehicles_per_hour / 3600:.6f})",  # a Poisson process
            "departLane": "best",
            "departSpeed": "max",
            "departPosLat": "random",
        }
        ET.SubElement(root, "flow", attributes)
    return root
