from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from dirprim_filter.recording.reader import stream_detections

LOG = Path(__file__).parents[1] / "data" / "indicator_lights.mcap"
TURN = {"INDICATOR_STATE_LEFT": np.pi / 2, "INDICATOR_STATE_RIGHT": -np.pi / 2}


def test_every_indicator_light_that_the_stock_decoder_finds_is_a_cue():
    expected = []
    with LOG.open("rb") as file:
        for _, _, _, view in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            for mover in view.global_ground_truth.moving_object:
                state = mover.vehicle_classification.light_state
                names = state.DESCRIPTOR.fields_by_name["indicator_state"].enum_type.values_by_number
                turn = TURN.get(names[state.indicator_state].name, np.nan)
                expected.append((str(mover.id.value), turn, turn and 0 * turn + 2.5))
    seen = list(stream_detections(LOG))
    found = [(name, *cue) for frame in seen for name, cue in zip(frame.track_id.tolist(), frame.cue, strict=True)]
    assert [name for name, *_ in found] == [name for name, *_ in expected]
    np.testing.assert_array_equal([cue for _, *cue in found], [cue for _, *cue in expected])
    assert {name for name, turn, _ in expected if not np.isnan(turn)} == {"1001"}
