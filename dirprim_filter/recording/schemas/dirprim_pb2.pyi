from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Observations(_message.Message):
    __slots__ = ("timestamp", "frame_id", "track_id", "x", "y", "direction", "speed", "group", "covariance_xx", "covariance_xy", "covariance_yy", "length", "width", "height", "heading", "label", "cue_turn", "cue_concentration", "confidence")
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
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
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
    confidence: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame_id: _Optional[str] = ..., track_id: _Optional[_Iterable[str]] = ..., x: _Optional[_Iterable[float]] = ..., y: _Optional[_Iterable[float]] = ..., direction: _Optional[_Iterable[float]] = ..., speed: _Optional[_Iterable[float]] = ..., group: _Optional[_Iterable[int]] = ..., covariance_xx: _Optional[_Iterable[float]] = ..., covariance_xy: _Optional[_Iterable[float]] = ..., covariance_yy: _Optional[_Iterable[float]] = ..., length: _Optional[_Iterable[float]] = ..., width: _Optional[_Iterable[float]] = ..., height: _Optional[_Iterable[float]] = ..., heading: _Optional[_Iterable[float]] = ..., label: _Optional[_Iterable[str]] = ..., cue_turn: _Optional[_Iterable[float]] = ..., cue_concentration: _Optional[_Iterable[float]] = ..., confidence: _Optional[_Iterable[float]] = ...) -> None: ...

class Assignments(_message.Message):
    __slots__ = ("timestamp", "frame_id", "track_id", "x", "y", "group", "assigned")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_ID_FIELD_NUMBER: _ClassVar[int]
    TRACK_ID_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    GROUP_FIELD_NUMBER: _ClassVar[int]
    ASSIGNED_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame_id: str
    track_id: _containers.RepeatedScalarFieldContainer[str]
    x: _containers.RepeatedScalarFieldContainer[float]
    y: _containers.RepeatedScalarFieldContainer[float]
    group: _containers.RepeatedScalarFieldContainer[int]
    assigned: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame_id: _Optional[str] = ..., track_id: _Optional[_Iterable[str]] = ..., x: _Optional[_Iterable[float]] = ..., y: _Optional[_Iterable[float]] = ..., group: _Optional[_Iterable[int]] = ..., assigned: _Optional[_Iterable[str]] = ...) -> None: ...

class TrackEstimates(_message.Message):
    __slots__ = ("timestamp", "frame_id", "track_id", "x", "y", "covariance_xx", "covariance_xy", "covariance_yy", "direction", "direction_resultant", "speed", "speed_std", "effective_sample_size", "log_evidence", "existence", "unseen_s", "follows_map")
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
    FOLLOWS_MAP_FIELD_NUMBER: _ClassVar[int]
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
    follows_map: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[_timestamp_pb2.Timestamp, _Mapping]] = ..., frame_id: _Optional[str] = ..., track_id: _Optional[_Iterable[str]] = ..., x: _Optional[_Iterable[float]] = ..., y: _Optional[_Iterable[float]] = ..., covariance_xx: _Optional[_Iterable[float]] = ..., covariance_xy: _Optional[_Iterable[float]] = ..., covariance_yy: _Optional[_Iterable[float]] = ..., direction: _Optional[_Iterable[float]] = ..., direction_resultant: _Optional[_Iterable[float]] = ..., speed: _Optional[_Iterable[float]] = ..., speed_std: _Optional[_Iterable[float]] = ..., effective_sample_size: _Optional[_Iterable[float]] = ..., log_evidence: _Optional[_Iterable[float]] = ..., existence: _Optional[_Iterable[float]] = ..., unseen_s: _Optional[_Iterable[float]] = ..., follows_map: _Optional[_Iterable[float]] = ...) -> None: ...

class PrimitiveMap(_message.Message):
    __slots__ = ("arrow",)
    ARROW_FIELD_NUMBER: _ClassVar[int]
    arrow: bytes
    def __init__(self, arrow: _Optional[bytes] = ...) -> None: ...
