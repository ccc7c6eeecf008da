"""The first wave of COVID-19 in Italy, and an epidemic whose contact rate never falls."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sklearn.datasets import fetch_file, get_data_home
from sklearn.utils import Bunch

from hybridsurrogate.datasets.measured import measured_bunch
from hybridsurrogate.ode.simulator import OdeSimulator
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.types import FloatArray

FILE = "dpc-covid19-ita-andamento-nazionale.csv"
URL = (
    "https://raw.githubusercontent.com/pcm-dpc/COVID-19/"
    f"fc82987b9ebda01fe8e5b59d5667e3e00721edb9/dati-andamento-nazionale/{FILE}"
)
# sha256 of the days and columns that are used, so that an excerpt and other line ends will do
CHECKSUM = "f875cb88783f371c173cd7227b9f94f44f5fce8944d8e5d01a683bd40d991974"
# an excerpt with English names
_EXCERPT = "italy_covid19_wave1.csv"
_NAMES = {
    "data": "date",
    "totale_casi": "confirmed",
    "dimessi_guariti": "recovered",
    "deceduti": "deaths",
    "totale_positivi": "active",
    "tamponi": "tests",
}
# days to 7 May 2020, and inhabitants: numbers are of 100,000 of them
_N_DAYS = 74
_POPULATION, _PER = 60_421_760, 100_000


def epidemic_slopes(
    t: float, state: FloatArray, contact_rate: FloatArray, recovery_rate: FloatArray
) -> FloatArray:
    """Return the slopes of susceptible and infected per 100,000 in an SIR epidemic."""
    new = contact_rate * state[0] * state[1] / _PER
    return np.stack([-new, new - recovery_rate * state[1]])


def infected_per_100k(state: FloatArray) -> FloatArray:
    """Return the infected, and at least one in Italy, as a log-normal likelihood needs."""
    return np.maximum(state[1], 0.001)


def fetch_covid19_italy(
    data_home: str | os.PathLike[str] | None = None,
    download_if_missing: bool = True,
    n_retries: int = 3,
    delay: float = 1.0,
) -> Bunch:
    """Load Italy's first wave of COVID-19, 24 February to 7 May 2020; download it if need be.

    The simulation is an SIR epidemic with constant rates. In fact contacts fell with the lockdown
    of 9 March (t = 15).

    Parameters
    ----------
    data_home : str, path or None, default=None
        Folder in which the official file is sought and kept; None: that of scikit-learn, see
        `sklearn.datasets.get_data_home`. After it ``$HYBRIDSURROGATE_SHARED/data`` is searched.
    download_if_missing : bool, default=True
        False: raise an OSError if there is no local copy.
    n_retries : int, default=3
        Further tries of a download that fails.
    delay : float, default=1.0
        Seconds between them.

    Returns
    -------
    sklearn.utils.Bunch
        data : DataFrame of shape (74, 1)
            The column ``t``, in days: 24 February is 1.
        target : Series of shape (74,)
            Confirmed less recovered cases per 100,000 inhabitants.
        frame : DataFrame
            Both, the date, and the official cumulative counts ``confirmed``, ``recovered``,
            ``deaths`` and ``tests`` with the currently ``active``.
        simulator : OdeSimulator
            Parameters: ``contact_rate`` and ``recovery_rate`` per day. It starts from the first
            day's infected.
        DESCR : str
            A description.

    Raises
    ------
    OSError
        If there is neither a local copy nor a network, or if the numbers are not those expected.

    Notes
    -----
    From the repository of the Dipartimento della Protezione Civile [1]_ at a fixed commit, licence
    CC-BY-4.0; the package does not contain it. As published in [2]_, those who died count as
    infected.

    References
    ----------
    .. [1] https://github.com/pcm-dpc/COVID-19
    .. [2] P. Reiser, P.-C. Bürkner, A. Guthke, "Bayesian Surrogate Training on Multiple Data
       Sources: A Hybrid Modeling Strategy", arXiv:2412.11875, 2024.

    Examples
    --------
    >>> from hybridsurrogate.datasets import fetch_covid19_italy
    >>> italy = fetch_covid19_italy()  # doctest: +SKIP
    >>> italy.data.shape  # doctest: +SKIP
    (74, 1)
    """
    home = Path(get_data_home(data_home))
    shared = os.environ.get("HYBRIDSURROGATE_SHARED")
    folders = [home] if shared is None else [home, Path(shared) / "data"]
    paths = [folder / name for folder in folders for name in (FILE, _EXCERPT)]
    local = next((path for path in paths if path.exists()), None)
    table = _read(local or _download(home, download_if_missing, n_retries, delay))
    target = _PER * (table["confirmed"] - table["recovered"]) / _POPULATION
    frame = table.assign(date=pd.to_datetime(table["date"]))
    frame.insert(0, "t", np.arange(1.0, _N_DAYS + 1))
    frame["infected_per_100k"] = target
    first = float(target[0])
    simulator = OdeSimulator(
        epidemic_slopes,
        initial_state=[_PER - first, first],
        observe=infected_per_100k,
        inputs={"t": (1, _N_DAYS)},
        parameters={
            "contact_rate": truncated_normal(0.3, 0.1, 0.1, 1.3),
            "recovery_rate": truncated_normal(0.2, 0.1, 0.1, 0.6),
        },
        states=("susceptible", "infected"),
        output="infected_per_100k",
        max_step=0.5,
    )
    return measured_bunch(
        frame,
        simulator,
        "COVID-19 in Italy, confirmed less recovered cases, 24 February to 7 May 2020, against "
        "an SIR epidemic with constant rates.\n"
        f"Source: Presidenza del Consiglio dei Ministri, Dipartimento della Protezione Civile, "
        f"{URL}\n"
        "Licence: CC-BY-4.0.\n"
        "Units: days since 23 February 2020; persons, or persons per 100,000; rates per day.",
    )


def _download(home: Path, allowed: bool, n_retries: int, delay: float) -> Path:
    missing = f"{home / FILE} does not exist"
    advice = f"Download {URL} where there is a network and save it as {home / FILE}."
    if not allowed:
        raise OSError(f"{missing}, and download_if_missing is False. {advice}")
    try:
        return Path(fetch_file(URL, folder=home, n_retries=n_retries, delay=delay))
    except OSError as error:
        raise OSError(f"{missing} and could not be downloaded ({error}). {advice}") from error


def _read(path: Path) -> pd.DataFrame:
    """Return the used days and columns of the official file or of the excerpt."""
    table = pd.read_csv(path, comment="#", nrows=_N_DAYS).rename(columns=_NAMES)
    wanted = list(_NAMES.values())
    if set(wanted) <= set(table.columns):
        table = table[wanted].assign(date=table["date"].astype(str).str[:10])
        rows: Any = table.itertuples(index=False)
        lines = "\n".join(",".join(map(str, row)) for row in rows)
        if hashlib.sha256(lines.encode()).hexdigest() == CHECKSUM:
            return table
    raise OSError(
        f"The numbers in {path} are not the expected ones: their checksum differs. Delete the file "
        "and call again, or download it anew from " + URL
    )
