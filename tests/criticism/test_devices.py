"""Criticism follows the device of the measurement."""

from __future__ import annotations

import dataclasses
import json
from typing import ClassVar

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.criticism import Scope, Selection, compare, refine, worlds_of
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.replaying.timed import instants
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.posterior import posterior_of_log
from onlinebayes.report.html import to_html
from onlinebayes.report.json import to_json
from onlinebayes.simulators import Actuator, Joint, TorchSimulator
from onlinebayes.simulators.effects import ConstantLoad
from tests.criticism.rigs import FREE, measure, model

STEP, ROWS, RUNS = 0.01, 201, 9


class Slider(TorchSimulator):
    """A sprung mass on a rail."""

    physical = ParameterSpace({"mass": Parameter(0.1, 10.0, "kg")})
    defaults: ClassVar = {"mass": 2.0}
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = STEP

    def acceleration(self, parameters, q, v, tau):
        return (tau - 4.0 * v - 20.0 * q) / parameters["mass"]


def recorded(slider: Slider | None = None, theta: tuple[float, ...] = (2.0,), runs: int = RUNS) -> Measurement:
    """Runs of the slider with a noisy sensor."""
    slider = Slider(["mass"]) if slider is None else slider
    truth, time, table = torch.tensor([theta]).double(), torch.arange(ROWS, dtype=torch.float64) * STEP, {}
    for r in range(runs):
        force = (torch.sin((3 + r) * time) + torch.sin(6.7 * time + r))[:, None]
        inputs = TensorDict({"command": force[None, :-1]}, batch_size=(1, ROWS - 1))
        path = slider.rollout(truth, slider.with_worlds(1).state, inputs, time[1:])
        q = torch.cat([torch.zeros(1), path["qpos"][0, :, 0]])
        q = q + 1e-3 * torch.randn(q.shape, generator=torch.Generator().manual_seed(r), dtype=q.dtype)
        table[f"run{r}"] = {"time": time.numpy(), "ctrl.motor": force[:, 0].numpy(), "qpos.rail": q.numpy()}
    return Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=1e-3)], commands=["motor"])


def elsewhere(windows: Windows) -> Windows:
    """The same windows without their values, on a device of which nothing mixes with the CPU's."""
    tensors = {f.name: getattr(windows, f.name) for f in dataclasses.fields(windows)}
    moved = {name: value.to("meta") for name, value in tensors.items() if isinstance(value, Tensor)}
    return dataclasses.replace(windows, **moved, run_histories=())


def test_what_is_made_of_windows_lies_where_they_lie() -> None:
    data = measure(runs=3)
    windows = elsewhere(make_windows(model(), data, 1.0))
    assert [instant.device.type for instant in instants(windows)] == ["meta", "meta"]
    simulator = ScopedSimulator(model(), Scope((FREE.names[0],)), data.runs)
    assert simulator.touches(windows).device.type == "meta"
    phi = torch.ones(2, len(simulator.parameters), dtype=torch.float64, device="meta")
    assert simulator.of_windows(phi, windows).shape == (2, windows.count, len(FREE))


@pytest.mark.gpu
def test_on_a_gpu_it_gives_what_the_cpu_gives() -> None:
    data, found = recorded(), {}
    for device in ("cpu", "cuda"):
        result = compare(Slider(["mass"], device=device), data.to(device), selection=Selection(horizon_s=0.8))
        assert result.final.theta.device.type == device
        found[device] = result
    assert found["cuda"].verdict == found["cpu"].verdict
    torch.testing.assert_close(found["cuda"].final.theta.cpu(), found["cpu"].final.theta, rtol=1e-6, atol=1e-8)


@pytest.mark.gpu
def test_an_effect_is_found_on_a_gpu_as_on_the_cpu() -> None:
    load = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
    data, found = recorded(Slider(["mass"]).with_effect(load), (2.0, 0.4), runs=5), {}
    for device in ("cpu", "cuda"):
        model, few = Slider(["mass"], device=device), ["constant_load"]
        found[device] = refine(model, data.to(device), selection=Selection(horizon_s=0.8), candidates=few)
    assert found["cpu"].accepted == ("constant_load@rail",)
    assert found["cuda"].accepted == found["cpu"].accepted
    for name, estimate in found["cpu"].parameters.items():
        assert found["cuda"].parameters[name].mean == pytest.approx(estimate.mean, rel=1e-4)
    worlds = worlds_of(found["cuda"])
    theta = worlds.sample((8,), torch.Generator().manual_seed(0))
    torch.testing.assert_close(worlds.mean, worlds_of(found["cpu"]).mean, rtol=1e-4, atol=1e-8)
    assert worlds.simulator.with_worlds(8).reset(theta).device.type == "cuda"
    assert "constant_load" in to_html(found["cuda"], title="slider")
    json.loads(to_json(found["cuda"]))


@pytest.mark.gpu
def test_values_of_every_run_on_a_gpu() -> None:
    data, found = recorded(runs=4), {}
    for device in ("cpu", "cuda"):
        scope = Scope(("mass",))
        model, given = Slider(["mass"], device=device), data.to(device)
        found[device] = compare(model, given, holdout=["run3"], selection=Selection(horizon_s=0.8), scope=scope)
    torch.testing.assert_close(found["cuda"].final.theta.cpu(), found["cpu"].final.theta, rtol=1e-5, atol=1e-8)


@pytest.mark.gpu
def test_the_posterior_of_a_log_on_a_gpu_is_that_of_the_cpu() -> None:
    data, found = recorded(), {}
    for device in ("cpu", "cuda"):
        posterior = posterior_of_log(Slider(["mass"], device=device), data.to(device))
        found[device] = posterior.belief.sample((500,), torch.Generator().manual_seed(0)).cpu()
    torch.testing.assert_close(found["cuda"].mean(0), found["cpu"].mean(0), rtol=1e-3, atol=0)
    torch.testing.assert_close(found["cuda"].std(0), found["cpu"].std(0), rtol=0.1, atol=0)
