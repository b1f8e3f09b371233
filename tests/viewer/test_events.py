"""Initiation, coasting, reinitialisation and end of a track are reported once each."""

from dataclasses import replace

import numpy as np

from dirprim_filter.viewer.texts import Events


def test_a_life_is_reported_from_its_first_estimate_to_its_end(scene_frames):
    def frame_of(unseen_s, *anew):
        estimates = scene_frames[0].estimates[: len(unseen_s)]
        return replace(
            scene_frames[0], estimates=replace(estimates, unseen_s=np.array(unseen_s)), reinitialised=anew
        )  # fmt: skip

    events = Events()
    lives = [([0.0],), ([0.0],), ([0.1],), ([0.6, 0.0],), ([0.0, 0.0],), ([0.0, 0.0], "7"), ([0.0],), ([],)]
    found = [[(level, text.split(":")[0]) for level, text in events.of(frame_of(*life))] for life in lives]
    assert found == [
        [("INFO", "7 initialised")], [], [], [("INFO", "8 initialised"), ("INFO", "7 coasts")],
        [("INFO", "7 measured again")], [("WARN", "7 reinitialised")], [("INFO", "8 ended")], [("INFO", "7 ended")],
    ]  # fmt: skip
