"""Objects of any schema, by the paths of their fields: `id=.objects[].id,x=.objects[].pose.position.x,...`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dirprim_filter.recording.decoding.fields import steps_of
from dirprim_filter.recording.schemas.family import GROUPS, NAMES, Family, family

_EITHER = (("time", "time_s"), ("speed", "speed_kmh"), ("direction", "direction_deg"), ("heading", "heading_deg"))


@dataclass(frozen=True, slots=True)
class FieldMapping:
    """Paths of what is to be read, such as `.objects[].pose.position.x`, see `family`.

    Args:
        paths: by the names of `family.NAMES`; or of `family.GROUPS`, as `pose` for position and quaternion.

    Raises:
        ValueError: a path is none, or names that do not go together.
    """

    paths: Mapping[str, str]

    def __post_init__(self) -> None:
        for path in self.paths.values():
            steps_of(f"{path}.x" if path == "" else path)
        names = set(self.family().fields)
        for one, other in _EITHER:
            if one in names and other in names:
                raise ValueError(f"fields: expected one of {one} and {other}, got both")
        for whole in ({"vx", "vy"}, {"qx", "qy", "qz", "qw"}, {"cxx", "cxy", "cyy"}):
            if names & whole not in (set(), whole):
                raise ValueError(f"fields: expected {' and '.join(sorted(whole))} together, got {self}")
        if {"x", "y", "latitude", "longitude"} & names not in ({"x", "y"}, {"latitude", "longitude"}):
            raise ValueError(f"fields: expected x= and y= at least, or latitude= and longitude=, got {self}")

    @classmethod
    def parse(cls, text: str) -> FieldMapping:
        """Of `name=path,name=path,...`.

        Raises:
            ValueError: names the part that is none.
        """
        known = [*NAMES, *GROUPS]
        paths: dict[str, str] = {}
        for part in text.split(","):
            name, _, path = (word.strip() for word in part.partition("="))
            if name not in known or not path or name in paths:
                raise ValueError(f"fields: expected name=path, each of {', '.join(known)} once, got {part!r}")
            paths[name] = path
        return cls(paths)

    def __str__(self) -> str:
        return ",".join(f"{name}={path}" for name, path in self.paths.items())

    def __contains__(self, name: str) -> bool:
        return name in self.family().fields

    def family(self) -> Family:
        """What reads such objects, of whatever schema: objects of their own messages are named after the topic."""
        is_alone = not any(
            "[]" in self.paths[name] for name in ("longitude", "x", "position", "pose") if name in self.paths
        )
        return family(paths=self.paths, required=True, names="topic" if is_alone else "id")
