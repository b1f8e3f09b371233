"""How a map was fitted, as a `dirprim.Refit` message.

Source: dirprim.proto.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any, cast

import numpy as np
from google.protobuf.message import DecodeError

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.recipe import ModesRule, Recipe, Usual
from dirprim_filter.primitives.refit import N_SPREADS, Counted, Refit
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import floats_of, ints_of

SIGNED = 1 << 63
"""Digests travel as unsigned numbers."""
MOST_MODES = 256
"""Of a cell: a file that says more is not believed, for memory is taken by it."""


def encode_refit(refit: Refit | None) -> dirprim_pb2.Refit | None:
    """The message; None of None."""
    if refit is None:
        return None
    recipe = refit.recipe
    return dirprim_pb2.Refit(
        modes=recipe.modes, curved=recipe.curved, prior_strength=recipe.prior_strength,
        parameter_cost=recipe.parameter_cost, usual_resultant=recipe.usual.resultant,
        usual_speed_spread=recipe.usual.speed_spread, config=json.dumps(asdict(recipe.config), sort_keys=True),
        softness=refit.softness, place_free=refit.place_free, borrowed=refit.borrowed,
        lenders=[dirprim_pb2.Generators(x=x.tolist(), y=y.tolist()) for x, y in (g.T for g in refit.lenders)],
        counted=None if refit.counted is None else _encode_counted(refit.counted),
    )  # fmt: skip


def _encode_counted(counted: Counted) -> dirprim_pb2.Counted:
    east, north = counted.tile.T.tolist()
    return dirprim_pb2.Counted(
        by=counted.by, min_vehicles=counted.min_vehicles, most_rows=counted.most_rows,
        usual_square=counted.usual_square.tolist(), east=east, north=north,
        digest=[number + SIGNED for number in counted.digest.tolist()], half_life=counted.half_life_s,
        now=counted.now_ns, slot_strength=counted.slot_strength.tolist(), slot_share=counted.slot_share.tolist(),
    )  # fmt: skip


def decode_refit(message: dirprim_pb2.Refit) -> Refit:
    """What the message says.

    Raises:
        DecodeError: columns of a wrong length, or knobs of another version.
        ValueError: numbers that are out of range.
    """
    if message.modes not in ("bic", "dbscan"):
        raise DecodeError(f"Refit.modes: expected bic or dbscan, got {message.modes!r}")
    recipe = Recipe(
        cast(ModesRule, message.modes), message.curved, message.prior_strength,
        Usual(message.usual_resultant, message.usual_speed_spread), _config_of(message.config), message.parameter_cost,
    )  # fmt: skip
    lenders = [np.column_stack([floats_of(g, axis, len(g.x)) for axis in ("x", "y")]) for g in message.lenders]
    return Refit(
        recipe=recipe, softness=message.softness, place_free=message.place_free, borrowed=message.borrowed,
        lenders=tuple(lenders), counted=_decode_counted(message.counted) if message.HasField("counted") else None,
    )  # fmt: skip


def _config_of(text: str) -> LearningConfig:
    try:
        knobs: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in json.loads(text).items()
        }
        config = LearningConfig(**knobs)
    except (ValueError, TypeError, AttributeError) as error:
        raise DecodeError(f"Refit.config: expected the knobs of learning, got {error}") from error
    if config.max_modes not in range(1, MOST_MODES + 1):
        raise DecodeError(f"Refit.config: expected max_modes from 1 to {MOST_MODES}, got {config.max_modes}")
    return config


def _decode_counted(message: dirprim_pb2.Counted) -> Counted:
    n = len(message.digest)
    return Counted(
        by=message.by, min_vehicles=message.min_vehicles, most_rows=message.most_rows,
        usual_square=floats_of(message, "usual_square", N_SPREADS),
        tile=np.column_stack([ints_of(message, axis, n) for axis in ("east", "north")]),
        digest=np.array([number - SIGNED for number in message.digest], np.int64), half_life_s=message.half_life,
        now_ns=message.now, slot_strength=np.array(message.slot_strength), slot_share=np.array(message.slot_share),
    )  # fmt: skip
