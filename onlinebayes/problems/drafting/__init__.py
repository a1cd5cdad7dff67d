"""A first problem file from a model and its logs: columns matched, units and bounds proposed, doubts as comments."""

from onlinebayes.problems.drafting.draft_text import cure, doubt
from onlinebayes.problems.drafting.first_draft import Draft, draft
from onlinebayes.problems.drafting.idle_parts import held
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.problems.drafting.proposals import proposed
from onlinebayes.problems.drafting.surroundings import weld_of

__all__ = ["Draft", "Match", "cure", "doubt", "draft", "held", "proposed", "weld_of"]
