import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_files import DATA
from mcap_protobuf.decoder import DecoderFactory

from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT
from dirprim_filter.recording.vehicle_lights import read_vehicle_lights
from dirprim_filter.recording.writer import write_tracks

LOG = DATA / "mcap_osi" / "testBrakeAndIndicatorLights.mcap"


@pytest.fixture(scope="module")
def lights():
    if not LOG.exists():
        pytest.skip(f"real logs are not at {LOG.parent}")
    return list(read_vehicle_lights(LOG))


def test_every_light_is_the_one_that_the_stock_decoder_finds(lights):
    expected = []
    with LOG.open("rb") as file:
        for _, _, message, view in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            for mover in view.global_ground_truth.moving_object:
                state = mover.vehicle_classification.light_state
                reported = []
                for name in ("indicator_state", "brake_light_state"):
                    names = state.DESCRIPTOR.fields_by_name[name].enum_type.values_by_number
                    reported.append(names[getattr(state, name)].name.split("_STATE_")[1])
                expected.append((message.log_time, str(mover.id.value), *reported))
    assert lights == expected
    assert {light.indicator for light in lights if light.track_id == "1001"} == {"OFF", "LEFT"}
    assert len({light.brake for light in lights}) > 1


def test_the_signal_of_a_real_vehicle_turns_the_prior_of_a_junction(lights):
    crossing = VonMisesMixture(
        weight=np.full(3, 1 / 3), mean_direction=np.array([-np.pi / 2, 0.0, np.pi / 2]), concentration=np.full(3, 20.0)
    )
    cues = {"LEFT": TURN_LEFT, "RIGHT": TURN_RIGHT}
    to_the_left = {}
    for state in {light.indicator for light in lights if light.track_id == "1001"}:
        belief = multiply_mixtures(crossing, cues[state].belief(0.0)).mixture if state in cues else crossing
        near = np.cos(belief.mean_direction - np.pi / 2) > 0.7
        to_the_left[state] = belief.weight[near].sum()
    assert to_the_left["OFF"] == pytest.approx(1 / 3)
    assert to_the_left["LEFT"] > 0.8


def test_a_log_without_osi_has_no_lights(ring, tmp_path):
    write_tracks(ring[ring.track_id < 2], tmp_path / "ring.mcap")
    assert list(read_vehicle_lights(tmp_path / "ring.mcap")) == []
