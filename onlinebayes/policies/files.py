"""A policy's files: ``policy.safetensors`` holds arrays and card, ``policy.md`` is the card for a reader."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.policies.acting import NumpyPolicy
from onlinebayes.policies.card import PolicyCard
from onlinebayes.policies.network import PolicyNetwork, from_arrays, to_arrays
from onlinebayes.runs import BadInput, one_line, read_arrays, together, write_arrays, write_atomic

FILE, CARD, CONTENT = "policy.safetensors", "policy.md", "onlinebayes policy"


def write_policy(folder: str | Path, network: PolicyNetwork, card: PolicyCard) -> None:
    """Write a policy's two files, whole or not at all.

    Raises:
        BadInput: they cannot be written, or the package safetensors is missing.
    """
    arrays, about = to_arrays(network)
    with together():
        write_arrays(Path(folder) / FILE, CONTENT, arrays, {"network": about, "card": card.to_plain()})
        write_atomic(Path(folder) / CARD, card.to_markdown())


def load_policy(folder: str | Path) -> NumpyPolicy:
    """The policy of a run: ``load_policy("out/pendulum-online-0").act(observation)``.

    Args:
        folder: of a training run, or a ``policy.safetensors`` itself.

    Raises:
        BadInput: there is no policy, or its file is damaged.
    """
    network, card = read_policy(folder)
    return NumpyPolicy(network, card)


def read_policy(folder: str | Path) -> tuple[PolicyNetwork, PolicyCard]:
    """Arrays and card of the policy in a folder; errors as :func:`load_policy`."""
    path = Path(folder)
    if path.is_dir():
        path = path / FILE
        if not path.is_file():
            raise BadInput(
                f"holds no {FILE}",
                "give the folder of a training run; a run says so where its policy cannot be exported",
                where=str(folder),
            )
    arrays, about = read_arrays(path, CONTENT)
    try:
        return from_arrays(arrays, about["network"]), PolicyCard.from_plain(about["card"])
    except (LookupError, TypeError, ValueError) as error:
        raise BadInput(f"is damaged: {one_line(str(error))[:200]}", "copy it anew", where=str(path)) from error
