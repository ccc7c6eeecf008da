"""Simulations that are programs: started, read, stopped, and counted where they fail."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import uniform

import hybridsurrogate as hs

RATE = {"rate": uniform(0.1, 0.4)}
T = {"t": (0, 10)}
PRINTS = "import math, sys; print('decay', math.exp(-float(sys.argv[1]) * float(sys.argv[2])))"
WRITES = """
import math, sys
settings = dict(line.split('=') for line in open('settings.txt').read().split('\\n') if line)
rate, times = float(settings['rate']), [float(t) for t in settings['times'].split()]
print('I was here')
with open('out.csv', 'w') as file:
    print('t,level', file=file)
    for t in times:
        print(f'{t!r},{math.exp(-rate * t)!r}', file=file)
"""
SETTINGS = {"settings.txt": "rate={rate}\ntimes={t}\n"}


def python(code, *arguments):
    return [sys.executable, "-c", code.replace("{", "{{").replace("}", "}}"), *arguments]


def test_the_last_number_that_is_printed():
    simulator = hs.CommandSimulator(python(PRINTS, "{rate}", "{t}"), T, RATE)
    t, rate = np.array([1.0, 3.0]), np.array([0.3, 0.2])
    np.testing.assert_array_equal(simulator(t, rate), np.exp(-rate * t))


@pytest.mark.slow
def test_curves_from_an_input_file_to_a_csv_file():
    simulator = hs.CommandSimulator(
        python(WRITES), T, RATE, output="level", files=SETTINGS, read="out.csv", returns="curve"
    )
    data = simulator.run(8, random_state=0, along=6, n_jobs=2)
    assert data.n_runs == 8
    np.testing.assert_allclose(data.y, np.exp(-data.omega[:, 0] * data.X[:, 0]), rtol=1e-14)
    assert repr(simulator).startswith("CommandSimulator(python")


def test_a_program_with_places_of_its_own_is_interpolated():
    code = (
        "import math, sys\nwith open('out.csv', 'w') as f:\n    print('t,y', file=f)\n"
        "    for k in range(1001):\n        print(k / 100, 2 * k / 100, sep=',', file=f)"
    )
    simulator = hs.CommandSimulator(
        python(code, "{rate}"), T, RATE, read="out.csv", returns="curve"
    )
    t = np.array([0.123, 5.678, 9.999])
    np.testing.assert_allclose(simulator(t, np.full(3, 0.2)), 2 * t)


def test_a_reader_of_ones_own():
    simulator = hs.CommandSimulator(
        python(PRINTS, "{rate}", "{t}"), T, RATE, read=lambda folder, said: len(said.split())
    )
    assert simulator([1.0], [0.2]) == [2.0]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import sys; sys.exit('no mesh')", r"ended with code 1: no mesh"),
        ("print('nan')", r"NaN or infinity"),
        ("print('done')", r"printed 0 numbers of 1"),
        ("import time; time.sleep(60)", r"longer than 1 s and was stopped"),
    ],
)
def test_runs_that_fail_are_counted(code, said):
    ok = f"import sys\nif float(sys.argv[1]) > 0.45:\n    exec({code!r})\nelse:\n    print(1 + "
    ok += "float(sys.argv[2]))"
    simulator = hs.CommandSimulator(python(ok, "{rate}", "{t}"), T, RATE, timeout=1)
    with pytest.warns(hs.FailedRunsWarning, match=rf"2 of 16 runs of '.*' failed .*{said}"):
        data = simulator.run(16, random_state=0, ends=0, n_jobs=2)
    assert data.n_runs == 14


def test_a_file_that_was_not_written():
    simulator = hs.CommandSimulator(python("pass", "{rate}", "{t}"), T, RATE, read="out.csv")
    with pytest.raises(ValueError, match=r"All 4 runs .* wrote no file 'out.csv'"):
        simulator.run(4, random_state=0)


@pytest.mark.parametrize(
    ("command", "files", "said"),
    [
        ("no-such-solver {rate} {t}", {}, r"There is no program 'no-such-solver'"),
        ("", {}, r"There is no program ''"),
        ([sys.executable, "{rate}", "{depth}"], {}, r"uses \['depth'\]; there are"),
        ([sys.executable, "{rate}"], {}, r"a place for \['t'\]: write \{t\}"),
        ([sys.executable, "{rate}"], {"in.txt": "{t} {"}, r"template of 'in.txt' is broken"),
    ],
)
def test_what_cannot_run_is_refused_at_once(command, files, said):
    with pytest.raises(ValueError, match=said):
        hs.CommandSimulator(command, T, RATE, files=files)


@pytest.mark.slow
def test_a_finished_program_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    code = (
        "import hybridsurrogate as hs, sys\nfrom scipy.stats import uniform\n"
        "s = hs.CommandSimulator([sys.executable, '-c', 'print({rate} * {t})'], {'t': (0, 10)}, "
        "{'rate': uniform(0, 1)})\nprint(s([2.0], [0.5]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[1.]"]
    assert list(tmp_path.glob("hybridsurrogate-*")) == []
