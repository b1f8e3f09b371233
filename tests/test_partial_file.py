"""A file takes its name when it is whole, and takes it from no other."""

import errno
import os

import pytest

from dirprim_filter.partial_file import OutputExistsError, PartialFile


@pytest.mark.parametrize("has_links", [True, False])
def test_of_two_that_write_one_name_the_second_says_so_and_keeps_what_it_wrote(
    tmp_path, monkeypatch, caplog, has_links
):
    if not has_links:
        monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(OSError(errno.EPERM, "not permitted")))
    path = tmp_path / "out.mcap"
    one = PartialFile(path, force=False)
    one.__enter__().write(b"one")
    with PartialFile(path, force=False) as other:
        other.write(b"other")
    with pytest.raises(OutputExistsError, match=r"out\.mcap: expected a new file"):
        one.close(whole=True)
    assert path.read_bytes() == b"other"
    (left,) = tmp_path.glob("*.partial")
    assert left.read_bytes() == b"one"
    assert f"{left}: holds what was written" in caplog.text
    with PartialFile(path, force=True) as third:
        third.write(b"third")
    assert path.read_bytes() == b"third"


@pytest.mark.parametrize("keep", [True, False])
def test_an_exception_leaves_what_was_written_if_it_is_to_be_kept(tmp_path, keep):
    def write():
        with PartialFile(tmp_path / "out", force=False, keep=keep) as file:
            file.write(b"half")
            raise OSError(errno.ENOSPC, "no space left")

    with pytest.raises(OSError, match="no space"):
        write()
    assert [left.read_bytes() for left in tmp_path.iterdir()] == [b"half"] * keep
