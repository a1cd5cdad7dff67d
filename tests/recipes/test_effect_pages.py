"""The pages of the effects say what the code says, and their figures are those that the study printed."""

import json
import re
from pathlib import Path

import mujoco
import pytest
import torch

from envs.pendulum import Pendulum
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import EFFECTS, Effect, Scales
from onlinebayes.simulators.mujoco.foreign import not_exportable
from onlinebayes.simulators.mujoco.system import MujocoSystem
from recipes.studies.effect_pages import BEGIN, END, name_of, shown, written
from recipes.studies.effect_pages_likeness import cosine, traces
from recipes.studies.effect_pages_machine import BASE, SPECIMENS, machine, record, specimen_effects, windows_of
from recipes.studies.effect_pages_picture import draw, fingerprint

DOCS = Path(__file__).parents[2] / "docs"
PAGES = DOCS / "effects"
TARGETS = {
    "joint": "hinge", "actuator": "motor", "body": "bob", "geom": "bob", "world": "world",
    "signal": "qpos.hinge", "parameter": "body.bob.mass",
}  # fmt: skip
# Units that depend on what the effect sits on, which its bounds cannot name.
BORROWED_UNITS = {
    ("actuator_dead_zone", "width"): "the command's",
    ("actuator_saturation", "limit"): "the actuator's force, N or N m before the gear",
    ("back_emf", "constant"): "N s/m or N m s/rad before the gear",
    ("servo_law", "limit"): "the actuator's force, N or N m before the gear",
    ("servo_law", "back_emf"): "the actuator's force per speed of the joint",
    ("servo_law", "dead_band"): "the joint's, m or rad",
    ("servo_law", "sag"): "one over the actuator's force squared",
    ("parameter_step", "size"): "the parameter's",
}


def page(name: str) -> str:
    return (PAGES / f"{name}.md").read_text(encoding="utf-8")


def scaled(name: str, unit: str = "hinge") -> Effect:
    sizes = Scales(force=1.0, speed=1.0, travel=1.0, time=0.1, unit=unit)
    return EFFECTS[name].scaled(TARGETS[EFFECTS[name].target_kind], sizes)


def line(name: str, start: str) -> str:
    (found,) = (row for row in page(name).splitlines() if row.startswith(start))
    return found


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_a_page_with_its_parameters_and_their_units(name: str) -> None:
    by_hand = page(name).partition(BEGIN)[0]
    cells = [[cell.strip(" `") for cell in row.split("|")[1:-1]] for row in by_hand.splitlines() if row[:3] == "| `"]
    units = {own: unit.split("; ") for own, _, unit, _ in cells}
    for place, unit in enumerate(("slide", "hinge")):
        effect = scaled(name, unit)
        assert set(units) == set(effect.parameters)
        for own, bounds in effect.parameters.items():
            said = units[own][place if len(units[own]) > 1 else 0]
            wanted = bounds.unit or BORROWED_UNITS.get((name, own), "1")
            assert said == wanted, f"{own} of a {unit}: {wanted}, not {said}"


def test_the_index_names_every_page_and_no_other() -> None:
    rows = re.findall(r"^\| \[(\w+)\]\((\w+)\.md\) \| (\w+) \|", page("README"), flags=re.MULTILINE)
    assert [(name, link) for name, link, _ in rows] == [(name, name) for name in EFFECTS]
    assert {name: kind for name, _, kind in rows} == {name: effect.target_kind for name, effect in EFFECTS.items()}
    assert {path.stem for path in PAGES.glob("*.md")} == {*EFFECTS, "README"}


@pytest.mark.parametrize("key", SPECIMENS)
def test_the_pages_say_what_refined_xml_holds(key: str) -> None:
    effect = EFFECTS[name_of(key)].scaled(key.partition("@")[2], Scales(1.0, 1.0, 1.0, 0.1))
    spec = machine().spec.copy()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # under the study's RK4 no delay is held
    system = MujocoSystem(spec, machine().parameters, [effect])
    values = {**BASE, **{f"{key}.{name}": value for name, value in SPECIMENS[key].items()}}
    held = key not in not_exportable(system, system.parameters.vector(values)[None].numpy())
    assert line(name_of(key), "- **refined.xml**: ").split(": ")[1].startswith("yes" if held else "no")


@pytest.mark.parametrize("name", EFFECTS)
def test_the_pages_say_what_a_torch_system_can_have(name: str) -> None:
    said = next(row for row in page(name).splitlines() if row.startswith("- ") and "**torch**" in row)
    simulator = Pendulum(["mass"], 1)
    kind = EFFECTS[name].target_kind
    target = (*simulator.targets(kind), TARGETS[kind])[0]
    try:
        simulator.with_effect(EFFECTS[name].scaled(target, Scales(1.0, 1.0, 1.0, 0.1)))
        can = True
    except BadInput:
        can = False
    assert ("no form" not in said) == can


@pytest.mark.parametrize("key", SPECIMENS)
def test_figures_and_pictures_are_those_that_the_study_printed(key: str) -> None:
    rows = json.loads((DOCS / "results" / "effect-pages.json").read_text(encoding="utf-8"))["rows"]
    printed = {name_of(row["name"].split()[-1]): row["value"] for row in rows if row["name"].startswith(f"{key} looks")}
    text = page(name_of(key))
    alike = re.findall(r"\[(\w+)\]\(\w+\.md\) \((-?[\d.]+)\)", text.partition("It looks like ")[2])
    assert len(alike) == 3
    assert dict(alike) == {other: f"{value:.4f}" for other, value in printed.items()}
    picture = (PAGES / "images" / f"{name_of(key)}.svg").read_text(encoding="utf-8")
    assert len(picture) < 60_000
    assert "prefers-color-scheme: dark" in picture
    assert f'<title id="title">What a model without {name_of(key)} gets wrong</title>' in picture


def test_what_is_printed_replaces_what_was_printed_before_and_nothing_else() -> None:
    text = f"before\n{BEGIN}\nold\n{END}\nafter\n"
    new = f"{BEGIN}\nnew\n{END}"
    assert written(text, new, "page.md") == f"before\n{new}\nafter\n"
    assert written(written(text, new, "page.md"), new, "page.md") == f"before\n{new}\nafter\n"
    with pytest.raises(BadInput, match="no place for what is printed"):
        written("a page by hand", new, "page.md")


@pytest.fixture(scope="module")
def bare():
    return windows_of(record())


def test_specimens_lie_within_what_diagnose_would_try(bare) -> None:
    effects = specimen_effects(bare)
    assert set(effects) == set(SPECIMENS)
    for key, effect in effects.items():
        effect.parameters.check(effect.parameters.vector(SPECIMENS[key]))


def test_the_values_on_the_pages_are_those_of_the_pictures(bare) -> None:
    for key, effect in specimen_effects(bare).items():
        assert f") with {shown(effect, SPECIMENS[key])} " in page(name_of(key))


@pytest.mark.long
def test_what_is_the_same_has_a_cosine_of_one_and_what_is_free_is_confounded(bare) -> None:
    keys = ("viscous_friction@hinge", "back_emf@motor", "constant_load@hinge", "dry_friction@hinge")
    effects = {key: effect for key, effect in specimen_effects(bare).items() if key in keys}
    simulator = machine()
    found = traces(simulator, bare, simulator.nominal, effects, SPECIMENS)
    viscous, emf, load, dry = (found[key] for key in keys)
    assert viscous.confounded
    assert not load.confounded
    assert cosine(viscous, emf) == pytest.approx(1, abs=1e-6)
    assert cosine(load, load) == pytest.approx(1, abs=1e-9)
    assert abs(cosine(dry, load)) < 0.3  # one turns with the velocity, the other does not
    assert cosine(load, viscous) == 0.0  # the free damping has taken it


@pytest.mark.long
def test_the_missing_torque_is_the_effect_less_what_the_refit_took() -> None:
    key = "dry_friction@hinge"
    effect = EFFECTS["dry_friction"].scaled("hinge", Scales(1.0, 1.0, 1.0, 0.1))
    recording = record(effect, SPECIMENS[key])
    found = fingerprint(machine(), windows_of(recording), recording)
    slow = abs(found.velocity) < 2.0
    slow &= abs(found.velocity) > 0.3
    v, torque = torch.as_tensor(found.velocity[slow]), torch.as_tensor(found.torque[slow])
    size, slope = torch.linalg.lstsq(torch.stack([-v.sign(), v], 1), torque).solution.tolist()
    assert size == pytest.approx(SPECIMENS[key]["frictionloss"], rel=0.1)
    assert slope > 0  # the refitted damping brakes too much
    assert found.left > 5
    assert draw(found, "title").count("<svg") == 9
