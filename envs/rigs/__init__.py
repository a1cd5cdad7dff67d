"""Eight rigs that play reality, with equations and an integrator of their own, and the blind cases made with them."""

from envs.rigs.cases import KINDS, LEVELS, BlindCase, case, effect_case, hidden_in, kinds, sized_case
from envs.rigs.catalogue import RIGS
from envs.rigs.files import write_case
from envs.rigs.messy import messy_case, messy_machine
from envs.rigs.off_numbers import OffNumber
from envs.rigs.rig import HiddenEffect, Protocol, Rig, Tie

__all__ = [
    "KINDS",
    "LEVELS",
    "RIGS",
    "BlindCase",
    "HiddenEffect",
    "OffNumber",
    "Protocol",
    "Rig",
    "Tie",
    "case",
    "effect_case",
    "hidden_in",
    "kinds",
    "messy_case",
    "messy_machine",
    "sized_case",
    "write_case",
]
