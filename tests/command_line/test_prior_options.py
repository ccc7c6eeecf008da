"""Priors and assumed constants as they are typed."""

import pytest

from hybridsurrogate.command_line.priors import assumed_of, prior_of


@pytest.mark.parametrize(
    ("text", "mean", "sd", "support"),
    [
        ("2,0.5", 2, 0.5, (-float("inf"), float("inf"))),
        # wide ends cut off nothing that shows
        ("2,0.5,-8,12", 2, 0.5, (-8, 12)),
        ("1..4", 2.5, 3 / 12**0.5, (1, 4)),
        ("-3..-1", -2, 2 / 12**0.5, (-3, -1)),
    ],
)
def test_a_prior_has_the_moments_that_were_typed(text, mean, sd, support):
    prior = prior_of("speed", text)
    assert prior.mean() == pytest.approx(mean)
    assert prior.std() == pytest.approx(sd)
    assert prior.support() == pytest.approx(support)


def test_of_runs_a_normal_prior_ends_with_them():
    assert prior_of("speed", "2,0.5", ((1.0, 3.0), 80)).support() == pytest.approx((1, 3))


@pytest.mark.parametrize(
    "text", ["2", "2,0", "2,-1", "a,b", "1,2,3", "0,1,2,1", "nan,1", "1..", ""]
)
def test_a_text_that_is_no_prior(text):
    with pytest.raises(ValueError, match=f"--prior speed={text}: write NAME=MEAN,SD"):
        prior_of("speed", text)


def test_an_assumed_constant():
    constant = assumed_of("rate", "0.5,0.3,0.9")
    assert constant.value == 0.5
    assert constant.prior.support() == pytest.approx((0.3, 0.9))
    assert assumed_of("rate", "0.5", (0.2, 1.0)).prior.support() == pytest.approx((0.2, 1.0))
    for text in ("0.5", "0.5,0.9,0.3", "half,0,1", "0.5,1"):
        with pytest.raises(ValueError, match=r"write NAME=VALUE,LOW,HIGH"):
            assumed_of("rate", text)
