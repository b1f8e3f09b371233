"""What beliefs are predicted by, as a command's options and its log have it: a map, or what moves without one."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import typer

from dirprim_filter.cli.progress import working
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.sensing import first_minutes
from dirprim_filter.cli.texts import counted
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import load_map


class MotionModel(NamedTuple):
    """A model of motion.

    Attributes:
        primitive_map: of a map, which may have no cell; None for constant velocity.
        acceleration: m^2/s^3, density of white acceleration, of constant velocity.
    """

    primitive_map: PrimitiveMap | None
    acceleration: float = 0.0

    def model(self, config: FilterConfig) -> PrimitiveMap | BayesFilter:
        """As a tracker takes it: a filter of its own for each."""
        if self.primitive_map is not None:
            return self.primitive_map
        return ConstantVelocityKalman(acceleration_density=self.acceleration, config=config)


def map_of(map_file: Path | None, reading: Reading) -> tuple[PrimitiveMap | None, Reading]:
    """The map, if a file was given; and the reading of logs that meet it."""
    if map_file is None:
        return None, reading
    loaded = load_map(map_file)
    return loaded, reading.on_plane_of(map_file, loaded.origin)


def motion_of(
    choice: Literal["learned", "constant-velocity"], by_map: PrimitiveMap | None, frames: Iterable[Detections], *,
    config: FilterConfig, acceleration: float = 0.0, fitted: float = 0.0, why_not: str = "", is_forecast: bool = False,
    seed: int,
) -> tuple[MotionModel, Iterable[Detections]]:  # fmt: skip
    """The model, which a line states unless it is the given map; and all the frames.

    Without a map it is the background motion of the log's first minutes; constant velocity is fitted to them. Where
    nothing can be learned from them vehicles go straight on.

    Args:
        choice: as given.
        by_map: a map that was given.
        frames: of the log, which is read once: those that are learned from are kept.
        config: the noise of the detections.
        acceleration: density that was stated; 0: none was.
        fitted: density that fits detections without ids; 0: there is none.
        why_not: why nothing can be learned from the frames; empty where it may.
        is_forecast: the model is to forecast too, which needs a map, with or without cells.
        seed: of learning.

    Raises:
        ValueError: it is to forecast, and nothing could be learned.
    """
    if choice == "learned" and by_map is not None:
        return MotionModel(by_map), frames

    from dirprim_filter.evaluation.without_map import acceleration_of, background_motion

    first, coming, rng = list[Detections](), iter(frames), np.random.default_rng(seed)
    found, how = MotionModel(None, acceleration or fitted or 1.0), f"not learned: {why_not}"  # 1.0: cars in towns
    if acceleration or fitted:
        how = "as stated" if acceleration else "fitted to tracks of the log's first minutes, without ids"
    elif not why_not:
        with working("learning how vehicles move"):
            first = first_minutes(coming, n_most=10_000)
            seen = Detections.concatenate(first)
            n_rows = np.unique(seen.in_one_group().track_id[seen.track_id != NO_ID], return_counts=True)[1]
            of = f"{counted(int((n_rows > 1).sum()), 'vehicle')} of the log's first minutes"
            try:
                if choice == "learned":
                    found, how = MotionModel(background_motion(seen, rng=rng)), f"as {of} move anywhere"
                else:
                    found, how = MotionModel(None, acceleration_of(seen, config, rng=rng)), f"fitted to {of}"
            except ValueError as error:
                how = f"not learned: {error}"
    if is_forecast and found.primitive_map is None:
        raise ValueError(f"--forecast needs --map, or a log from which motion can be learned; here it is {how}")
    straight = f"straight on, but for white acceleration of {found.acceleration:.3g} m2/s3, "
    typer.echo(f"motion: {'' if found.primitive_map else straight}{how}")
    return found, chain(first, coming)
