"""A file is written whole, or is what it was before."""

import os
import stat

import pytest

from hybridsurrogate.numerics.atomic_file import check_writable, written_whole


def test_a_file_takes_its_place_at_the_end(tmp_path):
    path = tmp_path / "figure.png"
    with written_whole(path) as part:
        part.write_text("new")
        # a writer of pictures goes by the ending
        assert part.suffix == ".png"
        assert part.parent == tmp_path
        assert not path.exists()
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["figure.png"]


@pytest.mark.parametrize("stop", [OSError("disk full"), KeyboardInterrupt()])
def test_what_was_there_stays_where_writing_stops(tmp_path, stop):
    path = tmp_path / "report.html"
    path.write_text("old")

    def write():
        with written_whole(path) as part:
            part.write_text("ne")
            raise stop

    with pytest.raises(type(stop)):
        write()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["report.html"]


def test_permissions_are_those_of_any_new_file_or_of_the_old_one(tmp_path):
    plain, new = tmp_path / "plain", tmp_path / "new"
    plain.write_text("")
    with written_whole(new) as part:
        part.write_text("")
    assert stat.S_IMODE(new.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
    new.chmod(0o640)
    with written_whole(new) as part:
        part.write_text("again")
    assert stat.S_IMODE(new.stat().st_mode) == 0o640


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "far").mkdir()
    link = tmp_path / "latest.html"
    link.symlink_to(tmp_path / "far" / "report.html")
    with written_whole(link) as part:
        part.write_text("new")
    assert link.is_symlink()
    assert (tmp_path / "far" / "report.html").read_text() == "new"


def test_a_device_stays_a_device():
    with written_whole("/dev/null") as part:
        part.write_text("gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_where_nothing_can_be_written(tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"folder '.*missing' does not exist\. Make it"):
        check_writable(tmp_path / "missing" / "report.html")
    with pytest.raises(IsADirectoryError, match="name a file in it"):
        check_writable(tmp_path)
    # whoever tests as root may write anywhere
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(PermissionError, match="you may not write there"):
        check_writable(tmp_path / "report.html")
