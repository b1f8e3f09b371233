"""Knobs that make no sense are refused by name."""

from dataclasses import fields

import numpy as np
import pytest

from dirprim_filter.config import FilterConfig, LearningConfig

WORDS = ("interaction",)
SERIES = ("cell_sizes", "prior_strengths", "parameter_costs", "rows_per_cell", "softness")
KNOBS = [
    (kind, f.name)
    for kind in (FilterConfig, LearningConfig)
    for f in fields(kind)
    if f.name not in (*SERIES, "interaction")
]


@pytest.mark.parametrize(("kind", "name"), KNOBS)
@pytest.mark.parametrize("value", [0, -1.0, np.nan])
def test_a_knob_that_is_not_positive_is_refused_by_name(kind, name, value):
    with pytest.raises(ValueError, match=f"{name}: expected a positive number, got"):
        kind(**{name: value})


@pytest.mark.parametrize("knobs", [{"outlier_probability": 1.0}, {"resample_below": 1.5}, {"place_free_share": 1.5}])
def test_a_share_above_one_is_refused_by_name(knobs):
    with pytest.raises(ValueError, match=f"{next(iter(knobs))}.*: expected shares"):
        FilterConfig(**knobs)


def test_an_interaction_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="interaction: expected 'none' or 'leader', got 'all'"):
        FilterConfig(interaction="all")


@pytest.mark.parametrize("name", SERIES)
@pytest.mark.parametrize("numbers", [(), (3.0, 0.0), (-1.0,), (np.nan,), (3.0, np.nan)])
def test_numbers_to_choose_from_are_positive_and_there_is_one(name, numbers):
    with pytest.raises(ValueError, match=f"{name}: expected positive numbers"):
        LearningConfig(**{name: numbers})
