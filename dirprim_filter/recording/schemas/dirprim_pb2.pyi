from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Observations(_message.Message):
    __slots__ = ("timestamp", "frame_id", "track_id", "x", "y", "direction", "speed", "group", "covariance_xx", "covariance_xy", "covariance_yy", "length", "width", "height", "heading", "label", "cue_turn", "cue_concentration")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    TRACK_ID_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    GROUP_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_XX_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_XY_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_YY_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    HEADING_FIELD_NUMBER: _ClassVar[int]
    LABEL_FIELD_NUMBER: _ClassVar[int]
    CUE_TURN_FIELD_NUMBER: _ClassVar[int]
    CUE_CONCENTRATION_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame_id: str
    track_id: _containers.RepeatedScalarFieldContainer[str]
    x: _containers.RepeatedScalarFieldContainer[float]
    y: _containers.RepeatedScalarFieldContainer[float]
    direction: _containers.RepeatedScalarFieldContainer[float]
    speed: _containers.RepeatedScalarFieldContainer[float]
    group: _containers.RepeatedScalarFieldContainer[int]
    covariance_xx: _containers.RepeatedScalarFieldContainer[float]
    covariance_xy: _containers.RepeatedScalarFieldContainer[float]
    covariance_yy: _containers.RepeatedScalarFieldContainer[float]
    length: _containers.RepeatedScalarFieldContainer[float]
    width: _containers.RepeatedScalarFieldContainer[float]
    height: _containers.RepeatedScalarFieldContainer[float]
    heading: _containers.RepeatedScalarFieldContainer[float]
    label: _containers.RepeatedScalarFieldContainer[str]
    cue_turn: _containers.RepeatedScalarFieldContainer[float]
    cue_concentration: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame_id: _Optional[str] = ..., track_id: _Optional[_Iterable[str]] = ..., x: _Optional[_Iterable[float]] = ..., y: _Optional[_Iterable[float]] = ..., direction: _Optional[_Iterable[float]] = ..., speed: _Optional[_Iterable[float]] = ..., group: _Optional[_Iterable[int]] = ..., covariance_xx: _Optional[_Iterable[float]] = ..., covariance_xy: _Optional[_Iterable[float]] = ..., covariance_yy: _Optional[_Iterable[float]] = ..., length: _Optional[_Iterable[float]] = ..., width: _Optional[_Iterable[float]] = ..., height: _Optional[_Iterable[float]] = ..., heading: _Optional[_Iterable[float]] = ..., label: _Optional[_Iterable[str]] = ..., cue_turn: _Optional[_Iterable[float]] = ..., cue_concentration: _Optional[_Iterable[float]] = ...) -> None: ...

class TrackEstimates(_message.Message):
    __slots__ = ("timestamp", "frame_id", "track_id", "x", "y", "covariance_xx", "covariance_xy", "covariance_yy", "direction", "direction_resultant", "speed", "speed_std", "effective_sample_size", "log_evidence", "existence", "unseen_s")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    TRACK_ID_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_XX_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_XY_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_YY_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_RESULTANT_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    SPEED_STD_FIELD_NUMBER: _ClassVar[int]
    EFFECTIVE_SAMPLE_SIZE_FIELD_NUMBER: _ClassVar[int]
    LOG_EVIDENCE_FIELD_NUMBER: _ClassVar[int]
    EXISTENCE_FIELD_NUMBER: _ClassVar[int]
    UNSEEN_S_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame_id: str
    track_id: _containers.RepeatedScalarFieldContainer[str]
    x: _containers.RepeatedScalarFieldContainer[float]
    y: _containers.RepeatedScalarFieldContainer[float]
    covariance_xx: _containers.RepeatedScalarFieldContainer[float]
    covariance_xy: _containers.RepeatedScalarFieldContainer[float]
    covariance_yy: _containers.RepeatedScalarFieldContainer[float]
    direction: _containers.RepeatedScalarFieldContainer[float]
    direction_resultant: _containers.RepeatedScalarFieldContainer[float]
    speed: _containers.RepeatedScalarFieldContainer[float]
    speed_std: _containers.RepeatedScalarFieldContainer[float]
    effective_sample_size: _containers.RepeatedScalarFieldContainer[float]
    log_evidence: _containers.RepeatedScalarFieldContainer[float]
    existence: _containers.RepeatedScalarFieldContainer[float]
    unseen_s: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame_id: _Optional[str] = ..., track_id: _Optional[_Iterable[str]] = ..., x: _Optional[_Iterable[float]] = ..., y: _Optional[_Iterable[float]] = ..., covariance_xx: _Optional[_Iterable[float]] = ..., covariance_xy: _Optional[_Iterable[float]] = ..., covariance_yy: _Optional[_Iterable[float]] = ..., direction: _Optional[_Iterable[float]] = ..., direction_resultant: _Optional[_Iterable[float]] = ..., speed: _Optional[_Iterable[float]] = ..., speed_std: _Optional[_Iterable[float]] = ..., effective_sample_size: _Optional[_Iterable[float]] = ..., log_evidence: _Optional[_Iterable[float]] = ..., existence: _Optional[_Iterable[float]] = ..., unseen_s: _Optional[_Iterable[float]] = ...) -> None: ...

class Grid(_message.Message):
    __slots__ = ("origin_x", "origin_y", "cell_size", "n_x", "n_y", "square")
    ORIGIN_X_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_Y_FIELD_NUMBER: _ClassVar[int]
    CELL_SIZE_FIELD_NUMBER: _ClassVar[int]
    N_X_FIELD_NUMBER: _ClassVar[int]
    N_Y_FIELD_NUMBER: _ClassVar[int]
    SQUARE_FIELD_NUMBER: _ClassVar[int]
    origin_x: float
    origin_y: float
    cell_size: float
    n_x: int
    n_y: int
    square: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, origin_x: _Optional[float] = ..., origin_y: _Optional[float] = ..., cell_size: _Optional[float] = ..., n_x: _Optional[int] = ..., n_y: _Optional[int] = ..., square: _Optional[_Iterable[int]] = ...) -> None: ...

class Voronoi(_message.Message):
    __slots__ = ("x", "y", "region", "beside", "beside_x", "beside_y")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    BESIDE_FIELD_NUMBER: _ClassVar[int]
    BESIDE_X_FIELD_NUMBER: _ClassVar[int]
    BESIDE_Y_FIELD_NUMBER: _ClassVar[int]
    x: _containers.RepeatedScalarFieldContainer[float]
    y: _containers.RepeatedScalarFieldContainer[float]
    region: Grid
    beside: _containers.RepeatedScalarFieldContainer[int]
    beside_x: _containers.RepeatedScalarFieldContainer[float]
    beside_y: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, x: _Optional[_Iterable[float]] = ..., y: _Optional[_Iterable[float]] = ..., region: _Optional[_Union[Grid, _Mapping]] = ..., beside: _Optional[_Iterable[int]] = ..., beside_x: _Optional[_Iterable[float]] = ..., beside_y: _Optional[_Iterable[float]] = ...) -> None: ...

class Primitives(_message.Message):
    __slots__ = ("weight", "mean_direction", "concentration", "shape", "rate", "bend_east", "bend_north", "gain_east", "gain_north", "n_rows")
    WEIGHT_FIELD_NUMBER: _ClassVar[int]
    MEAN_DIRECTION_FIELD_NUMBER: _ClassVar[int]
    CONCENTRATION_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    BEND_EAST_FIELD_NUMBER: _ClassVar[int]
    BEND_NORTH_FIELD_NUMBER: _ClassVar[int]
    GAIN_EAST_FIELD_NUMBER: _ClassVar[int]
    GAIN_NORTH_FIELD_NUMBER: _ClassVar[int]
    N_ROWS_FIELD_NUMBER: _ClassVar[int]
    weight: _containers.RepeatedScalarFieldContainer[float]
    mean_direction: _containers.RepeatedScalarFieldContainer[float]
    concentration: _containers.RepeatedScalarFieldContainer[float]
    shape: _containers.RepeatedScalarFieldContainer[float]
    rate: _containers.RepeatedScalarFieldContainer[float]
    bend_east: _containers.RepeatedScalarFieldContainer[float]
    bend_north: _containers.RepeatedScalarFieldContainer[float]
    gain_east: _containers.RepeatedScalarFieldContainer[float]
    gain_north: _containers.RepeatedScalarFieldContainer[float]
    n_rows: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, weight: _Optional[_Iterable[float]] = ..., mean_direction: _Optional[_Iterable[float]] = ..., concentration: _Optional[_Iterable[float]] = ..., shape: _Optional[_Iterable[float]] = ..., rate: _Optional[_Iterable[float]] = ..., bend_east: _Optional[_Iterable[float]] = ..., bend_north: _Optional[_Iterable[float]] = ..., gain_east: _Optional[_Iterable[float]] = ..., gain_north: _Optional[_Iterable[float]] = ..., n_rows: _Optional[_Iterable[int]] = ...) -> None: ...

class Leader(_message.Message):
    __slots__ = ("gain", "push", "trust", "start_rate")
    GAIN_FIELD_NUMBER: _ClassVar[int]
    PUSH_FIELD_NUMBER: _ClassVar[int]
    TRUST_FIELD_NUMBER: _ClassVar[int]
    START_RATE_FIELD_NUMBER: _ClassVar[int]
    gain: _containers.RepeatedScalarFieldContainer[float]
    push: float
    trust: float
    start_rate: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, gain: _Optional[_Iterable[float]] = ..., push: _Optional[float] = ..., trust: _Optional[float] = ..., start_rate: _Optional[_Iterable[float]] = ...) -> None: ...

class Motion(_message.Message):
    __slots__ = ("number", "cell", "mode", "visits", "seconds", "course", "bend_east", "bend_north", "course_spread", "log_pace", "gain_east", "gain_north", "log_pace_spread", "path_offset", "path_slope", "path_curvature", "path_spread", "path_direction", "acceleration", "acceleration_east", "acceleration_north", "acceleration_speed", "push", "stretch", "start_rate", "turn_ahead", "curvature", "first", "following", "count", "arrived", "course_rate", "strength", "leader", "spread")
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    CELL_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    VISITS_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    COURSE_FIELD_NUMBER: _ClassVar[int]
    BEND_EAST_FIELD_NUMBER: _ClassVar[int]
    BEND_NORTH_FIELD_NUMBER: _ClassVar[int]
    COURSE_SPREAD_FIELD_NUMBER: _ClassVar[int]
    LOG_PACE_FIELD_NUMBER: _ClassVar[int]
    GAIN_EAST_FIELD_NUMBER: _ClassVar[int]
    GAIN_NORTH_FIELD_NUMBER: _ClassVar[int]
    LOG_PACE_SPREAD_FIELD_NUMBER: _ClassVar[int]
    PATH_OFFSET_FIELD_NUMBER: _ClassVar[int]
    PATH_SLOPE_FIELD_NUMBER: _ClassVar[int]
    PATH_CURVATURE_FIELD_NUMBER: _ClassVar[int]
    PATH_SPREAD_FIELD_NUMBER: _ClassVar[int]
    PATH_DIRECTION_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_EAST_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_NORTH_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_SPEED_FIELD_NUMBER: _ClassVar[int]
    PUSH_FIELD_NUMBER: _ClassVar[int]
    STRETCH_FIELD_NUMBER: _ClassVar[int]
    START_RATE_FIELD_NUMBER: _ClassVar[int]
    TURN_AHEAD_FIELD_NUMBER: _ClassVar[int]
    CURVATURE_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    FOLLOWING_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    ARRIVED_FIELD_NUMBER: _ClassVar[int]
    COURSE_RATE_FIELD_NUMBER: _ClassVar[int]
    STRENGTH_FIELD_NUMBER: _ClassVar[int]
    LEADER_FIELD_NUMBER: _ClassVar[int]
    SPREAD_FIELD_NUMBER: _ClassVar[int]
    number: _containers.RepeatedScalarFieldContainer[int]
    cell: _containers.RepeatedScalarFieldContainer[int]
    mode: _containers.RepeatedScalarFieldContainer[int]
    visits: _containers.RepeatedScalarFieldContainer[float]
    seconds: _containers.RepeatedScalarFieldContainer[float]
    course: _containers.RepeatedScalarFieldContainer[float]
    bend_east: _containers.RepeatedScalarFieldContainer[float]
    bend_north: _containers.RepeatedScalarFieldContainer[float]
    course_spread: _containers.RepeatedScalarFieldContainer[float]
    log_pace: _containers.RepeatedScalarFieldContainer[float]
    gain_east: _containers.RepeatedScalarFieldContainer[float]
    gain_north: _containers.RepeatedScalarFieldContainer[float]
    log_pace_spread: _containers.RepeatedScalarFieldContainer[float]
    path_offset: _containers.RepeatedScalarFieldContainer[float]
    path_slope: _containers.RepeatedScalarFieldContainer[float]
    path_curvature: _containers.RepeatedScalarFieldContainer[float]
    path_spread: _containers.RepeatedScalarFieldContainer[float]
    path_direction: _containers.RepeatedScalarFieldContainer[float]
    acceleration: _containers.RepeatedScalarFieldContainer[float]
    acceleration_east: _containers.RepeatedScalarFieldContainer[float]
    acceleration_north: _containers.RepeatedScalarFieldContainer[float]
    acceleration_speed: _containers.RepeatedScalarFieldContainer[float]
    push: _containers.RepeatedScalarFieldContainer[float]
    stretch: _containers.RepeatedScalarFieldContainer[float]
    start_rate: _containers.RepeatedScalarFieldContainer[float]
    turn_ahead: _containers.RepeatedScalarFieldContainer[float]
    curvature: _containers.RepeatedScalarFieldContainer[float]
    first: _containers.RepeatedScalarFieldContainer[int]
    following: _containers.RepeatedScalarFieldContainer[int]
    count: _containers.RepeatedScalarFieldContainer[float]
    arrived: _containers.RepeatedScalarFieldContainer[float]
    course_rate: float
    strength: float
    leader: Leader
    spread: float
    def __init__(self, number: _Optional[_Iterable[int]] = ..., cell: _Optional[_Iterable[int]] = ..., mode: _Optional[_Iterable[int]] = ..., visits: _Optional[_Iterable[float]] = ..., seconds: _Optional[_Iterable[float]] = ..., course: _Optional[_Iterable[float]] = ..., bend_east: _Optional[_Iterable[float]] = ..., bend_north: _Optional[_Iterable[float]] = ..., course_spread: _Optional[_Iterable[float]] = ..., log_pace: _Optional[_Iterable[float]] = ..., gain_east: _Optional[_Iterable[float]] = ..., gain_north: _Optional[_Iterable[float]] = ..., log_pace_spread: _Optional[_Iterable[float]] = ..., path_offset: _Optional[_Iterable[float]] = ..., path_slope: _Optional[_Iterable[float]] = ..., path_curvature: _Optional[_Iterable[float]] = ..., path_spread: _Optional[_Iterable[float]] = ..., path_direction: _Optional[_Iterable[float]] = ..., acceleration: _Optional[_Iterable[float]] = ..., acceleration_east: _Optional[_Iterable[float]] = ..., acceleration_north: _Optional[_Iterable[float]] = ..., acceleration_speed: _Optional[_Iterable[float]] = ..., push: _Optional[_Iterable[float]] = ..., stretch: _Optional[_Iterable[float]] = ..., start_rate: _Optional[_Iterable[float]] = ..., turn_ahead: _Optional[_Iterable[float]] = ..., curvature: _Optional[_Iterable[float]] = ..., first: _Optional[_Iterable[int]] = ..., following: _Optional[_Iterable[int]] = ..., count: _Optional[_Iterable[float]] = ..., arrived: _Optional[_Iterable[float]] = ..., course_rate: _Optional[float] = ..., strength: _Optional[float] = ..., leader: _Optional[_Union[Leader, _Mapping]] = ..., spread: _Optional[float] = ...) -> None: ...

class Box(_message.Message):
    __slots__ = ("west", "south", "east", "north")
    WEST_FIELD_NUMBER: _ClassVar[int]
    SOUTH_FIELD_NUMBER: _ClassVar[int]
    EAST_FIELD_NUMBER: _ClassVar[int]
    NORTH_FIELD_NUMBER: _ClassVar[int]
    west: float
    south: float
    east: float
    north: float
    def __init__(self, west: _Optional[float] = ..., south: _Optional[float] = ..., east: _Optional[float] = ..., north: _Optional[float] = ...) -> None: ...

class PrimitiveMap(_message.Message):
    __slots__ = ("tile", "n_tiles", "n_modes", "n_place_free_modes", "grid", "voronoi", "cell", "area", "box", "cells", "place_free", "version", "motion", "place_free_motion")
    TILE_FIELD_NUMBER: _ClassVar[int]
    N_TILES_FIELD_NUMBER: _ClassVar[int]
    N_MODES_FIELD_NUMBER: _ClassVar[int]
    N_PLACE_FREE_MODES_FIELD_NUMBER: _ClassVar[int]
    GRID_FIELD_NUMBER: _ClassVar[int]
    VORONOI_FIELD_NUMBER: _ClassVar[int]
    CELL_FIELD_NUMBER: _ClassVar[int]
    AREA_FIELD_NUMBER: _ClassVar[int]
    BOX_FIELD_NUMBER: _ClassVar[int]
    CELLS_FIELD_NUMBER: _ClassVar[int]
    PLACE_FREE_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    PLACE_FREE_MOTION_FIELD_NUMBER: _ClassVar[int]
    tile: int
    n_tiles: int
    n_modes: int
    n_place_free_modes: int
    grid: Grid
    voronoi: Voronoi
    cell: _containers.RepeatedScalarFieldContainer[int]
    area: _containers.RepeatedScalarFieldContainer[float]
    box: Box
    cells: Primitives
    place_free: Primitives
    version: int
    motion: Motion
    place_free_motion: Motion
    def __init__(self, tile: _Optional[int] = ..., n_tiles: _Optional[int] = ..., n_modes: _Optional[int] = ..., n_place_free_modes: _Optional[int] = ..., grid: _Optional[_Union[Grid, _Mapping]] = ..., voronoi: _Optional[_Union[Voronoi, _Mapping]] = ..., cell: _Optional[_Iterable[int]] = ..., area: _Optional[_Iterable[float]] = ..., box: _Optional[_Union[Box, _Mapping]] = ..., cells: _Optional[_Union[Primitives, _Mapping]] = ..., place_free: _Optional[_Union[Primitives, _Mapping]] = ..., version: _Optional[int] = ..., motion: _Optional[_Union[Motion, _Mapping]] = ..., place_free_motion: _Optional[_Union[Motion, _Mapping]] = ...) -> None: ...

class MapSummary(_message.Message):
    __slots__ = ("version", "shared", "tiles", "n_cells", "n_manoeuvres", "traffic")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    SHARED_FIELD_NUMBER: _ClassVar[int]
    TILES_FIELD_NUMBER: _ClassVar[int]
    N_CELLS_FIELD_NUMBER: _ClassVar[int]
    N_MANOEUVRES_FIELD_NUMBER: _ClassVar[int]
    TRAFFIC_FIELD_NUMBER: _ClassVar[int]
    version: int
    shared: PrimitiveMap
    tiles: _containers.RepeatedCompositeFieldContainer[TileSummary]
    n_cells: int
    n_manoeuvres: int
    traffic: Traffic
    def __init__(self, version: _Optional[int] = ..., shared: _Optional[_Union[PrimitiveMap, _Mapping]] = ..., tiles: _Optional[_Iterable[_Union[TileSummary, _Mapping]]] = ..., n_cells: _Optional[int] = ..., n_manoeuvres: _Optional[int] = ..., traffic: _Optional[_Union[Traffic, _Mapping]] = ...) -> None: ...

class TileSummary(_message.Message):
    __slots__ = ("box",)
    BOX_FIELD_NUMBER: _ClassVar[int]
    box: Box
    def __init__(self, box: _Optional[_Union[Box, _Mapping]] = ...) -> None: ...

class Traffic(_message.Message):
    __slots__ = ("area", "seconds", "begun", "end_rate")
    AREA_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    BEGUN_FIELD_NUMBER: _ClassVar[int]
    END_RATE_FIELD_NUMBER: _ClassVar[int]
    area: float
    seconds: float
    begun: float
    end_rate: float
    def __init__(self, area: _Optional[float] = ..., seconds: _Optional[float] = ..., begun: _Optional[float] = ..., end_rate: _Optional[float] = ...) -> None: ...
