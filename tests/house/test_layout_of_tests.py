"""The tests lie where the modules lie that they test."""

from pathlib import Path

import hybridsurrogate

TESTS = Path(__file__).resolve().parents[1]
# what mirrors no room: runs from end to end, rates over seeds, the studies, the package as a whole
APART = {"stories", "statistical", "studies", "house", "benchmarks", "helpers"}


def test_each_folder_mirrors_a_room_of_the_package():
    package = Path(hybridsurrogate.__file__).parent
    folders = {path.parent.relative_to(TESTS) for path in TESTS.rglob("test_*.py")}
    mirrored = {folder for folder in folders if folder.as_posix() not in APART}
    rooms = {folder for folder in mirrored if (package / folder).is_dir()}
    files = {folder for folder in mirrored if (package / folder).with_suffix(".py").is_file()}
    assert mirrored == rooms | files


def test_no_two_files_share_a_name():
    """Their folders are no packages: of two alike pytest imports one, and stops at the other."""
    names = sorted(path.name for path in TESTS.rglob("test_*.py"))
    assert names == sorted({*names})


def test_studies_need_no_tests():
    helpers = {path.stem for path in (TESTS / "helpers").glob("*.py")} | {"tests", "conftest"}
    for path in (TESTS.parent / "examples").rglob("*.py"):
        words = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
        named = {w[1].partition(".")[0] for w in words if len(w) > 1 and w[0] in ("from", "import")}
        assert not named & helpers, path
