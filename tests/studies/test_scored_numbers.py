"""The scorecard counts every number that a cause estimates."""

import numpy as np
from scorecard import run
from tide import FRAME, context_of

from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.effects.base import NOISE_SD


def test_every_number_of_an_estimate_is_known():
    """An estimate with a word that nobody expects would silently not count."""
    seen = set()
    either_side_of_zero = FRAME.assign(wind=FRAME["wind"] - FRAME["wind"].mean())
    for cause in catalogue(context_of(either_side_of_zero))[0]:
        form = form_of(cause).partition(" over ")[0].replace(": linear", "")
        if form not in run.NUMBERS or getattr(cause, "level", None) is not None:
            continue
        seen.add(form)
        theta = dict.fromkeys(cause.parameters, np.ones(1))
        theta |= {NOISE_SD: np.ones(1)} if cause.follows_slope else {}
        found = cause.estimates(theta, dict.fromkeys(cause.coefficients, np.ones(1)))
        expected = {*run.NUMBERS[form].values()} | run._OTHER_WORDS.get(form, set())
        assert set(found) == expected, form
    assert seen == set(run.NUMBERS)
