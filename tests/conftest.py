import os
import warnings

import numpy as np
import pytest
from agreement import assert_same_numbers
from shared_files import SHARED
from threadpoolctl import threadpool_limits

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.fitting import verdict
from hybridsurrogate.simulation.simulator import Simulator

# processes share the cores already, and sums split among threads are rounded otherwise: one thread
# for what is loaded, and for what is yet to be loaded here and in processes of their own
threadpool_limits(1)
os.environ.setdefault("OMP_NUM_THREADS", "1")

# data sets and examples look where the tests look
os.environ.setdefault("HYBRIDSURROGATE_SHARED", str(SHARED))


def pytest_collection_modifyitems(items):
    """Put what runs longest first: with short tests last, processes end together.

    A test that takes two computations to give the same numbers is marked so.
    """
    longest = ("house", "statistical", "stories", "studies")
    items.sort(key=lambda item: item.path.parent.name not in longest)
    for item in items:
        if assert_same_numbers.__name__ in item.function.__code__.co_names:
            item.add_marker("numbers")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file in one process: else what they share is fitted in each."""
    if config.getvalue("dist") != "load":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Files(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            # these share the diagnosis of each outcome
            return file.rpartition("/")[0] if "diagnosis/report/" in file else file

    config.option.loadscopereorder = False
    return Files(config, log)


def fall(t, gravity):
    return 100 - gravity / 2 * t**2


@pytest.fixture(scope="session")
def simulator():
    """A body that falls: one input, one parameter."""
    return Simulator(
        fall,
        inputs={"t": (0, 4)},
        parameters={"gravity": hs.truncated_normal(9.8, 1, 5, 15)},
        output="height",
    )


@pytest.fixture(scope="session")
def simulation(simulator):
    return simulator.run(32, random_state=0)


@pytest.fixture(scope="session")
def measured():
    """As many measured rows as there are runs of the simulation: t in seconds, height."""
    rng = np.random.default_rng(1)
    t = np.linspace(0.1, 3.9, 32)
    return t[:, None], fall(t, 9.3) + rng.normal(0, 1, 32)


@pytest.fixture(scope="session")
def fitted(simulation, measured):
    """A power-scaled surrogate of the fall, fitted; nobody may change it."""
    model = hs.PowerScaledSurrogate(
        simulation, surrogate=hs.PolynomialChaos(degree=2), n_draws=400, random_state=0
    )
    return model.fit(*measured)


@pytest.fixture(scope="session")
def fitted_mixture(simulation, measured):
    """Predictive weighting of the fall with unequal weights, fitted."""
    model = hs.PredictiveWeightedSurrogate(
        simulation, surrogate=hs.PolynomialChaos(degree=2), beta=0.3, n_draws=400, random_state=0
    )
    return model.fit(*measured)


@pytest.fixture
def verdict_alone(monkeypatch):
    """Leave out what an adequate diagnosis adds: how large a cause of each kind would show."""
    for name in ("detectable", "smallest_detectable"):
        monkeypatch.setattr(verdict, name, lambda *_: None)


@pytest.fixture(scope="session")
def arviz():
    with warnings.catch_warnings():
        # ArviZ 0.x announces its own successor at import
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz
