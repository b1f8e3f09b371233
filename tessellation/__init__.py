"""Where? Divisions of the plane into cells, for any model that lives in cells."""

from tessellation.grid import GridTessellation as GridTessellation
from tessellation.protocols import OUTSIDE as OUTSIDE
from tessellation.protocols import Tessellation as Tessellation
from tessellation.voronoi import VoronoiTessellation as VoronoiTessellation
