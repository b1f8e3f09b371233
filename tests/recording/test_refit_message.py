"""How a map was fitted, in its file: it comes back, and what makes no sense is refused before memory is taken."""

import numpy as np
import pytest
from google.protobuf.message import DecodeError

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.recipe import Recipe, Usual
from dirprim_filter.primitives.refit import Counted, Refit
from dirprim_filter.recording.schemas.dirprim_pb2 import Generators
from dirprim_filter.recording.schemas.refit_message import decode_refit, encode_refit

COUNTED = Counted(
    by="configuration 0 in frame 'map'", min_vehicles=5, most_rows=1 << 40, usual_square=np.arange(4.0),
    tile=np.array([[-3, 2], [1, -(1 << 20)]]), digest=np.array([-(1 << 63), (1 << 63) - 1]),
    half_life_s=86400.0, now_ns=(1 << 63) - 1, slot_strength=np.array([np.inf, 3.0]), slot_share=np.full(24, 1 / 24),
)  # fmt: skip
REFIT = Refit(
    recipe=Recipe("bic", True, 0.4, Usual(0.9, 0.1), LearningConfig(max_modes=3), 0.5), softness=0.25, place_free=0.1,
    borrowed=0.4, lenders=(np.array([[1.0, 2.0], [3.0, -4.0]]), np.zeros((0, 2))), counted=COUNTED,
)  # fmt: skip


def test_it_comes_back():
    again = decode_refit(encode_refit(REFIT))
    assert (again.recipe, again.softness, again.place_free, again.borrowed) == (REFIT.recipe, 0.25, 0.1, 0.4)
    assert all(np.array_equal(one, other) for one, other in zip(again.lenders, REFIT.lenders, strict=True))
    assert again.counted == COUNTED
    assert encode_refit(None) is None


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        ({"modes": "many"}, "expected bic or dbscan, got 'many'"),
        ({"config": "[]"}, "expected the knobs of learning"),
        ({"config": '{"max_modes": 1000000000}'}, "max_modes from 1 to 256, got 1000000000"),
        ({"config": '{"unknown": 1}'}, "expected the knobs of learning"),
        ({"prior_strength": float("nan")}, "expected positive numbers"),
        ({"borrowed": 2.0}, "expected numbers that are not negative"),
        ({"lenders": [Generators(x=[1.0])]}, "expected 1 numbers, got 0"),
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused(damage, said):
    message = encode_refit(REFIT)
    for name, value in damage.items():
        if isinstance(value, list):
            getattr(message, name).extend(value)
        else:
            setattr(message, name, value)
    with pytest.raises((DecodeError, ValueError), match=said):
        decode_refit(message)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("half_life", float("nan"), "half_life_s: expected seconds"),
        ("slot_strength", [1.0], r"expected 2 numbers and \[24, 168\], got 1 and 24"),
        ("slot_share", [0.5] * 25, r"expected 2 numbers and \[24, 168\], got 2 and 25"),
        ("slot_strength", [0.0, 1.0], "expected numbers above 0"),
        ("slot_share", [-1.0] * 24, "expected numbers above 0"),
    ],
)
def test_of_choices_too(name, value, said):
    message = encode_refit(REFIT)
    if isinstance(value, list):
        message.counted.ClearField(name)
        getattr(message.counted, name).extend(value)
    else:
        setattr(message.counted, name, value)
    with pytest.raises(ValueError, match=said):
        decode_refit(message)
