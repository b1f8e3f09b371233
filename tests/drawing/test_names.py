"""Labels of long ids."""

from dirprim_filter.drawing.vehicles import LONGEST, short_name


def test_long_ids_are_shortened_and_keep_their_group_and_both_ends():
    uuid = "3f2b8c1e-0d4a-4f6b-9c7d-1a2b3c4d5e6f"
    assert short_name(uuid) == "3f2b…5e6f"
    assert short_name(f"7/{uuid}") == "7/3f2b…5e6f"
    for name in ("17", "7/car", "x" * LONGEST):
        assert short_name(name) == name
    assert len(short_name("x" * (LONGEST + 1))) < LONGEST
