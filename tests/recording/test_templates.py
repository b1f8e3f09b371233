"""Filling in the numbers of an encoded message gives what encoding the message anew would."""

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from dirprim_filter.recording.foxglove.templates import MessageTemplates

ENTITIES = SceneUpdate.DESCRIPTOR.fields_by_name["entities"].number


def drawn(name, numbers):
    entity = SceneEntity(id=name, frame_id="map")
    arrow = entity.arrows.add(shaft_length=numbers[0])
    arrow.pose.position.x, arrow.pose.position.y = numbers[1:]
    return entity


def test_filled_in_messages_are_those_drawn_anew():
    rng = np.random.default_rng(0)
    stencils = MessageTemplates(drawn, 3, field=ENTITIES)
    for names in (["a", "b" * 300, ""], ["b" * 300, "new", "a"], [], ["hole"], ["a"] * 3):
        numbers = rng.normal(size=(len(names), 3)) * 10.0 ** rng.integers(-300, 300, (len(names), 3))
        shared = SceneEntity(frame_locked=True)
        shared.timestamp.seconds = int(rng.integers(1, 2**40))
        data = stencils.encode(names, numbers, shared=shared.SerializeToString())
        expected = SceneUpdate()
        for name, row in zip(names, numbers.tolist(), strict=True):
            entity = expected.entities.add()
            entity.CopyFrom(drawn(name, row))
            entity.MergeFrom(shared)
        assert SceneUpdate.FromString(data) == expected


def test_a_nought_and_what_is_not_finite_are_filled_in_too():
    data = MessageTemplates(drawn, 3, field=ENTITIES).encode(["a"], np.array([[0.0, np.inf, -0.0]]), shared=b"")
    arrow = SceneUpdate.FromString(data).entities[0].arrows[0]
    assert (arrow.shaft_length, arrow.pose.position.x, arrow.pose.position.y) == (0.0, np.inf, 0.0)


def test_only_names_that_come_again_are_drawn_once():
    asked = []

    def witnessed(name, numbers):
        asked.append(name)
        return drawn(name, numbers)

    stencils = MessageTemplates(witnessed, 3, field=ENTITIES)
    for names in (["a", "b"], ["b", "a"], ["a"], ["a", "b"]):
        stencils.encode(names, np.zeros((len(names), 3)), shared=b"")
    assert asked == ["a", "b", "b"]  # b left and was forgotten: memory does not grow with the log
