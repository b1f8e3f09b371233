"""Where? Divisions of the plane into cells, for any model that lives in cells."""

from tessellation.grid import GridTessellation as GridTessellation
from tessellation.joint import JointFit as JointFit
from tessellation.joint import fit_jointly as fit_jointly
from tessellation.protocols import OUTSIDE as OUTSIDE
from tessellation.protocols import CellModel as CellModel
from tessellation.protocols import Members as Members
from tessellation.protocols import RefittingModel as RefittingModel
from tessellation.protocols import Tessellation as Tessellation
from tessellation.voronoi import VoronoiTessellation as VoronoiTessellation
