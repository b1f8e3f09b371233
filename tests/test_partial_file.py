"""A file takes its name when it is whole, and takes it from no other."""

import errno
import os
import socket
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

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


def written(path, *, force):
    with PartialFile(path, force=force) as file:
        file.write(b"new")


@pytest.mark.parametrize("force", [True, False])
def test_devices_and_pipes_are_written_to_and_stay_what_they_are(tmp_path, caplog, force):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with ThreadPoolExecutor(1) as reader:
        got = reader.submit(fifo.read_bytes)
        written(fifo, force=force)
        assert got.result(timeout=20) == b"new"
    assert stat.S_ISFIFO(fifo.stat().st_mode)
    end = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with PartialFile(fifo, force=force) as file:
        os.close(end)
        file.write(b"to nobody")
    assert "its reader has left" in caplog.text
    written("/dev/null", force=force)
    with pytest.raises(OSError, match="make room there"):
        written("/dev/full", force=force)
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    if os.geteuid() == 0:
        device = tmp_path / "device"
        os.mknod(device, 0o600 | stat.S_IFCHR, os.makedev(1, 3))
        written(device, force=force)
        assert stat.S_ISCHR(device.stat().st_mode)
    assert not list(tmp_path.glob("*.partial"))


def test_of_a_symlink_the_target_is_replaced_and_keeps_its_mode(tmp_path):
    old, link, dangling = tmp_path / "old", tmp_path / "link", tmp_path / "dangling"
    old.write_bytes(b"old")
    old.chmod(0o640)
    link.symlink_to("old")
    dangling.symlink_to("made")
    with pytest.raises(OutputExistsError):
        written(link, force=False)
    written(link, force=True)
    written(dangling, force=False)
    assert link.is_symlink()
    assert dangling.is_symlink()
    assert old.read_bytes() == (tmp_path / "made").read_bytes() == b"new"
    assert stat.S_IMODE(old.stat().st_mode) == 0o640


@pytest.mark.parametrize("kind", ["folder", "socket", "loop", "block device", "no folder", "file as folder", "long"])
def test_what_cannot_be_a_file_is_refused_before_the_work_and_stays(tmp_path, kind):
    path = tmp_path / "there"
    if kind == "folder":
        path.mkdir()
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
    elif kind == "loop":
        path.symlink_to(path)
    elif kind == "block device":
        if os.geteuid() != 0:
            pytest.skip("only root makes devices")
        os.mknod(path, 0o600 | stat.S_IFBLK, os.makedev(7, 250))
    elif kind == "file as folder":
        path.write_bytes(b"old")
        path /= "x"
    else:
        path = path / "x" if kind == "no folder" else path.with_name(300 * "x")
    before = sorted(tmp_path.rglob("*")), [os.lstat(one).st_mode for one in sorted(tmp_path.rglob("*"))]
    with pytest.raises(OSError):  # noqa: PT011 (what it says is of the system)
        PartialFile(path, force=True)
    assert before == (sorted(tmp_path.rglob("*")), [os.lstat(one).st_mode for one in sorted(tmp_path.rglob("*"))])
