"""How many files of the package a reader of one run follows."""

import sys
from pathlib import Path

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin

ROOT = Path(hs.__file__).parent


def files_entered(job):
    """Return the files of the package in which a function is called while a job runs."""
    entered = set()

    def note(frame, event, _):
        # a module's own lines run where it is imported, which is no call
        if event == "call" and frame.f_code.co_name != "<module>":
            entered.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        job()
    finally:
        sys.setprofile(None)
    return {Path(name) for name in entered if ROOT in Path(name).parents}


def test_the_package_has_few_files():
    assert len(list(ROOT.rglob("*.py"))) <= 250


def test_a_fit_and_a_diagnosis_enter_few_files():
    """The diagnosis entered 168 files before those of one algorithm were merged."""
    case = make_log_sin(random_state=0)
    surrogate = hs.PolynomialChaos(degree=5)
    model = hs.PowerScaledSurrogate(case.simulation, surrogate=surrogate, random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    of_fit = files_entered(lambda: model.fit(case.X, case.y))
    assert ROOT / "estimators" / "power_scaled.py" in of_fit
    assert len(of_fit) <= 40
    of_diagnosis = files_entered(lambda: diagnosis.fit(case.X, case.y))
    assert ROOT / "diagnosis" / "search" / "search.py" in of_diagnosis
    assert len(of_diagnosis) <= 100
