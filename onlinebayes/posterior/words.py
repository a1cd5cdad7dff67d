"""A posterior in plain words, for a terminal: labelled sentences, the same ones in posterior.json."""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.identification import quantities
from onlinebayes.posterior.results import LogPosterior, ParameterBelief, Reproduction

RINGS = 0.05
"""P below which the alarm rings."""

CERTAIN = 0.01
"""P below which it says that the model cannot have made the measurement; above, it may be chance."""


def lines(found: LogPosterior) -> list[tuple[str, str]]:
    """(label, sentence), in the order in which they are to be read: every parameter, the least known first."""
    named = sorted(found.parameters.items(), key=lambda one: -one[1].of_prior)
    told = [("posterior" if k == 0 else "", parameter(*one)) for k, one in enumerate(named)]
    told.append(("known", known(found)))
    told.append(("worlds", reproductions(found)))
    if said := alarm(found):
        told.append(("alarm", said))
    return [*told, *(("note", note) for note in notes(found)[:1])]


def parameter(name: str, value: ParameterBelief) -> str:
    """``body.bob.mass 0.41 ± 0.01 kg, 90 % 0.394 to 0.427 kg, 3 % of its prior``."""
    text = quantities.with_error(value.mean, value.sd, value.unit)
    within = quantities.interval(value.q05, value.q95, value.unit)
    return f"{name} {text}, 90 % {within}, {quantities.percent(min(value.of_prior, 1.0))} of its prior"


def title(found: LogPosterior) -> str:
    """``dry_friction@hinge + constant_load@hinge``."""
    return " + ".join(found.accepted) or "the model as it is"


def known(found: LogPosterior) -> str:
    """Name the parameters that are known, and those known only together; their widths stand above where all are."""
    of = found.identifiability
    said = str(of) if of.unknown or of.combinations else "every parameter by itself"
    return said if found.surprise >= CERTAIN else f"{said}, in a model that cannot have made this log (see the alarm)"


def reproductions(found: LogPosterior) -> str:
    """Describe the signal that the posterior's worlds follow least well, and count the other signals."""
    if not found.reproduction:
        return "none can be followed"
    signal, value = max(found.reproduction.items(), key=lambda one: one[1].rms / max(one[1].noise, 1e-300))
    rest = len(found.reproduction) - 1
    return f"{reproduction(signal, value)}{f'; {rest} more in posterior.json' if rest else ''}"


def reproduction(signal: str, value: Reproduction) -> str:
    """``they miss qpos.hinge by 6.3 mrad (6.1 to 6.6); noise 6.1 mrad``."""
    scale = quantities.scale_for(value.rms, value.unit)
    span = f"{scale.number(value.q05)} to {scale.number(value.q95)}"
    noise = quantities.text(value.noise, value.unit)
    return f"they miss {signal} by {scale.text(value.rms)} ({span}); noise {noise}"


def alarm(found: LogPosterior) -> str:
    """Warn that hardly a world of the model can be what was measured; nothing where one can."""
    if found.surprise >= RINGS:
        return ""
    p = quantities.significant(found.surprise, 1)
    where = f", {found.strange} most" if len(found.reproduction) > 1 else ""
    if found.surprise >= CERTAIN:
        often = round(1 / found.surprise)
        return (
            f"the measurement is unusual for the model (p {p}{where}): of a right model one log in {often} is; "
            "onlinebayes refine asks what may be missing"
        )
    return (
        f"the measurement is unlike anything that the model can do (p {p}{where}): onlinebayes refine asks what is "
        "missing in it"
    )


def notes(found: LogPosterior) -> tuple[str, ...]:
    """List the notes on how the posterior was made, and its own."""
    method, said = found.method, list[str]()
    if method.linear:
        said.append(
            f"{method.draws} replays are worth {method.effective:.0f} draws, too few: the model is taken as linear "
            "around its fit"
        )
    return (*said, *found.notes)


def side_by_side(models: Sequence[LogPosterior]) -> list[tuple[str, str]]:
    """Every model that the log leaves open, its weight before its own lines."""
    told: list[tuple[str, str]] = []
    for k, one in enumerate(models, 1):
        told += [(f"model {k}", f"{quantities.percent(one.weight)}: {title(one)}"), *lines(one)]
    return told
