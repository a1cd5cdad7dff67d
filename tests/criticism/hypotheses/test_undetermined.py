"""What may be nothing does not stand in a model; what is there, does."""

from __future__ import annotations

from dataclasses import replace

import pytest

from onlinebayes.criticism.findings.undetermined import determined
from onlinebayes.criticism.hypotheses.additions import AddedEffect
from onlinebayes.identification.judging.evaluator import FitRequest
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ConstantLoad, QuadraticDrag
from tests.criticism.rigs import explain, measure, model

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
DRAG = QuadraticDrag("rail", Parameter(0.0, 1.0, "N s2/m2"))


@pytest.mark.slow
def test_an_effect_that_may_be_nothing_goes_and_the_one_that_is_there_stays() -> None:
    found = explain(model(), measure({LOAD: (0.5,)}, runs=10), holdout=("run9", "run8"), candidates=["constant_load"])
    assert found.found.hypothesis.keys == ("constant_load@rail",)
    both = found.found.hypothesis.plus(AddedEffect(DRAG))
    fitted = found.evaluator.evaluate(FitRequest(both, [found.found.values]))
    assert fitted is not None
    left, gone = determined(replace(found, found=fitted), None)
    assert gone == ("quadratic_drag@rail",)
    assert left.found.hypothesis.keys == ("constant_load@rail",)
    assert determined(found, None) == (found, ())
