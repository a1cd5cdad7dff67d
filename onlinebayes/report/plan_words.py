"""The sentences about a planned experiment, for the terminal and the page: said once, here."""

from __future__ import annotations

from onlinebayes.criticism import Plan, Rivalry, Tried
from onlinebayes.identification import LEAST_GAIN


def headline(plan: Plan) -> str:
    """State the plan in one sentence."""
    if not plan.decides:
        return "No admissible recording decides what is open"
    return f"Play '{described(plan.chosen)}' for {float(plan.time[-1]):.3g} s"


def described(tried: Tried) -> str:
    """An input with what is fixed to the machine."""
    load = f", with {tried.payload.mass:g} kg fixed to body '{tried.payload.body}'" if tried.payload else ""
    return f"{tried.name}{load}"


def beginning(plan: Plan) -> str:
    """From where it begins."""
    posture = ", ".join(
        f"{joint} = {round(q, 6) + 0.0:.4g}" for joint, q in zip(plan.joints, plan.start.tolist(), strict=True)
    )
    return f"at rest, {posture}"


def outcome(rivalry: Rivalry) -> str:
    """Name the outcome for one pair of rivals in a word or two."""
    if rivalry.structural:
        return "structural"
    if rivalry.too_small:
        return "too small"
    return "decides" if rivalry.decides else "left open"


def expected(rivalry: Rivalry) -> str:
    """Describe what the chosen input can decide about one pair of rivals."""
    first, second = rivalry.names
    if rivalry.structural:
        return f"{first} or {second}: at most {rivalry.best:.2g} sigma under any admissible input"
    if rivalry.too_small:
        return f"{first} or {second}: {rivalry.sigma:.3g} sigma, but {acceptance(rivalry)}"
    weak = "" if rivalry.decides else f", not enough (another input gives {rivalry.best:.3g})"
    return f"{first} or {second}: {rivalry.sigma:.3g} sigma{weak}; {acceptance(rivalry)}"


def acceptance(rivalry: Rivalry) -> str:
    """State whether the true one would be preferred for what it shows; of an added effect, from which size on."""
    size = f"{rivalry.accepted_from:.3g} {rivalry.unit}".rstrip() if rivalry.accepted_from is not None else ""
    return (
        f"the true one would gain {rivalry.gain:.2g} nats, and {LEAST_GAIN:g} are asked"
        f"{f': accepted from about {size} on' if size else ''}"
    )


def remedy(rivalry: Rivalry) -> str:
    """Describe the remedy that would part a structural pair; empty for others."""
    if not rivalry.structural:
        return ""
    if not rivalry.remedies:
        return (
            "neither a velocity sensor nor a mass on a body parts them; wider limits may, "
            "or a sensor of the force or torque itself"
        )
    return "; ".join(f"{remedy.what} would ({remedy.sigma:.3g} sigma)" for remedy in rivalry.remedies[:2])


def instructions(plan: Plan) -> str:
    """Describe the use of the command table."""
    return (
        f"play next.csv at least {plan.recordings} times, log it as before, add the tables to 'measurements', "
        "name one of the recordings under 'holdout', and run refine again"
    )
