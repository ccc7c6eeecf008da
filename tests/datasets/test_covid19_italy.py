"""A download that is checked and kept; no test needs a network."""

import hashlib
import pickle
import shutil

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from shared_files import shared_path

from hybridsurrogate.datasets import covid19_italy, fetch_covid19_italy

COLUMNS = ["date", "confirmed", "recovered", "deaths", "active", "tests"]


def italian_days(n=80):
    """Invented days in the form of the official file, with more columns and days than are used."""
    day = np.arange(n)
    table = pd.DataFrame({"data": pd.date_range("2020-02-24", periods=n)})
    table["data"] = table["data"].dt.strftime("%Y-%m-%dT17:00:00")
    table["stato"] = "ITA"
    table["totale_positivi"] = 200 + 17 * day
    table["dimessi_guariti"] = 1 + 3 * day
    table["deceduti"] = 5 + 2 * day
    table["totale_casi"] = 206 + 22 * day
    table["tamponi"] = 4000 + 100 * day
    return table


def digest_of(table):
    lines = [
        f"{row.data[:10]},{row.totale_casi},{row.dimessi_guariti},{row.deceduti},"
        f"{row.totale_positivi},{row.tamponi}"
        for row in table.itertuples()
    ]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@pytest.fixture
def official(tmp_path, monkeypatch):
    """The folder of an official file that is invented; the package takes its numbers for right."""
    folder = tmp_path / "official"
    folder.mkdir()
    table = italian_days()
    table.to_csv(folder / covid19_italy.FILE, index=False, lineterminator="\r\n")
    monkeypatch.setattr(covid19_italy, "CHECKSUM", digest_of(table[:74]))
    # scikit-learn wants the name of a host
    address = (folder / covid19_italy.FILE).as_uri().replace("file:///", "file://localhost/")
    monkeypatch.setattr(covid19_italy, "URL", address)
    monkeypatch.delenv("HYBRIDSURROGATE_SHARED", raising=False)
    return folder


def test_italy_is_fetched_once_and_kept(official, tmp_path):
    home = tmp_path / "home"
    data = fetch_covid19_italy(home)
    assert data.data.shape == (74, 1)
    assert list(data.data["t"]) == list(range(1, 75))
    assert list(data.frame.columns) == ["t", *COLUMNS, data.target.name]
    assert data.frame["date"].iloc[-1] == pd.Timestamp("2020-05-07")
    day = np.arange(74)
    expected = (206 + 22 * day - 1 - 3 * day) / 60_421_760 * 1e5
    np.testing.assert_allclose(data.target, expected)
    shutil.rmtree(official)
    again = fetch_covid19_italy(home)
    pd.testing.assert_frame_equal(again.frame, data.frame)


def test_italy_reads_a_local_copy_first(official, tmp_path, monkeypatch):
    monkeypatch.setattr(covid19_italy, "URL", "https://nowhere.invalid/file.csv")
    assert len(fetch_covid19_italy(official, download_if_missing=False).target) == 74
    shared = tmp_path / "shared"
    (shared / "data").mkdir(parents=True)
    shutil.copy(official / covid19_italy.FILE, shared / "data")
    monkeypatch.setenv("HYBRIDSURROGATE_SHARED", str(shared))
    assert len(fetch_covid19_italy(tmp_path / "empty").target) == 74
    assert not list((tmp_path / "empty").iterdir())


@pytest.mark.parametrize("download", [True, False])
def test_italy_says_what_to_do_without_a_network(official, tmp_path, download):
    (official / covid19_italy.FILE).unlink()
    home = tmp_path / "home"
    with pytest.raises(OSError, match="Download") as caught:
        fetch_covid19_italy(home, download_if_missing=download, n_retries=0)
    assert covid19_italy.URL in str(caught.value)
    assert str(home / covid19_italy.FILE) in str(caught.value)
    assert not list(home.iterdir())


@pytest.mark.parametrize("where", ["home", "official"])
def test_italy_refuses_other_numbers(official, tmp_path, where):
    folder = tmp_path / where
    folder.mkdir(exist_ok=True)
    path = folder / covid19_italy.FILE
    table = italian_days()
    table.loc[30, "totale_casi"] += 1
    table.to_csv(path, index=False)
    with pytest.raises(OSError, match="checksum") as caught:
        fetch_covid19_italy(tmp_path / "home")
    # the file to delete, whether it lay there or was just downloaded
    assert str(tmp_path / "home" / covid19_italy.FILE) in str(caught.value)


def test_italy_refuses_a_file_of_another_kind(official, tmp_path):
    (tmp_path / covid19_italy.FILE).write_text("<html>not found</html>")
    with pytest.raises(OSError, match="checksum"):
        fetch_covid19_italy(tmp_path)


def test_italy_has_the_official_numbers(tmp_path):
    shared_path("data", "italy_covid19_wave1.csv")
    data = fetch_covid19_italy(tmp_path, download_if_missing=False)
    # read in the official file at the pinned commit: day, then the columns in order
    official = {
        1: ("2020-02-24", 229, 1, 7, 221, 4324),
        15: ("2020-03-09", 9172, 724, 463, 7985, 53826),
        45: ("2020-04-08", 139422, 26491, 17669, 95262, 807125),
        57: ("2020-04-20", 181228, 48877, 24114, 108237, 1398024),
        74: ("2020-05-07", 215858, 96276, 29958, 89624, 2381288),
    }
    rows = data.frame.set_index("t").loc[list(official), COLUMNS]
    assert [tuple(row) for row in rows.assign(date=rows["date"].astype(str)).to_numpy()] == list(
        official.values()
    )


def test_italian_simulation_is_an_epidemic_from_the_first_day(official):
    data = fetch_covid19_italy(official)
    simulator = data.simulator
    assert simulator.output == data.target.name
    assert simulator.parameter_names == ("contact_rate", "recovery_rate")
    t = np.array([1.0, 20.0, 74.0])
    first = data.target[0]

    def rates(_, state):
        new = 0.3 * state[0] * state[1] / 1e5
        return [-new, new - 0.1 * state[1]]

    solved = solve_ivp(
        rates, (1, 74), [1e5 - first, first], t_eval=t, method="DOP853", rtol=1e-10, atol=1e-10
    )
    ours = simulator(t, np.tile([0.3, 0.1], (3, 1)))
    np.testing.assert_allclose(ours, solved.y[1], rtol=1e-4)
    assert repr(pickle.loads(pickle.dumps(simulator))) == repr(simulator)


def test_italian_description_names_source_licence_and_units(official):
    described = fetch_covid19_italy(official).DESCR
    for word in ("Source: ", "Licence: CC-BY-4.0", "Units: ", covid19_italy.URL):
        assert described.count(word) == 1, word
