"""Where? Divisions of the plane into cells, for any model that lives in cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from tessellation.grid import GridTessellation as GridTessellation
    from tessellation.joint import JointFit as JointFit
    from tessellation.joint import fit_jointly as fit_jointly
    from tessellation.protocols import OUTSIDE as OUTSIDE
    from tessellation.protocols import CellModel as CellModel
    from tessellation.protocols import Members as Members
    from tessellation.protocols import Tessellation as Tessellation
    from tessellation.voronoi import VoronoiTessellation as VoronoiTessellation

_HOME = {
    "GridTessellation": "grid",
    "JointFit": "joint",
    "fit_jointly": "joint",
    "OUTSIDE": "protocols",
    "CellModel": "protocols",
    "Members": "protocols",
    "Tessellation": "protocols",
    "VoronoiTessellation": "voronoi",
}
"""The module of each name, imported when it is first used: array types cost no compiler."""

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
