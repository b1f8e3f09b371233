"""`dirprim plot`: a map from the command line."""

from matplotlib.image import imread

from cli.commands import DONE, dirprim


def test_a_part_of_the_map(here, capsys):
    for name, extent in (("a", "0 0 20 20"), ("b", "0 0 20 10")):
        assert dirprim(f"plot map.mcap --log log.mcap -o {name}.png --extent {extent}") == DONE
    assert capsys.readouterr().out == "a.png\nb.png\n"
    a, b = (imread(f"{name}.png").shape for name in "ab")
    assert a[1] == b[1] == 7.9 * 200
    assert b[0] < a[0]  # half as deep a part is drawn on a flatter page
