"""Parameter and ParameterSpace: names <-> theta <-> unit cube, and errors that say what to do."""

import math
from collections import ChainMap

import pytest
import torch

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput

SPACE = ParameterSpace(
    {"mass": Parameter(0.1, 2.0, "kg"), "damping": Parameter(1e-4, 1e-1, "N m s", "log"), "load": Parameter(-3, 1, "N")}
)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_unit_cube_is_a_bijection(dtype: torch.dtype) -> None:
    u = torch.rand(1000, 3, dtype=dtype)
    theta = SPACE.from_unit(u)
    assert theta.dtype == dtype
    assert SPACE.contains(theta).all()
    torch.testing.assert_close(SPACE.to_unit(theta), u, atol=2e-6 if dtype == torch.float32 else 1e-12, rtol=0)


def test_the_edges_map_to_the_bounds_exactly() -> None:
    torch.testing.assert_close(SPACE.from_unit(torch.zeros(3, dtype=torch.float64)), SPACE.low, atol=0, rtol=1e-15)
    torch.testing.assert_close(SPACE.from_unit(torch.ones(3, dtype=torch.float64)), SPACE.high, atol=0, rtol=1e-15)


def test_log_abs_det_is_the_jacobian_of_to_unit() -> None:
    theta = SPACE.from_unit(torch.rand(5, 3, dtype=torch.float64))
    for row in theta:
        jacobian = torch.autograd.functional.jacobian(SPACE.to_unit, row)
        torch.testing.assert_close(SPACE.log_abs_det(row), torch.linalg.det(jacobian).abs().log())


def test_names_are_views() -> None:
    theta = SPACE.from_unit(torch.rand(4, 3))
    SPACE.view(theta)["damping"].fill_(0.01)
    assert (theta[:, 1] == 0.01).all()
    assert torch.equal(SPACE.vector(SPACE.view(theta), dtype=torch.float32), theta)


def test_spaces_join_and_select() -> None:
    more = ParameterSpace({"gain": Parameter(-1, 1)})
    assert (SPACE | more).names == ("mass", "damping", "load", "gain")
    assert SPACE.subspace(["load", "mass"]).names == ("load", "mass")
    assert (SPACE | more).subspace(SPACE.names) == SPACE
    with pytest.raises(ValueError, match="both spaces"):
        SPACE | SPACE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((2.0, 1.0), r"bounds \[2.0, 1.0\] are reversed"),
        ((1.0, 1.0), "reversed or empty"),
        ((0.0, math.inf), "not finite"),
        ((0.0, 1.0, "kg", "log"), "log scale cannot start at 0.0; use a positive low bound"),
        ((0.0, 1.0, "kg", "cubic"), "scale 'cubic' is unknown"),
    ],
)
def test_bad_bounds_name_value_rule_and_cure(arguments: tuple, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        Parameter(*arguments)


def test_unknown_names_suggest_the_nearest() -> None:
    with pytest.raises(BadInput, match="parameter 'masss' is unknown; nearest: mass"):
        SPACE.index("masss")


def test_it_answers_as_any_mapping_does() -> None:
    plain = {name: SPACE[name] for name in SPACE}
    for mapping in (SPACE, plain):
        assert mapping.get("mass") == Parameter(0.1, 2.0, "kg")
        assert mapping.get("masss") is None
        assert mapping.get("masss", 3) == 3
        assert "mass" in mapping
        assert "masss" not in mapping
        with pytest.raises(KeyError):
            mapping["masss"]
        with pytest.raises(TypeError):
            mapping.get([])
    assert (list(SPACE), list(SPACE.keys()), len(SPACE)) == (list(plain), list(plain), len(plain))
    assert (list(SPACE.values()), list(SPACE.items())) == (list(plain.values()), list(plain.items()))
    assert dict(SPACE) == {**SPACE} == plain
    assert ChainMap({}, SPACE).get("masss", 3) == 3
    match SPACE:
        case {"masss": _}:
            pytest.fail("no such parameter")
        case {"load": load, **rest}:
            assert load.low == -3
            assert set(rest) == {"mass", "damping"}


def test_an_unknown_name_is_said_in_one_plain_line() -> None:
    for raising in (lambda: SPACE["masss"], lambda: SPACE.replaced("masss", SPACE["mass"])):
        with pytest.raises(BadInput) as caught:
            raising()
        assert str(caught.value) == "parameter 'masss' is unknown; nearest: mass"


def test_check_names_the_first_value_out_of_bounds() -> None:
    theta = SPACE.from_unit(torch.rand(3, 3, dtype=torch.float64))
    SPACE.check(theta)
    theta[1, 0] = 7.0
    with pytest.raises(BadInput, match=r"mass = 7 kg; it must lie in \[0.1, 2\]"):
        SPACE.check(theta)
    assert SPACE.contains(theta).tolist() == [True, False, True]
    assert SPACE.contains(SPACE.clamp(theta)).all()


def test_a_missing_value_is_named() -> None:
    with pytest.raises(BadInput, match="no value for"):
        SPACE.vector({"mass": 1.0})
    with pytest.raises(ValueError, match="theta has 2 columns, the space has 3"):
        SPACE.view(torch.zeros(4, 2))
