"""New logs against a refined model: does it still hold, what changed, since when, and how sure that is."""

from onlinebayes.criticism.checking.check import check
from onlinebayes.criticism.checking.results import FALSE_ALARMS, Change, Check, Drift, DriftPoint, ErrorNow, Since

__all__ = ["FALSE_ALARMS", "Change", "Check", "Drift", "DriftPoint", "ErrorNow", "Since", "check"]
